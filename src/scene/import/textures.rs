//! Samplers, textures and images.

use super::data::{Data, Located, locate};
use super::document;
use super::schema::{OtherSource, Root, Sampler};
use crate::scene::error::Warnings;
use crate::scene::{Image, Limits, Package, SceneError, Texture, Wrap, ktx2};
use image::{ImageFormat, ImageReader};
use std::io::Cursor;
use std::sync::Arc;

/// Textures that have an image.
pub(super) struct Textures {
    pub list: Vec<Texture>,
    /// By the file's index: index into `list`; none: the texture has no image that can be read.
    pub slots: Vec<Option<usize>>,
}

/// Reads textures with their samplers; references have been checked.
pub(super) fn read(root: &Root, warnings: &mut Warnings) -> Result<Textures, SceneError> {
    let samplers =
        root.samplers.iter().enumerate().map(|(index, source)| sampler(source, &format!("/samplers/{index}")));
    let samplers = samplers.collect::<Result<Vec<_>, _>>()?;
    let mut textures = Textures { list: Vec::new(), slots: Vec::new() };
    for (index, source) in root.textures.iter().enumerate() {
        let Some(image) = image_of(root, index)? else {
            let detail = "the texture has no image of a supported format (PNG, JPEG, WebP, KTX2) and is left out";
            warnings.add("texture_missing", format!("/textures/{index}"), detail);
            textures.slots.push(None);
            continue;
        };
        let sampler = source.sampler.and_then(|sampler| samplers.get(sampler));
        textures.slots.push(Some(textures.list.len()));
        textures.list.push(Texture { image, ..sampler.copied().unwrap_or_default() });
    }
    Ok(textures)
}

/// Extensions that name another image than the texture's own, the preferred one first.
const OTHER_SOURCES: [&str; 2] = ["KHR_texture_basisu", "EXT_texture_webp"];

/// The image that texture `index` shows: that of an extension, else its own.
fn image_of(root: &Root, index: usize) -> Result<Option<usize>, SceneError> {
    let Some(texture) = root.textures.get(index) else { return Ok(None) };
    let other = OTHER_SOURCES.iter().find_map(|name| Some((name, texture.extensions.get(*name)?)));
    let Some((name, content)) = other else { return Ok(texture.source) };
    let place = format!("/textures/{index}/extensions/{name}");
    let other: OtherSource = document::extension(content, &place)?;
    super::references::one(Some(other.source), root.images.len(), "image", || format!("{place}/source"))?;
    Ok(Some(other.source))
}

/// A texture without its image yet.
fn sampler(source: &Sampler, place: &str) -> Result<Texture, SceneError> {
    let invalid = |name: &str, code: u64, allowed: &str| {
        SceneError::invalid("sampler", format!("{place}/{name}"), format!("{code} is not one of {allowed}"))
    };
    let wrap = |code: Option<u64>, name| match code {
        None | Some(10497) => Ok(Wrap::Repeat),
        Some(33071) => Ok(Wrap::Clamp),
        Some(33648) => Ok(Wrap::Mirror),
        Some(code) => Err(invalid(name, code, "10497 (repeat), 33071 (clamp), 33648 (mirror)")),
    };
    let nearest = match source.mag_filter {
        None | Some(9729) => false,
        Some(9728) => true,
        Some(code) => return Err(invalid("magFilter", code, "9728 (nearest), 9729 (linear)")),
    };
    Ok(Texture { image: 0, wrap_u: wrap(source.wrap_s, "wrapS")?, wrap_v: wrap(source.wrap_t, "wrapT")?, nearest })
}

/// All images of the file; those `used` with their bytes, whose header has been read and found within the limits.
pub(super) fn images(
    data: &Data<'_>,
    package: &Package,
    used: &[bool],
    limits: &Limits,
) -> Result<Vec<Image>, SceneError> {
    let sources = &data.root.images;
    if sources.len() > limits.images {
        let detail = format!("the file has {} images, more than the limit of {}", sources.len(), limits.images);
        return Err(SceneError::too_large("images", "/images", detail));
    }
    let mut total = 0_u64;
    let mut images = Vec::new();
    for index in 0..sources.len() {
        let pointer = format!("/images/{index}");
        let is_used = used.get(index).copied().unwrap_or(false);
        let bytes = bytes(data, package, index, is_used)?;
        if is_used {
            let pixels = sniff(&bytes, &pointer)?;
            total = total.saturating_add(pixels);
            if pixels > limits.image_pixels || total > limits.total_image_pixels {
                let detail = format!(
                    "the image has {pixels} pixels ({total} with those before it); the limits are {} for one and {} for all; \
                     send smaller images",
                    limits.image_pixels, limits.total_image_pixels
                );
                return Err(SceneError::too_large("image_pixels", pointer, detail));
            }
        }
        images.push(Image { bytes, pointer });
    }
    Ok(images)
}

/// The encoded bytes; empty if the image is not used, but a file that it names must be there all the same.
fn bytes(data: &Data<'_>, package: &Package, index: usize, is_used: bool) -> Result<Arc<[u8]>, SceneError> {
    let pointer = format!("/images/{index}");
    let source = data.root.images.get(index);
    let uri = source.and_then(|source| source.uri.as_deref());
    let is_inline = uri.and_then(|uri| uri.get(..5)).is_some_and(|scheme| scheme.eq_ignore_ascii_case("data:"));
    match (uri, source.and_then(|source| source.buffer_view)) {
        (Some(uri), _) if is_used || !is_inline => match locate(uri, &format!("{pointer}/uri"), package)? {
            Located::Inline(bytes) => Ok(bytes.into()),
            Located::File(bytes) => Ok(bytes.clone()),
        },
        (None, Some(view)) if is_used => Ok(data.view(view)?.into()),
        (None, None) if is_used => {
            let detail = "the image has neither a `uri` nor a `bufferView`";
            Err(SceneError::invalid("image_missing", pointer, detail))
        }
        _ => Ok(Arc::default()),
    }
}

