//! `--config FILE.toml` holds what flags hold: each key is a flag's long name, and a flag on the command line wins.
//!
//! The file becomes flags before clap sees them, so that a value is checked once, by whoever checks the flag. With
//! `[[camera]]` sections it becomes a command line for each camera: what stands above the sections is said to all of them,
//! and what a section says comes before that.

use std::ffi::OsString;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use clap::parser::ValueSource;
use clap::{Arg, ArgAction, ArgMatches, Args, Command};
use nunet_core::plain_file;
use nunet_core::text::shortened;
use nunet_ipc::Limits;
use toml::{Table, Value};

use super::{RunArgs, StreamArgs};
use crate::source::SourceName;
use crate::words::default_frame_id;

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

/// The subcommands that take a configuration.
const WITH_CONFIG: [&str; 2] = ["run", "config"];

/// A key of the file as flags.
#[derive(Clone)]
struct Setting<'a> {
    argument: &'a Arg,
    flags: Vec<String>,
}

/// `arguments` with the flags of the file that `--config` names behind them: one line, or one for each `[[camera]]`
/// section of the file, which differ in what belongs to a camera.
///
/// # Errors
/// The file cannot be read, is no TOML, or says what no flag takes.
pub(super) fn expand(
    mut command: Command,
    arguments: Vec<OsString>,
) -> Result<Vec<Vec<OsString>>, clap::Error> {
    let asked = |argument: &OsString| argument.to_string_lossy().starts_with("--config");
    if !arguments.iter().any(asked) {
        return Ok(vec![arguments]);
    }
    command.build();
    // What the command line lacks may stand in the file.
    let lenient = command.clone().ignore_errors(true).try_get_matches_from(&arguments);
    let Ok(matches) = lenient else { return Ok(vec![arguments]) };
    let Some((subcommand, given)) =
        matches.subcommand().filter(|(subcommand, _)| WITH_CONFIG.contains(subcommand))
    else {
        return Ok(vec![arguments]);
    };
    let Some(path) = given.get_one::<PathBuf>("config") else { return Ok(vec![arguments]) };
    let run = command.find_subcommand(subcommand).cloned().unwrap_or_default();
    let said =
        |argument: &Arg| given.value_source(argument.get_id().as_str()) == Some(ValueSource::CommandLine);
    let typed: Vec<&Arg> = run.get_arguments().filter(|argument| said(argument)).collect();
    let line = |camera: Camera<'_>| {
        let missing =
            camera.settings.into_iter().filter(|setting| !is_excluded(&run, setting.argument, &typed));
        let flags = missing.flat_map(|setting| setting.flags).map(OsString::from);
        let line = arguments.iter().cloned().chain(flags).collect();
        check(&command, &camera.place, line)
    };
    let lines = lines_of(path, &run, given).and_then(|cameras| cameras.into_iter().map(line).collect());
    match lines {
        Ok(lines) => Ok(lines),
        // What is wrong with the command line itself is told by whoever parses it next.
        Err(_) if command.clone().try_get_matches_from(&arguments).is_err() => Ok(vec![arguments]),
        Err(message) => {
            let message = format!("`{}`: {}", path.display(), shortened(&message));
            Err(command.error(clap::error::ErrorKind::ValueValidation, message))
        }
    }
}

/// All that the file says of a camera.
struct Camera<'a> {
    /// How messages call it; empty for a file without sections.
    place: String,
    settings: Vec<Setting<'a>>,
}

