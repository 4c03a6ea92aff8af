//! Just enough of the Chrome DevTools protocol to use the page as a person does, and to see what it does.

use serde_json::{Value, json};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;
use tungstenite::{Message, WebSocket};

const NAMES: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"];
const FLAGS: [&str; 9] = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--remote-debugging-port=0",
];
const START: Duration = Duration::from_secs(30);
const REPLY: Duration = Duration::from_secs(30);

/// A Chromium of our own with one tab. Ends with its value.
pub struct Browser {
    child: Child,
    _profile: TempDir,
    socket: WebSocket<TcpStream>,
    session: Option<String>,
    calls: u64,
    events: Vec<Value>,
    user: Option<(String, String)>,
}

/// Where Chromium is, if it is installed.
pub fn find() -> Option<&'static str> {
    let runs = |name: &&&str| {
        let version = Command::new(name).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status();
        version.is_ok_and(|status| status.success())
    };
    NAMES.iter().find(runs).copied()
}

impl Browser {
    /// Starts Chromium with an empty profile and an empty tab of the given size.
    pub fn start(program: &str, width: u32, height: u32) -> Self {
        let profile = tempfile::tempdir().expect("a folder for the profile");
        let child = Command::new(program)
            .args(FLAGS)
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .arg(format!("--window-size={width},{height}"))
            .arg("about:blank")
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("Chromium starts");
        let (port, path) = debugging_address(profile.path());
        let stream = TcpStream::connect(("127.0.0.1", port)).expect("Chromium listens");
        stream.set_read_timeout(Some(REPLY)).expect("a socket takes a timeout");
        let (socket, _) = tungstenite::client(format!("ws://127.0.0.1:{port}{path}"), stream).expect("a handshake");
        let mut browser =
            Self { child, _profile: profile, socket, session: None, calls: 0, events: Vec::new(), user: None };
        let target = browser.call("Target.createTarget", json!({ "url": "about:blank" }));
        let attached = browser
            .call("Target.attachToTarget", json!({ "targetId": target["targetId"], "flatten": true }))["sessionId"]
            .as_str()
            .map(str::to_owned);
        browser.session = attached;
        for domain in ["Page", "Runtime", "Log", "Network", "DOM"] {
            browser.call(&format!("{domain}.enable"), json!({}));
        }
        browser
    }

    /// One command of the protocol and its result; events that come meanwhile are kept.
    pub fn call(&mut self, method: &str, params: Value) -> Value {
        self.calls += 1;
        let id = self.calls;
        let mut message = json!({ "id": id, "method": method });
        message["params"] = params;
        if let Some(session) = &self.session {
            message["sessionId"] = json!(session);
        }
        self.socket.send(Message::text(message.to_string())).expect("Chromium takes a command");
        loop {
            let reply = self.socket.read().unwrap_or_else(|error| panic!("no answer to {method}: {error}"));
            let Message::Text(text) = reply else { continue };
            let mut reply: Value = serde_json::from_str(&whole(&text)).expect("the protocol speaks JSON");
            if reply["id"] == id {
                assert!(reply["error"].is_null(), "{method}: {}", reply["error"]);
                return reply["result"].take();
            }
            self.answer(&reply);
            self.events.push(reply);
        }
    }

    /// Gives a name and a password whenever the browser would ask its user for them.
    pub fn log_in(&mut self, name: &str, password: &str) {
        self.user = Some((name.to_owned(), password.to_owned()));
        self.call("Fetch.enable", json!({ "handleAuthRequests": true }));
    }

    /// Lets a request go on that waits for [`Self::log_in`]; a second time the password is wrong.
    fn answer(&mut self, event: &Value) {
        let id = &event["params"]["requestId"];
        let (method, params) = match (event["method"].as_str(), &self.user) {
            (Some("Fetch.requestPaused"), _) => ("Fetch.continueRequest", json!({ "requestId": id })),
            (Some("Fetch.authRequired"), Some((name, password))) => {
                let response = json!({ "response": "ProvideCredentials", "username": name, "password": password });
                ("Fetch.continueWithAuth", json!({ "requestId": id, "authChallengeResponse": response }))
            }
            _ => return,
        };
        self.calls += 1;
        let mut message = json!({ "id": self.calls, "method": method, "params": params });
        message["sessionId"] = json!(self.session);
        self.socket.send(Message::text(message.to_string())).expect("Chromium takes a command");
    }

