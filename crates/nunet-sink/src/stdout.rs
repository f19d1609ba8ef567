//! Results on standard output, and log lines on standard error: the one place that writes them.

use std::fmt::Display;
use std::io::{self, Write};

use nunet_types::printable;

use crate::error_kind::SinkErrorKind;

/// Standard output could not be written.
#[derive(Debug, thiserror::Error)]
#[error("cannot write to standard output")]
pub struct StdoutError(#[from] io::Error);

impl StdoutError {
    /// [`SinkErrorKind::ClosedPipe`] if the reader has closed the pipe, as `head -1` does: that is the end of
    /// the work, not a failure. Otherwise [`SinkErrorKind::System`].
    #[must_use]
    pub fn kind(&self) -> SinkErrorKind {
        match self.0.kind() {
            io::ErrorKind::BrokenPipe => SinkErrorKind::ClosedPipe,
            _ => SinkErrorKind::System,
        }
    }
}

/// Prints `results` and a line end, and flushes both. Names in them cannot control the terminal.
///
/// # Errors
/// The disk is full, or the reader has closed the pipe.
pub fn print(results: impl Display) -> Result<(), StdoutError> {
    let mut stdout = io::stdout().lock();
    writeln!(stdout, "{}", printable::lines(&results.to_string()))?;
    Ok(stdout.flush()?)
}

/// Stderr for one log line: names of files and topics in it cannot begin another one. The formatter writes
/// each line at once.
#[derive(Debug)]
pub struct LogLine {
    /// The line has escape sequences for colors; the formatter has escaped those in its values.
    pub color: bool,
}

impl Write for LogLine {
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        io::stderr().write_all(escaped(line, self.color).as_bytes())?;
        Ok(line.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        io::stderr().flush()
    }
}

fn escaped(line: &[u8], color: bool) -> String {
    const ESCAPE: char = '\u{1b}';
    let text = String::from_utf8_lossy(line);
    let text = text.strip_suffix('\n').unwrap_or(&text);
    let parts = if color { text.split(ESCAPE).collect() } else { vec![text] };
    let parts: Vec<_> = parts.into_iter().map(printable::one_line).collect();
    parts.join("\u{1b}") + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_closed_pipe_is_no_failure_of_the_system() {
        let kind = |kind: io::ErrorKind| StdoutError::from(io::Error::from(kind)).kind();
        assert_eq!(kind(io::ErrorKind::BrokenPipe), SinkErrorKind::ClosedPipe);
        assert_eq!(kind(io::ErrorKind::StorageFull), SinkErrorKind::System);
    }

    #[test]
    fn a_log_line_stays_one_line() {
        assert_eq!(escaped(b"INFO `a\nERROR b\x1b[2J`\n", false), "INFO `a\\nERROR b\\u001b[2J`\n");
        assert_eq!(escaped(b"\x1b[32mINFO\x1b[0m `a\nb`\n", true), "\x1b[32mINFO\x1b[0m `a\\nb`\n");
        assert_eq!(escaped(b"{\"message\":\"a\\nb\"}\n", false), "{\"message\":\"a\\nb\"}\n");
    }

    #[test]
    fn names_do_not_make_invalid_json() {
        let json = serde_json::json!({ "message": "`fly\u{202e}gpj.png\u{7f}\u{85}\u{1b}`" });
        let printed = escaped(format!("{json}\n").as_bytes(), false);
        assert!(printed.trim_end().is_ascii(), "{printed}");
        assert_eq!(serde_json::from_str::<serde_json::Value>(&printed).unwrap(), json);
    }
}
