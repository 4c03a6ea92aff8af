//! What goes wrong is told, and nothing else goes with it.

use crate::browser::Browser;
use crate::controls::*;
use crate::server::Server;
use std::path::Path;

pub fn a_render_can_be_cancelled(page: &mut Browser) {
    set(page, "max_samples", 1_000_000);
    page.wait_for("!document.querySelector('.cancel').disabled");
    click(page, ".cancel");
    page.wait_for("document.querySelector('#status .words').textContent === 'Cancelled'");
    assert_eq!(page.eval("document.querySelector('.png').disabled"), true, "a cut-off picture is no result");
    set(page, "max_samples", SAMPLES);
    wait_until_done(page);
}

pub fn faults_are_told(page: &mut Browser, folder: &Path) {
    open_broken_file(page, folder);
    let told = text(page, "document.querySelector('#alert').innerText");
    assert!(told.contains("scene"), "the title of the problem is shown: {told}");
    assert_eq!(text(page, "document.querySelector('#model-name').textContent"), "box.gltf", "the former model stays");
}

pub fn nothing_is_amiss(page: &mut Browser, origin: &str) {
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

/// The picture under way is the same one after a file that is none.
pub fn a_broken_file_leaves_the_render_alone(page: &mut Browser, folder: &Path) {
    set(page, "max_samples", 1_000_000);
    page.wait_for("!document.querySelector('.cancel').disabled");
    let posted = jobs_posted(page);
    open_broken_file(page, folder);
    page.screenshot("fault");
    assert_eq!(text(page, "document.querySelector('#status .words').textContent"), "Rendering");
    assert_eq!(page.eval("document.querySelector('.cancel').disabled"), false, "the render goes on");
    assert_eq!(jobs_posted(page), posted, "no other render was begun");
    set(page, "max_samples", SAMPLES);
    wait_until_done(page);
}

/// A device that stays away: some tries, further and further apart, then an end that says so.
pub fn a_server_that_cannot_is_asked_a_few_times(page: &mut Browser) {
    page.eval(
        "(() => {
            window.tries = [];
            window.realFetch = window.fetch;
            const problem = { title: 'The graphics device is not available', status: 503, code: 'device_unavailable' };
            const headers = { 'content-type': 'application/problem+json', 'retry-after': '0.1' };
            window.fetch = (url, options) => {
                if (url !== '/v1/jobs') return window.realFetch(url, options);
                window.tries.push(performance.now());
                return Promise.resolve(new Response(JSON.stringify(problem), { status: 503, headers }));
            };
        })()",
    );
    set(page, "max_samples", SAMPLES + 1);
    page.wait_for("document.querySelector('#status .words').textContent.includes('try 3 of 6')");
    page.wait_for("document.querySelector('#status .words').textContent === 'Failed'");
    let told = text(page, "document.querySelector('#alert').innerText");
    assert!(told.contains("not available"), "{told}");
    let waits = page.eval("window.tries.slice(1).map((time, i) => (time - window.tries[i]) / 100)");
    let waits: Vec<f64> = waits.as_array().into_iter().flatten().filter_map(|wait| wait.as_f64()).collect();
    assert_eq!(waits.len(), 5, "{waits:?}");
    assert!(waits.iter().zip([1.0, 2.0, 4.0, 8.0, 16.0]).all(|(wait, least)| *wait > 0.9 * least), "{waits:?}");
    page.eval("window.fetch = window.realFetch");
    set(page, "max_samples", SAMPLES);
    wait_until_done(page);
    assert_eq!(page.eval("document.querySelector('#alert').hidden"), true, "a picture that came clears the fault");
}

/// A browser has six connections to a server for all its tabs: those that nobody sees must not take them.
pub fn a_page_out_of_sight_holds_no_connection(page: &mut Browser) {
    let show = |hidden: bool| {
        format!(
            "(() => {{
                Object.defineProperty(document, 'hidden', {{ configurable: true, value: {hidden} }});
                document.dispatchEvent(new Event('visibilitychange'));
            }})()"
        )
    };
    let listeners = |count: u32| {
        format!(
            "fetch('/metrics').then((reply) => reply.text()).then((all) => all.includes('\\ncandela_http_event_streams {count}\\n'))"
        )
    };
    set(page, "max_samples", 1_000_000);
    page.wait_for(&listeners(1));
    page.eval(&show(true));
    page.wait_for(&listeners(0));
    page.eval(&show(false));
    page.wait_for(&listeners(1));
    page.eval("delete document.hidden");
    set(page, "max_samples", SAMPLES);
    wait_until_done(page);
}

/// The scene and the maps are sent once more, and previews stay on.
pub fn a_server_that_forgot_is_sent_everything_again(page: &mut Browser, server: &mut Server) {
    server.restart();
    page.eval("document.querySelector('#viewport').focus()");
    page.key("ArrowLeft", 37);
    wait_until_done(page);
    assert_eq!(page.eval("document.querySelector('#alert').hidden"), true, "nothing is amiss");
    assert_eq!(text(page, "document.querySelector('[data-setting=moving] select').value"), "preview");
    server.restart();
    click(page, ".compare");
    page.wait_for("document.querySelector('#comparison [role=status]').textContent.startsWith('They differ')");
    click(page, "#comparison .close");
}

/// The browser may keep the page as it was when it was left: the render that was cancelled then is begun anew.
pub fn who_comes_back_sees_the_render_go_on(page: &mut Browser, origin: &str) {
    const NEWEST: &str =
        "fetch('/v1/jobs?limit=1').then((reply) => reply.json()).then(({ items: [{ state }] }) => state)";
    set(page, "max_samples", 1_000_000);
    page.wait_for(&format!("{NEWEST}.then((state) => state === 'running')"));
    page.open(&format!("{origin}/docs"));
    page.wait_for(&format!("{NEWEST}.then((state) => state === 'cancelled')"));
    page.back();
    page.wait_for("document.querySelector('#model-name')?.textContent.includes('.gl')");
    if page.eval("document.querySelector('#model-name').textContent") != "box.gltf" {
        eprintln!("SKIPPED: this browser did not keep the page that was left");
        return;
    }
    page.wait_for(&format!("{NEWEST}.then((state) => state === 'running')"));
    set(page, "max_samples", SAMPLES);
    wait_until_done(page);
}

fn open_broken_file(page: &mut Browser, folder: &Path) {
    let broken = folder.join("broken.glb");
    std::fs::write(&broken, b"glTF, but no further").expect("a file is written");
    page.choose("#choose-files", &[&broken]);
    page.wait_for("!document.querySelector('#alert').hidden");
}

fn jobs_posted(page: &mut Browser) -> usize {
    page.requests().iter().filter(|url| url.ends_with("/v1/jobs")).count()
}
