//! The file of `--config`. Its keys are the long names of flags; `[[camera]]` sections are cameras.

use std::path::Path;

use clap::{Arg, ArgAction, Command};
use nunet_core::plain_file;
use nunet_core::text::shortened;
use toml::de::{DeTable, DeValue};
use toml::{Spanned, Table, Value};

use super::keys::{CAMERA_NAME_KEY, excludes, is_on, is_setting, stream_flags};
use crate::exit::BadArguments;

/// The lowest similarity at which a key is suggested.
const LEAST_LIKENESS: f64 = 0.6;
/// The largest file: a hundred times the length of one with all flags.
const MAX_BYTES: u64 = 64 * 1024;
/// Keys that must be in the sections if there are any.
const OF_ONE_CAMERA: [&str; 2] = ["source", "camera"];
const SECTIONS_HINT: &str =
    "write a `[[camera]]` section for each of several cameras, or `camera = \"NAME\"` for one";

/// The settings of a file, by the long names of flags.
pub(super) struct ConfigFile {
    /// Settings above the sections.
    pub(super) shared: Table,
    /// Settings of each camera; empty if the file has no sections.
    pub(super) sections: Vec<Table>,
}

/// Checks a value of a key.
type ValueCheck<'a> = dyn Fn(&str, &Value) -> Result<(), BadArguments> + 'a;

impl ConfigFile {
    /// Reads a file whose keys are the flags of `run`.
    ///
    /// # Errors
    /// The message, with the file's name and the line if it is known.
    pub(super) fn read(path: &Path, run: &Command, check: &ValueCheck<'_>) -> Result<Self, BadArguments> {
        let in_file = |message: &str| format!("`{}`{}", path.display(), shortened(message));
        let text = plain_file::read_text(path, MAX_BYTES)
            .map_err(|error| BadArguments::new(in_file(&format!(": cannot read it: {error}"))))?;
        let reader = ConfigParser { text: &text, run, check, own: stream_flags() };
        reader.file().map_err(|Mistake { line, error }| {
            let place = line.map(|line| format!(", line {line}")).unwrap_or_default();
            error.map_message(|message| in_file(&format!("{place}: {message}")))
        })
    }
}

/// A mistake and its line.
struct Mistake {
    line: Option<usize>,
    error: BadArguments,
}

impl From<BadArguments> for Mistake {
    fn from(error: BadArguments) -> Self {
        Self { line: None, error }
    }
}

struct ConfigParser<'a> {
    text: &'a str,
    run: &'a Command,
    check: &'a ValueCheck<'a>,
    /// The flags of one camera.
    own: Vec<String>,
}

