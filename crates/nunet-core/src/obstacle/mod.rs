//! From depth to obstacles: which directions around the robot are free.
//!
//! All results are in the leveled base frame (REP 103: x forward, y left, z up), whose origin is on the
//! floor. The [`Mount`] says where the camera is in it. Depth must be in meters.
//!
//! Steps of a frame, each in its own module:
//! 1. The *ground* is a plane near the expected floor, fitted to samples that may be floor.
//! 2. Each sample shows floor, an obstacle (higher than the clearance, lower than the robot), a deceptive
//!    surface (window, mirror, screen), missing floor, or nothing.
//! 3. *Obstacle points*: isolated samples and those on a depth edge are removed, the others are reduced to
//!    one per cube.
//! 4. *Sectors*: in each direction the floor must be seen cell by cell, from near to far. Its end decides the
//!    state. Labels of samples with uncertain depth show where a thing stands on the floor, also if its depth
//!    is wrong, and correct the depth beside it. This needs both labels and confidence.
//!
//! Images wider than 320 pixels are sampled at each second, third, ... column and row.
//!
//! # Example: a box on the floor, 2 m ahead
//! ```
//! use nunet_core::camera::{Camera, Intrinsics, Mount};
//! use nunet_core::depth::DepthImage;
//! use nunet_core::obstacle::{ObstacleDetector, ObstacleOptions, SectorState};
//!
//! // A level camera 0.5 m above the floor. Depth as it sees floor, and a box 0.4 m wide and 0.3 m high.
//! let (width, height) = (320, 240);
//! let camera = Camera::pinhole(Intrinsics::new(260.0, 260.0, 160.0, 120.0, width, height)?);
//! let mount = Mount::new([0.0, 0.0, 0.5], [0.0, 0.0, 0.0])?;
//! let pixels = (0..height).flat_map(|row| (0..width).map(move |column| (column, row)));
//! let depth_m: Vec<f32> = pixels
//!     .map(|(column, row)| {
//!         let (x, y) = ((column as f32 - 160.0) / 260.0, (row as f32 - 120.0) / 260.0);
//!         let floor = if y > 0.0 { 0.5 / y } else { f32::NAN };
//!         let hits_box = (2.0 * x).abs() < 0.2 && 2.0 * y > 0.2 && floor > 2.0;
//!         if hits_box { 2.0 } else { floor }
//!     })
//!     .collect();
//!
//! let options = ObstacleOptions { sectors: 9, ..ObstacleOptions::default() };
//! let mut detector = ObstacleDetector::new(&camera, mount, &[], options)?;
//! let image = DepthImage { depth_m: &depth_m, labels: None, confidence: None };
//! let obstacles = detector.detect(&image, 0)?;
//!
//! let ahead = &obstacles.sectors[4];
//! assert_eq!(ahead.state(), SectorState::Occupied);
//! assert!((ahead.range_m - 2.0).abs() < 0.02, "{} m", ahead.range_m);
//! assert!(ahead.max_height_m < 0.31);
//! assert_eq!(obstacles.sectors[0].state(), SectorState::Free);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod collect;
mod contact;
mod correction;
mod directions;
mod error;
mod extent;
mod floor_mismatch;
mod floor_view;
mod ground;
mod hits;
mod kind;
mod options;
mod scan;
mod sectors;
mod view;
mod voxels;

pub use error::ObstacleError;
pub use floor_mismatch::FloorMismatch;
pub use floor_view::FloorView;
pub use ground::Ground;
pub use nunet_types::{ObstacleMap, ObstaclePoint, ObstacleSector, SectorState};
pub use options::ObstacleOptions;

use collect::Collector;
use correction::{Correction, Viewpoint};
use directions::Memory;
use ground::GroundFit;
use kind::Bounds;
use scan::Scan;
use sectors::Sectors;
use view::View;

use crate::camera::{Camera, Mount, RayTable};
use crate::depth::DepthImage;
use crate::label_roles::{Role, Roles};

