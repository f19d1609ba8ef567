//! Compares the obstacles in the network's depth and labels with those in the true ones, found by the same
//! detector.

use std::collections::BTreeMap;

use nunet_core::camera::{Camera, Mount};
use nunet_core::depth::DepthImage;
use nunet_core::obstacle::{ObstacleDetector, ObstacleOptions};
use nunet_core::pipeline::Pipeline;
use nunet_types::{NO_LABEL, ObstacleSector, SectorState, Units, counted};
use serde::Serialize;

use crate::error::EvalError;
use crate::event::{Event, OnEvent};
use crate::median::median;
use crate::truth_floor::TruthFloor;

/// Obstacles nearer than this are those that a robot must not miss, meters.
const NEAR_M: f32 = 2.0;
/// A range is right within this factor, as for `delta1`.
const TOLERANCE: f32 = 1.25;
/// The lower bounds of the groups by distance, meters; the last group has no upper bound.
const DISTANCES_M: [f32; 5] = [0.0, 1.0, 2.0, 3.0, 4.0];

/// The settings of the comparison of obstacles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ObstacleEval {
    /// The camera's mount; `None` if the dataset states it for each image in `mounts.csv`.
    pub mount: Option<Mount>,
    /// What counts as an obstacle.
    pub options: ObstacleOptions,
}

/// Compares the obstacles of one image after the other.
#[derive(Debug)]
pub(crate) struct ObstacleComparison {
    options: ObstacleOptions,
    classes: Vec<String>,
    counts: ObstacleCounts,
    floor: TruthFloor,
}

impl ObstacleComparison {
    /// The comparison with the results of a pipeline, if it was requested.
    ///
    /// # Errors
    /// The pipeline's depth has no unit.
    pub(crate) fn of(
        requested: Option<ObstacleEval>,
        pipeline: &Pipeline,
    ) -> Result<Option<Self>, EvalError> {
        match requested {
            Some(_) if pipeline.scale().units != Units::Metre => Err(EvalError::NoMeters),
            Some(how) => Ok(Some(Self::new(how.options, &pipeline.graph().description().classes))),
            None => Ok(None),
        }
    }

    fn new(options: ObstacleOptions, classes: &[String]) -> Self {
        let (counts, floor) = (ObstacleCounts::default(), TruthFloor::default());
        Self { options, classes: classes.to_vec(), counts, floor }
    }

    /// Adds the image `id` of `camera`, at the size of both views.
    pub(crate) fn add(
        &mut self,
        id: &str,
        camera: &Camera,
        mount: Mount,
        [truth, predicted]: [DepthImage<'_>; 2],
    ) -> Result<(), EvalError> {
        let mut detector = ObstacleDetector::new(camera, mount, &self.classes, self.options)?;
        let true_sectors = detector.detect(&truth, 0)?.sectors.clone();
        self.floor.add(id, &detector, &mount, &truth);
        detector.reset(); // obstacles of one image must not be remembered in the other
        let predicted = &detector.detect(&predicted, 0)?.sectors;
        true_sectors.iter().zip(predicted).for_each(|(truth, predicted)| self.counts.add(truth, predicted));
        Ok(())
    }

    /// Reports a mount that is probably wrong.
    pub(crate) fn report(&self, on_event: OnEvent<'_>) {
        if !self.floor.report(on_event) && self.counts.are_empty() {
            let text = "no direction shows a true obstacle or free floor, so that nothing was compared";
            let hint = "check the mount: z is in meters, pitch in radians, and a positive pitch looks down";
            on_event(Event::WrongMount { text, hint });
        }
    }

    pub(crate) fn scores(&self) -> ObstacleScores {
        self.counts.scores(&self.classes)
    }
}

/// Counts of sectors by outcome.
#[derive(Debug, Default)]
struct ObstacleCounts {
    by_distance: [Group; DISTANCES_M.len()],
    near: Group,
    /// Near obstacles, by class.
    near_by_class: BTreeMap<u8, Group>,
    clear: u64,
    false_alarms: u64,
    unknown: u64,
}

impl ObstacleCounts {
    fn add(&mut self, truth: &ObstacleSector, predicted: &ObstacleSector) {
        let true_m = truth.obstacle_m;
        if true_m.is_finite() {
            let group = DISTANCES_M.iter().rposition(|&from_m| true_m >= from_m).unwrap_or(0);
            self.by_distance[group].add(true_m, predicted);
            if true_m < NEAR_M {
                self.near.add(true_m, predicted);
                self.near_by_class.entry(truth.label).or_default().add(true_m, predicted);
            }
        }
        if truth.range_m >= NEAR_M * TOLERANCE {
            let is_short = predicted.range_m < NEAR_M;
            self.clear += 1;
            let is_unknown = predicted.state() == SectorState::Unknown;
            self.unknown += u64::from(is_short && is_unknown);
            self.false_alarms += u64::from(is_short && !is_unknown && predicted.state() != SectorState::Free);
        }
    }

