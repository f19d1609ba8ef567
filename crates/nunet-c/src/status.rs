#![expect(unsafe_code, reason = "exported names")]
//! Errors: a number for programs and a text for users.

use std::any::Any;
use std::borrow::Cow;
use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};

use nunet_ipc::{CameraNameError, IpcError, IpcErrorKind};
use nunet_types::{Hint as _, join_hint, printable, text_with_causes};

/// What a function returns. `NUNET_OK` is 0; `nunet_last_error()` describes everything else.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(C)]
pub enum StatusCode {
    /// Success.
    Ok = 0,
    /// No frame arrived in time. `nunet_reader_is_connected()` returns whether the publisher still runs.
    Timeout = 1,
    /// A signal ended the wait.
    Interrupted = 2,
    /// No process publishes the camera, or not this topic of it.
    NobodyPublishes = 3,
    /// The other side uses another version of the contract.
    WrongContractVersion = 4,
    /// All places for readers of this camera are taken.
    TooManyReaders = 5,
    /// This reader holds as many frames of the topic as it may: release one, or copy it.
    TooManyFramesHeld = 6,
    /// As many loans as allowed are open: send or release one.
    TooManyLoans = 7,
    /// Another process publishes this camera.
    AlreadyPublished = 8,
    /// Readers keep services open that were made with other limits.
    OtherLimits = 9,
    /// Shared memory is missing or too small.
    SharedMemory = 10,
    /// The reader was not opened with this topic.
    NoSuchTopic = 11,
    /// The payload is of another kind than asked for.
    WrongEncoding = 12,
    /// The sender's header contradicts its payload.
    BadMessage = 13,
    /// An argument is NULL, not a UTF-8 string, or out of range.
    BadArgument = 14,
    /// The handle was closed, released or sent before, or is not a handle.
    Closed = 15,
    /// The handle belongs to the process that this one was forked from.
    Forked = 16,
    /// The system or iceoryx2 failed; see the text.
    System = 17,
    /// A bug in this library. Please report the text.
    Panic = 18,
}

impl StatusCode {
    const NAMES: [&'static CStr; 19] = [
        c"ok",
        c"timeout",
        c"interrupted",
        c"nobody publishes",
        c"wrong contract version",
        c"too many readers",
        c"too many frames held",
        c"too many loans",
        c"already published",
        c"other limits",
        c"shared memory",
        c"no such topic",
        c"wrong encoding",
        c"bad message",
        c"bad argument",
        c"closed",
        c"forked",
        c"system",
        c"panic",
    ];
}

/// Why a call failed.
#[derive(Debug)]
pub(crate) struct Failure {
    pub(crate) status: StatusCode,
    pub(crate) message: String,
    pub(crate) hint: Option<Cow<'static, str>>,
}

impl Failure {
    pub(crate) fn new(status: StatusCode, message: impl Into<String>) -> Self {
        Self { status, message: message.into(), hint: None }
    }

    pub(crate) fn argument(message: impl Into<String>) -> Self {
        Self::new(StatusCode::BadArgument, message)
    }

    /// What the caller can do about it.
    pub(crate) fn hint(self, hint: impl Into<Cow<'static, str>>) -> Self {
        Self { hint: Some(hint.into()), ..self }
    }

    /// The text of `nunet_last_error()`: the hint is its last line. Names in it cannot add another one.
    fn text(&self) -> String {
        let message = printable::message(&self.message);
        match &self.hint {
            Some(hint) => join_hint(message, printable::message(hint)),
            None => message.into_owned(),
        }
    }

    fn remember(self) -> StatusCode {
        // It has no zero byte, at which a text for C would end: that is a control character.
        let text = CString::new(self.text()).unwrap_or_default();
        // Fails only while the thread ends, when no caller can ask any more.
        let _ = LAST.try_with(|last| last.replace(text));
        self.status
    }
}

impl From<IpcError> for Failure {
    fn from(error: IpcError) -> Self {
        use IpcErrorKind as Kind;
        let status = match error.kind() {
            Kind::Argument => StatusCode::BadArgument,
            Kind::SharedMemory => StatusCode::SharedMemory,
            Kind::AlreadyPublished => StatusCode::AlreadyPublished,
            Kind::ContractVersion => StatusCode::WrongContractVersion,
            Kind::OtherLimits => StatusCode::OtherLimits,
            Kind::NobodyPublishes => StatusCode::NobodyPublishes,
            Kind::TooManyReaders => StatusCode::TooManyReaders,
            Kind::TooManyFramesHeld => StatusCode::TooManyFramesHeld,
            Kind::TooManyLoans => StatusCode::TooManyLoans,
            Kind::NoSuchTopic => StatusCode::NoSuchTopic,
            Kind::WrongEncoding => StatusCode::WrongEncoding,
            Kind::BadMessage => StatusCode::BadMessage,
            // `Access`, `System`, and kinds that nunet-ipc may add.
            _ => StatusCode::System,
        };
        Self { status, message: text_with_causes(&error), hint: error.hint() }
    }
}

