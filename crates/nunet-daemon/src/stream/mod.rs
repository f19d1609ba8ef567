//! The loop: a source's thread, one mailbox, the inference thread; bounded, and every frame accounted for.
//!
//! [`pump`](pump::pump) captures on a thread of its own; [`Worker`] turns frames into depth on the caller's thread and
//! publishes them; readers are other processes. Nothing waits for a reader. [`Continuity`]
//! says where a stream breaks, for networks that remember. Several cameras have a source's thread, a mailbox and a worker
//! each, and [take turns](turns::take_turns) on the inference thread; one camera is the same with nobody to wait for.

mod bell;
mod continuity;
mod mailbox;
mod optics;
mod pump;
mod stop;
#[cfg(test)]
mod tests;
mod turns;
mod worker;

pub use bell::Bell;
pub(crate) use continuity::Continuity;
pub use mailbox::{Mailbox, Put, Taken};
pub(crate) use optics::{Optics, read_calibration};
pub(crate) use pump::{CloseOnDrop, Lane, Pace, SourceEnd, pump};
pub(crate) use stop::{Stop, Stopped};
pub(crate) use worker::{Remains, Sinks, Worker};

use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use nunet_ipc::orphans;
use tracing::{Span, debug};

use crate::source::Source;
use crate::telemetry::Counts;

/// A camera before its first frame.
pub(crate) struct Stream {
    pub(crate) source: Box<dyn Source>,
    pub(crate) pace: Pace,
    pub(crate) worker: Worker,
    /// What its log lines stand in.
    pub(crate) span: Span,
}

/// A camera that is over.
pub(crate) struct Ended {
    pub(crate) counts: Counts,
    pub(crate) remains: Remains,
    /// How its source ended, or why it failed.
    pub(crate) source: anyhow::Result<SourceEnd>,
}

/// Runs each stream until its source ends, its pace's limit is reached, or `stop` is requested; returns when all have
/// ended, in their order. One that fails leaves the others. `bell` rings when a sink has room again.
pub(crate) fn run(streams: Vec<Stream>, bell: &Arc<Bell>, stop: &Stop) -> anyhow::Result<Vec<Ended>> {
    let (mut sources, mut workers, mut lanes) = (Vec::new(), Vec::new(), Vec::new());
    for Stream { source, pace, worker, span } in streams {
        sources.push((source, pace));
        workers.push(worker);
        lanes.push(Lane::new(stop.clone(), Arc::clone(bell), span));
    }
    let lanes = &lanes[..];
    let (remains, ends) = std::thread::scope(|scope| {
        // Also where a thread cannot start: those before it must not run for ever.
        let closed: Vec<_> = lanes.iter().map(CloseOnDrop).collect();
        let mut captures = Vec::with_capacity(lanes.len());
        for ((source, pace), lane) in sources.iter_mut().zip(lanes) {
            let capture = move || pump(source.as_mut(), *pace, lane);
            let capture = named("capture").spawn_scoped(scope, capture);
            captures.push(capture.context("cannot start a source's thread")?);
        }
        let janitor = named("janitor").spawn_scoped(scope, || clean_up(lanes));
        janitor.context("cannot start the janitor's thread")?;
        let remains = turns::take_turns(workers, lanes, bell);
        drop(closed);
        let failed = |_| anyhow::anyhow!("the source's thread has failed: see the lines above");
        let ends: Vec<_> =
            captures.into_iter().map(|capture| capture.join().map_err(failed).flatten()).collect();
        Ok::<_, anyhow::Error>((remains, ends))
    })?;
    let counts = lanes.iter().map(|lane| lane.ledger.counts());
    let ended = counts.zip(remains).zip(ends);
    Ok(ended.map(|((counts, remains), source)| Ended { counts, remains, source }).collect())
}

fn named(name: &str) -> std::thread::Builder {
    std::thread::Builder::new().name(name.into())
}

/// How soon the place of a killed reader is free again, and work for it ends.
const CLEAN_UP_PERIOD: Duration = Duration::from_secs(1);

/// Removes what killed readers left, off the frame's path, until all mailboxes are closed.
fn clean_up(lanes: &[Lane]) {
    while !lanes.iter().all(|lane| lane.mailbox.wait_closed(CLEAN_UP_PERIOD)) {
        let dead = orphans::list().is_ok_and(|orphans| !orphans.is_empty());
        if let Some(error) = dead.then(orphans::clean).and_then(Result::err) {
            debug!("dead readers are not cleaned up after: {error}");
        }
    }
}
