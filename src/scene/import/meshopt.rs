//! EXT_meshopt_compression and KHR_meshopt_compression: buffer views packed by meshoptimizer's codecs.

use super::budget::Budget;
use super::document;
use super::schema::{BufferView, Extensions, Meshopt, MeshoptFallback};
use crate::scene::SceneError;
use meshoptimizer_rs::codec;
use meshoptimizer_rs::{Error, Limits, Workspace};

/// Both names; the newer one has one more filter and one more version of the codec for vertices.
const NAMES: [&str; 2] = ["KHR_meshopt_compression", "EXT_meshopt_compression"];

/// How a buffer view is packed, with the place of that; none: it is not.
pub(super) fn of_view(view: &BufferView, place: &str) -> Result<Option<(Meshopt, String)>, SceneError> {
    find(&view.extensions, place)
}

/// Whether a buffer stands in for readers that cannot unpack: nothing of it is read.
pub(super) fn is_fallback(extensions: &Extensions, place: &str) -> Result<bool, SceneError> {
    let found: Option<(MeshoptFallback, String)> = find(extensions, place)?;
    Ok(found.is_some_and(|(extension, _)| extension.fallback))
}

fn find<T: serde::de::DeserializeOwned>(
    extensions: &Extensions,
    place: &str,
) -> Result<Option<(T, String)>, SceneError> {
    let Some((name, content)) = NAMES.iter().find_map(|name| Some((name, extensions.get(*name)?))) else {
        return Ok(None);
    };
    let place = format!("{place}/extensions/{name}");
    Ok(Some((document::extension(content, &place)?, place)))
}

/// Unpacks a buffer view; `length` is what it declares to have.
pub(super) fn decode(
    packed: &Meshopt,
    source: &[u8],
    length: u64,
    place: &str,
    budget: &mut Budget,
) -> Result<Vec<u8>, SceneError> {
    let bytes = packed.count.checked_mul(packed.byte_stride);
    if bytes != Some(length) {
        let detail = format!(
            "{} elements of {} bytes are not the {length} bytes of the buffer view",
            packed.count, packed.byte_stride
        );
        return Err(SceneError::invalid("meshopt", place, detail));
    }
    let (count, stride) = match (usize::try_from(packed.count), usize::try_from(packed.byte_stride)) {
        (Ok(count), Ok(stride)) => (count, stride),
        _ => return Err(SceneError::invalid("meshopt", place, "the buffer view is larger than memory")),
    };
    budget.charge(length, count, place)?;
    let mut workspace = Workspace::new(Limits::default());
    let unpacked = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
        let mut bytes = unpack(packed, count, stride, source, &mut workspace)?;
        filter(packed, &mut bytes, count, stride, &mut workspace)?;
        Ok(bytes)
    }));
    let unpacked = unpacked.unwrap_or(Err(Fault::Stream("the decoder gave up".to_owned())));
    unpacked.map_err(|fault| match fault {
        Fault::Name(what, name) => {
            SceneError::invalid("meshopt", format!("{place}/{what}"), format!("`{name}` is not a {what}"))
        }
        Fault::Stream(why) => SceneError::invalid(
            "meshopt",
            place,
            format!("the packed bytes cannot be read: {why}; export the file again"),
        ),
    })
}

