//! Arguments of `candela render` -> a checked request.

use super::Failure;
use super::render::RenderArgs;
use crate::params::{self, EnvironmentChoice, EnvironmentParams, FieldError, ImageFormat, ParamLimits, RenderParams};
use std::path::{Path, PathBuf};

/// Where the picture goes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Target {
    /// A file.
    File(PathBuf),
    /// Standard output (`-o -`).
    Stdout,
}

/// A request as the command line has it.
#[derive(Debug)]
pub struct Request {
    /// Valid.
    pub params: RenderParams,
    /// In `params.output.format`.
    pub target: Target,
}

/// Reads `--params`, lays `--set`, `--hdri` and the format of `--output` over it, and checks the whole.
pub fn request(arguments: &RenderArgs) -> Result<Request, Failure> {
    let json = json(arguments.params.as_deref())?;
    let pairs = arguments.set.iter().map(|pair| pair.split_once('=').ok_or(pair)).collect::<Result<Vec<_>, _>>();
    let pairs = pairs.map_err(|pair| Failure::Request(format!("--set {pair}: write NAME=VALUE, like width=640")))?;
    let mut params = params::from_json_and_query(&json, pairs).map_err(|faults| faulty(&faults))?;
    if let Some(hdri) = &arguments.hdri {
        set_hdri(&mut params, hdri);
    }
    let asked = asks_for_format(&json, arguments).then_some(params.output.format);
    let target = target(arguments, &mut params)?;
    if let Some(asked) = asked.filter(|asked| *asked != params.output.format) {
        let (asked, path) = (asked.extension(), arguments.output.as_deref().unwrap_or(Path::new("")).display());
        let detail = format!("--output {path} does not go with output.format, which asks for {asked}: leave one out");
        return Err(Failure::Request(detail));
    }
    params.validate(&limits()).map_err(|faults| faulty(&faults))?;
    Ok(Request { params, target })
}

/// Nobody else waits for this machine: only what memory and arithmetic can hold is a limit.
pub fn limits() -> ParamLimits {
    ParamLimits { pixels: 1 << 28, pixel_samples: u64::MAX, ..ParamLimits::default() }
}

/// The text of `--params`: JSON by itself, or a file of it.
fn json(argument: Option<&str>) -> Result<String, Failure> {
    match argument {
        None => Ok("{}".to_owned()),
        Some(text) if text.trim_start().starts_with('{') => Ok(text.to_owned()),
        Some(file) => std::fs::read_to_string(file).map_err(|error| {
            Failure::Request(format!("--params {file}: {error}; give a file of JSON, or JSON that begins with {{"))
        }),
    }
}

fn set_hdri(params: &mut RenderParams, file: &Path) {
    let mut environment = match std::mem::take(&mut params.environment) {
        EnvironmentChoice::Given(environment) => environment,
        EnvironmentChoice::Auto | EnvironmentChoice::None => EnvironmentParams::default(),
    };
    environment.hdri = Some(file.to_string_lossy().into_owned());
    params.environment = EnvironmentChoice::Given(environment);
}

/// The file to write; its extension, if it has one, decides on the format. One that the user did not name is not replaced.
fn target(arguments: &RenderArgs, params: &mut RenderParams) -> Result<Target, Failure> {
    let Some(path) = &arguments.output else {
        let name = Path::new(arguments.scene.trim_start_matches(super::render::DEMO_PREFIX));
        let stem = name.file_stem().map_or_else(|| "picture".into(), |stem| stem.to_string_lossy());
        return new(PathBuf::from(format!("{stem}.{}", params.output.format.extension())));
    };
    if path.as_os_str() == "-" {
        return Ok(Target::Stdout);
    }
    let given = path.extension().map(|extension| extension.to_string_lossy().to_lowercase());
    params.output.format = match given.as_deref() {
        Some("png") => ImageFormat::Png,
        Some("exr") => ImageFormat::Exr,
        Some("webp") => ImageFormat::Webp,
        Some("jpg" | "jpeg") => ImageFormat::Jpeg,
        _ => {
            let path = path.display();
            return Err(Failure::Request(format!("--output {path}: end the name in .png, .exr, .webp or .jpg")));
        }
    };
    // Found out before the work, not after.
    if path.parent().is_some_and(|folder| !folder.as_os_str().is_empty() && !folder.is_dir()) {
        return Err(Failure::Request(format!("--output {}: there is no such folder", path.display())));
    }
    Ok(Target::File(path.clone()))
}

