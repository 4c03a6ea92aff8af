//! Rust mirrors of the uniform structs of `shaders/lib/bindings.wesl`. A test compares every offset by reflection.

use super::records::Places;
use crate::compile::{EnvironmentKind, Lens, Lighting, NONE, View};
use crate::params::{FilterKind, MAX_STEPS};
use crate::render::{Settings, Work};
use bytemuck::{Pod, Zeroable};
use glam::Affine3A;

/// Entries of [`Frame::filter_table`].
pub const FILTER_STEPS: usize = 1024;

/// Entries of [`Frame::camera_way`]: three for each end of a piece.
const CAMERA_WAY: usize = 3 * (MAX_STEPS as usize + 1);

/// What stays the same for a whole render.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
#[allow(missing_docs, reason = "named as in the shader")]
pub struct Frame {
    pub camera: [[f32; 4]; 3],
    pub width: u32,
    pub height: u32,
    pub tan_half_yfov: f32,
    pub aperture_radius: f32,
    pub focus_distance: f32,
    pub ymag: f32,
    pub filter_radius: f32,
    pub transparent: u32,
    pub seed: u32,
    pub max_bounces: u32,
    pub light_count: u32,
    pub pick_count: u32,
    pub places: Places,
    pub environment_probability: f32,
    pub phong_specular: f32,
    pub tree_probability: f32,
    pub extended_lights: u32,
    pub blades: u32,
    pub blade_rotation: f32,
    pub environment_top: [f32; 3],
    pub environment_intensity: f32,
    pub environment_horizon: [f32; 3],
    pub environment_cos: f32,
    pub environment_bottom: [f32; 3],
    pub environment_sin: f32,
    pub ambient: [f32; 3],
    pub environment_visible: u32,
    pub motion_pieces: u32,
    pub motion_first_triangle: u32,
    pub motion_triangles: u32,
    pub motion_first_vertex: u32,
    pub motion_vertices: u32,
    pub motion_nodes: u32,
    pub motion_camera: u32,
    pub motion_lights: u32,
    pub camera_way: [[f32; 4]; CAMERA_WAY],
    pub filter_table: [f32; FILTER_STEPS],
}

/// One dispatch: a range of the tiles that a pass lists.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
#[allow(missing_docs, reason = "named as in the shader")]
pub struct Slice {
    pub first: u32,
    pub count: u32,
    pub row: u32,
    pub regions_across: u32,
}

impl Frame {
    /// The frame of a render.
    pub fn new(work: &Work) -> Self {
        let mut frame = Self::zeroed();
        frame.set_view(&work.view);
        frame.set_settings(&work.settings);
        frame.places = Places::of(&work.scene);
        frame.set_lighting(&work.lighting);
        frame.set_motion(work);
        frame
    }

    fn set_view(&mut self, view: &View) {
        self.camera = rows(&view.to_world);
        (self.width, self.height) = (view.width, view.height);
        match view.lens {
            Lens::Perspective { tan_half_yfov, aperture_radius, blades, blade_rotation, focus_distance } => {
                (self.blades, self.blade_rotation) = (blades, blade_rotation);
                self.tan_half_yfov = tan_half_yfov;
                self.aperture_radius = aperture_radius;
                self.focus_distance = focus_distance;
            }
            Lens::Orthographic { ymag } => self.ymag = ymag,
        }
        self.filter_radius = view.filter.radius();
        self.filter_table = filter_table(view.filter.kind);
        self.transparent = u32::from(view.transparent);
    }

    fn set_settings(&mut self, settings: &Settings) {
        self.seed = settings.seed;
        self.max_bounces = settings.max_bounces.unwrap_or(u32::MAX);
        self.phong_specular = settings.direct.specular;
    }

    fn set_motion(&mut self, work: &Work) {
        let motion = work.scene.motion;
        let still = |first: u32| if motion.pieces > 0 { first } else { NONE };
        self.motion_pieces = work.settings.pieces;
        self.motion_first_triangle = still(motion.first_triangle);
        self.motion_triangles = motion.triangles;
        self.motion_first_vertex = still(motion.first_vertex);
        self.motion_vertices = motion.vertices;
        self.motion_nodes = motion.nodes;
        self.motion_camera = u32::from(!work.view.way.is_empty());
        self.motion_lights = u32::from(work.lighting.moves());
        self.camera_way.iter_mut().zip(work.view.way.iter().flat_map(rows)).for_each(|(to, row)| *to = row);
    }

