//! What a visitor takes home.

use crate::browser::Browser;
use crate::controls::*;
use candela::params::RenderParams;
use std::path::Path;
use std::process::Command;

pub fn the_command_makes_the_same_picture(page: &mut Browser, folder: &Path) {
    let shown = pixels(page);
    click(page, ".curl");
    page.wait_for("document.querySelector('.curl-dialog').open");
    page.screenshot("curl");
    let command = text(page, "document.querySelector('.curl-dialog textarea').value");
    click(page, ".curl-dialog .close");
    let json = command.split_once("params=").and_then(|(_, rest)| rest.split_once('\'')).map(|(json, _)| json);
    let params: RenderParams = serde_json::from_str(json.expect("the parameters are quoted")).expect("they parse");
    assert_eq!((params.width, params.height, params.max_samples), (WIDTH, HEIGHT, SAMPLES));
    assert_eq!((params.lights.len(), params.spheres.len(), params.overrides.len()), (1, 1, 1));
    if Command::new("curl").arg("--version").output().is_err() {
        eprintln!("SKIPPED: the command is not run, as curl is not installed");
        return;
    }
    let run = Command::new("sh").args(["-c", &command]).current_dir(folder).output().expect("a shell");
    assert!(run.status.success(), "{command}\n{}", String::from_utf8_lossy(&run.stderr));
    let file = std::fs::read(folder.join("box.png")).expect("the command wrote a picture");
    let picture = image::load_from_memory(&file).unwrap_or_else(|_| panic!("{}", String::from_utf8_lossy(&file)));
    assert_eq!(difference(&shown, picture.to_rgba8().as_raw()), 0.0, "the command makes the picture on screen");
}
