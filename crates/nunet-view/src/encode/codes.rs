//! Depth maps and maps of bytes in few bytes: depth in 0.4 % steps, each value as its difference to a
//! prediction, deflated.
//!
//! Depth from a network is smooth, so that most differences are 0, 1 or -1 steps and a map of 320x240 takes
//! 10 to 20 kB. A browser unpacks it with `DecompressionStream` and a loop of ten lines. JPEG would be
//! smaller, but it blurs edges. That creates points between an object and the wall behind it, and values
//! where there was no measurement.

use std::io::{Read as _, Write as _};

use flate2::Compression;
use flate2::read::ZlibDecoder;
use flate2::write::ZlibEncoder;
use nunet_types::{ImageSize, Units};

/// Relative step of metric depth. Half a step, 0.2 %, is far below a network's error.
const LOG_STEP: f32 = 0.004;
/// Steps between the smallest and the largest value of a depth map that is not metric, or not positive.
const LINEAR_LEVELS: f32 = 4095.0;
/// The largest unpacked map, 8192x8192 codes. Without this limit, a few kilobytes could unpack to gigabytes.
const MAX_MAP_BYTES: usize = 2 << 26;
/// Code of no measurement.
const NONE: u16 = 0;

/// How codes become values. Code 0 is no measurement; code `n` is level `n - 1`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum LevelCurve {
    /// `first + level * step`
    Linear { first: f32, step: f32 },
    /// `first * exp(level * step)`
    Logarithmic { first: f32, step: f32 },
}

impl LevelCurve {
    /// Its number in a message.
    pub(crate) fn number(self) -> u8 {
        match self {
            Self::Linear { .. } => 0,
            Self::Logarithmic { .. } => 1,
        }
    }

    /// The curve of a message; `None` for an unknown number, and for a first value or a step that no curve
    /// has.
    pub(crate) fn from_parts(number: u8, first: f32, step: f32) -> Option<Self> {
        let is_curve = first.is_finite() && step.is_finite() && step >= 0.0;
        match number {
            0 if is_curve => Some(Self::Linear { first, step }),
            1 if is_curve && first > 0.0 => Some(Self::Logarithmic { first, step }),
            _ => None,
        }
    }

    /// Its value at code 1, and its step.
    pub(crate) fn parts(self) -> (f32, f32) {
        match self {
            Self::Linear { first, step } | Self::Logarithmic { first, step } => (first, step),
        }
    }

    fn code(self, value: f32) -> u16 {
        if !value.is_finite() {
            return NONE;
        }
        let level = match self {
            Self::Linear { first, step } => (value - first) / step.max(f32::MIN_POSITIVE),
            Self::Logarithmic { first, step } => (value / first).ln() / step,
        };
        // Out of range becomes the nearest end; NaN becomes 0.
        (level + 0.5).min(f32::from(u16::MAX) - 1.0) as u16 + 1
    }

    fn value(self, code: u16) -> f32 {
        let Some(level) = code.checked_sub(1).map(f32::from) else { return f32::NAN };
        match self {
            Self::Linear { first, step } => first + level * step,
            Self::Logarithmic { first, step } => first * (level * step).exp(),
        }
    }
}

/// The curve that fits the values.
pub(crate) fn levels_of(depth: &[f32], units: Units) -> LevelCurve {
    let finite = depth.iter().copied().filter(|depth| depth.is_finite());
    let (least, greatest) = finite
        .fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), depth| (low.min(depth), high.max(depth)));
    if least > greatest {
        LevelCurve::Linear { first: 0.0, step: 0.0 }
    } else if units == Units::Metre && least > 0.0 {
        LevelCurve::Logarithmic { first: least, step: LOG_STEP }
    } else {
        // Divided first: the difference of two finite values may be infinite.
        LevelCurve::Linear { first: least, step: greatest / LINEAR_LEVELS - least / LINEAR_LEVELS }
    }
}

/// A depth map, `size` large, as the bytes of a message's section.
pub(crate) fn encode_depth(depth: &[f32], size: ImageSize, curve: LevelCurve) -> Vec<u8> {
    let width = size.width as usize;
    let codes: Vec<u16> = depth.iter().map(|&depth| curve.code(depth)).collect();
    let mut bytes = vec![0; 2 * codes.len()];
    let (low, high) = bytes.split_at_mut(codes.len());
    for (index, &code) in codes.iter().enumerate() {
        let [low_byte, high_byte] = zigzag(code.wrapping_sub(prediction(&codes, index, width))).to_le_bytes();
        (low[index], high[index]) = (low_byte, high_byte);
    }
    deflate(&bytes)
}

/// A map of one byte per pixel, such as labels, as the bytes of a message's section.
pub(crate) fn encode_bytes(map: &[u8]) -> Vec<u8> {
    deflate(map)
}

/// Predicts a code from its neighbors to the left, above, and above left: the median edge detector of LOCO-I.
/// Outside the map, neighbors are 0.
fn prediction(codes: &[u16], index: usize, width: usize) -> u16 {
    let has_left = !index.is_multiple_of(width);
    let left = if has_left { codes[index - 1] } else { 0 };
    let Some(above) = index.checked_sub(width).map(|above| codes[above]) else { return left };
    if !has_left {
        return above;
    }
    let diagonal = codes[index - width - 1];
    let (least, greatest) = (left.min(above), left.max(above));
    if diagonal >= greatest {
        least
    } else if diagonal <= least {
        greatest
    } else {
        left.wrapping_add(above).wrapping_sub(diagonal)
    }
}