    fn set_lighting(&mut self, lighting: &Lighting) {
        let environment = &lighting.environment;
        self.light_count = lighting.lights.len() as u32;
        self.pick_count = lighting.table().len() as u32;
        self.tree_probability = lighting.tree_probability;
        self.extended_lights = lighting.extended;
        self.environment_probability = lighting.environment_probability;
        match &environment.kind {
            EnvironmentKind::None | EnvironmentKind::Hdri(_) => {}
            EnvironmentKind::Constant(radiance) => self.environment_horizon = radiance.to_array(),
            EnvironmentKind::Gradient { top, horizon, bottom } => {
                self.environment_top = top.to_array();
                self.environment_horizon = horizon.to_array();
                self.environment_bottom = bottom.to_array();
            }
        }
        self.environment_intensity = environment.intensity;
        (self.environment_sin, self.environment_cos) = environment.rotation.sin_cos();
        self.environment_visible = u32::from(environment.visible);
        self.ambient = environment.ambient.to_array();
    }
}

/// Rows of a 3x4 matrix.
fn rows(map: &Affine3A) -> [[f32; 4]; 3] {
    let (m, t) = (map.matrix3, map.translation);
    std::array::from_fn(|i| [m.x_axis[i], m.y_axis[i], m.z_axis[i], t[i]])
}