/// What the file says of each camera; of the only one where it has no sections.
fn lines_of<'a>(path: &Path, run: &'a Command, given: &ArgMatches) -> Result<Vec<Camera<'a>>, String> {
    let mut table = read(path)?;
    let sections = take_sections(&mut table)?;
    let shared =
        table.iter().map(|(key, value)| setting_of(run, key, value)).collect::<Result<Vec<_>, _>>()?;
    if sections.is_empty() {
        return Ok(vec![Camera { place: String::new(), settings: shared }]);
    }
    for own in OF_ONE_CAMERA {
        if given.value_source(own) == Some(ValueSource::CommandLine) {
            return Err(format!(
                "`--{own}` cannot stand beside the `[[camera]]` sections\nhint: change the section"
            ));
        }
        if shared.iter().any(|setting| setting.argument.get_id() == own) {
            return Err(format!(
                "`{own}` stands above the `[[camera]]` sections\nhint: each section says its own"
            ));
        }
    }
    let cameras = sections.iter().enumerate().map(|(index, section)| {
        let name = section.get("name").and_then(Value::as_str).unwrap_or("without a name");
        let place = format!("camera {} (`{name}`): ", index + 1);
        let settings = section.iter().map(|(key, value)| setting_of_camera(run, key, value));
        let mut settings =
            settings.collect::<Result<Vec<_>, _>>().map_err(|message| format!("{place}{message}"))?;
        let own: Vec<&Arg> = settings.iter().map(|setting| setting.argument).collect();
        let others = shared.iter().filter(|setting| !is_excluded(run, setting.argument, &own));
        let others: Vec<_> =
            others.filter(|setting| !is_moot(setting.argument, &own, &shared)).cloned().collect();
        settings.extend(others);
        Ok(Camera { place, settings })
    });
    cameras.collect()
}

/// What only one of several cameras can have.
const OF_ONE_CAMERA: [&str; 2] = ["source", "camera"];

/// The `[[camera]]` sections, taken out of the file; none where it speaks of one camera.
fn take_sections(table: &mut Table) -> Result<Vec<Table>, String> {
    const HINT: &str =
        "hint: a `[[camera]]` section for each of several cameras, or `camera = \"NAME\"` for one";
    let sections = match table.get("camera") {
        Some(Value::Array(sections)) if sections.is_empty() => {
            return Err(format!("`camera` is an empty list\n{HINT}"));
        }
        Some(Value::Array(sections)) => sections.iter().map(|section| match section {
            Value::Table(section) => Ok(section.clone()),
            other => Err(format!("`camera` has {} in it; expected sections\n{HINT}", shown(other))),
        }),
        Some(Value::Table(_)) => return Err(format!("`camera` is a table\n{HINT}")),
        _ => return Ok(Vec::new()),
    };
    let sections = sections.collect();
    table.remove("camera");
    sections
}

/// A camera's whole command line, tried.
fn check(command: &Command, place: &str, line: Vec<OsString>) -> Result<Vec<OsString>, String> {
    command.clone().try_get_matches_from(&line).map(|_| line).map_err(|error| {
        let text = error.to_string();
        let text = text.trim_start_matches("error: ").split("\n\nUsage").next().unwrap_or_default();
        format!("{place}{}", text.trim_end())
    })
}

/// Flags that mean nothing without another one. Above the sections they are for the cameras that have that other one.
const NEEDS: [(&str, &str); 3] = [("force", "record"), ("record-lossless", "record"), ("format", "size")];

