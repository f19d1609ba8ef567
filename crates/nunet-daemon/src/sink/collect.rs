//! `--out DIR`: the last frame as files, read as any other process would read it.

use std::path::PathBuf;
use std::time::Duration;

use anyhow::Context as _;
use nunet_core::cloud::CloudPoint;
use nunet_ipc::{CameraName, FrameSet, Reader, Topic, Units};
use tracing::warn;

use super::files::{self, Results};
use super::shm::Outlet;
use super::writing::Writing;

/// The services are ours and exist: no waiting.
const NO_WAIT: Duration = Duration::ZERO;

/// A reader of our own camera. While it is attached, labels and cloud are computed.
pub(crate) struct Collector {
    folder: PathBuf,
    reader: Reader,
}

impl Collector {
    /// Attaches to everything that `outlet` publishes of a frame; `folder` may still have to be made.
    pub(crate) fn attach(folder: PathBuf, camera: &CameraName, outlet: &Outlet) -> anyhow::Result<Self> {
        let topics: Vec<_> = outlet.topics().iter().copied().filter(|&topic| topic != Topic::Stats).collect();
        Ok(Self { folder, reader: Reader::open(camera, &topics, NO_WAIT)? })
    }

    /// Copies the newest frame while the outlet is still open, and begins to write it; `None` where there was none. The
    /// disk is not waited for.
    pub(crate) fn write(mut self, outlet: &Outlet) -> anyhow::Result<Option<Writing>> {
        outlet.refresh();
        let Some(set) = self.reader.next_set()? else {
            warn!("no frame was published, so nothing is in `{}`", self.folder.display());
            return Ok(None);
        };
        let (last, folder) = (Last::of(&set)?, self.folder);
        let what = format!("the files in `{}`", folder.display());
        Writing::start(what, move || files::write(&folder, &last.results())).map(Some)
    }
}

/// A frame's results in memory of their own: what is lent must be given back before shared memory goes.
struct Last {
    size: (u32, u32),
    depth: Vec<f32>,
    metric: bool,
    labels: Option<Vec<u8>>,
    cloud: Option<Vec<CloudPoint>>,
}

impl Last {
    fn of(set: &FrameSet) -> anyhow::Result<Self> {
        let depth = set.get(Topic::Depth).context("a frame without depth")?;
        let labels = set.get(Topic::Labels).map(nunet_ipc::Frame::labels).transpose()?;
        let cloud = set.get(Topic::Cloud).map(nunet_ipc::Frame::points).transpose()?;
        Ok(Self {
            size: (depth.header().width, depth.header().height),
            depth: depth.depth()?.to_vec(),
            metric: depth.header().units()? == Units::Metre,
            labels: labels.map(<[_]>::to_vec),
            cloud: cloud.map(<[_]>::to_vec),
        })
    }

    fn results(&self) -> Results<'_> {
        let Self { size, depth, metric, labels, cloud } = self;
        Results { size: *size, depth, metric: *metric, labels: labels.as_deref(), cloud: cloud.as_deref() }
    }
}
