//! What this program and the processes that it starts of itself share: frames over pipes, and a bound on memory.

use std::io::{self, Read, Write};

/// Address space of the program itself.
const OWN: u64 = 1 << 30;

/// Writes a frame: its length and a message.
///
/// # Errors
/// The other end is gone.
pub fn write_frame(writer: &mut impl Write, message: &[u8]) -> io::Result<()> {
    writer.write_all(&(message.len() as u64).to_le_bytes())?;
    writer.write_all(message)?;
    writer.flush()
}

/// Reads a frame; memory is taken as its bytes arrive, whatever length it claims.
///
/// # Errors
/// The other end is gone before the frame is whole.
pub fn read_frame(reader: &mut impl Read) -> io::Result<Vec<u8>> {
    let mut length = [0; 8];
    reader.read_exact(&mut length)?;
    let length = u64::from_le_bytes(length);
    let mut message = Vec::new();
    reader.take(length).read_to_end(&mut message)?;
    if message.len() as u64 == length { Ok(message) } else { Err(io::ErrorKind::UnexpectedEof.into()) }
}

/// No more memory than that for this process, besides the program itself, where the system can say so.
///
/// # Errors
/// The system refuses.
pub fn restrict_memory(bytes: u64) -> io::Result<()> {
    #[cfg(unix)]
    {
        use rustix::process::{Resource, Rlimit, setrlimit};
        let most = Some(bytes.saturating_add(OWN));
        setrlimit(Resource::As, Rlimit { current: most, maximum: most })?;
    }
    #[cfg(not(unix))]
    let _ = bytes;
    Ok(())
}
