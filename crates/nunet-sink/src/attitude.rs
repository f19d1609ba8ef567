//! The mount of each frame on a robot that pitches or rolls, from the attitude of its base in shared memory
//! or in a recording.

use std::borrow::Cow;
use std::f64::consts::FRAC_PI_2;
use std::str::FromStr;
use std::time::Instant;

use nunet_core::camera::Mount;
use nunet_core::pipeline::Pipeline;
use nunet_ipc::{AttitudeReader, CameraName};
use nunet_source::{CaptureTime, Frame};
use nunet_telemetry::RateLimit;
use nunet_types::{Hint as _, counted};
use tracing::{info, warn};

use crate::obstacles::ObstacleStage;

/// A smaller change does not change the mount (0.1 degrees): its tables are computed again each time, and the
/// ground is measured in each frame anyway.
const MIN_CHANGE_RAD: f32 = 0.0017;

/// For an attitude that no robot has that drives.
const WRONG_ATTITUDE_HINT: &str =
    "give roll and pitch of the base, not of the sensor, in radians: both are 0 on a level floor";

/// Where the attitude comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AttitudeSource {
    /// The topic `attitude` of the camera in shared memory.
    SharedMemory,
    /// The recording that the frames come from.
    Recording,
}

impl FromStr for AttitudeSource {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "shm" => Ok(Self::SharedMemory),
            "recording" => Ok(Self::Recording),
            _ => Err(format!("expected `shm` or `recording`, got `{text}`")),
        }
    }
}

/// How the attitude of the robot is followed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AttitudeConfig {
    /// Where it comes from.
    pub source: AttitudeSource,
    /// The pose of the camera on the level robot.
    pub mount: Mount,
}

