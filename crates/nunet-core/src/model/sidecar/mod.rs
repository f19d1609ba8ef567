//! A foreign network's description: `NAME.toml` beside `NAME.onnx`.

mod error;
mod toml;

use std::collections::BTreeMap;

use nunet_types::ImageSize;

pub use error::SidecarError;

use super::{ExtraInput, FOREIGN, ModelDescription, TrainingCamera};
use crate::depth::{DepthEncoding, DepthRange, OutputScale};
use crate::frame::MAX_SIDE_PX;
use crate::preprocess::{TensorFormat, TensorLayout};
use crate::text::shortened;

/// What a foreign network takes and returns, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Sidecar {
    /// The name of the image tensor.
    pub input: String,
    /// The format of the image tensor; `None` for camera bytes, `uint8 [1, H, W, 3]`, RGB.
    pub format: Option<TensorFormat>,
    /// Width and height of the image, pixels.
    pub size: ImageSize,
    /// The other inputs, by name.
    pub extra_inputs: BTreeMap<String, ExtraInput>,
    /// The name of the depth tensor.
    pub depth: String,
    /// What its values mean.
    pub encoding: DepthEncoding,
    /// The linear map that is applied to its values first.
    pub output_scale: OutputScale,
    /// The depths that the network can measure, meters.
    pub range: DepthRange,
    /// The camera that the network's meters hold for.
    pub camera: Option<TrainingCamera>,
}

impl Sidecar {
    /// Parses a sidecar.
    ///
    /// # Errors
    /// Text that is not TOML, unknown or missing keys, values out of range.
    pub fn parse(text: &str) -> Result<Self, SidecarError> {
        let file: toml::SidecarFile = ::toml::from_str(text)
            .map_err(|error| SidecarError::Syntax { reason: shortened(&error.to_string()) })?;
        let [height, width] = file.input.size;
        if ![height, width].iter().all(|side| (1..=MAX_SIDE_PX).contains(side)) {
            return Err(SidecarError::Size { height, width });
        }
        let size = ImageSize { width, height };
        if file.inputs.contains_key(&file.input.tensor) {
            return Err(SidecarError::ImageTwice { input: file.input.tensor });
        }
        let extra_input = |(name, value): (&String, &::toml::Value)| {
            toml::extra_input(name, value).map(|input| (name.clone(), input))
        };
        Ok(Self {
            format: file.input.format()?,
            size,
            extra_inputs: file.inputs.iter().map(extra_input).collect::<Result<_, _>>()?,
            encoding: file.output.encoding.parse()?,
            output_scale: file.output.scale()?,
            range: file.output.range()?,
            camera: file.camera.map(|camera| camera.training_camera(size)).transpose()?,
            input: file.input.tensor,
            depth: file.output.depth,
        })
    }

    /// The shape of the image tensor.
    #[must_use]
    pub fn image_shape(&self) -> [i64; 4] {
        let (width, height) = (i64::from(self.size.width), i64::from(self.size.height));
        match self.format.map(|format| format.layout) {
            Some(TensorLayout::Nchw) => [1, 3, height, width],
            Some(TensorLayout::Nhwc) | None => [1, height, width, 3],
        }
    }

