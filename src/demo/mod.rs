//! Scenes that Candela makes itself, as GLB bytes: for pictures, tests and benchmarks that need no file from elsewhere.
//!
//! All in metres, +Y up, with a camera; the same bytes every time.

mod burdens;
mod glb;
mod materials;
mod motion;
mod shapes;
mod still_life;
mod stress;
mod studies;
mod textures;

pub use burdens::{Burden, Use, burdened, closed_room};
pub use motion::motion;
pub use still_life::still_life;
pub use stress::{many_emitters, many_instances};
pub use studies::{bumpy_sphere, furnace, light_box, material_grid, plane_and_point_light, surface_detail};
pub use textures::png;

/// A scene that can be asked for by name.
#[derive(Debug, Clone, Copy)]
pub struct Demo {
    /// What to ask for.
    pub name: &'static str,
    /// What it shows.
    pub description: &'static str,
    /// Makes its GLB.
    pub make: fn() -> Vec<u8>,
}

/// Every scene that has a name.
pub const DEMOS: [Demo; 12] = [
    Demo { name: "still-life", description: "a vase, gold, stone, steel and two lamps on a table", make: still_life },
    Demo { name: "grid", description: "49 spheres: roughness across, metallic upwards", make: material_grid },
    Demo { name: "box", description: "an open box with coloured walls under a square lamp", make: light_box },
    Demo { name: "detail", description: "textures, normal map, alpha, emission, vertex colours", make: surface_detail },
    Demo {
        name: "furnace",
        description: "a white metal sphere; vanishes with --set 'environment={\"constant\":[1,1,1]}'",
        make: white_furnace,
    },
    Demo { name: "plane", description: "a plane one metre under a point light", make: plane_and_point_light },
    Demo { name: "bumpy-10k", description: "a bumpy sphere of 9,800 triangles", make: || bumpy_sphere(35) },
    Demo { name: "bumpy-160k", description: "the same of 159,048", make: || bumpy_sphere(141) },
    Demo { name: "bumpy-1m", description: "the same of 1,002,528", make: || bumpy_sphere(354) },
    Demo { name: "instances", description: "10,000 instances of five meshes", make: || many_instances(100) },
    Demo {
        name: "motion",
        description: "a wheel that turns, a ball and a lamp that move: --set 'shutter={\"open\":0,\"close\":0.04}' --set time=0.5",
        make: motion,
    },
    Demo { name: "emitters", description: "1,024 small lamps over a floor", make: || many_emitters(32) },
];

/// The GLB of the demo of that name.
pub fn by_name(name: &str) -> Option<Vec<u8>> {
    DEMOS.iter().find(|demo| demo.name == name).map(|demo| (demo.make)())
}

fn white_furnace() -> Vec<u8> {
    furnace(1.0, 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn every_demo_is_a_valid_glb() {
        for demo in DEMOS {
            let bytes = (demo.make)();
            let file = gltf::Gltf::from_slice(&bytes).unwrap_or_else(|error| panic!("{}: {error}", demo.name));
            assert!(file.cameras().count() > 0, "{} has no camera", demo.name);
            let blob = file.blob.as_deref().unwrap();
            for primitive in file.meshes().flat_map(|mesh| mesh.primitives()) {
                let reader = primitive.reader(|_| Some(blob));
                let vertices = reader.read_positions().unwrap().count();
                let indices: Vec<u32> = reader.read_indices().unwrap().into_u32().collect();
                assert!(indices.len().is_multiple_of(3) && !indices.is_empty(), "{}", demo.name);
                assert!(indices.iter().all(|&index| (index as usize) < vertices), "{}", demo.name);
                assert!(reader.read_normals().unwrap().all(|n| (Vec3::from(n).length() - 1.0).abs() < 1e-4));
            }
            for image in file.images() {
                let gltf::image::Source::View { view, .. } = image.source() else { panic!("images are inside") };
                assert!(image::load_from_memory(&blob[view.offset()..view.offset() + view.length()]).is_ok());
            }
        }
        assert!(by_name("no such scene").is_none());
    }

    #[test]
    fn a_demo_is_the_same_every_time() {
        assert_eq!(still_life(), still_life());
        assert_eq!(many_emitters(4), many_emitters(4));
    }
}