impl ConfigParser<'_> {
    fn file(&self) -> Result<ConfigFile, Mistake> {
        let document = DeTable::parse(self.text).map_err(|error| syntax_error(&error))?;
        let document = document.into_inner();
        let sections = sections_of(&document)?;
        let top = document.iter().filter(|(key, _)| sections.is_none() || key.get_ref() != "camera");
        let shared = self.table(top, |key| self.shared_flag(key))?;
        let Some(sections) = sections else { return Ok(ConfigFile { shared, sections: Vec::new() }) };
        if let Some(own) = OF_ONE_CAMERA.into_iter().find(|own| shared.contains_key(*own)) {
            let error = BadArguments::new(format!("`{own}` stands above the `[[camera]]` sections"));
            return Err(error.with_hint("set it in each section").into());
        }
        let sections = sections.into_iter().enumerate();
        let sections =
            sections.map(|(index, section)| self.section(index, section)).collect::<Result<_, _>>()?;
        Ok(ConfigFile { shared, sections })
    }

    fn section(&self, index: usize, section: &DeTable<'_>) -> Result<Table, Mistake> {
        let name = section.get(CAMERA_NAME_KEY).and_then(|name| name.get_ref().as_str());
        let table = self.table(section.iter(), |key| self.camera_flag(key));
        let (number, name) = (index + 1, name.unwrap_or("without a name"));
        table.map_err(|Mistake { line, error }| Mistake {
            line,
            error: error.map_message(|message| format!("camera {number} (`{name}`): {message}")),
        })
    }

    /// A table whose keys are flags, checked.
    fn table<'s, 't>(
        &'s self,
        entries: impl Iterator<Item = (&'t Spanned<std::borrow::Cow<'t, str>>, &'t Spanned<DeValue<'t>>)>,
        flag: impl Fn(&str) -> Result<&'s Arg, BadArguments>,
    ) -> Result<Table, Mistake> {
        let mut table = Table::new();
        for (key, value) in entries {
            let line = Some(self.line_of(key.span().start));
            let at = |error: BadArguments| Mistake { line, error: error.on_one_line() };
            let argument = flag(key.get_ref()).map_err(at)?;
            let value = self.value(argument, key.get_ref(), value.get_ref()).map_err(at)?;
            let flag = argument.get_long().unwrap_or_default();
            let mut others = table.iter().filter(|(_, other)| is_on(other) && is_on(&value));
            if let Some((other, _)) = others.find(|(other, _)| excludes(self.run, other, flag)) {
                return Err(at(BadArguments::new(format!("`{flag}` cannot be used with `{other}`"))));
            }
            table.insert(flag.to_owned(), value);
        }
        Ok(table)
    }

    fn line_of(&self, offset: usize) -> usize {
        self.text.bytes().take(offset).filter(|byte| *byte == b'\n').count() + 1
    }

    /// The flag of a key above the sections.
    fn shared_flag<'s>(&'s self, key: &str) -> Result<&'s Arg, BadArguments> {
        let flag = self.named(&key.replace('_', "-"));
        flag.ok_or_else(|| unknown(key, self.flags().filter_map(Arg::get_long)))
    }

    /// The flag of a key in a section, where `--camera` is `name`. Settings of all cameras are above the
    /// sections.
    fn camera_flag<'s>(&'s self, key: &str) -> Result<&'s Arg, BadArguments> {
        if key == "camera" {
            let hint = format!("in a section it is `{CAMERA_NAME_KEY}`");
            return Err(BadArguments::new("unknown key `camera`").with_hint(hint));
        }
        let flag = if key == CAMERA_NAME_KEY { "camera".to_owned() } else { key.replace('_', "-") };
        match self.named(&flag) {
            Some(argument) if self.own.contains(&flag) => Ok(argument),
            Some(_) => Err(BadArguments::new(format!("`{key}` is not for one camera"))
                .with_hint("put it above the first `[[camera]]`")),
            None => {
                let names = self.own.iter().map(String::as_str).filter(|&name| name != "camera");
                Err(unknown(key, names.chain([CAMERA_NAME_KEY])))
            }
        }
    }

    fn flags(&self) -> impl Iterator<Item = &Arg> {
        self.run.get_arguments().filter(|argument| is_setting(argument))
    }

    fn named<'s>(&'s self, flag: &str) -> Option<&'s Arg> {
        self.flags().find(|argument| argument.get_long() == Some(flag))
    }

    fn value(&self, argument: &Arg, key: &str, value: &DeValue<'_>) -> Result<Value, BadArguments> {
        let setting = setting_of(argument, key, value)?;
        let checked = (self.check)(argument.get_long().unwrap_or_default(), &setting);
        checked.map_err(|error| {
            error.map_message(|message| format!("invalid value {} for `{key}`: {message}", shown(value)))
        })?;
        Ok(setting)
    }
}

fn syntax_error(error: &toml::de::Error) -> Mistake {
    let text = error.to_string();
    // Its line is that of the first section.
    if text.contains("duplicate key") && text.contains("[[camera]]") {
        return BadArguments::new("`camera` stands above the `[[camera]]` sections")
            .with_hint("remove `camera =`: each section has its own `name`")
            .into();
    }
    // The library quotes the line too, which may contain a token or a password.
    let place = text.lines().next().and_then(|first| first.strip_prefix("TOML parse error"));
    BadArguments::new(format!("it is not valid TOML{}: {}", place.unwrap_or_default(), error.message()))
        .into()
}

