//! Meshes and where they stand -> triangles, vertices, instances and trees.
//!
//! A mesh drawn once is moved to world space and merged with its like into one tree; a mesh drawn several times is
//! stored once, with an instance each. So is a mesh whose placement cannot be inverted: merged, once per placement.

use super::alpha::{AlphaTest, Presence};
use super::bvh::{self, Tree};
use super::emitters::{self, Emission};
use super::materials::{self, Key, Table};
use super::textures::{Space, Textures};
use super::vertices::{self, Placement, UV_SETS};
use super::walk::{invalid, placed_nodes};
use super::{Bounds, BvhNode, CompileError, CompileStats, CompiledScene, Instance, NONE, Triangle, VertexLayout};
use crate::scene::{Mesh, Primitive, Scene, SceneError, SceneErrorKind, TextureRef};
use glam::{DAffine3, DVec3, Vec2, Vec3};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::time::Instant;

/// Largest extent of a scene: squares and areas of what is smaller stay far from the limits of f32.
const MAX_EXTENT: f64 = 1e15;
/// Most triangles that are stored.
const MAX_TRIANGLES: u64 = 1 << 27;
/// Most instances.
const MAX_INSTANCES: usize = 1 << 24;
/// Most emitting triangles, counted per instance.
const MAX_EMITTERS: u64 = 1 << 26;
/// Volume of a placement's unit cube, relative to its edges, below which it counts as flat.
const FLAT: f64 = 1e-6;

/// Compiles what a scene of the file shows. None: its default scene, else its first.
///
/// # Errors
/// [`CompileError::Params`] if there is no scene of that index, [`CompileError::Scene`] if an image cannot be decoded
/// or the scene is beyond a limit.
pub fn compile_scene(scene: &Scene, scene_index: Option<usize>) -> Result<CompiledScene, CompileError> {
    let groups = Groups::new(scene, scene_index)?;
    groups.check_size()?;
    let origin = groups.centre()?;
    let keys = groups.primitives().map(|primitive| primitive.material).collect();
    let uses = texture_uses(scene, &keys);
    let uv_sets = uv_sets(&uses)?;
    let textures = Textures::decode(scene, &uses)?;
    let table = Table::new(scene, &keys, &textures);
    let sources: BTreeMap<Key, _> = keys.iter().map(|key| (*key, materials::source(scene, *key))).collect();
    let drawn = groups.primitives().map(|primitive| (primitive, &sources[&primitive.material]));
    let layout = vertices::layout(drawn, uv_sets);
    groups.check_vertices(&layout)?;

    let surfaces =
        Surfaces { table: &table, alpha: table.alpha_tests(&textures), emissions: table.emissions(&textures) };
    let mut compiled = CompiledScene { origin, layout, ..CompiledScene::default() };
    let merged = groups.merged_soup(origin, &surfaces, &mut compiled);
    let soups: Vec<Soup> = groups.instanced.iter().map(|group| group.soup(&surfaces, &mut compiled)).collect();
    check_emitters(&merged, &soups, &groups.instanced)?;
    let start = Instant::now();
    assemble(&mut compiled, &table, merged, soups, &groups.instanced);
    let used: BTreeSet<usize> = uses.iter().map(|(_, use_)| use_.texture).collect();
    compiled.stats = CompileStats {
        textures: textures.decoded,
        unused_textures: (scene.textures.len() - used.len()) as u64,
        texture_seconds: textures.seconds,
        bvh_seconds: start.elapsed().as_secs_f64(),
        ..compiled.stats
    };
    drop(surfaces);
    compiled.materials = table.materials;
    compiled.color_pages = textures.color;
    compiled.data_pages = textures.data;
    compiled.min_roughness = materials::min_roughness(&compiled);
    Ok(compiled)
}

/// Uses of textures by the materials behind the keys.
fn texture_uses(scene: &Scene, keys: &BTreeSet<Key>) -> Vec<(Space, TextureRef)> {
    keys.iter().flat_map(|key| materials::uses(&materials::source(scene, *key))).collect()
}

