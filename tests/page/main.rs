//! The page in a real browser against the real server: what a visitor does, from the first look to the curl command.
//! Pictures of it lie in `target/page-test/` afterwards, for people to look at.

mod axe;
mod browser;
mod model;
mod server;

use axe::Axe;
use browser::Browser;
use candela::params::RenderParams;
use server::Server;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

/// Middle of the picture on the desktop layout of the test.
const MIDDLE: (f64, f64) = (480.0, 320.0);
const WIDTH: u32 = 320;
const HEIGHT: u32 = 200;
const SAMPLES: u32 = 8;

/// Mean difference of the channels, 0 to 255, that no noise between equal pictures reaches: same seed, same bytes.
const CHANGED: f64 = 0.5;

const PIXELS: &str = "(() => {
    const image = document.querySelector('#viewport img');
    const canvas = new OffscreenCanvas(image.naturalWidth, image.naturalHeight);
    const context = canvas.getContext('2d');
    context.drawImage(image, 0, 0);
    return [...context.getImageData(0, 0, canvas.width, canvas.height).data];
})()";

#[test]
fn a_visitor_goes_from_a_dropped_model_to_a_picture_and_its_command() {
    let Some(program) = browser::find() else {
        eprintln!("SKIPPED: the page is not tested, as no Chromium is installed (apt-get install chromium)");
        return;
    };
    let folder = tempfile::tempdir().expect("a folder for the model");
    let [gltf, bin] = model::write(folder.path());
    let server = Server::start(&[]);
    let axe = Axe::new();
    let mut page = Browser::start(program, 1360, 850);
    page.emulate(1360, 850, false, "light");

    page.open(&server.origin);
    the_demo_is_rendered(&mut page);
    axe.finds_nothing(&mut page, "the first look");
    page.drop_files(MIDDLE, &[&gltf, &bin]);
    the_model_is_rendered(&mut page);
    a_light_changes_the_picture(&mut page);
    the_camera_turns(&mut page);
    an_animation_moves_the_model(&mut page);
    previews_follow_a_hand(&mut page);
    previews_are_drawn_and_compared(&mut page, &axe);
    spheres_and_materials_change_the_picture(&mut page, folder.path());
    a_render_can_be_cancelled(&mut page);
    the_command_makes_the_same_picture(&mut page, folder.path());
    everything_is_reached_by_keys(&mut page);
    it_is_accessible(&mut page, &axe);
    it_fits_a_phone(&mut page, &axe);
    nothing_is_amiss(&mut page, &server.origin);
    faults_are_told(&mut page, folder.path());
    axe.finds_nothing(&mut page, "a fault");
    page.open(&format!("{}/docs", server.origin));
    page.wait_for("document.querySelectorAll('main h2').length > 2");
    axe.finds_nothing(&mut page, "the reference of the API");
}

#[test]
fn a_visitor_with_a_key_renders_and_reads_the_reference() {
    let Some(program) = browser::find() else {
        eprintln!("SKIPPED: the page is not tested with keys, as no Chromium is installed (apt-get install chromium)");
        return;
    };
    let folder = tempfile::tempdir().expect("a folder for the keys");
    let file = folder.path().join("keys.json");
    let file = file.to_str().expect("a plain path");
    let mut add = Command::new(env!("CARGO_BIN_EXE_candela"));
    let made = add.args(["key", "add", "visitor", "--keys", file, "--scope", "render"]).output().expect("candela runs");
    let said = String::from_utf8(made.stdout).expect("text");
    let key = said.split_whitespace().find(|word| word.starts_with("candela_")).expect("a key").to_owned();
    let server = Server::start(&["--keys", file]);
    let mut page = Browser::start(program, 1360, 850);
    page.emulate(1360, 850, false, "light");
    page.log_in("visitor", &key);
    page.open(&server.origin);
    the_demo_is_rendered(&mut page);
    page.open(&format!("{}/docs", server.origin));
    page.wait_for("document.querySelectorAll('section.operation').length > 20");
    page.screenshot("reference");
    let drawn = page.eval("[...document.querySelectorAll('section.operation')].map((section) => section.id)");
    let drawn: Vec<&str> = drawn.as_array().into_iter().flatten().filter_map(|id| id.as_str()).collect();
    assert!(
        ["render", "createJob", "deleteJob", "followBatch", "getPage"].iter().all(|id| drawn.contains(id)),
        "{drawn:?}"
    );
    let amiss: Vec<_> = page.complaints().into_iter().filter(|text| !text.contains("/preview?")).collect();
    assert!(amiss.is_empty(), "{amiss:#?}");
}

