//! The pose of a camera on the robot, as six numbers.

use std::str::FromStr;

use nunet_core::camera::{Mount, MountDoubt, MountError, check_pose};
use nunet_mcap::CameraMount;
use nunet_types::{Hint as _, text_with_hint};
use tracing::warn;

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

    /// Warns of angles that are possible, but probably a mistake: degrees, or those of the optical frame.
    pub fn warn_of_mistakes(&self) {
        if let Some(doubt) = MountDoubt::of(self.roll_pitch_yaw_rad) {
            warn!(hint = doubt.hint().as_deref(), "{doubt}");
        }
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
        let name = |text: &str| {
            let mount: MountOption = text.parse().unwrap();
            match MountDoubt::of(mount.roll_pitch_yaw_rad) {
                Some(MountDoubt::Degrees { what, .. }) => Some(what),
                Some(doubt) => panic!("{text}: {doubt}"),
                None => None,
            }
        };
        for usual in ["0,0,1,0,0,0", "0,0,1,3.15,1.57,-3.1416", "0,0,1,-3.14,-1.571,3.142", "0,0,1,1,1,1"] {
            assert_eq!(name(usual), None, "{usual}");
        }
        let degrees = [("0,0,1,4,0,0", "roll"), ("0,0,1,0,2,0", "pitch"), ("0,0,1,0,-5,0", "pitch")];
        for (text, unusual) in degrees.into_iter().chain([("0,0,1,0,0,6", "yaw"), ("0,0,1,0,0,-4", "yaw")]) {
            assert_eq!(name(text), Some(unusual), "{text}");
        }
    }
}
