//! Emitting triangles drawn by how much they may light a point (Conty Estevez and Kulla 2018; pbrt-v4, 12.6.3): see
//! [`LightTree`](crate::compile::LightTree).

use super::place::Place;
use crate::compile::LightNode;
use glam::DVec3;

/// Where light is wanted.
#[derive(Debug, Clone, Copy)]
pub struct Receiver {
    /// Relative to the scene's origin.
    pub position: DVec3,
    /// Of the surface, on the side of the viewer; zero in a medium, which has none.
    pub normal: DVec3,
}

impl Receiver {
    /// A shading point.
    pub fn of(place: &Place) -> Self {
        Self { position: place.position, normal: place.normal }
    }
}

/// Nodes, and whether light from behind a surface counts.
#[derive(Debug, Clone, Copy)]
pub struct Tree<'a> {
    /// The root first.
    pub nodes: &'a [LightNode],
    /// Some surface of the scene lets light through.
    pub both_sides: bool,
}

impl Tree<'_> {
    /// An emitter and its probability; none: no emitter can light the receiver.
    pub fn sample(&self, receiver: &Receiver, mut u: f64) -> Option<(usize, f64)> {
        let mut node = self.nodes.first()?;
        let mut probability = 1.0;
        while node.child & LightNode::LEAF == 0 {
            let [first, second] = self.children(node);
            let share = self.first_share(first, second, receiver)?;
            if u < share {
                (node, u, probability) = (first, u / share, probability * share);
            } else {
                (node, u, probability) = (second, (u - share) / (1.0 - share), probability * (1.0 - share));
            }
        }
        Some(((node.child & LightNode::INDEX) as usize, probability))
    }

    /// Probability of drawing the emitter at the end of a trail.
    pub fn probability(&self, receiver: &Receiver, mut trail: u32) -> f64 {
        let Some(mut node) = self.nodes.first() else { return 0.0 };
        let mut probability = 1.0;
        while node.child & LightNode::LEAF == 0 {
            let [first, second] = self.children(node);
            let Some(share) = self.first_share(first, second, receiver) else { return 0.0 };
            (node, probability) =
                if trail & 1 == 0 { (first, probability * share) } else { (second, probability * (1.0 - share)) };
            trail >>= 1;
        }
        probability
    }

    fn children(&self, node: &LightNode) -> [&LightNode; 2] {
        let first = (node.child & LightNode::INDEX) as usize;
        [&self.nodes[first], &self.nodes[first + 1]]
    }

    /// Probability of the first of two siblings; none: neither sends anything.
    fn first_share(&self, first: &LightNode, second: &LightNode, receiver: &Receiver) -> Option<f64> {
        let [first, second] = [first, second].map(|node| self.importance(node, receiver));
        let sum = first + second;
        (sum > 0.0).then(|| first / sum)
    }

    /// Bound, but for a constant, of what a node's triangles send to a receiver: their power over the square of the distance,
    /// times the cosines at either end, each at the best angle that box and cone allow.
    fn importance(&self, node: &LightNode, receiver: &Receiver) -> f64 {
        let [low, high, axis] = [node.min, node.max, node.axis].map(|v| DVec3::from(v.map(f64::from)));
        let extent = 0.5 * (high - low);
        let radius2 = extent.length_squared();
        let way = 0.5 * (low + high) - receiver.position;
        let is_below = way.dot(receiver.normal) + extent.dot(receiver.normal.abs()) <= 0.0;
        if is_below && !self.both_sides {
            return 0.0;
        }
        let distance2 = way.length_squared();
        let power = f64::from(node.power);
        if distance2 <= radius2 {
            return power / radius2;
        }
        let direction = way / distance2.sqrt();
        let around = Angle::from_sine2(radius2 / distance2);
        let either_side = |cosine: f64, both: bool| Angle::from_cosine(if both { cosine.abs() } else { cosine });
        let sent = either_side(-direction.dot(axis), node.child & LightNode::TWO_SIDED != 0);
        let leaving = sent.less(Angle::from_cosine(f64::from(node.cos_spread))).less(around);
        if receiver.normal == DVec3::ZERO {
            return power * leaving.cos.max(0.0) / distance2;
        }
        let arriving = either_side(direction.dot(receiver.normal), self.both_sides).less(around);
        power * leaving.cos.max(0.0) * arriving.cos.max(0.0) / distance2
    }
}

