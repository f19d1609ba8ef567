//! The inference thread: the cameras take turns.

use nunet_ipc::LATE_JOINER_PERIOD;

use super::bell::Bell;
use super::pump::Lane;
use crate::telemetry::{End, Supervisor};

/// Who takes turns.
pub(super) trait Player: Sized {
    /// What is left of it.
    type Remains;

    /// Frames may come from now on.
    fn begin(self) -> Self;

    /// Never waits for anything but the arithmetic of its own frame: the others wait for it.
    fn turn(&mut self, lane: &Lane) -> Turn;

    /// There are no more frames.
    fn end(self, lane: &Lane) -> Self::Remains;
}

/// What a camera did when it was its turn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Turn {
    /// A frame's journey.
    Frame(End),
    /// There was none.
    Nothing,
    /// There will be none any more.
    Over,
}

/// Works until every mailbox is closed and empty; `lanes` are those of `workers`.
///
/// In each round every camera that has a new frame has one turn, in the same order: whatever the others send, a camera
/// waits for one frame of each of them at the most. A camera whose source has ended ends in its own turn.
pub(super) fn take_turns<P: Player>(workers: Vec<P>, lanes: &[Lane], bell: &Bell) -> Vec<P::Remains> {
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
                Some(Turn::Over) => *remains = place.take().map(|worker| worker.end(lane)),
                Some(Turn::Nothing) | None => {}
            }
        }
        if idle && workers.iter().any(Option::is_some) {
            let left = lanes.iter().zip(&workers).filter(|(_, worker)| worker.is_some());
            rest(&mut supervisor, left.map(|(lane, _)| lane));
            bell.wait(LATE_JOINER_PERIOD);
        }
    }
    Supervisor::stopping();
    remains.into_iter().flatten().collect()
}

/// No camera of those that are left had a frame; perhaps since each of them waits for its source.
fn rest<'a>(supervisor: &mut Supervisor, lanes: impl Iterator<Item = &'a Lane> + Clone) {
    let captured = lanes.clone().map(|lane| lane.ledger.counts().captured).sum();
    let waiting = lanes.clone().all(Lane::says_it_waits);
    if supervisor.nothing_to_do(waiting, captured) {
        lanes.for_each(Lane::ask_anew);
    }
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;
    use std::rc::Rc;

    use super::*;

    /// Does what it was told, and writes down whose turn it was.
    struct Scripted {
        name: char,
        script: std::vec::IntoIter<Turn>,
        log: Rc<RefCell<String>>,
    }

    impl Player for Scripted {
        type Remains = char;

        fn begin(self) -> Self {
            self
        }

        fn turn(&mut self, _lane: &Lane) -> Turn {
            let turn = self.script.next().unwrap_or(Turn::Over);
            if matches!(turn, Turn::Frame(_)) {
                self.log.borrow_mut().push(self.name);
            }
            turn
        }

        fn end(self, _lane: &Lane) -> char {
            self.name.to_ascii_uppercase()
        }
    }

    fn play(scripts: &[(char, Vec<Turn>)]) -> (String, Vec<char>) {
        let log = Rc::new(RefCell::new(String::new()));
        let player = |(name, script): &(char, Vec<Turn>)| Scripted {
            name: *name,
            script: script.clone().into_iter(),
            log: Rc::clone(&log),
        };
        let lanes: Vec<_> = scripts.iter().map(|_| Lane::default()).collect();
        let bell = Bell::default();
        bell.ring();
        let remains = take_turns(scripts.iter().map(player).collect(), &lanes, &bell);
        (log.take(), remains)
    }

    const FRAME: Turn = Turn::Frame(End::Published);

    #[test]
    fn a_camera_that_always_has_a_frame_waits_for_one_of_each_other_and_they_for_one_of_it() {
        let slow = vec![Turn::Nothing, FRAME, Turn::Nothing, Turn::Nothing, FRAME];
        let (log, remains) = play(&[('f', vec![FRAME; 6]), ('s', slow), ('g', vec![FRAME; 2])]);
        assert_eq!(log, ["fg", "fsg", "f", "f", "fs", "f"].concat(), "a round each, in the same order");
        assert_eq!(remains, ['F', 'S', 'G']);
    }

    #[test]
    fn a_frame_that_failed_is_a_turn_too_and_who_is_over_is_not_asked_again() {
        let failing = vec![Turn::Frame(End::Failed); 3];
        let (log, remains) = play(&[('a', Vec::new()), ('b', failing), ('c', vec![FRAME; 2])]);
        assert_eq!(log, "bcbcb");
        assert_eq!(remains, ['A', 'B', 'C']);
    }
}
