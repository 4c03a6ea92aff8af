//! The targets of `fuzz/` on stable Rust: bytes changed at random, from a fixed seed, without libFuzzer's knowledge of what was reached.
//!
//! `CANDELA_FUZZ=1000000 cargo test --test robustness fuzz -- --nocapture` is the long run; `CANDELA_FUZZ_SEED` another one. What a target
//! fell over lies in `target/fuzz/` then, and belongs among the inputs below once it is mended.

use crate::damage::{Random, Victim};
use crate::targets;
use std::io::Cursor;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::time::{Duration, Instant};

/// Executions of a run of `script/test`.
const USUAL: usize = 3000;

/// Longest execution.
const PATIENCE: Duration = Duration::from_secs(2);

/// Words that formats know, which chance alone would not find.
const WORDS: [&[u8]; 20] = [
    b"null",
    b"true",
    b"{}",
    b"[]",
    b"1e308",
    b"-0",
    b"18446744073709551615",
    b"\\u0000",
    b"\"",
    b"//",
    b"..",
    b"%2e",
    b"data:,",
    b"bufferView",
    b"lights",
    b"IHDR",
    b"IDAT",
    b"\0\0\0\0",
    b"\xff\xff\xff\xff",
    b"\x7f\xff\xff\xff",
];

/// One input, changed.
fn changed(random: &mut Random, inputs: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = inputs[random.below(inputs.len())].clone();
    for _ in 0..=random.below(6) {
        let at = random.below(bytes.len() + 1);
        let most = 1 << random.below(6);
        let length = random.below(most).min(bytes.len() - at);
        match random.below(9) {
            0 if at < bytes.len() => bytes[at] ^= 1 << random.below(8),
            1 if at < bytes.len() => bytes[at] = random.next() as u8,
            2 if at < bytes.len() => bytes[at] = [0, 1, 0x7f, 0x80, 0xff, b'"', b'0', b','][random.below(8)],
            3 => drop(bytes.drain(at..at + length)),
            4 => drop(bytes.splice(at..at, (0..length).map(|_| random.next() as u8).collect::<Vec<_>>())),
            5 => drop(bytes.splice(at..at + length, WORDS[random.below(WORDS.len())].iter().copied())),
            6 => {
                let copy = bytes[at..at + length].to_vec();
                let to = random.below(bytes.len() + 1);
                drop(bytes.splice(to..to, copy));
            }
            7 => {
                let other = &inputs[random.below(inputs.len())];
                let from = random.below(other.len() + 1);
                bytes.truncate(at);
                bytes.extend_from_slice(&other[from..]);
            }
            _ if random.below(8) == 0 => bytes.truncate(at),
            _ => {}
        }
    }
    bytes
}

/// Runs a target on each input as it is, then on changed ones.
fn fuzz(name: &str, inputs: &[Vec<u8>], target: fn(&[u8]) -> bool) {
    let number = |name: &str| std::env::var(name).ok().and_then(|text| text.parse().ok());
    let count = number("CANDELA_FUZZ").unwrap_or(USUAL);
    let mut random = Random(number("CANDELA_FUZZ_SEED").unwrap_or(1) as u64);
    let (begun, mut accepted, mut slowest) = (Instant::now(), 0, Duration::ZERO);
    for execution in 0..count {
        let bytes = inputs.get(execution).cloned().unwrap_or_else(|| changed(&mut random, inputs));
        let started = Instant::now();
        let ended = catch_unwind(AssertUnwindSafe(|| target(&bytes)));
        let took = started.elapsed();
        slowest = slowest.max(took);
        if ended.is_err() || took > PATIENCE {
            let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("fuzz");
            std::fs::create_dir_all(&folder).expect("a folder");
            let file = folder.join(format!("{name}-{execution}"));
            std::fs::write(&file, &bytes).expect("a file");
            panic!("{name}: execution {execution} ({took:?}); the input is {}", file.display());
        }
        accepted += usize::from(ended.unwrap_or_default());
    }
    eprintln!("{name}: {count} executions in {:.0?}, {accepted} accepted, slowest {slowest:.1?}", begun.elapsed());
    assert!(accepted > 0, "{name}: nothing was ever accepted");
}

