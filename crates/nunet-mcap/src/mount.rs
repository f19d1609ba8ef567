//! The pose of a camera on the robot, as a transform of ROS.

use crate::messages::{Header, TransformStamped};

/// The coordinate frame of the robot's base (REP 105).
pub const BASE_FRAME: &str = "base_link";

/// A camera's pose on the robot: the body frame (x forward, y left, z up) of the camera in the robot's
/// `base_link`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraMount {
    /// Meters.
    pub translation_m: [f64; 3],
    /// Radians about the fixed axes x, y and z, in this order.
    pub roll_pitch_yaw_rad: [f64; 3],
}

impl CameraMount {
    /// From the robot's base to the camera's optical frame (REP 103: x right, y down, z forward).
    pub(crate) fn transform<'a>(&self, header: &Header<'a>) -> TransformStamped<'a> {
        let [roll, pitch, yaw] = self.roll_pitch_yaw_rad;
        let about = |axis: [f64; 3], angle: f64| {
            let (sin, cos) = (angle / 2.0).sin_cos();
            [axis[0] * sin, axis[1] * sin, axis[2] * sin, cos]
        };
        let body = product(
            product(about([0.0, 0.0, 1.0], yaw), about([0.0, 1.0, 0.0], pitch)),
            about([1.0, 0.0, 0.0], roll),
        );
        const OPTICAL_IN_BODY: [f64; 4] = [-0.5, 0.5, -0.5, 0.5];
        TransformStamped {
            header: Header { stamp: header.stamp, frame_id: BASE_FRAME.into() },
            child_frame_id: header.frame_id.clone(),
            translation: self.translation_m,
            rotation: product(body, OPTICAL_IN_BODY),
        }
    }
}

/// The rotation `b` followed by `a`; quaternions x, y, z, w.
fn product(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    let ([ax, ay, az, aw], [bx, by, bz, bw]) = (a, b);
    [
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::Time;

    fn rotated(by: [f64; 4], [x, y, z]: [f64; 3]) -> [f64; 3] {
        let [qx, qy, qz, qw] = by;
        let [x, y, z, _] = product(product(by, [x, y, z, 0.0]), [-qx, -qy, -qz, qw]);
        [x, y, z].map(|value| (value * 1e9).round() / 1e9)
    }

    fn forward(roll_pitch_yaw_rad: [f64; 3]) -> [f64; 3] {
        let mount = CameraMount { translation_m: [0.0; 3], roll_pitch_yaw_rad };
        let header = Header { stamp: Time::default(), frame_id: "eye".into() };
        rotated(mount.transform(&header).rotation, [0.0, 0.0, 1.0])
    }

    #[test]
    fn a_camera_without_rotation_looks_forward_and_its_rows_run_to_the_right() {
        assert_eq!(forward([0.0; 3]), [1.0, 0.0, 0.0]);
        let mount = CameraMount { translation_m: [0.0; 3], roll_pitch_yaw_rad: [0.0; 3] };
        let header = Header { stamp: Time::default(), frame_id: "eye".into() };
        let rotation = mount.transform(&header).rotation;
        assert_eq!(rotated(rotation, [1.0, 0.0, 0.0]), [0.0, -1.0, 0.0], "right is -y of the body");
        assert_eq!(rotated(rotation, [0.0, 1.0, 0.0]), [0.0, 0.0, -1.0], "down is -z");
    }

    #[test]
    fn yaw_turns_left_and_pitch_looks_down() {
        let quarter = std::f64::consts::FRAC_PI_2;
        assert_eq!(forward([0.0, 0.0, quarter]), [0.0, 1.0, 0.0]);
        assert_eq!(forward([0.0, quarter, 0.0]), [0.0, 0.0, -1.0]);
        assert_eq!(forward([0.0, quarter, quarter]), [0.0, 0.0, -1.0], "pitch comes before yaw");
    }
}
