//! Trees: every box contains what lies below it, whatever the boxes are; all primitives are there, once.

use super::Random;
use super::walker::{child_box, decode};
use crate::compile::Bounds;
use crate::compile::bvh::{Tree, Visits, build};
use glam::{DVec3, Vec3};

fn random_boxes(count: usize, offset: Vec3, scale: f32, flat: bool) -> Vec<Bounds> {
    let mut random = Random(7);
    let boxes = (0..count).map(|_| {
        let centre = random.point();
        let corners = [random.point(), random.point(), random.point()].map(|mut p| {
            p = centre + p * 0.1;
            p.y = if flat { 0.3 } else { p.y };
            p * scale + offset
        });
        corners.into_iter().fold(Bounds::default(), Bounds::with)
    });
    boxes.collect()
}

/// Checks containment below a node and returns the exact bounds there.
fn check(tree: &Tree, boxes: &[Bounds], index: usize, seen: &mut [u32], depth: u32) -> Bounds {
    assert!(depth <= tree.depth, "deeper than the tree says");
    let node = decode(&tree.nodes[index]);
    let mut all = Bounds::default();
    for slot in (0..8).filter(|slot| node.child_meta[*slot] != 0) {
        let mut inside = Bounds::default();
        if node.is_leaf(slot) {
            let (first, count) = node.child_primitives(slot);
            for position in first..first + count {
                let primitive = tree.order[position as usize] as usize;
                seen[primitive] += 1;
                inside = inside.union(boxes[primitive]);
            }
        } else {
            inside = check(tree, boxes, node.child_node_index(slot) as usize, seen, depth + 1);
        }
        let p = node.p.as_dvec3();
        let (min, max) = child_box(&node, slot);
        let (low, high): (DVec3, DVec3) = (inside.min.as_dvec3() - p, inside.max.as_dvec3() - p);
        assert!(min.cmple(low).all() && high.cmple(max).all(), "node {index} child {slot}: {min} {low} {high} {max}");
        all = all.union(inside);
    }
    all
}

fn check_tree(boxes: &[Bounds]) -> Tree {
    let tree = build(boxes, |_| Visits::ONE);
    let mut seen = vec![0; boxes.len()];
    check(&tree, boxes, 0, &mut seen, 1);
    assert!(seen.iter().all(|times| *times == 1), "each primitive is in one leaf");
    tree
}

#[test]
fn boxes_contain_their_content() {
    let far = Vec3::new(148_376.0, 1234.0, -223_423.0);
    for count in [1, 2, 3, 4, 9, 1000] {
        for (offset, scale) in [(Vec3::ZERO, 1.0), (far, 1.0), (Vec3::ZERO, 1e-4), (far, 1e4), (Vec3::ONE, 1e-4)] {
            for flat in [false, true] {
                check_tree(&random_boxes(count, offset, scale, flat));
            }
        }
    }
}

#[test]
fn boxes_contain_points_extremes_and_powers_of_two() {
    let at = |p: Vec3| Bounds { min: p, max: p };
    check_tree(&[at(Vec3::splat(3.0))]);
    check_tree(&[at(Vec3::splat(-1e15)), at(Vec3::splat(1e15)), at(Vec3::splat(1e-30))]);
    // Extents of exactly 255 * 2^k, and one ulp more.
    for extent in [255.0_f32, 255.0_f32.next_up(), 255.0 / 1024.0, (255.0_f32 / 1024.0).next_up(), 1.0, 1e-38] {
        for corner in [0.0, 1.0, 0.1, 148_376.0] {
            check_tree(&[
                at(Vec3::splat(corner)),
                at(Vec3::splat(corner + extent)),
                at(Vec3::splat(corner + extent * 0.5)),
            ]);
        }
    }
}

#[test]
fn equal_and_nested_boxes_make_shallow_trees_in_little_time() {
    let around = |size: f32| Bounds { min: Vec3::splat(-size), max: Vec3::splat(size) };
    let start = std::time::Instant::now();
    let equal = check_tree(&vec![around(1.0); 50_000]);
    let nested = check_tree(&(1..50_000).map(|i| around(i as f32)).collect::<Vec<_>>());
    let shrinking = check_tree(&(0..250).map(|i| around(2.0_f32.powi(i - 125))).collect::<Vec<_>>());
    let corner = |i: i32| Bounds { min: Vec3::ZERO, max: Vec3::splat(1.3_f32.powi(i)) };
    let fan = check_tree(&(0..100).map(corner).collect::<Vec<_>>());
    let steep = check_tree(
        &(0..240).map(|i| Bounds { max: Vec3::splat(1.4_f32.powi(i - 120)), ..corner(0) }).collect::<Vec<_>>(),
    );
    for tree in [equal, nested, shrinking, fan, steep] {
        assert!(tree.depth <= 24, "depth {}", tree.depth);
    }
    assert!(start.elapsed().as_secs() < 20, "{:?}", start.elapsed());
}

#[test]
fn trees_do_not_depend_on_the_number_of_threads() {
    let boxes = random_boxes(20_000, Vec3::ZERO, 1.0, false);
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let (one, many) = (alone.install(|| build(&boxes, |_| Visits::ONE)), build(&boxes, |_| Visits::ONE));
    assert_eq!(one.order, many.order);
    assert!(one.nodes.iter().zip(&many.nodes).all(|(a, b)| a.words == b.words));
}

#[test]
fn no_box_makes_an_empty_node() {
    let tree = build(&[], |_| Visits::ONE);
    assert_eq!((tree.nodes.len(), tree.depth), (1, 1));
    assert_eq!(decode(&tree.nodes[0]).child_meta, [0; 8]);
}
