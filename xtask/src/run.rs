//! Runs other programs and prints messages.
#![expect(clippy::print_stderr, clippy::print_stdout, reason = "xtask is a command-line program")]

use std::ffi::OsStr;
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context as _, Error, Result, bail};

use crate::hinted::Hinted;
use crate::paths;

/// Prints a message to stderr.
pub(crate) fn say(line: &str) {
    eprintln!("{line}");
}

/// Prints an error, its causes, and then what can be done about it.
pub(crate) fn say_error(error: &Error) {
    for (depth, cause) in error.chain().enumerate() {
        say(&format!("{}{cause}", if depth == 0 { "error: " } else { "  because: " }));
    }
    let hinted = error.chain().filter_map(|cause| cause.downcast_ref::<Hinted>());
    hinted.for_each(|error| say(&format!("hint: {}", error.hint)));
}

/// Prints a result to stdout.
pub(crate) fn print(text: &str) {
    println!("{text}");
}

/// Cargo, the one that runs this program.
pub(crate) fn cargo(arguments: &[&str]) -> Command {
    let program = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut command = Command::new(program);
    command.args(arguments);
    // The variables by which cargo describes this program. Some build scripts read them, and would run again
    // after each change between `cargo xtask` and `cargo`.
    let about_this_program =
        |name: &str| name.starts_with("CARGO_PKG_") || name.starts_with("CARGO_MANIFEST_");
    for (name, _) in std::env::vars_os().filter(|(name, _)| name.to_str().is_some_and(about_this_program)) {
        command.env_remove(name);
    }
    command
}

/// Show the command, run it in the checkout without standard input, and fail unless it succeeds.
pub(crate) fn run(command: &mut Command) -> Result<()> {
    say(&format!("$ {}", shown(command)));
    let status = command
        .current_dir(paths::root())
        .stdin(Stdio::null())
        .status()
        .with_context(|| format!("cannot start `{}`", command.get_program().display()))?;
    if !status.success() {
        bail!("`{}` ended with {status}", named(command));
    }
    Ok(())
}

/// What the command prints on its standard output.
pub(crate) fn output(command: &mut Command) -> Result<String> {
    let output = command
        .stdin(Stdio::null())
        .stderr(Stdio::inherit())
        .output()
        .with_context(|| format!("cannot start `{}`", command.get_program().display()))?;
    if !output.status.success() {
        bail!("`{}` ended with {}", named(command), output.status);
    }
    String::from_utf8(output.stdout)
        .with_context(|| format!("`{}` printed something that is not UTF-8", named(command)))
}

/// Runs every step, also after a failure, and names the failed ones.
pub(crate) fn run_all(what: &str, steps: &mut [(&str, Command)]) -> Result<()> {
    let mut failed = Vec::new();
    for (name, command) in steps.iter_mut() {
        if let Err(error) = run(command) {
            say_error(&error);
            failed.push(*name);
        }
    }
    if !failed.is_empty() {
        bail!("{what}: failed: {}", failed.join(", "));
    }
    let names: Vec<&str> = steps.iter().map(|(name, _)| *name).collect();
    say(&format!("{what}: all good: {}", names.join(", ")));
    Ok(())
}

/// The first words of the command.
fn named(command: &Command) -> String {
    let program = Path::new(command.get_program());
    let words = program.file_name().into_iter().chain(command.get_args().take(2));
    words.map(quoted).collect::<Vec<_>>().join(" ")
}

/// The command as one would type it in the checkout.
fn shown(command: &Command) -> String {
    let settings =
        command.get_envs().filter_map(|(key, value)| Some(format!("{}={}", key.to_str()?, quoted(value?))));
    // Cargo without its path: rust-toolchain.toml decides which one runs.
    let program = Path::new(command.get_program());
    let program = if program.ends_with("cargo") { OsStr::new("cargo") } else { program.as_os_str() };
    let words = std::iter::once(program).chain(command.get_args()).map(quoted);
    settings.chain(words).collect::<Vec<_>>().join(" ")
}

/// A word as a shell takes it.
fn quoted(word: &OsStr) -> String {
    let word = word.to_string_lossy();
    let plain = |c: char| c.is_alphanumeric() || "_-./=:,+@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.into_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_printed_command_can_be_pasted_into_a_shell() {
        let mut command = Command::new("/somewhere/bin/cargo");
        command.args(["doc", "torch>=2,<3", "it's", ""]).env("RUSTDOCFLAGS", "-D warnings");
        assert_eq!(shown(&command), r"RUSTDOCFLAGS='-D warnings' cargo doc 'torch>=2,<3' 'it'\''s' ''");
    }

    #[test]
    fn cargo_starts_without_the_variables_of_this_program() {
        let command = cargo(&["test"]);
        let removed: Vec<_> =
            command.get_envs().filter(|(_, value)| value.is_none()).map(|(name, _)| name).collect();
        assert!(removed.contains(&OsStr::new("CARGO_MANIFEST_DIR")), "{removed:?}");
        assert!(removed.contains(&OsStr::new("CARGO_PKG_NAME")), "{removed:?}");
        assert_eq!(shown(&command).split(' ').next_back(), Some("test"));
    }

    #[test]
    fn every_step_runs_and_the_failed_ones_are_named() {
        let step = |program: &str| Command::new(program);
        let mut steps =
            [("one", step("false")), ("two", step("true")), ("three", step("/nonexistent/program"))];
        let error = run_all("check", &mut steps).unwrap_err().to_string();
        assert_eq!(error, "check: failed: one, three");
        assert!(run_all("check", &mut steps[1..2]).is_ok());
    }

    #[test]
    fn a_program_that_is_missing_is_named() {
        let error = run(&mut Command::new("/nonexistent/program")).unwrap_err();
        assert_eq!(error.to_string(), "cannot start `/nonexistent/program`");
    }
}
