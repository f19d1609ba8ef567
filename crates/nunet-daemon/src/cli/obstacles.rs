//! The flags of obstacles.

use clap::Args;
use nunet_core::obstacle::{ObstacleError, ObstacleOptions};
use nunet_core::pipeline::PipelineOptions;
use nunet_core::scale::ScaleMode;
use nunet_types::Hint as _;
use serde::Deserialize;
use tracing::warn;

use super::lens::without_mount;
use super::text::{Count, Distance, Seconds, Text, value};
use crate::config::{MountOption, ObstacleConfig};
use crate::exit::BadArguments;

/// What counts as an obstacle.
#[derive(Debug, Args, Clone, Default, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct ObstacleArgs {
    /// The height above ground that the robot can drive over, 0.005 to 0.5 meters; needs --mount [default:
    /// 0.05]
    #[arg(long, value_name = "M")]
    pub clearance: Option<Text<Distance>>,
    /// The height above ground that the robot can drive under, 0.05 to 10 meters and more than --clearance;
    /// needs --mount [default: 1.8]
    #[arg(long, value_name = "M")]
    pub robot_height: Option<Text<Distance>>,
    /// The number of directions in which obstacles are reported, over the field of view, 1 to 360; needs
    /// --mount [default: 72]
    #[arg(long, value_name = "N")]
    pub sectors: Option<Text<Count>>,
    /// The largest number of obstacle points, 1 to 5000; needs --mount [default: 5000]
    #[arg(long, value_name = "N")]
    pub obstacle_points: Option<Text<Count>>,
    /// Remember an obstacle that leaves the image at the bottom for S seconds, 0 to 10; needs --mount; not
    /// for `infer` and `eval`, which find the obstacles of each image alone [default: 0]
    #[arg(long, value_name = "S")]
    pub hold: Option<Text<Seconds>>,
}

/// Obstacles of single images: found only if they are asked for.
#[derive(Debug, Args, Clone, Default)]
pub struct ImageObstacleArgs {
    /// Find obstacles: `infer` writes obstacles.json and images of them, `eval` compares them with those of
    /// the true depth. Needs --mount; `eval` also takes `mounts.csv` in the dataset, with the columns
    /// id,x,y,z,roll,pitch,yaw
    #[arg(long, help_heading = "Obstacles")]
    pub obstacles: bool,
    /// The pose of the camera in the base frame of the robot, meters and radians; z is the height above the
    /// floor
    #[arg(long, value_name = "x,y,z,roll,pitch,yaw", allow_hyphen_values = true, help_heading = "Camera")]
    pub mount: Option<Text<MountOption>>,
    #[command(flatten, next_help_heading = "Obstacles")]
    pub options: ObstacleArgs,
}

impl ImageObstacleArgs {
    /// Whether obstacles are asked for, by their own flag or by one about them.
    pub(super) fn are_wanted(&self) -> bool {
        self.obstacles || self.options != ObstacleArgs::default()
    }

    /// Refuses flags that nothing uses.
    ///
    /// # Errors
    /// Obstacles were to be remembered, or neither obstacles nor the scale need the mount that is given.
    pub(super) fn check_used(&self, pipeline: &PipelineOptions) -> Result<(), BadArguments> {
        if self.options.hold.is_some() {
            let message = "--hold has no effect: `infer` and `eval` find the obstacles of each image alone";
            return Err(BadArguments::new(message).with_hint("remove --hold, or pass it to `run`"));
        }
        let is_used = self.are_wanted() || matches!(pipeline.scale, ScaleMode::Floor(_));
        if is_used || self.mount.is_none() {
            return Ok(());
        }
        let message = "--mount has no effect: it is for obstacles, and for the scale from the floor";
        Err(BadArguments::new(message).with_hint("add --obstacles or --scale floor, or remove --mount"))
    }
}

impl ObstacleArgs {
    /// As checked values; `None` without a mount. `is_required`: they were requested in another way.
    ///
    /// # Errors
    /// Obstacles were requested without a mount, or with an invalid one.
    pub(crate) fn config(
        &self,
        mount: Option<MountOption>,
        max_range_m: Option<f32>,
        is_required: bool,
    ) -> Result<Option<ObstacleConfig>, BadArguments> {
        let is_required = is_required || *self != Self::default();
        let Some(mount) = mount else {
            return if is_required { Err(without_mount("obstacles need")) } else { Ok(None) };
        };
        let made = mount.pose().map_err(ObstacleError::from).and_then(|mount| {
            let options = self.options(max_range_m);
            options.check()?;
            Ok(ObstacleConfig { mount, options, is_required })
        });
        match made {
            Ok(config) => Ok(Some(config)),
            Err(error) if is_required => Err(BadArguments::of(&error)),
            // The pose may be for `/tf_static` alone.
            Err(error) => {
                warn!(hint = error.hint().as_deref(), "obstacles are off: {error}");
                Ok(None)
            }
        }
    }

    /// What counts as an obstacle, unchecked.
    pub(super) fn options(&self, max_range_m: Option<f32>) -> ObstacleOptions {
        let default = ObstacleOptions::default();
        let meters = |flag: &Option<Text<Distance>>| value(flag).map(|Distance(meters)| meters);
        let count = |flag: &Option<Text<Count>>| value(flag).map(|Count(count)| count);
        ObstacleOptions {
            clearance_m: meters(&self.clearance).unwrap_or(default.clearance_m),
            robot_height_m: meters(&self.robot_height).unwrap_or(default.robot_height_m),
            max_range_m: max_range_m.unwrap_or(default.max_range_m),
            sectors: count(&self.sectors).unwrap_or(default.sectors),
            max_points: count(&self.obstacle_points).unwrap_or(default.max_points),
            hold_s: value(&self.hold).map_or(default.hold_s, |Seconds(seconds)| seconds),
            ..default
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MOUNT: MountOption = MountOption { translation_m: [0.1, 0.0, 0.25], roll_pitch_yaw_rad: [0.0; 3] };

    #[test]
    fn obstacles_are_on_with_a_mount_and_asked_for_without_one_an_error() {
        let none = ObstacleArgs::default();
        assert_eq!(none.config(None, None, false).unwrap(), None);
        let config = none.config(Some(MOUNT), None, false).unwrap().unwrap();
        assert_eq!((config.options, config.is_required), (ObstacleOptions::default(), false));
        assert!(
            none.config(None, None, true)
                .unwrap_err()
                .hint()
                .is_some_and(|hint| hint.contains("pass --mount"))
        );
        let hold = ObstacleArgs { hold: Some("0.5".parse().unwrap()), ..ObstacleArgs::default() };
        assert!(hold.config(None, None, false).is_err());
        assert_eq!(hold.config(Some(MOUNT), Some(3.0), false).unwrap().unwrap().options.max_range_m, 3.0);
    }

    #[test]
    fn a_mount_below_the_floor_is_an_error_only_for_obstacles() {
        let below = MountOption { translation_m: [0.0, 0.0, -0.1], ..MOUNT };
        let none = ObstacleArgs::default();
        assert_eq!(none.config(Some(below), None, false).unwrap(), None, "it may be for /tf_static");
        let error = none.config(Some(below), None, true).unwrap_err();
        assert!(error.to_string().contains("above the floor") && error.hint().is_some(), "{error}");
    }
}
