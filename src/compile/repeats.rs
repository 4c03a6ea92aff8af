//! What lies exactly on its like: copies made by mistake, of which a renderer can show one only. They are left out, for every
//! ray would visit each of them, and an emitter behind its equal would be drawn as a light that nobody can see.

use super::assemble::Standing;
use super::{Bounds, Triangle};
use std::collections::HashSet;

/// For each triangle whether it stays: the first of those with the same corners, front and material, if that is `opaque`.
/// None: all do. `by_place`: an order in which boxes of one centre are neighbours.
pub fn first_ones(
    triangles: &[Triangle],
    boxes: &[Bounds],
    by_place: &[u32],
    opaque: impl Fn(&Triangle) -> bool,
) -> Option<Vec<bool>> {
    let centre = |index: &u32| boxes[*index as usize].min + boxes[*index as usize].max;
    let mut stays: Option<Vec<bool>> = None;
    for place in by_place.chunk_by(|a, b| centre(a) == centre(b)).filter(|place| place.len() > 1) {
        let mut seen = HashSet::new();
        for &index in place {
            let triangle = &triangles[index as usize];
            let shape = bytemuck::cast::<_, [u32; 12]>(Triangle { light: 0, primitive: 0, ..*triangle });
            if opaque(triangle) && !seen.insert(shape) {
                stays.get_or_insert_with(|| vec![true; triangles.len()])[index as usize] = false;
            }
        }
    }
    stays
}

/// Leaves one of equal placements of a mesh whose materials are all opaque.
pub fn keep_first_places(standing: &mut Vec<Standing>, opaque: impl Fn(usize) -> bool) {
    let mut seen = HashSet::new();
    standing.retain(|place| {
        !opaque(place.bottom) || seen.insert((place.bottom, place.map.to_cols_array().map(f64::to_bits)))
    });
}
