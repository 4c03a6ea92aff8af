//! From a hit to a point that can be shaded.

use super::bend;
use super::bvh::sphere::normal as sphere_normal;
use super::bvh::{Hit, TriangleId};
use super::material::Layers;
use super::motion::Moment;
use super::place::{Place, ROUNDINGS, clear, gamma, linear_part, normal_to_world};
use super::relief::{Chart, Relief};
use super::sphere;
use super::texture::{self, Encoding};
use crate::compile::{CompiledScene, Detail, Extended, Instance, Material, NONE, Slot, TextureSlot, Triangle};
use glam::{DMat3, DVec2, DVec3, DVec4};

/// A shadable point, relative to the scene's origin.
#[derive(Debug)]
pub struct Surface<'a> {
    scene: &'a CompiledScene,
    /// What it is made of.
    pub material: &'a Material,
    /// Where it is.
    pub position: DVec3,
    /// Of the triangle, on the side that the ray came from.
    pub geometric_normal: DVec3,
    /// For the material, on the same side.
    pub shading_normal: DVec3,
    /// The ray met the back of the triangle.
    pub back: bool,
    /// The triangle.
    pub primitive: TriangleId,
    /// Index into the emitters, if it is one.
    pub emitter: Option<usize>,
    /// Distance along the geometric normal that clears the errors of `position`.
    clearance: f64,
    /// When it is there.
    moment: Moment,
    /// Of the triangle's corners.
    weights: DVec3,
    uvs: [DVec2; 2],
    vertex_color: DVec4,
}

impl<'a> Surface<'a> {
    /// Where a ray of this direction hit at a moment.
    pub fn new(scene: &'a CompiledScene, hit: &Hit, direction: DVec3, moment: Moment) -> Self {
        let triangle = &scene.triangles[hit.triangle as usize];
        if triangle.is_sphere() {
            return Self::of_sphere(scene, triangle, hit, direction, moment);
        }
        let instance = &scene.instances[hit.instance as usize];
        let weights = DVec3::new(1.0 - hit.u - hit.v, hit.u, hit.v);
        let vertices = scene.indices[hit.triangle as usize];
        let place = Place::new(scene, TriangleId::from(hit), weights, moment);
        let back = place.normal.dot(direction) > 0.0;
        let front = if back { -place.normal } else { place.normal };
        let material = material(scene, triangle);
        let mut surface = Self {
            scene,
            material,
            position: place.position,
            geometric_normal: front,
            shading_normal: front,
            back,
            primitive: TriangleId::from(hit),
            emitter: (triangle.light != NONE).then(|| (triangle.light + instance.light_base) as usize),
            clearance: place.clearance,
            moment,
            weights,
            uvs: uvs(scene, vertices, weights),
            vertex_color: vertex_color(scene, vertices, weights),
        };
        let normal = surface.smooth_normal(instance, vertices, weights, place.normal, direction);
        surface.shading_normal = surface.bent(if back { -normal } else { normal }, direction);
        surface
    }

    /// On a sphere, which stands in the world.
    #[inline(never)]
    fn of_sphere(scene: &'a CompiledScene, record: &Triangle, hit: &Hit, direction: DVec3, moment: Moment) -> Self {
        let normal = sphere_normal([hit.u, hit.v]);
        let (center, radius) = (DVec3::from(record.v0.map(f64::from)), f64::from(record.v1[0]));
        let back = normal.dot(direction) > 0.0;
        let front = if back { -normal } else { normal };
        let (uv, chart) = sphere::layout(record, normal);
        let mut surface = Self {
            scene,
            material: material(scene, record),
            position: center + radius * normal,
            geometric_normal: front,
            shading_normal: front,
            back,
            primitive: TriangleId::from(hit),
            emitter: None,
            clearance: gamma(ROUNDINGS) * (center.abs().max_element() + radius),
            moment,
            weights: DVec3::X,
            uvs: [uv, DVec2::ZERO],
            vertex_color: DVec4::ONE,
        };
        let bent = surface.detailed_normal(|_| chart, normal, direction).unwrap_or(normal);
        surface.shading_normal = surface.bent(if back { -bent } else { bent }, direction);
        surface
    }

