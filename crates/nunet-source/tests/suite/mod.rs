//! The rules for the frames of all sources. Tests inside the crate include this file for the sources that
//! only they can make.

use super::{Fill, Frame, ImageSize, Source, SourceErrorKind};

/// Bounds every loop.
pub(super) const MAX_CALLS: usize = 10_000;

/// A source of three frames, of which the second cannot be read if the kind has bad frames, and the third is
/// larger if the kind has sizes.
pub(super) struct Subject {
    pub(super) name: &'static str,
    pub(super) source: Box<dyn Source>,
    pub(super) has_bad_frames: bool,
    pub(super) has_sizes: bool,
    /// Called before each frame, for sources that show only the newest.
    pub(super) offer: Offer,
}

/// Publishes the frame of a number.
pub(super) type Offer = Box<dyn FnMut(u64)>;

/// The next fill that is more than nothing.
pub(super) fn next(source: &mut dyn Source, frame: &mut Frame) -> Fill {
    for _ in 0..MAX_CALLS {
        match source.fill(frame) {
            Fill::Nothing | Fill::Crowded => {}
            fill => return fill,
        }
    }
    panic!("nothing comes")
}

/// A bad frame fails alone and counts, and sizes may change.
pub(super) fn assert_frames(subject: Subject) {
    let Subject { name, mut source, has_bad_frames, has_sizes, mut offer } = subject;
    let mut frame = Frame::default();
    let mut seen = Vec::new();
    for expected in 0..3 {
        offer(expected);
        let fill = next(source.as_mut(), &mut frame);
        assert!(fill.had_frame(), "{name}: {fill:?}");
        assert_eq!(frame.sequence, expected, "{name}: bad frames count too");
        match fill {
            Fill::Failed(error) => {
                assert_eq!(error.kind(), SourceErrorKind::BadFrame, "{name}: {error:#}");
                seen.push(None);
            }
            _ => {
                let view = frame.view().unwrap();
                assert_eq!(
                    view.bytes().len(),
                    view.format().byte_len(view.width(), view.height(), view.row_stride())
                );
                seen.push(Some(frame.size));
            }
        }
    }
    let small = ImageSize::new(2, 2);
    let last = if has_sizes { ImageSize::new(4, 4) } else { small };
    let bad = (!has_bad_frames).then_some(small);
    assert_eq!(seen, [Some(small), bad, Some(last)], "{name}");
}