    /// Whether no sector counts.
    fn are_empty(&self) -> bool {
        let sectors = |group: &Group| group.found + group.unknown + group.missed;
        self.clear == 0 && self.by_distance.iter().map(sectors).sum::<u64>() == 0
    }

    fn scores(&self, classes: &[String]) -> ObstacleScores {
        let ends =
            DISTANCES_M.iter().skip(1).map(|to_m| format!(" to {to_m}")).chain([" or more".to_owned()]);
        let distances = DISTANCES_M.iter().zip(ends).map(|(from_m, end)| format!("{from_m}{end} m"));
        let class = |label: u8| match classes.get(usize::from(label)) {
            Some(name) => name.clone(),
            None if label == NO_LABEL => "no class".to_owned(),
            None => label.to_string(),
        };
        let share = |count: u64| (self.clear > 0).then(|| count as f64 / self.clear as f64);
        ObstacleScores {
            near_m: NEAR_M,
            near: self.near.scores(format!("nearer than {NEAR_M} m")),
            by_distance: distances.zip(&self.by_distance).map(|(name, group)| group.scores(name)).collect(),
            near_by_class: self
                .near_by_class
                .iter()
                .map(|(&label, group)| group.scores(class(label)))
                .collect(),
            clear_sectors: self.clear,
            false_alarms: share(self.false_alarms),
            wrongly_unknown: share(self.unknown),
        }
    }
}

/// The outcome for sectors with a true obstacle.
#[derive(Debug, Default)]
struct Group {
    found: u64,
    unknown: u64,
    missed: u64,
    /// Relative errors of the range where the obstacle was found.
    errors: Vec<f32>,
}

impl Group {
    fn add(&mut self, true_m: f32, predicted: &ObstacleSector) {
        if predicted.obstacle_m <= TOLERANCE * true_m {
            self.found += 1;
            self.errors.push((predicted.obstacle_m - true_m).abs() / true_m);
        } else if predicted.range_m > TOLERANCE * true_m {
            self.missed += 1;
        } else {
            self.unknown += 1;
        }
    }

    fn scores(&self, name: String) -> ObstacleGroup {
        let sectors = self.found + self.unknown + self.missed;
        let share = |count: u64| (sectors > 0).then(|| count as f64 / sectors as f64);
        ObstacleGroup {
            name,
            sectors,
            found: share(self.found),
            unknown: share(self.unknown),
            missed: share(self.missed),
            range_error: median(self.errors.iter().map(|&error| error.into()).collect()),
        }
    }
}

/// Scores of obstacles. A share is `None` if there are no sectors.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ObstacleScores {
    /// Obstacles nearer than this are *near*, meters.
    pub near_m: f32,
    /// Sectors with an obstacle nearer than [`Self::near_m`].
    pub near: ObstacleGroup,
    /// All sectors with an obstacle, by its true distance.
    pub by_distance: Vec<ObstacleGroup>,
    /// Sectors with a near obstacle, by its true class.
    pub near_by_class: Vec<ObstacleGroup>,
    /// Sectors that are free for 1.25 times [`Self::near_m`].
    pub clear_sectors: u64,
    /// The share of them in which an obstacle or a drop is reported nearer than [`Self::near_m`].
    pub false_alarms: Option<f64>,
    /// The share of them in which nothing is known from nearer than [`Self::near_m`] on.
    pub wrongly_unknown: Option<f64>,
}

/// Sectors with a true obstacle.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ObstacleGroup {
    /// The name of the group.
    pub name: String,
    /// The number of sectors.
    pub sectors: u64,
    /// The share in which an obstacle is reported, at most 1.25 times as far away.
    pub found: Option<f64>,
    /// The share without one, where the direction is not known to be free up to there.
    pub unknown: Option<f64>,
    /// The share that is reported as free up to more than 1.25 times the obstacle's distance.
    pub missed: Option<f64>,
    /// The median of |range - true range| / true range of those that are found.
    pub range_error: Option<f64>,
}

