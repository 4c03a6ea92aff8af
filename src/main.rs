//! Arguments -> subcommand; nothing else.

fn main() -> std::process::ExitCode {
    candela::cli::main()
}
