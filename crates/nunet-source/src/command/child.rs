//! A program that runs, with what it writes.

use std::io::{BufReader, Read};
use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
use std::process::{Child, ChildStderr, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use nunet_types::printable;
use rustix::process::{Pid, Signal, WaitId, WaitIdOptions, kill_process_group, waitid};
use tracing::debug;

use super::guard::Guard;
use super::processes::{Strays, is_group_running};
use crate::OpenOptions;
use crate::error::{SourceError, SourceErrorKind};
use crate::pipe::Pipe;
use crate::secret::Secrets;

/// How long a program may take to end after it is asked to.
const GRACE: Duration = Duration::from_secs(1);
/// How often a wait looks whether it is over.
const STEP: Duration = Duration::from_millis(5);
/// The longest part of a line that is kept.
const MAX_LINE_BYTES: usize = 1024;
/// What a shell's exit code says: the command cannot be run, or does not exist.
const CANNOT_RUN: i32 = 126;
const NOT_FOUND: i32 = 127;

/// A program that runs. It is killed with all that it started when this is dropped.
pub(super) struct Running {
    /// Until it is ended.
    child: Option<(Child, Guard)>,
    pub(super) images: Pipe,
    pub(super) started: Instant,
    errors: LastLine,
}

/// The last line that the program wrote on standard error, and the thread that reads it.
struct LastLine {
    line: Arc<Mutex<String>>,
    reader: Option<JoinHandle<()>>,
}

/// A program that is being ended, on a thread of its own: this may take longer than a source may wait.
/// Dropping this waits for the end.
pub(super) struct Ending(Option<JoinHandle<Ended>>);

/// How a program ended.
#[derive(Default)]
pub(super) struct Ended {
    /// `None` if it had to be killed, or its end is unknown.
    status: Option<ExitStatus>,
    /// The last line on standard error.
    pub(super) last_line: String,
}

impl Running {
    /// # Errors
    /// There is no such program, or no more process or thread.
    pub(super) fn start(arguments: &[String], options: &OpenOptions<'_>) -> Result<Self, SourceError> {
        let unavailable = |message: String| SourceError::new(SourceErrorKind::Unavailable, message);
        let secrets = Secrets::of_arguments(arguments);
        let (program, arguments) = arguments.split_first().ok_or_else(|| unavailable("no program".into()))?;
        let mut command = Command::new(program);
        command.args(arguments).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        // A group of its own, which can be ended as a whole.
        let mut child = command.process_group(0).spawn().map_err(|error| {
            let is_missing = error.kind() == std::io::ErrorKind::NotFound;
            let error = unavailable(format!("cannot start `{program}`")).with_cause(error);
            if is_missing { error.with_hint(format!("install {program}, and check PATH")) } else { error }
        })?;
        let guard = Guard::of(Pid::from_child(&child));
        let errors = LastLine::read(child.stderr.take(), secrets);
        let images = match child.stdout.take() {
            Some(output) => Pipe::open(output, options, "the program's output"),
            None => Err(unavailable("the program has no output".into())),
        };
        match images {
            Ok(images) => Ok(Self { child: Some((child, guard)), images, started: Instant::now(), errors }),
            Err(error) => {
                end((child, guard));
                Err(error)
            }
        }
    }

    /// Begins to end the program if it still runs.
    pub(super) fn end(mut self) -> Ending {
        let end = move || Ended { status: self.child.take().and_then(end), last_line: self.errors.get() };
        // Without the thread, the program is ended here, and only the reason is unknown.
        Ending(std::thread::Builder::new().name("program-end".into()).spawn(end).ok())
    }
}

impl Ending {
    /// Waits up to `timeout` for the end. Returns itself if that is too short.
    pub(super) fn wait(mut self, timeout: Duration) -> Result<Ended, Self> {
        if is_true_within(timeout, || has_ended(&self.0)) { Ok(self.join()) } else { Err(self) }
    }

    fn join(&mut self) -> Ended {
        self.0.take().and_then(|thread| thread.join().ok()).unwrap_or_default()
    }
}

impl Drop for Ending {
    fn drop(&mut self) {
        self.join();
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.child.take().and_then(end);
    }
}

impl Ended {
    /// Why the program gives no more images.
    pub(super) fn reason(&self) -> String {
        let status = match self.status.map(|status| (status.code(), status.signal())) {
            Some((Some(code), _)) => format!("it ended with exit code {code}"),
            Some((None, Some(signal))) => format!("signal {signal} ended it"),
            _ => "it closed its output".to_owned(),
        };
        if self.last_line.is_empty() { status } else { format!("{status}: {}", self.last_line) }
    }

    /// What a shell could not run.
    pub(super) fn never_starts(&self) -> Option<&str> {
        let is_refused = matches!(self.status?.code()?, CANNOT_RUN | NOT_FOUND);
        is_refused.then_some(if self.last_line.is_empty() {
            "the shell cannot run it"
        } else {
            &self.last_line
        })
    }
}

/// Waits a moment for a program to end by itself, then asks it and all that it started to end, then kills
/// them. Returns its status if it ended by itself.
fn end((mut child, guard): (Child, Guard)) -> Option<ExitStatus> {
    // Not collected before its group is ended: until then, no other process can have its number.
    let pid = i32::try_from(child.id()).ok().and_then(Pid::from_raw)?;
    let by_itself = ends_within(pid, GRACE / 20);
    let mut strays = Strays::below(pid);
    // Fails if no process of the group is left.
    let _ = kill_process_group(pid, Signal::TERM);
    strays.signal(Signal::TERM);
    // A shell may end at once while a program of its pipeline ignores the signal, and keeps the camera open.
    let are_gone = || !is_group_running(pid) && !strays.are_running();
    if !ends_within(pid, GRACE) || !is_true_within(GRACE, are_gone) {
        strays.update(pid);
        let _ = kill_process_group(pid, Signal::KILL);
        strays.signal(Signal::KILL);
    }
    // Afterward, another group may have the number.
    drop(guard);
    let status = child.wait().ok();
    status.filter(|_| by_itself)
}

/// Whether a child ends in time. It is not collected.
fn ends_within(pid: Pid, time: Duration) -> bool {
    let options = WaitIdOptions::EXITED | WaitIdOptions::NOHANG | WaitIdOptions::NOWAIT;
    // An error: there is no such child.
    is_true_within(time, || !matches!(waitid(WaitId::Pid(pid), options), Ok(None)))
}

fn has_ended<T>(thread: &Option<JoinHandle<T>>) -> bool {
    thread.as_ref().is_none_or(JoinHandle::is_finished)
}

/// Waits up to `time` until `condition` is true.
fn is_true_within(time: Duration, mut condition: impl FnMut() -> bool) -> bool {
    let deadline = Instant::now() + time;
    while !condition() {
        if Instant::now() >= deadline {
            return false;
        }
        std::thread::sleep(STEP);
    }
    true
}

impl LastLine {
    /// Reads standard error, so that the program never waits for it.
    fn read(errors: Option<ChildStderr>, secrets: Secrets) -> Self {
        let line = Arc::<Mutex<String>>::default();
        let kept = Arc::clone(&line);
        let read = move || errors.into_iter().for_each(|errors| keep_last_line(errors, &secrets, &kept));
        // Without the thread, only the reason of an end is unknown; the pipe is closed.
        let reader = std::thread::Builder::new().name("program".into()).spawn(read).ok();
        Self { line, reader }
    }

    /// The line, after the thread had a moment to read it.
    fn get(&self) -> String {
        is_true_within(GRACE / 5, || has_ended(&self.reader));
        self.line.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// Keeps the last line that is not empty. ffmpeg rewrites its progress after a carriage return.
fn keep_last_line(errors: impl Read, secrets: &Secrets, kept: &Mutex<String>) {
    let mut line = Vec::new();
    // One byte more shows that a line is too long.
    let most = MAX_LINE_BYTES + secrets.longest() + 1;
    for byte in BufReader::new(errors).bytes().map_while(Result::ok) {
        match byte {
            b'\n' | b'\r' => keep(&std::mem::take(&mut line), secrets, kept),
            byte if line.len() < most => line.push(byte),
            _ => {}
        }
    }
    keep(&line, secrets, kept);
}

fn keep(line: &[u8], secrets: &Secrets, kept: &Mutex<String>) {
    let text = String::from_utf8_lossy(line);
    if text.trim().is_empty() {
        return;
    }
    // Programs repeat their arguments in errors, ffmpeg its URL.
    let mut text = secrets.hide(text.trim());
    if line.len() > MAX_LINE_BYTES + secrets.longest() {
        // A secret may be cut off at the end, where it is not recognized.
        text.truncate(text.floor_char_boundary(text.len().saturating_sub(secrets.longest())));
    }
    let text = printable::one_line(&text).into_owned();
    debug!("program: {text}");
    *kept.lock().unwrap_or_else(PoisonError::into_inner) = text;
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kept(written: &str, arguments: &[&str]) -> String {
        let arguments: Vec<String> = arguments.iter().map(|&argument| argument.to_owned()).collect();
        let kept = Mutex::default();
        keep_last_line(written.as_bytes(), &Secrets::of_arguments(&arguments), &kept);
        kept.into_inner().unwrap()
    }

    #[test]
    fn a_password_of_the_arguments_is_in_no_line_whatever_the_program_makes_of_it() {
        let url = "rtsp://admin:12#s3cret@10.0.0.4/front";
        for printed in [
            format!("cannot open {url}"),
            "no route to #s3cret@10.0.0.4".to_owned(),
            "the password s3cret is wrong\n\n".to_owned(),
            // Cut off within it.
            format!("{}s3cret", "-".repeat(MAX_LINE_BYTES - 3)),
            format!("{}s3cret", "-".repeat(MAX_LINE_BYTES + "admin:12#s3cret".len() - 3)),
        ] {
            let kept = kept(&printed, &["ffmpeg", "-i", url]);
            assert!(!kept.contains("s3") && kept.len() >= 3, "{kept}");
        }
        let kept = kept("user s3cret!", &["/bin/sh", "-c", "curl -u admin:s3cret http://10.0.0.4/a"]);
        assert_eq!(kept, "user ***!");
    }

    #[test]
    fn the_last_line_that_is_not_empty_is_kept() {
        assert_eq!(kept("one\ntwo\r\n\r\n", &[]), "two");
        assert_eq!(kept("frame=1\rframe=2\r", &[]), "frame=2");
        assert_eq!(kept("", &[]), "");
    }
}
