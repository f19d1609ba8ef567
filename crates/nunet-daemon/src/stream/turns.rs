//! The inference thread: the cameras take turns.

use std::time::Duration;

use super::bell::Bell;
use super::pump::Lane;
use super::worker::{Remains, Turn, Worker};
use crate::telemetry::{End, Supervisor};

/// How soon a reader that joins a source that stands still gets the last frame.
pub(super) const LATE_JOINER_PERIOD: Duration = Duration::from_millis(200);

/// Works until every mailbox is closed and empty; `lanes` are those of `workers`.
///
/// In each round every camera that has a new frame has one turn, in the same order: whatever the others send, a camera
/// waits for one frame of each of them at the most. A camera whose source has ended ends in its own turn.
pub(super) fn take_turns(workers: Vec<Worker>, lanes: &[Lane], bell: &Bell) -> Vec<Remains> {
    let mut supervisor = Supervisor::from_environment();
    supervisor.ready("the self-test has passed, frames may come");
    let mut workers: Vec<_> = workers.into_iter().map(|worker| Some(worker.begin())).collect();
    let mut remains: Vec<_> = lanes.iter().map(|_| None).collect();
    while workers.iter().any(Option::is_some) {
        let mut idle = true;
        for ((place, lane), remains) in workers.iter_mut().zip(lanes).zip(&mut remains) {
            let _camera = lane.span.enter();
            match place.as_mut().map(|worker| worker.turn(lane)) {
                Some(Turn::Frame(end)) => {
                    idle = false;
                    if end == End::Published {
                        supervisor.frame_done();
                    }
                }
                Some(Turn::Over) => *remains = place.take().map(Worker::end),
                Some(Turn::Nothing) | None => {}
            }
        }
        if idle && workers.iter().any(Option::is_some) {
            bell.wait(LATE_JOINER_PERIOD);
        }
    }
    Supervisor::stopping();
    remains.into_iter().flatten().collect()
}