fn the_demo_is_rendered(page: &mut Browser) {
    page.wait_for("document.querySelector('#viewport img').naturalWidth > 0");
    page.screenshot("welcome");
    set(page, "max_samples", SAMPLES);
    set(page, "width", WIDTH);
    set(page, "height", HEIGHT);
    wait_until_done(page);
    assert!(spread(&pixels(page)) > 20.0, "the demo is more than one flat colour");
}

fn the_model_is_rendered(page: &mut Browser) {
    page.wait_for("document.querySelector('#model-name').textContent === 'box.gltf'");
    wait_until_done(page);
    let picture = pixels(page);
    assert_eq!(picture.len(), (WIDTH * HEIGHT * 4) as usize);
    assert!(spread(&picture) > 5.0, "the box is more than one flat colour");
    assert_eq!(number(page, "samples"), SAMPLES.to_string());
    assert!(number(page, "error").contains('%'), "the measured error is shown");
    page.screenshot("model");
}

fn a_light_changes_the_picture(page: &mut Browser) {
    let before = pixels(page);
    click(page, "#lights .row button");
    wait_until_done(page);
    let lit = pixels(page);
    assert!(difference(&before, &lit) > CHANGED, "a new light is seen");
    page.eval(
        "(() => {
            const input = document.querySelector('#lights .card input[type=color]');
            input.value = '#ff2000';
            for (const name of ['input', 'change']) input.dispatchEvent(new Event(name, { bubbles: true }));
        })()",
    );
    wait_until_done(page);
    assert!(difference(&lit, &pixels(page)) > CHANGED, "its colour is seen");
    for kind in ["spot", "directional", "ambient"] {
        let before = pixels(page);
        choose_option(page, "#lights .card select", kind);
        wait_until_done(page);
        assert!(difference(&before, &pixels(page)) > CHANGED / 10.0, "{kind} differs from the kind before");
        page.screenshot(&format!("light-{kind}"));
    }
    choose_option(page, "#lights .card select", "spot");
    wait_until_done(page);
}

fn the_camera_turns(page: &mut Browser) {
    let mut before = pixels(page);
    let mut differs_after = |page: &mut Browser, what: &str| {
        wait_until_done(page);
        let now = pixels(page);
        assert!(difference(&before, &now) > CHANGED, "the picture is another after {what}");
        before = now;
    };
    page.drag(MIDDLE, (MIDDLE.0 + 90.0, MIDDLE.1 + 40.0));
    differs_after(page, "a drag");
    page.eval("document.querySelector('#viewport').focus()");
    page.key("ArrowLeft", 37);
    differs_after(page, "an arrow key");
    page.key("-", 189);
    differs_after(page, "the minus key");
    let fingers = [[(400.0, 320.0), (340.0, 300.0)], [(560.0, 320.0), (660.0, 340.0)]];
    page.touch(&fingers);
    differs_after(page, "a pinch");
}

fn an_animation_moves_the_model(page: &mut Browser) {
    let before = pixels(page);
    choose_option(page, "[data-setting=animation] select", "0");
    wait_until_done(page);
    assert!(difference(&before, &pixels(page)) < CHANGED, "it begins as it rests");
    page.eval(
        "(() => {
            const slider = document.querySelector('[data-setting=time] input[type=range]');
            slider.value = 1;
            for (const name of ['input', 'change']) slider.dispatchEvent(new Event(name, { bubbles: true }));
        })()",
    );
    wait_until_done(page);
    assert!(difference(&before, &pixels(page)) > CHANGED, "it has turned");
}

