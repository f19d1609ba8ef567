//! `--config FILE.toml` holds what flags hold: each key is a flag's long name, and a flag on the command line wins.
//!
//! The file becomes flags before clap sees them, so that a value is checked once, by whoever checks the flag.

use std::ffi::OsString;
use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use clap::parser::ValueSource;
use clap::{Arg, ArgAction, ArgMatches, Args, Command};
use nunet_core::text::shortened;
use toml::{Table, Value};

use super::RunArgs;

/// Below this likeness a guess would be an insult.
const LEAST_LIKENESS: f64 = 0.6;
/// A hundred times what all flags take.
const MAX_BYTES: u64 = 64 * 1024;

/// `nunetd config`
#[derive(Debug, Args, Clone)]
pub struct ConfigArgs {
    #[command(flatten)]
    pub run: RunArgs,
    /// Everything as it would be run.
    #[arg(skip)]
    pub effective: String,
}

/// The verbs that take a configuration.
const VERBS: [&str; 2] = ["run", "config"];

/// `arguments` with the flags of the file that `--config` names behind them.
///
/// # Errors
/// The file cannot be read, is no TOML, or says what no flag takes.
pub(super) fn expand(
    mut command: Command,
    mut arguments: Vec<OsString>,
) -> Result<Vec<OsString>, clap::Error> {
    let asked = |argument: &OsString| argument.to_string_lossy().starts_with("--config");
    if !arguments.iter().any(asked) {
        return Ok(arguments);
    }
    command.build();
    // What is wrong with the command line itself is told by whoever parses it next.
    let Ok(matches) = command.clone().try_get_matches_from(&arguments) else { return Ok(arguments) };
    let Some((verb, given)) = matches.subcommand().filter(|(verb, _)| VERBS.contains(verb)) else {
        return Ok(arguments);
    };
    let Some(path) = given.get_one::<PathBuf>("config") else { return Ok(arguments) };
    let run = command.find_subcommand(verb).cloned().unwrap_or_default();
    let refuse = |message: String| {
        let (path, message) = (path.display(), shortened(&message));
        command.clone().error(clap::error::ErrorKind::ValueValidation, format!("`{path}`: {message}"))
    };
    let mut all = Vec::new();
    let mut missing = Vec::new();
    for (key, value) in read(path).map_err(refuse)? {
        let argument = argument_of(&run, &key).map_err(refuse)?;
        let flags = flags_of(argument, &key, &value).map_err(refuse)?;
        if !given_or_excluded(&run, argument, given) {
            missing.extend(flags.clone());
        }
        all.extend(flags);
    }
    let alone = ["nunetd".to_owned(), verb.to_owned()].into_iter().chain(all);
    if let Err(error) = command.clone().try_get_matches_from(alone) {
        let text = error.to_string();
        let text = text.trim_start_matches("error: ").split("\n\nUsage").next().unwrap_or_default();
        return Err(refuse(text.trim_end().to_owned()));
    }
    arguments.extend(missing.into_iter().map(OsString::from));
    Ok(arguments)
}

/// Whether the command line says a flag, or another one that cannot stand beside it.
fn given_or_excluded(run: &Command, argument: &Arg, given: &ArgMatches) -> bool {
    let is_given =
        |argument: &Arg| given.value_source(argument.get_id().as_str()) == Some(ValueSource::CommandLine);
    let excludes =
        |a: &Arg, b: &Arg| run.get_arg_conflicts_with(a).iter().any(|other| other.get_id() == b.get_id());
    let mut others = run.get_arguments().filter(|other| is_given(other));
    others.any(|other| {
        other.get_id() == argument.get_id() || excludes(other, argument) || excludes(argument, other)
    })
}

fn read(path: &Path) -> Result<Table, String> {
    let mut text = String::new();
    let read = File::open(path).and_then(|file| file.take(MAX_BYTES + 1).read_to_string(&mut text));
    read.map_err(|error| format!("cannot read it: {error}"))?;
    if text.len() as u64 > MAX_BYTES {
        return Err(format!("a file of more than {MAX_BYTES} bytes is no configuration"));
    }
    text.parse::<Table>().map_err(|error| format!("it is no TOML: {}", error.to_string().trim_end()))
}

