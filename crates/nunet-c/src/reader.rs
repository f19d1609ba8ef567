#![expect(unsafe_code, reason = "exported names, and texts that come as bare pointers")]
#![expect(clippy::missing_safety_doc, reason = "the header says once for all what pointers must be")]
//! A reader of a camera.

use std::ffi::c_char;
use std::mem::MaybeUninit;
use std::time::{Duration, Instant};

use nunet_ipc::{IpcError, Reader, Topic};

use crate::argument::{camera, fill, place, timeout, topics, word};
use crate::frame::{FRAMES, FrameHandle, Set};
use crate::handle::{Table, locked};
use crate::status::{Failure, StatusCode, guard};

/// A reader of some of a camera's topics. Calls with one reader run one after the other, from any threads.
#[derive(Debug)]
pub struct ReaderHandle;

static READERS: Table<Reader> = Table::new("reader");

/// The longest sleep between two attempts. A late subscriber receives its first frame without a wake-up, and
/// a reader may be closed by another thread.
const NAP: Duration = Duration::from_millis(100);

/// nunet-ipc does not sleep for less: what is left when a sleep ends by itself is less than this.
const SHORTEST_NAP: Duration = Duration::from_micros(10);

/// Opens topics of a camera. Waits for its publisher until the timeout.
///
/// `camera`: the name given to `nunetd --camera`. `topic_bits`: `NUNET_BIT_DEPTH | NUNET_BIT_LABELS | ...`.
/// `timeout_ms`: milliseconds, or `NUNET_FOREVER`. A signal does not end this wait: a program that must react
/// to one calls this repeatedly with a short timeout. `*reader` is the caller's, to be closed with
/// `nunet_reader_close()`; NULL after a failure.
///
/// Fails with `NUNET_NOBODY_PUBLISHES` after the timeout, `NUNET_TOO_MANY_READERS`,
/// `NUNET_WRONG_CONTRACT_VERSION`, `NUNET_SYSTEM`, `NUNET_BAD_ARGUMENT`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nunet_reader_open(
    camera: *const c_char,
    topic_bits: u32,
    timeout_ms: u32,
    reader: Option<&mut MaybeUninit<*mut ReaderHandle>>,
) -> StatusCode {
    guard(|| {
        let reader = place(reader, "reader", std::ptr::null_mut())?;
        // SAFETY: the caller passes a text or NULL.
        let camera = unsafe { self::camera(camera) }?;
        let topics = topics(topic_bits)?;
        *reader = READERS.insert(Reader::open(&camera, &topics, timeout(timeout_ms))?);
        Ok(())
    })
}

/// Sleeps until there may be a new frame, or the time is over. Only a hint, for programs with their own loop:
/// look for frames whatever it returns. `nunet_reader_next()` waits by itself.
///
/// `woken` (may be NULL): whether a publisher sent something, started or ended. A signal ends the sleep
/// early.
///
/// Fails with `NUNET_CLOSED`, also when another thread closes the reader meanwhile; `NUNET_SYSTEM`,
/// `NUNET_BAD_ARGUMENT`.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_reader_wait(
    reader: *const ReaderHandle,
    timeout_ms: u32,
    woken: Option<&mut MaybeUninit<bool>>,
) -> StatusCode {
    guard(|| {
        let (timeout, start) = (timeout(timeout_ms), Instant::now());
        loop {
            let left = timeout.saturating_sub(start.elapsed());
            let end = nap(&locked(&*READERS.get(reader)?), left)?;
            if end != Nap::Over || left <= NAP {
                fill(woken, end == Nap::Woken);
                return Ok(());
            }
        }
    })
}

/// The newest frame of a topic that was not returned yet. Sleeps until there is one. Older frames are
/// skipped.
///
/// `topic`: a `nunet_topic_t`. `timeout_ms`: milliseconds; 0 does not wait. `*frame` is the caller's, to be
/// released with `nunet_frame_release()`; NULL after a failure. A reader may hold a few frames of a topic at
/// a time, by default 2.
///
/// Fails with `NUNET_TIMEOUT`; `NUNET_INTERRUPTED` when a signal handler ran while it waited;
/// `NUNET_TOO_MANY_FRAMES_HELD` when there is a frame but the caller holds as many as it may;
/// `NUNET_NO_SUCH_TOPIC`, `NUNET_BAD_MESSAGE`, `NUNET_SYSTEM`, `NUNET_CLOSED`, `NUNET_BAD_ARGUMENT`.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_reader_next(
    reader: *const ReaderHandle,
    topic: u32,
    timeout_ms: u32,
    frame: Option<&mut MaybeUninit<*mut FrameHandle>>,
) -> StatusCode {
    guard(|| {
        let frame = place(frame, "frame", std::ptr::null_mut())?;
        let topic: Topic = word(topic, "topic")?;
        let found =
            wait_for(reader, timeout_ms, &format!("frame of `{topic}`"), |reader| reader.latest(topic))?;
        *frame = FRAMES.insert(found);
        Ok(())
    })
}

