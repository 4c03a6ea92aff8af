//! A plain f64 traversal of the compiled trees, and the search through all triangles that it must agree with.

use crate::compile::{BvhNode, CompiledScene, Instance};
use glam::{DVec3, Vec3};
use obvhs::cwbvh::node::CwBvhNode;

/// A hit: distance, instance, triangle.
pub type Hit = Option<(f64, usize, usize)>;

/// Box of a child of a node: corner offsets from `p`, exact in f64.
pub fn child_box(node: &CwBvhNode, slot: usize) -> (DVec3, DVec3) {
    let scale = DVec3::from_array(node.e.map(|e| f64::from(i32::from(e) - 127).exp2()));
    let corner = |x: &[u8; 8], y: &[u8; 8], z: &[u8; 8]| {
        DVec3::new(f64::from(x[slot]), f64::from(y[slot]), f64::from(z[slot])) * scale
    };
    (
        corner(&node.child_min_x, &node.child_min_y, &node.child_min_z),
        corner(&node.child_max_x, &node.child_max_y, &node.child_max_z),
    )
}

pub fn decode(node: &BvhNode) -> CwBvhNode {
    bytemuck::cast(*node)
}

fn crosses(min: DVec3, max: DVec3, origin: DVec3, direction: DVec3, farthest: f64) -> bool {
    let (a, b) = ((min - origin) / direction, (max - origin) / direction);
    let (near, far) = (a.min(b).max_element(), a.max(b).min_element());
    near.max(0.0) <= far * (1.0 + 1e-12) && near <= farthest
}

/// Calls `leaf` for each primitive whose leaf the ray crosses.
fn walk(scene: &CompiledScene, root: u32, origin: DVec3, direction: DVec3, leaf: &mut impl FnMut(usize)) {
    let mut open = vec![root];
    while let Some(index) = open.pop() {
        let node = decode(&scene.nodes[index as usize]);
        let p = node.p.as_dvec3();
        for slot in (0..8).filter(|slot| node.child_meta[*slot] != 0) {
            let (min, max) = child_box(&node, slot);
            if !crosses(p + min, p + max, origin, direction, f64::INFINITY) {
                continue;
            }
            if node.is_leaf(slot) {
                let (first, count) = node.child_primitives(slot);
                (first..first + count).for_each(|i| leaf(i as usize));
            } else {
                open.push(node.child_node_index(slot));
            }
        }
    }
}

/// Moeller and Trumbore 1997.
fn intersect(scene: &CompiledScene, triangle: usize, origin: DVec3, direction: DVec3) -> Option<f64> {
    let triangle = &scene.triangles[triangle];
    let [a, b, c] = [triangle.v0, triangle.v1, triangle.v2].map(|v| Vec3::from(v).as_dvec3());
    let (ab, ac, from_a) = (b - a, c - a, origin - a);
    let p = direction.cross(ac);
    let q = from_a.cross(ab);
    let inverse = 1.0 / ab.dot(p);
    let (u, v, t) = (from_a.dot(p) * inverse, direction.dot(q) * inverse, ac.dot(q) * inverse);
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0).then_some(t)
}

fn to_object(instance: &Instance, origin: DVec3, direction: DVec3) -> (DVec3, DVec3) {
    let row = |row: [f32; 4]| (Vec3::new(row[0], row[1], row[2]).as_dvec3(), f64::from(row[3]));
    let rows = instance.to_object.map(row);
    let point = rows.map(|(r, t)| r.dot(origin) + t);
    (DVec3::from_array(point), DVec3::from_array(rows.map(|(r, _)| r.dot(direction))))
}

/// Closest hit by the trees.
pub fn closest(scene: &CompiledScene, origin: DVec3, direction: DVec3) -> Hit {
    let mut hit: Hit = None;
    let mut visit = |instance: usize| {
        let (o, d) = to_object(&scene.instances[instance], origin, direction);
        walk(scene, scene.instances[instance].root, o, d, &mut |triangle| {
            keep(&mut hit, intersect(scene, triangle, o, d), instance, triangle);
        });
    };
    if scene.two_level {
        walk(scene, 0, origin, direction, &mut visit);
    } else {
        visit(0);
    }
    hit
}

/// Closest hit by trying everything.
pub fn closest_of_all(scene: &CompiledScene, origin: DVec3, direction: DVec3) -> Hit {
    let mut hit: Hit = None;
    for (index, instance) in scene.instances.iter().enumerate() {
        let (o, d) = to_object(instance, origin, direction);
        let starts = scene.instances.iter().map(|other| other.first_triangle as usize);
        let first = instance.first_triangle as usize;
        let end = starts.filter(|start| *start > first).min().unwrap_or(scene.triangles.len());
        for triangle in first..end {
            keep(&mut hit, intersect(scene, triangle, o, d), index, triangle);
        }
    }
    hit
}

fn keep(hit: &mut Hit, t: Option<f64>, instance: usize, triangle: usize) {
    if let Some(t) = t
        && hit.is_none_or(|(nearest, ..)| t < nearest)
    {
        *hit = Some((t, instance, triangle));
    }
}
