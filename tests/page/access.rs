//! Everybody can use it: with keys alone, with a screen reader, on a phone.

use crate::axe::Axe;
use crate::browser::Browser;
use crate::controls::*;

/// The tab key comes to every control that is to be seen, and where it stands is marked.
pub fn everything_is_reached_by_keys(page: &mut Browser) {
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
pub fn it_is_accessible(page: &mut Browser, axe: &Axe) {
    for scheme in ["light", "dark"] {
        page.emulate(1360, 850, false, scheme);
        assert_eq!(page.eval("document.documentElement.scrollHeight"), 850, "panels scroll, not the page");
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

/// Names of files may be of any length.
pub fn long_names_widen_nothing(page: &mut Browser) {
    page.eval(
        "(() => {
            const names = [...document.querySelectorAll('#model-name, .file-name')];
            window.before = names.map((name) => [name, name.textContent]);
            for (const name of names) name.textContent = 'n'.repeat(300);
        })()",
    );
    let wider = page.eval(
        "[document.documentElement, document.querySelector('.panels')].map((e) => e.scrollWidth - e.clientWidth)",
    );
    assert_eq!(wider, serde_json::json!([0, 0]), "the page and its panels fit their width");
    page.eval("for (const [name, text] of window.before) name.textContent = text");
}

pub fn it_fits_a_phone(page: &mut Browser, axe: &Axe) {
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
