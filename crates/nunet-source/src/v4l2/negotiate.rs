//! Chooses the camera's format, size and rate that are nearest to the requested ones.

use std::fmt;

use nunet_types::{ImageSize, MAX_SIDE_PX, PixelFormat};

use super::device::{BufferFormat, Device, FourCc, Interval, Intervals, Sizes};
use super::fault::CameraFault;
use crate::camera_settings::CameraSettings;
use crate::convert::{Bayer, RawLayout};
use crate::rate::MAX_HZ;

/// The mode that the user requests.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RequestedMode {
    /// Width and height, pixels.
    pub(super) size: ImageSize,
    /// Frames per second.
    pub(super) hz: f64,
    /// Exposure and gain.
    pub(super) settings: CameraSettings,
}

impl Default for RequestedMode {
    /// The size of the networks, and the rate of most cameras.
    fn default() -> Self {
        Self { size: ImageSize::new(640, 480), hz: 30.0, settings: CameraSettings::UNCHANGED }
    }
}

impl fmt::Display for RequestedMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ImageSize { width, height } = self.size;
        if self.hz >= MAX_HZ {
            return write!(f, "{width}x{height} at the highest rate");
        }
        write!(f, "{width}x{height} at {} Hz", self.hz)
    }
}

/// How the bytes of a format are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Coding {
    /// Pixels.
    Raw(RawLayout),
    /// Each image is a JPEG.
    Jpeg,
}

const fn direct(format: PixelFormat) -> Coding {
    Coding::Raw(RawLayout::Direct(format))
}

const fn mosaic(pattern: Bayer) -> Coding {
    Coding::Raw(RawLayout::Mosaic { pattern, bytes: 1 })
}

/// The readable formats, the best first. Raw images need no decoding and have no artifacts; the first
/// ones need no conversion. A mosaic has a third of the resolution, and gray images lack the color that the
/// networks were trained with.
const READABLE: [(FourCc, Coding); 20] = [
    (FourCc::new(b"NV12"), direct(PixelFormat::Nv12)),
    (FourCc::new(b"YUYV"), direct(PixelFormat::Yuyv)),
    (FourCc::new(b"RGB3"), direct(PixelFormat::Rgb8)),
    (FourCc::new(b"BGR3"), direct(PixelFormat::Bgr8)),
    (FourCc::new(b"UYVY"), Coding::Raw(RawLayout::Uyvy)),
    (FourCc::new(b"NV21"), Coding::Raw(RawLayout::Nv21)),
    (FourCc::new(b"YU12"), Coding::Raw(RawLayout::Planes { v_first: false })),
    (FourCc::new(b"YV12"), Coding::Raw(RawLayout::Planes { v_first: true })),
    // The planes of these are in a buffer each, and are joined.
    (FourCc::new(b"NM12"), direct(PixelFormat::Nv12)),
    (FourCc::new(b"NM21"), Coding::Raw(RawLayout::Nv21)),
    (FourCc::new(b"YM12"), Coding::Raw(RawLayout::Planes { v_first: false })),
    (FourCc::new(b"YM21"), Coding::Raw(RawLayout::Planes { v_first: true })),
    (FourCc::new(b"MJPG"), Coding::Jpeg),
    (FourCc::new(b"JPEG"), Coding::Jpeg),
    (FourCc::new(b"RGGB"), mosaic(Bayer::RGGB)),
    (FourCc::new(b"BA81"), mosaic(Bayer::BGGR)),
    (FourCc::new(b"GBRG"), mosaic(Bayer::GBRG)),
    (FourCc::new(b"GRBG"), mosaic(Bayer::GRBG)),
    (FourCc::new(b"GREY"), direct(PixelFormat::Mono8)),
    (
        FourCc::new(b"Y16 "),
        Coding::Raw(RawLayout::Channels { format: PixelFormat::Mono8, channels: 1, bytes: 2 }),
    ),
];

impl Coding {
    fn is_gray(self) -> bool {
        matches!(
            self,
            Self::Raw(
                RawLayout::Direct(PixelFormat::Mono8)
                    | RawLayout::Channels { format: PixelFormat::Mono8, .. }
            )
        )
    }
}

/// Whether images of `format` can be read.
pub(super) fn is_readable(format: FourCc) -> bool {
    READABLE.iter().any(|(known, _)| *known == format)
}

/// The mode that is requested from the driver.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Choice {
    pub(super) format: FourCc,
    pub(super) coding: Coding,
    pub(super) size: ImageSize,
    /// `None` if the driver does not list its rates.
    pub(super) interval: Option<Interval>,
}

/// The distance of a choice from the requested mode: whether it is gray, then the size, the rate, and the
/// order of [`READABLE`]. The first difference decides.
type Cost = (bool, f64, f64, usize);

