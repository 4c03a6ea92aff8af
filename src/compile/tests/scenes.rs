//! Geometry: hits, instances against merged copies, mirrored placements, what is left out.

use super::walker::{closest, closest_of_all};
use super::{Random, mesh, scene, soup, triangle, triangle_with};
use crate::compile::{CompileError, CompiledScene, Material, NONE, Triangle, compile_scene};
use crate::scene::{self, AlphaMode, Node, Scene, SceneRoot};
use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3, Vec4};
use std::sync::Arc;

fn placement(seed: u64, mirrored: bool, offset: DVec3) -> DAffine3 {
    let mut random = Random(seed * 977 + 1);
    let turn = DQuat::from_rotation_y(random.unit() * 6.0) * DQuat::from_rotation_x(random.unit() * 6.0);
    let scale = DVec3::new(0.5 + random.unit(), 0.5 + random.unit(), 0.5 + random.unit());
    let scale = if mirrored { scale * DVec3::new(-1.0, 1.0, 1.0) } else { scale };
    DAffine3::from_scale_rotation_translation(scale, turn, random.point().as_dvec3() * 4.0 + offset)
}

fn compiled(scene: &Scene) -> CompiledScene {
    compile_scene(scene, None).unwrap()
}

fn ray(random: &mut Random, reach: f64) -> (DVec3, DVec3) {
    let origin = random.point().as_dvec3() * 2.0 * reach;
    let target = random.point().as_dvec3() * reach;
    (origin, (target - origin).normalize())
}

fn check_hits(scene: &CompiledScene, reach: f64) {
    let mut random = Random(5);
    let mut hits = 0;
    for _ in 0..400 {
        let (origin, direction) = ray(&mut random, reach);
        let (found, all) = (closest(scene, origin, direction), closest_of_all(scene, origin, direction));
        assert_eq!(found, all, "from {origin} to {direction}");
        hits += u32::from(all.is_some());
    }
    assert!(hits > 40, "only {hits} rays hit something");
}

#[test]
fn trees_find_the_closest_hits_in_one_level() {
    let scene = compiled(&scene(
        vec![mesh(soup(1500, 3)), mesh(soup(300, 4))],
        &[(0, DAffine3::IDENTITY), (1, placement(2, true, DVec3::ZERO))],
    ));
    assert!(!scene.two_level);
    assert_eq!(scene.instances.len(), 1);
    check_hits(&scene, 2.0);
}

#[test]
fn trees_find_the_closest_hits_in_two_levels() {
    let far = DVec3::new(148_376.0, 1234.0, -223_423.0);
    for offset in [DVec3::ZERO, far] {
        let mut placed: Vec<(usize, DAffine3)> = (0..30).map(|i| (0, placement(i, i % 3 == 0, offset))).collect();
        placed.extend((30..36).map(|i| (1, placement(i, false, offset))));
        placed.push((2, placement(40, true, offset)));
        let scene = compiled(&scene(vec![mesh(soup(200, 3)), mesh(triangle()), mesh(soup(50, 8))], &placed));
        assert!(scene.two_level);
        assert_eq!(scene.instances.len(), 37);
        assert_eq!(scene.stats.instanced_triangles, 30 * 200 + 6 + 50);
        assert_eq!(scene.stats.triangles, 200 + 1 + 50);
        check_hits(&scene, 4.0);
    }
}

/// World corners of all triangles, as front faces see them, that of least x first, and its normal; in an order of their own.
fn world_triangles(scene: &CompiledScene) -> Vec<[DVec3; 4]> {
    let mut all = Vec::new();
    let ends: Vec<u32> = scene.instances.iter().map(|instance| instance.first_triangle).collect();
    for instance in &scene.instances {
        let end = ends.iter().filter(|end| **end > instance.first_triangle).min();
        let range = instance.first_triangle as usize..end.map_or(scene.triangles.len(), |end| *end as usize);
        let row = |v: DVec3, row: [f32; 4]| v.dot(Vec3::new(row[0], row[1], row[2]).as_dvec3()) + f64::from(row[3]);
        let place = |v: [f32; 3]| DVec3::from_array(instance.to_world.map(|r| row(Vec3::from(v).as_dvec3(), r)));
        for (triangle, indices) in scene.triangles[range.clone()].iter().zip(&scene.indices[range]) {
            let mut corners = [triangle.v0, triangle.v1, triangle.v2].map(place);
            let mut indices = *indices;
            if instance.flags & 1 == 1 {
                corners.swap(1, 2);
                indices.swap(1, 2);
            }
            let first = (1..3).fold(0, |first, i| if corners[i].x < corners[first].x { i } else { first });
            corners.rotate_left(first);
            indices.rotate_left(first);
            let word = (indices[0] * scene.layout.stride + scene.layout.normal) as usize;
            let object: Vec<f64> = (0..3).map(|i| f64::from(f32::from_bits(scene.vertices[word + i]))).collect();
            let inverse = DMat3::from_cols_array_2d(&instance.to_object.map(|r| [r[0], r[1], r[2]].map(f64::from)));
            let normal = (inverse * DVec3::from_slice(&object)).normalize();
            all.push([corners[0], corners[1], corners[2], normal]);
        }
    }
    all.sort_by(|a, b| a[0].x.total_cmp(&b[0].x).then(a[0].y.total_cmp(&b[0].y)));
    all
}

