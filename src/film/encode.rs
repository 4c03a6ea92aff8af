//! [`Picture`] -> file bytes. The same picture, parameters and facts always give the same bytes.

use super::tone_mapping::{srgb_encode, tone_map};
use super::{Aov, Aovs, Picture};
use crate::params::{ImageFormat, RenderParams};
use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression as ExrCompression, Encoding, FlatSamples, Image, Layer,
    LayerAttributes, LineOrder, SpecificChannels, Text, Vec2 as ExrPosition, WritableImage,
};
use glam::{Vec3, Vec4};
use image::ExtendedColorType;
use image::codecs::{jpeg::JpegEncoder, webp::WebPEncoder};
use rayon::prelude::*;
use std::io::Cursor;

/// Quality of a JPEG, of 100.
const JPEG_QUALITY: u8 = 95;

/// How the bytes of an EXR lie.
const ENCODING: Encoding =
    Encoding { compression: ExrCompression::ZIP16, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };

/// Why a picture cannot be written in a format.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum EncodeError {
    /// The format cannot hold what was asked for.
    #[error("{0}")]
    Unsupported(String),
    /// The encoder failed.
    #[error("the picture could not be encoded: {0}")]
    Failed(String),
}

/// Writes a picture as a file of the given format, which may differ from `params.output.format`.
///
/// PNG, WebP and JPEG are exposed, tone mapped and sRGB; EXR is the radiance as it is, f32, alpha premultiplied.
/// Alpha is there if `params.output.transparent`. `facts`, pairs of a short ASCII name and a text, go
/// into a PNG as text chunks and into an EXR as lines of its `comments`; the other formats have no place for them.
pub fn encode(
    picture: &Picture,
    params: &RenderParams,
    format: ImageFormat,
    facts: &[(String, String)],
) -> Result<Vec<u8>, EncodeError> {
    check_format(picture, params, format)?;
    match format {
        ImageFormat::Png => png(picture, params, facts),
        ImageFormat::Exr => exr(picture, params.output.transparent, facts),
        ImageFormat::Webp => webp(picture, params),
        ImageFormat::Jpeg => jpeg(picture, params),
    }
}

/// Writes an AOV as an EXR of three channels, and three more (`name.R` and so on) for each of its layers; `facts` as in [`encode`]. None:
/// there is no such AOV of this picture.
pub fn encode_aov(aovs: &Aovs, aov: Aov, facts: &[(String, String)]) -> Option<Result<Vec<u8>, EncodeError>> {
    let (picture, layers) = (aovs.picture(aov)?, aovs.layers(aov));
    Some(if layers.is_empty() { exr(&picture, false, facts) } else { exr_layers(&picture, layers, facts) })
}

fn check_format(picture: &Picture, params: &RenderParams, format: ImageFormat) -> Result<(), EncodeError> {
    let side = picture.width.max(picture.height);
    let most = format.max_side();
    if side > most {
        return Err(EncodeError::Unsupported(format!(
            "a side of {side} pixels is beyond the {most} that the format allows: ask for PNG or EXR"
        )));
    }
    if format == ImageFormat::Jpeg && params.output.transparent {
        return Err(EncodeError::Unsupported(
            "JPEG has no alpha: ask for PNG, WebP or EXR, or an opaque picture".into(),
        ));
    }
    Ok(())
}

fn png(picture: &Picture, params: &RenderParams, facts: &[(String, String)]) -> Result<Vec<u8>, EncodeError> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, picture.width, picture.height);
    encoder.set_color(if params.output.transparent { png::ColorType::Rgba } else { png::ColorType::Rgb });
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    // Noise hardly compresses: the fast level is within a few per cent of the best in size.
    encoder.set_compression(png::Compression::Fast);
    for (name, text) in facts {
        encoder.add_itxt_chunk(name.clone(), text.clone()).map_err(failed)?;
    }
    let data = if params.output.bits == 16 {
        encoder.set_depth(png::BitDepth::Sixteen);
        quantised(picture, params, |value| ((value * 65535.0).round() as u16).to_be_bytes())
    } else {
        encoder.set_depth(png::BitDepth::Eight);
        eight_bits(picture, params)
    };
    let mut writer = encoder.write_header().map_err(failed)?;
    writer.write_image_data(&data).map_err(failed)?;
    writer.finish().map_err(failed)?;
    Ok(bytes)
}

