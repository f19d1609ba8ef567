//! Finds discontinuities in a stream. A recurrent network treats each frame as the successor of the last one.
//! After a discontinuity its state describes another place or time, which gives worse depth than no state.

use std::fmt;

use nunet_core::camera::Camera;
use nunet_ipc::Clock;
use nunet_types::ImageSize;

use crate::frame::Frame;

/// The longest time between two consecutive frames. A robot at walking pace moves by its own length in that
/// time. A camera that drops some frames stays far below it.
const MAX_GAP_NANOS: i64 = 1_000_000_000;

/// Compares each frame with the last one that the network processed.
#[derive(Debug, Default)]
pub struct Continuity {
    last: Option<Seen>,
}

/// The properties of a frame that are compared.
#[derive(Debug, Clone, Copy)]
struct Seen {
    segment: u64,
    sequence: u64,
    size: ImageSize,
    camera: Option<Camera>,
    clock: Clock,
    nanos: i64,
}

/// Why a frame does not follow the one before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Discontinuity {
    /// The source restarted from its beginning (`--loop`).
    Repeated,
    /// The sequence number decreased: another process publishes now.
    Restarted,
    /// The image size changed.
    Size,
    /// The camera or its focal length changed.
    Camera,
    /// Capture times come from another clock and cannot be compared.
    Clock,
    /// The capture time went back.
    Backwards,
    /// More than [`MAX_GAP_NANOS`] between the frames; nanoseconds.
    Gap(i64),
}

impl Continuity {
    /// Why `frame` does not follow the last frame that the network processed; `None` if it does, and for the
    /// first frame. Frames in between that were superseded or failed are ignored, because the network has not
    /// processed them. Their time is part of the gap.
    #[must_use]
    pub fn discontinuity_to(&self, frame: &Frame) -> Option<Discontinuity> {
        let (last, next) = (self.last?, Seen::of(frame));
        let gap_nanos = next.nanos.saturating_sub(last.nanos);
        let candidates = [
            (next.segment != last.segment, Discontinuity::Repeated),
            // Equal numbers are not a discontinuity: not every publisher counts.
            (next.sequence < last.sequence, Discontinuity::Restarted),
            (next.size != last.size, Discontinuity::Size),
            (next.camera != last.camera, Discontinuity::Camera),
            (next.clock != last.clock, Discontinuity::Clock),
            (gap_nanos < 0, Discontinuity::Backwards),
            (is_in_camera_time(frame) && gap_nanos > MAX_GAP_NANOS, Discontinuity::Gap(gap_nanos)),
        ];
        candidates.into_iter().find_map(|(applies, reason)| applies.then_some(reason))
    }

    /// Records that the network processed `frame`: the next one is compared with it.
    pub fn took(&mut self, frame: &Frame) {
        self.last = Some(Seen::of(frame));
    }
}

/// Whether a gap in capture time is a gap in the scene. The capture time of an image file is when it was
/// read; that of an image in a recording is the camera's, at any replay speed.
fn is_in_camera_time(frame: &Frame) -> bool {
    frame.in_real_time || frame.capture.clock != Clock::Monotonic
}

impl Seen {
    fn of(frame: &Frame) -> Self {
        Self {
            segment: frame.segment,
            sequence: frame.sequence,
            size: frame.size,
            camera: frame.camera,
            clock: frame.capture.clock,
            nanos: frame.capture.nanos,
        }
    }
}