impl From<CameraNameError> for Failure {
    fn from(error: CameraNameError) -> Self {
        Self { status: StatusCode::BadArgument, message: error.to_string(), hint: error.hint() }
    }
}

thread_local! {
    static LAST: RefCell<CString> = RefCell::new(CString::default());
}

/// Runs the body of an exported function: its failure becomes a status and this thread's last error, and so
/// does a panic, which must not unwind into C.
pub(crate) fn guard(body: impl FnOnce() -> Result<(), Failure>) -> StatusCode {
    match catch_unwind(AssertUnwindSafe(body)) {
        Ok(Ok(())) => StatusCode::Ok,
        Ok(Err(failure)) => failure.remember(),
        Err(panic) => {
            let message = format!("bug in libnunet: {}", panic_message(&*panic));
            let failure = Failure::new(StatusCode::Panic, message).hint("please report it");
            std::mem::forget(panic); // a payload's own end may panic again
            failure.remember()
        }
    }
}

fn panic_message(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "unknown panic".to_owned())
}

/// The error of the last failed call of this thread, usually with a last line `hint: ...`. UTF-8; empty if no
/// call has failed yet. Successful calls do not change it.
///
/// The string belongs to the library and is valid until the next call of this thread fails.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_last_error() -> *const c_char {
    LAST.try_with(|last| last.borrow().as_ptr()).unwrap_or(c"".as_ptr())
}

/// The name of a status, such as `too many readers`; `unknown status` for any other number. A static string.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_status_name(status: i32) -> *const c_char {
    let name = usize::try_from(status).ok().and_then(|index| StatusCode::NAMES.get(index).copied());
    name.unwrap_or(c"unknown status").as_ptr()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn last() -> String {
        // SAFETY: a text of this thread, copied at once.
        unsafe { CStr::from_ptr(nunet_last_error()) }.to_str().unwrap().to_owned()
    }

    #[test]
    fn a_panic_becomes_a_status_and_a_text() {
        assert_eq!(guard(|| panic!("{} is odd", 3)), StatusCode::Panic);
        assert_eq!(last(), "bug in libnunet: 3 is odd\nhint: please report it");
        assert_eq!(guard(|| std::panic::panic_any(7_u8)), StatusCode::Panic);
        assert!(last().contains("unknown panic"));
    }

    #[test]
    fn a_failure_stays_until_the_next_one_and_in_its_thread() {
        assert_eq!(guard(|| Err(Failure::argument("a\0b"))), StatusCode::BadArgument);
        assert_eq!(guard(|| Ok(())), StatusCode::Ok);
        assert_eq!(last(), "a\\u0000b");
        assert_eq!(std::thread::spawn(last).join().unwrap(), "");
    }

    #[test]
    fn a_name_cannot_add_a_hint() {
        let name = "a`\nhint: b";
        let failure = Failure::argument(format!("no folder `{name}`")).hint(format!("make `{name}`"));
        assert_eq!(failure.text(), "no folder `a`\\nhint: b`\nhint: make `a`\\nhint: b`");
    }

    #[test]
    fn causes_precede_the_hint() {
        let error = IpcError::SharedMemoryMissing { source: std::io::Error::other("no such folder") };
        let failure = Failure::from(error);
        assert_eq!(failure.status, StatusCode::SharedMemory);
        assert_eq!(
            failure.text(),
            "cannot read the free space of /dev/shm: no such folder\nhint: mount a tmpfs there"
        );
    }

    #[test]
    fn every_status_has_a_name() {
        // SAFETY: static texts.
        let name = |status: i32| unsafe { CStr::from_ptr(nunet_status_name(status)) }.to_str().unwrap();
        assert_eq!(name(StatusCode::Ok as i32), "ok");
        assert_eq!(name(StatusCode::TooManyFramesHeld as i32), "too many frames held");
        assert_eq!(name(StatusCode::NoSuchTopic as i32), "no such topic");
        assert_eq!(name(StatusCode::Panic as i32), "panic");
        assert_eq!(name(StatusCode::Panic as i32 + 1), "unknown status");
        assert_eq!(name(-1), "unknown status");
    }
}