fn webp(picture: &Picture, params: &RenderParams) -> Result<Vec<u8>, EncodeError> {
    let color = if params.output.transparent { ExtendedColorType::Rgba8 } else { ExtendedColorType::Rgb8 };
    let mut bytes = Vec::new();
    WebPEncoder::new_lossless(&mut bytes)
        .encode(&eight_bits(picture, params), picture.width, picture.height, color)
        .map_err(failed)?;
    Ok(bytes)
}

fn jpeg(picture: &Picture, params: &RenderParams) -> Result<Vec<u8>, EncodeError> {
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY)
        .encode(&eight_bits(picture, params), picture.width, picture.height, ExtendedColorType::Rgb8)
        .map_err(failed)?;
    Ok(bytes)
}

fn exr(picture: &Picture, alpha: bool, facts: &[(String, String)]) -> Result<Vec<u8>, EncodeError> {
    let width = picture.width as usize;
    let pixel = |at: ExrPosition<usize>| picture.pixels[at.y() * width + at.x()];
    let rgb = |at: ExrPosition<usize>| {
        let [r, g, b, _] = pixel(at);
        (r, g, b)
    };
    let rgba = |at: ExrPosition<usize>| <(f32, f32, f32, f32)>::from(pixel(at));

    let size = (width, picture.height as usize);

    let mut file = Cursor::new(Vec::new());
    let written = if alpha {
        let layer = Layer::new(size, attributes(facts), ENCODING, SpecificChannels::rgba(rgba));
        Image::from_layer(layer).write().to_buffered(&mut file)
    } else {
        let layer = Layer::new(size, attributes(facts), ENCODING, SpecificChannels::rgb(rgb));
        Image::from_layer(layer).write().to_buffered(&mut file)
    };
    written.map_err(failed)?;
    Ok(file.into_inner())
}

/// One part with layers by the names of its channels, as compositing programs write and read it.
fn exr_layers(
    picture: &Picture,
    layers: &[(String, Vec<[f32; 3]>)],
    facts: &[(String, String)],
) -> Result<Vec<u8>, EncodeError> {
    let channel = |name: &str, values: Vec<f32>| AnyChannel::new(name, FlatSamples::F32(values));
    let of_picture = |(index, name)| channel(name, picture.pixels.iter().map(|pixel| pixel[index]).collect());
    let of_layer = |(layer, pixels): &(String, Vec<[f32; 3]>)| {
        let one =
            |(index, name)| channel(&format!("{layer}.{name}"), pixels.iter().map(|pixel| pixel[index]).collect());
        ["R", "G", "B"].into_iter().enumerate().map(one).collect::<Vec<_>>()
    };
    let whole = ["R", "G", "B"].into_iter().enumerate().map(of_picture);
    let channels = AnyChannels::sort(whole.chain(layers.iter().flat_map(of_layer)).collect());
    let layer = Layer::new((picture.width as usize, picture.height as usize), attributes(facts), ENCODING, channels);
    let mut file = Cursor::new(Vec::new());
    Image::from_layer(layer).write().to_buffered(&mut file).map_err(failed)?;
    Ok(file.into_inner())
}

/// What an EXR says of itself.
fn attributes(facts: &[(String, String)]) -> LayerAttributes {
    // One attribute rather than one per fact: the library writes custom attributes in random order.
    let lines: Vec<String> = facts.iter().map(|(name, text)| format!("{name}: {text}")).collect();
    LayerAttributes {
        comments: Text::new_or_none(lines.join("\n")),
        software_name: Text::new_or_none("Candela"),
        ..LayerAttributes::default()
    }
}