/// While a button is held down and moves, rasterised pictures come and replace each other.
fn previews_follow_a_hand(page: &mut Browser) {
    page.eval(
        "(() => {
            window.shown = 0;
            const observer = new MutationObserver((changes) => { window.shown += changes.length; });
            observer.observe(document.querySelector('#viewport img'), { attributeFilter: ['src'] });
            window.stopCounting = () => observer.disconnect();
        })()",
    );
    let begun = Instant::now();
    page.drag_slowly(MIDDLE, (MIDDLE.0 + 120.0, MIDDLE.1 - 30.0), Duration::from_secs(3));
    let (seconds, shown) = (begun.elapsed().as_secs_f64(), page.eval("window.shown").as_u64().unwrap_or(0));
    page.eval("window.stopCounting()");
    eprintln!("{shown} previews within {seconds:.1} s of dragging: {:.1} a second", shown as f64 / seconds);
    assert!(shown >= 3, "{shown} previews in {seconds} s");
    // Back to the lit side.
    page.drag((MIDDLE.0 + 120.0, MIDDLE.1 - 30.0), MIDDLE);
    wait_until_done(page);
}

fn previews_are_drawn_and_compared(page: &mut Browser, axe: &Axe) {
    let measured = text(page, "document.querySelector('.convergence svg').ariaLabel");
    assert!(measured.starts_with("Error"), "the error is plotted: {measured}");
    let traced = pixels(page);
    click(page, ".compare");
    page.wait_for("document.querySelector('#comparison [role=status]').textContent.startsWith('They differ')");
    page.screenshot("comparison");
    axe.finds_nothing(page, "the comparison");
    click(page, "#comparison .close");
    choose_option(page, "[data-setting=mode] select", "preview");
    wait_until_done(page);
    let rasterised = pixels(page);
    let apart = difference(&traced, &rasterised);
    assert!(apart > 0.0 && apart < 2.0, "a convex body under one lamp is the same but for its edges: {apart}");
    choose_option(page, "[data-setting=\"preview.shading\"] select", "phong");
    wait_until_done(page);
    assert!(difference(&rasterised, &pixels(page)) > CHANGED / 10.0, "Phong's shading is another");
    choose_option(page, "[data-setting=\"preview.shading\"] select", "pbr");
    choose_option(page, "[data-setting=mode] select", "path");
    wait_until_done(page);
}

/// Leaves a sphere with two maps and a painted material for what follows.
fn spheres_and_materials_change_the_picture(page: &mut Browser, folder: &Path) {
    let map = folder.join("bumps.png");
    let bumps =
        image::GrayImage::from_fn(32, 16, |x, y| image::Luma([if (x / 4 + y / 4) % 2 == 0 { 250 } else { 30 }]));
    bumps.save(&map).expect("the map is written");
    let mut before = pixels(page);
    let mut differs_after = |page: &mut Browser, what: &str, least: f64| {
        wait_until_done(page);
        let now = pixels(page);
        let apart = difference(&before, &now);
        assert!(apart > least, "the picture is another after {what}: {apart}");
        before = now;
    };
    for panel in ["#spheres", "#materials"] {
        page.eval(&format!("document.querySelector('{panel}').closest('details').open = true"));
    }
    click(page, "#spheres .row button");
    differs_after(page, "a sphere", CHANGED / 5.0);
    page.choose("#spheres .card .file input", &[&map]);
    page.wait_for("document.querySelector('#spheres .file-name').textContent === 'bumps.png'");
    differs_after(page, "its texture", CHANGED / 50.0);
    choose_option(page, "#spheres [data-field=detail] select", "height");
    page.choose("#spheres [data-field=detail] + .file input", &[&map]);
    page.wait_for("document.querySelectorAll('#spheres .file-name')[1].textContent === 'bumps.png'");
    differs_after(page, "its bumps", CHANGED / 50.0);
    click(page, "#materials .row button");
    click(page, "#materials .card .fields .check input");
    differs_after(page, "another colour", CHANGED);
    click(page, "#spheres .row:last-child button");
    differs_after(page, "a second sphere", CHANGED / 50.0);
    click(page, "#spheres .card:last-child .card-head button");
    differs_after(page, "its removal", CHANGED / 50.0);
    page.screenshot("surfaces");
}

