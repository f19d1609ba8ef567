//! The manual's pages and the shells' completions, for packages:
//! `cargo run --package nunet-daemon --example manual -- FOLDER`.

use std::fs;
use std::io::Result;
use std::path::PathBuf;

use clap::CommandFactory as _;
use clap_complete::Shell;
use nunet_daemon::cli::Cli;

fn main() -> Result<()> {
    let folder = PathBuf::from(std::env::args_os().nth(1).unwrap_or_else(|| "target/manual".into()));
    let (man, completions) = (folder.join("man"), folder.join("completions"));
    fs::create_dir_all(&man)?;
    fs::create_dir_all(&completions)?;
    clap_mangen::generate_to(Cli::command(), &man)?;
    for shell in [Shell::Bash, Shell::Zsh, Shell::Fish] {
        clap_complete::generate_to(shell, &mut Cli::command(), "nunetd", &completions)?;
    }
    fs::rename(completions.join("nunetd.bash"), completions.join("nunetd"))
}
