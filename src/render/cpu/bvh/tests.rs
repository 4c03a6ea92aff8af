//! Hits against a search through all triangles, on both vector units; closed meshes without leaks.

use super::boxes::{self, Slabs};
use super::simd::{Portable, Simd};
use super::traverse::Unit;
use super::triangle::{Block, Shear, intersect};
use super::{Bvh, Hit, Ray, TriangleId};
use crate::compile::{Bounds, CompiledScene, Triangle, compile_scene};
use crate::render::cpu::motion::Moment;
use crate::scene::{Mesh, Node, Primitive, Scene, SceneRoot};
use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};
use rayon::prelude::*;

/// Of rays that begin and end on no triangle.
const ANYWHERE: [TriangleId; 2] = [TriangleId::NONE; 2];

const FAR: DVec3 = DVec3::new(148_376.0, 1234.0, -223_423.0);

/// Random numbers (Marsaglia's xorshift64).
struct Random(u64);

impl Random {
    fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1)
    }

    fn unit(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn below(&mut self, end: usize) -> usize {
        (self.unit() * end as f64) as usize
    }

    /// In the cube of side 1 around the origin.
    fn point(&mut self) -> DVec3 {
        DVec3::new(self.unit(), self.unit(), self.unit()) - 0.5
    }
}

fn soup(count: usize, seed: u64, scale: f64) -> Primitive {
    let mut random = Random::new(seed);
    let mut positions = Vec::new();
    for _ in 0..count {
        let (centre, size) = (random.point(), 0.3 * random.unit());
        positions.extend((0..3).map(|_| ((centre + random.point() * size) * scale).as_vec3()));
    }
    Primitive {
        positions,
        triangles: (0..count as u32).map(|i| [0, 1, 2].map(|k| 3 * i + k)).collect(),
        ..Primitive::default()
    }
}

/// A sphere with shared vertices, `4 * side * side` triangles.
fn sphere(side: u32, radius: f64) -> Primitive {
    let (columns, rows) = (2 * side, side + 1);
    let point = |i: u32, j: u32| {
        let (theta, phi) = (
            std::f64::consts::PI * f64::from(i) / f64::from(rows),
            std::f64::consts::TAU * f64::from(j) / f64::from(columns),
        );
        (DVec3::new(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin()) * radius).as_vec3()
    };
    let mut positions = vec![point(0, 0), point(rows, 0)];
    positions.extend((1..rows).flat_map(|i| (0..columns).map(move |j| (i, j))).map(|(i, j)| point(i, j)));
    let index = |i: u32, j: u32| {
        if i == 0 {
            0
        } else if i == rows {
            1
        } else {
            2 + (i - 1) * columns + j % columns
        }
    };
    let quads = (0..rows).flat_map(|i| (0..columns).map(move |j| (i, j)));
    let triangles = quads
        .flat_map(|(i, j)| {
            let [a, b, c, d] = [index(i, j), index(i, j + 1), index(i + 1, j + 1), index(i + 1, j)];
            [[a, b, c], [a, c, d]]
        })
        .filter(|[a, b, c]| a != b && b != c && c != a);
    Primitive { triangles: triangles.collect(), positions, ..Primitive::default() }
}

fn compiled(meshes: Vec<Primitive>, placed: &[(usize, DAffine3)]) -> CompiledScene {
    let node = |(mesh, local): &(usize, DAffine3)| Node { mesh: Some(*mesh), local: *local, ..Node::default() };
    let nodes: Vec<Node> = placed.iter().map(node).collect();
    let scenes = vec![SceneRoot { name: None, nodes: (0..nodes.len()).collect() }];
    let meshes =
        meshes.into_iter().map(|primitive| Mesh { name: None, primitives: vec![primitive] }).collect::<Vec<_>>().into();
    compile_scene(&Scene { nodes, scenes, meshes, ..Scene::default() }, None).unwrap()
}

fn placement(seed: u64, size: f64, offset: DVec3) -> DAffine3 {
    let mut random = Random::new(seed);
    let turn = DQuat::from_rotation_y(random.unit() * 6.0) * DQuat::from_rotation_x(random.unit() * 6.0);
    let mirror = if seed.is_multiple_of(3) { -1.0 } else { 1.0 };
    let scale = DVec3::new(mirror * (0.5 + random.unit()), 0.5 + random.unit(), 0.5 + random.unit()) * size;
    DAffine3::from_scale_rotation_translation(scale, turn, random.point() * 4.0 + offset)
}

