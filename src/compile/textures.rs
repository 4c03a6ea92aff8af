//! Images -> pages of RGBA8 texels. Images of 16 bits per channel are rounded to 8, those of heights keep them.

use super::atlas::{self, Place};
use super::look::Look;
use super::{TexturePages, TextureSlot};
use crate::scene::{SceneError, SceneErrorKind, TextureRef, Wrap, ktx2};
use image::{DynamicImage, ImageFormat, ImageReader, Limits, RgbaImage};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::io::Cursor;
use std::time::Instant;

/// Largest side of an image.
const MAX_SIDE: u32 = 8192;
/// Smallest side of a page.
const MIN_PAGE: u32 = 256;
/// Pages are made large enough that about this many hold everything.
const FEW_PAGES: f64 = 4.0;
/// Most texels of all images together.
const MAX_TEXELS: u64 = 1 << 29;
/// Most bytes that decoding one image may take.
const MAX_ALLOC: u64 = 1 << 30;

/// How texels are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Space {
    /// Colour: sRGB.
    Color,
    /// Numbers: linear.
    Data,
    /// Heights: grey of 16 bits in two channels, red times 256 and green; among the numbers' pages.
    Height,
}

/// RGBA8 by image, and whether it is read as heights.
type Decoded = BTreeMap<(bool, usize), Vec<u8>>;

/// Decoded images in pages.
#[derive(Debug, Default)]
pub struct Textures {
    /// Colours.
    pub color: TexturePages,
    /// Numbers.
    pub data: TexturePages,
    /// Images decoded.
    pub decoded: u64,
    /// Time it took.
    pub seconds: f64,
    places: BTreeMap<(Space, usize), (Place, (u32, u32))>,
}

impl Textures {
    /// Decodes the images behind the given uses and packs them, each once per space.
    pub fn decode(look: &Look, uses: &[(Space, TextureRef)]) -> Result<Self, SceneError> {
        let start = Instant::now();
        let wanted: BTreeSet<(Space, usize)> =
            uses.iter().map(|(space, use_)| Ok((*space, image_of(look, use_)?))).collect::<Result<_, SceneError>>()?;
        let images: BTreeSet<usize> = wanted.iter().map(|(_, image)| *image).collect();
        let sizes: BTreeMap<usize, (u32, u32)> =
            images.iter().map(|image| Ok((*image, size(look, *image)?))).collect::<Result<_, SceneError>>()?;
        check_total(&sizes)?;
        // An image is decoded once for colours and numbers, and once for heights.
        let codes: BTreeSet<(bool, usize)> = wanted.iter().map(|(s, image)| (*s == Space::Height, *image)).collect();
        let pixels = |&(height, image): &(bool, usize)| Ok(((height, image), pixels(look, image, height)?));
        let decoded: Decoded = codes.par_iter().map(pixels).collect::<Result<_, SceneError>>()?;
        let mut textures = Self { decoded: decoded.len() as u64, ..Self::default() };
        for pages in [&[Space::Color][..], &[Space::Data, Space::Height]] {
            let images: Vec<(Space, usize)> =
                wanted.iter().filter(|(space, _)| pages.contains(space)).copied().collect();
            textures.fill(&images, &sizes, &decoded);
        }
        textures.seconds = start.elapsed().as_secs_f64();
        Ok(textures)
    }

    fn fill(&mut self, images: &[(Space, usize)], sizes: &BTreeMap<usize, (u32, u32)>, decoded: &Decoded) {
        let Some((first, _)) = images.first() else { return };
        let sizes: Vec<(u32, u32)> = images.iter().map(|(_, image)| sizes[image]).collect();
        let page_size = page_size(&sizes);
        let (places, count) = atlas::pack(&sizes, page_size);
        let mut pages = vec![vec![0; page_size as usize * page_size as usize * 4]; count as usize];
        for (((space, image), place), (width, height)) in images.iter().zip(&places).zip(&sizes) {
            let row_bytes = *width as usize * 4;
            for (y, row) in decoded[&(*space == Space::Height, *image)].chunks_exact(row_bytes).enumerate() {
                let start = ((place.y as usize + y) * page_size as usize + place.x as usize) * 4;
                pages[place.page as usize][start..start + row_bytes].copy_from_slice(row);
            }
            self.places.insert((*space, *image), (*place, (*width, *height)));
        }
        *self.pages_mut(*first) = TexturePages { page_size, pages };
    }