    /// The description of the network whose file has the hash `hash`. It counts as trained.
    #[must_use]
    pub fn describe(&self, hash: [u8; 32]) -> ModelDescription {
        ModelDescription {
            architecture: FOREIGN.to_owned(),
            components: Vec::new(),
            encoding: self.encoding,
            output_scale: self.output_scale,
            range: self.range,
            classes: Vec::new(),
            camera: self.camera,
            inner_size: None,
            trained: true,
            training: serde_json::Value::Null,
            accuracy: serde_json::Value::Null,
            license: None,
            targets: Vec::new(),
            selftest: None,
            hash,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::depth::DepthError;
    use crate::preprocess::ChannelOrder;

    const MIDAS_LIKE: &str = r#"
        [input]
        tensor = "x"
        layout = "nchw"
        dtype = "float32"
        color = "bgr"
        size = [192, 256]
        mean = [0.485, 0.456, 0.406]
        std = [0.229, 0.224, 0.225]
        scale = 0.00392156862745098
        [output]
        depth = "y"
        encoding = "relative"
    "#;

    #[test]
    fn the_documented_keys_are_read() {
        let sidecar = Sidecar::parse(MIDAS_LIKE).unwrap();
        assert_eq!(sidecar.size, ImageSize::new(256, 192));
        assert_eq!(sidecar.image_shape(), [1, 3, 192, 256]);
        let format = sidecar.format.unwrap();
        assert_eq!((format.layout, format.channels), (TensorLayout::Nchw, ChannelOrder::Bgr));
        assert_eq!(format.std, [0.229, 0.224, 0.225]);
        assert_eq!(sidecar.encoding, DepthEncoding::Relative);
    }

    #[test]
    fn a_sidecar_may_begin_with_a_byte_order_mark() {
        assert_eq!(Sidecar::parse(&format!("\u{feff}{MIDAS_LIKE}")), Sidecar::parse(MIDAS_LIKE));
    }

    #[test]
    fn camera_bytes_are_passed_on_unchanged() {
        let text = "[input]\ntensor = \"x\"\nlayout = \"nhwc\"\ndtype = \"uint8\"\nsize = [2, 4]\n\
                    [output]\ndepth = \"y\"\nencoding = \"metric\"\nmax_m = 80\n";
        let sidecar = Sidecar::parse(text).unwrap();
        assert_eq!(sidecar.format, None);
        assert_eq!(sidecar.image_shape(), [1, 2, 4, 3]);
        assert_eq!(Sidecar::parse(&text.replace("nhwc", "nchw")), Err(SidecarError::Uint8));
    }

    #[test]
    fn the_training_camera_is_read_and_its_size_defaults_to_the_networks() {
        let camera =
            |table: &str| Sidecar::parse(&format!("{MIDAS_LIKE}\n[camera]\n{table}")).map(|it| it.camera);
        let canonical = TrainingCamera { width: 256, height: 192, fx: 1000.0, fy: 1000.0 };
        assert_eq!(camera("fx = 1000"), Ok(Some(canonical)));
        let own = TrainingCamera { width: 640, height: 480, fx: 518.9, fy: 519.5 };
        assert_eq!(camera("width = 640\nheight = 480\nfx = 518.9\nfy = 519.5"), Ok(Some(own)));
        for table in ["fx = 0", "fx = 500\nwidth = 0", "fx = 3.6", "fx = 50\nfy = 500"] {
            assert!(matches!(camera(table), Err(SidecarError::Camera(_))), "{table}");
        }
        assert_eq!(Sidecar::parse(MIDAS_LIKE).unwrap().camera, None);
    }

    #[test]
    fn other_inputs_are_constants_or_follow_the_camera() {
        let inputs = |table: &str| {
            Sidecar::parse(&format!("{MIDAS_LIKE}\n[inputs]\n{table}")).map(|it| it.extra_inputs)
        };
        let read =
            inputs("num_tokens = 1800\nflag = true\nK = \"intrinsics\"\nm = [[1, 2.5], [3, 4]]").unwrap();
        assert_eq!(read["num_tokens"], ExtraInput::Constant(vec![1800.0]));
        assert_eq!(read["flag"], ExtraInput::Constant(vec![1.0]));
        assert_eq!(read["K"], ExtraInput::Intrinsics);
        assert_eq!(read["m"], ExtraInput::Constant(vec![1.0, 2.5, 3.0, 4.0]));
        for value in ["\"camera\"", "[]", "[1, \"two\"]", "{ a = 1 }"] {
            let error = inputs(&format!("K = {value}")).unwrap_err();
            assert!(matches!(&error, SidecarError::Input { input, .. } if input == "K"), "{error}");
        }
        let twice = SidecarError::ImageTwice { input: "x".to_owned() };
        assert_eq!(inputs("x = 1"), Err(twice));
    }

    #[test]
    fn scale_and_shift_of_the_output_are_read() {
        let text = MIDAS_LIKE.replace("\"relative\"", "\"inverse\"\nscale = 9.99\nshift = 0.01");
        let sidecar = Sidecar::parse(&text).unwrap();
        assert_eq!(sidecar.output_scale, OutputScale::new(9.99, 0.01).unwrap());
        assert_eq!(Sidecar::parse(MIDAS_LIKE).unwrap().output_scale, OutputScale::IDENTITY);
        let error = Sidecar::parse(&text.replace("9.99", "0")).unwrap_err();
        assert!(matches!(error, SidecarError::Depth(DepthError::OutputScale { .. })), "{error}");
    }

    #[test]
    fn invalid_values_are_refused() {
        for (from, to, expected) in [
            ("[192, 256]", "[0, 256]", SidecarError::Size { height: 0, width: 256 }),
            ("[0.229, 0.224, 0.225]", "[0, 1, 1]", SidecarError::Normalization),
            ("0.00392156862745098", "0", SidecarError::Normalization),
            (
                "relative",
                "disparity",
                SidecarError::Depth(DepthError::UnknownEncoding { text: "disparity".to_owned() }),
            ),
            (
                "encoding =",
                "min_m = 5\nmax_m = 1\nencoding =",
                SidecarError::Depth(DepthError::Range { min_m: 5.0, max_m: 1.0 }),
            ),
        ] {
            assert_eq!(Sidecar::parse(&MIDAS_LIKE.replace(from, to)), Err(expected), "{to}");
        }
    }

    #[test]
    fn unknown_keys_and_values_are_refused_by_name() {
        for (from, to, says) in [
            ("tensor = \"x\"", "tensr = \"x\"", "unknown field `tensr`"),
            ("nchw", "chw", "unknown variant `chw`"),
            ("[output]", "[outputs]", "unknown field `outputs`"),
            ("[0.485, 0.456, 0.406]", "[0.485, 0.456, 0.406, 0.5]", "it has 4 values, expected 3"),
            ("[0.229, 0.224, 0.225]", "[0.229, 0.224]", "it has 2 values, expected 3"),
            ("[192, 256]", "[192, 256, 3]", "it has 3 values, expected 2"),
        ] {
            let error = Sidecar::parse(&MIDAS_LIKE.replace(from, to)).unwrap_err();
            let SidecarError::Syntax { reason } = &error else { panic!("{error}") };
            assert!(reason.contains(says), "{to}: {reason}");
        }
    }
}