/// Inverse of the filter's distribution function at equal steps of probability, as offsets in -1..=1.
fn filter_table(kind: FilterKind) -> [f32; FILTER_STEPS] {
    const CELLS: usize = 16384;
    let weight = |x: f64| match kind {
        FilterKind::Box => 1.0,
        FilterKind::Triangle => 1.0 - x.abs(),
        FilterKind::Gaussian => (-4.5 * x * x).exp() - (-4.5f64).exp(),
        FilterKind::BlackmanHarris => {
            let phase = std::f64::consts::PI * (x + 1.0);
            0.35875 - 0.48829 * phase.cos() + 0.14128 * (2.0 * phase).cos() - 0.01168 * (3.0 * phase).cos()
        }
    };
    let position = |cell: f64| 2.0 * cell / CELLS as f64 - 1.0;
    let weights: Vec<f64> = (0..CELLS).map(|cell| weight(position(cell as f64 + 0.5)).max(0.0)).collect();
    let total: f64 = weights.iter().sum();
    let (mut cell, mut below) = (0, 0.0);
    std::array::from_fn(|step| {
        let target = total * step as f64 / (FILTER_STEPS - 1) as f64;
        while cell < CELLS - 1 && below + weights[cell] < target {
            below += weights[cell];
            cell += 1;
        }
        let within = if weights[cell] > 0.0 { ((target - below) / weights[cell]).clamp(0.0, 1.0) } else { 0.0 };
        position(cell as f64 + within) as f32
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compile::{
        Detail, Extended, Instance, LightNode, LightPick, Material, PunctualLight, SLOTS, Slot, TextureSlot, Triangle,
    };
    use std::mem::offset_of;

    /// Compares the offsets of the named fields, and the size, with those of the WGSL struct of the same name.
    macro_rules! assert_mirrors {
        ($module:expr, $name:ident { $($field:ident $(= $shader:literal)?),* $(,)? }) => {
            let (members, size) = reflected($module, stringify!($name));
            $(
                let shader = [$($shader,)? stringify!($field)][0];
                let offset = members.iter().find(|(name, _)| name == shader).map(|(_, offset)| *offset as usize);
                assert_eq!(offset, Some(offset_of!($name, $field)), "{}.{}", stringify!($name), shader);
            )*
            assert_eq!(size as usize, size_of::<$name>(), "size of {}", stringify!($name));
        };
    }

    fn module() -> naga::Module {
        naga::front::wgsl::parse_str(crate::render::gpu::PATHTRACE_WGSL).expect("WGSL that parses")
    }

    fn reflected(module: &naga::Module, name: &str) -> (Vec<(String, u32)>, u32) {
        let (_, ty) = module.types.iter().find(|(_, ty)| ty.name.as_deref() == Some(name)).expect(name);
        let naga::TypeInner::Struct { members, span } = &ty.inner else { panic!("{name} is no struct") };
        (members.iter().map(|m| (m.name.clone().unwrap_or_default(), m.offset)).collect(), *span)
    }

    fn constant(module: &naga::Module, name: &str) -> u32 {
        let (_, constant) = module.constants.iter().find(|(_, c)| c.name.as_deref() == Some(name)).expect(name);
        match module.global_expressions[constant.init] {
            naga::Expression::Literal(naga::Literal::U32(value)) => value,
            ref other => panic!("{name} is {other:?}"),
        }
    }

    #[test]
    fn structs_lie_as_in_the_shader() {
        let module = &module();
        assert_mirrors!(
            module,
            Frame {
                camera,
                width,
                height,
                tan_half_yfov,
                aperture_radius,
                focus_distance,
                ymag,
                filter_radius,
                transparent,
                seed,
                max_bounces,
                light_count,
                pick_count,
                places = "materials",
                environment_probability,
                phong_specular,
                tree_probability,
                extended_lights,
                blades,
                blade_rotation,
                environment_top,
                environment_intensity,
                environment_horizon,
                environment_cos,
                environment_bottom,
                environment_sin,
                ambient,
                environment_visible,
                motion_pieces,
                motion_first_triangle,
                motion_triangles,
                motion_first_vertex,
                motion_vertices,
                motion_nodes,
                motion_camera,
                motion_lights,
                camera_way,
                filter_table,
            }
        );
        macro_rules! places {
            ($($field:ident),*) => { [$((stringify!($field), offset_of!(Places, $field))),*] };
        }
        let (members, _) = reflected(module, "Frame");
        for (name, offset) in places!(
            materials,
            corners,
            vertices,
            vertex_stride,
            vertex_normal,
            vertex_tangent,
            vertex_color,
            vertex_uvs,
            extended,
            detail
        ) {
            let found = members.iter().find(|member| member.0 == name).map(|member| member.1 as usize);
            assert_eq!(found, Some(offset_of!(Frame, places) + offset), "{name}");
        }
        assert_mirrors!(module, Slice { first, count, row, regions_across });
        assert_mirrors!(module, Triangle { v0, material, v1, light, v2, primitive });
        assert_mirrors!(module, Instance { to_world, to_object, root, first_triangle, light_base, flags });
        assert_mirrors!(module, TextureSlot { row_u, info, row_v, corner, size });
        assert_mirrors!(
            module,
            Material {
                base_color,
                emissive,
                roughness,
                metallic,
                normal_scale,
                alpha_cutoff,
                flags,
                base_color_texture,
                emissive_texture,
                metallic_roughness_texture,
                normal_texture,
                detail,
            }
        );
        assert_mirrors!(module, PunctualLight { position, kind, direction, range, intensity, inner, axis, outer });
        assert_mirrors!(module, LightPick { keep, alias = "alternative", probability, area, index, triangle, trail });
    }

    #[test]
    fn constants_are_those_of_the_shader() {
        let module = &module();
        let value = |name: &str| constant(module, name);
        assert_eq!(value("NONE"), NONE);
        assert_eq!(value("ALPHA_BIT"), Triangle::ALPHA);
        assert_eq!(value("MOVING_BIT"), Instance::MOVING);
        assert_eq!(value("SPHERE_BIT"), Triangle::SPHERE);
        assert_eq!(value("DETAIL_NORMAL"), Detail::NORMAL);
        assert_eq!(value("DETAIL_OFFSET"), Detail::OFFSET);
        assert_eq!(value("DETAIL_OFFSET_LIMITED"), Detail::OFFSET_LIMITED);
        assert_eq!(value("DETAIL_STEEP"), Detail::STEEP);
        assert_eq!(value("DETAIL_WORDS") as usize, size_of::<Detail>() / 4);
        assert_eq!(value("AT_DETAIL_SCALE") as usize, offset_of!(Detail, scale) / 4);
        assert_eq!(value("AT_DETAIL_STEPS") as usize, offset_of!(Detail, steps) / 4);
        assert_eq!(value("AT_DETAIL_SELF_SHADOW") as usize, offset_of!(Detail, self_shadow) / 4);
        assert_eq!(value("AT_DETAIL_MAP") as usize, offset_of!(Detail, map) / 4);
        assert_eq!(value("DOUBLE_SIDED"), Material::DOUBLE_SIDED);
        assert_eq!(value("UNLIT_BIT"), Material::UNLIT);
        assert_eq!(value("FILLED"), Material::FILLED);
        assert_eq!(value("EXTENDED_SHIFT"), Material::EXTENDED_SHIFT);
        assert_eq!(value("SPECULAR_GLOSSINESS"), Extended::SPECULAR_GLOSSINESS);
        assert_eq!(value("DIRECTIONAL"), crate::compile::PunctualKind::Directional as u32);
        assert_eq!(value("SPOT"), crate::compile::PunctualKind::Spot as u32);
        assert_eq!(value("COSINE"), crate::compile::PunctualKind::Cosine as u32);
        assert_eq!(value("SUN"), crate::compile::PunctualKind::Sun as u32);
        assert_eq!(value("SPHERE"), crate::compile::PunctualKind::Sphere as u32);
        assert_eq!(value("DISK"), crate::compile::PunctualKind::Disk as u32);
        assert_eq!(value("VISIBLE_BIT"), PunctualLight::VISIBLE);
        assert_eq!(value("TREE_LEAF"), LightNode::LEAF);
        assert_eq!(value("TREE_TWO_SIDED"), LightNode::TWO_SIDED);
        assert_eq!(value("TREE_INDEX"), LightNode::INDEX);
    }

    /// Records of extensions are read word by word.
    #[test]
    fn words_of_extensions_are_those_of_the_shader() {
        macro_rules! assert_words {
            ($($name:literal $field:ident,)*) => {
                $(assert_eq!(constant(&module(), $name) as usize, offset_of!(Extended, $field) / 4, "{}", $name);)*
            };
        }
        assert_eq!(constant(&module(), "EXTENDED_WORDS") as usize, size_of::<Extended>() / 4);
        assert_eq!(constant(&module(), "SLOT_WORDS") as usize, size_of::<TextureSlot>() / 4);
        assert_words!(
            "AT_FLAGS" flags,
            "AT_IOR" ior,
            "AT_SPECULAR" specular,
            "AT_TRANSMISSION" transmission,
            "AT_SPECULAR_COLOR" specular_color,
            "AT_DISPERSION" dispersion,
            "AT_ABSORPTION" absorption,
            "AT_CLEARCOAT" clearcoat,
            "AT_CLEARCOAT_ROUGHNESS" clearcoat_roughness,
            "AT_CLEARCOAT_NORMAL_SCALE" clearcoat_normal_scale,
            "AT_SHEEN_ROUGHNESS" sheen_roughness,
            "AT_ANISOTROPY" anisotropy,
            "AT_SHEEN_COLOR" sheen_color,
            "AT_ANISOTROPY_ROTATION" anisotropy_rotation,
            "AT_IRIDESCENCE" iridescence,
            "AT_IRIDESCENCE_IOR" iridescence_ior,
            "AT_IRIDESCENCE_THICKNESS" iridescence_thickness,
            "AT_DIFFUSE_TRANSMISSION_COLOR" diffuse_transmission_color,
            "AT_DIFFUSE_TRANSMISSION" diffuse_transmission,
            "AT_SCATTER" scatter,
            "AT_SCATTER_ANISOTROPY" scatter_anisotropy,
            "AT_TEXTURES" textures,
        );
        let slots = [
            ("SLOT_SPECULAR", Slot::Specular),
            ("SLOT_SPECULAR_COLOR", Slot::SpecularColor),
            ("SLOT_TRANSMISSION", Slot::Transmission),
            ("SLOT_CLEARCOAT", Slot::Clearcoat),
            ("SLOT_CLEARCOAT_ROUGHNESS", Slot::ClearcoatRoughness),
            ("SLOT_CLEARCOAT_NORMAL", Slot::ClearcoatNormal),
            ("SLOT_SHEEN_COLOR", Slot::SheenColor),
            ("SLOT_SHEEN_ROUGHNESS", Slot::SheenRoughness),
            ("SLOT_ANISOTROPY", Slot::Anisotropy),
            ("SLOT_IRIDESCENCE", Slot::Iridescence),
            ("SLOT_IRIDESCENCE_THICKNESS", Slot::IridescenceThickness),
            ("SLOT_DIFFUSE_TRANSMISSION", Slot::DiffuseTransmission),
            ("SLOT_DIFFUSE_TRANSMISSION_COLOR", Slot::DiffuseTransmissionColor),
        ];
        assert_eq!(slots.len(), SLOTS);
        for (name, slot) in slots {
            assert_eq!(constant(&module(), name), slot as u32, "{name}");
        }
    }

    #[test]
    fn tables_of_layers_lie_where_the_shader_reads_them() {
        use crate::render::{albedo, layer_albedo};
        let is = |name, expected| assert_eq!(constant(&module(), name), expected, "{name}");
        is("SHEEN_FIRST_ROW", albedo::TABLE_HEIGHT);
        is("SHEEN_ROWS", layer_albedo::SHEEN_ROWS);
        is("GLASS_FIRST_ROW", albedo::TABLE_HEIGHT + layer_albedo::SHEEN_ROWS);
        is("GLASS_STEPS", layer_albedo::GLASS_STEPS);
        is("GLASS_SLICES", layer_albedo::GLASS_SLICES);
    }

    #[test]
    fn box_filter_is_uniform() {
        for (step, offset) in filter_table(FilterKind::Box).iter().enumerate() {
            let expected = 2.0 * step as f32 / (FILTER_STEPS - 1) as f32 - 1.0;
            assert!((offset - expected).abs() < 1e-6, "step {step}: {offset} for {expected}");
        }
    }

    #[test]
    fn triangle_filter_follows_its_closed_form() {
        // Distribution function (1 + x)^2 / 2 below the middle.
        let table = filter_table(FilterKind::Triangle);
        for (step, offset) in table.iter().enumerate().take(FILTER_STEPS / 2) {
            let u = step as f32 / (FILTER_STEPS - 1) as f32;
            assert!((offset - ((2.0 * u).sqrt() - 1.0)).abs() < 1e-3, "step {step}: {offset}");
        }
    }
}