fn eight_bits(picture: &Picture, params: &RenderParams) -> Vec<u8> {
    quantised(picture, params, |value| [(value * 255.0).round() as u8])
}

/// Display values of all pixels, RGB or RGBA, each turned into `N` bytes.
fn quantised<const N: usize>(
    picture: &Picture,
    params: &RenderParams,
    quantise: impl Fn(f32) -> [u8; N] + Sync,
) -> Vec<u8> {
    let channels = if params.output.transparent { 4 } else { 3 };
    let mut bytes = vec![0; picture.pixels.len() * channels * N];
    bytes.par_chunks_exact_mut(channels * N).zip(&picture.pixels).for_each(|(out, &pixel)| {
        let display = display_color(pixel.into(), params).to_array();
        for (out, value) in out.chunks_exact_mut(N).zip(display) {
            out.copy_from_slice(&quantise(value));
        }
    });
    bytes
}

/// sRGB values with straight alpha, 0 to 1, of a premultiplied scene-linear pixel.
fn display_color(pixel: Vec4, params: &RenderParams) -> Vec4 {
    let alpha = if params.output.transparent { pixel.w.clamp(0.0, 1.0) } else { 1.0 };
    if alpha == 0.0 {
        return Vec4::ZERO;
    }
    let radiance = pixel.truncate() / alpha * params.exposure.exp2();
    Vec3::from(tone_map(params.tone_mapping, radiance).to_array().map(srgb_encode)).extend(alpha)
}

