//! The inference thread: one frame of each camera in turn.

use nunet_ipc::LATE_JOINER_PERIOD;
use nunet_telemetry::{FrameEnd, Supervisor};

use super::state::StreamState;
use crate::source::Notify;

/// One camera's work on the inference thread.
pub(super) trait RoundRobinTask: Sized {
    /// The result after its end.
    type Summary;

    /// Called once before the first frame.
    fn begin(self) -> Self;

    /// Processes the waiting frame, if there is one. It must not wait: other cameras wait for it.
    fn poll(&mut self, state: &StreamState) -> Poll;

    /// Called once after the last frame.
    fn end(self, state: &StreamState) -> Self::Summary;
}

/// The outcome of one turn of a task.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Poll {
    /// It processed a frame.
    Frame(FrameEnd),
    /// It had no frame.
    Idle,
    /// It will get no more frames.
    Ended,
}

/// Runs until every mailbox is closed and empty; `states` are those of `tasks`.
///
/// In each round every camera that has a new frame has one turn, always in the same order: a camera waits for
/// one frame of each other camera at most. A camera whose source ended ends in its own turn.
pub(super) fn run_round_robin<T: RoundRobinTask>(
    tasks: Vec<T>,
    states: &[StreamState],
    notify: &Notify,
) -> Vec<T::Summary> {
    let mut supervisor = Supervisor::from_environment();
    supervisor.ready("the self-test passed; waiting for frames");
    let mut tasks: Vec<_> = tasks.into_iter().map(|task| Some(task.begin())).collect();
    let mut summaries: Vec<_> = states.iter().map(|_| None).collect();
    while tasks.iter().any(Option::is_some) {
        let mut is_idle = true;
        for ((slot, state), summary) in tasks.iter_mut().zip(states).zip(&mut summaries) {
            let _camera = state.span.enter();
            match slot.as_mut().map(|task| task.poll(state)) {
                Some(Poll::Frame(end)) => {
                    is_idle = false;
                    if end == FrameEnd::Published {
                        supervisor.frame_done();
                    }
                }
                Some(Poll::Ended) => *summary = slot.take().map(|task| task.end(state)),
                Some(Poll::Idle) | None => {}
            }
        }
        if is_idle && tasks.iter().any(Option::is_some) {
            let running = states.iter().zip(&tasks).filter(|(_, task)| task.is_some());
            report_idle(&mut supervisor, running.map(|(state, _)| state));
            notify.wait(LATE_JOINER_PERIOD);
        }
    }
    Supervisor::stopping();
    summaries.into_iter().flatten().collect()
}

/// No running camera had a frame, perhaps because each of them waits for its source.
fn report_idle<'a>(supervisor: &mut Supervisor, states: impl Iterator<Item = &'a StreamState> + Clone) {
    let captured = states.clone().map(|state| state.ledger.counts().captured).sum();
    let all_wait = states.clone().all(StreamState::has_reported_waiting);
    if supervisor.idle(all_wait, captured) {
        states.for_each(StreamState::forget_report);
    }
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;
    use std::rc::Rc;

    use super::*;

    /// Follows a script and writes down whose turn it was.
    struct Scripted {
        name: char,
        script: std::vec::IntoIter<Poll>,
        log: Rc<RefCell<String>>,
    }

    impl RoundRobinTask for Scripted {
        type Summary = char;

        fn begin(self) -> Self {
            self
        }

        fn poll(&mut self, _state: &StreamState) -> Poll {
            let poll = self.script.next().unwrap_or(Poll::Ended);
            if matches!(poll, Poll::Frame(_)) {
                self.log.borrow_mut().push(self.name);
            }
            poll
        }

        fn end(self, _state: &StreamState) -> char {
            self.name.to_ascii_uppercase()
        }
    }

    fn run(scripts: &[(char, Vec<Poll>)]) -> (String, Vec<char>) {
        let log = Rc::new(RefCell::new(String::new()));
        let task = |(name, script): &(char, Vec<Poll>)| Scripted {
            name: *name,
            script: script.clone().into_iter(),
            log: Rc::clone(&log),
        };
        let states: Vec<_> = scripts.iter().map(|_| StreamState::default()).collect();
        let notify = Notify::default();
        notify.notify();
        let summaries = run_round_robin(scripts.iter().map(task).collect(), &states, &notify);
        (log.take(), summaries)
    }

    const FRAME: Poll = Poll::Frame(FrameEnd::Published);

    #[test]
    fn cameras_that_always_have_a_frame_take_turns() {
        let slow = vec![Poll::Idle, FRAME, Poll::Idle, Poll::Idle, FRAME];
        let (log, summaries) = run(&[('f', vec![FRAME; 6]), ('s', slow), ('g', vec![FRAME; 2])]);
        assert_eq!(log, ["fg", "fsg", "f", "f", "fs", "f"].concat(), "one turn per round, in the same order");
        assert_eq!(summaries, ['F', 'S', 'G']);
    }

    #[test]
    fn a_failed_frame_is_a_turn_too_and_an_ended_camera_is_not_polled_again() {
        let failing = vec![Poll::Frame(FrameEnd::Failed); 3];
        let (log, summaries) = run(&[('a', Vec::new()), ('b', failing), ('c', vec![FRAME; 2])]);
        assert_eq!(log, "bcbcb");
        assert_eq!(summaries, ['A', 'B', 'C']);
    }
}