fn a_render_can_be_cancelled(page: &mut Browser) {
    set(page, "max_samples", 1_000_000);
    page.wait_for("!document.querySelector('.cancel').disabled");
    click(page, ".cancel");
    page.wait_for("document.querySelector('#status .words').textContent === 'Cancelled'");
    assert_eq!(page.eval("document.querySelector('.png').disabled"), true, "a cut-off picture is no result");
    set(page, "max_samples", SAMPLES);
    wait_until_done(page);
}

fn the_command_makes_the_same_picture(page: &mut Browser, folder: &Path) {
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

/// The tab key comes to every control that is to be seen, and where it stands is marked.
fn everything_is_reached_by_keys(page: &mut Browser) {
    page.eval(
        "(() => {
            for (const details of document.querySelectorAll('details')) details.open = true;
            window.reached = new Set();
            window.unmarked = [];
            document.activeElement?.blur();
            document.addEventListener('focusin', ({ target }) => {
                window.reached.add(target);
                const { outlineStyle, boxShadow } = getComputedStyle(target.matches('.visually-hidden') ? target.nextElementSibling : target);
                if (outlineStyle === 'none' && boxShadow === 'none') window.unmarked.push(target.outerHTML.slice(0, 120));
            });
        })()",
    );
    let controls = "[...document.querySelectorAll('a[href], button, input, select, textarea, summary, [tabindex=\"0\"]')]
        .filter((e) => !e.disabled && e.checkVisibility({ visibilityProperty: true }) && !e.closest('dialog:not([open])'))
        .filter((e) => e.type !== 'radio' || e.checked)";
    let count = page.eval(&format!("{controls}.length")).as_u64().expect("a number");
    for _ in 0..count + 10 {
        page.key("Tab", 9);
    }
    let missed =
        page.eval(&format!("{controls}.filter((e) => !window.reached.has(e)).map((e) => e.outerHTML.slice(0, 120))"));
    assert_eq!(missed, serde_json::json!([]), "of {count} controls the tab key does not come to these");
    assert_eq!(page.eval("window.unmarked"), serde_json::json!([]), "these do not show that they have the focus");
}

/// With everything unfolded, in both colour schemes.
fn it_is_accessible(page: &mut Browser, axe: &Axe) {
    for scheme in ["light", "dark"] {
        page.emulate(1360, 850, false, scheme);
        axe.finds_nothing(page, &format!("all panels, {scheme}"));
    }
    click(page, ".curl");
    page.wait_for("document.querySelector('.curl-dialog').open");
    axe.finds_nothing(page, "the command");
    click(page, ".curl-dialog .close");
    page.eval("document.querySelector('main').append(document.createElement('button'))");
    axe.finds(page, "button-name");
    page.eval("document.querySelector('main > button').remove()");
}

fn it_fits_a_phone(page: &mut Browser, axe: &Axe) {
    page.emulate(390, 844, true, "dark");
    page.wait_for("innerWidth === 390");
    axe.finds_nothing(page, "a phone");
    page.screenshot("phone-dark");
    let wide = page.eval("document.documentElement.scrollWidth");
    assert_eq!(wide, 390, "nothing is wider than the phone");
    page.emulate(1360, 850, false, "dark");
    page.wait_for("innerWidth === 1360");
    page.screenshot("dark");
}

