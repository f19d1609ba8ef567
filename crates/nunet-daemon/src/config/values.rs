//! Values that the user writes as a word or as numbers.

use std::str::FromStr;

use serde::Deserialize;

/// A topic that `--publish` names.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Publish {
    /// The depth map; always published.
    Depth,
    /// Class indices.
    Labels,
    /// The confidence of depth, if the model has one.
    Confidence,
    /// The organized point cloud.
    Cloud,
    /// Obstacles around the robot; needs the camera's mount.
    Obstacles,
}

impl Publish {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Depth, Self::Labels, Self::Confidence, Self::Cloud, Self::Obstacles];

    /// Those that are published by default.
    pub const DEFAULT: [Self; 4] = [Self::Depth, Self::Labels, Self::Confidence, Self::Cloud];

    /// As the user writes it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Depth => "depth",
            Self::Labels => "labels",
            Self::Confidence => "confidence",
            Self::Cloud => "cloud",
            Self::Obstacles => "obstacles",
        }
    }
}

/// The camera on the robot: `x,y,z,roll,pitch,yaw` in `base_link` (x forward, y left, z up).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MountOption {
    /// Meters.
    pub translation_m: [f64; 3],
    /// Radians.
    pub roll_pitch_yaw_rad: [f64; 3],
}

impl FromStr for MountOption {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse::<f64>()).collect();
        match numbers.as_deref() {
            Ok(&[x, y, z, roll, pitch, yaw])
                if [x, y, z, roll, pitch, yaw].iter().all(|number| number.is_finite()) =>
            {
                let roll_pitch_yaw_rad = [roll, pitch, yaw];
                nunet_core::obstacle::check_angles(roll_pitch_yaw_rad)
                    .map_err(|error| nunet_types::text_with_hint(&error))?;
                Ok(Self { translation_m: [x, y, z], roll_pitch_yaw_rad })
            }
            _ => Err("expected six numbers `x,y,z,roll,pitch,yaw`: meters, then radians".to_owned()),
        }
    }
}

/// How log lines are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LogOptions {
    /// 0: info, 1: debug, 2 and more: trace with a span per frame.
    pub verbose: u8,
    /// Errors only.
    pub quiet: bool,
    /// One JSON object per line.
    pub json: bool,
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
    }
}