enum Fault {
    /// A name that is not known.
    Name(&'static str, String),
    /// What the decoder says.
    Stream(String),
}

impl From<Error> for Fault {
    fn from(error: Error) -> Self {
        Self::Stream(error.to_string())
    }
}

fn unpack(
    packed: &Meshopt,
    count: usize,
    stride: usize,
    source: &[u8],
    workspace: &mut Workspace,
) -> Result<Vec<u8>, Fault> {
    Ok(match packed.mode.as_str() {
        "ATTRIBUTES" => codec::decode_vertex_buffer(count, stride, source, workspace)?,
        "TRIANGLES" => codec::decode_index_buffer(count, stride, source, workspace)?,
        "INDICES" => codec::decode_index_sequence(count, stride, source, workspace)?,
        other => return Err(Fault::Name("mode", other.to_owned())),
    })
}

fn filter(
    packed: &Meshopt,
    bytes: &mut [u8],
    count: usize,
    stride: usize,
    workspace: &mut Workspace,
) -> Result<(), Fault> {
    match packed.filter.as_deref() {
        None | Some("NONE") => {}
        Some(_) if packed.mode != "ATTRIBUTES" => return Err(Fault::Stream("only attributes have filters".to_owned())),
        Some("OCTAHEDRAL") => codec::decode_filter_oct(bytes, count, stride, workspace)?,
        Some("QUATERNION") => codec::decode_filter_quat(bytes, count, stride, workspace)?,
        Some("EXPONENTIAL") => codec::decode_filter_exp(bytes, count, stride, workspace)?,
        Some("COLOR") => codec::decode_filter_color(bytes, count, stride, workspace)?,
        Some(other) => return Err(Fault::Name("filter", other.to_owned())),
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use crate::scene::import::testing::{Builder, error_of, scene_of};
    use meshoptimizer_rs::Workspace;
    use meshoptimizer_rs::codec::{IndexEncoding, VertexEncoding, encode_index_buffer, encode_vertex_buffer};
    use serde_json::{Value, json};

    const POSITIONS: [f32; 12] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.5];

    /// A square whose positions and indices are packed, over a buffer that only stands in for them.
    fn packed(name: &str) -> Builder {
        let mut workspace = Workspace::default();
        let bytes: Vec<u8> = POSITIONS.iter().flat_map(|x| x.to_le_bytes()).collect();
        let version = VertexEncoding::new(u8::from(name.starts_with("KHR")), 2).unwrap();
        let vertices = encode_vertex_buffer(&bytes, 4, 12, version, &mut workspace).unwrap();
        let indices = encode_index_buffer(&[0, 1, 2, 2, 1, 3], IndexEncoding::DEFAULT, &mut workspace).unwrap();
        let mut builder = Builder::default();
        for (stream, count, stride, mode) in [(vertices, 4, 12, "ATTRIBUTES"), (indices, 6, 2, "TRIANGLES")] {
            let view = builder.view(&stream);
            let mut of_stream = builder.json["bufferViews"][view].take();
            of_stream["byteStride"] = json!(stride);
            of_stream["count"] = json!(count);
            of_stream["mode"] = json!(mode);
            builder.json["bufferViews"][view] =
                json!({"buffer": 1, "byteLength": count * stride, "extensions": {name: of_stream}});
        }
        builder.extra_buffers = vec![json!({"byteLength": 60, "extensions": {name: {"fallback": true}}})];
        builder.json["accessors"] = json!([
            {"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 4},
            {"bufferView": 1, "componentType": 5123, "type": "SCALAR", "count": 6},
        ]);
        builder.json["extensionsRequired"] = json!([name]);
        builder.show(&json!([{"attributes": {"POSITION": 0}, "indices": 1}]));
        builder
    }

    #[test]
    fn packed_views_are_read() {
        for name in super::NAMES {
            let scene = scene_of(&packed(name));
            let primitive = &scene.meshes[0].primitives[0];
            let positions: Vec<f32> = primitive.positions.iter().flat_map(|p| p.to_array()).collect();
            assert_eq!((positions.as_slice(), primitive.triangles.len()), (&POSITIONS[..], 2));
            assert!(scene.warnings.is_empty());
        }
    }

    #[test]
    fn faults_are_named() {
        let fault = |field: &str, value: Value| {
            let mut builder = packed("EXT_meshopt_compression");
            builder.json["bufferViews"][0]["extensions"]["EXT_meshopt_compression"][field] = value;
            let fault = error_of(&builder);
            (fault.code, fault.pointer.replace("/bufferViews/0/extensions/EXT_meshopt_compression", ""))
        };
        assert_eq!(fault("count", json!(5)), ("meshopt", String::new()));
        assert_eq!(fault("mode", json!("ZIP")), ("meshopt", "/mode".into()));
        assert_eq!(fault("filter", json!("BLUR")), ("meshopt", "/filter".into()));
        assert_eq!(fault("filter", json!("OCTAHEDRAL")), ("meshopt", String::new()), "a stride of 12");
        assert_eq!(fault("byteLength", json!(9)), ("meshopt", String::new()), "cut off");
        assert_eq!(fault("byteLength", json!(9000)).0, "buffer_view_out_of_bounds");
        assert_eq!(fault("buffer", json!(7)).0, "reference");
        let mut bomb = packed("KHR_meshopt_compression");
        bomb.json["bufferViews"][0]["byteLength"] = json!(12_000_000_000_u64);
        bomb.json["bufferViews"][0]["extensions"]["KHR_meshopt_compression"]["count"] = json!(1_000_000_000);
        assert_eq!(error_of(&bomb).code, "decoded_bytes");
    }

    #[test]
    fn broken_streams_never_panic() {
        let good = packed("EXT_meshopt_compression");
        for at in 0..good.clone().bin_mut().len() {
            for value in [0, 0x55, 0xff] {
                let mut broken = good.clone();
                broken.bin_mut()[at] = value;
                let _ = crate::scene::import(&broken.package(), &crate::scene::Limits::default());
            }
        }
    }
}