fn uv_sets(uses: &[(Space, TextureRef)]) -> Result<usize, SceneError> {
    let sets = uses.iter().map(|(_, use_)| use_.uv_set + 1).max().unwrap_or(0);
    if sets > UV_SETS {
        let detail = format!("a material reads {sets} sets of texture coordinates; at most {UV_SETS} are supported");
        return Err(invalid("too_many_uv_sets", "/materials", &detail));
    }
    Ok(sets)
}

/// What is drawn, by how it is stored.
struct Groups<'a> {
    merged: Vec<(&'a Mesh, DAffine3)>,
    instanced: Vec<Group<'a>>,
}

/// A mesh stored once and drawn several times.
struct Group<'a> {
    mesh: &'a Mesh,
    worlds: Vec<DAffine3>,
}

impl<'a> Groups<'a> {
    fn new(scene: &'a Scene, scene_index: Option<usize>) -> Result<Self, CompileError> {
        let mut by_mesh: BTreeMap<usize, Vec<DAffine3>> = BTreeMap::new();
        for placed in placed_nodes(scene, scene_index)? {
            let Some(mesh) = scene.nodes[placed.node].mesh else { continue };
            let linear = placed.world.matrix3;
            if linear.to_cols_array().iter().any(|v| *v != 0.0) && placed.world.is_finite() {
                by_mesh.entry(mesh).or_default().push(placed.world);
            }
        }
        let mut groups = Self { merged: Vec::new(), instanced: Vec::new() };
        for (mesh, worlds) in by_mesh {
            let Some(mesh) = scene.meshes.get(mesh) else { continue };
            let (worlds, flat): (Vec<_>, Vec<_>) = worlds.into_iter().partition(is_invertible);
            groups.merged.extend(flat.into_iter().map(|world| (mesh, world)));
            match worlds[..] {
                [] => {}
                [world] => groups.merged.push((mesh, world)),
                _ => groups.instanced.push(Group { mesh, worlds }),
            }
        }
        Ok(groups)
    }

    fn meshes(&self) -> impl Iterator<Item = &'a Mesh> {
        self.merged.iter().map(|(mesh, _)| *mesh).chain(self.instanced.iter().map(|group| group.mesh))
    }

    fn primitives(&self) -> impl Iterator<Item = &'a Primitive> {
        self.meshes().flat_map(|mesh| &mesh.primitives)
    }

    fn check_size(&self) -> Result<(), SceneError> {
        let triangles: u64 = self.primitives().map(|primitive| primitive.triangles.len() as u64).sum();
        let instances: usize = self.instanced.iter().map(|group| group.worlds.len()).sum();
        if triangles > MAX_TRIANGLES {
            return Err(too_large(&format!("{triangles} triangles; at most {MAX_TRIANGLES} are supported")));
        }
        if instances > MAX_INSTANCES {
            return Err(too_large(&format!("{instances} instances; at most {MAX_INSTANCES} are supported")));
        }
        Ok(())
    }

    fn check_vertices(&self, layout: &VertexLayout) -> Result<(), SceneError> {
        let vertices: u64 = self.primitives().map(|primitive| primitive.positions.len() as u64).sum();
        let words = vertices * u64::from(layout.stride.max(1));
        if words > u64::from(u32::MAX) {
            return Err(too_large(&format!("{vertices} vertices of {} words", layout.stride)));
        }
        Ok(())
    }

    /// Centre of the bounds of all triangles.
    fn centre(&self) -> Result<DVec3, SceneError> {
        let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let join = |a: (DVec3, DVec3), b: (DVec3, DVec3)| (a.0.min(b.0), a.1.max(b.1));
        let around = |points: &[DVec3], world: &DAffine3| {
            let points = points.iter().map(|p| world.transform_point3(*p)).filter(|p| p.is_finite());
            points.fold(empty, |all, p| (all.0.min(p), all.1.max(p)))
        };
        let merged = self.merged.par_iter().map(|(mesh, world)| around(&corner_points(mesh), world));
        let instanced = self.instanced.iter().map(|group| {
            let points = corner_points(group.mesh);
            group.worlds.par_iter().map(|world| around(&points, world)).reduce(|| empty, join)
        });
        let (min, max) = join(merged.reduce(|| empty, join), instanced.fold(empty, join));
        if !min.cmple(max).all() {
            return Ok(DVec3::ZERO);
        }
        let extent = (max - min).max_element();
        if extent > MAX_EXTENT {
            let detail =
                format!("the scene is {extent:e} units across; at most {MAX_EXTENT:e} are supported: scale it");
            return Err(invalid("extent_too_large", "/scenes", &detail));
        }
        Ok((min + max) * 0.5)
    }

    /// All merged meshes in world space, relative to the origin.
    fn merged_soup(&self, origin: DVec3, surfaces: &Surfaces, compiled: &mut CompiledScene) -> Soup {
        let mut soup = Soup::default();
        for (mesh, world) in &self.merged {
            let map = DAffine3 { translation: world.translation - origin, ..*world };
            soup.add_mesh(mesh, &Placement::new(map), surfaces, compiled);
        }
        soup
    }
}