/// The obstacles of one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Obstacles {
    /// The ground in the base frame.
    pub ground: Ground,
    /// Directions, counterclockwise: the first one is the rightmost. Sector `i` covers the angles from
    /// `angle_min_rad + i * angle_step_rad` on, 0 = forward.
    pub sectors: Vec<ObstacleSector>,
    /// Points of obstacles, at most [`ObstacleOptions::max_points`].
    pub points: Vec<ObstaclePoint>,
    /// The right boundary of the first sector, radians.
    pub angle_min_rad: f32,
    /// The width of a sector, radians.
    pub angle_step_rad: f32,
    /// Obstacles farther from the base are ignored, meters.
    pub max_range_m: f32,
    /// Whether labels identified floor and glass; if not, only geometry did.
    pub used_labels: bool,
}

impl Obstacles {
    /// The sectors and points, for what draws or sends them.
    #[must_use]
    pub fn map(&self) -> ObstacleMap<'_> {
        ObstacleMap {
            sectors: &self.sectors,
            points: &self.points,
            angle_min_rad: self.angle_min_rad,
            angle_step_rad: self.angle_step_rad,
            max_range_m: self.max_range_m,
        }
    }
}

/// Finds obstacles in depth maps of one camera. Allocates everything once.
#[derive(Debug, Clone)]
pub struct ObstacleDetector {
    options: ObstacleOptions,
    size: (u32, u32),
    rays: RayTable,
    roles: Roles,
    view: View,
    /// Those of the mount before.
    last_sectors: Sectors,
    scan: Scan,
    ground: GroundFit,
    correction: Correction,
    collector: Collector,
    memory: Memory,
    obstacles: Obstacles,
}

impl ObstacleDetector {
    /// For depth maps of `camera`, at the size of its intrinsics. `classes` are the names of the labels,
    /// index = label.
    ///
    /// # Errors
    /// An option out of range.
    pub fn new(
        camera: &Camera,
        mount: Mount,
        classes: &[String],
        options: ObstacleOptions,
    ) -> Result<Self, ObstacleError> {
        options.check()?;
        let rays = RayTable::new(camera);
        let view = View::new(&rays, &mount, &options);
        let obstacles = Obstacles {
            ground: Ground::EXPECTED,
            sectors: vec![ObstacleSector::UNKNOWN; options.sectors],
            points: Vec::with_capacity(options.max_points),
            angle_min_rad: view.sectors.angle_min_rad,
            angle_step_rad: view.sectors.angle_step_rad,
            max_range_m: options.max_range_m,
            used_labels: false,
        };
        Ok(Self {
            size: (rays.width(), rays.height()),
            roles: Roles::new(classes),
            scan: Scan::new(&view, mount.position_m()),
            ground: GroundFit::new(&mount, &options),
            correction: Correction::new(&mount, &options),
            collector: Collector::new(&view),
            memory: Memory::new(options.hold_s, options.sectors),
            obstacles,
            options,
            rays,
            last_sectors: view.sectors.clone(),
            view,
        })
    }

    /// Takes another mount from the next frame on, such as that of a tilted robot
    /// ([`Mount::on_tilted_base`]). Computes the tables again; allocates only if the camera sees more floor
    /// than with any mount before. Remembered obstacles keep their directions.
    pub fn set_mount(&mut self, mount: Mount) {
        std::mem::swap(&mut self.view.sectors, &mut self.last_sectors);
        self.view.set_mount(&self.rays, &mount, &self.options);
        self.memory.turn(&self.last_sectors, &self.view.sectors);
        self.scan.set_mount(&self.view, mount.position_m());
        self.ground.set_mount(&mount);
        self.correction.set_mount(&mount, &self.options);
        self.obstacles.angle_min_rad = self.view.sectors.angle_min_rad;
        self.obstacles.angle_step_rad = self.view.sectors.angle_step_rad;
    }

    /// The share of the image that looks at floor within range, 0 to 1. At 0 the camera never sees floor, and
    /// no direction can be free.
    #[must_use]
    pub fn floor_in_view(&self) -> f32 {
        self.view.floor_in_view()
    }

    /// What counts as an obstacle.
    #[must_use]
    pub fn options(&self) -> &ObstacleOptions {
        &self.options
    }

