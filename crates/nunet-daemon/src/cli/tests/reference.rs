//! The reference page of all flags and the schema of the configuration file, generated from the command line.
//! The tests keep the files in `docs/book` current: if one differs, it is rewritten and the test fails once.

use std::fmt::Write as _;
use std::path::Path;

use clap::{Arg, ArgAction, Command, CommandFactory as _};
use serde_json::{Map, Value, json};

use crate::cli::Cli;
use crate::cli::keys::{CAMERA_NAME_KEY, is_setting, stream_flags};

/// A page of Markdown: a section per subcommand, a table of its flags below each heading.
fn page() -> String {
    let mut command = Cli::command();
    command.build();
    let mut page = String::from(
        "# Flags\n\nThis page is generated from the code. `nunetd` without a subcommand is `nunetd run`. Every flag of \
         `run`\nis a key of the [configuration file](configuration.md) as well; its schema is\n\
         [nunetd.schema.json](nunetd.schema.json).\n\n## All subcommands\n\n",
    );
    let globals: Vec<&Arg> = command.get_arguments().filter(|argument| !argument.is_hide_set()).collect();
    table(&mut page, &globals);
    for subcommand in command.get_subcommands().filter(|subcommand| !subcommand.is_hide_set()) {
        if subcommand.get_name() == "help" {
            continue;
        }
        let about = subcommand.get_about().map(ToString::to_string).unwrap_or_default();
        // Writing into a string does not fail.
        let _ = write!(page, "\n## nunetd {}\n\n{about}.\n", subcommand.get_name());
        let is_global = |argument: &&Arg| globals.iter().any(|global| global.get_id() == argument.get_id());
        let own: Vec<&Arg> = subcommand.get_arguments().filter(|argument| !is_global(argument)).collect();
        tables(&mut page, &own);
    }
    page
}

/// A table for each heading of the help, in its order: arguments without a heading are the first.
fn tables(page: &mut String, arguments: &[&Arg]) {
    let mut headings = vec![None];
    for heading in arguments.iter().map(|argument| argument.get_help_heading()) {
        if !headings.contains(&heading) {
            headings.push(heading);
        }
    }
    for heading in headings {
        let is_below = |argument: &&&Arg| argument.get_help_heading() == heading;
        let below: Vec<&Arg> = arguments.iter().filter(is_below).copied().collect();
        if below.is_empty() {
            continue;
        }
        *page += &heading.map(|heading| format!("\n### {heading}\n")).unwrap_or_default();
        *page += "\n";
        table(page, &below);
    }
}

fn table(page: &mut String, arguments: &[&Arg]) {
    *page += "| argument | meaning |\n|---|---|\n";
    for argument in arguments.iter().filter(|argument| !argument.is_hide_set() && argument.get_id() != "help")
    {
        let _ = writeln!(page, "| `{}` | {} |", cell(&usage(argument)), cell(&meaning(argument)));
    }
}

/// `--rate <max|HZ>`
fn usage(argument: &Arg) -> String {
    let values = argument.get_value_names().unwrap_or_default();
    let values: Vec<_> = values.iter().map(|value| format!("<{value}>")).collect();
    let takes_values = argument.get_action().takes_values();
    let values = if takes_values { values.join(" ") } else { String::new() };
    let short = argument.get_short().map(|short| format!("-{short}, ")).unwrap_or_default();
    match argument.get_long() {
        Some(long) => format!("{short}--{long} {values}").trim_end().to_owned(),
        None => values,
    }
}

fn meaning(argument: &Arg) -> String {
    let help = argument.get_long_help().or(argument.get_help()).map(ToString::to_string).unwrap_or_default();
    let mut text = help.split("\n\n").map(|part| part.replace('\n', " ")).collect::<Vec<_>>().join("<br>");
    let defaults: Vec<_> =
        argument.get_default_values().iter().map(|value| value.to_string_lossy()).collect();
    if argument.get_action().takes_values() && !defaults.is_empty() {
        let _ = write!(text, " [default: {}]", defaults.join(","));
    }
    let values = possible_values(argument);
    if !values.is_empty() {
        let _ = write!(text, " [possible values: {}]", values.join(", "));
    }
    text
}

