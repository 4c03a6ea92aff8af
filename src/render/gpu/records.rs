//! What a kernel reads where a ray has met something, in one texture of texels of four words: instances, materials, corners of
//! triangles, vertices, extensions, reliefs. A software device reads a texel at once, but a buffer number by number
//! (docs/benchmarks.md), and a pass may have four storage textures at most.

use crate::compile::{CompiledScene, Detail, Extended, Instance, Material, NONE};
use bytemuck::{Pod, Zeroable};

/// Words of a texel.
const WORDS: usize = 4;

/// Where each kind begins, and where the attributes lie in a vertex, in texels: part of the frame.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
#[allow(missing_docs, reason = "named as in the shader")]
pub struct Places {
    pub materials: u32,
    pub corners: u32,
    pub vertices: u32,
    pub vertex_stride: u32,
    pub vertex_normal: u32,
    pub vertex_tangent: u32,
    pub vertex_color: u32,
    pub vertex_uvs: u32,
    pub extended: u32,
    pub detail: u32,
}

impl Places {
    /// Those of a scene. [`NONE`]: its vertices lack the attribute.
    pub fn of(scene: &CompiledScene) -> Self {
        let layout = &scene.layout;
        let mut vertex_stride = 0;
        let mut attribute = |there: u32| {
            let place = if there == NONE { NONE } else { vertex_stride };
            vertex_stride += u32::from(there != NONE);
            place
        };
        let [vertex_normal, vertex_tangent, vertex_color, vertex_uvs] =
            [layout.normal, layout.tangent, layout.color, layout.uv[0]].map(&mut attribute);
        let vertex_count = scene.vertices.len().checked_div(layout.stride as usize).unwrap_or(0) as u32;
        let texels = |bytes: usize| (bytes / (4 * WORDS)) as u32;
        let materials = texels(size_of_val(&scene.instances[..]));
        let corners = materials + texels(size_of_val(&scene.materials[..]));
        let vertices = corners + scene.indices.len() as u32;
        let extended = vertices + vertex_count * vertex_stride;
        let detail = extended + texels(size_of_val(&scene.extended[..]));
        Self {
            materials,
            corners,
            vertices,
            vertex_stride,
            vertex_normal,
            vertex_tangent,
            vertex_color,
            vertex_uvs,
            extended,
            detail,
        }
    }
}

const _: () = assert!(
    size_of::<Instance>().is_multiple_of(4 * WORDS)
        && size_of::<Material>().is_multiple_of(4 * WORDS)
        && size_of::<Extended>().is_multiple_of(4 * WORDS)
        && size_of::<Detail>().is_multiple_of(4 * WORDS),
    "records begin with a texel"
);

/// The words of all texels.
pub fn words(scene: &CompiledScene) -> Vec<u32> {
    let mut words: Vec<u32> = bytemuck::cast_slice(&scene.instances).to_vec();
    words.extend_from_slice(bytemuck::cast_slice(&scene.materials));
    words.extend(scene.indices.iter().flat_map(|[a, b, c]| [*a, *b, *c, 0]));
    push_vertices(&mut words, scene);
    words.extend_from_slice(bytemuck::cast_slice(&scene.extended));
    words.extend_from_slice(bytemuck::cast_slice(&scene.details));
    words
}

/// Each attribute in a texel of its own, both sets of texture coordinates in one.
fn push_vertices(words: &mut Vec<u32>, scene: &CompiledScene) {
    let layout = &scene.layout;
    let uvs = if layout.uv[1] == NONE { 2 } else { 4 };
    let attributes = [(layout.normal, 3), (layout.tangent, 4), (layout.color, 4), (layout.uv[0], uvs)];
    let attributes = attributes.map(|(from, count)| (from as usize, count));
    for vertex in scene.vertices.chunks_exact(layout.stride.max(1) as usize) {
        for (from, count) in attributes.iter().filter(|(from, _)| *from != NONE as usize) {
            let mut texel = [0; WORDS];
            texel[..*count].copy_from_slice(&vertex[*from..from + count]);
            words.extend_from_slice(&texel);
        }
    }
}