/// Whether `shared`, which is said to all cameras, means nothing to one with these flags of its own.
fn is_moot(argument: &Arg, own: &[&Arg], shared: &[Setting<'_>]) -> bool {
    let needed = NEEDS.iter().find(|(flag, _)| argument.get_long() == Some(flag)).map(|(_, needed)| *needed);
    let mut said = own.iter().copied().chain(shared.iter().map(|setting| setting.argument));
    needed.is_some_and(|needed| !said.any(|argument| argument.get_long() == Some(needed)))
}

/// Whether a flag is among those said already, or cannot stand beside one of them.
fn is_excluded(run: &Command, argument: &Arg, said: &[&Arg]) -> bool {
    let excludes =
        |a: &Arg, b: &Arg| run.get_arg_conflicts_with(a).iter().any(|other| other.get_id() == b.get_id());
    said.iter().any(|other| {
        other.get_id() == argument.get_id() || excludes(other, argument) || excludes(argument, other)
    })
}

fn read(path: &Path) -> Result<Table, String> {
    let mut text = String::new();
    let unreadable = |error| format!("cannot read it: {error}");
    let file = plain_file::open(path, MAX_BYTES + 1).map_err(unreadable)?;
    file.ok_or("it is no plain file")?.read_to_string(&mut text).map_err(unreadable)?;
    if text.len() as u64 > MAX_BYTES {
        return Err(format!("a file of more than {MAX_BYTES} bytes is no configuration"));
    }
    text.parse::<Table>().map_err(|error| match error.to_string() {
        // The line that it shows is the first section's.
        error if error.contains("duplicate key") && error.contains("[[camera]]") => {
            "`camera` stands above the `[[camera]]` sections\nhint: remove `camera =`: each section says its own `name`"
                .to_owned()
        }
        error => format!("it is no TOML: {}", error.trim_end()),
    })
}

fn setting_of<'a>(run: &'a Command, key: &str, value: &Value) -> Result<Setting<'a>, String> {
    let known = || run.get_arguments().filter(|argument| is_setting(argument));
    let argument = named(known(), &key.replace('_', "-"));
    let argument = argument.ok_or_else(|| unknown(key, known().filter_map(Arg::get_long)))?;
    Ok(Setting { argument, flags: flags_of(argument, key, value)? })
}

/// In a section `--camera` is `name`, and what belongs to all cameras stands above.
fn setting_of_camera<'a>(run: &'a Command, key: &str, value: &Value) -> Result<Setting<'a>, String> {
    let own = stream_flags();
    let is_own = |argument: &Arg| argument.get_long().is_some_and(|long| own.iter().any(|own| own == long));
    let known = || run.get_arguments().filter(|argument| is_own(argument));
    let flag = if key == CAMERA_NAME_KEY { "camera".to_owned() } else { key.replace('_', "-") };
    match named(known(), &flag).filter(|_| key != "camera") {
        Some(argument) => Ok(Setting { argument, flags: flags_of(argument, key, value)? }),
        None if named(run.get_arguments().filter(|argument| is_setting(argument)), &flag).is_none() => {
            let names = known().filter_map(Arg::get_long).filter(|&name| name != "camera");
            Err(unknown(key, names.chain([CAMERA_NAME_KEY])))
        }
        None if key == "camera" => {
            Err(format!("unknown key `camera`\nhint: in a section it is `{CAMERA_NAME_KEY}`"))
        }
        None => Err(format!("`{key}` is not for one camera\nhint: put it above the first `[[camera]]`")),
    }
}

/// The key of a camera's name in its section.
pub(super) const CAMERA_NAME_KEY: &str = "name";

/// The long names of the flags that belong to one camera.
pub(super) fn stream_flags() -> Vec<String> {
    let command = StreamArgs::augment_args(Command::new("camera"));
    command.get_arguments().filter_map(Arg::get_long).map(str::to_owned).collect()
}

fn named<'a>(mut known: impl Iterator<Item = &'a Arg>, name: &str) -> Option<&'a Arg> {
    known.find(|argument| argument.get_long() == Some(name))
}

/// A key that no flag has, with the nearest that there is.
fn unknown<'a>(key: &str, known: impl Iterator<Item = &'a str>) -> String {
    let flag = key.replace('_', "-");
    let likeness = |name: &str| strsim::jaro_winkler(name, &flag);
    let nearest = known.max_by(|a, b| likeness(a).total_cmp(&likeness(b)));
    match nearest.filter(|name| likeness(name) >= LEAST_LIKENESS) {
        Some(nearest) => format!("unknown key `{key}`\nhint: did you mean `{nearest}`?"),
        None => {
            format!("unknown key `{key}`\nhint: keys are the long names of the flags of `nunetd run --help`")
        }
    }
}

