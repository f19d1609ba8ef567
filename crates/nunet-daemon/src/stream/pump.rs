//! The source's thread: asks for frames and puts them into the mailbox.

use std::num::NonZeroU64;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use nunet_core::clock::Clock as _;
use tracing::{Span, error, info, warn};

use super::bell::Bell;
use super::mailbox::{Mailbox, Put};
use super::stop::Stop;
use crate::source::{Fill, Frame, Pacer, Rate, Source};
use crate::telemetry::{End, Ledger, MonotonicClock};

/// How long to wait for a lent frame to come back.
const CROWDED_PAUSE: Duration = Duration::from_millis(1);

/// How a source is asked for frames.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pace {
    /// How fast, for a source that has all its frames.
    pub(crate) rate: Rate,
    /// How many frames are captured.
    pub(crate) limit: Option<NonZeroU64>,
}

/// What both ends of a camera's mailbox share.
#[derive(Debug)]
pub(crate) struct Lane {
    pub(crate) mailbox: Mailbox<Frame>,
    pub(crate) ledger: Ledger,
    pub(crate) stop: Stop,
    /// Says in log lines which camera is meant, where there are several.
    pub(crate) span: Span,
    waiting: AtomicBool,
    said: AtomicBool,
}

impl Lane {
    pub(crate) fn new(stop: Stop, bell: Arc<Bell>, span: Span) -> Self {
        let mailbox = Mailbox::with_bell(bell);
        let (waiting, said) = (false.into(), false.into());
        Self { mailbox, ledger: Ledger::default(), stop, span, waiting, said }
    }

    /// Whether the source has lost what gives it frames, and waits for it.
    pub(crate) fn is_waiting(&self) -> bool {
        self.waiting.load(Ordering::Relaxed)
    }

    /// Whether the source has said since [`Lane::ask_anew`] that it waits, and nothing else later: one that hangs says
    /// nothing.
    pub(super) fn says_it_waits(&self) -> bool {
        self.said.load(Ordering::Relaxed)
    }

    /// What was said is to be said again.
    pub(super) fn ask_anew(&self) {
        self.said.store(false, Ordering::Relaxed);
    }

    fn hear(&self, waiting: bool) {
        self.waiting.store(waiting, Ordering::Relaxed);
        self.said.store(waiting, Ordering::Relaxed);
    }
}

/// How a source ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum SourceEnd {
    /// Every frame of it was asked for, or no more were wanted.
    Whole,
    /// The rest of it is lost; the reason has been logged.
    Cut,
}

/// Closes the mailbox when one of its ends goes away, also by a panic: the other end must not wait for ever.
pub(crate) struct CloseOnDrop<'a>(pub(crate) &'a Lane);

impl Drop for CloseOnDrop<'_> {
    fn drop(&mut self) {
        self.0.mailbox.close();
    }
}

