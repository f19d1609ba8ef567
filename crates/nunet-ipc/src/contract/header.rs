#![expect(
    unsafe_code,
    reason = "iceoryx2 asks for an unsafe promise that a type may cross process boundaries"
)]
//! The header in front of every payload.

use std::borrow::Cow;

use iceoryx2::prelude::ZeroCopySend;

use nunet_types::{
    CameraInfo, Clock, DistortionModel, Encoding, ImageSize, MAX_FRAME_ID, PixelRect, Quality, ScaleSource,
    Topic, Units, UnknownValue, contract_struct,
};

use super::text::{set_text, text};

pub use nunet_types::MAX_COEFFICIENTS;

/// The version of this contract, in every header and in the attribute of every service.
pub const CONTRACT_VERSION: u32 = nunet_types::CONTRACT_VERSION;

/// Stages whose times fit into a header.
pub const MAX_STAGES: usize = 16;

/// The name under which other languages know [`FrameHeader`].
pub const HEADER_TYPE_NAME: &str = "nunet.v1.FrameHeader";

contract_struct! {
    /// The header of a message.
    ///
    /// Plain numbers in native byte order, so that C, Python and recordings read it directly. Enumerations
    /// are stored as numbers ([`nunet_types`]): read them through the methods, which return an error for an
    /// unknown number.
    FrameHeader, 1024 bytes {
        /// [`CONTRACT_VERSION`].
        pub contract_version: u32,
        /// A [`Topic`].
        pub topic: u32,
        /// The frame's number: the same in every topic of one frame. It increases from an arbitrary start.
        pub sequence: u64,
        /// The capture time, in nanoseconds of `capture_clock`: the same in every topic of one frame.
        pub capture_nanos: i64,
        /// The capture time, in nanoseconds since 1970-01-01 UTC; 0 when unknown.
        pub capture_unix_nanos: i64,
        /// When this message was sent, nanoseconds of `CLOCK_MONOTONIC`.
        pub publish_nanos: i64,
        /// A [`Clock`].
        pub capture_clock: u32,
        /// An [`Encoding`].
        pub encoding: u32,
        /// Columns of the payload, in pixels or points.
        pub width: u32,
        /// Rows of the payload.
        pub height: u32,
        /// Bytes from one row to the next.
        pub row_stride_bytes: u32,
        /// [`Units`].
        pub units: u32,
        /// Bytes of the payload, without the unused end of the last block.
        pub payload_bytes: u64,
        /// A [`ScaleSource`]; without meaning when `units` is none.
        pub scale_source: u32,
        /// A [`Quality`].
        pub quality: u32,
        /// Focal length in pixels at `width` x `height`; 0 when the camera is not known.
        pub fx: f64,
        /// Focal length in pixels, vertically.
        pub fy: f64,
        /// Principal point in pixels; the center of the first pixel is 0.
        pub cx: f64,
        /// Principal point in pixels, vertically.
        pub cy: f64,
        /// The coefficients of `distortion_model`, padded with zeros.
        pub distortion: [f64; MAX_COEFFICIENTS],
        /// A [`DistortionModel`].
        pub distortion_model: u32,
        /// How many of `stage_micros` are in use; the stages' names are in the `stats` topic.
        pub stage_count: u32,
        /// SHA-256 of the model; zeros in a camera's own images.
        pub model_hash: [u8; 32],
        /// Microseconds that each stage took for this frame.
        pub stage_micros: [u32; MAX_STAGES],
        /// Bytes copied for this frame: for the network's input, for reused labels, and for resized results.
        pub bytes_copied: u64,
        /// Pixels of the depth map without a depth, after the filters: those that are NaN.
        pub invalid_pixels: u64,
        /// The name of the camera's coordinate frame, UTF-8, padded with zeros.
        pub frame_id: [u8; MAX_FRAME_ID],
        /// Factor by which the network's meters were multiplied; 0 if unknown or without meaning.
        pub scale_factor: f64,
        /// Nanoseconds since `scale_factor` was measured; 0 for one that does not change.
        pub scale_age_nanos: i64,
        /// The part of the camera's image that this message covers: its first column, pixels of the image.
        pub view_x: u32,
        /// The first row.
        pub view_y: u32,
        /// Columns; 0 if the part is unknown, and in images.
        pub view_width: u32,
        /// Rows; 0 if the part is unknown, and in images.
        pub view_height: u32,
        /// Zero; room for later fields. Public only so that `..Default::default()` works.
        pub reserved: [u8; 584],
    }
}

// SAFETY: `FrameHeader` is `repr(C)`, holds nothing but fixed-width numbers and arrays of them, and has no
// padding (asserted by `contract_struct!`), so it means the same in every process and every bit pattern of it
// is valid.
unsafe impl ZeroCopySend for FrameHeader {
    unsafe fn type_name() -> &'static str {
        HEADER_TYPE_NAME
    }
}