/// The file cannot name another file, and asking for help is no setting.
pub(super) fn is_setting(argument: &Arg) -> bool {
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
        (true, Value::Array(values)) if values.is_empty() => {
            Err(format!("`{key}` is an empty list; expected one value at least\nhint: leave the key out"))
        }
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
        other => Err(format!(
            "`{key}` is {}; expected a text or a number\nhint: write it in quotes, as its flag takes it",
            shown(other)
        )),
    }
}

fn shown(value: &Value) -> String {
    match value {
        Value::Boolean(_) | Value::Integer(_) | Value::Float(_) | Value::String(_) => format!("`{value}`"),
        Value::Array(_) => "a list".to_owned(),
        other => format!("a {}", other.type_str()),
    }
}

/// What `nunetd run` would do, as a file that `--config` takes; a line of `lines` for each camera.
pub(super) fn effective(command: &Command, lines: &[ArgMatches]) -> String {
    let runs: Vec<_> = lines.iter().filter_map(ArgMatches::subcommand).collect();
    let Some(&(subcommand, first)) = runs.first() else { return String::new() };
    let run = command.find_subcommand(subcommand).cloned().unwrap_or_default();
    let settings = || run.get_arguments().filter(|argument| is_setting(argument));
    if let [_] = runs.as_slice() {
        return settings().map(|argument| said(argument, first, None)).collect();
    }
    let own = stream_flags();
    let is_own = |argument: &&Arg| argument.get_long().is_some_and(|long| own.iter().any(|own| own == long));
    let mut text: String =
        settings().filter(|argument| !is_own(argument)).map(|a| said(a, first, None)).collect();
    for (_, camera) in runs {
        text += "\n[[camera]]\n";
        for argument in settings().filter(is_own) {
            let is_name = argument.get_long() == Some("camera");
            text += &said(argument, camera, is_name.then_some(CAMERA_NAME_KEY));
        }
    }
    text
}

/// A setting as a line of the file.
fn said(argument: &Arg, matches: &ArgMatches, name: Option<&str>) -> String {
    let id = argument.get_id().as_str();
    let name = name.or(argument.get_long()).unwrap_or_default();
    let said = |value: Value| format!("{name} = {value}{}\n", source_of(matches, id));
    if !argument.get_action().takes_values() {
        return said(match argument.get_action() {
            ArgAction::Count => Value::Integer(matches.get_count(id).into()),
            _ => Value::Boolean(matches.get_flag(id)),
        });
    }
    let values = matches.get_raw(id).into_iter().flatten();
    let values: Vec<_> = values.map(|value| Value::String(value.to_string_lossy().into_owned())).collect();
    match (argument.get_action(), values.as_slice()) {
        (_, []) => match resolved(argument.get_long().unwrap_or_default(), matches) {
            Some(value) => format!("{name} = {}  # default\n", Value::String(value)),
            None => format!("# {name} is not set\n"),
        },
        (ArgAction::Append, values) => said(Value::Array(values.to_vec())),
        (_, [value, ..]) => said(value.clone()),
    }
}