/// Reads the header; the number of pixels.
fn sniff(bytes: &[u8], pointer: &str) -> Result<u64, SceneError> {
    let broken = |why: String| SceneError::invalid("image_broken", pointer, why);
    let (width, height) = if ktx2::is_ktx2(bytes) { ktx2::size(bytes).map_err(broken)? } else { size(bytes, pointer)? };
    if width == 0 || height == 0 {
        return Err(broken("the image has no pixels".to_owned()));
    }
    Ok(u64::from(width) * u64::from(height))
}

fn size(bytes: &[u8], pointer: &str) -> Result<(u32, u32), SceneError> {
    let mut reader = ImageReader::new(Cursor::new(bytes));
    match image::guess_format(bytes) {
        Ok(format @ (ImageFormat::Png | ImageFormat::Jpeg | ImageFormat::WebP)) => reader.set_format(format),
        _ => {
            let detail = "the image is neither PNG, JPEG, WebP nor KTX2; convert it";
            return Err(SceneError::invalid("image_format", pointer, detail));
        }
    }
    reader.into_dimensions().map_err(|error| {
        SceneError::invalid("image_broken", pointer, format!("the header of the image cannot be read: {error}"))
    })
}

#[cfg(test)]
mod tests {
    use crate::scene::import::testing::{Builder, PNG, error_of, scene_of};
    use crate::scene::{Limits, Wrap, import};
    use serde_json::{Value, json};

    /// A triangle whose base colour is texture 0.
    fn textured(textures: Value, images: Value) -> Builder {
        let mut builder = Builder::triangle();
        builder.attribute("TEXCOORD_0", &[0.0_f32; 6], "VEC2");
        builder.json["materials"] = json!([{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]);
        builder.json["meshes"][0]["primitives"][0]["material"] = json!(0);
        builder.json["textures"] = textures;
        builder.json["images"] = images;
        builder
    }

    fn data_uri(bytes: &[u8]) -> String {
        bytes.iter().fold("data:,".to_owned(), |uri, byte| uri + &format!("%{byte:02x}"))
    }

    #[test]
    fn samplers_and_images_are_read() {
        let mut builder = textured(
            json!([{"source": 1, "sampler": 0}, {}]),
            json!([{"uri": "data:,unused"}, {"uri": data_uri(PNG)}]),
        );
        builder.json["samplers"] = json!([{"wrapS": 33071, "wrapT": 33648, "magFilter": 9728, "minFilter": 9987}]);
        let scene = scene_of(&builder);
        let texture = scene.textures[0];
        assert_eq!(
            (texture.image, texture.wrap_u, texture.wrap_v, texture.nearest),
            (1, Wrap::Clamp, Wrap::Mirror, true)
        );
        assert_eq!(
            (scene.images[0].bytes.len(), scene.images[1].bytes.as_ref()),
            (0, PNG),
            "unused images are not kept"
        );
        assert_eq!(scene.textures.len(), 1);
        assert!(scene.warnings.iter().any(|warning| warning.pointer == "/textures/1"));
        builder.json["samplers"][0]["wrapS"] = json!(1);
        assert_eq!(error_of(&builder).pointer, "/samplers/0/wrapS");
    }

    #[test]
    fn webp_textures_win_over_their_fallback() {
        let textures = json!([{"source": 0, "extensions": {"EXT_texture_webp": {"source": 1}}}]);
        let scene = scene_of(&textured(textures, json!([{"uri": "data:,x"}, {"uri": data_uri(PNG)}])));
        assert_eq!(scene.textures[0].image, 1);
    }

    #[test]
    fn ktx2_textures_win_over_all_others() {
        let others = json!({"EXT_texture_webp": {"source": 0}, "KHR_texture_basisu": {"source": 1}});
        let textures = json!([{"source": 0, "extensions": others}]);
        let file = crate::scene::ktx2::tests::two_colors([[9; 4]; 2]);
        let scene = scene_of(&textured(textures, json!([{"uri": "data:,x"}, {"uri": data_uri(&file)}])));
        assert_eq!((scene.textures[0].image, scene.images[1].bytes.as_ref()), (1, file.as_slice()));
    }

    #[test]
    fn bad_images_are_refused() {
        let fault = |image: Value| {
            let fault = error_of(&textured(json!([{"source": 0}]), json!([image])));
            (fault.code, fault.pointer)
        };
        assert_eq!(fault(json!({"uri": "gone.png"})), ("uri_missing", "/images/0/uri".into()));
        assert_eq!(fault(json!({})), ("image_missing", "/images/0".into()));
        assert_eq!(fault(json!({"uri": "data:,GIF89a"})), ("image_format", "/images/0".into()));
        assert_eq!(fault(json!({"uri": data_uri(&PNG[..20])})), ("image_broken", "/images/0".into()));
        let package = textured(json!([{"source": 0}]), json!([{"uri": data_uri(PNG)}])).package();
        let limits = Limits { image_pixels: 1, ..Limits::default() };
        assert_eq!(import(&package, &limits).unwrap_err().code, "image_pixels");
        let mut unused = textured(json!([{"source": 0}]), json!([{"uri": data_uri(PNG)}, {"uri": "gone.png"}]));
        assert_eq!(error_of(&unused).pointer, "/images/1/uri", "a missing file is missing even if unused");
        unused.json["images"] = json!([{"uri": data_uri(PNG)}, {"uri": "data:,GIF89a"}]);
        scene_of(&unused);
    }
}