#[test]
fn instances_and_merged_copies_are_the_same_triangles() {
    let placements: Vec<DAffine3> = (0..5).map(|i| placement(i, i % 2 == 0, DVec3::ZERO)).collect();
    let shared: Vec<(usize, DAffine3)> = placements.iter().map(|p| (0, *p)).collect();
    let copied: Vec<(usize, DAffine3)> = placements.iter().enumerate().map(|(i, p)| (i, *p)).collect();
    let instanced = compiled(&scene(vec![mesh(soup(20, 3))], &shared));
    let merged = compiled(&scene((0..5).map(|_| mesh(soup(20, 3))).collect(), &copied));
    assert!(instanced.two_level && !merged.two_level);
    assert_eq!(instanced.origin, merged.origin);
    let (a, b) = (world_triangles(&instanced), world_triangles(&merged));
    assert_eq!(a.len(), 100);
    assert_eq!(a.len(), b.len());
    for (a, b) in a.iter().zip(&b) {
        for (a, b) in a.iter().zip(b) {
            assert!(a.distance(*b) < 2e-6, "{a} {b}");
        }
    }
}

#[test]
fn mirrored_placements_keep_front_faces_in_front() {
    let mirror = DAffine3::from_scale(DVec3::new(-2.0, 1.0, 1.0));
    let scene = compiled(&scene(vec![mesh(triangle())], &[(0, mirror)]));
    let [a, b, c] = [scene.triangles[0].v0, scene.triangles[0].v1, scene.triangles[0].v2].map(Vec3::from);
    assert!((b - a).cross(c - a).z > 0.0, "the triangle faces +z before and after");
    assert_eq!(scene.layout.normal, 0);
    let normal: Vec<f32> = scene.vertices[..3].iter().map(|word| f32::from_bits(*word)).collect();
    assert_eq!(normal, [0.0, 0.0, 1.0]);
}

#[test]
fn flattened_placements_are_merged_and_vanished_ones_dropped() {
    let flat = DAffine3::from_scale(DVec3::new(1.0, 1.0, 0.0));
    let line = DAffine3::from_scale(DVec3::new(1.0, 0.0, 0.0));
    let gone = DAffine3::from_scale(DVec3::ZERO);
    let turned = DAffine3::from_rotation_x(1.0);
    let scene = compiled(&scene(vec![mesh(triangle())], &[(0, flat), (0, line), (0, gone), (0, turned)]));
    assert!(!scene.two_level);
    assert_eq!(scene.triangles.len(), 2);
    assert_eq!(scene.stats.degenerate_triangles, 1);
}

#[test]
fn an_empty_scene_compiles() {
    let empty = Scene { scenes: vec![SceneRoot::default()], ..Scene::default() };
    let scene = compiled(&empty);
    assert_eq!((scene.nodes.len(), scene.instances.len(), scene.triangles.len()), (1, 1, 0));
    assert!(scene.bounds.is_empty() && !scene.two_level && scene.depth == 1);
    assert_eq!(closest(&scene, DVec3::ZERO, DVec3::ONE), None);
    let degenerate = scene::Primitive { positions: vec![Vec3::ONE; 3], ..triangle() };
    let scene = compiled(&super::scene(
        vec![mesh(degenerate)],
        &[(0, DAffine3::IDENTITY), (0, placement(1, false, DVec3::ONE))],
    ));
    assert_eq!((scene.triangles.len(), scene.instances.len(), scene.two_level), (0, 1, false));
}

#[test]
fn bad_scenes_are_refused_with_a_pointer() {
    let missing = compile_scene(&triangle_with(scene::Material::default()), Some(3)).unwrap_err();
    assert!(matches!(&missing, CompileError::Params(error) if error.pointer == "/params/scene"), "{missing}");
    assert!(matches!(compile_scene(&Scene::default(), None), Err(CompileError::Scene(_))));
}

