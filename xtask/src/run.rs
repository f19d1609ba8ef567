//! Running other programs, and talking to people.
#![expect(
    clippy::print_stderr,
    clippy::print_stdout,
    reason = "talking to people is what xtask does"
)]

use std::ffi::OsStr;
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context as _, Result, bail};

use crate::paths;

/// A line for people.
pub(crate) fn say(line: &str) {
    eprintln!("{line}");
}

/// A result, which somebody may want to pipe.
pub(crate) fn print(text: &str) {
    println!("{text}");
}

/// Cargo, the one that runs this program.
pub(crate) fn cargo(arguments: &[&str]) -> Command {
    let program = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut command = Command::new(program);
    command.args(arguments);
    command
}

/// Show the command, run it in the checkout without standard input, and fail unless it succeeds.
pub(crate) fn run(command: &mut Command) -> Result<()> {
    let shown = shown(command);
    say(&format!("$ {shown}"));
    let status = command
        .current_dir(paths::root())
        .stdin(Stdio::null())
        .status()
        .with_context(|| format!("cannot start `{}`", command.get_program().display()))?;
    if !status.success() {
        bail!("`{shown}` ended with {status}");
    }
    Ok(())
}

/// What the command prints on its standard output.
pub(crate) fn output(command: &mut Command) -> Result<String> {
    let shown = shown(command);
    let output = command
        .stdin(Stdio::null())
        .stderr(Stdio::inherit())
        .output()
        .with_context(|| format!("cannot start `{}`", command.get_program().display()))?;
    if !output.status.success() {
        bail!("`{shown}` ended with {}", output.status);
    }
    String::from_utf8(output.stdout).with_context(|| format!("`{shown}` printed something that is not UTF-8"))
}

/// Run every step, though one before it failed, and name the ones that failed: one run tells everything.
pub(crate) fn run_all(what: &str, steps: &mut [(&str, Command)]) -> Result<()> {
    let mut failed = Vec::new();
    for (name, command) in steps.iter_mut() {
        if let Err(error) = run(command) {
            say(&format!("error: {error:#}"));
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

fn shown(command: &Command) -> String {
    let settings = command
        .get_envs()
        .filter_map(|(key, value)| Some(format!("{}={}", key.to_str()?, value?.to_str()?)));
    // Which cargo is rust-toolchain.toml's business; the long path would only hide the words that matter.
    let program = Path::new(command.get_program());
    let program = if program.ends_with("cargo") {
        OsStr::new("cargo")
    } else {
        program.as_os_str()
    };
    let words = std::iter::once(program).chain(command.get_args());
    let words = words.map(|word| word.to_string_lossy().into_owned());
    settings.chain(words).collect::<Vec<_>>().join(" ")
}