/// Several meshes, most of them instanced.
fn two_levels(offset: DVec3) -> CompiledScene {
    let mut placed: Vec<(usize, DAffine3)> = (0..30).map(|i| (0, placement(i, 1.0, offset))).collect();
    placed.extend((30..40).map(|i| (1, placement(i, 0.01 * (i as f64 - 29.0), offset))));
    placed.push((2, placement(41, 1.0, offset)));
    compiled(vec![soup(200, 3, 1.0), soup(3, 4, 1.0), soup(50, 8, 1.0)], &placed)
}

/// The hit that [`Bvh::closest`] promises, by trying all triangles.
fn closest_of_all(scene: &CompiledScene, ray: &Ray, mut accept: impl FnMut(&Hit) -> bool) -> Option<Hit> {
    let mut best: Option<Hit> = None;
    for (index, instance) in (0..).zip(&scene.instances) {
        let column = |i: usize| DVec3::from_array(instance.to_object.map(|row| f64::from(row[i])));
        let map = DAffine3 { matrix3: DMat3::from_cols(column(0), column(1), column(2)), translation: column(3) };
        let shear = Shear::new(map.transform_point3(ray.origin), map.transform_vector3(ray.direction));
        let first = instance.first_triangle;
        let ends = scene.instances.iter().map(|other| other.first_triangle).filter(|start| *start > first);
        for triangle in first..ends.min().unwrap_or(scene.triangles.len() as u32) {
            let block = Block::new(&[triangle], |index| scene.triangles[index as usize]);
            let Some(hits) = intersect::<Portable>(&block, &shear, ray.t_max) else { continue };
            let hit = Hit { t: hits.t[0], u: hits.u[0], v: hits.v[0], triangle, instance: index };
            let is_near = hit.t > 0.0 && best.map_or(hit.t < ray.t_max, |best| hit.t < best.t);
            let is_alpha = scene.triangles[triangle as usize].material & Triangle::ALPHA != 0;
            if is_near && (!is_alpha || accept(&hit)) {
                best = Some(hit);
            }
        }
    }
    best
}

/// The tree by each vector unit of this machine.
fn trees(scene: &CompiledScene) -> Vec<Bvh> {
    let best = Bvh::new(scene);
    if best.unit == Unit::Portable {
        eprintln!("SKIPPED: vector units other than the portable one, which this processor lacks");
    }
    vec![Bvh { unit: Unit::Portable, ..Bvh::new(scene) }, best]
}

/// Compares the hits of random rays within `reach` of the origin.
fn check_hits(scene: &CompiledScene, reach: f64, rays: usize) {
    let trees = trees(scene);
    let accept = |hit: &Hit| !(hit.triangle + hit.instance).is_multiple_of(3);
    let mut random = Random::new(5);
    let mut count = 0;
    for i in 0..rays {
        let origin = random.point() * 2.0 * reach;
        let mut direction = random.point() * reach - origin;
        // Of all lengths, some along axes.
        direction *= 10f64.powf(20.0 * random.unit() - 10.0);
        for axis in 0..3 {
            direction[axis] *= f64::from(i & (1 << axis) == 0 || i % 16 < 8);
        }
        let t_max = if i % 4 == 0 { reach * random.unit() / direction.length() } else { f64::INFINITY };
        let ray = Ray { origin, direction, t_max, ends: ANYWHERE, moment: Moment::OPEN };
        if direction == DVec3::ZERO {
            continue;
        }
        let expected = closest_of_all(scene, &ray, accept);
        count += usize::from(expected.is_some());
        for tree in &trees {
            assert_eq!(tree.closest(&ray, accept), expected, "{:?}: {ray:?}", tree.unit);
            assert_eq!(tree.occluded(&ray, accept), expected.is_some(), "{:?}: {ray:?}", tree.unit);
        }
    }
    assert!(count > rays / 20, "only {count} of {rays} rays hit something");
}

#[test]
fn hits_are_those_of_all_triangles_in_one_level() {
    for count in [1, 2, 3, 4, 5, 9, 1500] {
        let scene = compiled(vec![soup(count, 3, 1.0)], &[(0, DAffine3::from_scale(DVec3::splat(2.0)))]);
        assert!(!scene.two_level);
        if count > 100 {
            check_hits(&scene, 2.0, 3000);
        }
        check_rays_at_triangles(&scene, 200);
    }
}