/// Why an attitude is not known or cannot be used, and a hint.
type Unknown = (String, Option<Cow<'static, str>>);

/// Follows the attitude of a robot's base.
pub struct AttitudeStage {
    level: Mount,
    /// `None` if frames come with their attitude.
    reader: Option<AttitudeReader>,
    /// Roll and pitch of the mount in use, radians.
    in_use: [f32; 2],
    is_known: bool,
    frames: u64,
    frames_without: u64,
    warned: RateLimit,
}

impl AttitudeStage {
    /// For the frames of a camera. Opens nothing yet.
    #[must_use]
    pub fn new(camera: &CameraName, config: AttitudeConfig) -> Self {
        let is_read = config.source == AttitudeSource::SharedMemory;
        Self {
            level: config.mount,
            reader: is_read.then(|| AttitudeReader::new(camera)),
            in_use: [0.0; 2],
            is_known: false,
            frames: 0,
            frames_without: 0,
            warned: RateLimit::default(),
        }
    }

    /// Turns the mount of a frame's camera by the attitude at its capture time. Without one, the mount is
    /// that of the level robot, with a warning.
    pub fn follow(&mut self, frame: &Frame, pipeline: &mut Pipeline, obstacles: Option<&mut ObstacleStage>) {
        if let Some(mount) = self.new_mount(frame) {
            pipeline.set_mount(mount);
            obstacles.into_iter().for_each(|stage| stage.set_mount(mount));
        }
    }

    /// Roll and pitch of the mount of the last frame, radians; `None` if its attitude is not known.
    #[must_use]
    pub fn roll_pitch_rad(&self) -> Option<[f32; 2]> {
        self.is_known.then_some(self.in_use)
    }

    /// Whether the last frame had an attitude.
    #[must_use]
    pub fn is_known(&self) -> bool {
        self.is_known
    }

    /// Whether any frame had one.
    #[must_use]
    pub fn had_any(&self) -> bool {
        self.frames > self.frames_without
    }

    /// The number of frames that had none.
    #[must_use]
    pub fn frames_without(&self) -> u64 {
        self.frames_without
    }

    /// Roll and pitch at the capture time of a frame, radians.
    fn attitude_of(&mut self, frame: &Frame) -> Result<[f32; 2], Unknown> {
        let Some(reader) = &mut self.reader else {
            return frame.roll_pitch_rad.ok_or_else(|| ("the recording states none".to_owned(), None));
        };
        let CaptureTime { nanos, clock, unix_nanos } = frame.capture;
        let sample =
            reader.at(clock, nanos, unix_nanos).map_err(|error| (error.to_string(), error.hint()))?;
        Ok([sample.roll_rad, sample.pitch_rad])
    }

    /// The mount on a robot with this attitude. One beyond a quarter turn is in degrees, or that of a sensor
    /// that is upside down on the robot.
    fn tilted(&self, attitude: [f32; 2]) -> Result<Mount, Unknown> {
        let [roll_rad, pitch_rad] = attitude.map(f64::from);
        let wrong = |why: String| {
            let text = format!("roll {roll_rad:.2}, pitch {pitch_rad:.2} rad {why}");
            (text, Some(Cow::Borrowed(WRONG_ATTITUDE_HINT)))
        };
        if roll_rad.abs().max(pitch_rad.abs()) > FRAC_PI_2 {
            return Err(wrong("is more than a quarter turn (1.57)".to_owned()));
        }
        let mount = self.level.on_tilted_base(roll_rad, pitch_rad);
        mount.map_err(|error| wrong(format!("is impossible with this mount ({error})")))
    }

    /// The mount of a frame; `None` if it is that of the frame before.
    fn new_mount(&mut self, frame: &Frame) -> Option<Mount> {
        let tilted = self.attitude_of(frame).and_then(|attitude| Ok((attitude, self.tilted(attitude)?)));
        self.frames += 1;
        self.is_known = tilted.is_ok();
        let (attitude, mount) = tilted.unwrap_or_else(|(reason, hint)| {
            self.frames_without += 1;
            self.warn(&reason, hint.as_deref());
            ([0.0; 2], self.level)
        });
        if self.is_known && self.frames - self.frames_without == 1 {
            info!("the robot's attitude is received: roll {:.3}, pitch {:.3} rad", attitude[0], attitude[1]);
        }
        let change = [0, 1].map(|angle| (attitude[angle] - self.in_use[angle]).abs());
        // A recorded attitude was in use, so the mount follows it exactly.
        let min_change = if self.is_known && self.reader.is_none() { 0.0 } else { MIN_CHANGE_RAD };
        let is_new = change[0].max(change[1]) > min_change;
        if is_new {
            self.in_use = attitude;
        }
        is_new.then_some(mount)
    }

    fn warn(&mut self, reason: &str, hint: Option<&str>) {
        if let Some(text) = self.warning(reason, hint, Instant::now()) {
            warn!(hint, "{text}");
        }
    }

    /// The warning, unless the last one was of this reason and less than 10 s ago. The hint stands for the
    /// reason: it has no counts and no angles.
    fn warning(&mut self, reason: &str, hint: Option<&str>, now: Instant) -> Option<String> {
        let suppressed = self.warned.allow_text(now, hint.unwrap_or(reason))?;
        let Self { frames, frames_without, .. } = self;
        let frames = counted(*frames, "frame");
        Some(format!(
            "the robot counts as level in {frames_without} of {frames}, because its attitude is unknown: \
             {reason}{suppressed}"
        ))
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use nunet_ipc::{AttitudePublisher, Clock};

    use super::*;

    fn capture(nanos: i64) -> Frame {
        let capture = CaptureTime { nanos, clock: Clock::Monotonic, unix_nanos: 0 };
        Frame { capture, ..Frame::default() }
    }

    #[test]
    fn the_mount_follows_the_attitude_and_without_one_the_robot_counts_as_level() {
        // The default folder may belong to another user.
        let folder = tempfile::tempdir().unwrap();
        nunet_ipc::use_root(folder.path()).unwrap();
        let camera = CameraName::new(&format!("attitude-stage-{}", std::process::id())).unwrap();
        let level = Mount::new([0.2, 0.0, 0.5], [0.0, 0.1, 0.0]).unwrap();
        let config = AttitudeConfig { source: "shm".parse().unwrap(), mount: level };
        let mut publisher = AttitudePublisher::create(&camera, Clock::Monotonic).unwrap();
        let mut stage = AttitudeStage::new(&camera, config);
        assert_eq!((stage.new_mount(&capture(0)), stage.is_known()), (None, false));

        const MS: i64 = 1_000_000;
        for (nanos, pitch) in [(0, 0.0), (200 * MS, -0.2), (400 * MS, -0.2005), (600 * MS, 1.6)] {
            publisher.publish(nanos, 0.0, pitch).unwrap();
        }
        assert_eq!((stage.new_mount(&capture(MS)), stage.is_known()), (None, true), "level");
        let tilted = level.on_tilted_base(0.0, (-0.2_f32).into()).unwrap();
        assert_eq!(stage.new_mount(&capture(190 * MS)), Some(tilted));
        assert_eq!(stage.new_mount(&capture(410 * MS)), None, "nearly the same");
        assert_eq!((stage.new_mount(&capture(900 * MS)), stage.is_known()), (Some(level), false), "stale");
        assert_eq!((stage.new_mount(&capture(600 * MS)), stage.frames_without()), (None, 3), "on its nose");
        assert_eq!(stage.new_mount(&capture(200 * MS)), Some(tilted));
    }

    fn replayed_on(level: Mount) -> AttitudeStage {
        let config = AttitudeConfig { source: AttitudeSource::Recording, mount: level };
        AttitudeStage::new(&CameraName::new("replay").unwrap(), config)
    }

    #[test]
    fn an_attitude_in_degrees_or_of_a_sensor_upside_down_is_refused_by_its_numbers() {
        let stage = replayed_on(Mount::new([0.0, 0.0, 0.25], [0.0; 3]).unwrap());
        for ([roll, pitch], text) in [
            ([2.0, -3.0], "roll 2.00, pitch -3.00 rad is more than a quarter turn (1.57)"),
            ([std::f32::consts::PI, 0.0], "roll 3.14, pitch 0.00 rad is more than a quarter turn (1.57)"),
        ] {
            let hint = Some(Cow::Borrowed(WRONG_ATTITUDE_HINT));
            assert_eq!(stage.tilted([roll, pitch]), Err((text.to_owned(), hint)));
        }
        let stage = replayed_on(Mount::new([0.5, 0.0, 0.25], [0.0; 3]).unwrap());
        let (text, _) = stage.tilted([0.0, 1.0]).unwrap_err();
        let impossible =
            "roll 0.00, pitch 1.00 rad is impossible with this mount (mount: the camera is -0.28";
        assert!(text.starts_with(impossible), "{text}");
        assert!(stage.tilted([0.5, -0.5]).is_ok());
    }

    #[test]
    fn a_reason_is_logged_once_per_10_seconds_whatever_its_counts_and_angles() {
        let mut stage = replayed_on(Mount::new([0.0, 0.0, 0.25], [0.0; 3]).unwrap());
        let start = Instant::now();
        (stage.frames, stage.frames_without) = (1, 1);
        let first = "the robot counts as level in 1 of 1 frame, because its attitude is unknown: none";
        assert_eq!(stage.warning("none", None, start).as_deref(), Some(first));
        (stage.frames, stage.frames_without) = (2, 2);
        assert_eq!(stage.warning("none", None, start), None);
        let hint = Some(WRONG_ATTITUDE_HINT);
        let other = stage.warning("roll 2.00", hint, start).unwrap();
        assert!(other.contains("in 2 of 2 frames") && other.contains("roll 2.00 (1 similar"), "{other}");
        assert_eq!(stage.warning("roll -2.00", hint, start + Duration::from_secs(9)), None);
        assert!(stage.warning("roll -2.00", hint, start + Duration::from_secs(10)).is_some());
    }

    #[test]
    fn another_source_is_refused_by_name() {
        let error = "imu".parse::<AttitudeSource>().unwrap_err();
        assert_eq!(error, "expected `shm` or `recording`, got `imu`");
    }

    #[test]
    fn a_replay_has_the_mounts_of_the_recorded_frames() {
        let camera = CameraName::new("replay").unwrap();
        let level = Mount::new([0.2, 0.0, 0.5], [0.0, 0.1, 0.0]).unwrap();
        let config = AttitudeConfig { source: "recording".parse().unwrap(), mount: level };
        let mut stage = AttitudeStage::new(&camera, config);
        let mut mount_of = |roll_pitch_rad| {
            let mount = stage.new_mount(&Frame { roll_pitch_rad, ..Frame::default() });
            (mount, stage.roll_pitch_rad())
        };
        let tilted = |pitch: f32| level.on_tilted_base(0.0, pitch.into()).unwrap();
        assert_eq!(mount_of(None), (None, None));
        for pitch in [0.3, 0.3001, 0.2] {
            let recorded = Some([0.0, pitch]);
            assert_eq!(mount_of(recorded), (Some(tilted(pitch)), recorded), "also after a small change");
            assert_eq!(mount_of(recorded), (None, recorded));
        }
        assert_eq!(mount_of(None), (Some(level), None), "not recorded");
        assert_eq!(mount_of(Some([f32::NAN, 0.0])), (None, None));
    }
}
