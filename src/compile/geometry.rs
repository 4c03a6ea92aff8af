//! Meshes and materials -> triangles and vertices; the way through the room.

use super::alpha::{AlphaTest, Presence};
use super::assemble::assemble;
use super::emitters::Emission;
use super::groups::{Group, Groups, too_large};
use super::look::{Look, MapFiles, Sphere};
use super::materials::{self, Key, Table};
use super::motion::{self, MovingSoup};
use super::textures::{Space, Textures};
use super::vertices::{self, Placement, UV_SETS};
use super::walk::{chosen_scene, invalid};
use super::{CompileError, CompileStats, CompiledScene, LightTree, NONE, Triangle};
use crate::params::{FieldError, RenderParams};
use crate::scene::{DrawnOver, Mesh, Primitive, Scene, SceneError, TextureRef};
use glam::{DAffine3, DVec3, Vec2, Vec3};
use std::collections::{BTreeMap, BTreeSet};
use std::time::Instant;

/// Most emitting triangles, counted per instance.
const MAX_EMITTERS: u64 = 1 << 26;

/// Compiles what a scene of the file shows. None: its default scene, else its first.
///
/// # Errors
/// [`CompileError::Params`] if there is no scene of that index, [`CompileError::Scene`] if an image cannot be decoded
/// or the scene is beyond a limit.
pub fn compile_scene(scene: &Scene, scene_index: Option<usize>) -> Result<CompiledScene, CompileError> {
    let params = RenderParams { scene: scene_index, ..RenderParams::default() };
    compile_request(scene, &params, &MapFiles::new())
}

/// Compiles what a request shows of a file: one of its scenes, in a variant, with other values and maps for some materials, and
/// spheres. `files` has the pictures that the parameters name.
///
/// # Errors
/// Those of [`compile_scene`], and [`CompileError::Params`] if the file has no variant or material of a name.
pub fn compile_request(scene: &Scene, params: &RenderParams, files: &MapFiles) -> Result<CompiledScene, CompileError> {
    let variant = params.variant.as_deref().map(|name| variant_index(scene, name)).transpose()?;
    let chosen = chosen_scene(scene, params.scene)?;
    let poses = motion::poses(scene, params)?;
    let drawn = match &poses[..] {
        [] => DrawnOver { still: scene.drawn(chosen)?, moving: Vec::new() },
        poses => DrawnOver::new(poses, chosen)?,
    };
    let groups = Groups::new(&drawn, variant);
    groups.check_size()?;
    let look = Look::new(scene, params, files)?;
    let origin = groups.centre(&look.spheres)?;
    let mut keys: BTreeSet<Key> = groups.primitives().map(|primitive| primitive.material).collect();
    let uv_sets = uv_sets(&texture_uses(&look, &keys))?;
    let sources: BTreeMap<Key, _> = keys.iter().map(|key| (*key, materials::source(&look, *key))).collect();
    keys.extend(look.spheres.iter().map(|sphere| Some(sphere.material)));
    let uses = texture_uses(&look, &keys);
    let textures = Textures::decode(&look, &uses)?;
    let table = Table::new(&look, &keys, &textures);
    let primitives = groups.primitives().map(|primitive| (primitive, &sources[&primitive.material]));
    let layout = vertices::layout(primitives, uv_sets);
    groups.check_vertices(&layout)?;

    let surfaces =
        Surfaces { table: &table, variant, alpha: table.alpha_tests(&textures), emissions: table.emissions(&textures) };
    let mut compiled = CompiledScene { origin, layout, ..CompiledScene::default() };
    let mut merged = merged_soup(&groups, &surfaces, &mut compiled);
    merged.add_spheres(&look.spheres, &table, origin);
    let soups: Vec<Soup> =
        groups.instanced.iter().map(|group| object_soup(group.mesh, &surfaces, &mut compiled)).collect();
    // Last, so that what moves lies behind everything else.
    let moving = MovingSoup::new(&groups, &surfaces, &mut compiled);
    check_emitters([Some(&merged), moving.as_ref().map(|moving| &moving.soup)], &soups, &groups.instanced)?;
    let start = Instant::now();
    assemble(&mut compiled, &table, merged, soups, moving, &groups.instanced)?;
    let used: BTreeSet<usize> = uses.iter().map(|(_, use_)| use_.texture).collect();
    compiled.stats = CompileStats {
        textures: textures.decoded,
        triangles: compiled.stats.triangles - look.spheres.len() as u64,
        instanced_triangles: compiled.stats.instanced_triangles - look.spheres.len() as u64,
        spheres: look.spheres.len() as u64,
        unused_textures: (look.textures.len() - used.len()) as u64,
        texture_seconds: textures.seconds,
        bvh_seconds: start.elapsed().as_secs_f64(),
        ..compiled.stats
    };
    drop(surfaces);
    compiled.materials = table.materials;
    compiled.extended = table.extended;
    compiled.details = table.details;
    compiled.color_pages = textures.color;
    compiled.data_pages = textures.data;
    compiled.min_roughness = materials::min_roughness(&compiled);
    compiled.light_tree = LightTree::new(&compiled);
    Ok(compiled)
}

