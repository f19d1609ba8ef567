//! Where a stream breaks. A network with a memory sees each frame as the successor of the last one; where it is not,
//! the memory is of another place or time, and worse than none.

use std::fmt;

use nunet_core::camera::Camera;
use nunet_ipc::Clock;

use crate::source::Frame;

/// The longest time between two frames that belong together. A robot at walking pace has moved by its own length by
/// then; a camera that drops some frames has not come near it.
const MAX_GAP_NANOS: i64 = 1_000_000_000;

/// Follows a stream from one frame that the network took to the next.
#[derive(Debug, Default)]
pub(crate) struct Continuity {
    last: Option<Seen>,
}

/// What is compared of a frame.
#[derive(Debug, Clone, Copy)]
struct Seen {
    stretch: u64,
    sequence: u64,
    size: (u32, u32),
    camera: Option<Camera>,
    clock: Clock,
    nanos: i64,
}

/// Why a frame does not follow the one before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Jump {
    /// The source began again from its start.
    Repeated,
    /// The source counts its frames from a smaller number: another process publishes now.
    Restarted,
    /// Pictures of another size.
    Size,
    /// Another camera, or another focal length.
    Camera,
    /// Capture times are of another clock, and cannot be compared.
    Clock,
    /// Capture time ran backwards.
    Backwards,
    /// Too long a time between the frames, nanoseconds.
    Gap(i64),
}

impl Continuity {
    /// Why `frame` does not follow the last one that the network took; `None` where it does, and for the first.
    ///
    /// Frames that were superseded or failed in between change nothing: the network has not seen them, and the time
    /// that passes with them counts.
    pub(crate) fn jump_to(&self, frame: &Frame) -> Option<Jump> {
        let (last, next) = (self.last?, Seen::of(frame));
        let gap_nanos = next.nanos.saturating_sub(last.nanos);
        let jumps = [
            (next.stretch != last.stretch, Jump::Repeated),
            // Equal numbers say nothing: not every publisher counts.
            (next.sequence < last.sequence, Jump::Restarted),
            (next.size != last.size, Jump::Size),
            (next.camera != last.camera, Jump::Camera),
            (next.clock != last.clock, Jump::Clock),
            (gap_nanos < 0, Jump::Backwards),
            (seen_in_time(frame) && gap_nanos > MAX_GAP_NANOS, Jump::Gap(gap_nanos)),
        ];
        jumps.into_iter().find_map(|(is_so, jump)| is_so.then_some(jump))
    }

    /// The network took `frame`: the next one is compared with it.
    pub(crate) fn took(&mut self, frame: &Frame) {
        self.last = Some(Seen::of(frame));
    }
}

/// Whether a gap in capture time is one in what the camera saw. A picture from disk that waits for its turn is stamped
/// when it is read; one of a recording carries the camera's own time, at whatever pace it is read.
fn seen_in_time(frame: &Frame) -> bool {
    frame.in_real_time || frame.capture.clock != Clock::Monotonic
}

impl Seen {
    fn of(frame: &Frame) -> Self {
        Self {
            stretch: frame.stretch,
            sequence: frame.sequence,
            size: frame.size,
            camera: frame.camera,
            clock: frame.capture.clock,
            nanos: frame.capture.nanos,
        }
    }
}

impl fmt::Display for Jump {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Repeated => f.write_str("the source began again from its start"),
            Self::Restarted => f.write_str("the source counts its frames from a smaller number"),
            Self::Size => f.write_str("the pictures have another size"),
            Self::Camera => f.write_str("another camera took it"),
            Self::Clock => f.write_str("its capture time is of another clock"),
            Self::Backwards => f.write_str("its capture time lies before the last one's"),
            Self::Gap(nanos) => write!(f, "{:.1} s have passed since the last one", *nanos as f64 / 1e9),
        }
    }
}

#[cfg(test)]
mod tests {
    use nunet_core::camera::Intrinsics;

    use super::*;

    const SECOND: i64 = 1_000_000_000;

    /// A frame in the middle of a live stream.
    fn frame() -> Frame {
        let mut frame = Frame { size: (640, 480), sequence: 7, in_real_time: true, ..Frame::default() };
        frame.capture.nanos = 100 * SECOND;
        frame.camera = Some(camera(500.0));
        frame
    }

