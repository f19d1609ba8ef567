#![expect(unsafe_code, reason = "exported names")]
//! The reader's view of frames.

use std::ffi::c_void;
use std::mem::MaybeUninit;

use nunet_ipc::{
    AttitudeRecord, CloudPoint, FrameHeader, IpcError, Message, ObstacleRecord, StatsRecord, Topic,
    monotonic_nanos, unix_nanos,
};

use crate::argument::{fill, place, pointer_to};
use crate::handle::{Table, locked};
use crate::status::{Failure, StatusCode, guard};

/// One message in shared memory, read-only. Its memory does not change until it is released, also after its
/// reader is closed and its publisher has ended. Any thread may read and release it.
#[derive(Debug)]
pub struct FrameHandle;

/// Frames with one sequence number and one capture time.
#[derive(Debug)]
#[repr(C)]
pub struct Set {
    /// The frame of each topic, indexed by `nunet_topic_t`; NULL where there is none. No set has `stats` or
    /// `attitude`.
    pub frames: [*mut FrameHandle; 8],
}

impl Set {
    pub(crate) const EMPTY: Self = Self { frames: [std::ptr::null_mut(); Topic::ALL.len()] };
}

pub(crate) static FRAMES: Table<Message> = Table::new("frame");

/// The header of a frame.
///
/// `*header` is valid until the frame is released; NULL after a failure.
///
/// Fails with `NUNET_CLOSED`, `NUNET_BAD_ARGUMENT`, as the functions below do too.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_frame_header(
    frame: *const FrameHandle,
    header: Option<&mut MaybeUninit<*const FrameHeader>>,
) -> StatusCode {
    guard(|| {
        let header = place(header, "header", std::ptr::null())?;
        let frame = FRAMES.get(frame)?;
        *header = std::ptr::from_ref(locked(&frame).header());
        Ok(())
    })
}

/// A frame's payload, of any encoding, aligned to 64 bytes.
///
/// `*bytes` is valid until the frame is released; NULL after a failure. `byte_count` may be NULL.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_frame_bytes(
    frame: *const FrameHandle,
    bytes: Option<&mut MaybeUninit<*const c_void>>,
    byte_count: Option<&mut MaybeUninit<usize>>,
) -> StatusCode {
    guard(|| {
        let bytes = place(bytes, "bytes", std::ptr::null())?;
        let frame = FRAMES.get(frame)?;
        let frame = locked(&frame);
        *bytes = pointer_to(frame.bytes());
        fill(byte_count, frame.bytes().len());
        Ok(())
    })
}

/// The time since capture, in nanoseconds: by the monotonic clock where the camera uses it, otherwise by the
/// time of day.
///
/// `*age_nanos` is `INT64_MIN` where the sender knows neither.
///
/// Fails with `NUNET_CLOSED`, `NUNET_BAD_ARGUMENT`.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_frame_age(
    frame: *const FrameHandle,
    age_nanos: Option<&mut MaybeUninit<i64>>,
) -> StatusCode {
    guard(|| {
        let age_nanos = place(age_nanos, "age_nanos", i64::MIN)?;
        let frame = FRAMES.get(frame)?;
        let age = locked(&frame).header().age_nanos(monotonic_nanos(), unix_nanos());
        *age_nanos = age.unwrap_or(i64::MIN);
        Ok(())
    })
}

/// A depth map: `height` rows from the top of `width` floats, in the header's units (usually meters), NaN
/// where there is no measurement.
///
/// `*depth` is valid until the frame is released; NULL after a failure. `width` and `height` may be NULL.
///
/// Fails with `NUNET_WRONG_ENCODING` when it is something else, `NUNET_BAD_MESSAGE` when its size is not that
/// of its header.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_frame_depth(
    frame: *const FrameHandle,
    depth: Option<&mut MaybeUninit<*const f32>>,
    width: Option<&mut MaybeUninit<u32>>,
    height: Option<&mut MaybeUninit<u32>>,
) -> StatusCode {
    guard(|| grid(frame, place(depth, "depth", std::ptr::null())?, width, height, Message::depth))
}

/// The class of each pixel: `height` rows from the top of `width` bytes. `nunetd inspect MODEL` names the
/// classes.
///
/// Pointers and failures as in `nunet_frame_depth()`.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_frame_labels(
    frame: *const FrameHandle,
    labels: Option<&mut MaybeUninit<*const u8>>,
    width: Option<&mut MaybeUninit<u32>>,
    height: Option<&mut MaybeUninit<u32>>,
) -> StatusCode {
    guard(|| grid(frame, place(labels, "labels", std::ptr::null())?, width, height, Message::labels))
}

/// The confidence of each pixel's depth: `height` rows from the top of `width` bytes, 255 = certain, 0 where
/// there is no measurement.
///
/// Pointers and failures as in `nunet_frame_depth()`.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_frame_confidence(
    frame: *const FrameHandle,
    confidence: Option<&mut MaybeUninit<*const u8>>,
    width: Option<&mut MaybeUninit<u32>>,
    height: Option<&mut MaybeUninit<u32>>,
) -> StatusCode {
    guard(|| {
        let confidence = place(confidence, "confidence", std::ptr::null())?;
        grid(frame, confidence, width, height, Message::confidence)
    })
}

