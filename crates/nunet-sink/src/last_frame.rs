//! The last frame as files.

use std::path::PathBuf;

use nunet_core::cloud::CloudPoint;
use nunet_files::write_results;
use nunet_types::{ImageSize, Units};
use tracing::warn;

use crate::file_writer::FileWriter;
use crate::results::Results;
use crate::sink::{FinishingSink, Outcome, PublishedFrame, Sink, Wants};

/// Writes the results of the last frame into a folder.
struct LastFrame {
    folder: PathBuf,
}

/// Writes the results of the last frame into `folder`, which exists.
#[must_use]
pub fn last_frame_into(folder: PathBuf) -> Box<dyn Sink> {
    Box::new(LastFrame { folder })
}

impl Sink for LastFrame {
    /// Any frame may be the last one, so labels and cloud are computed for each.
    fn wants(&self) -> Wants {
        Wants { labels: true, cloud: true, obstacles: false }
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
        let writer = FileWriter::start(what, move || Ok(write_results(&folder, &last.results()).map(drop)?));
        FinishingSink::new(move |timeout| writer?.end(timeout).map(|()| Outcome::Done))
    }
}

/// Copies of the results.
struct OwnedResults {
    size: ImageSize,
    depth: Vec<f32>,
    metric: bool,
    labels: Option<Vec<u8>>,
    cloud: Option<Vec<CloudPoint>>,
}

impl OwnedResults {
    fn of(results: &Results<'_>) -> Self {
        Self {
            size: results.size,
            depth: results.depth.to_vec(),
            metric: results.units == Units::Metre,
            labels: results.labels.map(<[_]>::to_vec),
            cloud: results.cloud.map(<[_]>::to_vec),
        }
    }

    fn results(&self) -> nunet_files::Results<'_> {
        let Self { size, depth, metric, labels, cloud } = self;
        nunet_files::Results {
            size: *size,
            depth,
            metric: *metric,
            labels: labels.as_deref(),
            cloud: cloud.as_deref(),
        }
    }
}
