//! A speed that stops the robot before the nearest obstacle ahead, as reported by a running `nunetd`:
//! `nunetd --source /dev/video0 --camera front --mount 0.1,0,0.25,0,-0.07,0`, then
//! `cargo run -p nunet-ipc --example stop_before_wall front`.

#![allow(clippy::print_stdout, reason = "an example prints its answer")]

use std::time::{Duration, Instant};

use nunet_ipc::{CameraName, ObstacleRecord, Reader, Topic};

/// Full speed, meters per second, and how far before an obstacle the robot stops, meters.
const FULL_SPEED: f32 = 0.6;
const STOP_M: f32 = 0.4;
/// Meters over which it brakes.
const BRAKE_M: f32 = 1.0;
/// Half the angle ahead that counts, radians.
const AHEAD_RAD: f32 = 0.35;
/// The robot stops if no frame arrives for so long.
const TIMEOUT: Duration = Duration::from_millis(500);

/// The speed for the directions ahead. Each direction counts only as far as it is known to be free.
pub(crate) fn speed(obstacles: &ObstacleRecord) -> f32 {
    let angle = |index: usize| obstacles.angle_min_rad + (index as f32 + 0.5) * obstacles.angle_step_rad;
    let ahead = obstacles.sectors().iter().enumerate().filter(|(index, _)| angle(*index).abs() < AHEAD_RAD);
    let free_m = ahead.map(|(_, sector)| sector.range_m).reduce(f32::min).unwrap_or(0.0);
    FULL_SPEED * ((free_m - STOP_M) / BRAKE_M).clamp(0.0, 1.0)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let name = std::env::args().nth(1).unwrap_or_else(|| "camera".to_owned());
    let reader = Reader::open(&CameraName::new(&name)?, &[Topic::Obstacles], Duration::from_secs(10))?;
    let mut last = Instant::now();
    loop {
        // May return early, because other topics wake it too.
        reader.wait(TIMEOUT)?;
        if let Some(frame) = reader.latest(Topic::Obstacles)? {
            println!("{:.2} m/s", speed(frame.obstacles()?));
            last = Instant::now();
        } else if last.elapsed() >= TIMEOUT {
            println!("0.00 m/s: no frame for {} s", TIMEOUT.as_secs_f32());
        }
    }
}
