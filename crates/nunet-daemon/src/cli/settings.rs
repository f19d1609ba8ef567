//! The layers of settings of `run`. From the lowest to the highest: defaults, the environment, the file above
//! its `[[camera]]` sections, the section of a camera, flags.
//!
//! Each of them is a table from the long names of flags to values as the user writes them. The tables of a
//! camera become one, from which serde makes the same struct that clap makes from flags alone.

use std::path::Path;

use anyhow::Context as _;
use clap::error::ErrorKind;
use clap::parser::ValueSource;
use clap::{Arg, ArgAction, ArgMatches, Args, Command, CommandFactory as _};
use nunet_types::{printable, text_with_hint};
use serde::de::DeserializeOwned;
use toml::{Table, Value};
use tracing::warn;

use super::file::ConfigFile;
use super::keys::{CAMERA_NAME_KEY, excludes, is_on, is_setting, stream_flags};
use super::run::TOKEN_VARIABLE;
use super::{Cli, LogArgs, RunArgs, StreamArgs};
use crate::config::{CameraConfig, Config};
use crate::exit::BadArguments;

/// Flags that need another flag, which may be in the file.
const NEEDS: [(&str, &str); 7] = [
    ("force", "record"),
    ("record-lossless", "record"),
    ("format", "size"),
    ("access-mode", "access-group"),
    ("foxglove-public", "foxglove"),
    ("ros2-topics", "ros2"),
    ("ros2-depth", "ros2"),
];

/// `nunetd run` and `nunetd config`
#[derive(Debug, Args, Clone)]
pub struct RunCommand {
    #[command(flatten)]
    pub line: RunArgs,
    #[arg(skip)]
    pub settings: SettingLayers,
}

/// The layers of settings.
#[derive(Debug, Clone, Default)]
pub struct SettingLayers {
    defaults: Table,
    environment: Table,
    /// Flags and file together, a table for each camera.
    cameras: Vec<Table>,
}

/// A mistake in the settings, by where it was made.
enum SettingMistake {
    /// clap adds the usage.
    OnLine(String),
    /// The usage of the command line would not help.
    InFile(BadArguments),
}

/// Completes a parsed command line with the file that it names, and checks what clap cannot check without it.
pub(super) fn complete(
    (run, logging): (Option<&mut RunCommand>, &mut LogArgs),
    command: &mut Command,
    matches: &ArgMatches,
) -> Result<(), clap::Error> {
    let Some((name, matches)) = matches.subcommand() else { return Ok(()) };
    let subcommand = command.find_subcommand(name).cloned().unwrap_or_default();
    let flags = table_of(&subcommand, matches, ValueSource::CommandLine);
    let completed = match run {
        Some(run) => run.complete(flags, logging, &subcommand, matches),
        None => unmet_need(&subcommand, &flags).map_or(Ok(()), |need| Err(unmet_flag(need))),
    };
    completed.map_err(|mistake| match mistake {
        SettingMistake::OnLine(message) => command.error(ErrorKind::ValueValidation, message),
        SettingMistake::InFile(error) => {
            let text = text_with_hint(&error);
            let text = nunet_source::without_passwords(&text);
            clap::Error::raw(ErrorKind::ValueValidation, printable::lines(&text).into_owned() + "\n")
        }
    })
}

fn unmet_flag((flag, needed): (&str, &str)) -> SettingMistake {
    SettingMistake::OnLine(format!("`--{flag}` needs `--{needed}`"))
}

impl SettingLayers {
    /// Flags and file together, for each camera.
    fn with_file(&self, path: &Path, run: &Command, flags: &Table) -> Result<Vec<Table>, BadArguments> {
        let check = |key: &str, value: &Value| {
            let mut one = flags.clone();
            one.insert(key.to_owned(), value.clone());
            self.parse::<RunArgs>(&one).and(self.parse::<LogArgs>(&one)).map(drop)
        };
        let ConfigFile { shared, sections } = ConfigFile::read(path, run, &check)?;
        if sections.is_empty() {
            return Ok(vec![overlay(run, flags, &shared)]);
        }
        if let Some(own) = ["source", "camera"].into_iter().find(|own| flags.contains_key(*own)) {
            let path = path.display();
            let message = format!("`{path}`: `--{own}` cannot stand beside the `[[camera]]` sections");
            return Err(BadArguments::new(message).with_hint("change the section"));
        }
        let own = stream_flags();
        let camera = |section: &Table| {
            let mut table = overlay(run, flags, &overlay(run, section, &shared));
            // A setting for all cameras has no effect on a camera that lacks the flag it needs.
            for (flag, needed) in NEEDS {
                let is_shared = !section.contains_key(flag) && !flags.contains_key(flag);
                if is_shared && own.iter().any(|own| own == flag) && !table.contains_key(needed) {
                    table.remove(flag);
                }
            }
            table
        };
        Ok(sections.iter().map(camera).collect())
    }

    fn first(&self) -> &Table {
        self.cameras.first().unwrap_or(&self.defaults)
    }

