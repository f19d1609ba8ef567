//! Obstacles as stored in shared memory.

use nunet_core::obstacle::{ObstacleOptions, Obstacles};
use nunet_ipc::{CONTRACT_VERSION, ObstacleRecord};
use nunet_mcap::BASE_FRAME;

/// The base without its roll and pitch (REP 120).
const LEVEL_BASE_FRAME: &str = "base_footprint";

/// The coordinate frame of obstacles, which is level. It is the base of a robot that stays level itself. The
/// base of one whose attitude is followed is not level.
#[must_use]
pub fn obstacle_frame(follows_attitude: bool) -> &'static str {
    if follows_attitude { LEVEL_BASE_FRAME } else { BASE_FRAME }
}

/// Fills a record, which still contains an earlier frame.
pub fn fill_record(
    record: &mut ObstacleRecord,
    found: &Obstacles,
    options: &ObstacleOptions,
    used_attitude: bool,
) {
    record.contract_version = CONTRACT_VERSION;
    record.ground_refined = found.ground.is_refined.into();
    record.used_labels = found.used_labels.into();
    record.used_attitude = used_attitude.into();
    (record.angle_min_rad, record.angle_step_rad) = (found.angle_min_rad, found.angle_step_rad);
    record.clearance_m = options.clearance_m;
    record.robot_height_m = options.robot_height_m;
    record.max_range_m = options.max_range_m;
    record.floor_fraction = found.ground.floor_fraction;
    record.ground_slope_x = found.ground.slope_x;
    record.ground_slope_y = found.ground.slope_y;
    record.ground_height_m = found.ground.height_m;
    record.reserved.fill(0);
    record.set_sectors(&found.sectors);
    record.set_points(&found.points);
}