impl ObstacleScores {
    /// A table, with a final newline.
    #[must_use]
    pub fn text(&self) -> String {
        let head = ["found", "unknown", "missed", "range error"];
        let mut text = format!("{:<20}{:>9}", "obstacles", "sectors");
        text += &head.map(|name| format!("{name:>13}")).concat();
        text.push('\n');
        let groups = std::iter::once(&self.near).chain(&self.by_distance).chain(&self.near_by_class);
        for group in groups.filter(|group| group.sectors > 0) {
            let shares = [group.found, group.unknown, group.missed, group.range_error];
            text += &format!("{:<20}{:>9}", group.name, group.sectors);
            text += &shares.map(|share| format!("{:>13}", number(share))).concat();
            text.push('\n');
        }
        let [alarms, unknown] = [self.false_alarms, self.wrongly_unknown].map(number);
        let (near_m, clear) = (self.near_m, counted(self.clear_sectors, "sector"));
        text + &format!("{clear} free beyond {near_m} m: false alarms {alarms}, unknown {unknown}\n")
    }
}

fn number(share: Option<f64>) -> String {
    share.map_or_else(|| "-".to_owned(), |share| format!("{share:.4}"))
}

#[cfg(test)]
mod tests {
    use nunet_core::camera::Intrinsics;

    use super::*;

    fn sector(state: SectorState, range_m: f32, obstacle_m: f32) -> ObstacleSector {
        ObstacleSector { state: state as u32, range_m, obstacle_m, label: 0, ..ObstacleSector::UNKNOWN }
    }

    fn counts(pairs: &[(ObstacleSector, ObstacleSector)]) -> ObstacleScores {
        let mut counts = ObstacleCounts::default();
        pairs.iter().for_each(|(truth, predicted)| counts.add(truth, predicted));
        counts.scores(&["chair".to_owned()])
    }

    const SIZE: (u32, u32) = (64, 48);

    /// The warnings about the mount `given` for images of level floor with the mounts `real`; `None` for an
    /// image of a wall.
    fn warnings(given: Mount, real: &[Option<Mount>]) -> Vec<String> {
        warnings_with(&["floor", "wall"], given, real)
    }

    fn warnings_with(classes: &[&str], given: Mount, real: &[Option<Mount>]) -> Vec<String> {
        let camera = Intrinsics::new(50.0, 50.0, 31.5, 23.5, SIZE.0, SIZE.1).unwrap();
        let classes: Vec<String> = classes.iter().map(|&name| name.to_owned()).collect();
        let mut comparison = ObstacleComparison::new(ObstacleOptions::default(), &classes);
        for (index, real) in real.iter().enumerate() {
            let depth = |pixel: u32| {
                let (column, row) = (f64::from(pixel % SIZE.0), f64::from(pixel / SIZE.0));
                let ray = [(column - 31.5) / 50.0, (row - 23.5) / 50.0, 1.0];
                let Some(mount) = real else { return 0.4 };
                let slope = mount.to_base(ray)[2] - mount.height_m();
                if slope < -0.02 { (-mount.height_m() / slope) as f32 } else { f32::NAN }
            };
            let depth_m: Vec<f32> = (0..SIZE.0 * SIZE.1).map(depth).collect();
            let is_wall = |depth: &f32| u8::from(real.is_none() || depth.is_nan());
            let labels: Vec<u8> = depth_m.iter().map(is_wall).collect();
            let image = DepthImage { depth_m: &depth_m, labels: Some(&labels), confidence: None };
            comparison.add(&format!("{index:04}"), &Camera::pinhole(camera), given, [image; 2]).unwrap();
        }
        let mut warnings = Vec::new();
        comparison.report(&mut |event| {
            if let Event::WrongMount { text, hint } = event {
                warnings.push(format!("{text} ({hint})"));
            }
        });
        warnings
    }

