//! The stream loop: a capture thread and a mailbox per camera, and one inference thread. All queues are
//! bounded, and every frame is counted.
//!
//! [`capture`](capture::capture) reads the source on a thread of its own. [`StreamTask`] turns frames into
//! depth on the caller's thread, publishes them, and passes them to the sinks. Readers are other processes.
//! Nothing waits for a reader or a sink, except that a source that is not live delivers the next frame only
//! when there is room for it. Several cameras take turns on the inference thread ([`round_robin`]); a single
//! camera is a round of one.

mod capture;
mod drive;
mod round_robin;
mod state;
mod stop;
mod task;
#[cfg(test)]
mod tests;

pub(crate) use drive::{FrameHandler, Pace, SourceEnd, drive};
pub(crate) use stop::{Stop, Stopped, survive_size_limits};
pub(crate) use task::{StreamSummary, StreamTask};

use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use nunet_ipc::orphans;
use nunet_telemetry::Counts;
use tracing::{Span, debug};

use self::capture::capture;
use self::state::{CloseOnDrop, StreamState};
use crate::source::{Notify, Source};

/// A camera before its first frame.
pub(crate) struct Stream {
    pub(crate) source: Box<dyn Source>,
    pub(crate) pace: Pace,
    pub(crate) task: StreamTask,
    /// The context of its log lines.
    pub(crate) span: Span,
}

/// A camera after its end.
pub(crate) struct StreamEnd {
    pub(crate) counts: Counts,
    pub(crate) summary: StreamSummary,
    /// How its source ended, or why the camera failed.
    pub(crate) source: anyhow::Result<SourceEnd>,
}

/// Runs each stream until its source ends, its pace's limit is reached, or `stop` is requested. Returns when
/// all have ended, in their order. If one fails, the others continue. Sinks notify `notify` when they have
/// room again.
pub(crate) fn run(streams: Vec<Stream>, notify: &Arc<Notify>, stop: &Stop) -> anyhow::Result<Vec<StreamEnd>> {
    let (mut sources, mut tasks, mut states) = (Vec::new(), Vec::new(), Vec::new());
    for Stream { source, pace, task, span } in streams {
        sources.push((source, pace));
        tasks.push(task);
        states.push(StreamState::new(stop.clone(), Arc::clone(notify), span));
    }
    let states = &states[..];
    let (summaries, ends) = std::thread::scope(|scope| {
        // If a thread cannot start, the threads before it must not run forever.
        let closed: Vec<_> = states.iter().map(CloseOnDrop).collect();
        let mut captures = Vec::with_capacity(states.len());
        for ((source, pace), state) in sources.iter_mut().zip(states) {
            let run = move || capture(source.as_mut(), *pace, state);
            let thread = named("capture").spawn_scoped(scope, run);
            captures.push(thread.context("cannot start the capture thread")?);
        }
        let janitor = named("janitor").spawn_scoped(scope, || clean_up(states));
        janitor.context("cannot start the cleanup thread")?;
        let summaries = round_robin::run_round_robin(tasks, states, notify);
        drop(closed);
        let failed = |_| anyhow::anyhow!("the capture thread panicked: see the lines above");
        let ends: Vec<_> =
            captures.into_iter().map(|capture| capture.join().map_err(failed).flatten()).collect();
        Ok::<_, anyhow::Error>((summaries, ends))
    })?;
    let ended = states.iter().zip(summaries).zip(ends).map(|((state, mut summary), source)| {
        let source = summary.failure.take().map_or(source, Err);
        StreamEnd { counts: state.ledger.counts(), summary, source }
    });
    Ok(ended.collect())
}

fn named(name: &str) -> std::thread::Builder {
    std::thread::Builder::new().name(name.into())
}

/// How soon the resources of a killed reader are released.
const CLEAN_UP_PERIOD: Duration = Duration::from_secs(1);

/// Releases the resources of killed readers, outside of the inference thread, until all mailboxes are closed.
fn clean_up(states: &[StreamState]) {
    // Resources that could not be released, such as damaged ones: cleaning up writes and syncs files each
    // time.
    let mut known = Vec::new();
    while !states.iter().all(|state| state.mailbox.wait_closed(CLEAN_UP_PERIOD)) {
        let found = orphans::list().unwrap_or_default();
        if found.is_empty() || found == known {
            continue;
        }
        if let Err(error) = orphans::clean() {
            debug!("cannot clean up after killed readers: {error}");
        }
        known = orphans::list().unwrap_or_default();
    }
}