/// What `run` takes where a flag is not given whose default depends on others.
fn resolved(flag: &str, matches: &ArgMatches) -> Option<String> {
    let given = |id: &str| {
        let value = matches.get_raw(id).into_iter().flatten().next();
        value.map(|value| value.to_string_lossy().into_owned())
    };
    let source = given("source").map_or_else(SourceName::demo, |source| SourceName::parse(&source));
    let source = source.properties();
    match flag {
        "source" => Some("demo".to_owned()),
        "camera" => Some(source.camera.to_owned()),
        "frame-id" => {
            let camera = given("camera").unwrap_or_else(|| source.camera.to_owned());
            Some(default_frame_id(&camera))
        }
        "rate" => source.default_rate.map(str::to_owned),
        "size" => source.default_size.map(str::to_owned),
        "readers" => Some(Limits::DEFAULT.max_readers.to_string()),
        "access-mode" => given("access_group").map(|_| "0640".to_owned()),
        _ => None,
    }
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
    use super::super::{Cli, SubcommandArgs};
    use super::*;

    fn parse(config: &str, rest: &str) -> Result<SubcommandArgs, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("nunetd.toml");
        std::fs::write(&path, config).unwrap();
        let line = format!("nunetd {rest} --config {}", path.display());
        let cli = Cli::parse_line(line.split_whitespace().map(OsString::from));
        cli.map(|cli| cli.subcommand)
            .map_err(|error| error.to_string().replace(path.to_str().unwrap(), "[FILE]"))
    }

    fn run(config: &str, rest: &str) -> RunArgs {
        match parse(config, rest) {
            Ok(SubcommandArgs::Run(arguments)) => *arguments,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_file_says_what_flags_say() {
        let config = "model = 'a.onnx'\nrate = 15.5\nloop = true\nframe_id = 'eye'\npublish = ['depth', 'cloud']\n\
                      every = ['segmentation=3']\nreaders = 2\nfilter = ['holes', 'spatial=alpha:0.4,delta:0.1']";
        let arguments = run(config, "run");
        assert_eq!(arguments.model, PathBuf::from("a.onnx"));
        assert_eq!(arguments.every.len(), 1);
        assert!(arguments.others.is_empty());
        let camera = arguments.stream;
        assert_eq!(camera.pace.rate, Some(crate::source::Rate::Hz(15.5)));
        assert!(camera.pace.repeat);
        assert_eq!(camera.frame_id.as_deref(), Some("eye"));
        assert_eq!(camera.publish.len(), 2);
        assert_eq!(camera.optics.filters.filters.len(), 2);
        assert_eq!(camera.readers.map(std::num::NonZero::get), Some(2));
    }

    #[test]
    fn flags_win() {
        let arguments =
            run("model = 'a.onnx'\npublish = ['depth', 'cloud']", "--model b.onnx --publish labels");
        assert_eq!(arguments.model, PathBuf::from("b.onnx"));
        assert_eq!(arguments.stream.publish, [crate::options::Publish::Labels]);
        let geometry =
            run("intrinsics = '500,500,320,240'", "run --calibration a.yaml").stream.optics.lens.geometry;
        assert_eq!((geometry.intrinsics, geometry.calibration), (None, Some("a.yaml".into())));
    }

    #[test]
    fn file_and_command_line_may_need_each_other() {
        let split = run("force = true\naccess-mode = '0640'", "run --record a.mcap --access-group video");
        assert!(split.stream.recording.force && split.stream.recording.record.is_some());
        let turned = run("record = 'a.mcap'", "run --force");
        assert!(turned.stream.recording.force && turned.stream.recording.record.is_some());
        let error = parse("rate = 5", "run --force").unwrap_err();
        assert!(error.contains("--record") && !error.contains("[FILE]"), "{error}");
        assert_refused("force = true", "`[FILE]`: the following required arguments were not provided");
    }

    #[test]
    fn what_stands_above_the_sections_is_for_the_cameras_that_can_use_it() {
        let arguments =
            run("force = true\n[[camera]]\nname = 'a'\nrecord = 'a.mcap'\n[[camera]]\nname = 'b'\n", "run");
        assert!(arguments.stream.recording.force);
        assert!(arguments.others.iter().all(|camera| !camera.recording.force));
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
        assert_refused("model = 'a'\nmodel = 'b'", "`[FILE]`: it is no TOML");
        assert_refused(
            "intrinsics = [500, 500, 320, 240]",
            "`intrinsics` is a list; expected a text or a number\nhint: write it in quotes",
        );
        assert_refused(
            "publish = []",
            "`publish` is an empty list; expected one value at least\nhint: leave",
        );
        assert_refused("rate = -3", "expected `max` or frames a second from 0.0001 to 10000");
        assert_refused("intrinsics = '1,2,3,4'\ncalibration = 'a.yaml'", "cannot be used with");
    }

    #[test]
    fn a_file_that_is_endless_or_one_line_is_refused_in_few_words() {
        let large = parse(&"#".repeat(100_000), "run").unwrap_err();
        assert!(large.contains("a file of more than 65536 bytes is no configuration"), "{large}");
        for config in ["#".repeat(100_000), format!("a = {}", "[".repeat(60_000))] {
            let error = parse(&config, "run").unwrap_err();
            assert!(error.contains("`[FILE]`: ") && error.len() < 2000, "{error}");
        }
        let line = ["nunetd", "--config", "/dev/zero"].map(OsString::from);
        let error = Cli::parse_line(line).unwrap_err().to_string();
        assert!(error.contains("`/dev/zero`: it is no plain file"), "{error}");
    }

    #[test]
    fn a_missing_file_is_told() {
        let error = Cli::parse_line(["nunetd", "--config", "missing.toml"].map(OsString::from)).unwrap_err();
        assert!(error.to_string().contains("`missing.toml`: cannot read it:"), "{error}");
    }

    #[test]
    fn the_effective_configuration_is_a_configuration_again() {
        let Ok(SubcommandArgs::Config(first)) = parse("rate = 5\nloop = true", "config --frames 3") else {
            panic!()
        };
        assert!(first.effective.contains("rate = \"5\"\nloop = true\n"), "{}", first.effective);
        assert!(first.effective.contains("model = \"wnet_c.onnx\"  # default"), "{}", first.effective);
        assert!(first.effective.contains("# record is not set"), "{}", first.effective);
        let Ok(SubcommandArgs::Config(second)) = parse(&first.effective, "config") else { panic!() };
        let plain = |text: &str| text.replace("  # default", "");
        assert_eq!(plain(&first.effective), plain(&second.effective));
    }

    #[test]
    fn defaults_that_depend_on_other_flags_are_shown_as_run_takes_them() {
        let shown = |rest: &str| match parse("access-group = 'video'", &format!("config {rest}")) {
            Ok(SubcommandArgs::Config(config)) => config.effective,
            other => panic!("{other:?}"),
        };
        let demo = shown("");
        for line in [
            "source = \"demo\"  # default\n",
            "camera = \"demo\"  # default\n",
            "frame-id = \"demo_optical_frame\"  # default\n",
            "rate = \"max\"  # default\n",
            "readers = \"4\"  # default\n",
            "access-mode = \"0640\"  # default\n",
            "# size is not set\n",
        ] {
            assert!(demo.contains(line), "{line}{demo}");
        }
        let video = shown("--source /dev/video7 --camera front");
        for line in ["frame-id = \"front_optical_frame\"", "rate = \"30\"", "size = \"640x480\""] {
            assert!(video.contains(&format!("{line}  # default\n")), "{line}\n{video}");
        }
        assert!(shown("--source shm:front").contains("camera = \"camera\"  # default\n"));
        assert!(shown("--source shm:front").contains("# rate is not set\n"), "its publisher has the pace");
    }

    const TWO: &str = "model = 'a.onnx'\nframes = 7\nintrinsics = '500,500,320,240'\n\
                       [[camera]]\nname = 'front'\nsource = 'demo'\nframes = 3\n\
                       [[camera]]\nname = 'rear'\nsource = 'shm:rear'\ncalibration = 'rear.yaml'\nloop = true";

    #[test]
    fn each_section_is_a_camera_and_what_stands_above_is_said_to_all() {
        let arguments = run(TWO, "run");
        assert_eq!(arguments.model, PathBuf::from("a.onnx"));
        let cameras: Vec<_> = arguments.streams().collect();
        let names: Vec<_> = cameras.iter().map(|camera| camera.camera.as_deref()).collect();
        assert_eq!(names, [Some("front"), Some("rear")]);
        assert_eq!(cameras[1].source.as_deref(), Some("shm:rear"));
        let frames = |camera: &StreamArgs| camera.pace.frames.map(std::num::NonZero::get);
        assert_eq!((frames(cameras[0]), frames(cameras[1])), (Some(3), Some(7)));
        assert_eq!((cameras[0].pace.repeat, cameras[1].pace.repeat), (false, true));
        let geometry = |camera: &StreamArgs| {
            let geometry = &camera.optics.lens.geometry;
            (geometry.intrinsics.is_some(), geometry.calibration.is_some())
        };
        assert_eq!((geometry(cameras[0]), geometry(cameras[1])), ((true, false), (false, true)));
        let flags = run(TWO, "run --frames 9");
        assert!(flags.streams().all(|camera| frames(camera) == Some(9)), "flags win, for every camera");
    }

    #[test]
    fn one_section_is_one_camera() {
        let arguments = run("[[camera]]\nname = 'front'", "run");
        assert_eq!(arguments.stream.camera.as_deref(), Some("front"));
        assert!(arguments.others.is_empty());
    }

    #[test]
    fn what_a_section_cannot_say_is_told_with_the_camera_and_the_way_out() {
        let section = |lines: &str| format!("[[camera]]\nname = 'front'\n[[camera]]\nname = 'rear'\n{lines}");
        assert_refused(
            &section("framse = 3"),
            "`[FILE]`: camera 2 (`rear`): unknown key `framse`\nhint: did you mean `frames`?",
        );
        assert_refused(&section("nmae = 'x'"), "unknown key `nmae`\nhint: did you mean `name`?");
        assert_refused(&section("model = 'b.onnx'"), "`model` is not for one camera\nhint: put it above");
        assert_refused(&section("camera = 'b'"), "unknown key `camera`\nhint: in a section it is `name`");
        assert_refused(&section("rate = -3"), "camera 2 (`rear`): invalid value '-3' for '--rate");
        assert_refused(&section("loop = 3"), "camera 2 (`rear`): `loop` is `3`; expected true or false");
        assert_refused(
            &format!("source = 'demo'\n{}", section("")),
            "`source` stands above the `[[camera]]`",
        );
        assert_refused(
            "camera = 'front'\n[[camera]]\nname = 'front'\nsource = 'demo'",
            "`[FILE]`: `camera` stands above the `[[camera]]` sections\nhint: remove `camera =`: each section",
        );
        assert_refused("camera = []", "`camera` is an empty list\nhint: a `[[camera]]` section for each");
        assert_refused("camera = ['a', 'b']", "`camera` has `\"a\"` in it; expected sections\nhint: ");
        assert_refused("[camera]\nname = 'a'", "`camera` is a table\nhint: a `[[camera]]` section");
        for (flag, value) in [("source", "demo"), ("camera", "other")] {
            let error = parse(TWO, &format!("run --{flag} {value}")).unwrap_err();
            let expected = format!("`--{flag}` cannot stand beside the `[[camera]]` sections\nhint: ");
            assert!(error.contains(&expected), "{error}");
        }
    }

    #[test]
    fn several_cameras_are_shown_as_sections_that_are_a_configuration_again() {
        let Ok(SubcommandArgs::Config(first)) = parse(TWO, "config --frames 4") else { panic!() };
        let text = &first.effective;
        assert_eq!(text.matches("[[camera]]\nsource = ").count(), 2, "{text}");
        assert_eq!(text.matches("frames = \"4\"\n").count(), 2, "{text}");
        assert!(text.contains("name = \"rear\"\n") && !text.contains("\ncamera ="), "{text}");
        let Ok(SubcommandArgs::Config(second)) = parse(text, "config") else { panic!() };
        let plain = |text: &str| text.replace("  # default", "");
        assert_eq!(plain(text), plain(&second.effective));
    }
}
