//! The loop: a source's thread, one mailbox, the inference thread; bounded, and every frame accounted for.
//!
//! [`pump`](pump::pump) captures on a thread of its own; [`Worker`] turns frames into depth on the caller's thread and
//! publishes them; readers are other processes. Nothing waits for a reader.

mod ledger;
mod mailbox;
mod optics;
mod pump;
mod stop;
mod totals;
mod worker;

pub use ledger::{Counts, End, Ledger};
pub use mailbox::{Mailbox, Put, Reuse, Taken};
pub(crate) use optics::{Change, Optics};
pub(crate) use pump::{Lane, Pace, pump};
pub(crate) use stop::Stop;
pub(crate) use totals::Totals;
pub(crate) use worker::{Remains, Worker, stage_names};

use anyhow::Context as _;

use crate::source::Source;

/// Runs `source` through `worker` until the source ends, the pace's limit is reached, or `stop` is requested.
pub(crate) fn run(
    mut source: Box<dyn Source>,
    worker: Worker,
    pace: Pace,
    stop: Stop,
) -> anyhow::Result<(Counts, Remains)> {
    let lane = Lane { stop, ..Lane::default() };
    let remains = std::thread::scope(|scope| {
        let capture = std::thread::Builder::new().name("capture".into());
        let capture = capture.spawn_scoped(scope, || pump(source.as_mut(), pace, &lane));
        let capture = capture.context("cannot start the source's thread")?;
        let remains = worker.run(&lane);
        capture.join().map_err(|_| anyhow::anyhow!("the source's thread has failed"))?;
        Ok::<_, anyhow::Error>(remains)
    })?;
    Ok((lane.ledger.counts(), remains))
}
