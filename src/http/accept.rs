//! Which format of a picture a client wants.

use crate::jobs::{Code, Problem};
use crate::params::ImageFormat;
use axum::http::{HeaderMap, header};

/// The formats, with their media types.
const FORMATS: [(ImageFormat, &str); 4] = [
    (ImageFormat::Png, "image/png"),
    (ImageFormat::Exr, "image/x-exr"),
    (ImageFormat::Webp, "image/webp"),
    (ImageFormat::Jpeg, "image/jpeg"),
];

/// Media type of a format.
pub fn media_type(format: ImageFormat) -> &'static str {
    FORMATS.iter().find(|(known, _)| *known == format).map_or("application/octet-stream", |(_, name)| name)
}

/// The format that `Accept` likes best; `usual` where it leaves the choice (or is absent).
pub fn picture_format(headers: &HeaderMap, usual: ImageFormat) -> Result<ImageFormat, Problem> {
    let ranges = ranges(headers);
    if ranges.is_empty() {
        return Ok(usual);
    }
    let candidates = FORMATS.iter().map(|(format, name)| (*format, quality(&ranges, name)));
    let best = candidates.clone().map(|(_, quality)| quality).fold(0.0, f32::max);
    let mut liked = candidates.filter(|(_, quality)| best > 0.0 && *quality == best).map(|(format, _)| format);
    let first = liked.clone().next();
    let chosen = if liked.any(|format| format == usual) { Some(usual) } else { first };
    chosen.ok_or_else(|| {
        let detail = "this server makes image/png, image/x-exr, image/webp and image/jpeg; ask for one in `Accept`";
        Problem::new(Code::NotAcceptable, detail)
    })
}

/// Whether `Accept` allows a format.
pub fn takes(headers: &HeaderMap, format: ImageFormat) -> bool {
    let ranges = ranges(headers);
    ranges.is_empty() || quality(&ranges, media_type(format)) > 0.0
}

/// The media ranges of `Accept` with their qualities.
fn ranges(headers: &HeaderMap) -> Vec<(String, f32)> {
    let lines = headers.get_all(header::ACCEPT).iter().filter_map(|value| value.to_str().ok());
    lines.flat_map(|line| line.split(',')).filter_map(range).collect()
}

/// A media range, in lower case, and its quality.
fn range(text: &str) -> Option<(String, f32)> {
    let text = text.to_ascii_lowercase();
    let mut parts = text.split(';').map(str::trim);
    let name = parts.next().filter(|name| name.contains('/'))?.to_owned();
    let quality = parts.find_map(|part| value_of(part, "q")).map_or(Some(1.0), |q| q.parse().ok())?;
    Some((name, quality))
}

/// The value of `name = value`, the name in any case.
fn value_of<'a>(text: &'a str, name: &str) -> Option<&'a str> {
    let (key, value) = text.split_once('=')?;
    key.trim().eq_ignore_ascii_case(name).then(|| value.trim())
}

/// Quality of a media type: that of the most exact range that covers it.
fn quality(ranges: &[(String, f32)], name: &str) -> f32 {
    let of = |wanted: &str| ranges.iter().find(|(range, _)| range == wanted).map(|(_, quality)| *quality);
    of(name).or_else(|| of("image/*")).or_else(|| of("*/*")).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn accept(value: &str) -> Result<ImageFormat, Problem> {
        let mut headers = HeaderMap::new();
        headers.insert(header::ACCEPT, value.parse().unwrap());
        picture_format(&headers, ImageFormat::Webp)
    }

    #[test]
    fn the_best_liked_format_is_made() {
        assert_eq!(accept("image/png"), Ok(ImageFormat::Png));
        assert_eq!(accept("image/png;q=0.5, image/x-exr"), Ok(ImageFormat::Exr));
        assert_eq!(accept("*/*"), Ok(ImageFormat::Webp));
        assert_eq!(accept("text/html,image/*;q=0.8,*/*;q=0.1"), Ok(ImageFormat::Webp));
        assert_eq!(accept("image/*, image/webp;q=0"), Ok(ImageFormat::Png));
        for none in ["text/html", "image/png;q=0", "image/png;Q=0", "image/png; q = 0.0", "*/*;q=0", "image/*;q=0"] {
            assert_eq!(accept(none).unwrap_err().status, 406, "{none}");
        }
        assert_eq!(accept("image/webp;Q=0, */*"), Ok(ImageFormat::Png));
        assert_eq!(picture_format(&HeaderMap::new(), ImageFormat::Exr), Ok(ImageFormat::Exr));
    }
}