#[test]
fn hits_are_those_of_all_triangles_in_two_levels() {
    for offset in [DVec3::ZERO, FAR] {
        let scene = two_levels(offset);
        assert!(scene.two_level);
        check_hits(&scene, 4.0, 1500);
    }
}

#[test]
fn hits_do_not_depend_on_the_scale() {
    // Nearly as small and as large as scenes may be.
    for scale in [1e-5, 1e-4, 1e-2, 1e2, 1e4, 1e8] {
        check_hits(&compiled(vec![soup(300, 3, scale)], &[(0, DAffine3::IDENTITY)]), 2.0 * scale, 1000);
    }
}

#[test]
fn transparent_triangles_are_asked_about_and_passed() {
    let mut scene = two_levels(DVec3::ZERO);
    for triangle in scene.triangles.iter_mut().step_by(2) {
        triangle.material |= Triangle::ALPHA;
    }
    check_hits(&scene, 4.0, 1500);
    let tree = Bvh::new(&scene);
    let mut random = Random::new(9);
    for _ in 0..1000 {
        let origin = random.point() * 8.0;
        let ray = Ray {
            origin,
            direction: random.point() * 4.0 - origin,
            t_max: f64::INFINITY,
            ends: ANYWHERE,
            moment: Moment::OPEN,
        };
        let mut asked = Vec::new();
        let hit = tree.closest(&ray, |hit| {
            asked.push((hit.instance, hit.triangle));
            false
        });
        assert!(hit.is_none_or(|hit| scene.triangles[hit.triangle as usize].material & Triangle::ALPHA == 0));
        assert!(asked.iter().all(|(_, t)| scene.triangles[*t as usize].material & Triangle::ALPHA != 0));
        let asked_in_all = asked.len();
        asked.sort_unstable();
        asked.dedup();
        assert_eq!(asked.len(), asked_in_all, "asked twice");
    }
}

/// Rays at points of each triangle arrive there or before, and the hit is the point that t, and that u and v say.
fn check_rays_at_triangles(scene: &CompiledScene, rays: usize) {
    let trees = trees(scene);
    let mut random = Random::new(11);
    for _ in 0..rays {
        let triangle = &scene.triangles[random.below(scene.triangles.len())];
        let [a, b, c] = corners(triangle);
        let (u, v) = (random.unit() * 0.5, random.unit() * 0.5);
        let target = a + (b - a) * u + (c - a) * v;
        let origin = random.point() * 6.0;
        let ray =
            Ray { origin, direction: target - origin, t_max: f64::INFINITY, ends: ANYWHERE, moment: Moment::OPEN };
        for tree in &trees {
            let hit = tree.closest(&ray, |_| true).expect("the ray is aimed at a triangle");
            assert!(hit.t < 1.0 + 1e-6, "{hit:?}");
            let [a, b, c] = corners(&scene.triangles[hit.triangle as usize]);
            let by_weights = a + (b - a) * hit.u + (c - a) * hit.v;
            assert!(by_weights.distance(origin + ray.direction * hit.t) < 1e-6, "{hit:?}");
        }
    }
}

fn corners(triangle: &Triangle) -> [DVec3; 3] {
    [triangle.v0, triangle.v1, triangle.v2].map(|v| Vec3::from_array(v).as_dvec3())
}

/// Rays from inside two far spheres through vertices, through points of edges and anywhere, one ray of each kind per step.
fn check_leaks(scene: &CompiledScene, centres: [DVec3; 2], world: impl Fn(usize, DVec3) -> DVec3 + Sync, steps: usize) {
    for tree in trees(scene) {
        let steps = if tree.unit == Unit::Portable { steps / 8 } else { steps };
        let leak = (0..steps).into_par_iter().find_map_any(|step| {
            let mut random = Random::new(step as u64 + 1);
            let instance = step % 2;
            let origin = centres[instance] + random.point() * 2.0;
            let first = scene.instances.get(instance).map_or(0, |i| i.first_triangle as usize);
            let triangles = &scene.triangles[first..];
            let [a, b, _] = loop {
                let found = corners(&triangles[random.below(triangles.len())]).map(|p| world(instance, p));
                if found[0].distance(origin) < 40.0 {
                    break found;
                }
            };
            let part = random.unit();
            let targets = [a, a.lerp(b, part), b.lerp(a, part), origin + random.point()];
            targets.into_iter().find_map(|target| {
                let ray = Ray {
                    origin,
                    direction: target - origin,
                    t_max: f64::INFINITY,
                    ends: ANYWHERE,
                    moment: Moment::OPEN,
                };
                (tree.closest(&ray, |_| true).is_none() || !tree.occluded(&ray, |_| true)).then_some(ray)
            })
        });
        assert_eq!(leak, None, "{:?}", tree.unit);
    }
}