    /// The obstacles of the last frame.
    #[must_use]
    pub fn last(&self) -> &Obstacles {
        &self.obstacles
    }

    /// Marks a discontinuity: obstacles of earlier frames are forgotten.
    pub fn reset(&mut self) {
        self.memory.clear();
    }

    /// Finds the obstacles of one frame. `time_nanos` is its capture time; only differences count. Allocates
    /// nothing.
    ///
    /// # Errors
    /// Buffers of another size than the camera's image.
    pub fn detect(&mut self, image: &DepthImage<'_>, time_nanos: i64) -> Result<&Obstacles, ObstacleError> {
        self.check(image)?;
        self.obstacles.used_labels = image.labels.is_some() && self.roles.has_floor;
        self.scan.gather(image, &self.view);
        let ground = self.fit_ground(image);
        let bounds = Bounds::new(&ground, &self.options, self.scan.camera[2]);
        self.scan.start();
        self.collector.start();
        for row in 0..self.view.rows {
            if self.scan.classify_row(row, image, &self.view, (&self.roles, &bounds)) {
                self.collector.collect_row(row, &self.scan.line, image, &self.view);
            }
        }
        self.obstacles.ground = Ground { floor_fraction: self.scan.floor_fraction(), ..ground };
        self.collector.voxels.take(self.options.max_points, &mut self.obstacles.points);
        let sectors = &mut self.obstacles.sectors;
        let max_range_m = self.options.max_range_m;
        let hits = &mut self.collector.hits;
        let correction = (&mut self.correction, Viewpoint::new(self.scan.camera, &ground));
        directions::fill(&self.view, &self.scan.votes, hits, max_range_m, correction, sectors);
        self.memory.update(&mut self.obstacles.sectors, time_nanos);
        Ok(&self.obstacles)
    }

    fn check(&self, image: &DepthImage<'_>) -> Result<(), ObstacleError> {
        let (width, height) = self.size;
        let expected = width as usize * height as usize;
        let given = [("depth", Some(image.depth_m.len())), ("label", image.labels.map(<[u8]>::len))];
        let given = given.into_iter().chain([("confidence", image.confidence.map(<[u8]>::len))]);
        for (buffer, got) in given {
            if let Some(got) = got.filter(|got| *got != expected) {
                return Err(ObstacleError::Size { buffer, got, expected, width, height });
            }
        }
        Ok(())
    }

    /// The floor that a frame shows, whatever the mount says: the plane of what is labeled floor, without
    /// labels of the lower half of the image. `None` if that is no plane below the camera, or covers less
    /// than 5 % of the image. Allocates; for frames that contradict the mount.
    #[must_use]
    pub fn floor_view(&self, image: &DepthImage<'_>) -> Option<FloorView> {
        self.check(image).ok()?;
        FloorView::of_image(&self.rays, &self.roles, image)
    }

    /// Fits the ground to samples that look at the floor: those labeled floor, if there are labels.
    fn fit_ground(&mut self, image: &DepthImage<'_>) -> Ground {
        let Self { view, scan, roles, obstacles, .. } = self;
        let used_labels = obstacles.used_labels;
        let candidates = view.ground_samples.iter().map(|at| at.map(|place| place as usize));
        let labeled = candidates.filter(|&[row, column]| {
            !used_labels || image.label(view, row, column).is_some_and(|label| roles.of(label) == Role::Floor)
        });
        self.ground.fit(labeled.map(|[row, column]| scan.point(view, row, column)))
    }
}

impl DepthImage<'_> {
    /// The pixel of a sample.
    #[inline]
    fn pixel(view: &View, row: usize, column: usize) -> usize {
        (row * view.width + column) * view.stride
    }

    #[inline]
    fn label(&self, view: &View, row: usize, column: usize) -> Option<u8> {
        self.labels.map(|labels| labels[Self::pixel(view, row, column)])
    }

    #[inline]
    fn confidence(&self, view: &View, row: usize, column: usize) -> u8 {
        self.confidence.map_or(u8::MAX, |confidence| confidence[Self::pixel(view, row, column)])
    }
}
