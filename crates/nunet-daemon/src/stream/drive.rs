//! The loop over a source, for `run`, `feed` and `replay`, which handle frames differently.

use std::num::NonZeroU64;
use std::ops::ControlFlow;
use std::time::Instant;

use nunet_telemetry::RateLimit;
use tracing::{error, warn};

use super::Stop;
use crate::config::SourceConfig;
use crate::source::{Fill, Frame, Pacer, Rate, Source};

/// How a source is asked for frames.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pace {
    /// How fast. A live source has its own pace.
    pub(crate) rate: Rate,
    /// How many frames are captured.
    pub(crate) limit: Option<NonZeroU64>,
}

impl Pace {
    /// Every frame, as fast as possible.
    pub(crate) const ALL: Self = Self { rate: Rate::Max, limit: None };

    /// As configured: by default every frame.
    pub(crate) fn of(source: &SourceConfig) -> Self {
        Self { rate: source.rate.unwrap_or(Rate::Max), limit: source.frames }
    }
}

/// How a source ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum SourceEnd {
    /// It has no more frames, or the limit was reached.
    Complete,
    /// A stop was requested before its end.
    Stopped,
    /// The rest of its frames is lost; the reason has been logged.
    Truncated,
}

/// Receives the frames of a source.
pub(crate) trait FrameHandler {
    /// A frame to be filled, whose memory is reused.
    fn buffer(&mut self) -> Frame {
        Frame::default()
    }

    /// Handles a frame; `Break` to end the loop.
    ///
    /// # Errors
    /// A failure that ends the run, not only the loss of this frame.
    fn on_frame(&mut self, frame: Frame) -> anyhow::Result<ControlFlow<()>>;

    /// An unreadable frame, which has been logged.
    fn on_lost(&mut self, frame: Frame);

    /// The source had no frame. If `is_crowded`, it lends its memory and waits for frames to be returned.
    fn on_idle(&mut self, _frame: Frame, _is_crowded: bool) {}

    /// Called after each request: whether the source waits for its device or publisher.
    fn on_source_state(&mut self, _is_waiting: bool) {}

    /// Whether it takes no more frames, checked before each request.
    fn is_closed(&self) -> bool {
        false
    }

    /// Called around each log line, so that a progress bar can be hidden.
    fn around_log(&self, log: &mut dyn FnMut()) {
        log();
    }
}

/// Moves frames from `source` to `handler` until the source ends, the pace's limit is reached, the handler is
/// closed, or `stop` is requested.
///
/// # Errors
/// The source broke, or the handler failed.
pub(crate) fn drive(
    source: &mut dyn Source,
    pace: Pace,
    stop: &Stop,
    handler: &mut dyn FrameHandler,
) -> anyhow::Result<SourceEnd> {
    let mut pacer = Pacer::new(pace.rate, Instant::now()).filter(|_| !source.is_live());
    let mut left = pace.limit.map_or(u64::MAX, NonZeroU64::get);
    let mut next_is_due = true;
    let mut lost = RateLimit::default();
    while left > 0 && !handler.is_closed() {
        if stop.requested() {
            return Ok(SourceEnd::Stopped);
        }
        if next_is_due && let Some(pacer) = &mut pacer {
            stop.sleep(pacer.wait(Instant::now()));
        }
        let mut frame = handler.buffer();
        frame.superseded = 0; // its memory is reused, and few sources state this
        let fill = source.fill(&mut frame);
        next_is_due = fill.had_frame();
        left -= u64::from(fill.had_frame());
        handler.on_source_state(source.is_waiting());
        if let ControlFlow::Break(end) = hand_over(fill, frame, handler, &mut lost, stop)? {
            return Ok(end);
        }
    }
    Ok(SourceEnd::Complete)
}

