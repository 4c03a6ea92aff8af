//! KTX2 files with Basis Universal textures (KHR_texture_basisu): ETC1S and UASTC, plain or packed by BasisLZ or zstd.

use basisu::{DecodeFlags, TargetFormat, Transcoder};

/// First bytes of every file (KTX 2.0, 3.1).
const MAGIC: &[u8] = b"\xABKTX 20\xBB\r\n\x1A\n";

/// Bytes of a block of 4 x 4 texels before packing, at most (UASTC).
const BLOCK_BYTES: u64 = 16;

/// Whether bytes begin as a KTX2 file does.
pub fn is_ktx2(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}

/// Width and height, from the header; what is packed has been found to unpack to no more than these need.
///
/// # Errors
/// What is wrong with the file, or is not read here.
pub fn size(bytes: &[u8]) -> Result<(u32, u32), String> {
    let word = |at: usize| bytes.get(at..at + 4).and_then(|word| word.try_into().ok()).map(u32::from_le_bytes);
    let long = |at: usize| bytes.get(at..at + 8).and_then(|word| word.try_into().ok()).map(u64::from_le_bytes);
    let header = || Some(([word(20)?, word(24)?], [word(28)?, word(32)?, word(36)?], word(44)?, long(96)?));
    // Descriptor, keys and values, what all levels share, the first level.
    let parts = || {
        let short = |at| Some([u64::from(word(at)?), u64::from(word(at + 4)?)]);
        Some([short(48)?, short(56)?, [long(64)?, long(72)?], [long(80)?, long(88)?]])
    };
    let (Some(([width, height], [depth, layers, faces], packing, unpacked)), Some(parts)) = (header(), parts()) else {
        return Err("the KTX2 file is cut off in its header".to_owned());
    };
    let lies_inside =
        |[offset, length]: &[u64; 2]| offset.checked_add(*length).is_some_and(|end| end <= bytes.len() as u64);
    if !parts.iter().all(lies_inside) {
        return Err("the KTX2 file is cut off: a part of it lies beyond its end".to_owned());
    }
    if depth > 1 || layers > 1 || faces != 1 {
        return Err("the KTX2 file is no single picture (it has depth, layers or faces)".to_owned());
    }
    let most = u64::from(width.div_ceil(4)) * u64::from(height.div_ceil(4)) * BLOCK_BYTES;
    // BasisLZ (1) unpacks to what the size says; of the others the file says how much it is.
    if packing > 1 && unpacked > most {
        return Err(format!(
            "its first level is said to unpack to {unpacked} bytes, but its size needs at most {most}"
        ));
    }
    Ok((width, height))
}

/// The texels of the first level, RGBA8, row by row from the top, as they are stored (sRGB or linear).
///
/// # Errors
/// What is wrong with the file, or is not read here.
pub fn decode(bytes: &[u8]) -> Result<Vec<u8>, String> {
    let (width, height) = size(bytes)?;
    let texels = std::panic::catch_unwind(|| {
        let transcoder = Transcoder::new(bytes)?;
        transcoder.transcode(0, TargetFormat::Rgba32, DecodeFlags::NONE)
    });
    let texels = texels.map_err(|_| "the stream is broken".to_owned())?.map_err(|error| format!("{error:?}"))?;
    if texels.len() as u64 == u64::from(width) * u64::from(height) * 4 {
        return Ok(texels);
    }
    Err("the texels are not as many as the header says".to_owned())
}

#[cfg(test)]
pub(in crate::scene) mod tests {
    use super::*;
    use base64::Engine;

    /// A picture of 8 x 4 texels: two blocks of one colour each (UASTC's mode 8), packed by nothing.
    pub(in crate::scene) fn two_colors(colors: [[u8; 4]; 2]) -> Vec<u8> {
        let mut file = MAGIC.to_vec();
        let words = |file: &mut Vec<u8>, words: &[u32]| file.extend(words.iter().flat_map(|word| word.to_le_bytes()));
        // Format, type size, width, height, depth, layers, faces, levels, packing.
        words(&mut file, &[0, 1, 8, 4, 0, 0, 1, 1, 0]);
        // Descriptor at 104 (44 bytes), no key values, no global data.
        words(&mut file, &[104, 44, 0, 0, 0, 0, 0, 0]);
        // Level 0: at 160, 32 bytes.
        words(&mut file, &[160, 0, 32, 0, 32, 0]);
        // Basic descriptor: UASTC (166), BT.709, sRGB, straight alpha; blocks of 4 x 4 in 16 bytes; one RGBA sample.
        words(&mut file, &[44, 0, 2 | 40 << 16, 166 | 1 << 8 | 2 << 16, 3 | 3 << 8, 16, 0]);
        words(&mut file, &[127 << 16 | 3 << 24, 0, 0, u32::MAX]);
        file.resize(160, 0);
        for [r, g, b, a] in colors {
            // Mode 8: five bits (10111 from the left of a code read from the low end), then the colour.
            let bits =
                0b10111_u128 | u128::from(r) << 5 | u128::from(g) << 13 | u128::from(b) << 21 | u128::from(a) << 29;
            file.extend(bits.to_le_bytes());
        }
        file
    }

