//! Rust mirrors of the structs of `shaders/preview/bindings.wesl`. A test compares every offset by reflection.

use crate::compile::PunctualLight;
use bytemuck::{Pod, Zeroable};

/// From world to a picture: the camera's or a shadow map's.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Projection {
    /// World to view: x to the right, y up, z ahead.
    pub rows: [[f32; 4]; 3],
    /// View to clip, after the division by z if there is one.
    pub scale: [f32; 2],
    /// Added to clip x and y.
    pub offset: [f32; 2],
    /// Perspective: depth is `near / z`. Parallel: 0.
    pub near: f32,
    /// Parallel: depth is `1 - z / far`.
    pub far: f32,
    /// Unused.
    pub pad: [f32; 2],
}

/// What stays the same for a frame.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
#[allow(missing_docs, reason = "named as in the shader")]
pub struct Preview {
    pub camera: Projection,
    pub tiles_across: u32,
    pub tiles_down: u32,
    pub tile_side: u32,
    pub summary_words: u32,
    pub mask_words: u32,
    pub light_count: u32,
    pub unbounded_count: u32,
    pub sample: u32,
    pub shininess: f32,
    pub specular: f32,
    pub constant: f32,
    pub linear: f32,
    pub quadratic: f32,
    pub gizmo_size: f32,
    pub taps: u32,
    pub kernel_radius: f32,
    pub bias_constant: f32,
    pub bias_slope: f32,
    pub bias_normal: f32,
    pub light_radius: f32,
    pub sine_hash: u32,
    pub open_tiles: u32,
    pub has_overlay: u32,
    pub map_size: u32,
    pub first_row: u32,
    pub end_row: u32,
    pub pad: [u32; 2],
    pub harmonics: [[f32; 4]; 9],
}

/// A light, where it ends, and its shadow maps.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
#[allow(missing_docs, reason = "named as in the shader")]
pub struct PreviewLight {
    pub source: PunctualLight,
    pub radius: f32,
    pub first_face: u32,
    pub face_count: u32,
    pub profile: u32,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::preview::faces::MAX_FACES;
    use crate::render::preview::pipelines::FINISH_WGSL;
    use std::mem::offset_of;

    /// Compares the offsets of the named fields, and the size, with those of the WGSL struct of the same name.
    macro_rules! assert_mirrors {
        ($module:expr, $name:ident { $($field:ident),* $(,)? }) => {
            let (_, ty) = $module.types.iter().find(|(_, ty)| ty.name.as_deref() == Some(stringify!($name))).expect("a struct");
            let naga::TypeInner::Struct { members, span } = &ty.inner else { panic!("no struct") };
            $(
                let member = members.iter().find(|m| m.name.as_deref() == Some(stringify!($field)));
                assert_eq!(member.map(|m| m.offset as usize), Some(offset_of!($name, $field)), "{}", stringify!($field));
            )*
            assert_eq!(*span as usize, size_of::<$name>(), "size of {}", stringify!($name));
        };
    }

    #[test]
    fn structs_lie_as_in_the_shader() {
        let module = naga::front::wgsl::parse_str(FINISH_WGSL).expect("WGSL that parses");
        assert_mirrors!(module, Projection { rows, scale, offset, near, far });
        assert_mirrors!(
            module,
            Preview {
                camera,
                tiles_across,
                tiles_down,
                tile_side,
                summary_words,
                mask_words,
                light_count,
                unbounded_count,
                sample,
                shininess,
                specular,
                constant,
                linear,
                quadratic,
                gizmo_size,
                taps,
                kernel_radius,
                bias_constant,
                bias_slope,
                bias_normal,
                light_radius,
                sine_hash,
                open_tiles,
                has_overlay,
                map_size,
                first_row,
                end_row,
                harmonics,
            }
        );
        assert_mirrors!(module, PreviewLight { source, radius, first_face, face_count, profile });
        assert!(FINISH_WGSL.contains(&format!("array<Projection, {MAX_FACES}>")));
    }
}