impl fmt::Display for Discontinuity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Repeated => f.write_str("the source restarted"),
            Self::Restarted => f.write_str("the sequence number went back"),
            Self::Size => f.write_str("the image size changed"),
            Self::Camera => f.write_str("the camera changed"),
            Self::Clock => f.write_str("the capture clock changed"),
            Self::Backwards => f.write_str("the capture time went back"),
            Self::Gap(nanos) => write!(f, "{:.1} s passed since the last frame", *nanos as f64 / 1e9),
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
        let mut frame =
            Frame { size: ImageSize::new(640, 480), sequence: 7, in_real_time: true, ..Frame::default() };
        frame.capture.nanos = 100 * SECOND;
        frame.camera = Some(camera(500.0));
        frame
    }

    fn camera(fx_px: f64) -> Camera {
        Camera::pinhole(Intrinsics::new(fx_px, fx_px, 319.5, 239.5, 640, 480).unwrap())
    }

    /// The discontinuity of a frame that differs from the last one by `change`.
    fn after(change: impl Fn(&mut Frame)) -> Option<Discontinuity> {
        let mut continuity = Continuity::default();
        let mut next = frame();
        continuity.took(&next);
        change(&mut next);
        continuity.discontinuity_to(&next)
    }

    #[test]
    fn the_first_frame_follows_nothing_and_has_no_discontinuity() {
        assert_eq!(Continuity::default().discontinuity_to(&frame()), None);
    }

    #[test]
    fn frames_that_were_dropped_in_between_are_no_discontinuity() {
        assert_eq!(after(|next| next.capture.nanos += SECOND / 30), None);
        assert_eq!(after(|next| (next.sequence, next.capture.nanos) = (37, 101 * SECOND)), None);
    }

    #[test]
    fn a_publisher_that_neither_counts_nor_stamps_is_one_stream() {
        assert_eq!(after(|_| {}), None);
    }

    #[test]
    fn a_source_that_begins_again_is_a_discontinuity() {
        assert_eq!(after(|next| next.segment += 1), Some(Discontinuity::Repeated));
        assert_eq!(after(|next| next.sequence = 0), Some(Discontinuity::Restarted));
    }

    #[test]
    fn another_size_camera_or_clock_is_a_discontinuity() {
        assert_eq!(after(|next| next.size = ImageSize::new(480, 640)), Some(Discontinuity::Size));
        assert_eq!(after(|next| next.camera = Some(camera(510.0))), Some(Discontinuity::Camera));
        assert_eq!(after(|next| next.camera = None), Some(Discontinuity::Camera));
        assert_eq!(after(|next| next.capture.clock = Clock::Media), Some(Discontinuity::Clock));
    }

    #[test]
    fn time_that_runs_backwards_is_a_discontinuity_however_short() {
        assert_eq!(after(|next| next.capture.nanos -= 1), Some(Discontinuity::Backwards));
        assert_eq!(after(|next| next.capture.nanos = i64::MIN), Some(Discontinuity::Backwards));
    }

    #[test]
    fn a_gap_of_more_than_a_second_of_the_frames_own_clock_is_a_discontinuity() {
        assert_eq!(after(|next| next.capture.nanos += MAX_GAP_NANOS), None);
        let gap = after(|next| next.capture.nanos += MAX_GAP_NANOS + 1);
        assert_eq!(gap, Some(Discontinuity::Gap(MAX_GAP_NANOS + 1)));
        insta::assert_snapshot!(gap.unwrap(), @"1.0 s passed since the last frame");
        assert!(matches!(after(|next| next.capture.nanos = i64::MAX), Some(Discontinuity::Gap(_))));
    }

    /// A slow network must not lose its state between two images of one clip.
    #[test]
    fn images_that_wait_for_the_network_have_no_gaps_but_all_other_discontinuities() {
        let waiting = |change: fn(&mut Frame)| {
            after(|next| {
                next.in_real_time = false;
                change(next);
            })
        };
        assert_eq!(waiting(|next| next.capture.nanos += 60 * SECOND), None);
        assert_eq!(waiting(|next| next.capture.nanos -= 1), Some(Discontinuity::Backwards));
        assert_eq!(waiting(|next| next.segment += 1), Some(Discontinuity::Repeated));
        assert_eq!(waiting(|next| next.size = ImageSize::new(320, 240)), Some(Discontinuity::Size));
    }

    #[test]
    fn a_pause_in_a_recording_is_a_gap_at_every_pace() {
        let mut continuity = Continuity::default();
        let mut next = frame();
        (next.in_real_time, next.capture.clock) = (false, Clock::Unix);
        continuity.took(&next);
        next.capture.nanos += 600 * SECOND;
        assert_eq!(continuity.discontinuity_to(&next), Some(Discontinuity::Gap(600 * SECOND)));
    }

    #[test]
    fn frames_that_the_network_did_not_take_bridge_no_gap() {
        let mut continuity = Continuity::default();
        let mut next = frame();
        continuity.took(&next);
        for _ in 0..3 {
            next.capture.nanos += SECOND / 2;
            let _failed = continuity.discontinuity_to(&next);
        }
        assert_eq!(continuity.discontinuity_to(&next), Some(Discontinuity::Gap(3 * SECOND / 2)));
        continuity.took(&next);
        assert_eq!(continuity.discontinuity_to(&next), None);
    }
}
