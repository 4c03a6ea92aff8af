//! Drafts while the hand moves, and the rasterised picture beside the traced one.

use crate::axe::Axe;
use crate::browser::Browser;
use crate::controls::*;
use std::time::{Duration, Instant};

const MOVING: &str = "document.querySelector('[data-setting=moving] select').value";

/// While a button is held down and moves, rasterised pictures come and replace each other.
pub fn previews_follow_a_hand(page: &mut Browser) {
    page.eval(
        "(() => {
            window.shown = 0;
            const observer = new MutationObserver((changes) => { window.shown += changes.length; });
            observer.observe(document.querySelector('#viewport img'), { attributeFilter: ['src'] });
            const figures = new Set();
            const timer = setInterval(() => {
                const shown = document.querySelector('#status .words').textContent === 'Draft';
                if (shown) figures.add(document.querySelector('[data-number=error]').textContent);
                window.draftError = [...figures];
            }, 20);
            window.stopCounting = () => { observer.disconnect(); clearInterval(timer); };
        })()",
    );
    let begun = Instant::now();
    page.drag_slowly(MIDDLE, (MIDDLE.0 + 120.0, MIDDLE.1 - 30.0), Duration::from_secs(3));
    let (seconds, shown) = (begun.elapsed().as_secs_f64(), page.eval("window.shown").as_u64().unwrap_or(0));
    page.eval("window.stopCounting()");
    assert_eq!(page.eval("window.draftError"), serde_json::json!(["–"]), "a draft has no measured error");
    eprintln!("{shown} previews within {seconds:.1} s of dragging: {:.1} a second", shown as f64 / seconds);
    assert!(shown >= 3, "{shown} previews in {seconds} s");
    // Back to the lit side.
    page.drag((MIDDLE.0 + 120.0, MIDDLE.1 - 30.0), MIDDLE);
    wait_until_done(page);
}

/// A server without graphics driver refuses previews: drafts are traced from then on, and the page says why.
pub fn drafts_are_traced_where_nothing_can_draw(page: &mut Browser) {
    page.drag(MIDDLE, (MIDDLE.0 + 60.0, MIDDLE.1));
    wait_until_done(page);
    assert_eq!(text(page, MOVING), "traced");
    let told = text(page, "document.querySelector('#notes').innerText");
    assert!(told.contains("no graphics driver"), "{told}");
}

/// What the server refuses for another reason is no reason to give previews up.
pub fn a_refused_draft_leaves_previews_on(page: &mut Browser) {
    let intensity = |value: &str| {
        format!(
            "(() => {{
                const input = [...document.querySelectorAll('#lights .card .field')]
                    .find((field) => field.textContent.startsWith('Intensity')).querySelector('input[type=number]');
                const before = input.value;
                input.value = '{value}';
                input.dispatchEvent(new Event('input', {{ bubbles: true }}));
                return before;
            }})()"
        )
    };
    let before = text(page, &intensity("1e300"));
    page.wait_for("document.querySelector('#status .words').textContent === 'Failed'");
    assert_eq!(text(page, MOVING), "preview");
    page.eval(&intensity(&before));
    wait_until_done(page);
}

pub fn previews_are_drawn_and_compared(page: &mut Browser, axe: &Axe) {
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
    assert_eq!(page.eval("document.querySelector('.compare').disabled"), true, "a preview is not compared with itself");
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