/// Small differences of either sign as small numbers: 0, -1, 1, -2 become 0, 1, 2, 3.
fn zigzag(difference: u16) -> u16 {
    (difference << 1) ^ if difference & 0x8000 == 0 { 0 } else { u16::MAX }
}

fn unzigzag(number: u16) -> u16 {
    (number >> 1) ^ if number & 1 == 0 { 0 } else { u16::MAX }
}

fn deflate(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::fast());
    // Writing to a vector cannot fail.
    let written = encoder.write_all(bytes);
    written.and_then(|()| encoder.finish()).unwrap_or_default()
}

/// Exactly `count` bytes of a zlib stream; `None` if it is damaged, holds fewer or more, or more than any map
/// needs.
pub(crate) fn inflate(bytes: &[u8], count: usize) -> Option<Vec<u8>> {
    if count > MAX_MAP_BYTES {
        return None;
    }
    let mut inflated = Vec::new();
    let limit = u64::try_from(count).ok()?.saturating_add(1);
    ZlibDecoder::new(bytes).take(limit).read_to_end(&mut inflated).ok()?;
    (inflated.len() == count).then_some(inflated)
}

/// A depth map that was received.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthMap {
    /// Width and height.
    pub size: ImageSize,
    /// `[height, width]`, NaN = no measurement. Metric depth is within 0.2 % of what was measured.
    pub values: Vec<f32>,
}

/// A depth map cannot be unpacked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the section `depth` is not a deflated map of {size} codes")]
pub struct DepthMapError {
    size: ImageSize,
}

impl DepthMap {
    pub(crate) fn decode(bytes: &[u8], size: ImageSize, curve: LevelCurve) -> Result<Self, DepthMapError> {
        let count = size.pixel_count();
        let planes = inflate(bytes, 2 * count).ok_or(DepthMapError { size })?;
        let (low, high) = planes.split_at(count);
        let mut codes: Vec<u16> = Vec::with_capacity(count);
        for (index, (&low, &high)) in low.iter().zip(high).enumerate() {
            let difference = unzigzag(u16::from_le_bytes([low, high]));
            codes.push(difference.wrapping_add(prediction(&codes, index, size.width as usize)));
        }
        Ok(Self { size, values: codes.into_iter().map(|code| curve.value(code)).collect() })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn round_trip(depth: &[f32], width: u32, units: Units) -> (DepthMap, usize) {
        let size = ImageSize::new(width, depth.len() as u32 / width);
        let curve = levels_of(depth, units);
        let bytes = encode_depth(depth, size, curve);
        (DepthMap::decode(&bytes, size, curve).unwrap(), bytes.len())
    }

    fn any_depth() -> impl Strategy<Value = Vec<f32>> {
        let value = prop_oneof![Just(f32::NAN), Just(f32::INFINITY), 0.05_f32..90.0];
        prop::collection::vec(value, 12 * 7)
    }

    proptest! {
        #[test]
        fn metric_depth_comes_back_within_a_fifth_of_a_percent(depth in any_depth()) {
            let (map, _) = round_trip(&depth, 12, Units::Metre);
            for (before, after) in depth.iter().zip(&map.values) {
                let same = !before.is_finite() && after.is_nan();
                prop_assert!(same || (after / before - 1.0).abs() < 0.0021, "{before} became {after}");
            }
        }

        #[test]
        fn any_numbers_come_back_within_a_step(depth in prop::collection::vec(any::<f32>(), 30), metric: bool) {
            let units = if metric { Units::Metre } else { Units::Relative };
            let (map, _) = round_trip(&depth, 5, units);
            for (before, after) in depth.iter().zip(&map.values) {
                prop_assert_eq!(before.is_finite(), !after.is_nan(), "{} became {}", before, after);
            }
        }

        #[test]
        fn any_bytes_are_a_map_or_an_error(bytes in prop::collection::vec(any::<u8>(), 0..200), number: u8) {
            let curve = LevelCurve::from_parts(number, 1.0, 0.5);
            let curve = curve.unwrap_or(LevelCurve::Linear { first: 0.0, step: 1.0 });
            let _ = DepthMap::decode(&bytes, ImageSize::new(4, 4), curve);
        }
    }

    #[test]
    fn a_smooth_map_takes_less_than_three_bits_per_pixel() {
        let depth = |index: u32| {
            let (x, y) = ((index % 320) as f32, (index / 320) as f32);
            2.0 + 0.005 * y + 0.3 * (x / 40.0).sin() + if x > 200.0 { 1.5 } else { 0.0 }
        };
        let depth: Vec<f32> = (0..320 * 240).map(depth).collect();
        let (_, bytes) = round_trip(&depth, 320, Units::Metre);
        assert!(bytes < depth.len() * 3 / 8, "{bytes} bytes");
    }

    #[test]
    fn a_stream_of_another_length_is_refused_and_a_decompression_bomb_is_not_unpacked() {
        let bomb = deflate(&vec![0; 10_000_000]);
        assert_eq!(inflate(&bomb, 100), None);
        assert_eq!(inflate(&deflate(&[1, 2, 3]), 4), None);
        assert_eq!(inflate(&deflate(&[1, 2, 3]), 3), Some(vec![1, 2, 3]));
    }

    #[test]
    fn zigzag_orders_differences_by_their_size() {
        let numbers = [0_i16, -1, 1, -2, 2, i16::MIN].map(|difference| zigzag(difference as u16));
        assert_eq!(numbers, [0, 1, 2, 3, 4, u16::MAX]);
        assert!((0..=u16::MAX).all(|number| unzigzag(zigzag(number)) == number));
    }
}