    fn pages_mut(&mut self, space: Space) -> &mut TexturePages {
        match space {
            Space::Color => &mut self.color,
            Space::Data | Space::Height => &mut self.data,
        }
    }

    /// The slot of a use; none: no texture.
    pub fn slot(&self, look: &Look, space: Space, use_: Option<TextureRef>) -> TextureSlot {
        let Some(use_) = use_ else { return TextureSlot::default() };
        let texture = look.textures[use_.texture];
        let Some((place, (width, height))) = self.places.get(&(space, texture.image)) else {
            return TextureSlot::default();
        };
        let info = place.page
            | (use_.uv_set as u32 & 1) << 16
            | wrap_code(texture.wrap_u) << 17
            | wrap_code(texture.wrap_v) << 19
            | u32::from(texture.nearest) << 21;
        TextureSlot {
            row_u: use_.transform.row(0).to_array(),
            info,
            row_v: use_.transform.row(1).to_array(),
            corner: place.x | place.y << 16,
            size: (width - 1) | (height - 1) << 16,
            pad: [0; 3],
        }
    }
}

fn wrap_code(wrap: Wrap) -> u32 {
    match wrap {
        Wrap::Repeat => 0,
        Wrap::Clamp => 1,
        Wrap::Mirror => 2,
    }
}

/// The image of a texture.
fn image_of(look: &Look, use_: &TextureRef) -> Result<usize, SceneError> {
    let pointer = || format!("/textures/{}", use_.texture);
    let missing = |detail: &str| super::walk::invalid("texture_out_of_range", &pointer(), detail);
    let texture = look.textures.get(use_.texture).ok_or_else(|| missing("the file has no such texture"))?;
    look.images.get(texture.image).map(|_| texture.image).ok_or_else(|| missing("its image does not exist"))
}

fn reader(look: &Look, image: usize) -> Result<ImageReader<Cursor<&[u8]>>, SceneError> {
    let image = &look.images[image];
    let mut reader = ImageReader::new(Cursor::new(&*image.bytes))
        .with_guessed_format()
        .map_err(|error| fault(SceneErrorKind::Malformed, &image.pointer, &error.to_string()))?;
    reader.limits(limits());
    Ok(reader)
}

fn limits() -> Limits {
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_SIDE);
    limits.max_image_height = Some(MAX_SIDE);
    limits.max_alloc = Some(MAX_ALLOC);
    limits
}

fn size(look: &Look, image: usize) -> Result<(u32, u32), SceneError> {
    let (bytes, pointer) = (&look.images[image].bytes, &look.images[image].pointer);
    let (width, height) = if ktx2::is_ktx2(bytes) {
        ktx2::size(bytes).map_err(|why| unreadable(pointer, &why))?
    } else {
        reader(look, image)?.into_dimensions().map_err(|error| undecodable(pointer, &error))?
    };
    if width == 0 || height == 0 {
        return Err(fault(SceneErrorKind::Invalid, pointer, "the image has no texels"));
    }
    if width.max(height) > MAX_SIDE {
        let detail = format!("the image is {width} x {height}; at most {MAX_SIDE} texels a side are read: shrink it");
        return Err(fault(SceneErrorKind::TooLarge, pointer, &detail));
    }
    Ok((width, height))
}

