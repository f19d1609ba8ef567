//! Traits for a video device and its machine. Tests implement them with simulated cameras.

use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use nunet_types::ImageSize;

pub(super) use rustix::io::Errno;

pub(super) type Result<T> = std::result::Result<T, Errno>;

/// The machine that devices are plugged into.
pub(super) trait Host: Send {
    /// Opens the device at `path`; `NOTTY` for any other kind of file.
    fn open(&mut self, path: &Path) -> Result<Box<dyn Device>>;

    /// The paths of all video devices, cameras or not, by their number.
    fn nodes(&self) -> Vec<PathBuf>;

    /// The current time.
    fn now(&self) -> Now;

    /// Waits.
    fn pause(&self, time: Duration);
}

/// An open device. Dropping it ends its stream and closes it.
pub(super) trait Device: Send {
    /// What it is.
    fn capability(&mut self) -> Result<Capability>;

    /// The formats that it offers, in its own order.
    fn formats(&mut self) -> Result<Vec<FourCc>>;

    /// The sizes of a format; none if the driver does not list them.
    fn sizes(&mut self, format: FourCc) -> Result<Vec<Sizes>>;

    /// The frame intervals of a format and size; none if the driver does not list them.
    fn intervals(&mut self, format: FourCc, size: ImageSize) -> Result<Vec<Intervals>>;

    /// Requests a format and size, and returns what the driver set.
    fn set_format(&mut self, format: FourCc, size: ImageSize) -> Result<BufferFormat>;

    /// Requests a frame interval, and returns what the driver set; `None` if it does not support rates.
    fn set_interval(&mut self, interval: Interval) -> Result<Option<Interval>>;

    /// Gives the driver about `buffers` buffers to fill and starts the stream.
    fn start(&mut self, buffers: u32) -> Result<()>;

    /// Waits until a buffer is filled; false after `timeout`.
    fn wait(&mut self, timeout: Duration) -> Result<bool>;

    /// Takes the oldest filled buffer from the driver; `None` if none is filled.
    fn dequeue(&mut self) -> Result<Option<Buffer>>;

    /// The content of a taken buffer; empty after it was given back.
    fn bytes(&self, buffer: &Buffer) -> &[u8];

    /// Gives a buffer back to be filled again.
    fn queue(&mut self, buffer: Buffer) -> Result<()>;

    /// The values that a control takes; `None` if the device does not have it.
    fn control_range(&mut self, id: u32) -> Result<Option<ControlRange>>;

    /// Sets a control.
    fn set_control(&mut self, id: u32, value: i32) -> Result<()>;
}

/// The same time on two clocks.
#[derive(Debug, Clone, Copy)]
pub(super) struct Now {
    /// `CLOCK_MONOTONIC`.
    pub(super) monotonic_nanos: i64,
    /// Since 1970.
    pub(super) unix_nanos: i64,
}

/// The values of a control.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ControlRange {
    /// The smallest.
    pub(super) least: i32,
    /// The largest.
    pub(super) most: i32,
}

/// A device's name and abilities.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Capability {
    /// The camera's name.
    pub(super) name: String,
    /// Whether it captures images, in one buffer each or in one per plane.
    pub(super) captures: bool,
    /// Whether it fills mapped buffers.
    pub(super) streams: bool,
}

/// The four-character code of a format in V4L2.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) struct FourCc(pub(super) u32);

impl FourCc {
    pub(super) const fn new(letters: &[u8; 4]) -> Self {
        Self(u32::from_le_bytes(*letters))
    }
}

impl fmt::Display for FourCc {
    /// Characters that are not printable become `.`; trailing ones are omitted.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let shown = |byte: u8| if byte.is_ascii_graphic() { char::from(byte) } else { '.' };
        let letters: String = self.0.to_le_bytes().into_iter().map(shown).collect();
        f.pad(letters.trim_end_matches('.'))
    }
}

impl fmt::Debug for FourCc {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// One size, or a range.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Sizes {
    /// Width and height, pixels.
    One(ImageSize),
    /// All sizes of a range, in steps.
    Range {
        /// The smallest.
        least: ImageSize,
        /// The largest.
        most: ImageSize,
        /// The difference of consecutive sizes.
        step: ImageSize,
    },
}

/// The time from frame to frame, as a fraction of seconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Interval {
    /// The numerator, seconds.
    pub(super) numerator: u32,
    /// The denominator.
    pub(super) denominator: u32,
}

impl Interval {
    /// The interval of a rate, exact to 0.001 Hz.
    pub(super) fn of_hz(hz: f64) -> Self {
        Self { numerator: 1000, denominator: ((hz * 1000.0).round() as u32).max(1) }
    }

    /// Frames per second; `None` for a fraction without a value.
    pub(super) fn hz(self) -> Option<f64> {
        let hz = f64::from(self.denominator) / f64::from(self.numerator);
        (hz.is_finite() && hz > 0.0).then_some(hz)
    }
}

/// One frame interval, or a range.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Intervals {
    /// One interval.
    One(Interval),
    /// All intervals of a range.
    Range {
        /// The fastest.
        shortest: Interval,
        /// The slowest.
        longest: Interval,
    },
}

/// The format and layout of images in buffers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct BufferFormat {
    /// The format.
    pub(super) format: FourCc,
    /// Width and height, pixels.
    pub(super) size: ImageSize,
    /// Bytes from row to row; 0 for a compressed format, and if the driver does not state it.
    pub(super) row_stride: u32,
}

/// A filled buffer, taken from the driver until it is given back.
#[derive(Debug)]
pub(super) struct Buffer {
    /// Its index among the device's buffers.
    pub(super) index: u32,
    /// Bytes that were filled.
    pub(super) used: usize,
    /// Whether the driver reports that the image is damaged.
    pub(super) flawed: bool,
    /// When the image was taken, `CLOCK_MONOTONIC`; `None` if the driver uses another clock or does not state
    /// it.
    pub(super) taken_nanos: Option<i64>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_format_is_written_by_its_letters() {
        assert_eq!(FourCc::new(b"YUYV").to_string(), "YUYV");
        assert_eq!(FourCc::new(b"Y16 ").to_string(), "Y16");
        assert_eq!(FourCc::new(b"\x1b[2J").to_string(), ".[2J", "nothing that a terminal obeys");
    }

    #[test]
    fn an_interval_is_a_rate_and_a_fraction_that_is_none_is_no_rate() {
        assert_eq!(Interval::of_hz(29.97).hz(), Some(29.97));
        assert!(Interval::of_hz(1e-9).hz().is_some_and(|hz| hz > 0.0));
        assert_eq!(Interval { numerator: 0, denominator: 30 }.hz(), None);
        assert_eq!(Interval { numerator: 1, denominator: 0 }.hz(), None);
    }
}
