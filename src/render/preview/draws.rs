//! What is drawn: meshes by their triangles; blended triangles and spheres by lists.

use crate::compile::{CompiledScene, Instance, Triangle, View};
use glam::{Affine3A, Vec3};
use std::ops::Range;

/// (triangle, instance) of what is drawn by itself.
#[derive(Debug, Default)]
pub struct Listed {
    /// From far to near.
    pub blended: Vec<[u32; 2]>,
    /// In the scene's order.
    pub spheres: Vec<[u32; 2]>,
}

impl Listed {
    /// What a view of a scene needs.
    pub fn new(scene: &CompiledScene, view: &View) -> Self {
        Self { blended: blended_triangles(scene, view), spheres: spheres(scene) }
    }
}

fn spheres(scene: &CompiledScene) -> Vec<[u32; 2]> {
    if scene.stats.spheres == 0 {
        return Vec::new();
    }
    let of_mesh = |(instance, mesh): (u32, Range<u32>)| {
        let spheres = mesh.filter(|triangle| scene.triangles[*triangle as usize].is_sphere());
        spheres.map(move |triangle| [triangle, instance])
    };
    (0..).zip(meshes(scene)).flat_map(of_mesh).collect()
}

/// Triangles of each instance's mesh: from its first to the next mesh's.
fn meshes(scene: &CompiledScene) -> Vec<Range<u32>> {
    let all = scene.triangles.len() as u32;
    let first = |instance: &Instance| if scene.two_level { instance.first_triangle } else { 0 };
    let mut firsts: Vec<u32> = scene.instances.iter().map(first).collect();
    firsts.sort_unstable();
    let range = |instance| {
        let first = first(instance);
        first..firsts.get(firsts.partition_point(|&other| other <= first)).copied().unwrap_or(all)
    };
    scene.instances.iter().map(range).collect()
}

/// Vertices and instance of each draw: three vertices a triangle.
pub fn draws(scene: &CompiledScene) -> Vec<(Range<u32>, u32)> {
    meshes(scene).into_iter().map(|mesh| 3 * mesh.start..3 * mesh.end).zip(0..).collect()
}

/// (triangle, instance) of what is blended, from far to near.
fn blended_triangles(scene: &CompiledScene, view: &View) -> Vec<[u32; 2]> {
    let is_blended = |triangle: &Triangle| {
        let material = scene.materials.get(triangle.material());
        triangle.material & Triangle::ALPHA != 0 && material.is_some_and(|material| material.alpha_cutoff == -1.0)
    };
    let blended: Vec<u32> =
        (0..).zip(&scene.triangles).filter(|(_, t)| is_blended(t)).map(|(index, _)| index).collect();
    if blended.is_empty() {
        return Vec::new();
    }
    let to_view = view.to_world.inverse();
    let mut found: Vec<(f32, [u32; 2])> = Vec::new();
    for (index, (instance, mesh)) in (0..).zip(scene.instances.iter().zip(meshes(scene))) {
        let rows = instance.to_world.map(glam::Vec4::from_array);
        let matrix = glam::Mat4::from_cols(rows[0], rows[1], rows[2], glam::Vec4::W).transpose();
        let to_view = to_view * Affine3A::from_mat4(matrix);
        let from = blended.partition_point(|&triangle| triangle < mesh.start);
        for &triangle in blended[from..].iter().take_while(|&&triangle| triangle < mesh.end) {
            let Triangle { v0, v1, v2, .. } = scene.triangles[triangle as usize];
            let centre = [v0, v1, v2].into_iter().map(Vec3::from_array).sum::<Vec3>() / 3.0;
            found.push((to_view.transform_point3(centre).z, [triangle, index]));
        }
    }
    // The camera looks along -z; what is as far keeps the order of the scene.
    found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    found.into_iter().map(|(_, entry)| entry).collect()
}