/// Pixels across and down of a map; none: it has no format of maps.
///
/// # Errors
/// It cannot be decoded, or says in its header that it has more than `most` pixels.
pub fn map_size(bytes: &[u8], most: u64) -> Option<Result<(u32, u32), String>> {
    let format = image::guess_format(bytes).ok()?;
    if !matches!(format, ImageFormat::Png | ImageFormat::Jpeg | ImageFormat::WebP) {
        return None;
    }
    let open = || ImageReader::with_format(Cursor::new(bytes), format);
    let size = open().into_dimensions().map_err(|error| why(&error));
    Some(size.and_then(|(width, height)| {
        if width.max(height) > MAX_SIDE || u64::from(width) * u64::from(height) > most {
            return Err(format!(
                "the image is {width} x {height}; at most {MAX_SIDE} a side and {most} in all are read"
            ));
        }
        // All of it, so that one that is cut off is refused here and not by each render that names it.
        let mut reader = open();
        reader.limits(limits());
        reader.decode().map(|_| (width, height)).map_err(|error| why(&error))
    }))
}

/// What is wrong with an image, in words of those who made it.
pub(super) fn why(error: &image::ImageError) -> String {
    let said = error.to_string();
    let is_cut = matches!(error, image::ImageError::IoError(error) if error.kind() == std::io::ErrorKind::UnexpectedEof)
        || ["end of file", "EOF", "UnexpectedEnd", "fill whole buffer"].iter().any(|word| said.contains(word));
    if is_cut {
        "the image cannot be decoded: it ends before its last row, so it was cut off; send the whole file".to_owned()
    } else {
        format!("the image cannot be decoded: {said}; export it again as PNG, JPEG or WebP")
    }
}

fn decoded(look: &Look, image: usize) -> Result<DynamicImage, SceneError> {
    let (bytes, pointer) = (&look.images[image].bytes, &look.images[image].pointer);
    if !ktx2::is_ktx2(bytes) {
        return reader(look, image)?.decode().map_err(|error| undecodable(pointer, &error));
    }
    let (width, height) = size(look, image)?;
    let texels = ktx2::decode(bytes).map_err(|why| unreadable(pointer, &why))?;
    let image = RgbaImage::from_raw(width, height, texels);
    image.map(DynamicImage::from).ok_or_else(|| unreadable(pointer, "its texels do not fill it"))
}

fn pixels(look: &Look, image: usize, height: bool) -> Result<Vec<u8>, SceneError> {
    let decoded = decoded(look, image)?;
    if !height {
        return Ok(decoded.into_rgba8().into_raw());
    }
    let texel = |grey: u16| [(grey >> 8) as u8, (grey & 0xff) as u8, 0, 255];
    Ok(decoded.into_luma16().into_raw().into_iter().flat_map(texel).collect())
}

fn check_total(sizes: &BTreeMap<usize, (u32, u32)>) -> Result<(), SceneError> {
    let total: u64 = sizes.values().map(|(w, h)| u64::from(*w) * u64::from(*h)).sum();
    if total <= MAX_TEXELS {
        return Ok(());
    }
    let detail = format!("the images in use have {total} texels together; at most {MAX_TEXELS} are read: shrink them");
    Err(fault(SceneErrorKind::TooLarge, "/images", &detail))
}

fn page_size(sizes: &[(u32, u32)]) -> u32 {
    let largest = sizes.iter().map(|(w, h)| *w.max(h)).max().unwrap_or(1);
    let area: f64 = sizes.iter().map(|(w, h)| f64::from(*w) * f64::from(*h)).sum();
    let roomy = (area / FEW_PAGES).sqrt() as u32;
    largest.max(roomy).next_power_of_two().clamp(MIN_PAGE, MAX_SIDE)
}

fn undecodable(pointer: &str, error: &image::ImageError) -> SceneError {
    let kind = match error {
        image::ImageError::Limits(_) => SceneErrorKind::TooLarge,
        image::ImageError::Unsupported(_) => SceneErrorKind::Invalid,
        _ => SceneErrorKind::Malformed,
    };
    fault(kind, pointer, &why(error))
}

/// A fault of a KTX2 file.
fn unreadable(pointer: &str, why: &str) -> SceneError {
    fault(SceneErrorKind::Malformed, pointer, &format!("the image cannot be decoded: {why}; export it again"))
}

fn fault(kind: SceneErrorKind, pointer: &str, detail: &str) -> SceneError {
    let code = if kind == SceneErrorKind::TooLarge { "image_too_large" } else { "image_undecodable" };
    SceneError { kind, code, pointer: pointer.into(), detail: detail.into() }
}