    /// Normal of the front under the material's relief, if it has one; `normal` is that without it. What is seen of the relief
    /// may lie elsewhere: the texture coordinates are moved there.
    fn detailed_normal(
        &mut self,
        chart: impl FnOnce(usize) -> Chart,
        normal: DVec3,
        direction: DVec3,
    ) -> Option<DVec3> {
        let detail = self.material.detail.checked_sub(1).and_then(|index| self.scene.details.get(index as usize))?;
        let uv_set = Relief::uv_set(detail);
        let relief = Relief { detail, pages: &self.scene.data_pages, chart: chart(uv_set), normal };
        if relief.has_parallax() && !self.back {
            self.uvs[uv_set] += relief.parallax(self.uvs, direction);
        }
        // A relief that is seen through keeps the material's own normal map; the others replace it.
        let keeps_own = relief.has_parallax() && self.material.normal_texture.info != NONE;
        (!keeps_own).then(|| relief.bent_normal(self.uvs))
    }

    /// Whether the material's relief keeps light from a direction, of unit length, off the point of it that is seen.
    pub fn relief_shadows(&self, direction: DVec3) -> bool {
        let Some(index) = self.material.detail.checked_sub(1).filter(|_| !self.back) else { return false };
        self.scene.details.get(index as usize).is_some_and(|detail| self.is_blocked_by(detail, direction))
    }

    #[inline(never)]
    fn is_blocked_by(&self, detail: &Detail, direction: DVec3) -> bool {
        if detail.self_shadow == 0 {
            return false;
        }
        let (scene, record) = (self.scene, &self.scene.triangles[self.primitive.triangle as usize]);
        let chart = if record.is_sphere() {
            sphere::layout(record, self.geometric_normal).1
        } else {
            let (instance, vertices) = self.stored();
            let corners = self.moment.corners(scene, self.primitive.triangle);
            triangle_chart(scene, corners, instance, vertices, Relief::uv_set(detail))
        };
        let relief = Relief { detail, pages: &scene.data_pages, chart, normal: self.geometric_normal };
        relief.blocks(self.uvs, direction)
    }

    /// Where it is.
    pub fn place(&self) -> Place {
        Place { position: self.position, normal: self.geometric_normal, moment: self.moment, clearance: self.clearance }
    }

    /// Value of one of the material's textures; white if there is none.
    pub fn texel(&self, encoding: Encoding, slot: &TextureSlot) -> DVec4 {
        let pages = match encoding {
            Encoding::Srgb => &self.scene.color_pages,
            Encoding::Linear => &self.scene.data_pages,
        };
        texture::sample(pages, encoding, slot, self.uvs)
    }

    /// Normal of the material's coat, on the side that the ray of this direction came from: the mesh's, with the coat's own map.
    pub fn coat_normal(&self, extended: &Extended, direction: DVec3) -> DVec3 {
        let flat = if self.back { -self.geometric_normal } else { self.geometric_normal };
        let (instance, vertices) = self.stored();
        let mut normal = self.interpolated_normal(instance, vertices, self.weights, flat);
        let slot = extended.texture(Slot::ClearcoatNormal);
        if slot.info != NONE {
            let scale = f64::from(extended.clearcoat_normal_scale);
            normal = self.mapped(normal, instance, self.stored_tangent(vertices, self.weights), slot, scale);
        }
        bend::mirroring(if self.back { -normal } else { normal }, self.geometric_normal, direction)
    }

    /// A normal that can be shaded with. That of a metal is bent as a mirror's, that of a diffuse layer, which most light of
    /// other materials comes from, only until it is seen.
    fn bent(&self, normal: DVec3, direction: DVec3) -> DVec3 {
        let mirroring = bend::mirroring(normal, self.geometric_normal, direction);
        if mirroring == normal {
            return normal;
        }
        let visible = bend::visible(normal, self.geometric_normal, direction);
        visible.lerp(mirroring, self.layers().metallic).normalize()
    }

    /// Unit vectors along the tangent and the bitangent of the shading normal; none: the mesh has no tangents here.
    pub fn tangents(&self) -> Option<[DVec3; 2]> {
        let (instance, vertices) = self.stored();
        let normal = if self.back { -self.shading_normal } else { self.shading_normal };
        tangents(instance, normal, self.stored_tangent(vertices, self.weights))
    }

    fn stored(&self) -> (&'a Instance, [u32; 3]) {
        let TriangleId { triangle, instance } = self.primitive;
        (&self.scene.instances[instance as usize], self.scene.indices[triangle as usize])
    }