    #[test]
    fn blocks_become_texels() {
        let colors = [[255, 128, 0, 255], [3, 2, 1, 77]];
        let file = two_colors(colors);
        assert!(is_ktx2(&file));
        assert_eq!(size(&file), Ok((8, 4)));
        let texels = decode(&file).unwrap();
        for (index, texel) in texels.chunks_exact(4).enumerate() {
            assert_eq!(texel, colors[index % 8 / 4], "texel {index}");
        }
    }

    /// 8 x 8 texels, the left half opaque (200, 40, 40), the right half (30, 60, 220) with alpha 128: ETC1S in BasisLZ.
    const ETC1S: &str = "q0tUWCAyMLsNChoKAAAAAAEAAAAIAAAACAAAAAAAAAAAAAAAAQAAAAEAAAABAAAAaAAAADwAAACkAAAAJAAAAMgAAAAAAAAAkwAA\
        AAAAAABbAQAAAAAAAAMAAAAAAAAAAAAAAAAAAAA8AAAAAAAAAAIAOACjAQIAAwMAAAgIAAAAAAAAAAA/AAAAAAAAAAAA/////0AA\
        Pw8AAAAAAAAAAP////8fAAAAS1RYd3JpdGVyAEJhc2lzIFVuaXZlcnNhbCAyLjEwAAAEAAMAMQAAAA0AAAAtAAAAAAAAAAAAAAAA\
        AAAAAgAAAAIAAAABAAAAHsCUAAAAAAAAckIFAkwEAAAAAAAgCw54AFMCAAAAAEBQM/BBBCACQAAAAABEFR/mBFRVVVUFAAAAqKqq\
        qgJgwEQAAAAAAACSigCYABAAAAAAQJQIiBAgAAAACKKu6BMFgAkAAQAAAABEIADuESQ=";

    /// The same: UASTC in zstd.
    const UASTC_ZSTD: &str = "q0tUWCAyMLsNChoKAAAAAAEAAAAIAAAACAAAAAAAAAAAAAAAAQAAAAEAAAACAAAAaAAAACwAAACUAAAAJAAAAAAAAAAAAAAAAAAA\
        AAAAAAC4AAAAAAAAACQAAAAAAAAAQAAAAAAAAAAsAAAAAAAAAAIAKACmAQIAAwMAABAAAAAAAAAAAAB/AwAAAAAAAAAA/////x8A\
        AABLVFh3cml0ZXIAQmFzaXMgVW5pdmVyc2FsIDIuMTAAACi1L/0gQN0AAIgXGQXlP8jGANeDhxtwHEcDAAMAQ2EA3HkBFw==";

    #[test]
    fn packed_files_are_unpacked() {
        for (name, text) in [("ETC1S", ETC1S), ("UASTC", UASTC_ZSTD)] {
            let file = base64::engine::general_purpose::STANDARD.decode(text).unwrap();
            assert_eq!(size(&file), Ok((8, 8)));
            for (index, texel) in decode(&file).unwrap().chunks_exact(4).enumerate() {
                let expected = if index % 8 < 4 { [200, 40, 40, 255] } else { [30, 60, 220, 128] };
                for (found, expected) in texel.iter().zip(expected) {
                    assert!((i32::from(*found) - expected).abs() <= 8, "{name}, texel {index}: {texel:?}");
                }
            }
            for at in 12..file.len() {
                for value in [0, 0x5a, 0xff] {
                    let mut file = file.clone();
                    file[at] = value;
                    let _ = decode(&file);
                }
            }
        }
    }

    #[test]
    fn broken_files_are_refused() {
        let file = two_colors([[1; 4]; 2]);
        for length in [12, 40, 103, 150, 170] {
            assert!(decode(&file[..length]).is_err(), "{length} bytes");
        }
        let with = |at: usize, value: u32| {
            let mut file = file.clone();
            file[at..at + 4].copy_from_slice(&value.to_le_bytes());
            decode(&file)
        };
        assert!(with(36, 6).unwrap_err().contains("faces"));
        assert!(with(20, 4000).is_err(), "more texels than blocks");
        // Found by libFuzzer: the decoder adds these without a look.
        for (at, value) in [(84, u32::MAX), (92, u32::MAX), (68, u32::MAX), (48, u32::MAX), (60, u32::MAX)] {
            assert!(with(at, value).unwrap_err().contains("beyond its end"), "a part at byte {at}");
        }
        let mut packed = file.clone();
        packed[44] = 2;
        packed[96..104].copy_from_slice(&(1_u64 << 40).to_le_bytes());
        assert!(size(&packed).unwrap_err().contains("unpack"));
        // Whatever a byte is, the answer is texels or an error.
        for at in 12..file.len() {
            for value in [0, 1, 0x7f, 0xff] {
                let mut file = file.clone();
                file[at] = value;
                let _ = decode(&file);
            }
        }
    }
}
