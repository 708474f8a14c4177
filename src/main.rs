//! The `harmzone` program: parse, run, exit code.

fn main() -> std::process::ExitCode {
    harmzone::cli::main()
}