    /// Zero if the mesh has none.
    fn stored_tangent(&self, vertices: [u32; 3], weights: DVec3) -> DVec4 {
        let offset = self.scene.layout.tangent;
        if offset == NONE { DVec4::ZERO } else { DVec4::from(self.moved::<4>(vertices, weights, offset)) }
    }

    /// An attribute that changes as its vertices move.
    fn moved<const N: usize>(&self, vertices: [u32; 3], weights: DVec3, offset: u32) -> [f64; N] {
        let corners = vertices.map(|vertex| self.moment.attribute::<N>(self.scene, vertex, offset));
        std::array::from_fn(|i| (0..3).map(|corner| weights[corner] * corners[corner][i]).sum())
    }

    /// Product of factor, texture and vertex colour: linear RGB and alpha.
    pub fn base_color(&self) -> DVec4 {
        base_color(self.scene, self.material, self.uvs, self.vertex_color)
    }

    /// Colour, metalness, roughness.
    pub fn layers(&self) -> Layers {
        let texel = texture::sample(
            &self.scene.data_pages,
            Encoding::Linear,
            &self.material.metallic_roughness_texture,
            self.uvs,
        );
        Layers {
            color: self.base_color().truncate(),
            metallic: f64::from(self.material.metallic) * texel.z,
            roughness: f64::from(self.material.roughness) * texel.y,
        }
    }

    /// Radiance that it sends to the side that the ray came from, against a direction.
    pub fn emitted(&self, direction: DVec3) -> DVec3 {
        if self.back && self.material.flags & Material::DOUBLE_SIDED == 0 {
            return DVec3::ZERO;
        }
        emission(self.scene, self.material, self.uvs, direction.dot(self.geometric_normal))
    }

    /// Origin of a ray that leaves in a direction, clear of the surface.
    pub fn leave(&self, direction: DVec3) -> DVec3 {
        clear(self.position, self.geometric_normal, self.clearance, direction)
    }

    /// Interpolated and mapped normal of the front, unit length.
    fn smooth_normal(
        &mut self,
        instance: &Instance,
        vertices: [u32; 3],
        weights: DVec3,
        flat: DVec3,
        direction: DVec3,
    ) -> DVec3 {
        let normal = self.interpolated_normal(instance, vertices, weights, flat);
        if self.material.detail != 0 {
            let (scene, corners) = (self.scene, self.moment.corners(self.scene, self.primitive.triangle));
            let chart = |uv_set| triangle_chart(scene, corners, instance, vertices, uv_set);
            if let Some(bent) = self.detailed_normal(chart, normal, direction) {
                return bent;
            }
        }
        let slot = &self.material.normal_texture;
        if slot.info == NONE {
            return normal;
        }
        let tangent = self.stored_tangent(vertices, weights);
        self.mapped(normal, instance, tangent, slot, f64::from(self.material.normal_scale))
    }

    fn interpolated_normal(&self, instance: &Instance, vertices: [u32; 3], weights: DVec3, flat: DVec3) -> DVec3 {
        let layout = self.scene.layout;
        if layout.normal == NONE {
            return flat;
        }
        let stored = self.moved::<3>(vertices, weights, layout.normal);
        // A mesh without normals stores zeros: it is flat.
        normal_to_world(self.scene, instance, DVec3::from(stored)).try_normalize().unwrap_or(flat)
    }

    /// Normal map (glTF 2.0, 3.9.3).
    fn mapped(&self, normal: DVec3, instance: &Instance, tangent: DVec4, slot: &TextureSlot, scale: f64) -> DVec3 {
        let Some([along, across]) = tangents(instance, normal, tangent) else { return normal };
        let texel = self.texel(Encoding::Linear, slot).truncate() * 2.0 - 1.0;
        let mapped = texel.x * scale * along + texel.y * scale * across + texel.z * normal;
        mapped.try_normalize().unwrap_or(normal)
    }
}

/// How a set of texture coordinates lies on a triangle.
fn triangle_chart(
    scene: &CompiledScene,
    [a, b, c]: [DVec3; 3],
    instance: &Instance,
    vertices: [u32; 3],
    uv_set: usize,
) -> Chart {
    let map = if scene.two_level { linear_part(&instance.to_world) } else { DMat3::IDENTITY };
    let [uv, second, third] = [DVec3::X, DVec3::Y, DVec3::Z].map(|corner| uvs(scene, vertices, corner)[uv_set]);
    Chart::of_triangle([map * (b - a), map * (c - a)], [second - uv, third - uv])
}