fn nothing_is_amiss(page: &mut Browser, origin: &str) {
    // A preview is gone once its job is over, and so is what could be cancelled: the page asks at its own risk.
    let late = |text: &String| text.contains("/preview?") || text.contains("/cancel");
    let complaints: Vec<_> = page.complaints().into_iter().filter(|text| !late(text)).collect();
    assert!(complaints.is_empty(), "{complaints:#?}");
    let elsewhere = |url: &String| !url.starts_with(origin) && !url.starts_with("blob:") && url != "about:blank";
    let strays: Vec<_> = page.requests().into_iter().filter(elsewhere).collect();
    assert!(strays.is_empty(), "requests to other hosts: {strays:?}");
    let unnamed = page.eval(
        "[...document.querySelectorAll('input, select, textarea, button')]
            .filter((e) => !e.labels?.length && !e.ariaLabel && !e.textContent.trim()).length",
    );
    assert_eq!(unnamed, 0, "every control has a name");
}

fn faults_are_told(page: &mut Browser, folder: &Path) {
    let broken = folder.join("broken.glb");
    std::fs::write(&broken, b"glTF, but no further").expect("a file is written");
    page.choose("#choose-files", &[&broken]);
    page.wait_for("!document.querySelector('#alert').hidden");
    page.screenshot("fault");
    let told = text(page, "document.querySelector('#alert').innerText");
    assert!(told.contains("scene"), "the title of the problem is shown: {told}");
    assert_eq!(text(page, "document.querySelector('#model-name').textContent"), "box.gltf", "the former model stays");
}

/// Types a number into a settings field.
fn set(page: &mut Browser, setting: &str, value: u32) {
    page.eval(&format!(
        "(() => {{
            const input = document.querySelector('[data-setting={setting}] input[type=number]');
            input.value = '{value}';
            input.dispatchEvent(new Event('change', {{ bubbles: true }}));
        }})()"
    ));
}

fn choose_option(page: &mut Browser, selector: &str, value: &str) {
    page.eval(&format!(
        "(() => {{
            const select = document.querySelector('{selector}');
            select.value = '{value}';
            select.dispatchEvent(new Event('change', {{ bubbles: true }}));
        }})()"
    ));
}

fn click(page: &mut Browser, selector: &str) {
    page.eval(&format!("document.querySelector('{selector}').click()"));
}

fn text(page: &mut Browser, expression: &str) -> String {
    page.eval(expression).as_str().unwrap_or_else(|| panic!("{expression} is no text")).to_owned()
}

fn number(page: &mut Browser, name: &str) -> String {
    text(page, &format!("document.querySelector('[data-number={name}]').textContent"))
}

/// Waits for the full-quality picture of what the page shows now, until it is on screen.
fn wait_until_done(page: &mut Browser) {
    page.wait_for("!document.querySelector('.png').disabled");
}

/// RGBA of the picture on screen, row by row.
fn pixels(page: &mut Browser) -> Vec<u8> {
    let value = page.eval(PIXELS);
    let bytes = value.as_array().expect("pixels are a list").iter();
    bytes.map(|byte| u8::try_from(byte.as_u64().expect("a byte")).expect("a byte")).collect()
}

/// Mean absolute difference of two pictures of one size; of two sizes: everything.
fn difference(a: &[u8], b: &[u8]) -> f64 {
    if a.len() != b.len() {
        return 255.0;
    }
    let sum: f64 = a.iter().zip(b).map(|(x, y)| f64::from(x.abs_diff(*y))).sum();
    sum / a.len() as f64
}

/// Standard deviation of the green channel.
fn spread(rgba: &[u8]) -> f64 {
    let greens = || rgba.iter().skip(1).step_by(4).map(|byte| f64::from(*byte));
    let count = greens().count() as f64;
    let mean = greens().sum::<f64>() / count;
    (greens().map(|green| (green - mean).powi(2)).sum::<f64>() / count).sqrt()
}
