//! The capture thread: moves frames from the source into the mailbox.

use std::ops::ControlFlow;
use std::time::Duration;

use nunet_core::clock::Clock as _;
use nunet_engine::MonotonicClock;
use nunet_telemetry::FrameEnd;
use tracing::info;

use super::drive::{FrameHandler, Pace, SourceEnd, drive};
use super::state::{CloseOnDrop, StreamState};
use crate::source::{Frame, Put, Rate, Source};

/// How long to wait for a lent frame to be returned.
const CROWDED_PAUSE: Duration = Duration::from_millis(1);

/// Moves frames from `source` into the mailbox until the source ends, the limit is reached, or a stop is
/// requested; then closes the mailbox.
///
/// # Errors
/// The source broke.
pub(crate) fn capture(source: &mut dyn Source, pace: Pace, state: &StreamState) -> anyhow::Result<SourceEnd> {
    let _camera = state.span.enter();
    let _closed = CloseOnDrop(state);
    let latest_wins = source.is_live() || pace.rate != Rate::Max;
    let end = drive(source, pace, &state.stop, &mut MailboxFiller { state, latest_wins })?;
    supersede_when_stopped(state);
    Ok(end)
}

struct MailboxFiller<'a> {
    state: &'a StreamState,
    /// Whether a newer frame replaces the waiting one; otherwise the source waits.
    latest_wins: bool,
}