/// The `[[camera]]` sections; `None` for a file of one camera.
fn sections_of<'a>(document: &'a DeTable<'a>) -> Result<Option<Vec<&'a DeTable<'a>>>, BadArguments> {
    let refused = |message: String| BadArguments::new(message).with_hint(SECTIONS_HINT);
    let sections = match document.get("camera").map(Spanned::get_ref) {
        Some(DeValue::Array(sections)) if sections.is_empty() => {
            return Err(refused("`camera` is an empty list".to_owned()));
        }
        Some(DeValue::Table(_)) => return Err(refused("`camera` is a table".to_owned())),
        Some(DeValue::Array(sections)) => sections,
        _ => return Ok(None),
    };
    let section = |section: &'a Spanned<DeValue<'a>>| match section.get_ref() {
        DeValue::Table(section) => Ok(section),
        other => Err(refused(format!("`camera` has {} in it; expected sections", shown(other)))),
    };
    sections.iter().map(section).collect::<Result<_, _>>().map(Some)
}

/// The error for an unknown key, with the most similar known one.
fn unknown<'a>(key: &str, known: impl Iterator<Item = &'a str>) -> BadArguments {
    let flag = key.replace('_', "-");
    let likeness = |name: &str| strsim::jaro_winkler(name, &flag);
    let nearest = known.max_by(|a, b| likeness(a).total_cmp(&likeness(b)));
    let error = BadArguments::new(format!("unknown key `{key}`"));
    match nearest.filter(|name| likeness(name) >= LEAST_LIKENESS) {
        Some(nearest) => error.with_hint(format!("did you mean `{nearest}`?")),
        None => error.with_hint("keys are the long names of the flags of `nunetd run --help`"),
    }
}

/// A value in the form that it has for a flag: true or false, a count, a text, or a list of texts.
fn setting_of(argument: &Arg, key: &str, value: &DeValue<'_>) -> Result<Value, BadArguments> {
    match (argument.get_action(), value) {
        (ArgAction::Count, DeValue::Boolean(given)) => Ok(Value::Integer((*given).into())),
        (ArgAction::Count, DeValue::Integer(count)) => {
            let count = u8::from_str_radix(count.as_str(), count.radix());
            let refused = || format!("`{key}` is {}; expected true, false or 0 to 255", shown(value));
            count.map(|count| Value::Integer(count.into())).map_err(|_| BadArguments::new(refused()))
        }
        (action, DeValue::Boolean(given)) if !action.takes_values() => Ok(Value::Boolean(*given)),
        (action, other) if !action.takes_values() => {
            Err(BadArguments::new(format!("`{key}` is {}; expected true or false", shown(other))))
        }
        (_, DeValue::Array(values)) if values.is_empty() => {
            Err(BadArguments::new(format!("`{key}` is an empty list; expected one value at least"))
                .with_hint("leave the key out"))
        }
        (ArgAction::Append, DeValue::Array(values)) => {
            let texts = values.iter().map(|value| text_of(key, value.get_ref()).map(Value::String));
            texts.collect::<Result<_, _>>().map(Value::Array)
        }
        (ArgAction::Append, value) => {
            let text = text_of(key, value)?;
            let parts = text.split(|character| argument.get_value_delimiter() == Some(character));
            Ok(parts.map(|part| Value::String(part.to_owned())).collect::<Vec<_>>().into())
        }
        (_, value) => text_of(key, value).map(Value::String),
    }
}

fn text_of(key: &str, value: &DeValue<'_>) -> Result<String, BadArguments> {
    match value {
        DeValue::String(text) => Ok(text.clone().into_owned()),
        DeValue::Integer(number) => Ok(i64::from_str_radix(number.as_str(), number.radix())
            .map_or_else(|_| number.to_string(), |n| n.to_string())),
        DeValue::Float(number) => Ok(number.to_string()),
        other => Err(BadArguments::new(format!("`{key}` is {}; expected a text or a number", shown(other)))
            .with_hint("write it in quotes, as its flag takes it")),
    }
}

fn shown(value: &DeValue<'_>) -> String {
    match value {
        DeValue::String(text) => format!("`{}`", Value::String(text.clone().into_owned())),
        DeValue::Integer(number) => format!("`{number}`"),
        DeValue::Float(number) => format!("`{number}`"),
        DeValue::Boolean(given) => format!("`{given}`"),
        DeValue::Array(_) => "a list".to_owned(),
        other => format!("a {}", other.type_str()),
    }
}