fn variant_index(scene: &Scene, name: &str) -> Result<usize, FieldError> {
    scene.variants.iter().position(|variant| variant == name).ok_or_else(|| {
        let known = if scene.variants.is_empty() {
            "the file has none (KHR_materials_variants)".to_owned()
        } else {
            format!("the file has {}", scene.variants.join(", "))
        };
        FieldError::new("/params/variant", format!("there is no variant `{name}`; {known}"))
    })
}

/// Uses of textures by the materials behind the keys.
fn texture_uses(look: &Look, keys: &BTreeSet<Key>) -> Vec<(Space, TextureRef)> {
    keys.iter().flat_map(|key| materials::uses(look, *key)).collect()
}

fn uv_sets(uses: &[(Space, TextureRef)]) -> Result<usize, SceneError> {
    let sets = uses.iter().map(|(_, use_)| use_.uv_set + 1).max().unwrap_or(0);
    if sets > UV_SETS {
        let detail = format!("a material reads {sets} sets of texture coordinates; at most {UV_SETS} are supported");
        return Err(invalid("too_many_uv_sets", "/materials", &detail));
    }
    Ok(sets)
}

fn check_emitters(in_world: [Option<&Soup>; 2], soups: &[Soup], groups: &[Group]) -> Result<(), SceneError> {
    let lit = |soup: &Soup| soup.luminance.iter().filter(|l| **l > 0.0).count() as u64;
    let instanced = soups.iter().zip(groups).map(|(soup, group)| lit(soup) * group.worlds.len() as u64);
    let emitters = in_world.into_iter().flatten().map(lit).sum::<u64>() + instanced.sum::<u64>();
    if emitters > MAX_EMITTERS {
        return Err(too_large(&format!("{emitters} emitting triangles; at most {MAX_EMITTERS} are supported")));
    }
    Ok(())
}

/// All merged meshes in world space, relative to the origin.
fn merged_soup(groups: &Groups, surfaces: &Surfaces, compiled: &mut CompiledScene) -> Soup {
    let mut soup = Soup::default();
    for (mesh, world) in &groups.merged {
        let map = DAffine3 { translation: world.translation - compiled.origin, ..*world };
        soup.add_mesh(mesh, &Placement::new(map), surfaces, compiled);
    }
    soup
}

/// A mesh in its own space.
fn object_soup(mesh: &Mesh, surfaces: &Surfaces, compiled: &mut CompiledScene) -> Soup {
    let mut soup = Soup::default();
    soup.add_mesh(mesh, &Placement::new(DAffine3::IDENTITY), surfaces, compiled);
    soup
}

/// What materials say about triangles.
pub struct Surfaces<'a> {
    table: &'a Table,
    /// Variant of the materials.
    pub variant: Option<usize>,
    alpha: Vec<AlphaTest<'a>>,
    emissions: Vec<Emission<'a>>,
}

/// Triangles before they are in a tree.
#[derive(Default)]
pub struct Soup {
    /// In the order of the file.
    pub triangles: Vec<Triangle>,
    /// Vertices of each.
    pub indices: Vec<[u32; 3]>,
    /// Mean luminance of each; zero: does not emit.
    pub luminance: Vec<f32>,
    /// Triangles of no area are kept: they move, and may get one.
    pub moves: bool,
    /// Triangles seen, those left out included.
    seen: u32,
}

impl Soup {
    fn add_spheres(&mut self, spheres: &[Sphere], table: &Table, origin: DVec3) {
        for sphere in spheres {
            let center = (sphere.center - origin).as_vec3().to_array();
            let shape = [sphere.radius as f32, f32::from(sphere.axis as u8), 0.0];
            let material = table.index(Some(sphere.material)) as u32 | Triangle::SPHERE;
            self.triangles.push(Triangle {
                v0: center,
                material,
                v1: shape,
                light: NONE,
                v2: [0.0; 3],
                primitive: self.seen,
            });
            self.indices.push([0; 3]);
            self.luminance.push(0.0);
            self.seen += 1;
        }
    }

