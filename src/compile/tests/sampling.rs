//! Alias tables and environments: what is drawn with which probability.

use super::Random;
use crate::compile::alias::table;
use crate::compile::{ANY_FACING, ENVIRONMENT_PIXELS, Hdri, HdriError, TILES, decode_hdri, tile_of};
use std::f64::consts::{PI, TAU};
use std::io::Cursor;

#[test]
fn alias_tables_have_the_probabilities_of_their_weights() {
    let mut random = Random(11);
    for count in [1, 2, 3, 10, 1000] {
        let weights: Vec<f64> =
            (0..count).map(|i| if i % 7 == 3 { 0.0 } else { random.unit().powi(8) * 1e6 }).collect();
        let total: f64 = weights.iter().sum();
        let (entries, probabilities) = table(&weights);
        assert!((probabilities.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        for (weight, probability) in weights.iter().zip(&probabilities) {
            assert!((weight / total - probability).abs() < 1e-7 / count as f64, "{} {probability}", weight / total);
        }
        assert!(entries.iter().all(|entry| (0.0..=1.0).contains(&entry.keep) && (entry.alias as usize) < count));
    }
    let (_, uniform) = table(&[0.0; 4]);
    assert_eq!(uniform, [0.25; 4]);
    assert!(table(&[]).0.is_empty());
}

fn solid_angle(hdri: &Hdri, row: usize) -> f64 {
    let edge = |j: f64| (PI * j.clamp(0.0, f64::from(hdri.height)) / f64::from(hdri.height)).cos();
    TAU / f64::from(hdri.width) * (edge(row as f64 - 0.5) - edge(row as f64 + 0.5))
}

fn random_hdri(width: u32, height: u32) -> Hdri {
    let mut random = Random(3);
    let texels = (0..width * height).map(|_| [random.unit().powi(6) as f32 * 100.0, 0.1, 0.2]).collect();
    Hdri::new(width, height, texels)
}

/// Density over solid angle in a cell, for a surface of some facing.
fn density(hdri: &Hdri, facing: usize, cell: usize) -> f64 {
    let (width, rows) = (hdri.width as usize, hdri.height as usize + 1);
    let tile = tile_of(cell / width, rows, TILES[1]) * TILES[0] + tile_of(cell % width, width, TILES[0]);
    f64::from(hdri.facing(facing)[TILES[1] + tile].probability) * f64::from(hdri.cells[cell].pdf)
}

#[test]
fn environment_densities_integrate_to_one() {
    let black = Hdri::new(8, 4, vec![[0.0; 3]; 32]);
    assert!((0..black.cells.len()).all(|cell| (density(&black, ANY_FACING, cell) * 2.0 * TAU - 1.0).abs() < 1e-5));
    assert_eq!(black.power, 0.0);
    for (width, height) in [(1, 1), (2, 1), (16, 8), (64, 33)] {
        let hdri = random_hdri(width, height);
        assert_eq!(hdri.cells.len() as u32, width * (height + 1));
        let solid_angles: Vec<f64> =
            (0..hdri.cells.len()).map(|cell| solid_angle(&hdri, cell / width as usize)).collect();
        let sphere: f64 = solid_angles.iter().sum();
        assert!((sphere - 2.0 * TAU).abs() < 1e-9, "{sphere}");
        for facing in 0..=ANY_FACING {
            let parts = solid_angles.iter().enumerate().map(|(cell, angle)| density(&hdri, facing, cell) * angle);
            let integral: f64 = parts.sum();
            assert!((integral - 1.0).abs() < 1e-5, "{width} x {height}, facing {facing}: {integral}");
        }
    }
}

#[test]
fn environment_densities_follow_luminance() {
    let hdri = random_hdri(16, 8);
    let lum = |i: usize, j: usize| {
        let [r, g, b] = hdri.texels[j.min(7) * 16 + i % 16].map(f64::from);
        0.2126 * r + 0.7152 * g + 0.0722 * b
    };
    for cell in 0..hdri.cells.len() {
        let (i, j) = (cell % 16, cell / 16);
        let mean = [(0, j.saturating_sub(1)), (1, j.saturating_sub(1)), (0, j), (1, j)].map(|(di, j)| lum(i + di, j));
        let expected = mean.iter().sum::<f64>() / 4.0 / f64::from(hdri.power);
        let got = density(&hdri, ANY_FACING, cell);
        assert!((got / expected - 1.0).abs() < 1e-3, "cell {cell}: {got} {expected}");
    }
}

fn encoded(texels: &[[f32; 3]], width: u32, format: image::ImageFormat) -> Vec<u8> {
    let raw: Vec<f32> = texels.iter().flatten().copied().collect();
    let picture = image::Rgb32FImage::from_raw(width, texels.len() as u32 / width, raw).unwrap();
    let mut bytes = Cursor::new(Vec::new());
    image::DynamicImage::from(picture).write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

#[test]
fn pictures_decode_and_bad_texels_are_refused_with_their_place() {
    let texels = [[1.0, 2.0, 4.0], [0.5, 0.25, 0.125], [1000.0, 0.0, 8.0], [0.0; 3]];
    for format in [image::ImageFormat::Hdr, image::ImageFormat::OpenExr] {
        let hdri = decode_hdri(&encoded(&texels, 2, format), ENVIRONMENT_PIXELS).unwrap();
        assert_eq!((hdri.width, hdri.height), (2, 2));
        for (a, b) in hdri.texels.iter().flatten().zip(texels.iter().flatten()) {
            assert!((a - b).abs() <= 8.0, "{a} {b}");
        }
    }
    for (value, what) in [(f32::NAN, "not a number"), (-1.0, "negative"), (f32::INFINITY, "infinite")] {
        let mut bad = texels;
        bad[3][1] = value;
        let error = decode_hdri(&encoded(&bad, 2, image::ImageFormat::OpenExr), ENVIRONMENT_PIXELS).unwrap_err();
        assert_eq!(error, HdriError::Texel { x: 1, y: 1, what });
    }
    assert!(matches!(decode_hdri(b"not a picture", ENVIRONMENT_PIXELS), Err(HdriError::Undecodable(_))));
    let small = encoded(&[[1.0; 3]; 4], 2, image::ImageFormat::Hdr);
    assert_eq!(decode_hdri(&small, 3).unwrap_err(), HdriError::TooLarge { width: 2, height: 2, limit: 3 });
    assert!(matches!(decode_hdri(b"", ENVIRONMENT_PIXELS), Err(HdriError::Undecodable(_))));
}
