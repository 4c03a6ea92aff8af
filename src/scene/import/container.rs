//! Binary glTF (glTF 2.0, chapter 4): header and chunks.

use crate::scene::SceneError;

/// The two halves of a glTF file.
#[derive(Debug, PartialEq, Eq)]
pub(in crate::scene) struct Container<'a> {
    /// JSON text.
    pub json: &'a [u8],
    /// Content of the BIN chunk.
    pub bin: Option<&'a [u8]>,
}

const JSON: u32 = 0x4E4F_534A;
const BIN: u32 = 0x004E_4942;

/// Splits a `.glb`; any other bytes are taken for JSON text.
pub(in crate::scene) fn split(bytes: &[u8]) -> Result<Container<'_>, SceneError> {
    if !bytes.starts_with(b"glTF") {
        return Ok(Container { json: bytes, bin: None });
    }
    let (Some(version), Some(length)) = (word(bytes, 4), word(bytes, 8)) else {
        return Err(cut("its 12-byte header", bytes.len()));
    };
    if version != 2 {
        let detail = format!("byte 4: GLB container version {version} is not supported; export as glTF 2.0");
        return Err(SceneError::malformed("glb_version", detail));
    }
    let body = bytes
        .get(..length as usize)
        .ok_or_else(|| cut(&format!("the {length} bytes that byte 8 declares"), bytes.len()))?;
    if body.len() < bytes.len() {
        let detail = format!("byte 8: the GLB declares {length} bytes, but the file has {}", bytes.len());
        return Err(SceneError::malformed("glb_length", detail));
    }
    chunks(body)
}

fn chunks(body: &[u8]) -> Result<Container<'_>, SceneError> {
    let mut container = Container { json: &[], bin: None };
    let mut at = 12;
    for ordinal in 0.. {
        if at >= body.len() && ordinal > 0 {
            break;
        }
        let (Some(length), Some(kind)) = (word(body, at), word(body, at + 4)) else {
            return Err(cut(&format!("the header of chunk {ordinal} at byte {at}"), body.len()));
        };
        let start = at + 8;
        let content = start.checked_add(length as usize).and_then(|end| body.get(start..end)).ok_or_else(|| {
            let detail =
                format!("byte {at}: chunk {ordinal} of {length} bytes does not fit in the GLB's {} bytes", body.len());
            SceneError::malformed("glb_chunk", detail)
        })?;
        let fault = match (ordinal, kind) {
            (0, JSON) if content.is_empty() => "the JSON chunk is empty",
            (0, JSON) if !looks_like_an_object(content) => "the JSON chunk does not hold a JSON object (`{`)",
            (0, JSON) => {
                container.json = content;
                ""
            }
            (0, _) => "the first chunk must be of type JSON",
            (1, BIN) => {
                container.bin = Some(content);
                ""
            }
            (_, JSON) => "there must be one JSON chunk only",
            (_, BIN) => "the BIN chunk must be the second chunk, and the only one of its type",
            // Chunks of other types are to be ignored (4.4.1).
            _ => "",
        };
        if !fault.is_empty() {
            return Err(SceneError::malformed("glb_chunk", format!("byte {at}: {fault}; export the file again")));
        }
        at = start + content.len();
    }
    Ok(container)
}

/// What has a byte order mark in front is told so elsewhere.
fn looks_like_an_object(json: &[u8]) -> bool {
    json.trim_ascii_start().first().is_some_and(|byte| matches!(byte, b'{' | 0xEF))
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    let bytes = bytes.get(at..at.checked_add(4)?)?;
    Some(u32::from_le_bytes(bytes.try_into().ok()?))
}

fn cut(what: &str, length: usize) -> SceneError {
    SceneError::malformed(
        "glb_cut",
        format!("the GLB ends at byte {length}, before the end of {what}; send the whole file"),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::import::testing::glb;

    #[test]
    fn chunk_rules() {
        let code = |bytes: &[u8]| split(bytes).map(|_| "ok").unwrap_or_else(|error| error.code);
        let json = (JSON, b"{}  ".as_slice());
        let bin = (BIN, [1, 2, 3, 4].as_slice());
        let other = (7, [0; 4].as_slice());
        assert_eq!(split(&glb(&[json])).unwrap(), Container { json: b"{}  ", bin: None });
        assert_eq!(split(&glb(&[json, bin, other])).unwrap(), Container { json: b"{}  ", bin: Some(&[1, 2, 3, 4]) });
        assert_eq!(code(&glb(&[bin, json])), "glb_chunk", "order");
        assert_eq!(code(&glb(&[json, bin, bin])), "glb_chunk", "two BIN");
        assert_eq!(code(&glb(&[json, json])), "glb_chunk", "two JSON");
        assert_eq!(code(&glb(&[json, other, bin])), "glb_chunk", "BIN is third");
        assert_eq!(code(&glb(&[(JSON, b"")])), "glb_chunk", "empty");
        for text in [b"null", b"[{}]", b"    ", b"\0{} "] {
            let fault = split(&glb(&[(JSON, text)])).unwrap_err();
            assert_eq!(fault.code, "glb_chunk");
            assert!(fault.detail.contains("does not hold a JSON object"), "{fault}");
        }
        assert_eq!(code(&glb(&[])), "glb_cut", "no chunk");
        let whole = glb(&[json, bin]);
        for length in 4..whole.len() {
            assert_eq!(code(&whole[..length]), "glb_cut", "{length}");
        }
        let mut longer = whole.clone();
        longer.push(0);
        assert_eq!(code(&longer), "glb_length");
        let mut version = whole.clone();
        version[4] = 1;
        assert_eq!(code(&version), "glb_version");
        let mut chunk = whole;
        chunk[12..16].fill(0xff);
        assert_eq!(code(&chunk), "glb_chunk");
    }
}