/// From 0 to pi.
#[derive(Debug, Clone, Copy)]
struct Angle {
    cos: f64,
    sin: f64,
}

impl Angle {
    fn from_cosine(cos: f64) -> Self {
        Self { cos, sin: (1.0 - cos * cos).max(0.0).sqrt() }
    }

    /// At most a right angle, of the square of its sine.
    fn from_sine2(sine2: f64) -> Self {
        Self { cos: (1.0 - sine2).sqrt(), sin: sine2.sqrt() }
    }

    /// The difference, or 0 if the other is larger.
    fn less(self, other: Self) -> Self {
        if self.cos > other.cos {
            return Self { cos: 1.0, sin: 0.0 };
        }
        Self { cos: self.cos * other.cos + self.sin * other.sin, sin: self.sin * other.cos - self.cos * other.sin }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_of_angles_are_those_of_their_cosines() {
        for i in 0..=60 {
            for j in 0..=60 {
                let [a, b] = [i, j].map(|k| std::f64::consts::PI * f64::from(k) / 60.0);
                let left = Angle::from_cosine(a.cos()).less(Angle::from_cosine(b.cos()));
                let expected = (a - b).max(0.0);
                assert!(
                    (left.cos - expected.cos()).abs() < 1e-7 && (left.sin - expected.sin()).abs() < 1e-7,
                    "{a} - {b}"
                );
            }
        }
    }

    /// By the definition: the best of many points of the box, of many normals of the cone.
    #[test]
    fn importance_bounds_what_arrives() {
        let (axis, spread) = (DVec3::new(0.3, -0.9, 0.2).normalize(), 0.4f64);
        let node = LightNode {
            min: [-0.5, 1.0, -0.2],
            max: [0.7, 1.4, 0.3],
            power: 1.0,
            axis: axis.as_vec3().to_array(),
            cos_spread: spread.cos() as f32,
            ..LightNode::default()
        };
        let tree = Tree { nodes: &[], both_sides: false };
        let (across, along) = axis.any_orthonormal_pair();
        let unit = |k: u32, n: u32| f64::from(k) / f64::from(n - 1);
        for place in 0..64u32 {
            let position = DVec3::new(unit(place % 4, 4), unit(place / 4 % 4, 4), unit(place / 16, 4)) * 6.0 - 3.0;
            let receiver = Receiver { position, normal: DVec3::new(0.1, 0.9, -0.3).normalize() };
            let importance = tree.importance(&node, &receiver);
            let radius2 = 0.25 * (DVec3::new(1.2, 0.4, 0.5)).length_squared();
            for k in 0..125u32 {
                let part = DVec3::new(unit(k % 5, 5), unit(k / 5 % 5, 5), unit(k / 25, 5));
                let point = DVec3::new(-0.5, 1.0, -0.2) + part * DVec3::new(1.2, 0.4, 0.5);
                let way = point - position;
                let best = (0..9).map(|turn| {
                    let aside = f64::from(turn) * std::f64::consts::TAU / 8.0;
                    let tilt = if turn == 8 { 0.0 } else { spread };
                    let normal = axis * tilt.cos() + (across * aside.cos() + along * aside.sin()) * tilt.sin();
                    -way.normalize().dot(normal)
                });
                let leaving = best.fold(0.0, f64::max);
                let arriving = way.normalize().dot(receiver.normal).max(0.0);
                let centre = DVec3::new(0.1, 1.2, 0.05).distance_squared(position).max(radius2);
                assert!(leaving * arriving / centre <= importance * (1.0 + 1e-5), "from {position} to {point}");
            }
        }
    }
}