/// Moves frames from `source` into the lane's mailbox until the source ends, the limit is reached, or a stop is
/// requested; then closes the mailbox.
///
/// # Errors
/// The source broke.
pub(crate) fn pump(source: &mut dyn Source, pace: Pace, lane: &Lane) -> anyhow::Result<SourceEnd> {
    let mut end = SourceEnd::Whole;
    let _camera = lane.span.enter();
    let _closed = CloseOnDrop(lane);
    let latest_wins = source.is_live() || pace.rate != Rate::Max;
    let mut pacer = Pacer::new(pace.rate, Instant::now()).filter(|_| !source.is_live());
    let mut left = pace.limit.map_or(u64::MAX, NonZeroU64::get);
    let mut next_is_due = true;
    while left > 0 && !lane.stop.requested() && !lane.mailbox.wait_closed(Duration::ZERO) {
        if next_is_due && let Some(pacer) = &mut pacer {
            lane.stop.sleep(pacer.wait(Instant::now()));
        }
        let mut frame = lane.mailbox.used().unwrap_or_default();
        let fill = source.fill(&mut frame);
        next_is_due = fill.had_frame();
        lane.hear(source.is_waiting());
        match fill {
            Fill::Frame => {
                left -= 1;
                if !hand_over(frame, latest_wins, lane) {
                    break;
                }
            }
            Fill::Failed(error) => {
                left -= 1;
                warn!("frame {} is lost: {error:#}", frame.sequence);
                lane.ledger.captured();
                lane.ledger.ended(End::Failed);
                lane.mailbox.give_back(frame);
            }
            Fill::Nothing => lane.mailbox.give_back(frame),
            Fill::Crowded => make_room(frame, lane),
            Fill::End => break,
            // Ctrl-C also ends whoever writes into a pipe, in the middle of a picture or before the first.
            Fill::Cut(_) | Fill::Broken(_) if lane.stop.requested() => break,
            Fill::Cut(error) => {
                error!("the source ends early: {error:#}");
                end = SourceEnd::Cut;
                break;
            }
            Fill::Broken(error) => return Err(error),
        }
    }
    supersede_when_stopped(lane);
    Ok(end)
}

/// Returns whether the mailbox still takes frames.
fn hand_over(mut frame: Frame, latest_wins: bool, lane: &Lane) -> bool {
    lane.ledger.captured();
    frame.ready_nanos = MonotonicClock.nanos();
    frame.in_real_time = latest_wins;
    let put = if latest_wins {
        lane.mailbox.put_latest(frame)
    } else {
        lane.mailbox.put_waiting(frame, || lane.stop.requested())
    };
    if put != Put::Accepted {
        lane.ledger.ended(End::Superseded);
    }
    put != Put::Refused
}

/// The source lends no more frames: the one that waits makes room for a newer one. Where none waits, the one in work
/// will be back soon.
fn make_room(frame: Frame, lane: &Lane) {
    lane.mailbox.give_back(frame);
    if lane.mailbox.recall() {
        lane.ledger.ended(End::Superseded);
    } else {
        lane.stop.sleep(CROWDED_PAUSE);
    }
}

/// A stop finishes the frame in work, not the one that waits.
fn supersede_when_stopped(lane: &Lane) {
    if lane.stop.requested() {
        info!("stopping");
        if lane.mailbox.close_and_empty() {
            lane.ledger.ended(End::Superseded);
        }
    }
}

#[cfg(test)]
mod tests {
    use anyhow::anyhow;

    use super::*;
    use crate::stream::Taken;
    use crate::telemetry::Counts;

    impl Default for Lane {
        fn default() -> Self {
            Self::new(Stop::default(), Arc::default(), Span::none())
        }
    }

    /// Frames by number; some are unreadable; the end comes after `count`.
    struct Numbers {
        count: u64,
        next: u64,
        live: bool,
        bad: fn(u64) -> bool,
    }

    impl Source for Numbers {
        fn fill(&mut self, frame: &mut Frame) -> Fill {
            if self.next == self.count {
                return Fill::End;
            }
            frame.sequence = self.next;
            self.next += 1;
            if (self.bad)(frame.sequence) { Fill::Failed(anyhow!("unreadable")) } else { Fill::Frame }
        }

        fn is_live(&self) -> bool {
            self.live
        }
    }

    fn run(mut source: Numbers, limit: Option<u64>, per_frame: Duration) -> (Vec<u64>, Counts) {
        let lane = Lane::default();
        let pace = Pace { rate: Rate::Max, limit: limit.and_then(NonZeroU64::new) };
        let mut seen = Vec::new();
        std::thread::scope(|scope| {
            scope.spawn(|| pump(&mut source, pace, &lane).unwrap());
            while let Taken::Item(frame) = lane.mailbox.take(Duration::from_secs(60)) {
                seen.push(frame.sequence);
                std::thread::sleep(per_frame);
                lane.ledger.ended(End::Published);
                lane.mailbox.give_back(frame);
            }
        });
        (seen, lane.ledger.counts())
    }