    /// Leaves out the triangles that do not stay.
    pub fn keep(&mut self, stays: &[bool]) {
        fn filter<T>(all: &mut Vec<T>, stays: &[bool]) {
            let mut stays = stays.iter();
            all.retain(|_| stays.next() == Some(&true));
        }
        filter(&mut self.triangles, stays);
        filter(&mut self.indices, stays);
        filter(&mut self.luminance, stays);
    }

    fn add_mesh(&mut self, mesh: &Mesh, placement: &Placement, surfaces: &Surfaces, compiled: &mut CompiledScene) {
        for primitive in mesh.primitives.iter().map(|primitive| primitive.of_variant(surfaces.variant)) {
            let first_vertex = compiled.vertex_count();
            vertices::push(&mut compiled.vertices, &compiled.layout, primitive, placement);
            self.add_primitive(primitive, placement, surfaces, first_vertex, &mut compiled.stats);
        }
    }

    /// Adds the triangles of a primitive whose vertex records begin with `first_vertex`.
    pub fn add_primitive(
        &mut self,
        primitive: &Primitive,
        placement: &Placement,
        surfaces: &Surfaces,
        first_vertex: u32,
        stats: &mut CompileStats,
    ) {
        let material = surfaces.table.index(primitive.material);
        let (alpha, emission) = (&surfaces.alpha[material], &surfaces.emissions[material]);
        for indices in &primitive.triangles {
            let ordinal = self.seen;
            self.seen += 1;
            let indices = if placement.mirrored { [indices[0], indices[2], indices[1]] } else { *indices };
            let corners = corners(primitive, placement, indices).filter(|(_, area, _)| self.moves || *area > 0.0);
            let Some((indices, _, [v0, v1, v2])) = corners else {
                stats.degenerate_triangles += 1;
                continue;
            };
            let presence = alpha.presence(uvs(primitive, alpha.uv_set(), indices), alphas(primitive, indices));
            if presence == Presence::Absent {
                continue;
            }
            let flag = if presence == Presence::Partial { Triangle::ALPHA } else { 0 };
            let (v0, v1, v2) = (v0.to_array(), v1.to_array(), v2.to_array());
            let material = material as u32 | flag;
            self.triangles.push(Triangle { v0, material, v1, light: NONE, v2, primitive: ordinal });
            self.indices.push(indices.map(|index| first_vertex + index));
            self.luminance.push(emission.luminance(uvs(primitive, emission.uv_set(), indices)));
        }
    }
}

impl CompiledScene {
    /// Vertices stored so far.
    pub(super) fn vertex_count(&self) -> u32 {
        self.vertices.len().checked_div(self.layout.stride as usize).unwrap_or(0) as u32
    }
}

/// Corners of a triangle where it is stored, their indices, turned so that the longest edge lies opposite to the first
/// ([`Triangle::v0`]), and the square of twice its area; none: it is not finite.
fn corners(primitive: &Primitive, placement: &Placement, mut indices: [u32; 3]) -> Option<([u32; 3], f64, [Vec3; 3])> {
    let point = |index: u32| primitive.positions.get(index as usize).map(|p| placement.point(*p));
    let mut corners = [point(indices[0])?, point(indices[1])?, point(indices[2])?];
    let [a, b, c] = corners.map(|v| v.as_dvec3());
    let area = (b - a).cross(c - a).length_squared();
    let opposite = [[b, c], [c, a], [a, b]].map(|[from, to]| from.distance_squared(to));
    let first = (1..3).fold(0, |first, i| if opposite[i] > opposite[first] { i } else { first });
    corners.rotate_left(first);
    indices.rotate_left(first);
    corners.iter().all(|v| v.is_finite()).then_some((indices, area, corners))
}

fn uvs(primitive: &Primitive, set: Option<usize>, indices: [u32; 3]) -> [Vec2; 3] {
    set.map_or([Vec2::ZERO; 3], |set| indices.map(|index| vertices::uv(primitive, set, index as usize)))
}

fn alphas(primitive: &Primitive, indices: [u32; 3]) -> [f32; 3] {
    let colors = primitive.colors.as_ref();
    indices.map(|index| colors.and_then(|colors| colors.get(index as usize)).map_or(1.0, |color| color.w))
}
