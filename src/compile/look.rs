//! What surfaces are made of in one request: the file's materials, what the request says of some of them, and its spheres.

use super::Detail;
use crate::params::{
    Axis, FieldError, Maps, OverrideParams, ParallaxMethod, ParallaxParams, RenderParams, SphereParams, TextureParams,
};
use crate::scene::{Extended, Image, Material, Primitive, Scene, Texture, TextureRef, Wrap};
use glam::{DVec3, Mat3, Vec2};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Encoded pictures by the names that parameters have for them.
pub type MapFiles = BTreeMap<String, Arc<[u8]>>;

/// Materials and where their texels come from.
#[derive(Debug, Default)]
pub struct Look {
    /// The file's, then those of the spheres.
    pub materials: Vec<Material>,
    /// The file's, then those of the request.
    pub textures: Vec<Texture>,
    /// The file's, then those of the request.
    pub images: Vec<Image>,
    /// Details by material.
    pub reliefs: BTreeMap<usize, Relief>,
    /// Spheres of the request.
    pub spheres: Vec<Sphere>,
}

/// Relief of a surface that is finer than its geometry.
#[derive(Debug, Clone, Copy)]
pub struct Relief {
    /// [`Detail::HEIGHT`] and so on.
    pub kind: u32,
    /// Factor on normals, or the height of white above black in scene units.
    pub scale: f32,
    /// Steps of a search.
    pub steps: u32,
    /// It keeps light off itself.
    pub self_shadow: bool,
    /// Where it is read.
    pub map: TextureRef,
}

/// A sphere by its equation.
#[derive(Debug, Clone, Copy)]
pub struct Sphere {
    /// World space.
    pub center: DVec3,
    /// Scene units.
    pub radius: f64,
    /// Axis of the poles.
    pub axis: Axis,
    /// Index into [`Look::materials`].
    pub material: usize,
}

impl Look {
    /// The file's materials as a request wants them. `files` has every picture that the request names.
    ///
    /// # Errors
    /// The request names a material that the file does not have, or puts a map where no texture coordinates are.
    pub fn new(scene: &Scene, params: &RenderParams, files: &MapFiles) -> Result<Self, FieldError> {
        let mut look = Self {
            materials: scene.materials.clone(),
            textures: scene.textures.clone(),
            images: scene.images.clone(),
            ..Self::default()
        };
        for (index, changes) in params.overrides.iter().enumerate() {
            look.override_materials(scene, changes, files, &format!("/params/overrides/{index}"))?;
        }
        for (index, sphere) in params.spheres.iter().enumerate() {
            look.add_sphere(sphere, files, &format!("/params/spheres/{index}"))?;
        }
        Ok(look)
    }

    fn override_materials(
        &mut self,
        scene: &Scene,
        changes: &OverrideParams,
        files: &MapFiles,
        place: &str,
    ) -> Result<(), FieldError> {
        let named = |material: &Material| material.name.as_ref() == Some(&changes.material);
        let meant: Vec<usize> = (0..scene.materials.len()).filter(|index| named(&scene.materials[*index])).collect();
        if meant.is_empty() {
            return Err(unknown(scene, &changes.material, place));
        }
        for index in meant {
            let material = &mut self.materials[index];
            if let Some([r, g, b]) = changes.color {
                material.base_color = glam::Vec4::new(r, g, b, material.base_color.w);
            }
            material.metallic = changes.metallic.unwrap_or(material.metallic);
            material.roughness = changes.roughness.unwrap_or(material.roughness);
            material.emissive = changes.emissive.map_or(material.emissive, glam::Vec3::from_array);
            let (first_uv, emissive_texture) = (material.first_uv, material.emissive_texture.is_some());
            let maps = changes.maps();
            let some = [maps.texture.is_some(), maps.height.is_some(), maps.normal.is_some(), maps.parallax.is_some()];
            if some.contains(&true) && !has_uv(scene, index, first_uv) {
                let detail = format!(
                    "no mesh with the material `{}` has texture coordinates (TEXCOORD_0) that a map could be laid out by",
                    changes.material
                );
                return Err(FieldError::new(place, detail));
            }
            if maps.parallax.is_some() && emissive_texture {
                let detail = "a material with an emissive texture cannot have a parallax map: light would be looked for where \
                              it is not seen; use `height`";
                return Err(FieldError::new(format!("{place}/parallax"), detail));
            }
            self.lay(index, &maps, first_uv, Wrap::Repeat, files, place)?;
        }
        Ok(())
    }