/// A file that is not there yet.
fn new(path: PathBuf) -> Result<Target, Failure> {
    if path.exists() {
        let path = path.display();
        return Err(Failure::Request(format!(
            "{path} is there already: write `-o {path}` to replace it, or another name"
        )));
    }
    Ok(Target::File(path))
}

/// Whether the parameters themselves choose a format.
fn asks_for_format(json: &str, arguments: &RenderArgs) -> bool {
    let has = |json: &str, pointer: &str| {
        serde_json::from_str(json).is_ok_and(|json: serde_json::Value| json.pointer(pointer).is_some())
    };
    let set = |pair: &String| match pair.split_once('=') {
        Some(("output", json)) => has(json, "/format"),
        Some((name, _)) => name == "output.format",
        None => false,
    };
    has(json, "/output/format") || arguments.set.iter().any(set)
}

fn faulty(faults: &[FieldError]) -> Failure {
    let lines: Vec<String> = faults.iter().map(|fault| format!("\n  {fault}")).collect();
    Failure::Request(format!("the parameters are not valid:{}", lines.concat()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Arguments {
        #[command(flatten)]
        render: RenderArgs,
    }

    fn parsed(arguments: &[&str]) -> Result<Request, Failure> {
        request(&Arguments::parse_from(["render"].iter().chain(arguments)).render)
    }

    #[test]
    fn settings_go_over_params() {
        let json = r#"{"width": 100, "environment": {"hdri": "a.hdr", "intensity": 2}}"#;
        let arguments = ["duck.glb", "--params", json, "--set", "width=64", "--hdri", "b.hdr", "-o", "duck.JPG"];
        let request = parsed(&arguments).unwrap();
        assert_eq!(request.params.width, 64);
        assert_eq!(request.params.output.format, ImageFormat::Jpeg);
        assert_eq!(request.target, Target::File("duck.JPG".into()));
        let EnvironmentChoice::Given(environment) = request.params.environment else { panic!("no environment") };
        assert_eq!((environment.hdri.as_deref(), environment.intensity), (Some("b.hdr"), 2.0));
    }

    #[test]
    fn the_picture_is_named_after_the_scene() {
        let target = |arguments: &[&str]| parsed(arguments).unwrap().target;
        assert_eq!(target(&["models/duck.glb"]), Target::File("duck.png".into()));
        assert_eq!(target(&["demo:grid", "--set", "output.format=exr"]), Target::File("grid.exr".into()));
        assert_eq!(target(&["demo:grid", "-o", "-"]), Target::Stdout);
    }

    #[test]
    fn a_file_that_nobody_named_is_not_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("scene.png");
        assert_eq!(new(file.clone()).unwrap(), Target::File(file.clone()));
        std::fs::write(&file, b"").unwrap();
        let failure = new(file.clone()).unwrap_err();
        assert!(failure.exit_code() == 2 && failure.to_string().contains("-o "), "{failure}");
        assert_eq!(parsed(&["a.glb", "-o", &file.to_string_lossy()]).unwrap().target, Target::File(file));
    }

    #[test]
    fn other_fields_of_the_output_go_with_any_file() {
        let request = parsed(&["a.glb", "--set", "output={\"transparent\": true}", "-o", "x.exr"]).unwrap();
        assert_eq!((request.params.output.format, request.params.output.transparent), (ImageFormat::Exr, true));
    }

    #[test]
    fn what_is_wrong_is_said() {
        for (arguments, says) in [
            (["--set", "width"], "NAME=VALUE"),
            (["--set", "widht=1"], "Did you mean `width`?"),
            (["--set", "width=0"], "/params/width"),
            (["--params", "no such file"], "no such file"),
            (["--params", "{"], "not valid JSON"),
            (["--output", "x.gif"], ".png, .exr"),
            (["-ox.png", "--set=output.format=exr"], "asks for exr"),
            (["-ox.exr", "--set=output={\"format\": \"png\"}"], "asks for png"),
            (["--output", "no such folder/x.png"], "no such folder"),
        ] {
            let failure = parsed(&["a.glb", arguments[0], arguments[1]]).unwrap_err();
            assert_eq!(failure.exit_code(), 2);
            assert!(failure.to_string().contains(says), "{arguments:?}: {failure}");
        }
    }
}