fn encoded(format: image::ImageFormat) -> Vec<u8> {
    let mut file = Cursor::new(Vec::new());
    let picture = image::RgbImage::from_fn(9, 7, |x, y| image::Rgb([x as u8 * 20, y as u8 * 30, 90]));
    let picture = image::DynamicImage::from(picture);
    let is_linear = matches!(format, image::ImageFormat::Hdr | image::ImageFormat::OpenExr);
    let picture = if is_linear { image::DynamicImage::from(picture.to_rgb32f()) } else { picture };
    picture.write_to(&mut file, format).expect("it can be written");
    file.into_inner()
}

#[test]
fn fuzzed_scenes() {
    let victim = Victim::new();
    let mut random = Random(5);
    let mut inputs = vec![victim.whole(), candela::demo::surface_detail()];
    inputs.extend((0..20).map(|_| victim.with_odd_values(&mut random)));
    fuzz("glb", &inputs, targets::sound_or_refused);
}

#[test]
fn fuzzed_parameters() {
    let inputs = [
        r#"{"width": 640, "height": 480, "camera": {"position": [1, 1, 3], "target": [0, 0.5, 0], "yfov_degrees": 45, "aperture_radius": 0.1}}"#,
        r#"{"lights": [{"type": "spot", "position": [0, 3, 0], "direction": [0, -1, 0], "color": [1, 1, 1], "intensity": 50, "range": 20}, {"type": "ambient"}]}"#,
        r#"{"environment": {"gradient": {"top": [1, 1, 1], "horizon": [0, 0, 0], "bottom": [0, 0, 1]}, "rotation_degrees": 30}, "tone_mapping": "agx"}"#,
        r#"{"mode": "preview", "preview": {"shading": "phong", "shadows": {"algorithm": "pcss", "bias": {"slope": 2}}, "attenuation": {"linear": 1}}}"#,
        r#"{"spheres": [{"center": [0, 1, 0], "radius": 0.5, "texture": {"image": "a.png"}}], "overrides": [{"material": "a", "color": [1, 0, 0]}]}"#,
        r#"{"output": {"format": "exr", "bits": 16, "transparent": true}, "filter": {"kind": "gaussian", "radius": 2}, "environment": null, "time": 1.5}"#,
        "width=640&camera.yfov_degrees=30&lights.0.type=point&lights.0.position=[1,2,3]&environment={\"constant\":[1,1,1]}",
        "{\"scene\": \"a\", \"name\": \"top\", \"params\": {\"width\": 7}}\n{\"scene\": \"b\"}",
        r#"{"scenes": ["a", "b"], "cameras": [{"index": 0}, null], "lights": [[], [{"type": "ambient"}]]}"#,
    ];
    fuzz("params", &inputs.map(|text| text.as_bytes().to_vec()), targets::parameters);
}

#[test]
fn fuzzed_images() {
    use image::ImageFormat::{Hdr, Jpeg, OpenExr, Png, WebP};
    let mut inputs: Vec<Vec<u8>> = [Png, Jpeg, WebP, Hdr, OpenExr].into_iter().map(encoded).collect();
    inputs.push(ktx2());
    fuzz("images", &inputs, targets::image);
}

/// A KTX2 file of one level of 4 x 4 texels in UASTC, as its header has it; the block is zero.
fn ktx2() -> Vec<u8> {
    let mut file = b"\xabKTX 20\xbb\r\n\x1a\n".to_vec();
    // Format undefined, type size 1, 4 x 4, no depth, no layers, one face, one level, no supercompression.
    for word in [0_u32, 1, 4, 4, 0, 0, 1, 1, 0] {
        file.extend(word.to_le_bytes());
    }
    // Data format descriptor at 104, 44 bytes; no keys, no global data.
    for word in [104_u32, 44, 0, 0] {
        file.extend(word.to_le_bytes());
    }
    file.extend([0; 16]);
    for word in [160_u64, 16, 16] {
        file.extend(word.to_le_bytes());
    }
    for word in [44_u32, 0, 0x0028_0002, 0x0001_01a6, 0x0000_0303, 16, 0, 0x007f_0000, 0, 0, u32::MAX] {
        file.extend(word.to_le_bytes());
    }
    file.resize(176, 0);
    file
}