    /// Loads an address and waits until its modules have run.
    pub fn open(&mut self, url: &str) {
        self.call("Page.navigate", json!({ "url": url }));
        self.wait_for("document.readyState === 'complete' && location.protocol !== 'about:'");
    }

    /// Goes back in the history of the tab.
    pub fn back(&mut self) {
        let history = self.call("Page.getNavigationHistory", json!({}));
        let here = history["currentIndex"].as_u64().expect("a place in the history") as usize;
        self.call("Page.navigateToHistoryEntry", json!({ "entryId": history["entries"][here - 1]["id"] }));
        // The page there is shown by and by.
        std::thread::sleep(Duration::from_secs(1));
    }

    /// Value of an expression in the page.
    pub fn eval(&mut self, expression: &str) -> Value {
        let params = json!({ "expression": expression, "awaitPromise": true, "returnByValue": true });
        let mut reply = self.call("Runtime.evaluate", params);
        assert!(reply["exceptionDetails"].is_null(), "{expression}: {}", reply["exceptionDetails"]);
        reply["result"]["value"].take()
    }

    /// Waits until an expression, or what it promises, is true.
    pub fn wait_for(&mut self, condition: &str) {
        const PATIENCE: Duration = Duration::from_secs(120);
        let start = Instant::now();
        while self.eval(&format!("Promise.resolve({condition}).then(Boolean)")) != json!(true) {
            if start.elapsed() > PATIENCE {
                self.screenshot("failure");
                let status = self.eval("document.querySelector('#status')?.innerText");
                panic!("in {PATIENCE:?} this did not come true: {condition}; status: {status}; see failure.png");
            }
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Gives files to a file input.
    pub fn choose(&mut self, selector: &str, files: &[&Path]) {
        let document = self.call("DOM.getDocument", json!({}));
        let query = json!({ "nodeId": document["root"]["nodeId"], "selector": selector });
        let node = self.call("DOM.querySelector", query);
        self.call("DOM.setFileInputFiles", json!({ "nodeId": node["nodeId"], "files": files }));
    }

    /// Drops files on a point of the page.
    pub fn drop_files(&mut self, (x, y): (f64, f64), files: &[&Path]) {
        let data = json!({ "items": [], "files": files, "dragOperationsMask": 1 });
        for kind in ["dragEnter", "dragOver", "drop"] {
            self.call("Input.dispatchDragEvent", json!({ "type": kind, "x": x, "y": y, "data": data }));
        }
    }

    /// Drags with the left button from one point to another, as a quick hand does.
    pub fn drag(&mut self, from: (f64, f64), to: (f64, f64)) {
        self.drag_slowly(from, to, Duration::from_millis(160));
    }

    /// Drags with the left button from one point to another, taking its time.
    pub fn drag_slowly(&mut self, from: (f64, f64), to: (f64, f64), time: Duration) {
        const STEP: Duration = Duration::from_millis(20);
        let steps = time.as_millis().div_ceil(STEP.as_millis()) as u32;
        let mut mouse = |kind: &str, (x, y): (f64, f64)| {
            let params = json!({ "type": kind, "x": x, "y": y, "button": "left", "buttons": 1, "clickCount": 1 });
            self.call("Input.dispatchMouseEvent", params);
        };
        mouse("mousePressed", from);
        for step in 1..=steps {
            let part = f64::from(step) / f64::from(steps);
            mouse("mouseMoved", (from.0 + (to.0 - from.0) * part, from.1 + (to.1 - from.1) * part));
            std::thread::sleep(STEP);
        }
        mouse("mouseReleased", to);
    }

    /// Presses fingers down, moves them and lifts them; each finger is a path of two points.
    pub fn touch(&mut self, fingers: &[[(f64, f64); 2]]) {
        let points = |end: usize| -> Vec<Value> {
            fingers
                .iter()
                .enumerate()
                .map(|(id, path)| json!({ "x": path[end].0, "y": path[end].1, "id": id }))
                .collect()
        };
        for (kind, touch_points) in [("touchStart", points(0)), ("touchMove", points(1)), ("touchEnd", Vec::new())] {
            self.call("Input.dispatchTouchEvent", json!({ "type": kind, "touchPoints": touch_points }));
        }
    }

    /// Presses and releases a key.
    pub fn key(&mut self, key: &str, code: u32) {
        for kind in ["keyDown", "keyUp"] {
            let params = json!({ "type": kind, "key": key, "code": key, "windowsVirtualKeyCode": code });
            self.call("Input.dispatchKeyEvent", params);
        }
    }

    /// Looks at the page as a device of this size does, in a colour scheme.
    pub fn emulate(&mut self, width: u32, height: u32, mobile: bool, scheme: &str) {
        let device = json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": mobile });
        self.call("Emulation.setDeviceMetricsOverride", device);
        self.call("Emulation.setTouchEmulationEnabled", json!({ "enabled": mobile, "maxTouchPoints": 5 }));
        let features = json!([{ "name": "prefers-color-scheme", "value": scheme }]);
        self.call("Emulation.setEmulatedMedia", json!({ "features": features }));
    }

    /// Writes what is to be seen to `target/page-test/{name}.png`.
    pub fn screenshot(&mut self, name: &str) {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).parent().expect("target has a place").join("page-test");
        std::fs::create_dir_all(&folder).expect("a folder for pictures");
        let reply = self.call("Page.captureScreenshot", json!({ "format": "png" }));
        let bytes =
            base64::Engine::decode(&base64::prelude::BASE64_STANDARD, reply["data"].as_str().expect("a picture"));
        std::fs::write(folder.join(format!("{name}.png")), bytes.expect("base64")).expect("a picture is written");
    }

    /// Everything that went wrong in the page: exceptions, console errors, blocked or failed loads.
    pub fn complaints(&mut self) -> Vec<String> {
        self.settle();
        let complaint = |event: &Value| {
            let params = &event["params"];
            let wrong = match event["method"].as_str()? {
                "Runtime.exceptionThrown" => true,
                "Runtime.consoleAPICalled" => params["type"] == "error" || params["type"] == "assert",
                "Log.entryAdded" => params["entry"]["level"] == "error",
                _ => false,
            };
            wrong.then(|| params.to_string())
        };
        self.events.iter().filter_map(complaint).collect()
    }

    /// Addresses that the page asked for.
    pub fn requests(&mut self) -> Vec<String> {
        self.settle();
        let sent = self.events.iter().filter(|event| event["method"] == "Network.requestWillBeSent");
        sent.filter_map(|event| Some(event["params"]["request"]["url"].as_str()?.to_owned())).collect()
    }

    /// Any answered command comes after the events that went before it.
    fn settle(&mut self) {
        self.eval("0");
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        // The child may be gone already; then there is nothing to end.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Chromium writes the port that it chose, and the path of its socket, into its profile.
fn debugging_address(profile: &Path) -> (u16, String) {
    let file = profile.join("DevToolsActivePort");
    let start = Instant::now();
    while start.elapsed() < START {
        let text = std::fs::read_to_string(&file).unwrap_or_default();
        if let Some((port, path)) = text.split_once('\n').filter(|(_, path)| path.starts_with('/')) {
            return (port.parse().expect("a port"), path.trim().to_owned());
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    panic!("Chromium did not say its port within {START:?}");
}

/// A message with U+FFFD in place of halves of surrogate pairs: an uploaded file's bytes come as text with such, which Rust's has not.
fn whole(message: &str) -> String {
    let escape = |rest: &str| rest.strip_prefix("\\u").and_then(|hex| u32::from_str_radix(hex.get(..4)?, 16).ok());
    let (mut text, mut rest) = (String::with_capacity(message.len()), message);
    while let Some(at) = rest.find('\\') {
        text.push_str(&rest[..at]);
        rest = &rest[at..];
        let follower = || rest.get(6..).and_then(escape);
        let (length, broken) = match escape(rest) {
            Some(0xd800..0xdc00) if matches!(follower(), Some(0xdc00..0xe000)) => (12, false),
            Some(0xd800..0xe000) => (6, true),
            Some(_) => (6, false),
            None => (2, false),
        };
        text.push_str(if broken { "\u{fffd}" } else { &rest[..length] });
        rest = &rest[length..];
    }
    text + rest
}
