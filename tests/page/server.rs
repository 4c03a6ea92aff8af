//! The real server on a free port of this machine.

use std::net::{TcpListener, TcpStream};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A running `candela serve`. Ends with its value.
pub struct Server {
    child: Child,
    address: String,
    /// `http://127.0.0.1:port`
    pub origin: String,
}

impl Server {
    /// Starts it, with arguments of `candela serve`, and waits until it answers.
    pub fn start(arguments: &[&str]) -> Self {
        let free = free_address();
        Self::run(command(&free).args(arguments), free)
    }

    /// Starts one that finds no graphics driver (Vulkan's are named by files).
    pub fn without_graphics() -> Self {
        let free = free_address();
        let mut command = command(&free);
        for name in ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"] {
            command.env(name, "/dev/null");
        }
        Self::run(&mut command, free)
    }

    /// Ends it at once, and starts another at the same address, which knows nothing of what it was sent.
    pub fn restart(&mut self) {
        self.end();
        self.child = command(&self.address).spawn().expect("the server starts");
        self.wait();
    }

    fn run(command: &mut Command, address: String) -> Self {
        let child = command.spawn().expect("the server starts");
        let mut server = Self { child, origin: format!("http://{address}"), address };
        server.wait();
        server
    }

    fn end(&mut self) {
        // The child may be gone already; then there is nothing to end.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }

    fn wait(&mut self) {
        const PATIENCE: Duration = Duration::from_secs(60);
        let start = Instant::now();
        while TcpStream::connect(&self.address).is_err() {
            let ended = self.child.try_wait().expect("a child can be asked");
            assert!(ended.is_none(), "the server ended at once: {ended:?}");
            assert!(start.elapsed() < PATIENCE, "the server did not listen within {PATIENCE:?}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.end();
    }
}

fn free_address() -> String {
    let free = TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr()).expect("a free port");
    free.to_string()
}

fn command(address: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_candela"));
    command.args(["serve", "--listen", address]).stdout(Stdio::null());
    command
}
