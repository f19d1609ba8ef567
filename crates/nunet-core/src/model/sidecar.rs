//! A foreign network's description: `NAME.toml` beside `NAME.onnx`.

use serde::Deserialize;

use super::{FOREIGN, ModelDescription, unlimited};
use crate::depth::{DepthRange, Encoding};
use crate::frame::MAX_SIDE_PX;
use crate::preprocess::{ChannelOrder, TensorFormat, TensorLayout};
use crate::text::shortened;

/// What a foreign network takes and gives, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Sidecar {
    /// The name of the input tensor.
    pub input: String,
    /// How it wants its picture; `None` for camera bytes, `uint8 [1, H, W, 3]`, RGB.
    pub format: Option<TensorFormat>,
    /// Width and height of the picture, pixels.
    pub size: (u32, u32),
    /// The name of the depth tensor.
    pub depth: String,
    /// What its numbers mean.
    pub encoding: Encoding,
    /// The depths that the network can measure, metres.
    pub range: DepthRange,
}

impl Sidecar {
    /// Reads a sidecar's text.
    ///
    /// # Errors
    /// What is wrong, in words for [`super::ModelError::Sidecar`].
    pub fn parse(text: &str) -> Result<Self, String> {
        Self::of_toml(text).map_err(|reason| shortened(&reason))
    }

    fn of_toml(text: &str) -> Result<Self, String> {
        let file: File = toml::from_str(text).map_err(|error| error.to_string())?;
        let [height, width] = file.input.size;
        if ![height, width].iter().all(|side| (1..=MAX_SIDE_PX).contains(side)) {
            return Err(format!("`size = [{height}, {width}]`; sides are 1 to {MAX_SIDE_PX}"));
        }
        Ok(Self {
            format: file.input.format()?,
            input: file.input.tensor,
            size: (width, height),
            encoding: file.output.encoding.parse().map_err(|error| format!("{error}"))?,
            range: file.output.range()?,
            depth: file.output.depth,
        })
    }

    /// The shape of the input tensor.
    #[must_use]
    pub fn image_shape(&self) -> [i64; 4] {
        let (width, height) = (i64::from(self.size.0), i64::from(self.size.1));
        match self.format.map(|format| format.layout) {
            Some(TensorLayout::Nchw) => [1, 3, height, width],
            Some(TensorLayout::Nhwc) | None => [1, height, width, 3],
        }
    }

    /// The description of the network, whose file has the hash `hash`. Nothing is known of its training: it counts
    /// as trained, and its depth as of any camera.
    #[must_use]
    pub fn describe(&self, hash: [u8; 32]) -> ModelDescription {
        ModelDescription {
            architecture: FOREIGN.to_owned(),
            components: Vec::new(),
            encoding: self.encoding,
            range: self.range,
            classes: Vec::new(),
            camera: None,
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

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    input: Input,
    output: Output,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Input {
    tensor: String,
    layout: Layout,
    #[serde(default)]
    dtype: Dtype,
    #[serde(default)]
    color: Color,
    size: [u32; 2],
    #[serde(default)]
    mean: [f32; 3],
    #[serde(default = "ones")]
    std: [f32; 3],
    #[serde(default = "one")]
    scale: f32,
}

#[derive(Deserialize, Clone, Copy, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
enum Layout {
    Nchw,
    Nhwc,
}

#[derive(Deserialize, Clone, Copy, PartialEq, Eq, Default)]
#[serde(rename_all = "lowercase")]
enum Dtype {
    #[default]
    Float32,
    Uint8,
}

#[derive(Deserialize, Clone, Copy, PartialEq, Eq, Default)]
#[serde(rename_all = "lowercase")]
enum Color {
    #[default]
    Rgb,
    Bgr,
}

fn one() -> f32 {
    1.0
}

fn ones() -> [f32; 3] {
    [1.0; 3]
}

impl Input {
    fn format(&self) -> Result<Option<TensorFormat>, String> {
        let finite = |values: &[f32; 3]| values.iter().all(|value| value.is_finite());
        if !self.scale.is_finite() || !finite(&self.mean) || !finite(&self.std) || self.std.contains(&0.0) {
            return Err("`scale`, `mean` and `std` must be finite, and `std` not 0".to_owned());
        }
        let as_it_lies = self.scale == 1.0 && self.mean == [0.0; 3] && self.std == ones();
        match self.dtype {
            Dtype::Float32 => Ok(Some(TensorFormat {
                layout: if self.layout == Layout::Nchw { TensorLayout::Nchw } else { TensorLayout::Nhwc },
                channels: if self.color == Color::Rgb { ChannelOrder::Rgb } else { ChannelOrder::Bgr },
                scale: self.scale,
                mean: self.mean,
                std: self.std,
            })),
            Dtype::Uint8 if self.layout == Layout::Nhwc && self.color == Color::Rgb && as_it_lies => Ok(None),
            Dtype::Uint8 => {
                Err("`dtype = \"uint8\"` takes `nhwc`, `rgb`, and no `mean`, `std` or `scale`".to_owned())
            }
        }
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Output {
    depth: String,
    encoding: String,
    min_m: Option<f32>,
    max_m: Option<f32>,
}

impl Output {
    fn range(&self) -> Result<DepthRange, String> {
        let min_m = self.min_m.unwrap_or(unlimited().min_m());
        let max_m = self.max_m.unwrap_or(unlimited().max_m());
        DepthRange::new(min_m, max_m).map_err(|error| error.to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
        assert_eq!(sidecar.size, (256, 192));
        assert_eq!(sidecar.image_shape(), [1, 3, 192, 256]);
        let format = sidecar.format.unwrap();
        assert_eq!((format.layout, format.channels), (TensorLayout::Nchw, ChannelOrder::Bgr));
        assert_eq!(format.std, [0.229, 0.224, 0.225]);
        assert_eq!(sidecar.encoding, Encoding::Relative);
    }

    #[test]
    fn bytes_are_bound_as_they_lie() {
        let text = "[input]\ntensor = \"x\"\nlayout = \"nhwc\"\ndtype = \"uint8\"\nsize = [2, 4]\n\
                    [output]\ndepth = \"y\"\nencoding = \"metric\"\nmax_m = 80\n";
        let sidecar = Sidecar::parse(text).unwrap();
        assert_eq!(sidecar.format, None);
        assert_eq!(sidecar.image_shape(), [1, 2, 4, 3]);
        assert!(Sidecar::parse(&text.replace("nhwc", "nchw")).is_err());
    }

    #[test]
    fn what_is_wrong_is_said() {
        for (from, to, says) in [
            ("tensor = \"x\"", "tensr = \"x\"", "unknown field `tensr`"),
            ("nchw", "chw", "unknown variant `chw`"),
            ("[192, 256]", "[0, 256]", "sides are 1 to"),
            ("[0.229, 0.224, 0.225]", "[0, 1, 1]", "`std` not 0"),
            ("relative", "disparity", "no depth encoding"),
            ("encoding =", "min_m = 5\nmax_m = 1\nencoding =", "depth range"),
            ("[output]", "[outputs]", "unknown field `outputs`"),
        ] {
            let error = Sidecar::parse(&MIDAS_LIKE.replace(from, to)).unwrap_err();
            assert!(error.contains(says), "{to}: {error}");
        }
    }
}
