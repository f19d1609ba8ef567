//! Foxglove's messages in JSON. All spellings of its tools are accepted.
//!
//! The published schemas spell the matrices `D K R P`; Foxglove's own Rust types write `d k r p`, and some
//! tools write both. Optional fields may be absent or `null`. Protobuf's JSON mapping writes `frameId` and
//! `distortionModel`, and its readers accept whole numbers as `64`, `64.0` and `"64"`.

use crate::json_fields::Fields;

/// The names of the fields that are read.
const OF_CAMERAS: [&str; 12] =
    ["width", "height", "distortion_model", "distortionModel", "D", "d", "K", "k", "R", "r", "P", "p"];
const OF_IMAGES: [&str; 9] =
    ["timestamp", "frame_id", "frameId", "width", "height", "encoding", "step", "format", "data"];

/// `foxglove.CameraCalibration`
#[derive(Debug)]
pub(crate) struct JsonCameraCalibration {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) distortion_model: String,
    pub(crate) d: Vec<f64>,
    pub(crate) k: Vec<f64>,
    pub(crate) r: Vec<f64>,
    pub(crate) p: Vec<f64>,
}

impl JsonCameraCalibration {
    pub(crate) fn decode(message: &[u8]) -> Result<Self, String> {
        let mut fields = Fields::parse(message, &OF_CAMERAS)?;
        Ok(Self {
            width: fields.whole_number("width")?,
            height: fields.whole_number("height")?,
            distortion_model: fields.text(&["distortion_model", "distortionModel"])?.unwrap_or_default(),
            d: fields.numbers(&["D", "d"])?.unwrap_or_default(),
            k: fields.numbers(&["K", "k"])?.ok_or_else(|| missing("K"))?,
            r: fields.numbers(&["R", "r"])?.unwrap_or_default(),
            p: fields.numbers(&["P", "p"])?.unwrap_or_default(),
        })
    }
}

/// `foxglove.RawImage`
#[derive(Debug)]
pub(crate) struct JsonRawImage {
    /// Nanoseconds since 1970; 0 if unknown.
    pub(crate) unix_nanos: i64,
    pub(crate) frame_id: String,
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) encoding: String,
    pub(crate) step: u32,
    pub(crate) data: Vec<u8>,
}

impl JsonRawImage {
    pub(crate) fn decode(message: &[u8]) -> Result<Self, String> {
        let mut fields = Fields::parse(message, &OF_IMAGES)?;
        Ok(Self {
            unix_nanos: fields.stamp("timestamp"),
            frame_id: fields.text(&["frame_id", "frameId"])?.unwrap_or_default(),
            width: fields.whole_number("width")?,
            height: fields.whole_number("height")?,
            encoding: fields.text(&["encoding"])?.ok_or_else(|| missing("encoding"))?,
            step: fields.whole_number("step")?,
            data: fields.bytes()?,
        })
    }
}

/// `foxglove.CompressedImage`
#[derive(Debug)]
pub(crate) struct JsonCompressedImage {
    /// Nanoseconds since 1970; 0 if unknown.
    pub(crate) unix_nanos: i64,
    pub(crate) frame_id: String,
    pub(crate) data: Vec<u8>,
    pub(crate) format: String,
}

impl JsonCompressedImage {
    pub(crate) fn decode(message: &[u8]) -> Result<Self, String> {
        let mut fields = Fields::parse(message, &OF_IMAGES)?;
        Ok(Self {
            unix_nanos: fields.stamp("timestamp"),
            frame_id: fields.text(&["frame_id", "frameId"])?.unwrap_or_default(),
            data: fields.bytes()?,
            format: fields.text(&["format"])?.unwrap_or_default(),
        })
    }
}

fn missing(name: &str) -> String {
    format!("`{name}` is missing")
}

#[cfg(test)]
mod tests {
    use super::*;

    const K: &str = "[50, 0, 31.5, 0, 51, 24.5, 0, 0, 1]";

    fn camera(fields: &str) -> Result<JsonCameraCalibration, String> {
        JsonCameraCalibration::decode(format!("{{{fields}}}").as_bytes())
    }