    #[test]
    fn frames_come_in_real_time_but_for_a_file_source_that_waits() {
        for (live, rate, expected) in
            [(true, Rate::Max, true), (false, Rate::Hz(1000.0), true), (false, Rate::Max, false)]
        {
            let lane = Lane::default();
            let mut source = Numbers { count: 1, next: 0, live, bad: |_| false };
            pump(&mut source, Pace { rate, limit: None }, &lane).unwrap();
            let Taken::Item(frame) = lane.mailbox.take(Duration::ZERO) else { panic!("one frame waits") };
            assert_eq!(frame.in_real_time, expected, "{rate:?}, live: {live}");
        }
    }

    #[test]
    fn every_frame_of_a_file_source_arrives_and_bad_ones_are_counted() {
        let source = Numbers { count: 10, next: 0, live: false, bad: |number| number % 4 == 1 };
        let (seen, counts) = run(source, None, Duration::from_millis(1));
        assert_eq!(seen, [0, 2, 3, 4, 6, 7, 8]);
        assert_eq!(counts, Counts { captured: 10, published: 7, failed: 3, ..Counts::default() });
    }

    #[test]
    fn of_a_live_source_the_latest_frame_wins_and_the_others_are_superseded() {
        let source = Numbers { count: 1000, next: 0, live: true, bad: |_| false };
        let (seen, counts) = run(source, None, Duration::from_millis(5));
        assert_eq!(seen.last(), Some(&999), "the newest frame is never the one that is dropped");
        assert!(counts.superseded > 0);
        assert_eq!(counts.published + counts.superseded, 1000);
        assert!(counts.balances() && counts.in_flight == 0);
    }

    /// Frames with a silence before each, as between the pictures of a recording with many topics.
    struct Sparse(u64);

    impl Source for Sparse {
        fn fill(&mut self, _frame: &mut Frame) -> Fill {
            self.0 += 1;
            if self.0.is_multiple_of(10) { Fill::Frame } else { Fill::Nothing }
        }
    }

    #[test]
    fn a_rate_is_of_frames_and_silence_costs_no_turn() {
        let lane = Lane::default();
        // Nobody waits for a second turn of this rate.
        let pace = Pace { rate: Rate::Hz(0.001), limit: NonZeroU64::new(1) };
        std::thread::scope(|scope| {
            scope.spawn(|| pump(&mut Sparse(0), pace, &lane).unwrap());
            let taken = lane.mailbox.take(Duration::from_secs(60));
            lane.stop.request();
            assert!(matches!(taken, Taken::Item(_)), "the first frame is due at once");
        });
    }

    #[test]
    fn the_limit_counts_captured_frames_readable_or_not() {
        let source = Numbers { count: 100, next: 0, live: false, bad: |number| number == 0 };
        let (seen, counts) = run(source, Some(3), Duration::ZERO);
        assert_eq!(seen, [1, 2]);
        assert_eq!(counts.captured, 3);
    }

    #[test]
    fn a_stop_supersedes_the_frame_that_waits() {
        let lane = Lane::default();
        lane.ledger.captured();
        lane.mailbox.put_latest(Frame::default());
        lane.stop.request();
        let mut source = Numbers { count: 5, next: 0, live: false, bad: |_| false };
        pump(&mut source, Pace { rate: Rate::Max, limit: None }, &lane).unwrap();
        assert_eq!(lane.ledger.counts(), Counts { captured: 1, superseded: 1, ..Counts::default() });
        assert!(matches!(lane.mailbox.take(Duration::ZERO), Taken::Closed));
    }