fn possible_values(argument: &Arg) -> Vec<String> {
    let takes_values = argument.get_action().takes_values();
    let values =
        argument.get_possible_values().into_iter().filter(|value| takes_values && !value.is_hide_set());
    values.map(|value| value.get_name().to_owned()).collect()
}

/// Text within a table.
fn cell(text: &str) -> String {
    text.replace('|', "\\|")
}

/// The JSON Schema of the configuration file.
fn schema() -> Value {
    let mut command = Cli::command();
    command.build();
    let run = command.find_subcommand("run").cloned().unwrap_or_default();
    let own = stream_flags();
    let is_own = |argument: &&Arg| argument.get_long().is_some_and(|long| own.iter().any(|own| own == long));
    let mut camera = properties(run.get_arguments().filter(is_own));
    let name = camera.remove("camera");
    camera.extend(name.map(|name| (CAMERA_NAME_KEY.to_owned(), name)));
    let mut all = properties(run.get_arguments().filter(|argument| is_setting(argument)));
    let sections = json!({
        "type": "array",
        "minItems": 1,
        "description": "Several cameras: a [[camera]] section each, without `source` and `camera` above them",
        "items": { "type": "object", "additionalProperties": false, "properties": camera },
    });
    let single = all.remove("camera").unwrap_or_default();
    all.insert("camera".to_owned(), json!({ "anyOf": [single, sections] }));
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Configuration of nunetd",
        "description": "The keys are the long names of the flags of `nunetd run`; `_` may be written for `-`",
        "type": "object",
        "additionalProperties": false,
        "properties": all,
    })
}

fn properties<'a>(arguments: impl Iterator<Item = &'a Arg>) -> Map<String, Value> {
    let named = arguments.filter_map(|argument| Some((argument.get_long()?.to_owned(), property(argument))));
    named.collect()
}

fn property(argument: &Arg) -> Value {
    let description = argument.get_help().map(ToString::to_string).unwrap_or_default().replace('\n', " ");
    let one = match possible_values(argument).as_slice() {
        [] => json!({ "type": ["string", "number"] }),
        values => json!({ "enum": values }),
    };
    let mut schema = match argument.get_action() {
        ArgAction::Append => json!({ "anyOf": [one, { "type": "array", "minItems": 1, "items": one }] }),
        action if action.takes_values() => one,
        ArgAction::Count => json!({ "type": ["boolean", "integer"] }),
        _ => json!({ "type": "boolean" }),
    };
    schema["description"] = description.into();
    schema
}

/// Rewrites a generated file that is not current, and fails.
#[track_caller]
fn assert_current(file: &str, generated: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/book").join(file);
    let found = std::fs::read_to_string(&path).unwrap_or_default();
    if found != generated {
        std::fs::write(&path, generated).unwrap();
        panic!("docs/book/{file} was out of date and has been rewritten: commit it");
    }
}

#[test]
fn the_reference_page_is_current() {
    assert_current("reference.md", &page());
}

#[test]
fn the_schema_of_the_configuration_file_is_current() {
    assert_current("nunetd.schema.json", &format!("{:#}\n", schema()));
}

#[test]
fn every_flag_of_run_is_on_the_page_and_in_the_schema() {
    let (page, schema) = (page(), schema());
    let run: Command = Cli::command().find_subcommand("run").unwrap().clone();
    for flag in run.get_arguments().filter_map(Arg::get_long) {
        assert!(page.contains(&format!("--{flag}")), "{flag} is not on the page");
        let is_key = schema["properties"].get(flag).is_some();
        assert_eq!(is_key, flag != "config", "{flag} in the schema");
    }
    let camera = &schema["properties"]["camera"]["anyOf"][1]["items"]["properties"];
    assert!(camera.get("name").is_some() && camera.get("camera").is_none() && camera.get("model").is_none());
}
