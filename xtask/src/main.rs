//! `cargo xtask`: setup, checks, packages and the demo. Needs only cargo, a C compiler and python3.

mod browser;
mod bundle;
mod check;
mod deb;
mod demo;
mod dev_package;
mod hinted;
mod interpreter;
mod latency_table;
mod package;
mod paper_models;
mod paths;
mod python;
mod rerun;
mod ros2;
mod run;
mod setup;
mod test;
mod wheel;
mod wheels;

use std::process::ExitCode;

const USAGE: &str = "\
usage: cargo xtask COMMAND

  setup          fetch ONNX Runtime's library into the cache, if it is not there
  demo           run nunetd on its demo; images, cloud and a recording in target/demo/
  check          format, lints, documentation, structure of the source; needs no root
  test           all tests, Rust and Python; those that need root say so and are skipped without it
  test --ros2    ROS 2 topics, received by rclpy from the package index; needs CPython 3.11
  test --rerun   a recording, opened by Rerun from the package index
  test --browser the live view in Chromium, with screenshots in target/browser/
  package        build the Python package for the tests; prints the interpreter that has it
  bundle         copy the models of the Python package from models/
  wheel          build the Python package and collect its dependencies as wheels in dist/; install and try them
  deb            build the Debian packages nunetd and nunet-dev in target/debian/, with cargo-deb
  paper-models   export the paper's networks at 480x640 to target/paper-models/

The package index is the one that pip is configured to use. The cache is $XDG_CACHE_HOME/nunet or ~/.cache/nunet.";

const BAD_ARGUMENTS: u8 = 2;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let done = match words.as_slice() {
        ["setup"] => setup::setup(),
        ["demo"] => demo::demo(),
        ["check"] => check::check(),
        ["test"] => test::test(),
        ["test", "--browser"] => browser::test(),
        ["test", "--rerun"] => rerun::test(),
        ["test", "--ros2"] => ros2::test(),
        ["package"] => package::package(),
        ["bundle"] => bundle::bundle(),
        ["wheel"] => wheel::wheel(),
        ["deb"] => deb::deb(),
        ["paper-models"] => paper_models::paper_models(),
        ["help" | "--help" | "-h"] => {
            run::print(USAGE);
            return ExitCode::SUCCESS;
        }
        _ => {
            run::say(USAGE);
            return ExitCode::from(BAD_ARGUMENTS);
        }
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            run::say_error(&error);
            ExitCode::FAILURE
        }
    }
}