impl FrameHandler for MailboxFiller<'_> {
    fn buffer(&mut self) -> Frame {
        self.state.mailbox.used().unwrap_or_default()
    }

    fn on_frame(&mut self, mut frame: Frame) -> anyhow::Result<ControlFlow<()>> {
        let StreamState { mailbox, ledger, stop, .. } = self.state;
        ledger.superseded(frame.superseded);
        ledger.captured();
        frame.ready_nanos = MonotonicClock.nanos();
        frame.in_real_time = self.latest_wins;
        let put = if self.latest_wins {
            mailbox.put_latest(frame)
        } else {
            mailbox.put_waiting(frame, || stop.requested())
        };
        if put != Put::Accepted {
            ledger.ended(FrameEnd::Superseded);
        }
        Ok(if put == Put::Refused { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
    }

    fn on_lost(&mut self, frame: Frame) {
        self.state.ledger.superseded(frame.superseded);
        self.state.ledger.captured();
        self.state.ledger.ended(FrameEnd::Failed);
        self.state.mailbox.give_back(frame);
    }

    /// If the source lends no more frames, the waiting frame is dropped for a newer one. If none waits, the
    /// one being processed will be returned soon, and the one that is kept for late readers is requested.
    fn on_idle(&mut self, frame: Frame, is_crowded: bool) {
        let StreamState { mailbox, ledger, stop, .. } = self.state;
        mailbox.give_back(frame);
        match is_crowded {
            true if mailbox.recall() => ledger.ended(FrameEnd::Superseded),
            true => {
                self.state.request_frame();
                stop.sleep(CROWDED_PAUSE);
            }
            false => {}
        }
    }

    fn on_source_state(&mut self, is_waiting: bool) {
        self.state.report_waiting(is_waiting);
    }

    fn is_closed(&self) -> bool {
        self.state.mailbox.wait_closed(Duration::ZERO)
    }
}

/// After a stop, the current frame is finished, and the waiting one is superseded.
fn supersede_when_stopped(state: &StreamState) {
    if state.stop.requested() {
        info!("stopping");
        if state.mailbox.close_and_empty() {
            state.ledger.ended(FrameEnd::Superseded);
        }
    }
}

#[cfg(test)]
mod tests {
    use nunet_ipc::{Encoding, Limits, Publisher, Topic, TopicPlan, monotonic_nanos};
    use nunet_telemetry::Counts;
    use std::num::NonZeroU64;
    use std::time::Instant;

    use super::*;
    use crate::exit::camera_name;
    use crate::source::{Fill, OpenOptions, SourceName, Taken};

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
            if (self.bad)(frame.sequence) {
                Fill::Failed(crate::source::SourceError::bad_frame("unreadable"))
            } else {
                Fill::Frame
            }
        }

        fn is_live(&self) -> bool {
            self.live
        }
    }

    fn run(mut source: Numbers, limit: Option<u64>, per_frame: Duration) -> (Vec<u64>, Counts) {
        let state = StreamState::default();
        let pace = Pace { rate: Rate::Max, limit: limit.and_then(NonZeroU64::new) };
        let mut seen = Vec::new();
        std::thread::scope(|scope| {
            scope.spawn(|| capture(&mut source, pace, &state).unwrap());
            while let Taken::Item(frame) = state.mailbox.take(Duration::from_secs(60)) {
                seen.push(frame.sequence);
                std::thread::sleep(per_frame);
                state.ledger.ended(FrameEnd::Published);
                state.mailbox.give_back(frame);
            }
        });
        (seen, state.ledger.counts())
    }

    #[test]
    fn frames_are_real_time_except_from_a_file_source_that_waits() {
        for (live, rate, expected) in
            [(true, Rate::Max, true), (false, Rate::Hz(1000.0), true), (false, Rate::Max, false)]
        {
            let state = StreamState::default();
            let mut source = Numbers { count: 1, next: 0, live, bad: |_| false };
            capture(&mut source, Pace { rate, limit: None }, &state).unwrap();
            let Taken::Item(frame) = state.mailbox.take(Duration::ZERO) else { panic!("one frame waits") };
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
    fn the_latest_frame_of_a_live_source_wins_and_the_others_are_superseded() {
        let source = Numbers { count: 1000, next: 0, live: true, bad: |_| false };
        let (seen, counts) = run(source, None, Duration::from_millis(5));
        assert_eq!(seen.last(), Some(&999), "the newest frame is never the one that is dropped");
        assert!(counts.superseded > 0);
        assert_eq!(counts.published + counts.superseded, 1000);
        assert!(counts.balances() && counts.in_flight == 0);
    }

    /// An unreadable frame that replaced two, one that states nothing, a frame that replaced one, and the
    /// end.
    struct Replacing(u64);

    impl Source for Replacing {
        fn fill(&mut self, frame: &mut Frame) -> Fill {
            self.0 += 1;
            match self.0 {
                1 => frame.superseded = 2,
                3 => frame.superseded = 1,
                _ => {}
            }
            match self.0 {
                1 | 2 => Fill::Failed(crate::source::SourceError::bad_frame("unreadable")),
                3 => Fill::Frame,
                _ => Fill::End,
            }
        }
    }

    #[test]
    fn frames_that_were_replaced_within_the_source_are_superseded() {
        let state = StreamState::default();
        capture(&mut Replacing(0), Pace::ALL, &state).unwrap();
        let expected = Counts { captured: 6, superseded: 3, failed: 2, in_flight: 1, ..Counts::default() };
        assert_eq!(state.ledger.counts(), expected);
    }

    /// They are lent at once, so that the mailbox replaces them. Their numbers may skip some that were never
    /// sent.
    #[test]
    fn frames_in_shared_memory_that_newer_ones_replace_are_superseded_and_skipped_numbers_are_not() {
        nunet_ipc::use_root(&nunet_testkit::ipc_root()).unwrap();
        let camera = camera_name(&format!("replaced_{}", std::process::id())).unwrap();
        let plan = TopicPlan { topic: Topic::Rgb, payload_bytes: 4 };
        let publisher = Publisher::create(&camera, &[plan], &Limits::default()).unwrap();
        let mut source = SourceName::parse(&format!("shm:{camera}")).open(OpenOptions::default()).unwrap();
        let state = StreamState::default();
        let send = |sequence, captured| {
            let mut loan = publisher.loan(Topic::Rgb).unwrap();
            let header = loan.header_mut();
            (header.sequence, header.width, header.height, header.row_stride_bytes) = (sequence, 2, 2, 2);
            header.set_encoding(Encoding::Mono8);
            loan.publish(monotonic_nanos()).unwrap();
            let start = Instant::now();
            while state.ledger.counts().captured < captured {
                assert!(start.elapsed() < Duration::from_secs(60), "frame {sequence} never came");
                publisher.refresh().unwrap(); // for the source, which connects late
                std::thread::sleep(Duration::from_millis(1));
            }
        };
        std::thread::scope(|scope| {
            let _closed = CloseOnDrop(&state); // a test that fails comes to its end as well
            scope.spawn(|| capture(source.as_mut(), Pace::ALL, &state).unwrap());
            send(7, 1);
            let _processed = state.mailbox.take(Duration::from_secs(60));
            for (sequence, captured) in [(8, 2), (20, 3), (21, 4), (50, 5)] {
                send(sequence, captured);
            }
            let waiting = state.mailbox.take(Duration::from_secs(60));
            assert!(matches!(waiting, Taken::Item(Frame { sequence: 50, .. })), "the newest is not replaced");
        });
        let expected = Counts { captured: 5, superseded: 3, in_flight: 2, ..Counts::default() };
        assert_eq!(state.ledger.counts(), expected);
    }

    #[test]
    fn a_stop_supersedes_the_waiting_frame() {
        let state = StreamState::default();
        state.ledger.captured();
        state.mailbox.put_latest(Frame::default());
        state.stop.request();
        let mut source = Numbers { count: 5, next: 0, live: false, bad: |_| false };
        capture(&mut source, Pace::ALL, &state).unwrap();
        assert_eq!(state.ledger.counts(), Counts { captured: 1, superseded: 1, ..Counts::default() });
        assert!(matches!(state.mailbox.take(Duration::ZERO), Taken::Closed));
    }

    #[test]
    fn a_stop_while_the_source_waits_for_room_supersedes_both_waiting_frames() {
        let state = StreamState::default();
        let mut source = Numbers { count: 5, next: 0, live: false, bad: |_| false };
        let (done, ended) = std::sync::mpsc::channel();
        std::thread::scope(|scope| {
            let _closed = CloseOnDrop(&state); // a test that fails comes to its end as well
            let state = &state;
            scope.spawn(move || done.send(capture(&mut source, Pace::ALL, state)));
            let start = Instant::now();
            while state.ledger.counts().captured < 2 {
                assert!(start.elapsed() < Duration::from_secs(60), "the second frame was never asked for");
                std::thread::sleep(Duration::from_millis(1));
            }
            state.stop.request();
            let end = ended.recv_timeout(Duration::from_secs(60)).expect("the stop was not seen");
            end.unwrap();
        });
        assert_eq!(state.ledger.counts(), Counts { captured: 2, superseded: 2, ..Counts::default() });
        assert!(matches!(state.mailbox.take(Duration::ZERO), Taken::Closed));
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
            (|| Fill::Broken(crate::source::SourceError::bad_frame("another contract")), false),
        ] {
            let state = StreamState::default();
            let ended = std::thread::scope(|scope| {
                let capture = scope.spawn(|| capture(&mut Failing(fail), Pace::ALL, &state));
                assert!(matches!(state.mailbox.take(Duration::from_secs(60)), Taken::Closed));
                capture.join()
            });
            assert_eq!(ended.is_err(), panics);
            assert!(ended.map_or(true, |result| result.is_err()));
        }
    }

    #[test]
    fn an_endless_capture_ends_with_the_inference_thread() {
        let state = StreamState::default();
        let mut source = Numbers { count: u64::MAX, next: 0, live: false, bad: |_| false };
        std::thread::scope(|scope| {
            let capture = scope.spawn(|| capture(&mut source, Pace::ALL, &state));
            drop(CloseOnDrop(&state));
            capture.join().unwrap().unwrap();
        });
        assert!(state.ledger.counts().balances());
    }
}