impl Default for FrameHeader {
    /// All zero except the version.
    fn default() -> Self {
        Self {
            contract_version: CONTRACT_VERSION,
            topic: 0,
            sequence: 0,
            capture_nanos: 0,
            capture_unix_nanos: 0,
            publish_nanos: 0,
            capture_clock: 0,
            encoding: 0,
            width: 0,
            height: 0,
            row_stride_bytes: 0,
            units: 0,
            payload_bytes: 0,
            scale_source: 0,
            quality: 0,
            fx: 0.0,
            fy: 0.0,
            cx: 0.0,
            cy: 0.0,
            distortion: [0.0; MAX_COEFFICIENTS],
            distortion_model: 0,
            stage_count: 0,
            model_hash: [0; 32],
            stage_micros: [0; MAX_STAGES],
            bytes_copied: 0,
            invalid_pixels: 0,
            frame_id: [0; MAX_FRAME_ID],
            scale_factor: 0.0,
            scale_age_nanos: 0,
            view_x: 0,
            view_y: 0,
            view_width: 0,
            view_height: 0,
            reserved: [0; 584],
        }
    }
}

// The getter returns an error for a number that the setter cannot have written.
macro_rules! word {
    ($getter:ident, $setter:ident, $field:ident, $kind:ident) => {
        #[doc = concat!("The field `", stringify!($field), "` as a word.")]
        ///
        /// # Errors
        /// [`UnknownValue`] when the sender wrote a number that this contract does not define.
        pub fn $getter(&self) -> Result<$kind, UnknownValue> {
            $kind::try_from(self.$field)
        }

        #[doc = concat!("Sets the field `", stringify!($field), "`.")]
        pub fn $setter(&mut self, value: $kind) {
            self.$field = value.into();
        }
    };
}

impl FrameHeader {
    word!(topic, set_topic, topic, Topic);
    word!(encoding, set_encoding, encoding, Encoding);
    word!(units, set_units, units, Units);
    word!(scale_source, set_scale_source, scale_source, ScaleSource);
    word!(capture_clock, set_capture_clock, capture_clock, Clock);
    word!(distortion_model, set_distortion_model, distortion_model, DistortionModel);
    word!(quality, set_quality, quality, Quality);