    #[test]
    fn matrices_are_read_in_both_spellings_and_the_optional_fields_may_be_absent_or_null() {
        for fields in [
            format!(r#""K": {K}, "width": 64, "height": 48"#),
            format!(r#""width": 64, "height": 48, "k": {K}, "frame_id": 7"#),
            format!(r#""width": 64, "height": 48, "K": {K}, "k": {K}"#),
            format!(r#""width": 64, "height": 48, "K": [], "k": {K}, "d": []"#),
            format!(r#""width": 64, "height": 48, "K": null, "k": {K}"#),
            format!(
                r#""width": 64, "height": 48, "K": {K}, "D": null, "R": null, "P": null, "distortion_model": null"#
            ),
        ] {
            let camera = camera(&fields).unwrap();
            assert_eq!((camera.k[0], camera.k[4], camera.d.len()), (50.0, 51.0, 0), "{fields}");
            assert_eq!((camera.width, camera.distortion_model.as_str()), (64, ""));
        }
        for fields in [r#""width": 64, "height": 48"#, r#""width": 64, "height": 48, "K": null"#] {
            assert_eq!(camera(fields).unwrap_err(), "`K` is missing");
        }
    }

    #[test]
    fn numbers_are_read_as_protobufs_json_mapping_writes_them() {
        for side in ["64", "64.0", "\"64\"", "\"64.0\"", "6.4e1"] {
            assert_eq!(camera(&format!(r#""width": {side}, "height": 48, "K": {K}"#)).unwrap().width, 64);
        }
        let fields = r#""width": 64, "height": 48, "K": ["50", 0, 31.5, 0, "5.1e1", 24.5, 0, 0, 1]"#;
        assert_eq!(camera(fields).unwrap().k[4], 51.0);
    }

    #[test]
    fn an_error_names_the_field() {
        let error = |fields: &str| camera(fields).unwrap_err();
        let expected = "expected a whole number from 0 to 4294967295";
        for (side, got) in [
            ("64.5", "64.5"),
            ("-1", "-1"),
            ("4294967296", "4294967296"),
            ("\"wide\"", "\"wide\""),
            ("[]", "an array"),
            ("true", "true"),
        ] {
            let fields = format!(r#""width": {side}, "height": 48, "K": {K}"#);
            assert_eq!(error(&fields), format!("`width` is {got}, {expected}"));
        }
        assert_eq!(error(&format!(r#""width": null, "height": 48, "K": {K}"#)), "`width` is missing");
        let with = |field: &str| error(&format!(r#""width": 64, "height": 48, "K": {K}, {field}"#));
        assert_eq!(with(r#""D": [0.1, null]"#), "value 2 of `D` is null, expected a number");
        assert_eq!(with(r#""p": {"0": 1}"#), "`p` is an object, expected an array of numbers");
        assert_eq!(with(r#""distortionModel": 7"#), "`distortionModel` is 7, expected a text");
        let image =
            JsonRawImage::decode(br#"{"width": 2, "height": 1, "step": 2, "data": "Bwg="}"#).unwrap_err();
        assert_eq!(image, "`encoding` is missing");
        assert!(JsonCameraCalibration::decode(b"[1]").unwrap_err().contains("expected an object"));
        let text = format!("\"{}\"", "x".repeat(100_000));
        assert!(
            JsonCameraCalibration::decode(text.as_bytes()).unwrap_err().len() <= 200,
            "its text is shortened"
        );
    }

    #[test]
    fn bytes_are_base64_or_numbers() {
        let decode = |data: &str| JsonCompressedImage::decode(format!(r#"{{"data": {data}}}"#).as_bytes());
        for data in [r#""BwgJ""#, "[7, 8, 9]"] {
            assert_eq!(decode(data).unwrap().data, [7, 8, 9]);
        }
        for data in ["-_8=", "-_8", "+/8=", "+/8", "+/\\r\\n8=\\n", " +/8= "] {
            assert_eq!(decode(&format!("\"{data}\"")).unwrap().data, [0xfb, 0xff], "{data:?}");
        }
        assert!(decode("\"?\"").unwrap_err().contains("`data` is not base64"));
        assert_eq!(decode("[7, 256]").unwrap_err(), "value 2 of `data` is 256, expected 0 to 255");
        assert_eq!(
            decode("[7, [8, 9], 300]").unwrap_err(),
            "value 2 of `data` is an array, expected 0 to 255"
        );
        assert_eq!(decode("{\"a\": [7]}").unwrap_err(), "`data` is an object, expected base64");
        assert_eq!(decode("null").unwrap_err(), "`data` is missing");
    }

    #[test]
    fn other_fields_are_ignored_whatever_is_in_them_and_a_matrix_has_an_end() {
        let other = format!(
            r#""other": [[1], {{"K": 7, "data": null}}, {}], "k": {K}"#,
            "[".repeat(100) + &"]".repeat(100)
        );
        let fields = format!(r#""width": 64, "height": 48, {other}"#);
        assert_eq!(camera(&fields).unwrap().k[0], 50.0);
        let long = format!(r#""width": 64, "height": 48, "k": [{}1]"#, "1,".repeat(1000));
        assert_eq!(camera(&long).unwrap_err(), "`k` has more than 64 values");
        assert!(camera(&format!("{fields}}} {{")).is_err(), "something follows");
    }

    #[test]
    fn stamps_of_ros_and_protobuf_are_read_and_others_are_unknown() {
        let nanos = |stamp: &str| {
            let message = format!(r#"{{"data": "", "timestamp": {stamp}}}"#);
            JsonCompressedImage::decode(message.as_bytes()).unwrap().unix_nanos
        };
        assert_eq!(nanos(r#"{"sec": 3, "nsec": 5}"#), 3_000_000_005);
        assert_eq!(nanos(r#"{"seconds": "3", "nanos": 5}"#), 3_000_000_005);
        assert_eq!(nanos(r#"{"sec": 3.0, "nsec": null}"#), 3_000_000_000);
        assert_eq!(nanos(r#"{"sec": 9223372036854775807}"#), i64::MAX);
        for unknown in [r#""2026-11-29T00:00:00Z""#, "null", "7"] {
            assert_eq!(nanos(unknown), 0, "{unknown}");
        }
    }
}