/// A cloud: `height` rows from the top of `width` points in the camera's optical frame (x right, y down, z
/// forward), in the header's units; NaN where there is no measurement.
///
/// Pointers and failures as in `nunet_frame_depth()`.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_frame_points(
    frame: *const FrameHandle,
    points: Option<&mut MaybeUninit<*const CloudPoint>>,
    width: Option<&mut MaybeUninit<u32>>,
    height: Option<&mut MaybeUninit<u32>>,
) -> StatusCode {
    guard(|| grid(frame, place(points, "points", std::ptr::null())?, width, height, Message::points))
}

/// The daemon's counts and latencies, from a frame of the topic `stats`.
///
/// `*stats` is valid until the frame is released; NULL after a failure.
///
/// Fails with `NUNET_WRONG_ENCODING`, `NUNET_BAD_MESSAGE`.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_frame_stats(
    frame: *const FrameHandle,
    stats: Option<&mut MaybeUninit<*const StatsRecord>>,
) -> StatusCode {
    guard(|| {
        let stats = place(stats, "stats", std::ptr::null())?;
        let frame = FRAMES.get(frame)?;
        *stats = std::ptr::from_ref(locked(&frame).stats()?);
        Ok(())
    })
}

/// The obstacles around the robot, from a frame of the topic `obstacles`.
///
/// `*obstacles` is valid until the frame is released; NULL after a failure. Only the first `sector_count`
/// sectors and `point_count` points mean something.
///
/// Fails with `NUNET_WRONG_ENCODING`, `NUNET_BAD_MESSAGE`.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_frame_obstacles(
    frame: *const FrameHandle,
    obstacles: Option<&mut MaybeUninit<*const ObstacleRecord>>,
) -> StatusCode {
    guard(|| {
        let obstacles = place(obstacles, "obstacles", std::ptr::null())?;
        let frame = FRAMES.get(frame)?;
        let frame = locked(&frame);
        let record = frame.obstacles()?;
        let fits = record.sectors().len() == record.sector_count as usize
            && record.points().len() == record.point_count as usize;
        if !fits {
            let detail = "its counts are larger than its arrays".to_owned();
            return Err(IpcError::BadMessage { topic: frame.topic(), detail }.into());
        }
        *obstacles = std::ptr::from_ref(record);
        Ok(())
    })
}

/// The attitude of the robot's base, from a frame of the topic `attitude`.
///
/// `*attitude` is valid until the frame is released; NULL after a failure. Only the first `sample_count`
/// samples mean something.
///
/// Fails with `NUNET_WRONG_ENCODING`, `NUNET_BAD_MESSAGE`.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_frame_attitude(
    frame: *const FrameHandle,
    attitude: Option<&mut MaybeUninit<*const AttitudeRecord>>,
) -> StatusCode {
    guard(|| {
        let attitude = place(attitude, "attitude", std::ptr::null())?;
        let frame = FRAMES.get(frame)?;
        let frame = locked(&frame);
        let record = frame.attitude()?;
        if record.samples().len() != record.sample_count as usize {
            let detail = "its count is larger than its array".to_owned();
            return Err(IpcError::BadMessage { topic: frame.topic(), detail }.into());
        }
        *attitude = std::ptr::from_ref(record);
        Ok(())
    })
}

/// Releases a frame. Pointers into it are no longer valid. NULL is allowed.
///
/// Fails with `NUNET_CLOSED` when it was released before.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_frame_release(frame: *mut FrameHandle) -> StatusCode {
    guard(|| FRAMES.remove(frame).map(drop))
}

/// Releases all frames of a set and sets its pointers to NULL. To keep a frame longer, copy its pointer and
/// set the one in the set to NULL first. NULL is allowed.
///
/// Fails with `NUNET_CLOSED` when one of them was released before; the others are released anyway.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_set_release(set: Option<&mut Set>) -> StatusCode {
    guard(|| {
        let mut all = Ok(());
        for frame in set.into_iter().flat_map(|set| &mut set.frames) {
            let handle = std::mem::replace(frame, std::ptr::null_mut());
            all = all.and(FRAMES.remove(handle).map(drop));
        }
        all
    })
}

fn grid<T>(
    frame: *const FrameHandle,
    cells: &mut *const T,
    width: Option<&mut MaybeUninit<u32>>,
    height: Option<&mut MaybeUninit<u32>>,
    view: impl FnOnce(&Message) -> Result<&[T], IpcError>,
) -> Result<(), Failure> {
    let frame = FRAMES.get(frame)?;
    let frame = locked(&frame);
    let found = view(&frame)?;
    let (columns, rows) = (frame.header().width, frame.header().height);
    // The sender can change the header after it was checked, so the returned size must match the payload.
    if (columns as usize).checked_mul(rows as usize) != Some(found.len()) {
        let detail = "its header changed while it was read".to_owned();
        return Err(IpcError::BadMessage { topic: frame.topic(), detail }.into());
    }
    *cells = found.as_ptr();
    fill(width, columns);
    fill(height, rows);
    Ok(())
}
