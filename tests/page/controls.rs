//! What a visitor does with the page's controls, and what is then on screen.

use crate::browser::Browser;

pub const WIDTH: u32 = 320;
pub const HEIGHT: u32 = 200;
pub const SAMPLES: u32 = 8;

/// Middle of the picture on the desktop layout of the test.
pub const MIDDLE: (f64, f64) = (480.0, 320.0);

/// Mean difference of the channels, 0 to 255, that no noise between equal pictures reaches: same seed, same bytes.
pub const CHANGED: f64 = 0.5;

const PIXELS: &str = "(() => {
    const image = document.querySelector('#viewport img');
    const canvas = new OffscreenCanvas(image.naturalWidth, image.naturalHeight);
    const context = canvas.getContext('2d');
    context.drawImage(image, 0, 0);
    return [...context.getImageData(0, 0, canvas.width, canvas.height).data];
})()";

/// Types a number into a settings field.
pub fn set(page: &mut Browser, setting: &str, value: u32) {
    page.eval(&format!(
        "(() => {{
            const input = document.querySelector('[data-setting={setting}] input[type=number]');
            input.value = '{value}';
            input.dispatchEvent(new Event('change', {{ bubbles: true }}));
        }})()"
    ));
}

pub fn choose_option(page: &mut Browser, selector: &str, value: &str) {
    page.eval(&format!(
        "(() => {{
            const select = document.querySelector('{selector}');
            select.value = '{value}';
            select.dispatchEvent(new Event('change', {{ bubbles: true }}));
        }})()"
    ));
}

pub fn click(page: &mut Browser, selector: &str) {
    page.eval(&format!("document.querySelector('{selector}').click()"));
}

pub fn text(page: &mut Browser, expression: &str) -> String {
    page.eval(expression).as_str().unwrap_or_else(|| panic!("{expression} is no text")).to_owned()
}

pub fn number(page: &mut Browser, name: &str) -> String {
    text(page, &format!("document.querySelector('[data-number={name}]').textContent"))
}

/// Waits for the full-quality picture of what the page shows now, until it is on screen.
pub fn wait_until_done(page: &mut Browser) {
    page.wait_for("!document.querySelector('.png').disabled");
}

/// RGBA of the picture on screen, row by row.
pub fn pixels(page: &mut Browser) -> Vec<u8> {
    let value = page.eval(PIXELS);
    let bytes = value.as_array().expect("pixels are a list").iter();
    bytes.map(|byte| u8::try_from(byte.as_u64().expect("a byte")).expect("a byte")).collect()
}

/// Mean absolute difference of two pictures of one size; of two sizes: everything.
pub fn difference(a: &[u8], b: &[u8]) -> f64 {
    if a.len() != b.len() {
        return 255.0;
    }
    let sum: f64 = a.iter().zip(b).map(|(x, y)| f64::from(x.abs_diff(*y))).sum();
    sum / a.len() as f64
}

/// Standard deviation of the green channel.
pub fn spread(rgba: &[u8]) -> f64 {
    let greens = || rgba.iter().skip(1).step_by(4).map(|byte| f64::from(*byte));
    let count = greens().count() as f64;
    let mean = greens().sum::<f64>() / count;
    (greens().map(|green| (green - mean).powi(2)).sum::<f64>() / count).sqrt()
}
