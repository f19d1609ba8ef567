//! The mount of each frame on a robot that pitches or rolls, from the attitude of its base in shared memory.

use std::str::FromStr;
use std::time::Instant;

use nunet_core::obstacle::Mount;
use nunet_core::pipeline::Pipeline;
use nunet_ipc::{AttitudeReader, CameraName};
use nunet_source::CaptureTime;
use nunet_telemetry::RateLimit;
use nunet_types::Hint as _;
use tracing::{info, warn};

use crate::obstacles::ObstacleStage;

/// A smaller change does not change the mount (0.1 degrees): its tables are computed again each time, and the ground is
/// measured in each frame anyway.
const MIN_CHANGE_RAD: f32 = 0.0017;

/// Where the attitude comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AttitudeSource {
    /// The topic `attitude` of the camera in shared memory.
    SharedMemory,
}

impl FromStr for AttitudeSource {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "shm" { Ok(Self::SharedMemory) } else { Err(format!("expected `shm`, got `{text}`")) }
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

/// Follows the attitude of a robot's base.
pub struct AttitudeStage {
    level: Mount,
    reader: AttitudeReader,
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
        let AttitudeConfig { source: AttitudeSource::SharedMemory, mount } = config;
        Self {
            level: mount,
            reader: AttitudeReader::new(camera),
            in_use: [0.0; 2],
            is_known: false,
            frames: 0,
            frames_without: 0,
            warned: RateLimit::default(),
        }
    }

    /// Turns the mount of a frame's camera by the attitude at its capture time. Without one, the mount is that of the level
    /// robot, with a warning.
    pub fn follow(
        &mut self,
        capture: &CaptureTime,
        pipeline: &mut Pipeline,
        obstacles: Option<&mut ObstacleStage>,
    ) {
        if let Some(mount) = self.new_mount(capture) {
            pipeline.set_mount(mount);
            obstacles.into_iter().for_each(|stage| stage.set_mount(mount));
        }
    }

    /// Whether the last frame had an attitude.
    #[must_use]
    pub fn is_known(&self) -> bool {
        self.is_known
    }

    /// The number of frames that had none.
    #[must_use]
    pub fn frames_without(&self) -> u64 {
        self.frames_without
    }

    /// The mount of a frame; `None` if it is that of the frame before.
    fn new_mount(&mut self, capture: &CaptureTime) -> Option<Mount> {
        let found = self.reader.at(capture.clock, capture.nanos, capture.unix_nanos);
        let tilted = found.map_err(|error| (error.to_string(), error.hint())).and_then(|sample| {
            let mount = self.level.on_tilted_base(sample.roll_rad.into(), sample.pitch_rad.into());
            let mount = mount.map_err(|error| (error.to_string(), error.hint()))?;
            Ok(([sample.roll_rad, sample.pitch_rad], mount))
        });
        self.frames += 1;
        self.is_known = tilted.is_ok();
        let (attitude, mount) = tilted.unwrap_or_else(|(reason, hint)| {
            self.frames_without += 1;
            self.warn(&reason, &hint.unwrap_or_default());
            ([0.0; 2], self.level)
        });
        if self.is_known && self.frames - self.frames_without == 1 {
            info!("the robot's attitude is received: roll {:.3}, pitch {:.3} rad", attitude[0], attitude[1]);
        }
        let change = [0, 1].map(|angle| (attitude[angle] - self.in_use[angle]).abs());
        let is_new = change[0].max(change[1]) > MIN_CHANGE_RAD;
        if is_new {
            self.in_use = attitude;
        }
        is_new.then_some(mount)
    }

    fn warn(&mut self, reason: &str, hint: &str) {
        let Self { frames, frames_without, .. } = self;
        let text = format!(
            "the robot counts as level in {frames_without} of {frames} frames, because its attitude is unknown: {reason}"
        );
        if let Some(suppressed) = self.warned.allow_text(Instant::now(), &text) {
            warn!(hint, "{text}{suppressed}");
        }
    }
}

#[cfg(test)]
mod tests {
    use nunet_ipc::{AttitudePublisher, Clock};

    use super::*;

    fn capture(nanos: i64) -> CaptureTime {
        CaptureTime { nanos, clock: Clock::Monotonic, unix_nanos: 0 }
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

    #[test]
    fn another_source_is_refused_by_name() {
        let error = "imu".parse::<AttitudeSource>().unwrap_err();
        assert_eq!(error, "expected `shm`, got `imu`");
    }
}