/// Passes the outcome of one request to `handler`; `Break` at the end.
fn hand_over(
    fill: Fill,
    frame: Frame,
    handler: &mut dyn FrameHandler,
    lost: &mut RateLimit,
    stop: &Stop,
) -> anyhow::Result<ControlFlow<SourceEnd>> {
    match fill {
        Fill::Frame => return Ok(handler.on_frame(frame)?.map_break(|()| SourceEnd::Complete)),
        Fill::Failed(error) => {
            if let Some(text) = lost.lost_frame(Instant::now(), frame.sequence, &error) {
                handler.around_log(&mut || warn!("{text}"));
            }
            handler.on_lost(frame);
        }
        Fill::Nothing => handler.on_idle(frame, false),
        Fill::Crowded => handler.on_idle(frame, true),
        Fill::End => return Ok(ControlFlow::Break(SourceEnd::Complete)),
        // Ctrl-C also ends the process that writes into the pipe, perhaps within an image.
        Fill::Cut(_) | Fill::Broken(_) if stop.requested() => {
            return Ok(ControlFlow::Break(SourceEnd::Stopped));
        }
        Fill::Cut(error) => {
            handler.around_log(&mut || error!("the source ends early: {error:#}"));
            return Ok(ControlFlow::Break(SourceEnd::Truncated));
        }
        Fill::Broken(error) => return Err(error.into()),
    }
    Ok(ControlFlow::Continue(()))
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use anyhow::bail;

    use super::*;
    use crate::source::SourceError;

    /// Frames by number with two idle requests before each; some are unreadable.
    struct Numbers {
        count: u64,
        requests: u64,
        bad: fn(u64) -> bool,
        end: fn() -> Fill,
    }

    impl Numbers {
        fn new(count: u64) -> Self {
            Self { count, requests: 0, bad: |_| false, end: || Fill::End }
        }
    }

    impl Source for Numbers {
        fn fill(&mut self, frame: &mut Frame) -> Fill {
            self.requests += 1;
            if !self.requests.is_multiple_of(3) {
                return Fill::Nothing;
            }
            frame.sequence = self.requests / 3 - 1;
            match frame.sequence {
                number if number >= self.count => (self.end)(),
                number if (self.bad)(number) => Fill::Failed(SourceError::bad_frame("unreadable")),
                _ => Fill::Frame,
            }
        }
    }

    /// Collects numbers; fails or stops at one of them.
    #[derive(Default)]
    struct Collector {
        seen: Vec<u64>,
        lost: Vec<u64>,
        idle: u64,
        fails_at: Option<u64>,
        breaks_at: Option<u64>,
        stops_at: Option<(u64, Stop)>,
    }

    impl FrameHandler for Collector {
        fn on_frame(&mut self, frame: Frame) -> anyhow::Result<ControlFlow<()>> {
            if self.fails_at == Some(frame.sequence) {
                bail!("the disk is full");
            }
            self.seen.push(frame.sequence);
            if let Some((at, stop)) = &self.stops_at
                && *at == frame.sequence
            {
                stop.request();
            }
            let is_last = self.breaks_at == Some(frame.sequence);
            Ok(if is_last { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
        }

        fn on_lost(&mut self, frame: Frame) {
            self.lost.push(frame.sequence);
        }

        fn on_idle(&mut self, _frame: Frame, _is_crowded: bool) {
            self.idle += 1;
        }
    }

    fn limited(limit: u64) -> Pace {
        Pace { limit: NonZeroU64::new(limit), ..Pace::ALL }
    }

    #[test]
    fn every_frame_is_handed_over_and_unreadable_ones_are_lost() {
        let mut source = Numbers { bad: |number| number % 2 == 1, ..Numbers::new(5) };
        let mut handler = Collector::default();
        let end = drive(&mut source, Pace::ALL, &Stop::default(), &mut handler).unwrap();
        assert_eq!((handler.seen, handler.lost, end), (vec![0, 2, 4], vec![1, 3], SourceEnd::Complete));
        assert_eq!(handler.idle, 12);
    }

    #[test]
    fn the_limit_counts_frames_readable_or_not_and_idle_requests_do_not_count() {
        let mut source = Numbers { bad: |number| number == 0, ..Numbers::new(100) };
        let mut handler = Collector::default();
        drive(&mut source, limited(3), &Stop::default(), &mut handler).unwrap();
        assert_eq!((handler.seen, handler.lost), (vec![1, 2], vec![0]));
    }

    #[test]
    fn the_rate_counts_frames_and_idle_requests_do_not_wait() {
        // Two idle requests before the first frame would wait 2000 s.
        let pace = Pace { rate: Rate::Hz(0.001), limit: NonZeroU64::new(1) };
        let (stop, mut handler) = (Stop::default(), Collector::default());
        std::thread::scope(|scope| {
            let (send, done) = std::sync::mpsc::channel();
            let (stop, handler) = (&stop, &mut handler);
            scope.spawn(move || {
                drive(&mut Numbers::new(5), pace, stop, handler).unwrap();
                send.send(handler.seen.len()).unwrap();
            });
            let seen = done.recv_timeout(Duration::from_secs(60));
            stop.request();
            assert_eq!(seen, Ok(1), "the first frame is due at once");
        });
    }

    #[test]
    fn a_handler_that_breaks_or_fails_or_a_stop_ends_the_loop() {
        let run = |mut handler: Collector, stop: &Stop| {
            let end = drive(&mut Numbers::new(9), Pace::ALL, stop, &mut handler);
            (end.map_err(|error| error.to_string()), handler.seen)
        };
        let stop = Stop::default();
        let broken = run(Collector { breaks_at: Some(1), ..Collector::default() }, &stop);
        assert_eq!(broken, (Ok(SourceEnd::Complete), vec![0, 1]));
        let failed = run(Collector { fails_at: Some(1), ..Collector::default() }, &stop);
        assert_eq!(failed, (Err("the disk is full".into()), vec![0]));
        let stopped = run(Collector { stops_at: Some((2, stop.clone())), ..Collector::default() }, &stop);
        assert_eq!(stopped, (Ok(SourceEnd::Stopped), vec![0, 1, 2]));
    }

    #[test]
    fn a_truncated_source_is_no_failure_and_a_broken_one_is() {
        let run = |end: fn() -> Fill| {
            let mut source = Numbers { end, ..Numbers::new(2) };
            drive(&mut source, Pace::ALL, &Stop::default(), &mut Collector::default())
        };
        assert_eq!(run(|| Fill::Cut(SourceError::bad_frame("half an image"))).unwrap(), SourceEnd::Truncated);
        assert_eq!(
            run(|| Fill::Broken(SourceError::bad_frame("another contract"))).unwrap_err().to_string(),
            "another contract"
        );
    }

    /// A pipe whose writer received the same Ctrl-C.
    struct Interrupted<'a>(&'a Stop, fn() -> Fill);

    impl Source for Interrupted<'_> {
        fn fill(&mut self, _frame: &mut Frame) -> Fill {
            self.0.request();
            (self.1)()
        }
    }

    #[test]
    fn a_source_that_ends_with_the_stop_lost_nothing() {
        for end in [(|| Fill::Broken(SourceError::bad_frame("no image"))) as fn() -> Fill, || {
            Fill::Cut(SourceError::bad_frame("half of one"))
        }] {
            let stop = Stop::default();
            let driven = drive(&mut Interrupted(&stop, end), Pace::ALL, &stop, &mut Collector::default());
            assert_eq!(driven.unwrap(), SourceEnd::Stopped);
        }
    }
}