    #[test]
    fn a_mount_that_most_true_floor_contradicts_is_reported() {
        let mount = |height, roll, pitch| Mount::new([0.0, 0.0, height], [roll, pitch, 0.0]).unwrap();
        let real = Some(mount(0.25, 0.0, -0.07));
        for wrong in [mount(0.25, 3.1, -0.07), mount(0.25, 0.0, 0.07), mount(25.0, 0.0, -0.07)] {
            let found = warnings(wrong, &[None, real, real]);
            let [text] = &found[..] else { panic!("{wrong:?}: {found:?}") };
            assert!(text.contains("in 2 of 2 images") && text.contains("`0001`"), "{text}");
            assert!(text.contains("0.25 m below the camera with a roll of 0.00 rad"), "{text}");
        }
        for right in [mount(0.25, 0.0, -0.07), mount(0.26, 0.0, -0.05)] {
            for images in [&[None, real, real][..], &[None]] {
                assert_eq!(warnings(right, images), Vec::<String>::new(), "{right:?}: {images:?}");
            }
        }
    }

    #[test]
    fn without_labels_of_floor_three_images_must_contradict_the_mount() {
        let [real, given] =
            [-0.07, 0.07].map(|pitch| Mount::new([0.0, 0.0, 0.25], [0.0, pitch, 0.0]).unwrap());
        for (images, count) in [(2, 0), (3, 1)] {
            let images_and_wall = [vec![None], vec![Some(real); images]].concat();
            let found = warnings_with(&["a", "b"], given, &images_and_wall);
            assert_eq!(found.len(), count, "{images}: {found:?}");
        }
    }

    #[test]
    fn a_mount_with_which_nothing_can_be_compared_is_reported() {
        // Everything is above the robot, and no floor is in view.
        let found = warnings(Mount::new([0.0, 0.0, 25.0], [0.0, -1.0, 0.0]).unwrap(), &[None]);
        assert!(found.len() == 1 && found[0].starts_with("no direction shows"), "{found:?}");
    }

    #[test]
    fn an_obstacle_is_found_unknown_or_missed() {
        use SectorState::{Free, Occupied, Unknown};
        let truth = sector(Occupied, 1.0, 1.0);
        let scores = counts(&[
            (truth, sector(Occupied, 1.2, 1.2)),
            (truth, sector(Occupied, 0.9, 0.9)),
            (truth, sector(Unknown, 0.7, 1.1)), // what is unknown before it does not hide it
            (truth, sector(Unknown, 1.1, f32::NAN)),
            (truth, sector(Free, 3.0, f32::NAN)),
            (truth, sector(Occupied, 1.5, 1.5)),
        ]);
        let near = &scores.near;
        assert_eq!(near.sectors, 6);
        assert_eq!(near.found, Some(0.5));
        assert_eq!((near.unknown, near.missed), (Some(1.0 / 6.0), Some(2.0 / 6.0)));
        assert!((near.range_error.unwrap() - 0.1).abs() < 1e-3, "{near:?}");
        assert_eq!((scores.near_by_class[0].name.as_str(), scores.by_distance[1].sectors), ("chair", 6));
        assert_eq!((scores.clear_sectors, scores.false_alarms), (0, None));
    }

    #[test]
    fn a_false_alarm_is_an_obstacle_or_a_drop_where_the_floor_is_free() {
        use SectorState::{Drop, Free, Occupied, Unknown};
        let truth = sector(Free, 2.6, f32::NAN);
        let scores = counts(&[
            (truth, sector(Occupied, 1.9, 1.9)),
            (truth, sector(Drop, 1.0, f32::NAN)),
            (truth, sector(Unknown, 1.0, f32::NAN)),
            (truth, sector(Occupied, 2.1, 2.1)),
            (sector(Occupied, 2.4, 2.4), sector(Occupied, 1.0, 1.0)), // not far enough to say
        ]);
        assert_eq!((scores.clear_sectors, scores.false_alarms), (4, Some(0.5)));
        assert_eq!(scores.wrongly_unknown, Some(0.25));
        assert_eq!(scores.by_distance[2].sectors, 1);
    }

    #[test]
    fn the_table_has_a_line_for_each_group_with_obstacles() {
        let truth = sector(SectorState::Occupied, 1.5, 1.5);
        let text = counts(&[(truth, truth)]).text();
        assert!(
            text.contains("nearer than 2 m") && text.contains("1 to 2 m") && text.contains("chair"),
            "{text}"
        );
        assert!(!text.contains("4 or more") && text.contains("false alarms -"), "{text}");
    }
}