#[test]
fn closed_meshes_far_from_the_origin_do_not_leak() {
    let at = |p: DVec3| DAffine3::from_translation(p);
    let ball = || sphere(40, 12.0);
    let merged = compiled(vec![ball(), ball()], &[(0, at(FAR)), (1, at(-FAR))]);
    assert!(!merged.two_level);
    let centre = merged.origin;
    check_leaks(&merged, [FAR - centre, -FAR - centre], |_, p| p, 150_000);

    let turned = |p: DVec3| DAffine3::from_rotation_translation(DQuat::from_rotation_x(1.0), p);
    let instanced = compiled(vec![ball()], &[(0, turned(FAR)), (0, turned(-FAR))]);
    assert!(instanced.two_level);
    let column = |i: &crate::compile::Instance, c: usize| DVec3::from_array(i.to_world.map(|row| f64::from(row[c])));
    let place = |index: usize, p: DVec3| {
        let i = &instanced.instances[index];
        column(i, 0) * p.x + column(i, 1) * p.y + column(i, 2) * p.z + column(i, 3)
    };
    let centres = [0, 1].map(|index| column(&instanced.instances[index], 3));
    check_leaks(&instanced, centres, place, 150_000);
}

/// A flat grid of unit squares in the plane of `axis`, with corners at integers from 0 to `side`, at height `height`.
fn grid(side: u32, axis: usize, height: f32) -> Primitive {
    let corners = (0..=side).flat_map(|i| (0..=side).map(move |j| [height, i as f32, j as f32]));
    let positions = corners.map(|p| Vec3::from_array(std::array::from_fn(|k| p[(k + 3 - axis) % 3]))).collect();
    let cells = (0..side).flat_map(|i| (0..side).map(move |j| i * (side + 1) + j));
    let triangles = cells.flat_map(|a| [[a, a + 1, a + side + 2], [a, a + side + 2, a + side + 1]]).collect();
    Primitive { positions, triangles, ..Primitive::default() }
}

/// Rays to points of boxes (corners, faces, inside), from near and far, some along axes and within planes of faces.
fn check_boxes<S: Simd>() {
    let mut random = Random::new(21);
    for step in 0..100_000 {
        // Few different numbers, so that planes coincide with rays; flat boxes too.
        let coordinate = |random: &mut Random| {
            let value = 2.0 * random.unit() - 1.0;
            if step % 2 == 0 { (value * 4.0).round() / 4.0 } else { f64::from(value as f32) }
        };
        let mut corner = || DVec3::new(coordinate(&mut random), coordinate(&mut random), coordinate(&mut random));
        let (a, b) = (corner(), corner());
        let bounds = Bounds { min: a.min(b).as_vec3(), max: a.max(b).as_vec3() };
        let node = boxes::Node::new([bounds].into_iter(), 1.0);
        let part = DVec3::from_array(std::array::from_fn(|_| [0.0, 1.0, random.unit()][random.below(3)]));
        let target = bounds.min.as_dvec3() + part * bounds.extent();
        let mut offset = random.point() * 10f64.powf(12.0 * random.unit() - 3.0);
        for axis in 0..3 {
            offset[axis] *= f64::from(u8::from(random.unit() < 0.6));
        }
        if offset == DVec3::ZERO {
            continue;
        }
        let origin = target + offset;
        let ray = (origin, target - origin);
        let slabs = Slabs::<S>::new(ray.0, ray.1, 1.0);
        let (met, distances) = slabs.enter(&node, slabs.limit(1.0));
        assert_eq!(met, 1, "{bounds:?} {ray:?}");
        assert!(distances[0] <= slabs.limit(1.0));
    }
}

#[test]
fn boxes_are_met_by_all_rays_to_their_points() {
    check_boxes::<Portable>();
    #[cfg(target_arch = "x86_64")]
    if Unit::detect() == Unit::Avx2 {
        check_boxes::<super::avx2::Avx2>();
    }
}