    #[test]
    fn a_stop_while_the_source_waits_for_room_supersedes_the_frame_that_waits_and_the_one_behind_it() {
        let lane = Lane::default();
        let mut source = Numbers { count: 5, next: 0, live: false, bad: |_| false };
        let (done, ended) = std::sync::mpsc::channel();
        std::thread::scope(|scope| {
            let _closed = CloseOnDrop(&lane); // a test that fails comes to its end as well
            let lane = &lane;
            scope.spawn(move || done.send(pump(&mut source, Pace { rate: Rate::Max, limit: None }, lane)));
            let start = Instant::now();
            while lane.ledger.counts().captured < 2 {
                assert!(start.elapsed() < Duration::from_secs(60), "the second frame was never asked for");
                std::thread::sleep(Duration::from_millis(1));
            }
            lane.stop.request();
            let end = ended.recv_timeout(Duration::from_secs(60)).expect("the stop was not seen");
            assert_eq!(end.unwrap(), SourceEnd::Whole);
        });
        assert_eq!(lane.ledger.counts(), Counts { captured: 2, superseded: 2, ..Counts::default() });
        assert!(matches!(lane.mailbox.take(Duration::ZERO), Taken::Closed));
    }

    #[test]
    fn what_a_source_says_of_its_waiting_counts_until_it_is_asked_anew() {
        let lane = Lane::default();
        lane.hear(true);
        assert!(lane.is_waiting() && lane.says_it_waits());
        lane.ask_anew();
        assert!(lane.is_waiting() && !lane.says_it_waits(), "it may hang by now");
        lane.hear(true);
        assert!(lane.says_it_waits());
        lane.hear(false);
        assert!(!lane.is_waiting() && !lane.says_it_waits());
    }

    /// Fails in one way or the other at the first frame.
    struct Failing(fn() -> Fill);

    impl Source for Failing {
        fn fill(&mut self, _frame: &mut Frame) -> Fill {
            (self.0)()
        }
    }

    #[test]
    fn a_source_that_panics_or_breaks_closes_the_mailbox() {
        for (fail, panics) in [
            ((|| panic!("a decoder's bug")) as fn() -> Fill, true),
            (|| Fill::Broken(anyhow!("another contract")), false),
        ] {
            let lane = Lane::default();
            let pace = Pace { rate: Rate::Max, limit: None };
            let ended = std::thread::scope(|scope| {
                let capture = scope.spawn(|| pump(&mut Failing(fail), pace, &lane));
                assert!(matches!(lane.mailbox.take(Duration::from_secs(60)), Taken::Closed));
                capture.join()
            });
            assert_eq!(ended.is_err(), panics);
            assert!(ended.map_or(true, |result| result.is_err()));
        }
    }

    /// A pipe whose writer heard the same Ctrl-C.
    struct Interrupted<'a>(&'a Lane, fn() -> Fill);

    impl Source for Interrupted<'_> {
        fn fill(&mut self, _frame: &mut Frame) -> Fill {
            self.0.stop.request();
            (self.1)()
        }
    }

    #[test]
    fn a_source_that_ends_with_the_stop_has_lost_nothing() {
        for end in
            [(|| Fill::Broken(anyhow!("no picture"))) as fn() -> Fill, || Fill::Cut(anyhow!("half of one"))]
        {
            let lane = Lane::default();
            let pace = Pace { rate: Rate::Max, limit: None };
            assert_eq!(pump(&mut Interrupted(&lane, end), pace, &lane).unwrap(), SourceEnd::Whole);
        }
    }

    #[test]
    fn a_worker_that_goes_away_ends_the_capture_of_an_endless_source() {
        let lane = Lane::default();
        let mut source = Numbers { count: u64::MAX, next: 0, live: false, bad: |_| false };
        std::thread::scope(|scope| {
            let capture = scope.spawn(|| pump(&mut source, Pace { rate: Rate::Max, limit: None }, &lane));
            drop(CloseOnDrop(&lane));
            capture.join().unwrap().unwrap();
        });
        let counts = lane.ledger.counts();
        assert!(counts.balances());
    }
}
