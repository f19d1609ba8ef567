#![expect(unsafe_code, reason = "exported names")]
//! What went wrong: a number for the program, a text for people.

use std::any::Any;
use std::cell::RefCell;
use std::error::Error;
use std::ffi::{CStr, CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};

use nunet_ipc::{CameraNameError, IpcError};

/// What a function answers. `NUNET_OK` is 0; everything else is described by `nunet_last_error()`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(C)]
pub enum Status {
    /// It worked.
    Ok = 0,
    /// Nothing came in time. The camera may stand still or be gone: `nunet_reader_is_connected()` tells.
    Timeout = 1,
    /// A signal ended the waiting.
    Interrupted = 2,
    /// Nobody publishes the camera, or not this topic of it.
    NobodyPublishes = 3,
    /// The other side speaks another version of the contract.
    WrongContractVersion = 4,
    /// All places for readers of this camera are taken.
    TooManyReaders = 5,
    /// This reader holds as many frames of the topic as it may: release one, or copy what must live longer.
    TooManyFramesHeld = 6,
    /// As many loans as allowed are open: send or release one.
    TooManyLoans = 7,
    /// Another process publishes this camera.
    AlreadyOwned = 8,
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
    /// An argument is NULL, no text, or outside of its range.
    BadArgument = 14,
    /// The handle was closed, released or sent before, or never was one.
    Closed = 15,
    /// The handle belongs to the process that this one was forked from.
    Forked = 16,
    /// The system or iceoryx2 refused; the text says what.
    System = 17,
    /// A fault in this library. It was stopped here; please report the text.
    Panic = 18,
}

impl Status {
    const NAMES: [&'static CStr; 19] = [
        c"ok",
        c"timeout",
        c"interrupted",
        c"nobody publishes",
        c"wrong contract version",
        c"too many readers",
        c"too many frames held",
        c"too many loans",
        c"already owned",
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
    pub(crate) status: Status,
    pub(crate) message: String,
}

impl Failure {
    pub(crate) fn new(status: Status, message: impl Into<String>) -> Self {
        Self { status, message: message.into() }
    }

    pub(crate) fn argument(message: impl Into<String>) -> Self {
        Self::new(Status::BadArgument, message)
    }

    fn remember(self) -> Status {
        // A text for C ends at its first zero byte.
        let text = CString::new(self.message.replace('\0', "\\0")).unwrap_or_default();
        // Fails only while the thread ends, when nobody can ask any more.
        let _ = LAST.try_with(|last| last.replace(text));
        self.status
    }
}

impl From<IpcError> for Failure {
    fn from(error: IpcError) -> Self {
        use IpcError as E;
        let status = match &error {
            E::Limit { .. } | E::PlannedTwice { .. } | E::PayloadTooLarge { .. } | E::WrongElement { .. } => {
                Status::BadArgument
            }
            E::SharedMemoryTooSmall { .. } | E::SharedMemoryMissing { .. } | E::MemoryNotBacked { .. } => {
                Status::SharedMemory
            }
            E::AlreadyOwned { .. } => Status::AlreadyOwned,
            E::ContractVersion { .. } => Status::WrongContractVersion,
            E::OtherLimits { .. } => Status::OtherLimits,
            E::NobodyPublishes { .. } => Status::NobodyPublishes,
            E::TooManyReaders { .. } | E::TooManyListeners { .. } => Status::TooManyReaders,
            E::TooManyFramesHeld { .. } => Status::TooManyFramesHeld,
            E::TooManyLoans { .. } => Status::TooManyLoans,
            E::NoSuchTopic { .. } => Status::NoSuchTopic,
            E::WrongEncoding { .. } => Status::WrongEncoding,
            E::BadMessage { .. } => Status::BadMessage,
            // `Iceoryx`, `Locked`, `Remove`, `CannotJoin`, and what a later nunet-ipc may add.
            _ => Status::System,
        };
        Self::new(status, explained(&error))
    }
}

impl From<CameraNameError> for Failure {
    fn from(error: CameraNameError) -> Self {
        Self::argument(error.to_string())
    }
}

/// The error and its causes in one text, with the hint as its last line.
fn explained(error: &dyn Error) -> String {
    let text = error.to_string();
    let (body, hint) = text.split_once("\nhint: ").map_or((text.as_str(), None), |(b, h)| (b, Some(h)));
    let mut whole = body.to_owned();
    let mut cause = error.source();
    while let Some(found) = cause {
        whole.push_str(&format!(": {found}"));
        cause = found.source();
    }
    if let Some(hint) = hint {
        whole.push_str(&format!("\nhint: {hint}"));
    }
    whole
}

thread_local! {
    static LAST: RefCell<CString> = RefCell::new(CString::default());
}

/// Runs the body of an exported function: its failure becomes a status and this thread's last error, and so does a
/// panic, which must not unwind into C.
pub(crate) fn guard(body: impl FnOnce() -> Result<(), Failure>) -> Status {
    match catch_unwind(AssertUnwindSafe(body)) {
        Ok(Ok(())) => Status::Ok,
        Ok(Err(failure)) => failure.remember(),
        Err(panic) => {
            let failure = Failure::new(
                Status::Panic,
                format!("a fault in libnunet: {}\nhint: please report it", said(&*panic)),
            );
            std::mem::forget(panic); // a payload's own end may panic again
            failure.remember()
        }
    }
}

fn said(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "of unknown kind".to_owned())
}

