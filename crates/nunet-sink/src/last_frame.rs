//! The last frame as files.

use std::path::PathBuf;

use nunet_core::cloud::CloudPoint;
use nunet_core::obstacle::Obstacles;
use nunet_files::write_results;
use nunet_types::{ImageSize, Units};
use tracing::warn;

use crate::file_writer::FileWriter;
use crate::obstacle_images::write_obstacles;
use crate::results::Results;
use crate::sink::{FinishingSink, Outcome, PublishedFrame, Sink, Wants};

/// Writes the results of the last frame into a folder.
struct LastFrame {
    folder: PathBuf,
    has_obstacles: bool,
}

/// Writes the results of the last frame into `folder`, which exists; obstacles too if there is a stage that
/// finds them.
#[must_use]
pub fn last_frame_into(folder: PathBuf, has_obstacles: bool) -> Box<dyn Sink> {
    Box::new(LastFrame { folder, has_obstacles })
}

impl Sink for LastFrame {
    /// Any frame may be the last one, so everything is computed for each.
    fn wants(&self) -> Wants {
        Wants { labels: true, confidence: true, cloud: true, obstacles: self.has_obstacles }
    }

    fn on_frame(&mut self, _frame: &PublishedFrame<'_>) {}

    /// Copies the last results, because shared memory is released next, and starts to write them.
    fn finish(self: Box<Self>, last: Option<&Results<'_>>) -> FinishingSink {
        let Some(last) = last.map(OwnedResults::of) else {
            warn!("no frame was published, so `{}` has no results", self.folder.display());
            return FinishingSink::done();
        };
        let folder = self.folder;
        let what = format!("the files in `{}`", folder.display());
        let writer = FileWriter::start(what, move || {
            write_results(&folder, &last.results())?;
            last.obstacles.map_or(Ok(()), |found| write_obstacles(&found, &folder))
        });
        FinishingSink::new(move |timeout| writer?.end(timeout).map(|()| Outcome::Done))
    }
}

/// Copies of the results.
struct OwnedResults {
    size: ImageSize,
    depth: Vec<f32>,
    metric: bool,
    labels: Option<Vec<u8>>,
    confidence: Option<Vec<u8>>,
    cloud: Option<Vec<CloudPoint>>,
    obstacles: Option<Obstacles>,
}

impl OwnedResults {
    fn of(results: &Results<'_>) -> Self {
        Self {
            size: results.size,
            depth: results.depth.to_vec(),
            metric: results.scale.units == Units::Metre,
            labels: results.labels.map(<[_]>::to_vec),
            confidence: results.confidence.map(<[_]>::to_vec),
            cloud: results.cloud.map(<[_]>::to_vec),
            obstacles: results.obstacles.cloned(),
        }
    }

    fn results(&self) -> nunet_files::ResultArrays<'_> {
        let Self { size, depth, metric, labels, confidence, cloud, obstacles: _ } = self;
        nunet_files::ResultArrays {
            size: *size,
            depth,
            metric: *metric,
            labels: labels.as_deref(),
            confidence: confidence.as_deref(),
            cloud: cloud.as_deref(),
        }
    }
}
