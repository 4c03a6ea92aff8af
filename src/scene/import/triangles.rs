//! Lists, strips and fans -> triangle lists (glTF 2.0, 3.7.2.1).

/// How vertices form triangles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Mode {
    List,
    Strip,
    Fan,
}

impl Mode {
    /// Number of triangles that `count` vertices make.
    pub(super) fn triangles(self, count: usize) -> usize {
        match self {
            Self::List => count / 3,
            Self::Strip | Self::Fan => count.saturating_sub(2),
        }
    }

    /// Corners of triangle `i` in the order of the vertices.
    fn corners(self, i: usize) -> [usize; 3] {
        match self {
            Self::List => [3 * i, 3 * i + 1, 3 * i + 2],
            Self::Strip => [i, i + 1 + i % 2, i + 2 - i % 2],
            Self::Fan => [i + 1, i + 2, 0],
        }
    }
}

/// Triangles of `count` vertices, through `indices` if given.
pub(super) fn list(mode: Mode, count: usize, indices: Option<&[u32]>) -> Vec<[u32; 3]> {
    let vertex = |corner: usize| match indices {
        Some(indices) => indices.get(corner).copied().unwrap_or(0),
        None => corner as u32,
    };
    (0..mode.triangles(count)).map(|i| mode.corners(i).map(vertex)).collect()
}

/// If the triangles use only a few of `count` vertices: those that they use, in order, to which the triangles then refer.
/// Primitives often share one long array of vertices, each using a part.
pub(super) fn compact(triangles: &mut [[u32; 3]], count: usize) -> Option<Vec<u32>> {
    if triangles.len() * 3 >= count {
        return None;
    }
    let mut used: Vec<u32> = triangles.iter().flatten().copied().collect();
    used.sort_unstable();
    used.dedup();
    for vertex in triangles.iter_mut().flatten() {
        *vertex = used.binary_search(vertex).map_or(0, |position| position as u32);
    }
    Some(used)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn winding_is_kept() {
        assert_eq!(list(Mode::List, 7, None), [[0, 1, 2], [3, 4, 5]]);
        assert_eq!(list(Mode::Strip, 5, None), [[0, 1, 2], [1, 3, 2], [2, 3, 4]]);
        assert_eq!(list(Mode::Fan, 5, None), [[1, 2, 0], [2, 3, 0], [3, 4, 0]]);
        assert_eq!(list(Mode::Strip, 3, Some(&[7, 5, 9])), [[7, 5, 9]]);
        for mode in [Mode::List, Mode::Strip, Mode::Fan] {
            assert!(list(mode, 2, None).is_empty());
        }
    }

    #[test]
    fn unused_vertices_are_left_out() {
        let mut triangles = [[9, 5, 7], [7, 5, 100]];
        assert_eq!(compact(&mut triangles, 1000), Some(vec![5, 7, 9, 100]));
        assert_eq!(triangles, [[2, 0, 1], [1, 0, 3]]);
        assert_eq!(compact(&mut triangles, 6), None);
    }
}
