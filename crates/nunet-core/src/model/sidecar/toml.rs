//! A sidecar's text: the keys and their defaults.

use std::collections::BTreeMap;

use nunet_types::{ImageSize, counted};
use serde::de::Error as _;
use serde::{Deserialize, Deserializer};

use super::SidecarError;
use crate::depth::{DepthRange, OutputScale};
use crate::model::{ExtraInput, TrainingCamera, unlimited};
use crate::preprocess::{ChannelOrder, TensorFormat, TensorLayout};
use crate::text::shortened;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SidecarFile {
    pub(super) input: InputTable,
    #[serde(default)]
    pub(super) inputs: BTreeMap<String, toml::Value>,
    pub(super) output: OutputTable,
    pub(super) camera: Option<CameraTable>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct InputTable {
    pub(super) tensor: String,
    layout: LayoutName,
    #[serde(default)]
    dtype: Dtype,
    #[serde(default)]
    color: ColorName,
    #[serde(deserialize_with = "exactly")]
    pub(super) size: [u32; 2],
    #[serde(default, deserialize_with = "exactly")]
    mean: [f32; 3],
    #[serde(default = "ones", deserialize_with = "exactly")]
    std: [f32; 3],
    #[serde(default = "one")]
    scale: f32,
}

#[derive(Deserialize, Clone, Copy, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
enum LayoutName {
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
enum ColorName {
    #[default]
    Rgb,
    Bgr,
}

/// A list of `N` values. serde ignores those behind the last one.
fn exactly<'de, D: Deserializer<'de>, T: Deserialize<'de>, const N: usize>(
    deserializer: D,
) -> Result<[T; N], D::Error> {
    let values = Vec::deserialize(deserializer)?;
    let expected =
        |values: Vec<T>| D::Error::custom(format!("it has {}, expected {N}", counted(values.len(), "value")));
    values.try_into().map_err(expected)
}

fn one() -> f32 {
    1.0
}

fn ones() -> [f32; 3] {
    [1.0; 3]
}

impl InputTable {
    pub(super) fn format(&self) -> Result<Option<TensorFormat>, SidecarError> {
        let finite = |values: &[f32; 3]| values.iter().all(|value| value.is_finite());
        let sound = |factor: &f32| factor.is_finite() && *factor != 0.0;
        if !sound(&self.scale) || !finite(&self.mean) || !self.std.iter().all(sound) {
            return Err(SidecarError::Normalization);
        }
        let unchanged = self.scale == 1.0 && self.mean == [0.0; 3] && self.std == ones();
        match self.dtype {
            Dtype::Float32 => Ok(Some(TensorFormat {
                layout: if self.layout == LayoutName::Nchw { TensorLayout::Nchw } else { TensorLayout::Nhwc },
                channels: if self.color == ColorName::Rgb { ChannelOrder::Rgb } else { ChannelOrder::Bgr },
                scale: self.scale,
                mean: self.mean,
                std: self.std,
            })),
            Dtype::Uint8 if self.layout == LayoutName::Nhwc && self.color == ColorName::Rgb && unchanged => {
                Ok(None)
            }
            Dtype::Uint8 => Err(SidecarError::Uint8),
        }
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct OutputTable {
    pub(super) depth: String,
    pub(super) encoding: String,
    min_m: Option<f32>,
    max_m: Option<f32>,
    #[serde(default = "one")]
    scale: f32,
    #[serde(default)]
    shift: f32,
}

impl OutputTable {
    pub(super) fn range(&self) -> Result<DepthRange, SidecarError> {
        let min_m = self.min_m.unwrap_or(unlimited().min_m());
        let max_m = self.max_m.unwrap_or(unlimited().max_m());
        Ok(DepthRange::new(min_m, max_m)?)
    }

    pub(super) fn scale(&self) -> Result<OutputScale, SidecarError> {
        Ok(OutputScale::new(self.scale, self.shift)?)
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CameraTable {
    width: Option<u32>,
    height: Option<u32>,
    fx: f64,
    fy: Option<f64>,
}

impl CameraTable {
    /// The training camera. Without a size its focal lengths are at the network's.
    pub(super) fn training_camera(
        &self,
        ImageSize { width, height }: ImageSize,
    ) -> Result<TrainingCamera, SidecarError> {
        let camera = TrainingCamera {
            width: self.width.unwrap_or(width),
            height: self.height.unwrap_or(height),
            fx: self.fx,
            fy: self.fy.unwrap_or(self.fx),
        };
        camera.check().map(|()| camera).map_err(|error| SidecarError::Camera(error.into()))
    }
}

/// The value of one key of `[inputs]`.
pub(super) fn extra_input(input: &str, value: &toml::Value) -> Result<ExtraInput, SidecarError> {
    let invalid = || SidecarError::Input { input: input.to_owned(), value: shortened(&value.to_string()) };
    if let toml::Value::String(name) = value {
        let known = ExtraInput::NAMES.into_iter().find(|(known, _)| known == name);
        return known.map(|(_, input)| input).ok_or_else(invalid);
    }
    let mut numbers = Vec::new();
    flatten(value, &mut numbers).ok_or_else(invalid)?;
    if numbers.is_empty() { Err(invalid()) } else { Ok(ExtraInput::Constant(numbers)) }
}

/// Collects the numbers of a value and of its nested lists; `None` for anything else in them.
fn flatten(value: &toml::Value, numbers: &mut Vec<f64>) -> Option<()> {
    match value {
        toml::Value::Integer(number) => numbers.push(*number as f64),
        toml::Value::Float(number) => numbers.push(*number),
        toml::Value::Boolean(flag) => numbers.push(f64::from(u8::from(*flag))),
        toml::Value::Array(list) => list.iter().try_for_each(|value| flatten(value, numbers))?,
        _ => return None,
    }
    Some(())
}
