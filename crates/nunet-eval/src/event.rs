//! The events of an evaluation. The library prints nothing itself.

use nunet_source::{CameraNews, DimImages};

/// Progress and problems of an evaluation.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Event<'a> {
    /// A pass over `count` images begins.
    Started {
        /// The purpose of the pass.
        what: &'static str,
        /// The number of images.
        count: u64,
    },
    /// One more image is done.
    Advanced,
    /// The pass is over.
    Finished,
    /// An image cannot be measured.
    Skipped {
        /// Its id.
        id: &'a str,
        /// The error and its causes.
        reason: &'a str,
        /// What can be done about it.
        hint: Option<&'a str>,
    },
    /// That many images were skipped for the same reason. Only the first one was reported as
    /// [`Event::Skipped`].
    SkippedAlike {
        /// The number of images.
        count: u64,
        /// The reason, `ID` in place of the id.
        reason: &'a str,
        /// What can be done about it.
        hint: Option<&'a str>,
    },
    /// Images and depth whose names are times were joined by them.
    JoinedByTime {
        /// The number of images with depth of another name.
        by_time: usize,
        /// The number of images with depth of the same name.
        by_name: usize,
        /// The largest difference of time stamps.
        apart_ms: u64,
    },
    /// Something unusual that does not stop the evaluation.
    Warning(&'a str),
    /// A mount is probably wrong.
    WrongMount {
        /// Why.
        text: &'a str,
        /// What can be done about it.
        hint: &'a str,
    },
    /// 16-bit images use only the lower bits.
    DimImages(&'a DimImages),
    /// The camera is unknown, or the network does not see all of its images.
    Camera(CameraNews),
    /// Much of the true depth is not compared: its unit or the cap may be wrong.
    TruthBeyondCap {
        /// The share of the true depth.
        share: f64,
        /// The cap, in meters.
        cap_m: f32,
        /// The farthest true depth, in meters.
        farthest_m: f32,
        /// Whether the dataset states meters (floating point), so that no other unit can be stated.
        is_meters: bool,
    },
}

/// Receives events.
pub(crate) type OnEvent<'a> = &'a mut dyn FnMut(Event<'_>);