/// The nearest mode that the camera offers.
///
/// # Errors
/// The camera has no readable format, or the device fails.
pub(super) fn choose(device: &mut dyn Device, requested: RequestedMode) -> Result<Choice, CameraFault> {
    let offered = device.formats().map_err(CameraFault::at("list its formats"))?;
    let mut best: Option<(Cost, Choice)> = None;
    for (place, (format, coding)) in READABLE.into_iter().enumerate() {
        if !offered.contains(&format) {
            continue;
        }
        let sizes = device.sizes(format).map_err(CameraFault::at("list its sizes"))?;
        let size = nearest_size(&sizes, requested.size);
        let intervals = device.intervals(format, size).map_err(CameraFault::at("list its rates"))?;
        let interval = nearest_interval(&intervals, requested.hz);
        let is_gray = coding.is_gray();
        let cost = (is_gray, size_distance(size, requested.size), hz_distance(interval, requested.hz), place);
        if best.is_none_or(|(least, _)| cost < least) {
            best = Some((cost, Choice { format, coding, size, interval }));
        }
    }
    let (_, choice) = best.ok_or_else(|| {
        let readable = READABLE.map(|(format, _)| format).to_vec();
        CameraFault::NoFormat { offered, readable }
    })?;
    Ok(choice)
}

/// The distance of two sizes on a logarithmic scale: half and double the width are equally far.
fn size_distance(size: ImageSize, requested: ImageSize) -> f64 {
    let octaves = |side: u32, requested: u32| (f64::from(side) / f64::from(requested)).log2().abs();
    octaves(size.width, requested.width) + octaves(size.height, requested.height)
}

/// The distance of two rates, rounded to 0.1 Hz: 333333/10000000 s and 1/30 s are the same rate. An unknown
/// rate counts as the requested one.
fn hz_distance(interval: Option<Interval>, requested_hz: f64) -> f64 {
    let hz = interval.and_then(Interval::hz).unwrap_or(requested_hz);
    ((hz - requested_hz).abs() * 10.0).round()
}

/// For a driver that lists no sizes, the requested one: the driver replies with the size that it sets.
fn nearest_size(sizes: &[Sizes], requested: ImageSize) -> ImageSize {
    let sizes = sizes.iter().map(|&sizes| match sizes {
        Sizes::One(size) => size,
        Sizes::Range { least, most, step } => ImageSize {
            width: on_grid(requested.width, least.width, most.width, step.width),
            height: on_grid(requested.height, least.height, most.height, step.height),
        },
    });
    let usable = sizes.filter(|size| size.pixel_count() > 0);
    let nearest = usable.min_by(|&a, &b| size_distance(a, requested).total_cmp(&size_distance(b, requested)));
    nearest.unwrap_or(requested)
}

/// The nearest of `least`, `least + step`, ... up to `most`.
fn on_grid(requested: u32, least: u32, most: u32, step: u32) -> u32 {
    let (most, step) = (most.max(least), step.max(1));
    let above = requested.clamp(least, most) - least;
    let down = above - above % step;
    let up = down.saturating_add(step).min(most - least);
    let is_on_grid = (up - down) == step;
    least + if is_on_grid && above - down > up - above { up } else { down }
}

fn nearest_interval(intervals: &[Intervals], requested_hz: f64) -> Option<Interval> {
    let intervals = intervals.iter().map(|&intervals| match intervals {
        Intervals::One(interval) => interval,
        Intervals::Range { shortest, longest } => {
            let (fastest, slowest) = (shortest.hz(), longest.hz());
            match (fastest, slowest) {
                (Some(fastest), _) if requested_hz >= fastest => shortest,
                (_, Some(slowest)) if requested_hz <= slowest => longest,
                _ => Interval::of_hz(requested_hz),
            }
        }
    });
    let distance = |interval: &Interval| interval.hz().map(|hz| (hz - requested_hz).abs());
    intervals
        .filter(|interval| interval.hz().is_some())
        .min_by(|a, b| distance(a).partial_cmp(&distance(b)).unwrap_or(std::cmp::Ordering::Equal))
}

/// The mode that a camera is set to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct CaptureMode {
    pub(super) format: FourCc,
    pub(super) coding: Coding,
    pub(super) size: ImageSize,
    /// Bytes from row to row; unused for JPEG.
    pub(super) row_stride: u32,
    /// Frames per second, if the driver states them.
    pub(super) hz: Option<f64>,
}

/// Sets the camera to a choice.
///
/// # Errors
/// The driver chose another format or an invalid layout, or fails.
pub(super) fn set(
    device: &mut dyn Device,
    choice: Choice,
    requested: RequestedMode,
) -> Result<CaptureMode, CameraFault> {
    let Choice { format, coding, size, interval } = choice;
    let layout = device.set_format(format, size).map_err(CameraFault::at("set its format"))?;
    if layout.format != format {
        return Err(CameraFault::OtherFormat { asked: format, got: layout.format });
    }
    let row_stride = row_stride(layout, coding)?;
    let interval = device
        .set_interval(interval.unwrap_or(Interval::of_hz(requested.hz)))
        .map_err(CameraFault::at("set its rate"))?;
    Ok(CaptureMode { format, coding, size: layout.size, row_stride, hz: interval.and_then(Interval::hz) })
}