    /// The name of the camera's coordinate frame; invalid UTF-8 is replaced.
    #[must_use]
    pub fn frame_id(&self) -> Cow<'_, str> {
        text(&self.frame_id)
    }

    /// Sets the name of the camera's coordinate frame, cut to [`MAX_FRAME_ID`] bytes.
    pub fn set_frame_id(&mut self, name: &str) {
        set_text(&mut self.frame_id, name);
    }

    /// Microseconds of each stage; a `stage_count` beyond the array is cut to it.
    #[must_use]
    pub fn stages(&self) -> &[u32] {
        &self.stage_micros[..(self.stage_count as usize).min(MAX_STAGES)]
    }

    /// Sets the stages' times; those beyond [`MAX_STAGES`] are dropped.
    pub fn set_stages(&mut self, micros: impl IntoIterator<Item = u32>) {
        self.stage_micros = [0; MAX_STAGES];
        self.stage_count = 0;
        for (slot, value) in self.stage_micros.iter_mut().zip(micros) {
            *slot = value;
            self.stage_count += 1;
        }
    }

    /// Identifies the frame that a message belongs to: `sequence` and `capture_nanos`. The number alone is
    /// not enough, because some publishers do not count, and a restarted one counts from 0 again.
    #[must_use]
    pub fn key(&self) -> (u64, i64) {
        (self.sequence, self.capture_nanos)
    }

    /// The capture time in nanoseconds since 1970-01-01 UTC: `capture_unix_nanos`, or if that is 0,
    /// `capture_nanos` converted from `capture_clock`. A position in a recording cannot be converted; the
    /// result is `now_unix` then.
    ///
    /// `now_monotonic`, `now_unix`: [`monotonic_nanos`](crate::monotonic_nanos) and
    /// [`unix_nanos`](crate::unix_nanos).
    #[must_use]
    pub fn unix_of_capture(&self, now_monotonic: i64, now_unix: i64) -> i64 {
        match self.capture_clock() {
            _ if self.capture_unix_nanos != 0 => self.capture_unix_nanos,
            Ok(Clock::Monotonic) => now_unix.saturating_sub(now_monotonic.saturating_sub(self.capture_nanos)),
            Ok(Clock::Unix) => self.capture_nanos,
            Ok(Clock::Media) | Err(_) => now_unix,
        }
    }

    /// Nanoseconds since capture: by the monotonic clock if the camera uses it, because that clock is never
    /// adjusted, otherwise by the time of day. `None` where neither is known.
    ///
    /// `now_monotonic`, `now_unix`: [`monotonic_nanos`](crate::monotonic_nanos) and
    /// [`unix_nanos`](crate::unix_nanos).
    #[must_use]
    pub fn age_nanos(&self, now_monotonic: i64, now_unix: i64) -> Option<i64> {
        match self.capture_clock() {
            Ok(Clock::Monotonic) => Some(now_monotonic.saturating_sub(self.capture_nanos)),
            _ if self.capture_unix_nanos != 0 => Some(now_unix.saturating_sub(self.capture_unix_nanos)),
            _ => None,
        }
    }

    /// The camera at the size of this message; `None` where the sender does not know it.
    ///
    /// # Errors
    /// [`UnknownValue`] for a lens model that this contract does not define. Nothing else is checked.
    pub fn camera(&self) -> Result<Option<CameraInfo>, UnknownValue> {
        if !self.has_intrinsics() {
            return Ok(None);
        }
        Ok(Some(CameraInfo {
            size: ImageSize::new(self.width, self.height),
            fx_px: self.fx,
            fy_px: self.fy,
            cx_px: self.cx,
            cy_px: self.cy,
            distortion_model: self.distortion_model()?,
            distortion: self.distortion,
        }))
    }

    /// Sets the camera, which must be one of the message's size: `width` and `height` do not change.
    pub fn set_camera(&mut self, camera: &CameraInfo) {
        (self.fx, self.fy) = (camera.fx_px, camera.fy_px);
        (self.cx, self.cy) = (camera.cx_px, camera.cy_px);
        self.set_distortion_model(camera.distortion_model);
        self.distortion = camera.distortion;
    }

    /// The part of the camera's image that this message covers; `None` if it is unknown, and in images.
    #[must_use]
    pub fn view(&self) -> Option<PixelRect> {
        let Self { view_x: x, view_y: y, view_width: width, view_height: height, .. } = *self;
        (width > 0 && height > 0).then_some(PixelRect { x, y, width, height })
    }

    /// Sets the part of the camera's image that this message covers.
    pub fn set_view(&mut self, PixelRect { x, y, width, height }: PixelRect) {
        (self.view_x, self.view_y, self.view_width, self.view_height) = (x, y, width, height);
    }

    /// Whether the camera's intrinsics are known.
    #[must_use]
    pub fn has_intrinsics(&self) -> bool {
        self.fx > 0.0 && self.fy > 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stages_beyond_the_array_are_dropped() {
        let mut header = FrameHeader::default();
        header.set_stages(0..20);
        assert_eq!(header.stages().len(), MAX_STAGES);
        header.stage_count = u32::MAX; // as a hostile sender might write
        assert_eq!(header.stages().len(), MAX_STAGES);
    }

    fn taken(clock: Clock, capture_nanos: i64, capture_unix_nanos: i64) -> FrameHeader {
        let mut header = FrameHeader { capture_nanos, capture_unix_nanos, ..FrameHeader::default() };
        header.set_capture_clock(clock);
        header
    }

    #[test]
    fn capture_times_are_converted_to_the_shared_clock() {
        let unix = |header: FrameHeader| header.unix_of_capture(1000, 50_000);
        assert_eq!(unix(taken(Clock::Monotonic, 900, 0)), 49_900);
        assert_eq!(unix(taken(Clock::Unix, 900, 0)), 900);
        assert_eq!(unix(taken(Clock::Media, 900, 0)), 50_000, "a recording is played now");
        assert_eq!(unix(FrameHeader { capture_clock: 9, ..FrameHeader::default() }), 50_000);
        assert_eq!(unix(taken(Clock::Media, 900, 7)), 7, "who knows better is believed");
        assert_eq!(unix(taken(Clock::Monotonic, i64::MIN, 0)), 50_000 - i64::MAX);
    }

    #[test]
    fn the_age_uses_the_monotonic_clock_if_there_is_one() {
        let age = |header: FrameHeader| header.age_nanos(1000, 50_000);
        assert_eq!(age(taken(Clock::Monotonic, 900, 1)), Some(100));
        assert_eq!(age(taken(Clock::Unix, 49_000, 49_000)), Some(1000));
        assert_eq!(age(taken(Clock::Media, 900, 49_500)), Some(500));
        assert_eq!(age(taken(Clock::Media, 900, 0)), None, "not the years since 1970");
        assert_eq!(age(taken(Clock::Media, 900, i64::MIN)), Some(i64::MAX));
        assert_eq!(age(taken(Clock::Monotonic, i64::MIN, 0)), Some(i64::MAX));
    }

    #[test]
    fn a_camera_reads_back_from_a_header_at_its_size() {
        let camera = CameraInfo {
            size: ImageSize::new(640, 480),
            fx_px: 500.0,
            fy_px: 501.0,
            cx_px: 320.0,
            cy_px: 240.0,
            distortion_model: DistortionModel::KannalaBrandt,
            distortion: std::array::from_fn(|index| index as f64),
        };
        let mut header = FrameHeader { width: 640, height: 480, ..FrameHeader::default() };
        assert_eq!(header.camera(), Ok(None));
        header.set_camera(&camera);
        assert_eq!(header.camera(), Ok(Some(camera)));
        header.distortion_model = 9;
        let unknown = UnknownValue { field: "distortion_model", value: 9, last: 2 };
        assert_eq!(header.camera(), Err(unknown));
    }

    #[test]
    fn a_default_header_has_unknown_values() {
        let header = FrameHeader::default();
        assert_eq!(header.contract_version, CONTRACT_VERSION);
        assert_eq!(header.units(), Ok(Units::None));
        assert!(!header.has_intrinsics());
        assert_eq!(header.frame_id(), "");
    }
}