impl Group<'_> {
    fn soup(&self, surfaces: &Surfaces, compiled: &mut CompiledScene) -> Soup {
        let mut soup = Soup::default();
        soup.add_mesh(self.mesh, &Placement::new(DAffine3::IDENTITY), surfaces, compiled);
        soup
    }
}

fn check_emitters(merged: &Soup, soups: &[Soup], groups: &[Group]) -> Result<(), SceneError> {
    let lit = |soup: &Soup| soup.luminance.iter().filter(|l| **l > 0.0).count() as u64;
    let instanced = soups.iter().zip(groups).map(|(soup, group)| lit(soup) * group.worlds.len() as u64);
    let emitters = lit(merged) + instanced.sum::<u64>();
    if emitters > MAX_EMITTERS {
        return Err(too_large(&format!("{emitters} emitting triangles; at most {MAX_EMITTERS} are supported")));
    }
    Ok(())
}

fn is_invertible(world: &DAffine3) -> bool {
    let m = world.matrix3;
    let edges = m.x_axis.length() * m.y_axis.length() * m.z_axis.length();
    m.determinant().abs() > FLAT * edges && world.inverse().is_finite()
}

fn too_large(detail: &str) -> SceneError {
    let detail = format!("the scene has {detail}; simplify its meshes");
    SceneError { kind: SceneErrorKind::TooLarge, code: "scene_too_large", pointer: "/meshes".into(), detail }
}

/// The vertices that some triangle of the mesh uses.
fn corner_points(mesh: &Mesh) -> Vec<DVec3> {
    let mut points = Vec::new();
    for primitive in &mesh.primitives {
        let mut used = vec![false; primitive.positions.len()];
        for index in primitive.triangles.iter().flatten() {
            if let Some(used) = used.get_mut(*index as usize) {
                *used = true;
            }
        }
        points.extend(primitive.positions.iter().zip(used).filter(|(_, used)| *used).map(|(p, _)| p.as_dvec3()));
    }
    points
}

/// What materials say about triangles.
struct Surfaces<'a> {
    table: &'a Table,
    alpha: Vec<AlphaTest<'a>>,
    emissions: Vec<Emission<'a>>,
}

/// Triangles before they are in a tree.
#[derive(Default)]
struct Soup {
    triangles: Vec<Triangle>,
    indices: Vec<[u32; 3]>,
    /// Mean luminance of each; zero: does not emit.
    luminance: Vec<f32>,
    /// Triangles seen, those left out included.
    seen: u32,
}

impl Soup {
    fn add_mesh(&mut self, mesh: &Mesh, placement: &Placement, surfaces: &Surfaces, compiled: &mut CompiledScene) {
        for primitive in &mesh.primitives {
            let first_vertex = compiled.vertex_count();
            vertices::push(&mut compiled.vertices, &compiled.layout, primitive, placement);
            self.add_primitive(primitive, placement, surfaces, first_vertex, &mut compiled.stats);
        }
    }