    /// All layers of a camera together.
    fn parse<T: DeserializeOwned>(&self, camera: &Table) -> Result<T, BadArguments> {
        let layers = [&self.defaults, &self.environment, camera].into_iter().flatten();
        let table: Table = layers.map(|(key, value)| (key.clone(), value.clone())).collect();
        T::deserialize(Value::Table(table)).map_err(|error| BadArguments::from_text(error.message()))
    }

    fn mark(&self, camera: &Table, key: &str) -> &'static str {
        match key {
            _ if camera.contains_key(key) => "",
            _ if self.environment.contains_key(key) => "  # from the environment",
            _ => "  # default",
        }
    }
}

impl RunCommand {
    /// Keeps the layers, and adds the file to the flags.
    fn complete(
        &mut self,
        flags: Table,
        logging: &mut LogArgs,
        run: &Command,
        matches: &ArgMatches,
    ) -> Result<(), SettingMistake> {
        self.settings = SettingLayers {
            defaults: table_of(run, matches, ValueSource::DefaultValue),
            environment: table_of(run, matches, ValueSource::EnvVariable),
            cameras: vec![flags.clone()],
        };
        let Some(path) = &self.line.config else {
            return unmet_need(run, &flags).map_or(Ok(()), |need| Err(unmet_flag(need)));
        };
        refuse_what_is_not_unicode(run, matches).map_err(SettingMistake::OnLine)?;
        let cameras = self.settings.with_file(path, run, &flags).map_err(SettingMistake::InFile)?;
        let unmet = cameras.iter().find_map(|camera| unmet_need(run, camera));
        match unmet {
            Some(need) if flags.contains_key(need.0) => return Err(unmet_flag(need)),
            Some((key, needed)) => {
                let message = format!("`{}`: `{key}` needs `{needed}`", path.display());
                return Err(SettingMistake::InFile(BadArguments::new(message)));
            }
            None => self.settings.cameras = cameras,
        }
        *logging = self.settings.parse(self.settings.first()).map_err(SettingMistake::InFile)?;
        Ok(())
    }

    /// As checked values: flags and file together.
    pub(crate) fn config(&self) -> anyhow::Result<Config> {
        let runs = match &self.line.config {
            None => vec![self.line.clone()],
            Some(_) => {
                let runs = self.settings.cameras.iter().map(|camera| self.settings.parse(camera));
                runs.collect::<Result<Vec<RunArgs>, _>>()?
            }
        };
        let cameras: Vec<StreamArgs> = runs.iter().map(|run| run.stream.clone()).collect();
        if let Some(path) = &self.line.config {
            refuse_no_source(path, &cameras)?;
        }
        let config = runs.first().context("one camera at least")?.config(&cameras)?;
        Ok(Config { file: self.line.config.clone(), ..config })
    }

    /// Warns of what may be a mistake in a valid configuration.
    pub(crate) fn warn(&self) {
        // In case the flag was forgotten. With a file, a source is required.
        if self.line.config.is_none() && self.line.stream.source.is_none() {
            warn!("no --source: frames come from the built-in demo scene");
        }
    }

    /// What `nunetd run` would do, as a file that `--config` takes.
    pub(crate) fn effective(&self, config: &Config) -> String {
        let mut command = Cli::command();
        command.build();
        let run = command.find_subcommand("run").cloned().unwrap_or_default();
        let keys: Vec<&str> =
            run.get_arguments().filter(|argument| is_setting(argument)).filter_map(Arg::get_long).collect();
        let cameras = || config.cameras.iter().zip(&self.settings.cameras);
        let lines = |keys: &[&str], camera: &CameraConfig, table: &Table| -> String {
            keys.iter().map(|key| self.line_of(key, table, camera, config)).collect()
        };
        if config.cameras.len() == 1 {
            return cameras().map(|(camera, table)| lines(&keys, camera, table)).collect();
        }
        let flags = stream_flags();
        let (own, shared): (Vec<_>, Vec<_>) =
            keys.into_iter().partition(|key| flags.iter().any(|flag| flag == key));
        let shared = cameras().take(1).map(|(camera, table)| lines(&shared, camera, table));
        let own = cameras().map(|(camera, table)| {
            let lines = lines(&own, camera, table).replace("\ncamera = ", &format!("\n{CAMERA_NAME_KEY} = "));
            format!("\n[[camera]]\n{lines}")
        });
        shared.chain(own).collect()
    }

    /// A setting as a line of the file.
    fn line_of(&self, key: &str, table: &Table, camera: &CameraConfig, config: &Config) -> String {
        let SettingLayers { defaults, environment, .. } = &self.settings;
        let value = [table, environment, defaults].into_iter().find_map(|layer| layer.get(key)).cloned();
        let shown = camera.source.name.shown();
        if key == "source" && shown != camera.source.name.as_str() {
            return format!("{key} = {}  # without its password\n", Value::String(shown.into_owned()));
        }
        let has_token = config.outputs.view.as_ref().is_some_and(|view| view.token.is_some());
        match value.or_else(|| dependent_default(key, camera, config).map(Value::String)).map(as_number) {
            Some(value) => format!("{key} = {value}{}\n", self.settings.mark(table, key)),
            None if key == "view-token" && has_token => format!("# {key} is set by {TOKEN_VARIABLE}\n"),
            None => format!("# {key} is not set\n"),
        }
    }
}

