//! What moves vertices: joints with their weights, and morph targets.

use super::meshes::{Decoder, Source};
use crate::scene::{Influences, SceneError, Target};
use glam::Vec3;

/// How far the weights of a vertex may be from adding up to 1 before a warning says so.
const TOLERANCE: f32 = 0.02;

/// Vertices of a primitive whose weights had to be mended.
#[derive(Default)]
struct Mended {
    negative: usize,
    absent: usize,
    unequal: usize,
}

impl Decoder<'_> {
    /// Joints and weights of a primitive that a skin moves; none: it has none.
    pub(super) fn influences(&mut self, source: Source<'_>) -> Result<Option<Influences>, SceneError> {
        if !source.need.skinned {
            return Ok(None);
        }
        let of_set = |name: &str, set: usize| source.primitive.attributes.get(&format!("{name}_{set}")).copied();
        let mut sets = Vec::new();
        while let (Some(joints), Some(weights)) = (of_set("JOINTS", sets.len()), of_set("WEIGHTS", sets.len())) {
            let set = sets.len();
            let joints = self.numbers::<4>(source, joints, &format!("attributes/JOINTS_{set}"))?;
            let weights = self.numbers::<4>(source, weights, &format!("attributes/WEIGHTS_{set}"))?;
            sets.push((joints, weights));
        }
        if sets.is_empty() {
            let detail =
                "a skin moves the mesh, but this primitive lacks JOINTS_0 or WEIGHTS_0; it stays where its node is";
            self.warnings.add("skin_weights", source.place, detail);
            return Ok(None);
        }
        let mut influences = Influences { per_vertex: sets.len() * 4, ..Influences::default() };
        let mut mended = Mended::default();
        for vertex in 0..sets.first().map_or(0, |(joints, _)| joints.len()) {
            let start = influences.weights.len();
            for (joints, weights) in &sets {
                // Joints are stored as 16 bits at most.
                influences.joints.extend(joints.get(vertex).into_iter().flatten().map(|joint| *joint as u16));
                influences.weights.extend(weights.get(vertex).into_iter().flatten());
            }
            mended.mend(&mut influences.weights[start..]);
        }
        self.report(&mended, source.place);
        Ok(Some(influences))
    }

    fn report(&mut self, mended: &Mended, place: &str) {
        let Mended { negative, absent, unequal } = mended;
        let mut warn = |count: &usize, detail: &str| {
            if *count > 0 {
                let place = format!("{place}/attributes/WEIGHTS_0");
                self.warnings.add("skin_weights", place, format!("{count} vertices {detail}"));
            }
        };
        warn(negative, "have negative weights, which are taken as 0");
        warn(absent, "have no weight at all; the first joint moves them");
        warn(unequal, "have weights that do not add up to 1; they are scaled");
    }

    /// Morph targets of a primitive that weights ever move.
    pub(super) fn targets(&mut self, source: Source<'_>) -> Result<Vec<Target>, SceneError> {
        let mut targets = Vec::new();
        for (index, attributes) in source.primitive.targets.iter().enumerate().filter(|_| source.need.morphed) {
            let mut list = |name: &str| -> Result<Vec<Vec3>, SceneError> {
                let Some(accessor) = attributes.get(name) else { return Ok(Vec::new()) };
                let numbers = self.numbers::<3>(source, *accessor, &format!("targets/{index}/{name}"))?;
                Ok(numbers.into_iter().map(Vec3::from).collect())
            };
            let target = Target { positions: list("POSITION")?, normals: list("NORMAL")?, tangents: list("TANGENT")? };
            targets.push(target);
            let other = attributes.keys().find(|name| !["POSITION", "NORMAL", "TANGENT"].contains(&name.as_str()));
            if let Some(other) = other {
                let place = format!("{}/targets/{index}/{}", source.place, super::document::escape(other));
                self.warnings.add("morph_ignored", place, "morph targets move positions, normals and tangents only");
            }
        }
        Ok(targets)
    }
}

impl Mended {
    /// Makes the weights of a vertex add up to 1.
    fn mend(&mut self, weights: &mut [f32]) {
        if weights.iter().any(|weight| *weight < 0.0) {
            self.negative += 1;
            weights.iter_mut().for_each(|weight| *weight = weight.max(0.0));
        }
        let sum: f32 = weights.iter().sum();
        if sum.is_finite() && sum > f32::MIN_POSITIVE {
            self.unequal += usize::from((sum - 1.0).abs() > TOLERANCE);
            weights.iter_mut().for_each(|weight| *weight /= sum);
        } else {
            self.absent += 1;
            weights.iter_mut().enumerate().for_each(|(i, weight)| *weight = if i == 0 { 1.0 } else { 0.0 });
        }
    }
}
