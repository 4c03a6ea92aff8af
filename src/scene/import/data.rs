//! Bytes of buffers, buffer views and accessors, unpacked.

use super::budget::Budget;
use super::schema::Root;
use super::{draco, meshopt};
use crate::scene::package::uri::{self, Uri};
use crate::scene::{Limits, Package, SceneError};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The document with its binary data at hand.
pub(super) struct Data<'a> {
    pub root: &'a Root,
    buffers: Vec<Cow<'a, [u8]>>,
    /// By buffer view: its bytes, if they are packed in the file.
    unpacked: BTreeMap<usize, Vec<u8>>,
    /// Accessors that are packed in the file.
    decoded: draco::Decoded,
}

/// Where a URI leads.
pub(super) enum Located<'a> {
    /// Bytes that the URI held itself.
    Inline(Vec<u8>),
    /// A file of the package.
    File(&'a Arc<[u8]>),
}

impl<'a> Data<'a> {
    /// Finds all buffers, checks that all views lie within them, and unpacks what is packed.
    pub(super) fn new(
        root: &'a Root,
        package: &'a Package,
        bin: Option<&'a [u8]>,
        limits: &Limits,
        budget: &mut Budget,
    ) -> Result<Self, SceneError> {
        if root.buffers.len() > limits.buffers {
            let detail =
                format!("the file has {} buffers, more than the limit of {}", root.buffers.len(), limits.buffers);
            return Err(SceneError::too_large("buffers", "/buffers", detail));
        }
        let buffers =
            (0..root.buffers.len()).map(|index| buffer(root, index, package, bin)).collect::<Result<_, _>>()?;
        let mut data = Self { root, buffers, unpacked: BTreeMap::new(), decoded: draco::Decoded::new() };
        for (index, view) in root.buffer_views.iter().enumerate() {
            let Some((packed, place)) = meshopt::of_view(view, &format!("/bufferViews/{index}"))? else { continue };
            let source = data.part(packed.buffer, packed.byte_offset, packed.byte_length, &place)?;
            let bytes = meshopt::decode(&packed, source, view.byte_length, &place, budget)?;
            data.unpacked.insert(index, bytes);
        }
        for index in 0..root.buffer_views.len() {
            data.view(index)?;
        }
        data.decoded = draco::decode(&data, limits, budget)?;
        Ok(data)
    }

    /// The elements of an accessor that was packed by itself, side by side.
    pub(super) fn decoded(&self, accessor: usize) -> Option<&[u8]> {
        self.decoded.get(&accessor).map(Vec::as_slice)
    }

    /// Bytes of a buffer view.
    pub(super) fn view(&self, index: usize) -> Result<&[u8], SceneError> {
        let pointer = format!("/bufferViews/{index}");
        let view = self.root.buffer_views.get(index).ok_or_else(|| missing(&pointer, "buffer view", index))?;
        match self.unpacked.get(&index) {
            Some(bytes) => Ok(bytes),
            None => self.part(view.buffer, view.byte_offset, view.byte_length, &pointer),
        }
    }

    /// Some bytes of a buffer; `pointer` is what asks for them.
    fn part(&self, buffer: usize, offset: u64, length: u64, pointer: &str) -> Result<&[u8], SceneError> {
        let bytes = self.buffers.get(buffer);
        let bytes = bytes.ok_or_else(|| missing(&format!("{pointer}/buffer"), "buffer", buffer))?;
        slice(bytes, offset, length).ok_or_else(|| {
            let detail = format!(
                "the view of {length} bytes at byte {offset} does not fit in buffer {buffer} of {} bytes; export the file again",
                bytes.len()
            );
            SceneError::invalid("buffer_view_out_of_bounds", format!("{pointer}/byteLength"), detail)
        })
    }
}

/// Some `length` bytes at `offset`.
pub(super) fn slice(bytes: &[u8], offset: u64, length: u64) -> Option<&[u8]> {
    let start = usize::try_from(offset).ok()?;
    let end = usize::try_from(offset.checked_add(length)?).ok()?;
    bytes.get(start..end)
}

/// A reference to something that the file does not have.
pub(super) fn missing(pointer: &str, what: &str, index: usize) -> SceneError {
    SceneError::invalid("reference", pointer, format!("the file has no {what} {index}; export it again"))
}

