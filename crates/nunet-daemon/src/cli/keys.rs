//! The keys of the file: which flags are settings, which belong to one camera, and which exclude each other.

use clap::{Arg, Args as _, Command};
use toml::Value;

use super::StreamArgs;

/// The key of a camera's name in its section of the file.
pub(super) const CAMERA_NAME_KEY: &str = "name";

/// Whether a value turns its flag on.
pub(super) fn is_on(value: &Value) -> bool {
    !matches!(value, Value::Boolean(false) | Value::Integer(0))
}

/// Whether two flags cannot be given together.
pub(super) fn excludes(run: &Command, one: &str, other: &str) -> bool {
    let argument = |key: &str| run.get_arguments().find(|argument| argument.get_long() == Some(key));
    let (Some(one), Some(other)) = (argument(one), argument(other)) else { return false };
    let names = |one: &Arg, other: &Arg| {
        run.get_arg_conflicts_with(one).iter().any(|argument| argument.get_id() == other.get_id())
    };
    names(one, other) || names(other, one)
}

/// Whether a flag is a key of the file. The file cannot name another file, and help is not a setting.
pub(super) fn is_setting(argument: &Arg) -> bool {
    argument.get_long().is_some_and(|name| !["config", "help", "version"].contains(&name))
}

/// The long names of the flags that belong to one camera.
pub(super) fn stream_flags() -> Vec<String> {
    let command = StreamArgs::augment_args(Command::new("camera"));
    command.get_arguments().filter_map(Arg::get_long).map(str::to_owned).collect()
}
