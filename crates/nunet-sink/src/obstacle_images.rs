//! Obstacles of one frame, as files.

use std::path::Path;

use anyhow::Context as _;
use image::RgbImage;
use nunet_core::camera::Camera;
use nunet_core::obstacle::Obstacles;
use nunet_core::pipeline::Pipeline;
use nunet_files::{BirdsEye, draw_obstacle_points, write_json, write_rgb};
use nunet_ipc::CONTRACT_VERSION;
use nunet_types::shortest;
use serde_json::{Value, json};

use crate::obstacles::ObstacleConfig;

/// The data that the images are drawn from.
pub struct ObstacleView<'a> {
    /// The obstacles.
    pub found: &'a Obstacles,
    /// The settings of their detection.
    pub config: &'a ObstacleConfig,
    /// The pipeline that computed depth.
    pub pipeline: &'a Pipeline,
    /// The network's image, RGB.
    pub rgb: &'a [u8],
}

impl ObstacleView<'_> {
    /// Writes the files of [`write_obstacles`] and `obstacles_overlay.png` (on the image).
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn write(&self, folder: &Path) -> anyhow::Result<()> {
        write_obstacles(self.found, folder)?;
        Ok(write_rgb(&folder.join("obstacles_overlay.png"), self.overlay()?)?)
    }

    /// The network's image with the points of obstacles.
    fn overlay(&self) -> anyhow::Result<RgbImage> {
        let size = self.pipeline.graph().size();
        let image = RgbImage::from_raw(size.width, size.height, self.rgb.to_vec());
        let mut image = image.context("the network's image has another size than the network")?;
        let camera: &Camera = self.pipeline.points_camera();
        let factor = f64::from(self.pipeline.decimation().get());
        let points = self.found.points.iter().filter_map(|point| {
            let optical = self.config.mount.to_optical([point.x, point.y, point.z].map(f64::from));
            let pixel = camera.project(optical)?.map(|pixel| factor * pixel);
            Some((pixel, point.x.hypot(point.y)))
        });
        draw_obstacle_points(&mut image, points, self.found.max_range_m);
        Ok(image)
    }
}

/// The names of the files of obstacles.
pub const OBSTACLE_FILES: [&str; 3] = ["obstacles.json", "obstacles.png", "obstacles_overlay.png"];

/// Writes `obstacles.json` and `obstacles.png` (from above) into `folder`, which exists.
///
/// # Errors
/// A file cannot be written.
pub fn write_obstacles(found: &Obstacles, folder: &Path) -> anyhow::Result<()> {
    write_json(&folder.join("obstacles.json"), &obstacles_json(found))?;
    Ok(write_rgb(&folder.join("obstacles.png"), BirdsEye(found.map()).draw())?)
}

/// JSON has no NaN; it becomes `null`.
fn obstacles_json(found: &Obstacles) -> Value {
    let map = found.map();
    let sectors = found.sectors.iter().enumerate().map(|(index, sector)| {
        json!({
            "angle_rad": shortest(map.angle_rad(index)),
            "state": sector.state().name(),
            "range_m": shortest(sector.range_m),
            "obstacle_m": shortest(sector.obstacle_m),
            "min_height_m": shortest(sector.min_height_m),
            "max_height_m": shortest(sector.max_height_m),
            "seen_from_m": shortest(sector.seen_from_m),
            "label": sector.label,
            "remembered": sector.remembered != 0,
            "age_s": shortest(sector.age_s),
        })
    });
    let ground = found.ground;
    json!({
        "contract": CONTRACT_VERSION,
        "ground": {
            "slope_x": shortest(ground.slope_x),
            "slope_y": shortest(ground.slope_y),
            "height_m": shortest(ground.height_m),
            "refined": ground.is_refined,
            "floor_fraction": shortest(ground.floor_fraction),
        },
        "used_labels": found.used_labels,
        "max_range_m": shortest(found.max_range_m),
        "angle_min_rad": shortest(found.angle_min_rad),
        "angle_step_rad": shortest(found.angle_step_rad),
        "sectors": sectors.collect::<Vec<_>>(),
        "points": found.points.len(),
    })
}

#[cfg(test)]
mod tests {
    use nunet_core::obstacle::{Ground, ObstacleSector, SectorState};

    use super::*;

    fn found(sectors: Vec<ObstacleSector>) -> Obstacles {
        Obstacles {
            ground: Ground::EXPECTED,
            sectors,
            points: Vec::new(),
            angle_min_rad: -0.5,
            angle_step_rad: 0.5,
            max_range_m: 4.0,
            used_labels: false,
        }
    }

    #[test]
    fn the_range_of_free_sectors_and_their_sides_are_stated() {
        let found = found(vec![ObstacleSector::UNKNOWN; 2]);
        let json = obstacles_json(&found);
        let of = |name: &str| json[name].as_f64().unwrap();
        assert_eq!((of("max_range_m"), of("angle_min_rad"), of("angle_step_rad")), (4.0, -0.5, 0.5));
        // Of the middle of a sector.
        assert_eq!(json["sectors"][0]["angle_rad"], json!(-0.25));
    }

    #[test]
    fn a_remembered_obstacle_differs_from_one_that_is_seen() {
        let seen =
            ObstacleSector { state: SectorState::Occupied.into(), range_m: 1.2, ..ObstacleSector::UNKNOWN };
        let remembered = ObstacleSector { remembered: 1, age_s: 0.5, ..seen };
        let found = found(vec![seen, remembered]);
        let sectors = &obstacles_json(&found)["sectors"];
        let of = |index: usize| (sectors[index]["remembered"].clone(), sectors[index]["age_s"].clone());
        assert_eq!(of(0), (json!(false), json!(0.0)));
        assert_eq!(of(1), (json!(true), json!(0.5)));
        assert_eq!(sectors[0]["range_m"], json!(1.2), "the digits of f32");
    }
}
