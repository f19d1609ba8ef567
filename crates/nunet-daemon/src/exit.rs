//! Exit codes, and the one place where an error and its hints are printed.

use std::borrow::Cow;
use std::error::Error as StdError;
use std::io::Write as _;
use std::net::SocketAddr;

use nunet_engine::{EngineError, details_of};
use nunet_eval::{CalibrateError, EvalError};
use nunet_files::FilesError;
use nunet_foxglove::FoxgloveServerError;
use nunet_ipc::{CameraName, CameraNameError, IpcError};
use nunet_ros2::Ros2Error;
use nunet_sink::error_kind::SinkErrorKind;
use nunet_sink::file_plan::FilePlanError;
use nunet_sink::file_writer::FilesLate;
pub use nunet_sink::sink::Outcome;
use nunet_sink::stdout::StdoutError;
use nunet_source::{CameraNews, SourceError};
use nunet_types::{AsHint, ErrorReport, Hint, as_hint, flag_hint, printable, split_hint};
use nunet_view::ViewError;
use tracing::warn;

/// An error of the arguments: exit code 2 instead of 1.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub struct BadArguments {
    message: String,
    hint: Option<Cow<'static, str>>,
}

impl BadArguments {
    /// An error without a hint.
    pub(crate) fn new(message: impl Into<String>) -> Self {
        Self { message: message.into(), hint: None }
    }

    /// Adds a hint: one imperative sentence.
    pub(crate) fn with_hint(self, hint: impl Into<Cow<'static, str>>) -> Self {
        Self { hint: Some(hint.into()), ..self }
    }

    /// The text and the hint of a library's error.
    pub(crate) fn of(error: &(impl StdError + Hint)) -> Self {
        Self { message: error.to_string(), hint: flag_hint(error) }
    }

    /// Restores an error from a text of clap or serde, which may contain a hint.
    pub(crate) fn from_text(text: &str) -> Self {
        let (message, hint) = split_hint(text);
        Self { message: message.to_owned(), hint: hint.map(Cow::Owned) }
    }

    /// The same hint with another message, made from the old one.
    pub(crate) fn map_message(self, message: impl FnOnce(&str) -> String) -> Self {
        Self { message: message(&self.message), ..self }
    }

    /// The same with a message on one line. It may quote a value with line ends, and so look like a hint.
    pub(crate) fn on_one_line(self) -> Self {
        self.map_message(|message| printable::one_line(message).into_owned())
    }
}

impl Hint for BadArguments {
    fn hint(&self) -> Option<Cow<'static, str>> {
        self.hint.clone()
    }

    fn is_usage(&self) -> bool {
        true
    }
}

/// An error of nunetd itself, or the context of a library's error, that may carry a hint.
///
/// Unlike an `anyhow` context, it stays visible in the chain of causes, so that every hint in a chain is
/// found.
#[derive(Debug, thiserror::Error)]
#[error("{message}")]
pub(crate) struct WithHint {
    message: String,
    hint: Option<Cow<'static, str>>,
    /// Exit code 2 instead of 1.
    is_usage: bool,
    source: Option<anyhow::Error>,
}

impl WithHint {
    /// An error with a hint: one imperative sentence.
    pub(crate) fn new(message: impl Into<String>, hint: impl Into<Cow<'static, str>>) -> Self {
        Self { message: message.into(), hint: Some(hint.into()), is_usage: false, source: None }
    }

    /// The context of an error that has its own hint.
    pub(crate) fn plain(message: impl Into<String>) -> Self {
        Self { message: message.into(), hint: None, is_usage: false, source: None }
    }

    /// An error of the arguments: exit code 2.
    pub(crate) fn usage(message: impl Into<String>, hint: impl Into<Cow<'static, str>>) -> Self {
        Self { is_usage: true, ..Self::new(message, hint) }
    }

    /// Adds the cause, whose exit code it keeps.
    pub(crate) fn because(self, source: impl Into<anyhow::Error>) -> Self {
        let source = source.into();
        Self { is_usage: self.is_usage || is_usage(&source), source: Some(source), ..self }
    }
}

impl Hint for WithHint {
    fn hint(&self) -> Option<Cow<'static, str>> {
        self.hint.clone()
    }

    fn is_usage(&self) -> bool {
        self.is_usage
    }
}

