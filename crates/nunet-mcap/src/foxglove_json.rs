//! Foxglove's messages in JSON. All spellings of its tools are accepted.
//!
//! The published schemas spell the matrices `D K R P`; Foxglove's own Rust types write `d k r p`. Optional fields may be
//! absent, and protobuf's JSON mapping writes `frameId` and `distortionModel`.

use base64::Engine as _;
use base64::alphabet;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use serde::de::{DeserializeOwned, Error as _};
use serde::{Deserialize, Deserializer};
use serde_json::Value;

const NANOS_PER_SEC: i64 = 1_000_000_000;

pub(crate) fn decode<T: DeserializeOwned>(message: &[u8]) -> Result<T, String> {
    serde_json::from_slice(message).map_err(|error| format!("{error:.200}"))
}

/// `foxglove.CameraCalibration`
#[derive(Debug, Deserialize)]
pub(crate) struct CameraCalibration {
    pub(crate) width: u32,
    pub(crate) height: u32,
    #[serde(default, alias = "distortionModel")]
    pub(crate) distortion_model: String,
    #[serde(default, alias = "D")]
    pub(crate) d: Vec<f64>,
    #[serde(alias = "K")]
    pub(crate) k: Vec<f64>,
    #[serde(default, alias = "R")]
    pub(crate) r: Vec<f64>,
    #[serde(default, alias = "P")]
    pub(crate) p: Vec<f64>,
}

/// `foxglove.RawImage`
#[derive(Debug, Deserialize)]
pub(crate) struct RawImage {
    #[serde(default)]
    pub(crate) timestamp: Stamp,
    #[serde(default, alias = "frameId")]
    pub(crate) frame_id: String,
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) encoding: String,
    pub(crate) step: u32,
    pub(crate) data: Bytes,
}

/// `foxglove.CompressedImage`
#[derive(Debug, Deserialize)]
pub(crate) struct CompressedImage {
    #[serde(default)]
    pub(crate) timestamp: Stamp,
    #[serde(default, alias = "frameId")]
    pub(crate) frame_id: String,
    pub(crate) data: Bytes,
    #[serde(default)]
    pub(crate) format: String,
}

/// Bytes in base64, or as an array of numbers.
#[derive(Debug)]
pub(crate) struct Bytes(pub(crate) Vec<u8>);

impl<'de> Deserialize<'de> for Bytes {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged)]
        enum JsonBytes {
            Base64(String),
            Numbers(Vec<u8>),
        }
        match JsonBytes::deserialize(deserializer)? {
            JsonBytes::Numbers(bytes) => Ok(Self(bytes)),
            JsonBytes::Base64(text) => {
                let decoded = base64_bytes(text);
                decoded.map(Self).map_err(|error| D::Error::custom(format!("`data` is not base64: {error}")))
            }
        }
    }
}

/// As protobuf's JSON mapping asks of readers: standard or URL-safe, with or without padding. MIME tools break the lines.
fn base64_bytes(mut text: String) -> Result<Vec<u8>, base64::DecodeError> {
    const ANY_PADDING: GeneralPurposeConfig =
        GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent);
    text.retain(|character| !character.is_ascii_whitespace());
    let alphabet = if text.contains(['-', '_']) { alphabet::URL_SAFE } else { alphabet::STANDARD };
    GeneralPurpose::new(&alphabet, ANY_PADDING).decode(text)
}

/// `{sec, nsec}`, with the names of ROS or of protobuf too. Any other form counts as unknown; the time of
/// recording replaces it.
#[derive(Debug, Default, Deserialize)]
#[serde(transparent)]
pub(crate) struct Stamp(Value);

impl Stamp {
    pub(crate) fn unix_nanos(&self) -> i64 {
        let field = |names: &[&str]| {
            let value = names.iter().find_map(|name| self.0.get(*name))?;
            value.as_i64().or_else(|| value.as_str()?.parse().ok())
        };
        let sec = field(&["sec", "secs", "seconds"]).unwrap_or_default();
        let nsec = field(&["nsec", "nsecs", "nanosec", "nanos"]).unwrap_or_default();
        sec.saturating_mul(NANOS_PER_SEC).saturating_add(nsec)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matrices_are_read_in_both_spellings_and_the_optional_fields_may_be_absent() {
        for text in [
            r#"{"K": [50, 0, 31.5, 0, 51, 24.5, 0, 0, 1], "width": 64, "height": 48}"#,
            r#"{"width": 64, "height": 48, "k": [50, 0, 31.5, 0, 51, 24.5, 0, 0, 1], "frame_id": 7}"#,
        ] {
            let camera: CameraCalibration = decode(text.as_bytes()).unwrap();
            assert_eq!((camera.k[0], camera.k[4], camera.d.len()), (50.0, 51.0, 0));
        }
        let missing = decode::<CameraCalibration>(br#"{"width": 64, "height": 48}"#).unwrap_err();
        assert!(missing.contains("missing field `k`"), "{missing}");
    }

    #[test]
    fn bytes_are_base64_or_numbers() {
        for data in [r#""BwgJ""#, "[7, 8, 9]"] {
            let message = format!(r#"{{"data": {data}}}"#);
            let image: CompressedImage = decode(message.as_bytes()).unwrap();
            assert_eq!(image.data.0, [7, 8, 9]);
        }
        for data in ["-_8=", "-_8", "+/8=", "+/8", "+/\\r\\n8=\\n", " +/8= "] {
            let message = format!(r#"{{"data": "{data}"}}"#);
            let image: CompressedImage = decode(message.as_bytes()).unwrap();
            assert_eq!(image.data.0, [0xfb, 0xff], "{data:?}");
        }
        assert!(decode::<CompressedImage>(br#"{"data": "?"}"#).unwrap_err().contains("not base64"));
    }

    #[test]
    fn stamps_of_ros_and_protobuf_are_read_and_others_are_unknown() {
        let nanos = |text| decode::<Stamp>(text).unwrap().unix_nanos();
        assert_eq!(nanos(br#"{"sec": 3, "nsec": 5}"#), 3_000_000_005);
        assert_eq!(nanos(br#"{"seconds": "3", "nanos": 5}"#), 3_000_000_005);
        assert_eq!(nanos(br#""2026-11-29T00:00:00Z""#), 0);
        assert_eq!(nanos(br#"{"sec": 9223372036854775807}"#), i64::MAX);
    }
}
