//! `--out DIR`: the last frame as files, read as any other process would read it.

use std::path::PathBuf;
use std::time::Duration;

use anyhow::Context as _;
use nunet_ipc::{CameraName, FrameSet, Reader, Topic, Units};
use tracing::warn;

use super::files::{self, Results};
use super::points::cloud_points;
use super::shm::Outlet;

/// The services are ours and exist: no waiting.
const NO_WAIT: Duration = Duration::ZERO;

/// A reader of our own camera. While it is attached, labels and cloud are computed.
pub(crate) struct Collector {
    folder: PathBuf,
    reader: Reader,
}

impl Collector {
    /// Attaches to everything that `outlet` publishes of a frame; `folder` exists.
    pub(crate) fn attach(folder: PathBuf, camera: &CameraName, outlet: &Outlet) -> anyhow::Result<Self> {
        let topics: Vec<_> = outlet.topics().iter().copied().filter(|&topic| topic != Topic::Stats).collect();
        Ok(Self { folder, reader: Reader::open(camera, &topics, NO_WAIT)? })
    }

    /// Writes the newest frame, while the outlet is still open.
    pub(crate) fn write(mut self, outlet: &Outlet) -> anyhow::Result<()> {
        outlet.refresh();
        match self.reader.next_set()? {
            Some(set) => write_set(&self.folder, &set),
            None => {
                warn!("no frame was published, so nothing is in `{}`", self.folder.display());
                Ok(())
            }
        }
    }
}

fn write_set(folder: &std::path::Path, set: &FrameSet) -> anyhow::Result<()> {
    let depth = set.get(Topic::Depth).context("a frame without depth")?;
    let results = Results {
        size: (depth.header().width, depth.header().height),
        depth: depth.depth()?,
        metric: depth.header().units()? == Units::Metre,
        labels: set.get(Topic::Labels).map(nunet_ipc::Frame::labels).transpose()?,
        cloud: set.get(Topic::Cloud).map(|frame| frame.points().map(cloud_points)).transpose()?,
    };
    files::write(folder, &results)
}
