//! Geometry that lies on itself.

use super::{Random, mesh, scene, triangle};
use crate::compile::{CompileError, CompiledScene, compile_scene};
use crate::scene::{self, AlphaMode, Primitive, Scene};
use glam::{DAffine3, DVec3, Vec3, Vec4};
use std::sync::Arc;

fn compiled(scene: &Scene) -> CompiledScene {
    compile_scene(scene, None).unwrap()
}

/// `count` times the same triangle, and once its back.
fn copies(count: usize) -> Primitive {
    let mut triangles = vec![[0, 1, 2]; count];
    triangles.insert(count / 2, [0, 2, 1]);
    Primitive { triangles, material: Some(0), ..triangle() }
}

fn of(material: scene::Material, primitive: Primitive, places: &[DAffine3]) -> Scene {
    let places: Vec<(usize, DAffine3)> = places.iter().map(|place| (0, *place)).collect();
    Scene { materials: vec![material], ..scene(vec![mesh(primitive)], &places) }
}

#[test]
fn of_equal_triangles_one_stays_and_its_back() {
    for count in [2, 5, 20_000] {
        let scene = compiled(&of(scene::Material::default(), copies(count), &[DAffine3::IDENTITY]));
        assert_eq!((scene.triangles.len(), scene.indices.len()), (2, 2), "{count} copies");
        let mut ordinals: Vec<u32> = scene.triangles.iter().map(|triangle| triangle.primitive).collect();
        ordinals.sort_unstable();
        assert_eq!(ordinals, if count == 2 { vec![0, 1] } else { vec![0, count as u32 / 2] }, "the first of them");
    }
}

#[test]
fn copies_that_let_light_through_stay() {
    let color = Vec4::new(1.0, 1.0, 1.0, 0.5);
    let veil = scene::Material { base_color: color, alpha_mode: AlphaMode::Blend, ..Default::default() };
    let glass = scene::Extended { transmission: 0.5, ..Default::default() };
    let glass = scene::Material { extended: Some(Arc::new(glass)), ..Default::default() };
    for material in [veil, glass] {
        let places = [DAffine3::IDENTITY; 2];
        assert_eq!(compiled(&of(material.clone(), copies(9), &places[..1])).triangles.len(), 10);
        assert_eq!(compiled(&of(material, copies(9), &places)).instances.len(), 2);
    }
}

#[test]
fn a_lamp_that_was_doubled_shines_once() {
    let lamp = scene::Material { emissive: Vec3::ONE, ..Default::default() };
    let elsewhere = DAffine3::from_translation(DVec3::X);
    let scene = compiled(&of(lamp, copies(3), &[elsewhere, DAffine3::IDENTITY, elsewhere]));
    assert_eq!((scene.instances.len(), scene.emitters.len()), (2, 4));
}

#[test]
fn triangles_that_nearly_lie_on_each_other_are_refused_before_they_hold_the_device() {
    let mut random = Random(3);
    let mut heap = |count: u32| {
        let positions = (0..count).flat_map(|_| {
            let nudge = random.point() * 1e-4;
            [Vec3::ZERO, Vec3::X, Vec3::Y].map(|corner| corner + nudge)
        });
        let positions: Vec<Vec3> = positions.collect();
        let triangles = (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        scene(vec![mesh(Primitive { positions, triangles, ..Primitive::default() })], &[(0, DAffine3::IDENTITY)])
    };
    assert_eq!(compiled(&heap(1000)).triangles.len(), 1000);
    let error = compile_scene(&heap(100_000), None).unwrap_err();
    assert!(matches!(&error, CompileError::Scene(error) if error.code == "scene_too_large"), "{error}");
}
