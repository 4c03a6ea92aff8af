//! `candela key`: the file of keys that `candela serve --keys` reads. A running server sees a change within a second or two.

use super::Failure;
use crate::http::keys::{KeyError, KeyFile, Scope};
use clap::{Args, Subcommand};
use std::io::Write;
use std::path::PathBuf;

/// Arguments of `candela key`.
#[derive(Debug, Args)]
pub struct KeyArgs {
    /// File of keys.
    #[arg(long, env = "CANDELA_KEYS", value_name = "FILE", global = true, default_value = "keys.json")]
    keys: PathBuf,
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    /// Makes a key and prints it, which happens once: the file has its hash alone.
    Add {
        /// For lists and logs.
        name: String,
        /// What it may do; each includes those before it.
        #[arg(long, value_enum, default_value_t = Scope::Render)]
        scope: Scope,
        /// Requests a minute, and as many at once; by default without bound.
        #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u32).range(1..))]
        requests_per_minute: Option<u32>,
        /// Renders a day (UTC); by default without bound.
        #[arg(long, value_name = "COUNT")]
        renders_per_day: Option<u64>,
    },
    /// Lists the keys by name.
    List,
    /// Takes a key away.
    Revoke {
        /// Its name.
        name: String,
    },
}

/// Changes the file, or shows it.
pub fn run(arguments: &KeyArgs) -> Result<(), Failure> {
    let keys = &arguments.keys;
    let text = match &arguments.what {
        What::Add { name, scope, requests_per_minute, renders_per_day } => {
            let key = KeyFile::change(keys, |file| file.add(name, *scope, *requests_per_minute, *renders_per_day));
            key.map(|key| format!("{key}\n"))
        }
        What::List => KeyFile::read(keys).map(|file| list(&file)),
        // A file that is not there has no such key, and is not made for that.
        What::Revoke { name } => {
            KeyFile::read(keys).and_then(|_| KeyFile::change(keys, |file| file.revoke(name))).map(|()| String::new())
        }
    };
    let text = text.map_err(|error| failure(&error))?;
    let written = std::io::stdout().write_all(text.as_bytes());
    written.map_err(|error| Failure::Machine(format!("standard output: {error}")))
}

fn list(file: &KeyFile) -> String {
    let bound = |bound: Option<u64>| bound.map_or_else(|| "-".to_owned(), |bound| bound.to_string());
    let mut text = format!("{:<24} {:<8} {:>15} {:>12}\n", "name", "scope", "requests/minute", "renders/day");
    for key in &file.keys {
        let scope = serde_json::json!(key.scope);
        let (rate, quota) = (bound(key.requests_per_minute.map(u64::from)), bound(key.renders_per_day));
        text += &format!("{:<24} {:<8} {rate:>15} {quota:>12}\n", key.name, scope.as_str().unwrap_or_default());
    }
    text
}

fn failure(error: &KeyError) -> Failure {
    match error {
        KeyError::File(path, error) if error.kind() == std::io::ErrorKind::NotFound => {
            Failure::Request(format!("--keys {}: {error}", path.display()))
        }
        KeyError::File(..) => Failure::Machine(error.to_string()),
        KeyError::Content(..) | KeyError::Request(_) => Failure::Request(error.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_come_and_go() {
        let folder = tempfile::tempdir().unwrap();
        let keys = folder.path().join("keys.json");
        let run = |what| run(&KeyArgs { keys: keys.clone(), what });
        let name = || "ci".to_owned();
        let add =
            || What::Add { name: name(), scope: Scope::Read, requests_per_minute: Some(9), renders_per_day: None };
        run(add()).unwrap();
        assert_eq!(run(add()).unwrap_err().exit_code(), 2);
        let listed = list(&KeyFile::read(&keys).unwrap());
        assert!(listed.contains("ci") && listed.contains("read") && listed.contains('9'), "{listed}");
        run(What::Revoke { name: name() }).unwrap();
        assert_eq!(run(What::Revoke { name: name() }).unwrap_err().exit_code(), 2);
    }
}
