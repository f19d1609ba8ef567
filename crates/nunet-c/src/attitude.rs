#![expect(unsafe_code, reason = "exported names, and texts that come as bare pointers")]
#![expect(clippy::missing_safety_doc, reason = "the header says once for all what pointers must be")]
//! The attitude of a robot that pitches or rolls.

use std::ffi::c_char;
use std::mem::MaybeUninit;

use nunet_ipc::AttitudePublisher;

use crate::argument::{camera, place, word};
use crate::handle::{Table, locked};
use crate::status::{StatusCode, guard};

/// The publisher of the attitude for a camera. Calls with one publisher run one after the other, from any
/// threads.
#[derive(Debug)]
pub struct AttitudeHandle;

static ATTITUDES: Table<AttitudePublisher> = Table::new("attitude publisher");

/// Becomes the publisher of the attitude of the robot's base for a camera, which `nunetd --attitude shm`
/// reads.
///
/// `clock`: a `nunet_clock_t`, that of the samples' times. `*attitude` is the caller's, to be closed with
/// `nunet_attitude_close()`; NULL after a failure.
///
/// Fails with `NUNET_ALREADY_PUBLISHED` when another process publishes it, `NUNET_SHARED_MEMORY`,
/// `NUNET_OTHER_LIMITS`, `NUNET_WRONG_CONTRACT_VERSION`, `NUNET_SYSTEM`, `NUNET_BAD_ARGUMENT`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nunet_attitude_open(
    camera: *const c_char,
    clock: u32,
    attitude: Option<&mut MaybeUninit<*mut AttitudeHandle>>,
) -> StatusCode {
    guard(|| {
        let attitude = place(attitude, "attitude", std::ptr::null_mut())?;
        // SAFETY: the caller passes a text or NULL.
        let camera = unsafe { self::camera(camera) }?;
        *attitude = ATTITUDES.insert(AttitudePublisher::create(&camera, word(clock, "clock")?)?);
        Ok(())
    })
}

/// Publishes a sample. Call it for each measurement of the sensor, about 50 to 200 times per second.
///
/// `capture_nanos`: when it was measured, nanoseconds of the publisher's clock (`nunet_monotonic_nanos()`).
/// `roll_rad`, `pitch_rad`: rotation of the base about x (forward) and y (left), radians; a positive roll
/// lowers the right side, a positive pitch the front.
///
/// Fails with `NUNET_BAD_ARGUMENT` for an angle that is not a number or is beyond a turn and for a negative
/// time, `NUNET_SYSTEM`, `NUNET_CLOSED`.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_attitude_publish(
    attitude: *const AttitudeHandle,
    capture_nanos: i64,
    roll_rad: f32,
    pitch_rad: f32,
) -> StatusCode {
    guard(|| {
        let publisher = ATTITUDES.get(attitude)?;
        Ok(locked(&publisher).publish(capture_nanos, roll_rad, pitch_rad)?)
    })
}

/// Closes a publisher of the attitude. NULL is allowed.
///
/// Fails with `NUNET_CLOSED` when it was closed before.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_attitude_close(attitude: *mut AttitudeHandle) -> StatusCode {
    guard(|| ATTITUDES.remove(attitude).map(drop))
}
