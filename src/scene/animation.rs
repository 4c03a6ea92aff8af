//! Animations: curves over time, and the scene as it stands at a moment (glTF 2.0, 3.11 and appendix C).

use super::Scene;
use glam::{DAffine3, DQuat, DVec3};
use std::collections::BTreeMap;

/// A moment of an animation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// Index into [`Scene::animations`].
    pub animation: usize,
    /// Seconds, finite. Before the first key of a channel its first value holds, after the last its last.
    pub time: f64,
}

/// An animation of the file: what it moves, and how.
#[derive(Debug, Clone, Default)]
pub struct Animation {
    /// Name in the file.
    pub name: Option<String>,
    /// What moves, in the file's order; channels that move nothing known here are left out.
    pub channels: Vec<Channel>,
    /// Seconds of its first and its last key.
    pub span: [f64; 2],
    /// Whether a mesh changes its place or shape by it (rather than cameras and lights alone).
    pub moves_meshes: bool,
}

/// A property of a node that follows a curve.
#[derive(Debug, Clone)]
pub struct Channel {
    /// Index into [`Scene::nodes`].
    pub node: usize,
    /// Which property.
    pub path: Path,
    /// Its values.
    pub curve: Curve,
}

/// An animated property of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Path {
    /// Translation: 3 numbers.
    Translation,
    /// Rotation: a quaternion (x, y, z, w), unit length.
    Rotation,
    /// Scale: 3 numbers.
    Scale,
    /// Weights of morph targets.
    Weights,
}

/// How values between keys are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Interpolation {
    /// Along the straight line; rotations along the great arc.
    #[default]
    Linear,
    /// The value of the key before.
    Step,
    /// A cubic with the tangents of the keys (Hermite).
    CubicSpline,
}

/// Values at times.
#[derive(Debug, Clone, Default)]
pub struct Curve {
    /// Seconds, strictly increasing, at least one.
    pub times: Vec<f32>,
    /// Per key `width` numbers; of a cubic three times as many: tangent in, value, tangent out.
    pub values: Vec<f32>,
    /// Numbers of a value.
    pub width: usize,
    /// Between the keys.
    pub interpolation: Interpolation,
}

/// Where a time lies among the keys.
enum Place {
    At(usize),
    /// After a key, by a part of the seconds to the next one.
    Between {
        key: usize,
        part: f64,
        seconds: f64,
    },
}

impl Curve {
    fn place(&self, time: f64) -> Place {
        let seconds = |key: usize| self.times.get(key).map_or(0.0, |time| f64::from(*time));
        let next = self.times.partition_point(|key| f64::from(*key) <= time);
        match next.checked_sub(1) {
            None => Place::At(0),
            Some(key) if next == self.times.len() => Place::At(key),
            Some(key) => {
                let step = seconds(next) - seconds(key);
                Place::Between { key, part: (time - seconds(key)) / step, seconds: step }
            }
        }
    }

    /// The numbers of a key; of a cubic `part` 0 is the tangent in, 1 the value, 2 the tangent out.
    fn numbers(&self, key: usize, part: usize) -> &[f32] {
        let start = match self.interpolation {
            Interpolation::CubicSpline => (key * 3 + part) * self.width,
            _ => key * self.width,
        };
        self.values.get(start..start + self.width).unwrap_or_default()
    }

    fn value(&self, key: usize) -> Vec<f64> {
        self.numbers(key, 1).iter().map(|number| f64::from(*number)).collect()
    }

    /// The value at a time; of a linear rotation use [`Self::rotation`].
    pub fn at(&self, time: f64) -> Vec<f64> {
        match self.place(time) {
            Place::At(key) => self.value(key),
            Place::Between { key, .. } if self.interpolation == Interpolation::Step => self.value(key),
            Place::Between { key, part, .. } if self.interpolation == Interpolation::Linear => {
                let (from, to) = (self.value(key), self.value(key + 1));
                from.iter().zip(&to).map(|(from, to)| from * (1.0 - part) + to * part).collect()
            }
            Place::Between { key, part, seconds } => self.hermite(key, part, seconds),
        }
    }

    /// Appendix C.5: the cubic through both values with the tangents, which are per second.
    fn hermite(&self, key: usize, t: f64, seconds: f64) -> Vec<f64> {
        let (t2, t3) = (t * t, t * t * t);
        let factors =
            [2.0 * t3 - 3.0 * t2 + 1.0, seconds * (t3 - 2.0 * t2 + t), -2.0 * t3 + 3.0 * t2, seconds * (t3 - t2)];
        let ends = [self.numbers(key, 1), self.numbers(key, 2), self.numbers(key + 1, 1), self.numbers(key + 1, 0)];
        let number = |end: &[f32], i: usize| end.get(i).map_or(0.0, |number| f64::from(*number));
        let at = |i| factors.iter().zip(ends).map(|(factor, end)| factor * number(end, i)).sum();
        (0..self.width).map(at).collect()
    }

    /// The rotation at a time, unit length. Appendix C.4: linear is along the shorter great arc.
    pub fn rotation(&self, time: f64) -> DQuat {
        let unit = |numbers: &[f64]| match *numbers {
            [x, y, z, w] => normalized(DQuat::from_xyzw(x, y, z, w)),
            _ => DQuat::IDENTITY,
        };
        match self.place(time) {
            Place::Between { key, part, .. } if self.interpolation == Interpolation::Linear => {
                unit(&self.value(key)).slerp(unit(&self.value(key + 1)), part).normalize()
            }
            _ => unit(&self.at(time)),
        }
    }
}