/// The flag of a key; `_` may stand for `-`.
fn argument_of<'a>(run: &'a Command, key: &str) -> Result<&'a Arg, String> {
    let named = key.replace('_', "-");
    let known = || run.get_arguments().filter(|argument| is_setting(argument));
    if let Some(found) = known().find(|argument| argument.get_long() == Some(&named)) {
        return Ok(found);
    }
    let likeness = |name: &str| strsim::jaro_winkler(name, &named);
    let nearest = known().filter_map(Arg::get_long).max_by(|a, b| likeness(a).total_cmp(&likeness(b)));
    Err(match nearest.filter(|name| likeness(name) >= LEAST_LIKENESS) {
        Some(nearest) => format!("unknown key `{key}`\nhint: did you mean `{nearest}`?"),
        None => {
            format!("unknown key `{key}`\nhint: keys are the long names of the flags of `nunetd run --help`")
        }
    })
}

/// The file cannot name another file, and asking for help is no setting.
fn is_setting(argument: &Arg) -> bool {
    argument.get_long().is_some_and(|name| !["config", "help", "version"].contains(&name))
}

fn flags_of(argument: &Arg, key: &str, value: &Value) -> Result<Vec<String>, String> {
    let name = argument.get_long().unwrap_or_default();
    let takes_value = argument.get_action().takes_values();
    match (takes_value, value) {
        (false, Value::Boolean(true)) => Ok(vec![format!("--{name}")]),
        (false, Value::Boolean(false)) => Ok(Vec::new()),
        (false, Value::Integer(count)) if matches!(argument.get_action(), ArgAction::Count) => {
            Ok((0..*count).take(8).map(|_| format!("--{name}")).collect())
        }
        (false, other) => Err(format!("`{key}` is {}; expected true or false", shown(other))),
        (true, Value::Array(values)) if matches!(argument.get_action(), ArgAction::Append) => {
            values.iter().map(|value| Ok(format!("--{name}={}", text_of(key, value)?))).collect()
        }
        (true, value) => Ok(vec![format!("--{name}={}", text_of(key, value)?)]),
    }
}

fn text_of(key: &str, value: &Value) -> Result<String, String> {
    match value {
        Value::String(text) => Ok(text.clone()),
        Value::Integer(number) => Ok(number.to_string()),
        Value::Float(number) => Ok(number.to_string()),
        other => Err(format!("`{key}` is {}; expected a text or a number", shown(other))),
    }
}

fn shown(value: &Value) -> String {
    match value {
        Value::Boolean(_) | Value::Integer(_) | Value::Float(_) | Value::String(_) => format!("`{value}`"),
        other => format!("a {}", other.type_str()),
    }
}

/// What `nunetd run` would do, as a file that `--config` takes.
pub(super) fn effective(command: &Command, matches: &ArgMatches) -> String {
    let mut lines = String::new();
    for argument in command.get_arguments().filter(|argument| is_setting(argument)) {
        let id = argument.get_id().as_str();
        let name = argument.get_long().unwrap_or_default();
        let said = |line: String| format!("{line}{}\n", source_of(matches, id));
        if !argument.get_action().takes_values() {
            let on = match argument.get_action() {
                ArgAction::Count => Value::Integer(matches.get_count(id).into()),
                _ => Value::Boolean(matches.get_flag(id)),
            };
            lines += &said(format!("{name} = {on}"));
            continue;
        }
        let values: Vec<Value> = matches
            .get_raw(id)
            .into_iter()
            .flatten()
            .map(|value| Value::String(value.to_string_lossy().into_owned()))
            .collect();
        match (argument.get_action(), values.as_slice()) {
            (_, []) => lines += &format!("# {name} is not set\n"),
            (ArgAction::Append, values) => {
                lines += &said(format!("{name} = {}", Value::Array(values.to_vec())));
            }
            (_, [value, ..]) => lines += &said(format!("{name} = {value}")),
        }
    }
    lines
}

