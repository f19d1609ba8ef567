//! The attitude of the robot's base: from the driver of an inertial sensor to the daemon.

use std::borrow::Cow;
use std::time::{Duration, Instant};

use nunet_types::{Clock, Encoding, Hint, Topic};

use crate::clock::{monotonic_nanos, unix_nanos};
use crate::contract::{AttitudeRecord, AttitudeSample};
use crate::error::IpcError;
use crate::name::CameraName;
use crate::plan::{Limits, TopicPlan};
use crate::publisher::{Publisher, check_capture_time};
use crate::reader::{Message, Reader};

/// How soon to look again for a publisher.
const RETRY_PERIOD: Duration = Duration::from_millis(500);

/// A sample farther from the capture time of a frame than this is not used.
const MAX_DISTANCE_NANOS: u64 = 100_000_000;

/// An angle beyond a turn is in degrees, not in radians.
const MAX_ANGLE_RAD: f32 = std::f32::consts::TAU;

/// Publishes the attitude of the robot's base for a camera. Wakes no reader: the daemon reads it when a frame
/// arrives.
///
/// # Example: an inertial sensor
/// ```
/// use nunet_ipc::{AttitudePublisher, AttitudeReader, CameraName, Clock, monotonic_nanos};
///
/// # let root = tempfile::tempdir()?;
/// # nunet_ipc::use_root(root.path())?;
/// let camera = CameraName::new(&format!("attitude-{}", std::process::id()))?;
/// let mut publisher = AttitudePublisher::create(&camera, Clock::Monotonic)?;
/// let (mut reader, now) = (AttitudeReader::new(&camera), monotonic_nanos());
/// assert!(reader.at(Clock::Monotonic, now, 0).is_err(), "nothing is published yet");
///
/// publisher.publish(now, 0.02, -0.1)?; // roll and pitch, radians
/// let sample = reader.at(Clock::Monotonic, now + 5_000_000, 0)?; // the capture time of a frame
/// assert_eq!((sample.roll_rad, sample.pitch_rad, sample.capture_nanos), (0.02, -0.1, now));
/// assert!(reader.at(Clock::Monotonic, now + 500_000_000, 0).is_err(), "too long ago");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct AttitudePublisher {
    publisher: Publisher,
    record: Box<AttitudeRecord>,
    clock: Clock,
    sequence: u64,
}

impl AttitudePublisher {
    /// Becomes the publisher of the attitude for a camera. `clock`: that of the samples' times.
    ///
    /// # Errors
    /// Those of [`Publisher::create`].
    pub fn create(camera: &CameraName, clock: Clock) -> Result<Self, IpcError> {
        let plan = TopicPlan { topic: Topic::Attitude, payload_bytes: size_of::<AttitudeRecord>() };
        let publisher = Publisher::create(camera, &[plan], &Limits::DEFAULT)?;
        Ok(Self { publisher, record: Box::default(), clock, sequence: 0 })
    }

    /// Publishes a sample: when it was measured, and rotation about x (forward) and y (left), radians (REP
    /// 103).
    ///
    /// # Errors
    /// [`IpcError::CaptureTime`] for a negative time, [`IpcError::Attitude`] for an angle that is not a
    /// number of -2π to 2π, [`IpcError::Iceoryx`].
    pub fn publish(&mut self, capture_nanos: i64, roll_rad: f32, pitch_rad: f32) -> Result<(), IpcError> {
        let sample = AttitudeSample { capture_nanos, roll_rad, pitch_rad };
        check_capture_time(Topic::Attitude, capture_nanos)?;
        check(&sample)?;
        self.record.push(sample);
        let mut loan = self.publisher.loan(Topic::Attitude)?;
        loan.bytes_mut().copy_from_slice(bytemuck::bytes_of(&*self.record));
        let header = loan.header_mut();
        (header.sequence, header.capture_nanos) = (self.sequence, capture_nanos);
        header.set_capture_clock(self.clock);
        header.capture_unix_nanos = header.unix_of_capture(monotonic_nanos(), unix_nanos());
        header.set_encoding(Encoding::AttitudeRecord);
        loan.publish(monotonic_nanos())?;
        self.sequence += 1;
        Ok(())
    }
}

