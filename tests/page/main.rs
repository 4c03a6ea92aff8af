//! The page in a real browser against the real server: what a visitor does, from the first look to the curl command.
//! Pictures of it lie in `target/page-test/` afterwards, for people to look at.

mod access;
mod axe;
mod browser;
mod command;
mod controls;
mod faults;
mod model;
mod previews;
mod scene;
mod server;

use axe::Axe;
use browser::Browser;
use controls::MIDDLE;
use server::Server;
use std::process::Command;

#[test]
fn a_visitor_goes_from_a_dropped_model_to_a_picture_and_its_command() {
    let Some(program) = browser::find() else {
        eprintln!("SKIPPED: the page is not tested, as no Chromium is installed (apt-get install chromium)");
        return;
    };
    let folder = tempfile::tempdir().expect("a folder for the model");
    let [gltf, bin] = model::write(folder.path());
    let mut server = Server::start(&[]);
    let axe = Axe::new();
    let mut page = Browser::start(program, 1360, 850);
    page.emulate(1360, 850, false, "light");

    page.open(&server.origin);
    scene::the_demo_is_rendered(&mut page);
    axe.finds_nothing(&mut page, "the first look");
    page.drop_files(MIDDLE, &[&gltf, &bin]);
    scene::the_model_is_rendered(&mut page);
    scene::the_file_s_variant_and_other_scene_are_shown(&mut page);
    scene::a_light_changes_the_picture(&mut page);
    scene::an_emptied_field_says_so_and_keeps_its_number(&mut page);
    scene::the_camera_turns(&mut page);
    scene::an_animation_moves_the_model(&mut page);
    previews::previews_follow_a_hand(&mut page);
    previews::previews_are_drawn_and_compared(&mut page, &axe);
    scene::spheres_and_materials_change_the_picture(&mut page, folder.path());
    faults::a_render_can_be_cancelled(&mut page);
    command::the_command_makes_the_same_picture(&mut page, folder.path());
    access::everything_is_reached_by_keys(&mut page);
    access::it_is_accessible(&mut page, &axe);
    access::long_names_widen_nothing(&mut page);
    access::it_fits_a_phone(&mut page, &axe);
    faults::nothing_is_amiss(&mut page, &server.origin);
    faults::faults_are_told(&mut page, folder.path());
    axe.finds_nothing(&mut page, "a fault");
    faults::a_broken_file_leaves_the_render_alone(&mut page, folder.path());
    faults::a_server_that_cannot_is_asked_a_few_times(&mut page);
    previews::a_refused_draft_leaves_previews_on(&mut page);
    faults::a_page_out_of_sight_holds_no_connection(&mut page);
    faults::a_server_that_forgot_is_sent_everything_again(&mut page, &mut server);
    faults::who_comes_back_sees_the_render_go_on(&mut page, &server.origin);
    page.open(&format!("{}/docs", server.origin));
    page.wait_for("document.querySelectorAll('main h2').length > 2");
    axe.finds_nothing(&mut page, "the reference of the API");
}

#[test]
fn a_visitor_of_a_server_without_graphics_sees_traced_drafts() {
    let Some(program) = browser::find() else {
        eprintln!(
            "SKIPPED: drafts without graphics are not tested, as no Chromium is installed (apt-get install chromium)"
        );
        return;
    };
    if !cfg!(target_os = "linux") {
        eprintln!("SKIPPED: drafts without graphics are not tested, as only drivers that files name can be hidden");
        return;
    }
    let server = Server::without_graphics();
    let mut page = Browser::start(program, 1360, 850);
    page.emulate(1360, 850, false, "light");
    page.open(&server.origin);
    scene::the_demo_is_rendered(&mut page);
    previews::drafts_are_traced_where_nothing_can_draw(&mut page);
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
    scene::the_demo_is_rendered(&mut page);
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