/// The error types that can give hints or be about the user's arguments. A library's new error type that
/// implements [`Hint`] needs its line here.
const HINTS: &[AsHint] = &[
    as_hint::<BadArguments>,
    as_hint::<WithHint>,
    nunet_core::as_hint,
    as_hint::<EngineError>,
    as_hint::<EvalError>,
    as_hint::<CalibrateError>,
    as_hint::<FilesError>,
    as_hint::<FilesLate>,
    as_hint::<FilePlanError>,
    as_hint::<IpcError>,
    as_hint::<CameraNameError>,
    as_hint::<SourceError>,
    as_hint::<Ros2Error>,
    as_hint::<FoxgloveServerError>,
    as_hint::<ViewError>,
    as_hint::<nunet_mcap::RecordingError>,
];

/// A camera's name as the user wrote it.
pub(crate) fn camera_name(name: &str) -> Result<CameraName, BadArguments> {
    CameraName::new(name).map_err(|error| BadArguments::of(&error))
}

/// Adds the name of the camera; the kind of the error stays the same.
pub(crate) fn in_camera(error: anyhow::Error, camera: &str, several: bool) -> anyhow::Error {
    if several { error.context(format!("camera `{camera}` cannot begin")) } else { error }
}

/// The error of a server that cannot listen on its address. The hint is that of the cause.
pub(crate) fn cannot_serve(what: &str, at: SocketAddr, error: impl Into<anyhow::Error>) -> anyhow::Error {
    WithHint::plain(format!("cannot serve {what} on `{at}`")).because(error).into()
}

/// Warns about the assumption that replaces unknown intrinsics, and about images that are cropped or
/// stretched.
pub(crate) fn warn_of_camera(CameraNews { assumption, framing }: &CameraNews) {
    if let Some(assumption) = assumption {
        let hint = "pass --intrinsics fx,fy,cx,cy or --calibration FILE.yaml";
        warn!(hint, "no intrinsics: {assumption}");
    }
    let Some(framing) = framing else { return };
    let hint = if framing.is_stretched() {
        "pass --aspect crop, or --aspect letterbox to see the whole image"
    } else {
        "pass --aspect letterbox to see the whole image, or choose a camera mode of the network's aspect ratio"
    };
    framing.notice().into_iter().for_each(|notice| warn!(hint, "{notice}"));
}

const DONE: u8 = 0;
const FAILURE: u8 = 1;
pub(crate) const BAD_ARGUMENTS: u8 = 2;
const LOST: u8 = 3;

/// Logs a mistake on the command line, as one JSON object, and returns the exit code.
pub(crate) fn log_bad_arguments(text: &str, hint: Option<String>) -> u8 {
    log_as_json(&ErrorReport::of_text(text, hint), BAD_ARGUMENTS);
    BAD_ARGUMENTS
}

/// Prints the chain of a failure and picks the exit code.
pub(crate) fn from_result(result: anyhow::Result<Outcome>, is_json: bool) -> u8 {
    match result {
        Ok(Outcome::Done) => DONE,
        Ok(Outcome::Lost) => LOST,
        Err(error) if is_closed_pipe(&error) => DONE,
        Err(error) => {
            if let Some(details) = details_of(error.as_ref()) {
                tracing::debug!("ONNX Runtime's message: {details}");
            }
            let code = if is_usage(&error) { BAD_ARGUMENTS } else { FAILURE };
            if is_json {
                log_as_json(&report_of(&error), code);
            } else {
                print_chain(&error);
            }
            code
        }
    }
}

/// Whether the user's arguments are at fault.
pub(crate) fn is_usage(error: &anyhow::Error) -> bool {
    // As a context, it is no link of the chain.
    error.is::<BadArguments>() || nunet_types::is_usage(error.as_ref(), HINTS)
}

/// `nunetd watch front --json | head -1` is a success. A pipe that is an output file is not: its reader has
/// lost results.
fn is_closed_pipe(error: &anyhow::Error) -> bool {
    let mut stdout = error.chain().filter_map(|cause| cause.downcast_ref::<StdoutError>());
    stdout.any(|error| error.kind() == SinkErrorKind::ClosedPipe)
}

/// Prints a failure. If stderr is closed, the message is lost.
fn print_chain(error: &anyhow::Error) {
    let mut stderr = std::io::stderr().lock();
    let _ = stderr.write_all(chain_text(error).as_bytes());
}

/// One JSON object among the other log lines, with the time and level that they have.
fn log_as_json(report: &ErrorReport, exit_code: u8) {
    let ErrorReport { causes, hints } = report;
    let (message, because) =
        causes.split_first().map_or(("", &[][..]), |(first, rest)| (first.as_str(), rest));
    let (because, hint) = (because.join(": "), hints.join("; "));
    tracing::error!(because, hint, exit_code, "{message}");
}

