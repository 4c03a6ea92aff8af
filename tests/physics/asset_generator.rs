//! The groups of the glTF Asset Generator: each member shows what the group's README says that it adds.
//! Members that say the same in other words are the same picture; members that say something else are another one.

use super::support::{params, render, work};
use candela::film::Picture;
use candela::params::EngineChoice;
use candela::scene::{self, Limits, Package};
use std::path::PathBuf;

/// What storing a number in 8 bits may change of a picture, at most.
const ROUNDING: f64 = 0.02;

/// A group's folder; none: the assets are not here.
fn group(name: &str) -> Option<Group> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/assets/asset-generator").join(name);
    if !folder.exists() {
        eprintln!("SKIPPED: ../shared/assets/asset-generator is not here");
        return None;
    }
    let manifest = std::fs::read(folder.join("Manifest.json")).expect("a manifest");
    let manifest: serde_json::Value = serde_json::from_slice(&manifest).expect("JSON");
    Some(Group { folder, manifest })
}

struct Group {
    folder: PathBuf,
    manifest: serde_json::Value,
}

impl Group {
    /// Member `index` from the camera of its sample image; `extra` is another camera, if any.
    fn seen(&self, index: usize, extra: &str) -> Picture {
        let model = &self.manifest["models"][index];
        let file = self.folder.join(model["fileName"].as_str().expect("a file name"));
        let limits = Limits::default();
        let scene = scene::import(&Package::from_path(&file, &limits).expect("a package"), &limits).expect("a scene");
        let at: Vec<f64> = serde_json::from_value(model["camera"]["translation"].clone()).expect("a camera");
        let light = r#""lights":[{"type":"directional","direction":[0.3,-0.5,-1],"intensity":2}]"#;
        let camera = format!(r#""camera":{{"position":{at:?},"target":[0,0,0]}}"#);
        let common = r#""environment":{"constant":[0.4,0.4,0.4],"visible":false},"max_samples":32,"adaptive":false"#;
        let camera = if extra.is_empty() { &camera } else { extra };
        let params = params(&format!(r#"{{{common},{light},{camera},"output":{{"transparent":true}}}}"#));
        render(EngineChoice::Cpu, work(&scene, &params))
    }

    fn all(&self, members: &[usize]) -> Vec<Picture> {
        members.iter().map(|index| self.seen(*index, "")).collect()
    }

    /// Asserts that members are the same picture, but for a mean difference.
    #[track_caller]
    fn same(&self, members: &[usize], tolerance: f64) {
        let pictures = self.all(members);
        assert!(covered(&pictures[0]) > 0.05, "member {} shows something", members[0]);
        for (member, picture) in members.iter().zip(&pictures).skip(1) {
            let found = difference(&pictures[0], picture);
            assert!(found <= tolerance, "members {} and {member} differ by {found}", members[0]);
        }
    }

    /// Asserts that each of `members` is another picture than `from`.
    #[track_caller]
    fn other(&self, from: usize, members: &[usize]) {
        let first = self.seen(from, "");
        for member in members {
            let found = difference(&first, &self.seen(*member, ""));
            assert!(found > 0.01, "members {from} and {member} differ by {found} only");
        }
    }
}

/// Mean absolute difference of all channels, relative to the first picture's mean.
fn difference(a: &Picture, b: &Picture) -> f64 {
    let channels = |picture: &Picture| picture.pixels.iter().flatten().copied().map(f64::from).collect::<Vec<_>>();
    let (a, b) = (channels(a), channels(b));
    let differing: f64 = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).sum();
    differing / a.iter().sum::<f64>().max(1e-9)
}

/// Part of the picture that something covers.
fn covered(picture: &Picture) -> f64 {
    super::support::mean(picture, 3)
}

#[test]
fn skins_of_all_component_types_are_the_same() {
    let Some(group) = group("Animation_SkinType") else { return };
    group.same(&[0, 3], 0.0);
    group.same(&[0, 1, 2], ROUNDING);
}

#[test]
fn interleaved_attributes_of_all_types_are_the_same() {
    let Some(group) = group("Buffer_Interleaved") else { return };
    group.same(&[0, 1, 2, 3, 4], ROUNDING);
}

#[test]
fn vertex_colours_of_all_types_are_the_same() {
    let Some(group) = group("Mesh_PrimitiveVertexColor") else { return };
    group.same(&[0, 3], 0.0);
    group.same(&[0, 1, 2, 4, 5], ROUNDING);
}

#[test]
fn modes_of_triangles_are_the_same_and_others_draw_nothing() {
    let Some(group) = group("Mesh_PrimitiveMode") else { return };
    // Where the square is cut along its other diagonal, rounding may differ.
    group.same(&[6, 4, 5, 11, 12, 13, 14, 15], 1e-3);
    group.same(&[13, 14, 15], 0.0);
    for points_and_lines in [0, 1, 2, 3, 7, 8, 9, 10] {
        assert_eq!(covered(&group.seen(points_and_lines, "")), 0.0, "member {points_and_lines}");
    }
}

#[test]
fn materials_show_what_they_add() {
    let Some(group) = group("Material") else { return };
    // Occlusion is found by tracing, not read.
    group.same(&[0, 2, 5], 0.0);
    group.other(0, &[1, 3, 4, 6, 7]);
    group.other(1, &[4]);
    group.other(3, &[6]);
}

#[test]
fn alpha_masks_cover_less_the_higher_the_cutoff() {
    let Some(group) = group("Material_AlphaMask") else { return };
    // Cut-offs relative to the texture's alpha: none, 0.4, 0.5, 0.4/0.7, 0.7, 0.6/0.7, above 1.
    let coverage: Vec<f64> = [4, 1, 0, 5, 2, 6, 3].map(|member| covered(&group.seen(member, ""))).to_vec();
    assert!(coverage.is_sorted_by(|more, less| more >= less), "{coverage:?}");
    assert!(coverage[0] > coverage[5] && coverage[5] > 0.0, "{coverage:?}");
    assert_eq!(coverage[6], 0.0, "a cut-off above 1 leaves nothing");
}

#[test]
fn double_sided_materials_are_seen_from_behind() {
    let Some(group) = group("Material_DoubleSided") else { return };
    let behind = r#""camera":{"position":[0,0,-1.3],"target":[0,0,0]}"#;
    for member in 0..4 {
        let (front, back) = (group.seen(member, ""), group.seen(member, behind));
        assert!((covered(&front) - covered(&back)).abs() < 0.05, "member {member}");
        assert!(super::support::mean(&back, 1) > 0.02, "member {member} is lit from behind by the sky");
    }
    group.same(&[0, 1], 1e-3);
    group.same(&[2, 3], ROUNDING);
    group.other(1, &[2]);
}

#[test]
fn metals_show_what_they_add() {
    let Some(group) = group("Material_MetallicRoughness") else { return };
    group.other(0, &[1, 2, 3, 4, 5, 6]);
    group.other(2, &[7, 8]);
    group.other(4, &[9, 10]);
    group.other(7, &[11]);
}

#[test]
fn samplers_wrap_and_filter() {
    let Some(group) = group("Texture_Sampler") else { return };
    // How a texture is made smaller is for rasterizers.
    group.same(&[0, 6, 7, 8, 9, 10, 11, 12], 0.0);
    group.other(0, &[1, 2, 3, 4]);
    group.other(1, &[2, 3]);
    group.other(3, &[4, 13]);
    assert!(difference(&group.seen(0, ""), &group.seen(5, "")) > 0.0, "texels are squares");
}
