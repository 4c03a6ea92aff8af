//! URIs of a glTF: `data:` (RFC 2397) and relative references (RFC 3986).

use base64::Engine as _;
use base64::engine::general_purpose::{STANDARD_PAD_INDIFFERENT, URL_SAFE_PAD_INDIFFERENT};

/// What a URI is.
#[derive(Debug, PartialEq, Eq)]
pub(in crate::scene) enum Uri<'a> {
    /// Its bytes.
    Data(Vec<u8>),
    /// A relative reference, still percent-encoded.
    Relative(&'a str),
    /// It names a scheme or a host: never fetched.
    External,
    /// A `data:` URI that cannot be read, and why.
    Broken(String),
}

/// Reads a URI; nothing is fetched.
pub(in crate::scene) fn parse(uri: &str) -> Uri<'_> {
    if uri.get(..5).is_some_and(|scheme| scheme.eq_ignore_ascii_case("data:")) {
        return data(uri.get(5..).unwrap_or_default());
    }
    let scheme = uri.split_once(':').map(|(scheme, _)| scheme);
    // One letter before a colon is a drive, which is as unreachable, but not worth another word.
    if uri.starts_with("//") || scheme.is_some_and(is_scheme) { Uri::External } else { Uri::Relative(uri) }
}

fn is_scheme(text: &str) -> bool {
    text.starts_with(|c: char| c.is_ascii_alphabetic())
        && text.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '+' | '-' | '.'))
}

fn data(rest: &str) -> Uri<'_> {
    let Some((media_type, payload)) = rest.split_once(',') else {
        return Uri::Broken("the data URI has no comma between its media type and its data".into());
    };
    let bytes: Vec<u8> = percent_encoding::percent_decode_str(payload).collect();
    if !media_type.to_ascii_lowercase().trim_end().ends_with(";base64") {
        return Uri::Data(bytes);
    }
    let packed: Vec<u8> = bytes.into_iter().filter(|byte| !byte.is_ascii_whitespace()).collect();
    let decoded = STANDARD_PAD_INDIFFERENT.decode(&packed).or_else(|error| {
        // Some writers use the alphabet for URLs; the first error is the one worth telling.
        URL_SAFE_PAD_INDIFFERENT.decode(&packed).map_err(|_| error)
    });
    decoded.map_or_else(|error| Uri::Broken(format!("the data URI is not base64: {error}")), Uri::Data)
}

/// Percent-decoded, if the result is text; without query and fragment.
pub(in crate::scene) fn decode(uri: &str) -> String {
    let path = uri.split(['?', '#']).next().unwrap_or(uri);
    percent_encoding::percent_decode_str(path).decode_utf8().map_or_else(|_| path.to_owned(), Into::into)
}

/// `path` as seen from `folder`, without `.` and `..`; none if it leaves the outermost folder.
pub(in crate::scene) fn join(folder: &str, path: &str) -> Option<String> {
    let mut segments: Vec<&str> = Vec::new();
    for segment in folder.split('/').chain(path.split(['/', '\\'])) {
        match segment {
            "" | "." => {}
            ".." => {
                segments.pop()?;
            }
            name => segments.push(name),
        }
    }
    Some(segments.join("/"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_uris() {
        let data = |uri| match parse(uri) {
            Uri::Data(bytes) => String::from_utf8(bytes).unwrap(),
            other => panic!("{uri}: {other:?}"),
        };
        assert_eq!(data("data:application/octet-stream;base64,aGVsbG8="), "hello");
        assert_eq!(data("data:;base64,aGVsbG8"), "hello", "no padding");
        assert_eq!(data("DATA:text/plain;BASE64,aGVs%0AbG8%3D"), "hello", "encoded base64");
        assert_eq!(data("data:text/plain,a%20b%2c"), "a b,");
        assert_eq!(data("data:,"), "");
        assert_eq!(data("data:;base64,"), "");
        assert_eq!(data("data:;base64,Pz8_"), "???", "URL alphabet");
        assert!(matches!(parse("data:text/plain;base64"), Uri::Broken(_)));
        assert!(matches!(parse("data:;base64,a"), Uri::Broken(_)));
        assert!(matches!(parse("data:;base64,***"), Uri::Broken(_)));
    }

    #[test]
    fn schemes_are_external() {
        for uri in ["http://a/b", "https:x", "file:///etc/passwd", "//host/x", "C:/x.bin"] {
            assert_eq!(parse(uri), Uri::External, "{uri}");
        }
        assert_eq!(parse("a b/c:d.bin"), Uri::Relative("a b/c:d.bin"));
        assert_eq!(parse("é.bin"), Uri::Relative("é.bin"));
    }

    #[test]
    fn joined_paths_stay_inside() {
        assert_eq!(join("m", "../t/x.png").as_deref(), Some("t/x.png"));
        assert_eq!(join("m", "../../x"), None);
        assert_eq!(join("", "a\\b").as_deref(), Some("a/b"));
    }
}