fn buffer<'a>(
    root: &Root,
    index: usize,
    package: &'a Package,
    bin: Option<&'a [u8]>,
) -> Result<Cow<'a, [u8]>, SceneError> {
    let pointer = format!("/buffers/{index}");
    let buffer = root.buffers.get(index).ok_or_else(|| missing(&pointer, "buffer", index))?;
    if meshopt::is_fallback(&buffer.extensions, &pointer)? {
        return Ok(Cow::Borrowed(&[]));
    }
    let bytes: Cow<'a, [u8]> = match (&buffer.uri, bin) {
        (Some(uri), _) => match locate(uri, &format!("{pointer}/uri"), package)? {
            Located::Inline(bytes) => bytes.into(),
            Located::File(bytes) => Cow::Borrowed(bytes.as_ref()),
        },
        (None, Some(bin)) if index == 0 => bin.into(),
        (None, _) => {
            let detail = "the buffer has no `uri`, and only buffer 0 of a .glb with a BIN chunk may do without";
            return Err(SceneError::invalid("buffer_missing", pointer, detail));
        }
    };
    // More bytes than declared are padding.
    let short = || {
        let detail = format!(
            "the buffer declares {} bytes, but its data has {}; is it cut off?",
            buffer.byte_length,
            bytes.len()
        );
        SceneError::invalid("buffer_too_short", format!("{pointer}/byteLength"), detail)
    };
    let length = usize::try_from(buffer.byte_length).ok().filter(|length| *length <= bytes.len()).ok_or_else(short)?;
    Ok(match bytes {
        Cow::Borrowed(bytes) => Cow::Borrowed(bytes.get(..length).unwrap_or(bytes)),
        Cow::Owned(mut bytes) => {
            bytes.truncate(length);
            Cow::Owned(bytes)
        }
    })
}

/// Finds what a URI names; never outside the package.
pub(super) fn locate<'a>(text: &str, pointer: &str, package: &'a Package) -> Result<Located<'a>, SceneError> {
    match uri::parse(text) {
        Uri::Data(bytes) => Ok(Located::Inline(bytes)),
        Uri::Broken(why) => Err(SceneError::invalid("uri_broken", pointer, why)),
        Uri::External => {
            let detail = format!("`{}` lies outside; nothing is fetched: embed it, or put the file beside the glTF and name that", clip(text));
            Err(SceneError::invalid("uri_external", pointer, detail))
        }
        Uri::Relative(path) => package.find(path).map(Located::File).ok_or_else(|| {
            let detail = format!(
                "there is no file `{}` with the glTF; it must lie beside it (in the same folder, zip or form, under that name), or \
                 export a .glb, which holds everything",
                clip(&uri::decode(path))
            );
            SceneError::invalid("uri_missing", pointer, detail)
        }),
    }
}

/// The beginning of a text that a user wrote, for a message.
fn clip(text: &str) -> String {
    text.chars().take(200).collect()
}

#[cfg(test)]
mod tests {
    use crate::scene::import::testing::{error, gltf};
    use serde_json::json;

    #[test]
    fn buffers_must_be_there_and_long_enough() {
        let code = |buffers| {
            let fault = error(&gltf(json!({"buffers": buffers})));
            (fault.code, fault.pointer)
        };
        assert_eq!(code(json!([{"byteLength": 1, "uri": "a.bin"}])), ("uri_missing", "/buffers/0/uri".into()));
        assert_eq!(
            code(json!([{"byteLength": 1, "uri": "http://x/a.bin"}])),
            ("uri_external", "/buffers/0/uri".into())
        );
        assert_eq!(code(json!([{"byteLength": 1, "uri": "data:;base64,*"}])), ("uri_broken", "/buffers/0/uri".into()));
        assert_eq!(code(json!([{"byteLength": 1}])), ("buffer_missing", "/buffers/0".into()));
        assert_eq!(
            code(json!([{"byteLength": 4, "uri": "data:,abc"}])),
            ("buffer_too_short", "/buffers/0/byteLength".into())
        );
    }

    #[test]
    fn views_must_fit() {
        let code = |view| {
            let fault =
                error(&gltf(json!({"buffers": [{"byteLength": 3, "uri": "data:,abcd"}], "bufferViews": [view]})));
            (fault.code, fault.pointer)
        };
        let place = "/bufferViews/0/byteLength".to_owned();
        assert_eq!(code(json!({"buffer": 0, "byteLength": 4})), ("buffer_view_out_of_bounds", place.clone()));
        assert_eq!(
            code(json!({"buffer": 0, "byteLength": 1, "byteOffset": 3})),
            ("buffer_view_out_of_bounds", place.clone())
        );
        assert_eq!(
            code(json!({"buffer": 0, "byteLength": 1, "byteOffset": u64::MAX})),
            ("buffer_view_out_of_bounds", place)
        );
        assert_eq!(code(json!({"buffer": 1, "byteLength": 1})), ("reference", "/bufferViews/0/buffer".into()));
    }
}