fn source_of(matches: &ArgMatches, id: &str) -> &'static str {
    match matches.value_source(id) {
        Some(ValueSource::DefaultValue) => "  # default",
        Some(ValueSource::EnvVariable) => "  # from the environment",
        _ => "",
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Cli, Verb};
    use super::*;

    fn parse(config: &str, rest: &str) -> Result<Verb, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("nunetd.toml");
        std::fs::write(&path, config).unwrap();
        let line = format!("nunetd {rest} --config {}", path.display());
        let cli = Cli::parse_line(line.split_whitespace().map(OsString::from));
        cli.map(|cli| cli.verb).map_err(|error| error.to_string().replace(path.to_str().unwrap(), "[FILE]"))
    }

    fn run(config: &str, rest: &str) -> RunArgs {
        match parse(config, rest) {
            Ok(Verb::Run(arguments)) => *arguments,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_file_says_what_flags_say() {
        let config = "model = 'a.onnx'\nrate = 15.5\nloop = true\nframe_id = 'eye'\npublish = ['depth', 'cloud']\n\
                      every = ['segmentation=3']\nreaders = 2\nfilter = ['holes', 'spatial=alpha:0.4,delta:0.1']";
        let arguments = run(config, "run");
        assert_eq!(arguments.model, PathBuf::from("a.onnx"));
        assert_eq!(arguments.pace.rate, Some(crate::source::Rate::Hz(15.5)));
        assert!(arguments.pace.repeat);
        assert_eq!(arguments.frame_id.as_deref(), Some("eye"));
        assert_eq!(arguments.publish.len(), 2);
        assert_eq!(arguments.every.len(), 1);
        assert_eq!(arguments.optics.filters.filters.len(), 2);
        assert_eq!(arguments.readers.map(std::num::NonZero::get), Some(2));
    }

    #[test]
    fn flags_win() {
        let arguments =
            run("model = 'a.onnx'\npublish = ['depth', 'cloud']", "--model b.onnx --publish labels");
        assert_eq!(arguments.model, PathBuf::from("b.onnx"));
        assert_eq!(arguments.publish, [super::super::Publish::Labels]);
        let geometry = run("intrinsics = '500,500,320,240'", "run --calibration a.yaml").optics.lens.geometry;
        assert_eq!((geometry.intrinsics, geometry.calibration), (None, Some("a.yaml".into())));
    }

    #[track_caller]
    fn assert_refused(config: &str, part: &str) {
        let error = parse(config, "run").unwrap_err();
        assert!(error.contains(part), "{error}");
    }

    #[test]
    fn what_no_flag_takes_is_told_with_the_nearest_name() {
        assert_refused("modle = 'a.onnx'", "`[FILE]`: unknown key `modle`\nhint: did you mean `model`?");
        assert_refused("zzz = 1", "unknown key `zzz`\nhint: keys are the long names of the flags");
        assert_refused("config = 'other.toml'", "unknown key `config`");
        assert_refused("loop = 'yes'", "`loop` is `\"yes\"`; expected true or false");
        assert_refused("model = true", "`model` is `true`; expected a text or a number");
        assert_refused("model = {a = 1}", "`model` is a table; expected a text or a number");
        assert_refused("model = ", "`[FILE]`: it is no TOML");
        assert_refused("rate = -3", "expected `max` or frames a second above 0");
        assert_refused("intrinsics = '1,2,3,4'\ncalibration = 'a.yaml'", "cannot be used with");
    }

    #[test]
    fn a_file_that_is_endless_or_one_line_is_refused_in_few_words() {
        for config in ["#".repeat(100_000), format!("a = {}", "[".repeat(60_000))] {
            let error = parse(&config, "run").unwrap_err();
            assert!(error.contains("`[FILE]`: ") && error.len() < 2000, "{error}");
        }
        let line = ["nunetd", "--config", "/dev/zero"].map(OsString::from);
        let error = Cli::parse_line(line).unwrap_err().to_string();
        assert!(error.contains("a file of more than 65536 bytes is no configuration"), "{error}");
    }

    #[test]
    fn a_missing_file_is_told() {
        let error = Cli::parse_line(["nunetd", "--config", "missing.toml"].map(OsString::from)).unwrap_err();
        assert!(error.to_string().contains("`missing.toml`: cannot read it:"), "{error}");
    }

    #[test]
    fn the_effective_configuration_is_a_configuration_again() {
        let Ok(Verb::Config(first)) = parse("rate = 5\nloop = true", "config --frames 3") else { panic!() };
        assert!(first.effective.contains("rate = \"5\"\nloop = true\n"), "{}", first.effective);
        assert!(first.effective.contains("model = \"wnet_c.onnx\"  # default"), "{}", first.effective);
        assert!(first.effective.contains("# record is not set"), "{}", first.effective);
        let Ok(Verb::Config(second)) = parse(&first.effective, "config") else { panic!() };
        let plain = |text: &str| text.replace("  # default", "");
        assert_eq!(plain(&first.effective), plain(&second.effective));
    }
}