/// Why the last call of this thread that failed did so: what, where, expected and got, and mostly a last line
/// `hint: ...`. UTF-8; empty when none has failed yet. A call that works leaves it as it is.
///
/// The text belongs to the library and stays until the next call of this thread fails.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_last_error() -> *const c_char {
    LAST.try_with(|last| last.borrow().as_ptr()).unwrap_or(c"".as_ptr())
}

/// A status in words, such as `too many readers`; `unknown status` for a number that is none. A static text.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_status_name(status: i32) -> *const c_char {
    let name = usize::try_from(status).ok().and_then(|index| Status::NAMES.get(index).copied());
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
        assert_eq!(guard(|| panic!("{} is odd", 3)), Status::Panic);
        assert_eq!(last(), "a fault in libnunet: 3 is odd\nhint: please report it");
        assert_eq!(guard(|| std::panic::panic_any(7_u8)), Status::Panic);
        assert!(last().contains("of unknown kind"));
    }

    #[test]
    fn a_failure_stays_until_the_next_one_and_in_its_thread() {
        assert_eq!(guard(|| Err(Failure::argument("a\0b"))), Status::BadArgument);
        assert_eq!(guard(|| Ok(())), Status::Ok);
        assert_eq!(last(), "a\\0b");
        assert_eq!(std::thread::spawn(last).join().unwrap(), "");
    }

    #[test]
    fn causes_stand_before_the_hint() {
        let error = IpcError::SharedMemoryMissing { source: std::io::Error::other("no such folder") };
        let failure = Failure::from(error);
        assert_eq!(failure.status, Status::SharedMemory);
        assert_eq!(
            failure.message,
            "cannot ask /dev/shm for its free space: no such folder\nhint: mount a tmpfs there"
        );
    }

    #[test]
    fn every_status_has_a_name() {
        // SAFETY: static texts.
        let name = |status: i32| unsafe { CStr::from_ptr(nunet_status_name(status)) }.to_str().unwrap();
        assert_eq!(name(Status::Ok as i32), "ok");
        assert_eq!(name(Status::TooManyFramesHeld as i32), "too many frames held");
        assert_eq!(name(Status::NoSuchTopic as i32), "no such topic");
        assert_eq!(name(Status::Panic as i32), "panic");
        assert_eq!(name(Status::Panic as i32 + 1), "unknown status");
        assert_eq!(name(-1), "unknown status");
    }
}