    fn add_primitive(
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
            let Some([v0, v1, v2]) = corners(primitive, placement, indices) else {
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

    /// Builds the tree and brings the triangles into its order.
    fn build(self) -> Bottom {
        let boxes: Vec<Bounds> = self.triangles.iter().map(triangle_bounds).collect();
        let tree = bvh::build(&boxes);
        let mut bottom =
            Bottom { bounds: boxes.iter().fold(Bounds::default(), |a, b| a.union(*b)), ..Bottom::default() };
        for (position, from) in (0..).zip(&tree.order) {
            let from = *from as usize;
            let mut triangle = self.triangles[from];
            if self.luminance[from] > 0.0 {
                triangle.light = bottom.lit.len() as u32;
                bottom.lit.push((position, self.luminance[from]));
            }
            bottom.triangles.push(triangle);
            bottom.indices.push(self.indices[from]);
        }
        bottom.tree = tree;
        bottom
    }
}

impl CompiledScene {
    /// Vertices stored so far.
    fn vertex_count(&self) -> u32 {
        self.vertices.len().checked_div(self.layout.stride as usize).unwrap_or(0) as u32
    }
}

/// Corners of a triangle where it is stored; none: it has no area there, or is not finite.
fn corners(primitive: &Primitive, placement: &Placement, indices: [u32; 3]) -> Option<[Vec3; 3]> {
    let point = |index: u32| primitive.positions.get(index as usize).map(|p| placement.point(*p));
    let corners = [point(indices[0])?, point(indices[1])?, point(indices[2])?];
    let [a, b, c] = corners.map(|v| v.as_dvec3());
    let area = (b - a).cross(c - a).length_squared();
    (corners.iter().all(|v| v.is_finite()) && area > 0.0).then_some(corners)
}

fn uvs(primitive: &Primitive, set: Option<usize>, indices: [u32; 3]) -> [Vec2; 3] {
    set.map_or([Vec2::ZERO; 3], |set| indices.map(|index| vertices::uv(primitive, set, index as usize)))
}

fn alphas(primitive: &Primitive, indices: [u32; 3]) -> [f32; 3] {
    let colors = primitive.colors.as_ref();
    indices.map(|index| colors.and_then(|colors| colors.get(index as usize)).map_or(1.0, |color| color.w))
}

fn triangle_bounds(triangle: &Triangle) -> Bounds {
    [triangle.v0, triangle.v1, triangle.v2].map(Vec3::from_array).into_iter().fold(Bounds::default(), Bounds::with)
}

/// A mesh in its tree.
#[derive(Default)]
pub struct Bottom {
    tree: Tree,
    /// In leaf order.
    pub triangles: Vec<Triangle>,
    indices: Vec<[u32; 3]>,
    /// Emitting triangles: index among the mesh's, and mean luminance.
    pub lit: Vec<(u32, f32)>,
    bounds: Bounds,
}

/// An instance before the top level orders it.
struct Standing {
    bottom: usize,
    /// To world, relative to the origin.
    map: DAffine3,
    bounds: Bounds,
}

fn assemble(compiled: &mut CompiledScene, table: &Table, merged: Soup, soups: Vec<Soup>, groups: &[Group]) {
    let mut bottoms: Vec<Bottom> = soups.into_par_iter().map(Soup::build).collect();
    bottoms.push(merged.build());
    let merged = bottoms.len() - 1;
    let mut standing = instances(&bottoms, groups, compiled.origin);
    compiled.two_level = !standing.is_empty();
    let empty = bottoms[merged].triangles.is_empty();
    if !(compiled.two_level && empty) {
        standing.push(Standing { bottom: merged, map: DAffine3::IDENTITY, bounds: bottoms[merged].bounds });
    }
    let mut order: Vec<u32> = vec![0];
    if compiled.two_level {
        let top = bvh::build(&standing.iter().map(|s| s.bounds).collect::<Vec<_>>());
        compiled.depth = top.depth;
        compiled.nodes = top.nodes;
        order = top.order;
    }
    let roots = append_bottoms(compiled, &mut bottoms, &standing);
    for index in order {
        push_instance(compiled, &standing[index as usize], &bottoms, &roots, table);
    }
    compiled.stats.triangles = compiled.triangles.len() as u64;
    compiled.stats.instances = compiled.instances.len() as u64;
}

/// All instances of meshes drawn several times that have something to show.
fn instances(bottoms: &[Bottom], groups: &[Group], origin: DVec3) -> Vec<Standing> {
    let mut standing = Vec::new();
    for (bottom, group) in groups.iter().enumerate().filter(|(bottom, _)| !bottoms[*bottom].triangles.is_empty()) {
        let points = corner_points(group.mesh);
        let maps = group.worlds.par_iter().map(|world| DAffine3 { translation: world.translation - origin, ..*world });
        let placed = maps.map(|map| Standing { bottom, map, bounds: instance_bounds(&points, &map) });
        standing.par_extend(placed);
    }
    standing
}

/// Bounds of a placed mesh, as a ray sees it that goes through the rounded inverse of the map.
fn instance_bounds(points: &[DVec3], map: &DAffine3) -> Bounds {
    let placed = points.iter().map(|p| map.transform_point3(*p));
    let (min, max) = placed.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(min, max), p| (min.min(p), max.max(p)));
    // Rounding the inverse A of M moves a point x by at most |M| (ulp |A| (|x| + |t|)); a factor of 4 covers sums.
    let (m, inverse) = (map.matrix3, map.matrix3.inverse());
    let reach = min.abs().max(max.abs()) + map.translation.abs();
    let slack = m.abs() * (inverse.abs() * reach) * (4.0 * f64::from(f32::EPSILON));
    Bounds::outwards(min - slack, max + slack)
}

/// Moves triangles and nodes of all meshes that stand somewhere into the scene; returns (root, first triangle) of each.
fn append_bottoms(compiled: &mut CompiledScene, bottoms: &mut [Bottom], standing: &[Standing]) -> Vec<(u32, u32)> {
    let used: BTreeSet<usize> = standing.iter().map(|s| s.bottom).collect();
    let mut roots = vec![(0, 0); bottoms.len()];
    let mut deepest = 0;
    for index in used {
        let bottom = &mut bottoms[index];
        let (root, first_triangle) = (compiled.nodes.len() as u32, compiled.triangles.len() as u32);
        roots[index] = (root, first_triangle);
        deepest = deepest.max(bottom.tree.depth);
        compiled.nodes.extend(bottom.tree.nodes.drain(..).map(|node| shifted(node, root, first_triangle)));
        compiled.triangles.extend_from_slice(&bottom.triangles);
        compiled.indices.append(&mut bottom.indices);
    }
    compiled.depth += deepest;
    roots
}

/// A node whose indices count from elsewhere: word 4 is the first child node, word 5 the first primitive.
fn shifted(mut node: BvhNode, nodes: u32, primitives: u32) -> BvhNode {
    node.words[4] += nodes;
    node.words[5] += primitives;
    node
}

fn push_instance(
    compiled: &mut CompiledScene,
    standing: &Standing,
    bottoms: &[Bottom],
    roots: &[(u32, u32)],
    table: &Table,
) {
    let bottom = &bottoms[standing.bottom];
    let (root, first_triangle) = roots[standing.bottom];
    let index = compiled.instances.len() as u32;
    compiled.instances.push(Instance {
        to_world: rows(&standing.map),
        to_object: rows(&standing.map.inverse()),
        root,
        first_triangle,
        light_base: compiled.emitters.len() as u32,
        flags: u32::from(standing.map.matrix3.determinant() < 0.0),
    });
    let emitters = emitters::of_instance(index, bottom, first_triangle, &table.materials, standing.map);
    compiled.emitters.extend(emitters);
    compiled.bounds = compiled.bounds.union(standing.bounds);
    compiled.stats.instanced_triangles += bottom.triangles.len() as u64;
}

/// Rows of a 3x4 matrix.
fn rows(map: &DAffine3) -> [[f32; 4]; 3] {
    let m = map.matrix3;
    std::array::from_fn(|i| [m.x_axis[i], m.y_axis[i], m.z_axis[i], map.translation[i]].map(|v| v as f32))
}