    fn add_sphere(&mut self, sphere: &SphereParams, files: &MapFiles, place: &str) -> Result<(), FieldError> {
        let [r, g, b] = sphere.color;
        let of_reflectance = |reflectance: f32| {
            let root = reflectance.sqrt();
            Arc::new(Extended { ior: (1.0 + root) / (1.0 - root), ..Extended::default() })
        };
        let material = self.materials.len();
        self.materials.push(Material {
            base_color: glam::Vec4::new(r, g, b, 1.0),
            metallic: sphere.metallic,
            roughness: sphere.roughness(),
            extended: sphere.reflectivity.map(of_reflectance),
            ..Material::default()
        });
        let (center, radius, axis) = (DVec3::from(sphere.center), sphere.radius, sphere.axis);
        self.spheres.push(Sphere { center, radius, axis, material });
        // A texture ends at the poles.
        self.lay(material, &sphere.maps(), 0, Wrap::Clamp, files, place)
    }

    /// Lays the maps of a request on a material.
    fn lay(
        &mut self,
        material: usize,
        maps: &Maps<'_>,
        uv_set: usize,
        wrap_v: Wrap,
        files: &MapFiles,
        place: &str,
    ) -> Result<(), FieldError> {
        let mut map = |name: &str, image: &str, tiling: [f32; 2]| {
            let wrap_v = if tiling[1] == 1.0 { wrap_v } else { Wrap::Repeat };
            let texture = self.add_texture(image, wrap_v, files, &format!("{place}/{name}/image"))?;
            Ok(TextureRef { texture, uv_set, transform: Mat3::from_scale(Vec2::from_array(tiling)) })
        };
        let texture = maps.texture.map(|TextureParams { image, tiling }| map("texture", image, *tiling)).transpose()?;
        let relief = if let Some(height) = maps.height {
            let map = map("height", &height.image, height.tiling)?;
            Some(Relief { kind: Detail::HEIGHT, scale: height.scale, steps: 0, self_shadow: false, map })
        } else if let Some(normal) = maps.normal {
            let map = map("normal", &normal.image, normal.tiling)?;
            Some(Relief { kind: Detail::NORMAL, scale: normal.scale, steps: 0, self_shadow: false, map })
        } else if let Some(parallax) = maps.parallax {
            let kind = match parallax.method {
                ParallaxMethod::Offset => Detail::OFFSET,
                ParallaxMethod::OffsetLimited => Detail::OFFSET_LIMITED,
                ParallaxMethod::Steep => Detail::STEEP,
                ParallaxMethod::Relief => Detail::RELIEF,
            };
            let map = map("parallax", &parallax.image, parallax.tiling)?;
            let ParallaxParams { scale, steps, self_shadow, .. } = *parallax;
            Some(Relief { kind, scale, steps, self_shadow, map })
        } else {
            None
        };
        if texture.is_some() {
            self.materials[material].base_color_texture = texture;
        }
        self.reliefs.extend(relief.map(|relief| (material, relief)));
        Ok(())
    }

    fn add_texture(&mut self, name: &str, wrap_v: Wrap, files: &MapFiles, place: &str) -> Result<usize, FieldError> {
        let Some(bytes) = files.get(name) else {
            return Err(FieldError::new(place, format!("there is no image `{name}`")));
        };
        let known = self.images.iter().position(|image| Arc::ptr_eq(&image.bytes, bytes));
        let image = known.unwrap_or_else(|| {
            self.images.push(Image { bytes: Arc::clone(bytes), pointer: place.to_owned() });
            self.images.len() - 1
        });
        self.textures.push(Texture { image, wrap_v, ..Texture::default() });
        Ok(self.textures.len() - 1)
    }
}

/// Whether some primitive with the material has that set of texture coordinates.
fn has_uv(scene: &Scene, material: usize, uv_set: usize) -> bool {
    let has = |primitive: &Primitive| primitive.material == Some(material) && primitive.uvs.len() > uv_set;
    let mut primitives = scene.meshes.iter().flat_map(|mesh| &mesh.primitives);
    primitives.any(|primitive| has(primitive) || primitive.alternatives.iter().any(|(_, other)| has(other)))
}

fn unknown(scene: &Scene, name: &str, place: &str) -> FieldError {
    let names: Vec<&str> = scene.materials.iter().filter_map(|material| material.name.as_deref()).take(20).collect();
    let known = if names.is_empty() {
        "its materials have no names".to_owned()
    } else {
        format!("it has {}", names.join(", "))
    };
    FieldError::new(format!("{place}/material"), format!("the file has no material `{name}`; {known}"))
}