/// The newest frames of all the reader's topics that belong together: all with one `sequence` and one
/// `capture_nanos`. Waits for them as `nunet_reader_next()` does, which alone returns `stats` and `attitude`.
///
/// `set->frames[NUNET_TOPIC_...]`: a frame for each such topic that was opened, NULL for the others, all NULL
/// after a failure. They are the caller's: release each with `nunet_frame_release()`, or all with
/// `nunet_set_release()`.
///
/// Fails as `nunet_reader_next()` does.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_reader_next_set(
    reader: *const ReaderHandle,
    timeout_ms: u32,
    set: Option<&mut MaybeUninit<Set>>,
) -> StatusCode {
    guard(|| {
        let set = place(set, "set", Set::EMPTY)?;
        let mut found = wait_for(reader, timeout_ms, "complete set of frames", Reader::next_set)?;
        for topic in Topic::ALL {
            if let Some(frame) = found.take(*topic) {
                set.frames[*topic as usize] = FRAMES.insert(frame);
            }
        }
        Ok(())
    })
}

/// The process that publishes a topic. It reads the file system, so call it when no frames arrive, not for
/// every frame.
///
/// `pid` (may be NULL): 0 when there is none. `alive` (may be NULL): false when there is none, or it was
/// killed.
///
/// Fails with `NUNET_NO_SUCH_TOPIC`, `NUNET_CLOSED`, `NUNET_BAD_ARGUMENT`.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_reader_publisher(
    reader: *const ReaderHandle,
    topic: u32,
    pid: Option<&mut MaybeUninit<u32>>,
    alive: Option<&mut MaybeUninit<bool>>,
) -> StatusCode {
    guard(|| {
        let reader = READERS.get(reader)?;
        let publisher = locked(&reader).publisher(word(topic, "topic")?)?;
        fill(pid, publisher.map_or(0, |publisher| publisher.pid));
        fill(alive, publisher.is_some_and(|publisher| publisher.alive));
        Ok(())
    })
}

/// Whether a living process publishes each of the reader's topics; as costly as `nunet_reader_publisher()`. A
/// reader that is not connected need not be opened again: it receives the frames of the next publisher. False
/// for a reader that is closed or NULL.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_reader_is_connected(reader: *const ReaderHandle) -> bool {
    let mut connected = false;
    guard(|| {
        let reader = READERS.get(reader)?;
        connected = locked(&reader).is_connected();
        Ok(())
    }) == StatusCode::Ok
        && connected
}

/// Closes a reader. Its frames stay valid until they are released. NULL is allowed.
///
/// Fails with `NUNET_CLOSED` when it was closed before.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_reader_close(reader: *mut ReaderHandle) -> StatusCode {
    guard(|| READERS.remove(reader).map(drop))
}

/// Attempts until there is a result, the time is over, or a signal arrives. The handle is looked up before
/// each sleep, so that the wait ends when another thread closes the reader.
fn wait_for<T>(
    handle: *const ReaderHandle,
    timeout_ms: u32,
    what: &str,
    mut poll: impl FnMut(&mut Reader) -> Result<Option<T>, IpcError>,
) -> Result<T, Failure> {
    let timeout = timeout(timeout_ms);
    let start = Instant::now();
    loop {
        let reader = READERS.get(handle)?;
        let mut reader = locked(&reader);
        if let Some(found) = poll(&mut reader)? {
            return Ok(found);
        }
        let left = timeout.saturating_sub(start.elapsed());
        if left.is_zero() {
            return Err(late(&reader, timeout, what));
        }
        if nap(&reader, left)? == Nap::Interrupted {
            return Err(Failure::new(StatusCode::Interrupted, "a signal came while waiting for a frame"));
        }
    }
}

/// How a sleep ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Nap {
    Woken,
    Interrupted,
    Over,
}

/// Sleeps once, for `NAP` at most.
fn nap(reader: &Reader, left: Duration) -> Result<Nap, IpcError> {
    let (nap, asleep) = (left.min(NAP), Instant::now());
    Ok(match reader.wait(nap)? {
        true => Nap::Woken,
        false if nap.saturating_sub(asleep.elapsed()) > SHORTEST_NAP => Nap::Interrupted,
        false => Nap::Over,
    })
}

/// Why no frame arrived. Without a timeout the reason is not looked up, because that takes time.
fn late(reader: &Reader, timeout: Duration, what: &str) -> Failure {
    let camera = reader.camera();
    if timeout.is_zero() {
        return Failure::new(StatusCode::Timeout, format!("no new {what} of camera `{camera}` yet"));
    }
    let hint = if reader.is_connected() {
        "wait longer: its publisher is alive, but slower than the timeout, or its source is paused"
    } else {
        "start its publisher again: no process publishes the camera, and this reader will receive the frames of the next"
    };
    let seconds = timeout.as_secs_f64();
    Failure::new(StatusCode::Timeout, format!("no new {what} of camera `{camera}` after {seconds} s"))
        .hint(hint)
}
