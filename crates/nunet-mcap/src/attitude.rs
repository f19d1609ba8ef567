//! The attitude of the robot's base that was used for a frame, as a message of an inertial sensor.

use crate::cdr;
use crate::messages::{Header, Imu};

/// What the first value of a covariance says if the quantity is not measured (`sensor_msgs/msg/Imu`).
const NOT_MEASURED: [f64; 9] = [-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];

/// The topic with the attitude for the images of a topic; `None` if these are not images of this crate's
/// writer.
pub(crate) fn topic_of(image_topic: &str) -> Option<String> {
    let namespace = image_topic.strip_suffix("image_raw/compressed")?;
    Some(format!("{namespace}attitude"))
}

/// The message of roll and pitch, radians, about the fixed axes x and y in this order. The heading is not
/// known, and stated as 0.
pub(crate) fn message(roll_pitch_rad: [f32; 2], header: Header<'_>) -> Imu<'_> {
    let half = |angle_rad: f32| (0.5 * f64::from(angle_rad)).sin_cos();
    let [(sin_roll, cos_roll), (sin_pitch, cos_pitch)] = roll_pitch_rad.map(half);
    Imu {
        header,
        orientation: [
            sin_roll * cos_pitch,
            cos_roll * sin_pitch,
            -sin_roll * sin_pitch,
            cos_roll * cos_pitch,
        ],
        orientation_covariance: [0.0; 9], // unknown
        angular_velocity: [0.0; 3],
        angular_velocity_covariance: NOT_MEASURED,
        linear_acceleration: [0.0; 3],
        linear_acceleration_covariance: NOT_MEASURED,
    }
}

/// The stamp of a message, nanoseconds since 1970, with roll and pitch, radians: exactly those that were
/// written. `None` if it is damaged.
pub(crate) fn read(data: &[u8]) -> Option<(i64, [f32; 2])> {
    let imu: Imu<'_> = cdr::decode(data).ok()?;
    let [x, y, z, w] = imu.orientation;
    let roll_rad = (2.0 * (w * x + y * z)).atan2(1.0 - 2.0 * (x * x + y * y));
    let pitch_rad = (2.0 * (w * y - z * x)).clamp(-1.0, 1.0).asin();
    let is_known = roll_rad.is_finite() && pitch_rad.is_finite();
    is_known.then_some((imu.header.stamp.unix_nanos(), [roll_rad as f32, pitch_rad as f32]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::BASE_FRAME;
    use crate::messages::Time;

    fn encoded(roll_pitch_rad: [f32; 2]) -> Vec<u8> {
        let header = Header { stamp: Time { sec: 3, nanosec: 5 }, frame_id: BASE_FRAME.into() };
        let mut encoded = Vec::new();
        cdr::encode(&message(roll_pitch_rad, header), &mut encoded).unwrap();
        encoded
    }

    #[test]
    fn an_attitude_is_read_exactly_as_it_was_written() {
        for roll in [0.0, 0.3, -1.1, 1e-12, f32::MIN_POSITIVE] {
            for pitch in [0.0, -0.2, 1.2, 0.0017, -3e-20] {
                let read = read(&encoded([roll, pitch])).unwrap();
                assert_eq!(read, (3_000_000_005, [roll, pitch]));
            }
        }
    }

    /// Worked out by hand from the axes: pitch about y, then roll about x.
    #[test]
    fn a_quarter_turn_is_the_quaternion_that_ros_expects() {
        let header = || Header { stamp: Time::default(), frame_id: BASE_FRAME.into() };
        let rounded = |roll_pitch_rad| {
            message(roll_pitch_rad, header()).orientation.map(|value| (value * 1e6).round() / 1e6)
        };
        let quarter = std::f32::consts::FRAC_PI_2;
        let half_root = (std::f64::consts::FRAC_1_SQRT_2 * 1e6).round() / 1e6;
        assert_eq!(rounded([quarter, 0.0]), [half_root, 0.0, 0.0, half_root]);
        assert_eq!(rounded([0.0, quarter]), [0.0, half_root, 0.0, half_root]);
        assert_eq!(rounded([quarter, quarter]), [0.5, 0.5, -0.5, 0.5]);
    }

    #[test]
    fn a_damaged_attitude_is_none() {
        let whole = encoded([0.1, 0.2]);
        assert!((0..whole.len()).all(|length| read(&whole[..length]).is_none()));
        assert_eq!(read(&encoded([f32::NAN, 0.2])), None);
    }

    #[test]
    fn the_topic_is_beside_the_recorded_images() {
        assert_eq!(topic_of("/front/image_raw/compressed").as_deref(), Some("/front/attitude"));
        assert_eq!(topic_of("/front/depth/image_raw"), None);
    }
}