#[test]
fn rays_within_the_planes_of_box_faces_hit() {
    let side = 16;
    for axis in 0..3 {
        for height in [0.0, 3.0, 1e5] {
            let scene = compiled(vec![grid(side, axis, height)], &[(0, DAffine3::IDENTITY)]);
            for tree in trees(&scene) {
                for i in 0..=2 * side {
                    for j in 0..=2 * side {
                        // Through corners, along edges, and through the middle of cells.
                        let point = [f64::from(height), 0.5 * f64::from(i), 0.5 * f64::from(j)];
                        let target =
                            DVec3::from_array(std::array::from_fn(|k| point[(k + 3 - axis) % 3])) - scene.origin;
                        for (from, drift) in
                            [(1.0, 0.0), (-7.0, 0.0), (1e6, 0.0), (-1e12, 0.0), (2.0, 1e-40), (2.0, -1e-300)]
                        {
                            let mut origin = target;
                            origin[axis] += from;
                            let mut direction = DVec3::splat(if i > side { -drift } else { drift });
                            direction[axis] = -from.signum();
                            let ray =
                                Ray { origin, direction, t_max: f64::INFINITY, ends: ANYWHERE, moment: Moment::OPEN };
                            let hit = tree.closest(&ray, |_| true);
                            let inner = (1..2 * side).contains(&i) && (1..2 * side).contains(&j);
                            // A drifting ray may rightly leave over the border.
                            assert!(hit.is_some() || drift != 0.0 && !inner, "{axis} {height} {i} {j} {ray:?}");
                        }
                    }
                }
            }
        }
    }
}

#[test]
fn a_stack_of_triangles_that_shrink_without_end_is_searched() {
    let mut primitive = Primitive::default();
    for i in 0..120_u32 {
        let size = 1.6f32.powi(40 - i as i32);
        let first = primitive.positions.len() as u32;
        primitive.positions.extend([Vec3::ZERO, Vec3::X * size, Vec3::new(size, size, size)]);
        primitive.triangles.push([first, first + 1, first + 2]);
    }
    let scene = compiled(vec![primitive], &[(0, DAffine3::IDENTITY)]);
    check_hits(&scene, 1e8, 2000);
}

#[test]
fn rays_that_are_no_rays_hit_nothing() {
    let scene = compiled(vec![sphere(8, 1.0)], &[(0, DAffine3::IDENTITY)]);
    let good =
        Ray { origin: DVec3::ZERO, direction: DVec3::X, t_max: f64::INFINITY, ends: ANYWHERE, moment: Moment::OPEN };
    for tree in trees(&scene) {
        assert!(tree.occluded(&good, |_| true));
        let directions = [DVec3::ZERO, DVec3::NAN, DVec3::INFINITY, DVec3::new(1.0, f64::NAN, 0.0)];
        let origins = [DVec3::NAN, DVec3::INFINITY, DVec3::new(f64::NEG_INFINITY, 0.0, 0.0)];
        let mut bad: Vec<Ray> = directions.into_iter().map(|direction| Ray { direction, ..good }).collect();
        bad.extend(origins.into_iter().map(|origin| Ray { origin, ..good }));
        bad.extend([f64::NAN, 0.0, -1.0].map(|t_max| Ray { t_max, ..good }));
        for ray in bad {
            assert_eq!(tree.closest(&ray, |_| true), None, "{ray:?}");
            assert!(!tree.occluded(&ray, |_| true), "{ray:?}");
        }
        for length in [1e-199, 1e-30, 1e30, 1e199] {
            let hit = tree.closest(&Ray { direction: DVec3::ONE * length, ..good }, |_| true);
            assert!(hit.is_some_and(|hit| (hit.t * length * 3f64.sqrt() - 1.0).abs() < 0.1), "{length} {hit:?}");
        }
    }
}

#[test]
fn an_empty_scene_is_hit_by_nothing() {
    let scene = compiled(vec![Primitive::default()], &[(0, DAffine3::IDENTITY)]);
    for tree in trees(&scene) {
        let ray = Ray {
            origin: DVec3::ZERO,
            direction: DVec3::X,
            t_max: f64::INFINITY,
            ends: ANYWHERE,
            moment: Moment::OPEN,
        };
        assert_eq!(tree.closest(&ray, |_| true), None);
    }
}