/// A unit quaternion; of one without length (a cubic may pass zero) no turn.
fn normalized(rotation: DQuat) -> DQuat {
    let length = rotation.length();
    if length > 0.0 && length.is_finite() { rotation / length } else { DQuat::IDENTITY }
}

/// A transform in the parts that animations move.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parts {
    /// Translation.
    pub translation: DVec3,
    /// Rotation, unit length.
    pub rotation: DQuat,
    /// Scale along the axes.
    pub scale: DVec3,
}

impl From<Parts> for DAffine3 {
    fn from(parts: Parts) -> Self {
        Self::from_scale_rotation_translation(parts.scale, parts.rotation, parts.translation)
    }
}

impl Scene {
    /// The scene as it stands at a moment; meshes keep their vertices, which [`Scene::drawn`] moves. None: the scene as
    /// the file stores it.
    pub fn at(&self, moment: Option<Moment>) -> Self {
        let mut scene = self.clone();
        let Some(moment) = moment else { return scene };
        let mut moved: BTreeMap<usize, Parts> = BTreeMap::new();
        for channel in self.animations.get(moment.animation).map_or(&[][..], |animation| &animation.channels) {
            let curve = &channel.curve;
            let (Some(node), Some(rest)) = (scene.nodes.get_mut(channel.node), self.moved.get(&channel.node)) else {
                continue;
            };
            let parts = moved.entry(channel.node).or_insert(*rest);
            match channel.path {
                Path::Translation => parts.translation = vector(&curve.at(moment.time)),
                Path::Scale => parts.scale = vector(&curve.at(moment.time)),
                Path::Rotation => parts.rotation = curve.rotation(moment.time),
                Path::Weights => node.weights = curve.at(moment.time),
            }
        }
        for (node, parts) in moved {
            if let Some(node) = scene.nodes.get_mut(node) {
                node.local = parts.into();
            }
        }
        scene
    }
}

fn vector(numbers: &[f64]) -> DVec3 {
    DVec3::from_slice(numbers.get(..3).unwrap_or(&[0.0; 3]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    fn curve(times: &[f32], values: &[f32], width: usize, interpolation: Interpolation) -> Curve {
        Curve { times: times.to_vec(), values: values.to_vec(), width, interpolation }
    }

    #[test]
    fn curves_hold_before_and_after_their_keys() {
        for interpolation in [Interpolation::Linear, Interpolation::Step] {
            let curve = curve(&[1.0, 2.0, 4.0], &[10.0, 20.0, 0.0], 1, interpolation);
            let at = |time| curve.at(time)[0];
            assert_eq!([at(-1e300), at(0.0), at(1.0), at(2.0), at(4.0), at(1e300)], [10.0, 10.0, 10.0, 20.0, 0.0, 0.0]);
            let between = if interpolation == Interpolation::Step { [10.0, 20.0] } else { [12.5, 10.0] };
            assert_eq!([at(1.25), at(3.0)], between);
        }
    }

    #[test]
    fn cubics_have_the_values_and_tangents_of_their_keys() {
        // p(t) = t^3 - t on [1, 3]: exact whatever the keys.
        let (value, slope) = (|t: f32| t * t * t - t, |t: f32| 3.0 * t * t - 1.0);
        let key = |t: f32| [slope(t), value(t), slope(t)];
        let values = [key(1.0), key(1.5), key(3.0)].concat();
        let curve = curve(&[1.0, 1.5, 3.0], &values, 1, Interpolation::CubicSpline);
        for i in 0..=40 {
            let t = 1.0 + f64::from(i) * 0.05;
            assert!((curve.at(t)[0] - (t * t * t - t)).abs() < 1e-12 * 24.0, "{t}");
        }
        assert_eq!((curve.at(0.0)[0], curve.at(9.0)[0]), (0.0, 24.0));
    }

    #[test]
    fn rotations_take_the_shorter_arc_at_even_speed() {
        let quarter = DQuat::from_rotation_y(FRAC_PI_2).as_quat().to_array();
        for sign in [1.0, -1.0] {
            let values =
                [0.0, 0.0, 0.0, 1.0, quarter[0] * sign, quarter[1] * sign, quarter[2] * sign, quarter[3] * sign];
            let curve = curve(&[0.0, 3.0], &values, 4, Interpolation::Linear);
            for part in [0.25, 0.5, 0.9] {
                let expected = DQuat::from_rotation_y(FRAC_PI_2 * part);
                assert!(curve.rotation(part * 3.0).angle_between(expected) < 1e-6, "{sign} {part}");
            }
        }
        // A cubic is normalised: half way between two opposite half turns it has no length, and does not turn.
        let half = DQuat::from_rotation_y(PI).as_quat().to_array();
        let zero = [0.0; 4];
        let values = [zero, half, zero, zero, half.map(|x| -x), zero].concat();
        let curve = curve(&[0.0, 1.0], &values, 4, Interpolation::CubicSpline);
        assert_eq!(curve.rotation(0.5), DQuat::IDENTITY);
        assert!((curve.rotation(0.25).length() - 1.0).abs() < 1e-12);
    }
}
