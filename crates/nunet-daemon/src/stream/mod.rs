//! The loop: a source's thread, one mailbox, the inference thread; bounded, and every frame accounted for.
//!
//! [`pump`](pump::pump) captures on a thread of its own; [`Worker`] turns frames into depth on the caller's thread and
//! publishes them; readers are other processes. Nothing waits for a reader. [`Continuity`]
//! says where a stream breaks, for networks that remember.

mod continuity;
mod mailbox;
mod optics;
mod pump;
mod stop;
mod worker;

pub(crate) use continuity::Continuity;
pub use mailbox::{Mailbox, Put, Taken};
pub(crate) use optics::{Optics, read_calibration};
pub(crate) use pump::{CloseOnDrop, Lane, Pace, SourceEnd, pump};
pub(crate) use stop::Stop;
pub(crate) use worker::{Remains, Worker};

use std::time::Duration;

use anyhow::Context as _;
use nunet_ipc::orphans;
use tracing::debug;

use crate::source::Source;
use crate::telemetry::Counts;

/// Runs `source` through `worker` until the source ends, the pace's limit is reached, or `stop` is requested.
pub(crate) fn run(
    mut source: Box<dyn Source>,
    worker: Worker,
    pace: Pace,
    stop: Stop,
) -> anyhow::Result<Ended> {
    let lane = Lane { stop, ..Lane::default() };
    let (remains, source) = std::thread::scope(|scope| {
        let capture = named("capture").spawn_scoped(scope, || pump(source.as_mut(), pace, &lane));
        let capture = capture.context("cannot start the source's thread")?;
        named("janitor")
            .spawn_scoped(scope, || clean_up(&lane))
            .context("cannot start the janitor's thread")?;
        let remains = {
            let _closed = CloseOnDrop(&lane);
            worker.run(&lane)
        };
        let source = capture
            .join()
            .map_err(|_| anyhow::anyhow!("the source's thread has failed: see the lines above"))??;
        Ok::<_, anyhow::Error>((remains, source))
    })?;
    Ok(Ended { counts: lane.ledger.counts(), remains, source })
}

/// A stream that is over.
pub(crate) struct Ended {
    pub(crate) counts: Counts,
    pub(crate) remains: Remains,
    pub(crate) source: SourceEnd,
}

fn named(name: &str) -> std::thread::Builder {
    std::thread::Builder::new().name(name.into())
}

/// How soon the place of a killed reader is free again, and work for it ends.
const CLEAN_UP_PERIOD: Duration = Duration::from_secs(1);

/// Removes what killed readers left, off the frame's path, until the mailbox is closed.
fn clean_up(lane: &Lane) {
    while !lane.mailbox.wait_closed(CLEAN_UP_PERIOD) {
        let dead = orphans::list().is_ok_and(|orphans| !orphans.is_empty());
        if let Some(error) = dead.then(orphans::clean).and_then(Result::err) {
            debug!("dead readers are not cleaned up after: {error}");
        }
    }
}
