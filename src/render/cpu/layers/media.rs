//! What a path is in: the filled meshes that it has entered, the last one on top.
//!
//! The last one entered is what the path is in. Where a mesh is left that is not on top, nothing is seen of its surface: a liquid
//! that reaches into the wall of its glass thereby has one surface with the wall, not two with air between.

use crate::compile::{CompiledScene, Extended, Material};
use glam::DVec3;

/// Most meshes within one another; of more the outermost are forgotten.
const MOST: usize = 4;

/// Meshes that the path is in, by their index in `CompiledScene::extended`.
#[derive(Debug, Clone, Copy, Default)]
pub struct Media {
    stack: [u32; MOST],
    depth: usize,
}

/// The two sides of a surface.
#[derive(Debug, Clone, Copy)]
pub struct Crossing {
    /// Index of refraction beyond over that before.
    pub eta: f64,
    /// Where a path is that goes through.
    pub beyond: Media,
}

/// Place of a material in `CompiledScene::extended`.
pub fn id(material: &Material) -> u32 {
    (material.flags >> Material::EXTENDED_SHIFT).wrapping_sub(1)
}

/// Index of refraction at a place in the visible range, 0 its red and 1 its blue end; without one, at the sodium line's. 0 is
/// infinite (KHR_materials_dispersion).
pub fn index_of(extended: &Extended, wavelength: Option<f64>) -> f64 {
    let ior = f64::from(extended.ior);
    // By Abbe's number, n(F) - n(C) = (n(d) - 1) / V, with V = 20 / dispersion.
    let spread = (ior - 1.0) * f64::from(extended.dispersion) / 20.0;
    match wavelength {
        Some(place) if ior > 0.0 => (ior + spread * (place - 0.5)).max(1.0),
        _ => ior,
    }
}

/// Weight of the colours at a place in the visible range; their means are one.
pub fn colors_at(place: f64) -> DVec3 {
    DVec3::new(
        4.0 * (1.0 - 2.0 * place).max(0.0),
        2.0 * (1.0 - (2.0 * place - 1.0).abs()),
        4.0 * (2.0 * place - 1.0).max(0.0),
    )
}

impl Media {
    /// Passing the surface of a filled mesh.
    pub fn crossing(&self, scene: &CompiledScene, id: u32, back: bool, wavelength: Option<f64>) -> Crossing {
        let index = |id: Option<u32>| {
            let extended = id.and_then(|id| scene.extended.get(id as usize));
            // Infinite indices let nothing in.
            extended.map_or(1.0, |extended| index_of(extended, wavelength)).max(1.0)
        };
        if !back {
            return Crossing { eta: index(Some(id)) / index(self.top()), beyond: self.entered(id) };
        }
        let beyond = self.left(id);
        let inside = if self.holds(id) { self.top() } else { Some(id) };
        Crossing { eta: index(beyond.top()) / index(inside), beyond }
    }

    /// Part of the light that is left after a way through what the path is in. `left`: the mesh whose surface was met from within,
    /// in which the path must have begun if it has not entered it.
    pub fn transmittance(&self, scene: &CompiledScene, left: Option<u32>, distance: f64) -> DVec3 {
        let extended = self.top().or(left).and_then(|id| scene.extended.get(id as usize));
        let Some(extended) = extended.filter(|_| distance.is_finite()) else { return DVec3::ONE };
        (DVec3::from(extended.absorption.map(f64::from)) * -distance).exp()
    }

    /// What scatters light on a way; `left` as in [`Self::transmittance`].
    pub fn scattering<'a>(&self, scene: &'a CompiledScene, left: Option<u32>) -> Option<&'a Extended> {
        let medium = self.top().or(left).and_then(|id| scene.extended.get(id as usize));
        medium.filter(|medium| medium.scatters())
    }

    /// Where a path is that was in the mesh of `left` all along, if it is in nothing else.
    pub fn within(self, left: Option<u32>) -> Self {
        match left {
            Some(id) if self.depth == 0 => self.entered(id),
            _ => self,
        }
    }

    fn top(&self) -> Option<u32> {
        self.depth.checked_sub(1).map(|last| self.stack[last])
    }

    fn holds(&self, id: u32) -> bool {
        self.stack[..self.depth].contains(&id)
    }

    fn entered(mut self, id: u32) -> Self {
        if self.depth == MOST {
            self.stack.rotate_left(1);
            self.depth -= 1;
        }
        self.stack[self.depth] = id;
        self.depth += 1;
        self
    }

    fn left(mut self, id: u32) -> Self {
        if let Some(place) = self.stack[..self.depth].iter().rposition(|entered| *entered == id) {
            self.stack.copy_within(place + 1..self.depth, place);
            self.depth -= 1;
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene() -> CompiledScene {
        let of = |ior| Extended { ior, absorption: [ior; 3], ..Extended::default() };
        CompiledScene { extended: vec![of(1.5), of(1.25)], ..CompiledScene::default() }
    }

    #[test]
    fn a_liquid_that_reaches_into_its_glass_has_one_surface_with_it() {
        let scene = scene();
        let cross = |media: Media, id, back| media.crossing(&scene, id, back, None);
        let glass = cross(Media::default(), 0, false);
        assert_eq!(glass.eta, 1.5);
        let both = cross(glass.beyond, 1, false);
        assert_eq!(both.eta, 1.25 / 1.5);
        let liquid = cross(both.beyond, 0, true);
        assert_eq!((liquid.eta, liquid.beyond.depth), (1.0, 1));
        assert_eq!(cross(liquid.beyond, 1, true).eta, 1.0 / 1.25);
        assert_eq!(both.beyond.transmittance(&scene, None, 2.0), DVec3::splat((-2.5f64).exp()));
    }

    #[test]
    fn a_path_may_begin_inside() {
        let scene = scene();
        assert_eq!(Media::default().crossing(&scene, 0, true, None).eta, 1.0 / 1.5);
        assert_eq!(Media::default().transmittance(&scene, Some(0), 1.0), DVec3::splat((-1.5f64).exp()));
        assert_eq!(Media::default().transmittance(&scene, None, 1.0), DVec3::ONE);
    }

    #[test]
    fn the_outermost_of_too_many_is_forgotten() {
        let media = (0..10).fold(Media::default(), |media, id| media.entered(id));
        assert_eq!((media.depth, media.holds(6), media.holds(5)), (MOST, true, false));
    }

    #[test]
    fn colours_average_to_white() {
        let mean = (0..1000).map(|i| colors_at((f64::from(i) + 0.5) / 1000.0)).sum::<DVec3>() / 1000.0;
        assert!(mean.abs_diff_eq(DVec3::ONE, 1e-5), "{mean}");
    }
}
