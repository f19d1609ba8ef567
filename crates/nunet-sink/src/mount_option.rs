//! The pose of a camera on the robot, as six numbers.

use std::f64::consts::{FRAC_PI_2, PI};
use std::str::FromStr;

use nunet_core::camera::{Mount, MountError, check_pose};
use nunet_mcap::CameraMount;
use nunet_types::text_with_hint;
use tracing::warn;

/// Angles are often written with few digits: 3.15 for half a turn.
const ROUNDING_RAD: f64 = 0.01;

/// The camera on the robot, as a user writes it: `x,y,z,roll,pitch,yaw` in `base_link` (x forward, y left, z
/// up).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MountOption {
    /// Meters.
    pub translation_m: [f64; 3],
    /// Radians.
    pub roll_pitch_yaw_rad: [f64; 3],
}

impl MountOption {
    /// The pose.
    ///
    /// # Errors
    /// No camera can be there.
    pub fn pose(self) -> Result<Mount, MountError> {
        Mount::new(self.translation_m, self.roll_pitch_yaw_rad)
    }

    /// Warns of an angle that is possible, but probably in degrees.
    pub fn warn_of_degrees(&self) {
        if let Some((name, angle, most)) = self.unusual_angle() {
            let hint = "if the angles are in degrees, convert them to radians: 90 degrees are 1.571";
            warn!(
                hint,
                "mount: {name} is {angle} rad, but -{most:.2} to {most:.2} describes every direction"
            );
        }
    }

    /// The first angle beyond those that every rotation can be written with, and their limit. A few degrees
    /// that are taken as radians are often beyond; larger ones are refused.
    fn unusual_angle(&self) -> Option<(&'static str, f64, f64)> {
        let [roll, pitch, yaw] = self.roll_pitch_yaw_rad;
        let named = [("roll", roll, PI), ("pitch", pitch, FRAC_PI_2), ("yaw", yaw, PI)];
        named.into_iter().find(|(_, angle, most)| angle.abs() > most + ROUNDING_RAD)
    }
}

impl From<MountOption> for CameraMount {
    fn from(MountOption { translation_m, roll_pitch_yaw_rad }: MountOption) -> Self {
        Self { translation_m, roll_pitch_yaw_rad }
    }
}

impl FromStr for MountOption {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse::<f64>()).collect();
        match numbers.as_deref() {
            Ok(&[x, y, z, roll, pitch, yaw])
                if [x, y, z, roll, pitch, yaw].iter().all(|number| number.is_finite()) =>
            {
                let (translation_m, roll_pitch_yaw_rad) = ([x, y, z], [roll, pitch, yaw]);
                check_pose(translation_m, roll_pitch_yaw_rad).map_err(|error| text_with_hint(&error))?;
                Ok(Self { translation_m, roll_pitch_yaw_rad })
            }
            _ => Err("expected six numbers `x,y,z,roll,pitch,yaw`: meters, then radians".to_owned()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mount_is_six_finite_numbers() {
        let mount: MountOption = "1, 2,3,0,-0.5,0.25".parse().unwrap();
        assert_eq!((mount.translation_m, mount.roll_pitch_yaw_rad), ([1.0, 2.0, 3.0], [0.0, -0.5, 0.25]));
        for wrong in ["", "1,2,3", "1,2,3,4,5,6,7", "1,2,3,4,5,nan", "1,2,3,4,5,x"] {
            assert!(wrong.parse::<MountOption>().unwrap_err().starts_with("expected six numbers"), "{wrong}");
        }
        let degrees = "0,0,0.3,0,15,90".parse::<MountOption>().unwrap_err();
        assert!(degrees.contains("pitch is 15") && degrees.contains("radians"), "{degrees}");
        let far = "0,0,-1e300,0,0,0".parse::<MountOption>().unwrap_err();
        assert!(far.contains("1e300 m from the base") && far.len() < 200, "{far}");
    }

    #[test]
    fn an_angle_that_no_rotation_needs_is_unusual() {
        let name = |text: &str| text.parse::<MountOption>().unwrap().unusual_angle().map(|(name, ..)| name);
        for usual in ["0,0,1,0,0,0", "0,0,1,3.15,1.57,-3.1416", "0,0,1,-3.14,-1.571,3.142", "0,0,1,1,1,1"] {
            assert_eq!(name(usual), None, "{usual}");
        }
        let degrees = [("0,0,1,4,0,0", "roll"), ("0,0,1,0,2,0", "pitch"), ("0,0,1,0,-5,0", "pitch")];
        for (text, unusual) in degrees.into_iter().chain([("0,0,1,0,0,6", "yaw"), ("0,0,1,0,0,-4", "yaw")]) {
            assert_eq!(name(text), Some(unusual), "{text}");
        }
    }
}