/// The value of a setting that is not given and whose default depends on others.
fn dependent_default(key: &str, camera: &CameraConfig, config: &Config) -> Option<String> {
    let source = camera.source.name.properties();
    match key {
        "source" => Some("demo".to_owned()),
        "camera" => Some(camera.name.to_string()),
        "frame-id" => (camera.is_frame_id_chosen || !source.states_frame_id).then(|| camera.frame_id.clone()),
        "rate" => source.default_rate.map(str::to_owned),
        "size" => source.default_size.map(str::to_owned),
        "readers" => Some(camera.readers.to_string()),
        "access-mode" => config.outputs.access.as_ref().map(|_| "0640".to_owned()),
        _ => None,
    }
}

/// A number instead of its text, as the file's schema has it: `5`, not `"5"`. Only where the text is the
/// number's usual one, so that it is read back as the same text; `0640` and `01` remain as they are.
fn as_number(value: Value) -> Value {
    let Value::String(text) = &value else { return value };
    let number = text.parse().map(Value::Integer).or_else(|_| text.parse().map(Value::Float));
    let ends_with_digit = text.ends_with(|c: char| c.is_ascii_digit()); // not `nan`
    number.ok().filter(|number| ends_with_digit && number.to_string() == *text).unwrap_or(value)
}

/// Requires a source with a file, because a missing line must not publish the depth of the demo scene
/// under a robot's camera name. On the command line `--source` is optional.
fn refuse_no_source(path: &Path, cameras: &[StreamArgs]) -> Result<(), BadArguments> {
    let Some(camera) = cameras.iter().find(|camera| camera.source.is_none()) else { return Ok(()) };
    let camera = camera.camera.as_ref().map(|name| format!(" for camera `{name}`")).unwrap_or_default();
    let message = format!("neither `{}` nor the command line names a source{camera}", path.display());
    let hint = "write `source = \"/dev/video0\"`, or `source = \"demo\"` if the demo scene is meant";
    Err(BadArguments::new(message).with_hint(hint))
}

/// A flag without the one that it needs, if `command` has both: `replay --force` needs nothing.
fn unmet_need(command: &Command, table: &Table) -> Option<(&'static str, &'static str)> {
    let has = |flag: &str| command.get_arguments().any(|argument| argument.get_long() == Some(flag));
    let is_unmet = |(flag, needed): &(&str, &str)| {
        table.get(*flag).is_some_and(is_on) && has(needed) && !table.contains_key(*needed)
    };
    NEEDS.into_iter().find(is_unmet)
}

/// `upper`, completed by `lower`.
fn overlay(run: &Command, upper: &Table, lower: &Table) -> Table {
    let is_beside = |key: &str| {
        let excludes = |(upper_key, value): (&String, &Value)| {
            upper_key == key || is_on(value) && excludes(run, upper_key, key)
        };
        !upper.iter().any(excludes)
    };
    let beside = lower.iter().filter(|(key, _)| is_beside(key));
    upper.iter().chain(beside).map(|(key, value)| (key.clone(), value.clone())).collect()
}

/// The values that come from `source`, by the long names of their flags.
fn table_of(command: &Command, matches: &ArgMatches, source: ValueSource) -> Table {
    let is_from = |argument: &&Arg| matches.value_source(argument.get_id().as_str()) == Some(source);
    let settings = command.get_arguments().filter(|argument| is_setting(argument)).filter(is_from);
    settings
        .filter_map(|argument| Some((argument.get_long()?.to_owned(), value_of(argument, matches))))
        .collect()
}

fn value_of(argument: &Arg, matches: &ArgMatches) -> Value {
    let id = argument.get_id().as_str();
    let texts = || {
        let values = matches.get_raw(id).into_iter().flatten();
        values.map(|value| Value::String(value.to_string_lossy().into_owned()))
    };
    match argument.get_action() {
        ArgAction::Count => Value::Integer(matches.get_count(id).into()),
        ArgAction::Append => Value::Array(texts().collect()),
        action if action.takes_values() => texts().next().unwrap_or_else(|| Value::String(String::new())),
        _ => Value::Boolean(matches.get_flag(id)),
    }
}

/// TOML is Unicode, so the flags that are merged with it must be Unicode too.
fn refuse_what_is_not_unicode(run: &Command, matches: &ArgMatches) -> Result<(), String> {
    let given = run.get_arguments().filter(|argument| argument.get_action().takes_values());
    let is_unicode = |argument: &&Arg| {
        let values = matches.get_raw(argument.get_id().as_str()).into_iter().flatten();
        values.into_iter().all(|value| value.to_str().is_some())
    };
    let wrong = given.filter(|argument| !is_unicode(argument)).filter_map(Arg::get_long);
    let refused = |name| Err(format!("`--{name}` is not Unicode, which it must be beside `--config`"));
    wrong.filter(|name| *name != "config").try_for_each(refused)
}