/// Tangent and bitangent in the world, at right angles to a normal of the front.
fn tangents(instance: &Instance, normal: DVec3, tangent: DVec4) -> Option<[DVec3; 2]> {
    let mirrored = instance.flags & 1 != 0;
    let handedness = if (tangent.w < 0.0) != mirrored { -1.0 } else { 1.0 };
    let along = linear_part(&instance.to_world) * tangent.truncate();
    let along = along.reject_from_normalized(normal).try_normalize()?;
    Some([along, handedness * normal.cross(along)])
}

/// Whether a triangle lets a ray pass for certain (`false`), for certain not (`true`), or with some probability: its coverage
/// there, 0 to 1 (glTF 2.0, 3.9.4).
pub fn coverage(scene: &CompiledScene, hit: &Hit) -> f64 {
    let triangle = &scene.triangles[hit.triangle as usize];
    let vertices = scene.indices[hit.triangle as usize];
    let weights = DVec3::new(1.0 - hit.u - hit.v, hit.u, hit.v);
    let material = material(scene, triangle);
    let color = base_color(scene, material, uvs(scene, vertices, weights), vertex_color(scene, vertices, weights));
    let cutoff = f64::from(material.alpha_cutoff);
    if cutoff < 0.0 { color.w } else { f64::from(u8::from(color.w >= cutoff)) }
}

/// Radiance of the front of an emitting triangle at a cosine from its normal.
pub fn emitted_at(scene: &CompiledScene, triangle: u32, weights: DVec3, cosine: f64) -> DVec3 {
    let vertices = scene.indices[triangle as usize];
    emission(scene, material(scene, &scene.triangles[triangle as usize]), uvs(scene, vertices, weights), cosine)
}

/// The material of a triangle.
pub fn material<'a>(scene: &'a CompiledScene, triangle: &Triangle) -> &'a Material {
    &scene.materials[triangle.material()]
}

fn emission(scene: &CompiledScene, material: &Material, uvs: [DVec2; 2], cosine: f64) -> DVec3 {
    let texel = texture::sample(&scene.color_pages, Encoding::Srgb, &material.emissive_texture, uvs);
    let radiance = DVec3::from(material.emissive.map(f64::from)) * texel.truncate();
    let Some(extended) = material.extended(scene).filter(|extended| extended.clearcoat > 0.0) else { return radiance };
    // What the coat lets through (KHR_materials_clearcoat).
    let texel = texture::sample(&scene.data_pages, Encoding::Linear, extended.texture(Slot::Clearcoat), uvs);
    let reflected = 0.04 + 0.96 * (1.0 - cosine.abs().min(1.0)).powi(5);
    radiance * (1.0 - f64::from(extended.clearcoat) * texel.x * reflected)
}

fn base_color(scene: &CompiledScene, material: &Material, uvs: [DVec2; 2], vertex_color: DVec4) -> DVec4 {
    let slot: &TextureSlot = &material.base_color_texture;
    let factor = DVec4::from(material.base_color.map(f64::from));
    factor * vertex_color * texture::sample(&scene.color_pages, Encoding::Srgb, slot, uvs)
}

fn interpolated<const N: usize>(scene: &CompiledScene, vertices: [u32; 3], weights: DVec3, offset: u32) -> [f64; N] {
    let first = vertices.map(|vertex| (vertex * scene.layout.stride + offset) as usize);
    std::array::from_fn(|i| {
        (0..3).map(|corner| weights[corner] * f64::from(f32::from_bits(scene.vertices[first[corner] + i]))).sum()
    })
}

fn uvs(scene: &CompiledScene, vertices: [u32; 3], weights: DVec3) -> [DVec2; 2] {
    scene.layout.uv.map(|offset| {
        if offset == NONE { DVec2::ZERO } else { DVec2::from(interpolated::<2>(scene, vertices, weights, offset)) }
    })
}

fn vertex_color(scene: &CompiledScene, vertices: [u32; 3], weights: DVec3) -> DVec4 {
    let offset = scene.layout.color;
    if offset == NONE { DVec4::ONE } else { DVec4::from(interpolated::<4>(scene, vertices, weights, offset)) }
}
