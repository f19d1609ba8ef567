//! Where the camera is at each frame.

use super::noise::hash;
use super::vector::Vec3;

/// A camera in the room.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pose {
    pub(super) position: Vec3,
    /// The directions of the camera's optical frame, in the room.
    pub(super) right: Vec3,
    pub(super) down: Vec3,
    pub(super) forward: Vec3,
}

/// The pose at a frame: it moves slowly through the free part of the room and turns.
///
/// No sine or cosine, which differ between machines: parabolas swing as smoothly, and tangents of half angles
/// turn.
pub(super) fn pose(seed: u64, frame_index: u64) -> Pose {
    let start = |what: u32| u64::from(hash(seed as u32, what));
    let swing = |period: u64, what: u32| swing(frame_index % period + start(what) % period, period);
    let position =
        Vec3::new(2.45 + 0.55 * swing(600, 1), 0.95 + 0.40 * swing(840, 2), 1.40 + 0.05 * swing(150, 3));
    let (cos_yaw, sin_yaw) = cos_sin(0.17 * swing(720, 4));
    let (cos_pitch, sin_pitch) = cos_sin(-0.075 + 0.02 * swing(330, 5));
    let (cos_roll, sin_roll) = cos_sin(0.012 * swing(270, 6));

    let forward = Vec3::new(sin_yaw * cos_pitch, cos_yaw * cos_pitch, sin_pitch);
    let level_right = Vec3::new(cos_yaw, -sin_yaw, 0.0);
    let level_down = forward.cross(level_right);
    Pose {
        position,
        right: level_right * cos_roll + level_down * sin_roll,
        down: level_down * cos_roll - level_right * sin_roll,
        forward,
    }
}

/// -1 to 1 and back in one period.
fn swing(time: u64, period: u64) -> f32 {
    let t = (time % period) as f32 / period as f32 * 2.0 - 1.0;
    4.0 * t * (1.0 - t.abs())
}

/// Cosine and sine of twice the angle with this tangent.
fn cos_sin(half_angle_tangent: f32) -> (f32, f32) {
    let square = half_angle_tangent * half_angle_tangent;
    ((1.0 - square) / (1.0 + square), 2.0 * half_angle_tangent / (1.0 + square))
}