fn row_stride(layout: BufferFormat, coding: Coding) -> Result<u32, CameraFault> {
    let BufferFormat { size: ImageSize { width, height }, row_stride, .. } = layout;
    let sides = 1..=MAX_SIDE_PX;
    let least = match coding {
        Coding::Raw(format) => format.min_stride(width),
        Coding::Jpeg => 0,
    };
    let stride = if row_stride == 0 { least } else { row_stride };
    if sides.contains(&width) && sides.contains(&height) && stride >= least {
        Ok(stride)
    } else {
        Err(CameraFault::NoLayout { size: layout.size, row_stride })
    }
}

impl CaptureMode {
    /// Whether the mode is the requested one.
    pub(super) fn fulfils(&self, requested: RequestedMode) -> bool {
        self.size == requested.size && self.hz.is_none_or(|hz| (hz - requested.hz).abs() < 0.1)
    }
}

impl fmt::Display for CaptureMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        show(f, self.format, self.size, self.hz)
    }
}

impl fmt::Display for Choice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        show(f, self.format, self.size, self.interval.and_then(Interval::hz))
    }
}

fn show(f: &mut fmt::Formatter<'_>, format: FourCc, size: ImageSize, hz: Option<f64>) -> fmt::Result {
    write!(f, "{format} {size}")?;
    // Two decimals distinguish 29.97 from 30; more would show rounding errors of the driver.
    hz.map_or(Ok(()), |hz| write!(f, " at {} Hz", (hz * 100.0).round() / 100.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_size_is_nearest_in_proportion() {
        let sizes = [
            ImageSize::new(320, 240),
            ImageSize::new(640, 360),
            ImageSize::new(1280, 720),
            ImageSize::new(1920, 1080),
        ]
        .map(Sizes::One);
        assert_eq!(nearest_size(&sizes, ImageSize::new(640, 480)), ImageSize::new(640, 360));
        assert_eq!(nearest_size(&sizes, ImageSize::new(1, 1)), ImageSize::new(320, 240));
        assert_eq!(nearest_size(&sizes, ImageSize::new(9000, 9000)), ImageSize::new(1920, 1080));
        assert_eq!(
            nearest_size(&[], ImageSize::new(640, 480)),
            ImageSize::new(640, 480),
            "the driver will say"
        );
        assert_eq!(
            nearest_size(&[Sizes::One(ImageSize::new(0, 0))], ImageSize::new(640, 480)),
            ImageSize::new(640, 480)
        );
    }

    #[test]
    fn a_range_of_sizes_is_kept_to_in_its_steps() {
        let range = [Sizes::Range {
            least: ImageSize::new(48, 32),
            most: ImageSize::new(1920, 1080),
            step: ImageSize::new(16, 8),
        }];
        assert_eq!(nearest_size(&range, ImageSize::new(640, 480)), ImageSize::new(640, 480));
        assert_eq!(nearest_size(&range, ImageSize::new(645, 477)), ImageSize::new(640, 480));
        assert_eq!(nearest_size(&range, ImageSize::new(10, 9000)), ImageSize::new(48, 1080));
        let odd = [Sizes::Range {
            least: ImageSize::new(10, 10),
            most: ImageSize::new(25, 25),
            step: ImageSize::new(10, 0),
        }];
        assert_eq!(
            nearest_size(&odd, ImageSize::new(30, 30)),
            ImageSize::new(20, 25),
            "25 is not on the grid of 10"
        );
        let upside_down = [Sizes::Range {
            least: ImageSize::new(64, 64),
            most: ImageSize::new(0, 0),
            step: ImageSize::new(1, 1),
        }];
        assert_eq!(nearest_size(&upside_down, ImageSize::new(640, 480)), ImageSize::new(64, 64));
    }

    #[test]
    fn the_nearest_rate_is_taken_of_lists_and_ranges() {
        let hz = |hz: f64| Interval::of_hz(hz);
        let list = [Intervals::One(hz(60.0)), Intervals::One(hz(25.0)), Intervals::One(hz(5.0))];
        assert_eq!(nearest_interval(&list, 30.0), Some(hz(25.0)));
        assert_eq!(nearest_interval(&list, 10_000.0), Some(hz(60.0)));
        let range = [Intervals::Range { shortest: hz(30.0), longest: hz(2.0) }];
        for (requested, got) in [(100.0, 30.0), (12.5, 12.5), (1.0, 2.0)] {
            assert_eq!(nearest_interval(&range, requested), Some(hz(got)), "{requested}");
        }
        let none = [Intervals::One(Interval { numerator: 0, denominator: 0 })];
        assert_eq!(nearest_interval(&none, 30.0), None);
    }
}