#[test]
fn extents_beyond_the_arithmetic_are_refused() {
    let scaled = |scale: f64| scene(vec![mesh(triangle())], &[(0, DAffine3::from_scale(DVec3::splat(scale)))]);
    // The same size in the world, but traced in the space of the mesh.
    let instanced = |scale: f64| {
        let place = DAffine3::from_scale(DVec3::splat(1.0 / scale));
        let grown = triangle().positions.iter().map(|p| *p * scale as f32).collect();
        let grown = scene::Primitive { positions: grown, ..triangle() };
        scene(vec![mesh(grown)], &[(0, place), (0, DAffine3::from_translation(DVec3::X) * place)])
    };
    for scene in [scaled(1e8), scaled(1e-5), instanced(1e8), instanced(1e-5)] {
        assert!(!compile_scene(&scene, None).unwrap().bounds.is_empty());
    }
    for (scene, code) in [
        (scaled(1e10), "extent_too_large"),
        (scaled(1e20), "extent_too_large"),
        (scaled(1e100), "extent_too_large"),
        (scaled(1e-9), "extent_too_small"),
        (instanced(1e10), "extent_too_large"),
        (instanced(1e-9), "extent_too_small"),
    ] {
        let error = compile_scene(&scene, None).unwrap_err();
        assert!(matches!(&error, CompileError::Scene(error) if error.code == code), "{error}");
        assert!(!error.to_string().contains("inf"), "{error}");
    }
}

#[test]
fn the_origin_is_the_centre_and_keeps_far_scenes_precise() {
    let far = DVec3::new(1e8, -3e8, 5e8);
    let near = compiled(&scene(vec![mesh(soup(50, 3))], &[(0, DAffine3::IDENTITY)]));
    let moved = compiled(&scene(vec![mesh(soup(50, 3))], &[(0, DAffine3::from_translation(far))]));
    assert!((moved.origin - far).distance(near.origin) < 1e-6);
    for (a, b) in near.triangles.iter().zip(&moved.triangles) {
        assert!(Vec3::from(a.v0).distance(Vec3::from(b.v0)) < 1e-6);
    }
    assert!(near.bounds.centre().length() < 1e-6);
}

#[test]
fn alpha_is_tested_only_where_it_matters() {
    let with = |alpha: f32, mode: AlphaMode| {
        let material =
            scene::Material { base_color: Vec4::new(1.0, 1.0, 1.0, alpha), alpha_mode: mode, ..Default::default() };
        compiled(&triangle_with(material))
    };
    let tested = |scene: &CompiledScene| scene.triangles[0].material & Triangle::ALPHA != 0;
    assert!(!tested(&with(1.0, AlphaMode::Blend)));
    assert!(tested(&with(0.5, AlphaMode::Blend)));
    assert!(!tested(&with(0.5, AlphaMode::Opaque)));
    assert!(!tested(&with(0.5, AlphaMode::Mask { cutoff: 0.5 })));
    assert!(with(0.4, AlphaMode::Mask { cutoff: 0.5 }).triangles.is_empty());
    assert!(with(0.0, AlphaMode::Blend).triangles.is_empty());
    let mut colored = triangle_with(scene::Material { alpha_mode: AlphaMode::Blend, ..Default::default() });
    Arc::make_mut(&mut colored.meshes)[0].primitives[0].colors =
        Some(vec![Vec4::ONE, Vec4::ONE, Vec4::new(1.0, 1.0, 1.0, 0.9)]);
    assert!(tested(&compiled(&colored)));
}

#[test]
fn emitters_follow_their_instances() {
    let material = scene::Material { emissive: Vec3::splat(2.0), double_sided: true, ..Default::default() };
    let mut source = triangle_with(material);
    source.nodes.push(Node { mesh: Some(0), local: DAffine3::from_scale(DVec3::splat(3.0)), ..Node::default() });
    source.scenes[0].nodes.push(1);
    let scene = compiled(&source);
    assert_eq!(scene.emitters.len(), 2);
    assert_eq!(scene.triangles[0].light, 0);
    for (index, instance) in (0..).zip(&scene.instances) {
        let emitter = scene.emitters[instance.light_base as usize];
        let scale = Vec3::new(instance.to_world[0][0], instance.to_world[1][0], instance.to_world[2][0]).length();
        assert_eq!((emitter.instance, emitter.double_sided), (index, true));
        assert!((emitter.area - 0.5 * scale * scale).abs() < 1e-6 && (emitter.luminance - 2.0).abs() < 1e-6);
    }
    assert!(scene.materials.iter().all(|material| material.flags & Material::DOUBLE_SIDED != 0));
    let dark = compiled(&triangle_with(scene::Material::default()));
    assert_eq!((dark.emitters.len(), dark.triangles[0].light), (0, NONE));
}