fn failed(error: impl std::fmt::Display) -> EncodeError {
    EncodeError::Failed(error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::{OutputParams, ToneMapping};
    use std::time::Instant;

    fn params(bits: u8, transparent: bool) -> RenderParams {
        let output = OutputParams { format: ImageFormat::Png, bits, transparent };
        RenderParams { tone_mapping: ToneMapping::Linear, output, ..RenderParams::default() }
    }

    /// Top left red at half coverage, then grey 0.5, black, nothing.
    fn picture() -> Picture {
        let pixels = vec![[0.5, 0.0, 0.0, 0.5], [0.5, 0.5, 0.5, 1.0], [0.0, 0.0, 0.0, 1.0], [0.0; 4]];
        Picture { width: 2, height: 2, pixels }
    }

    /// Smooth shading with noise, as a render has.
    fn render_like(width: u32, height: u32) -> Picture {
        let noise =
            |i: u32| (i.wrapping_mul(747_796_405) ^ (i >> 5)).wrapping_mul(277_803_737) as f32 / u32::MAX as f32;
        let pixel = |i: u32| {
            let smooth = (i % width) as f32 / width as f32;
            let value = smooth * (1.0 + 0.04 * noise(i));
            [value, value * 0.8, 0.3, 1.0]
        };
        Picture { width, height, pixels: (0..width * height).map(pixel).collect() }
    }

    fn facts() -> Vec<(String, String)> {
        vec![("Candela-Error".into(), "0.0123 ± ü".into()), ("Candela-Samples".into(), "64".into())]
    }

    fn bytes(params: &RenderParams, format: ImageFormat) -> Vec<u8> {
        encode(&picture(), params, format, &facts()).unwrap()
    }

    #[test]
    fn png_has_pixels_colour_space_and_facts() {
        let file = bytes(&params(8, false), ImageFormat::Png);
        let mut reader = png::Decoder::new(Cursor::new(&file)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut pixels).unwrap();
        assert_eq!(pixels, [188, 0, 0, 188, 188, 188, 0, 0, 0, 0, 0, 0]);
        let info = reader.info();
        assert!(info.srgb.is_some());
        let read: Vec<_> =
            info.utf8_text.iter().map(|chunk| (chunk.keyword.clone(), chunk.get_text().unwrap())).collect();
        assert_eq!(read, facts());
    }

    #[test]
    fn png_alpha_is_straight() {
        let rgba = image::load_from_memory(&bytes(&params(8, true), ImageFormat::Png)).unwrap().to_rgba8();
        assert_eq!(rgba.get_pixel(0, 0).0, [255, 0, 0, 128]);
        assert_eq!(rgba.get_pixel(1, 1).0, [0; 4]);
    }

    #[test]
    fn png_of_16_bits_is_finer() {
        let rgb = image::load_from_memory(&bytes(&params(16, false), ImageFormat::Png)).unwrap().to_rgb16();
        assert_eq!(rgb.get_pixel(1, 0).0, [48192; 3]);
    }

    #[test]
    fn exposure_is_in_stops() {
        let params = RenderParams { exposure: 1.0, ..params(8, false) };
        let rgb = image::load_from_memory(&bytes(&params, ImageFormat::Png)).unwrap().to_rgb8();
        assert_eq!(rgb.get_pixel(1, 0).0, [255; 3]);
    }

    #[test]
    fn exr_holds_the_radiance_exactly() {
        use exr::prelude::{ReadChannels, ReadLayers, read};
        let picture = render_like(37, 21);
        let file = encode(&picture, &params(8, true), ImageFormat::Exr, &facts()).unwrap();
        let image = read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .first_valid_layer()
            .all_attributes()
            .from_buffered(Cursor::new(file))
            .unwrap();
        let layer = &image.layer_data;
        let red = layer.channel_data.list.iter().find(|c| c.name.eq("R")).unwrap();
        let FlatSamples::F32(red) = &red.sample_data else { panic!("samples are not f32") };
        assert!(red.iter().zip(&picture.pixels).all(|(file, pixel)| *file == pixel[0]));
        assert_eq!(layer.channel_data.list.len(), 4);
        let comments = layer.attributes.comments.as_ref().unwrap().to_string();
        assert!(comments.contains("Candela-Samples: 64"), "{comments}");
    }

    #[test]
    fn webp_is_lossless_and_jpeg_nearly_so() {
        let params = params(8, false);
        let exact = image::load_from_memory(&bytes(&params, ImageFormat::Png)).unwrap().to_rgb8();
        let webp = image::load_from_memory(&bytes(&params, ImageFormat::Webp)).unwrap().to_rgb8();
        assert_eq!(exact, webp);
        let wide = render_like(64, 32);
        let of = |format| image::load_from_memory(&encode(&wide, &params, format, &[]).unwrap()).unwrap().to_rgb8();
        let worst = of(ImageFormat::Png).iter().zip(of(ImageFormat::Jpeg).iter()).map(|(a, b)| a.abs_diff(*b)).max();
        assert!(worst < Some(24), "{worst:?}");
    }

    #[test]
    fn what_a_format_cannot_hold_is_refused() {
        let jpeg = encode(&picture(), &params(8, true), ImageFormat::Jpeg, &[]);
        assert!(matches!(jpeg, Err(EncodeError::Unsupported(_))));
        let long = Picture { width: 20_000, height: 1, pixels: vec![[0.0; 4]; 20_000] };
        assert!(matches!(encode(&long, &params(8, false), ImageFormat::Webp, &[]), Err(EncodeError::Unsupported(_))));
        assert!(encode(&long, &params(8, false), ImageFormat::Png, &[]).is_ok());
    }

    #[test]
    fn same_picture_same_bytes() {
        let picture = render_like(400, 300);
        for format in [ImageFormat::Png, ImageFormat::Exr, ImageFormat::Webp, ImageFormat::Jpeg] {
            let write = || {
                let begun = Instant::now();
                let file = encode(&picture, &params(8, false), format, &facts()).unwrap();
                eprintln!("{format:?}: {} bytes in {:?}", file.len(), begun.elapsed());
                file
            };
            assert_eq!(write(), write(), "{format:?}");
        }
    }
}