    fn camera(fx_px: f64) -> Camera {
        Camera::pinhole(Intrinsics::new(fx_px, fx_px, 319.5, 239.5, 640, 480).unwrap())
    }

    /// What becomes of a frame that differs from the last one by `change`.
    fn after(change: impl Fn(&mut Frame)) -> Option<Jump> {
        let mut continuity = Continuity::default();
        let mut next = frame();
        continuity.took(&next);
        change(&mut next);
        continuity.jump_to(&next)
    }

    #[test]
    fn the_first_frame_follows_nothing_and_jumps_nowhere() {
        assert_eq!(Continuity::default().jump_to(&frame()), None);
    }

    #[test]
    fn frames_that_were_dropped_in_between_are_no_jump() {
        assert_eq!(after(|next| next.capture.nanos += SECOND / 30), None);
        assert_eq!(after(|next| (next.sequence, next.capture.nanos) = (37, 101 * SECOND)), None);
    }

    #[test]
    fn a_publisher_that_neither_counts_nor_stamps_is_one_stream() {
        assert_eq!(after(|_| {}), None);
    }

    #[test]
    fn a_source_that_begins_again_is_a_jump() {
        assert_eq!(after(|next| next.stretch += 1), Some(Jump::Repeated));
        assert_eq!(after(|next| next.sequence = 0), Some(Jump::Restarted));
    }

    #[test]
    fn another_size_camera_or_clock_is_a_jump() {
        assert_eq!(after(|next| next.size = (480, 640)), Some(Jump::Size));
        assert_eq!(after(|next| next.camera = Some(camera(510.0))), Some(Jump::Camera));
        assert_eq!(after(|next| next.camera = None), Some(Jump::Camera));
        assert_eq!(after(|next| next.capture.clock = Clock::Media), Some(Jump::Clock));
    }

    #[test]
    fn time_that_runs_backwards_is_a_jump_however_short() {
        assert_eq!(after(|next| next.capture.nanos -= 1), Some(Jump::Backwards));
        assert_eq!(after(|next| next.capture.nanos = i64::MIN), Some(Jump::Backwards));
    }

    #[test]
    fn a_gap_of_more_than_a_second_of_the_frames_own_clock_is_a_jump() {
        assert_eq!(after(|next| next.capture.nanos += MAX_GAP_NANOS), None);
        let gap = after(|next| next.capture.nanos += MAX_GAP_NANOS + 1);
        assert_eq!(gap, Some(Jump::Gap(MAX_GAP_NANOS + 1)));
        assert_eq!(gap.unwrap().to_string(), "1.0 s have passed since the last one");
        assert!(matches!(after(|next| next.capture.nanos = i64::MAX), Some(Jump::Gap(_))));
    }

    /// A slow network must not forget between two pictures of a folder that belong together.
    #[test]
    fn pictures_that_wait_for_the_network_have_no_gaps_but_all_other_jumps() {
        let waiting = |change: fn(&mut Frame)| {
            after(|next| {
                next.in_real_time = false;
                change(next);
            })
        };
        assert_eq!(waiting(|next| next.capture.nanos += 60 * SECOND), None);
        assert_eq!(waiting(|next| next.capture.nanos -= 1), Some(Jump::Backwards));
        assert_eq!(waiting(|next| next.stretch += 1), Some(Jump::Repeated));
        assert_eq!(waiting(|next| next.size = (320, 240)), Some(Jump::Size));
    }

    #[test]
    fn a_pause_in_a_recording_is_a_gap_at_every_pace() {
        let mut continuity = Continuity::default();
        let mut next = frame();
        (next.in_real_time, next.capture.clock) = (false, Clock::Unix);
        continuity.took(&next);
        next.capture.nanos += 600 * SECOND;
        assert_eq!(continuity.jump_to(&next), Some(Jump::Gap(600 * SECOND)));
    }

    #[test]
    fn frames_that_the_network_did_not_take_bridge_no_gap() {
        let mut continuity = Continuity::default();
        let mut next = frame();
        continuity.took(&next);
        for _ in 0..3 {
            next.capture.nanos += SECOND / 2;
            let _failed = continuity.jump_to(&next);
        }
        assert_eq!(continuity.jump_to(&next), Some(Jump::Gap(3 * SECOND / 2)));
        continuity.took(&next);
        assert_eq!(continuity.jump_to(&next), None);
    }
}