/// Why a frame has no attitude.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NoAttitude {
    /// No process publishes it, or none has sent a sample yet.
    #[error("no process publishes it")]
    NotPublished,
    /// Times of the frame and of the samples cannot be compared.
    #[error("the clock of the frames, `{frame}`, cannot be compared with that of the samples")]
    OtherClock {
        /// The clock of the frame.
        frame: Clock,
    },
    /// No sample is near enough.
    #[error("the nearest sample is {distance_s:.2} s from the capture time, expected at most 0.10 s")]
    TooFar {
        /// Seconds from the capture time.
        distance_s: f64,
    },
    /// A damaged message, or an error of the shared memory.
    #[error(transparent)]
    Ipc(#[from] IpcError),
}

impl Hint for NoAttitude {
    fn hint(&self) -> Option<Cow<'static, str>> {
        let hint = match self {
            Self::NotPublished => "start the program that publishes it, with the name of this camera",
            Self::OtherClock { .. } => "use a source that states when its images were taken",
            Self::TooFar { .. } => {
                "publish it at least 10 times per second, with times of the clock that the publisher states"
            }
            Self::Ipc(error) => return error.hint(),
        };
        Some(hint.into())
    }
}

/// Reads the attitude for a camera, as soon as a process publishes it.
#[derive(Debug)]
pub struct AttitudeReader {
    camera: CameraName,
    reader: Option<Reader>,
    /// The newest record.
    newest: Option<Message>,
    looked: Option<Instant>,
}

impl AttitudeReader {
    /// A reader for a camera. Opens nothing yet.
    #[must_use]
    pub fn new(camera: &CameraName) -> Self {
        Self { camera: camera.clone(), reader: None, newest: None, looked: None }
    }

    /// The sample nearest to the capture time of a frame: nanoseconds of `clock`, and nanoseconds since 1970
    /// (0 if unknown), which count if the publisher uses another clock.
    ///
    /// # Errors
    /// Why there is none within 0.1 s.
    pub fn at(&mut self, clock: Clock, nanos: i64, unix_nanos: i64) -> Result<AttitudeSample, NoAttitude> {
        self.update()?;
        let message = self.newest.as_ref().ok_or(NoAttitude::NotPublished)?;
        let header = message.header();
        let is_same_clock = header.capture_clock() == Ok(clock) && clock != Clock::Media;
        // To the clock of the samples.
        let offset_nanos = if is_same_clock {
            0
        } else if unix_nanos != 0 && header.capture_unix_nanos != 0 {
            let of_samples = header.capture_unix_nanos.saturating_sub(header.capture_nanos);
            unix_nanos.saturating_sub(nanos).saturating_sub(of_samples)
        } else {
            return Err(NoAttitude::OtherClock { frame: clock });
        };
        let time_nanos = nanos.saturating_add(offset_nanos);
        let sample = *message.attitude()?.nearest(time_nanos).ok_or(NoAttitude::NotPublished)?;
        let distance_nanos = sample.capture_nanos.abs_diff(time_nanos);
        if distance_nanos > MAX_DISTANCE_NANOS {
            return Err(NoAttitude::TooFar { distance_s: distance_nanos as f64 / 1e9 });
        }
        check(&sample)?;
        Ok(sample)
    }

    /// Opens the topic if there is one, and takes the newest record.
    fn update(&mut self) -> Result<(), IpcError> {
        if self.reader.is_none() && self.looked.is_none_or(|looked| looked.elapsed() >= RETRY_PERIOD) {
            self.looked = Some(Instant::now());
            self.reader = match Reader::open(&self.camera, &[Topic::Attitude], Duration::ZERO) {
                Ok(reader) => Some(reader),
                Err(IpcError::NobodyPublishes { .. }) => None,
                Err(error) => return Err(error),
            };
        }
        let Some(reader) = &self.reader else { return Ok(()) };
        // Takes the wake-ups of the camera's other topics, so that they do not pile up.
        let newest = reader.wait(Duration::ZERO).and_then(|_| reader.latest(Topic::Attitude));
        if matches!(newest, Err(IpcError::Iceoryx { .. })) {
            // The connection does not recover by itself.
            self.reader = None;
        }
        if let Some(message) = newest? {
            self.newest = Some(message);
        }
        Ok(())
    }
}

