//! Models, lights, the camera, spheres and materials: each changes the picture.

use crate::browser::Browser;
use crate::controls::*;
use std::path::Path;

pub fn the_demo_is_rendered(page: &mut Browser) {
    page.wait_for("document.querySelector('#viewport img').naturalWidth > 0");
    page.screenshot("welcome");
    set(page, "max_samples", SAMPLES);
    set(page, "width", WIDTH);
    set(page, "height", HEIGHT);
    wait_until_done(page);
    assert!(spread(&pixels(page)) > 20.0, "the demo is more than one flat colour");
}

pub fn the_model_is_rendered(page: &mut Browser) {
    page.wait_for("document.querySelector('#model-name').textContent === 'box.gltf'");
    wait_until_done(page);
    let picture = pixels(page);
    assert_eq!(picture.len(), (WIDTH * HEIGHT * 4) as usize);
    assert!(spread(&picture) > 5.0, "the box is more than one flat colour");
    assert_eq!(number(page, "samples"), SAMPLES.to_string());
    assert!(number(page, "error").contains('%'), "the measured error is shown");
    page.screenshot("model");
}

/// A scene of the file that nobody has described to the page is seen whole all the same.
pub fn the_file_s_variant_and_other_scene_are_shown(page: &mut Browser) {
    let usual = pixels(page);
    choose_option(page, "[data-setting=variant] select", "0");
    wait_until_done(page);
    assert!(difference(&usual, &pixels(page)) > CHANGED, "the variant has another paint");
    choose_option(page, "[data-setting=variant] select", "usual");
    choose_option(page, "[data-setting=scene] select", "1");
    wait_until_done(page);
    let tower = pixels(page);
    assert!(difference(&usual, &tower) > CHANGED, "the other scene differs");
    assert!(spread(&tower) > 5.0, "the tower, which stands elsewhere, is in the picture");
    page.screenshot("other-scene");
    choose_option(page, "[data-setting=scene] select", "0");
    wait_until_done(page);
    assert_eq!(difference(&usual, &pixels(page)), 0.0, "the first scene is back");
    assert!(text(page, "document.querySelector('#status .words').textContent").contains("kept from before"));
}

pub fn a_light_changes_the_picture(page: &mut Browser) {
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

/// Of a light's two angles one is emptied: the field says that it misses something, and the other one turns the light.
pub fn an_emptied_field_says_so_and_keeps_its_number(page: &mut Browser) {
    let before = pixels(page);
    let change = |place: &str, kind: &str, value: &str| {
        format!(
            "(() => {{
                const [around, above] = document.querySelectorAll('#lights .card .fields .fields .field');
                const input = {place}.querySelector('input[type={kind}]');
                input.value = '{value}';
                for (const name of ['input', 'change']) input.dispatchEvent(new Event(name, {{ bubbles: true }}));
            }})()"
        )
    };
    let kept = page.eval("document.querySelector('#lights .card .fields .fields input[type=number]').value");
    page.eval(&change("around", "number", ""));
    let words = "document.querySelector('#lights .fault')?.textContent.length ?? 0";
    assert!(page.eval(words).as_u64() > Some(5), "the empty field is told of");
    page.eval(&change("above", "range", "80"));
    wait_until_done(page);
    assert!(difference(&before, &pixels(page)) > CHANGED / 10.0, "the light comes from elsewhere");
    page.eval(&change("around", "number", kept.as_str().expect("a number in a field")));
    assert_eq!(page.eval(words), 0, "a number that is taken ends the words");
    click(page, "#lights .card .fields > button");
    wait_until_done(page);
}

pub fn the_camera_turns(page: &mut Browser) {
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

pub fn an_animation_moves_the_model(page: &mut Browser) {
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

/// Leaves a sphere with two maps and a painted material for what follows.
pub fn spheres_and_materials_change_the_picture(page: &mut Browser, folder: &Path) {
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
    click(page, "#spheres > .row button");
    differs_after(page, "a second sphere", CHANGED / 50.0);
    click(page, "#spheres .card:last-child .card-head button");
    differs_after(page, "its removal", CHANGED / 50.0);
    page.screenshot("surfaces");
}