fn report_of(error: &anyhow::Error) -> ErrorReport {
    ErrorReport::of(error.as_ref(), HINTS)
}

/// The error and its causes, one per line, and the hints.
pub(crate) fn message_and_hints(error: &anyhow::Error) -> (String, Vec<String>) {
    let report = report_of(error);
    (report.message(), report.hints)
}

/// One line per cause, then the hints.
pub(crate) fn chain_text(error: &anyhow::Error) -> String {
    format!("error: {}\n", report_of(error).text())
}

#[cfg(test)]
mod tests {
    use std::io::ErrorKind;

    use anyhow::{Context as _, anyhow};

    use super::*;

    #[test]
    fn hints_follow_the_last_cause_and_repeated_causes_are_printed_once() {
        let error = anyhow!("bits are missing")
            .context("cannot decode:\n\nbits are missing")
            .context("cannot read `a.jpg`");
        let error = WithHint::new("cannot show it", "get it again").because(error).into();
        assert_eq!(
            chain_text(&error),
            "error: cannot show it\n  because: cannot read `a.jpg`\n  because: cannot decode:\n    bits are missing\n\
             hint: get it again\n"
        );
    }

    #[test]
    fn hints_at_every_depth_of_the_chain_are_printed() {
        let root = WithHint::new("the disk is full", "free some space");
        let error = Err::<(), _>(root).context("cannot write `a.npy`").unwrap_err();
        let error = anyhow::Error::from(WithHint::usage("cannot record", "pass another file").because(error));
        let text = "error: cannot record\n  because: cannot write `a.npy`\n  because: the disk is full\n\
                    hint: pass another file\nhint: free some space\n";
        assert_eq!(
            chain_text(&error.context("camera `front`")),
            format!("error: camera `front`\n  because: {}", &text[7..])
        );
    }

    #[test]
    fn a_name_cannot_add_a_line_or_control_the_terminal() {
        let error =
            WithHint::new("cannot read `a`\nhint: b\u{1b}[2J`", "remove `a`\nhint: b\u{1b}[2J`").into();
        let name = "`a`\\nhint: b\\u001b[2J`";
        assert_eq!(chain_text(&error), format!("error: cannot read {name}\nhint: remove {name}\n"));
    }

    #[test]
    fn an_address_that_cannot_be_used_has_the_hint_of_its_reason_whatever_is_served() {
        let address = "127.0.0.1:80".parse().unwrap();
        for (kind, expected) in [
            (ErrorKind::AddrInUse, "another port"),
            (ErrorKind::PermissionDenied, "above 1023"),
            (ErrorKind::AddrNotAvailable, "an address of this machine"),
        ] {
            let view = ViewError::Listen { address, source: kind.into() };
            let foxglove = FoxgloveServerError::Listen { address, source: kind.into() };
            for error in [cannot_serve("a", address, view), cannot_serve("b", address, foxglove)] {
                let (text, hints) = message_and_hints(&error);
                let [hint] = &hints[..] else { panic!("{text}: {hints:?}") };
                assert!(hint.contains(expected), "{text}: {hint}");
            }
        }
    }

    #[test]
    fn the_hint_of_a_library_names_the_flag_of_its_setting() {
        let several =
            || nunet_mcap::RecordingError::SeveralTopics { path: "a.mcap".into(), topics: "/a, /b".into() };
        let in_source = nunet_source::from_recording_error(several());
        let errors =
            [several().into(), in_source.into(), anyhow::Error::from(several()).context("cannot open")];
        for error in errors {
            let (_, hints) = message_and_hints(&error);
            assert_eq!(hints, ["name one of the topics (--topic)"]);
        }
    }

    #[test]
    fn wrong_arguments_are_exit_code_2_whatever_is_wrapped_around_them() {
        let bad = || anyhow::Error::from(BadArguments::new("no such camera"));
        let wrapped = anyhow::Error::from(WithHint::new("cannot start", "try again").because(bad()));
        let usage = anyhow::Error::from(WithHint::usage("no", "yes")).context("outer");
        let source = anyhow::Error::from(SourceError::bad_arguments("no such size")).context("outer");
        for error in [bad().context("outer"), wrapped.context("outer"), usage, source] {
            assert_eq!(from_result(Err(error), false), BAD_ARGUMENTS);
        }
        assert_eq!(
            from_result(Err(WithHint::new("the disk is full", "free some space").into()), false),
            FAILURE
        );
    }
}