/// Refuses angles that are not numbers or beyond a turn.
fn check(sample: &AttitudeSample) -> Result<(), IpcError> {
    for (angle, value) in [("roll", sample.roll_rad), ("pitch", sample.pitch_rad)] {
        // False for NaN.
        let is_angle = value.abs() <= MAX_ANGLE_RAD;
        if !is_angle {
            return Err(IpcError::Attitude { angle, value });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::IpcErrorKind;

    fn camera(name: &str) -> CameraName {
        CameraName::new(&format!("{name}-{}", std::process::id())).unwrap()
    }

    #[test]
    fn the_nearest_sample_is_found_with_any_clock_that_can_be_compared() {
        let camera = camera("attitude-clocks");
        let mut reader = AttitudeReader::new(&camera);
        let (now, unix) = (monotonic_nanos(), unix_nanos());
        let unpublished = reader.at(Clock::Monotonic, now, unix).unwrap_err();
        assert!(matches!(unpublished, NoAttitude::NotPublished), "{unpublished}");

        let mut publisher = AttitudePublisher::create(&camera, Clock::Monotonic).unwrap();
        let mut reader = AttitudeReader::new(&camera);
        assert!(matches!(reader.at(Clock::Monotonic, now, unix), Err(NoAttitude::NotPublished)));
        publisher.publish(now, 0.1, 0.0).unwrap();
        publisher.publish(now + 20_000_000, 0.2, 0.0).unwrap();
        let mut roll = |clock, nanos, unix| reader.at(clock, nanos, unix).map(|sample| sample.roll_rad);
        assert_eq!(roll(Clock::Monotonic, now + 5_000_000, 0).unwrap(), 0.1);
        assert_eq!(roll(Clock::Monotonic, now + 15_000_000, 0).unwrap(), 0.2);
        assert_eq!(roll(Clock::Unix, unix, unix).unwrap(), 0.1);
        assert_eq!(roll(Clock::Unix, unix + 40_000_000, unix + 40_000_000).unwrap(), 0.2);
        assert_eq!(roll(Clock::Media, 7, unix).unwrap(), 0.1, "a recording that is played now");
        assert!(matches!(roll(Clock::Media, now, 0), Err(NoAttitude::OtherClock { .. })));
    }

    /// A publisher that has not published yet, and its reader.
    fn silent(name: &str) -> (AttitudePublisher, AttitudeReader) {
        let camera = camera(name);
        let publisher = AttitudePublisher::create(&camera, Clock::Monotonic).unwrap();
        let mut reader = AttitudeReader::new(&camera);
        assert!(matches!(reader.at(Clock::Monotonic, 0, 0), Err(NoAttitude::NotPublished)));
        (publisher, reader)
    }

    #[test]
    fn a_sample_from_another_time_is_not_used() {
        let (mut publisher, mut reader) = silent("attitude-stale");
        publisher.publish(1_000_000_000, 0.1, 0.0).unwrap();
        for (nanos, is_near) in
            [(1_100_000_000, true), (900_000_000, true), (1_100_000_001, false), (0, false)]
        {
            let found = reader.at(Clock::Monotonic, nanos, 0);
            assert_eq!(found.is_ok(), is_near, "{nanos}: {found:?}");
        }
        let far = reader.at(Clock::Monotonic, i64::MIN, 0).unwrap_err();
        assert!(matches!(far, NoAttitude::TooFar { .. }) && far.hint().is_some(), "{far}");
    }

    #[test]
    fn a_refused_time_does_not_stay_among_the_samples() {
        let (mut publisher, mut reader) = silent("attitude-negative");
        for nanos in [-1, i64::MIN] {
            let error = publisher.publish(nanos, 0.1, 0.0).unwrap_err();
            assert_eq!(error.kind(), IpcErrorKind::Argument, "{error}");
        }
        publisher.publish(MAX_DISTANCE_NANOS as i64, 0.2, 0.0).unwrap();
        assert_eq!(reader.at(Clock::Monotonic, 0, 0).unwrap().roll_rad, 0.2, "the only sample");
    }

    #[test]
    fn degrees_and_nan_are_refused_by_the_publisher_and_by_the_reader() {
        let (mut publisher, mut reader) = silent("attitude-degrees");
        for [roll_rad, pitch_rad] in [[90.0, 0.0], [0.0, f32::NAN], [0.0, f32::INFINITY]] {
            let error = publisher.publish(1, roll_rad, pitch_rad).unwrap_err();
            assert_eq!(error.kind(), IpcErrorKind::Argument, "{error}");
            // As a program without these checks might send it.
            publisher.record.push(AttitudeSample { capture_nanos: 1, roll_rad, pitch_rad });
            publisher.publish(9_000_000_000, 0.0, 0.0).unwrap();
            let error = reader.at(Clock::Monotonic, 1, 0).unwrap_err();
            assert!(matches!(error, NoAttitude::Ipc(IpcError::Attitude { .. })), "{error}");
            assert_eq!(reader.at(Clock::Monotonic, 9_000_000_000, 0).unwrap().roll_rad, 0.0);
        }
    }
}
