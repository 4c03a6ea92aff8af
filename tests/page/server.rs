//! The real server on a free port of this machine.

use std::net::{TcpListener, TcpStream};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A running `candela serve`. Ends with its value.
pub struct Server {
    child: Child,
    /// `http://127.0.0.1:port`
    pub origin: String,
}

impl Server {
    /// Starts it, with arguments of `candela serve`, and waits until it answers.
    pub fn start(arguments: &[&str]) -> Self {
        let free = TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr()).expect("a free port");
        let child = Command::new(env!("CARGO_BIN_EXE_candela"))
            .args(["serve", "--listen", &free.to_string()])
            .args(arguments)
            .stdout(Stdio::null())
            .spawn()
            .expect("the server starts");
        let mut server = Self { child, origin: format!("http://{free}") };
        server.wait();
        server
    }

    fn wait(&mut self) {
        const PATIENCE: Duration = Duration::from_secs(60);
        let start = Instant::now();
        let address = self.origin.trim_start_matches("http://").to_owned();
        while TcpStream::connect(&address).is_err() {
            let ended = self.child.try_wait().expect("a child can be asked");
            assert!(ended.is_none(), "the server ended at once: {ended:?}");
            assert!(start.elapsed() < PATIENCE, "the server did not listen within {PATIENCE:?}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        // The child may be gone already; then there is nothing to end.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
