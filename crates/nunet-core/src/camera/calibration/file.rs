//! A calibration's text: YAML of ROS, of a printed message, of OpenCV or of Kalibr.

use nunet_types::SensorRegion;
use serde::Deserialize;

use super::document::first_document;
use super::yaml::parse_yaml;
use super::{Calibration, CalibrationError, RosCalibration, kalibr, opencv, scale};

/// Parses any of the formats.
pub(super) fn parse(text: &str) -> Result<Calibration, CalibrationError> {
    let document = first_document(text);
    let scale = scale::parse(&document)?;
    let calibration = if kalibr::is_camchain(&document) {
        kalibr::calibration(parse_yaml(&document)?)?
    } else {
        parse_yaml::<CameraInfoFile>(&document)?.calibration(&document)?
    };
    Ok(Calibration { scale, ..calibration })
}

/// The keys that are read of a file and of a printed message; others are ignored. All are optional here, so
/// that a missing one is an error of ours.
#[derive(Deserialize)]
struct CameraInfoFile {
    #[serde(alias = "width", alias = "image_Width")]
    image_width: Option<u32>,
    #[serde(alias = "height", alias = "image_Height")]
    image_height: Option<u32>,
    #[serde(alias = "Camera_Matrix", alias = "cameraMatrix")]
    camera_matrix: Option<Matrix>,
    distortion_model: Option<String>,
    #[serde(alias = "Distortion_Coefficients", alias = "distCoeffs")]
    distortion_coefficients: Option<Matrix>,
    /// The camera matrix of a message; ROS 1 writes `K` and `D`.
    #[serde(alias = "K")]
    k: Option<Vec<f64>>,
    /// The lens coefficients of a message.
    #[serde(alias = "D")]
    d: Option<Vec<f64>>,
    binning_x: Option<u32>,
    binning_y: Option<u32>,
    roi: Option<RegionFields>,
    /// OpenCV's calibration program writes it for a fisheye.
    fisheye_model: Option<i64>,
}

#[derive(Deserialize)]
struct Matrix {
    rows: Option<usize>,
    cols: Option<usize>,
    data: Option<Vec<f64>>,
}

#[derive(Deserialize, Default, Clone, Copy)]
#[serde(default)]
struct RegionFields {
    x_offset: u32,
    y_offset: u32,
    width: u32,
    height: u32,
}

impl CameraInfoFile {
    /// `text` is the file.
    fn calibration(self, text: &str) -> Result<Calibration, CalibrationError> {
        let region = self.region();
        let width = present("image_width", self.image_width)?;
        let height = present("image_height", self.image_height)?;
        let numbers = |key, matrix: Option<Matrix>, flat: Option<Vec<f64>>| match flat {
            Some(numbers) => Ok(numbers),
            None => present(key, matrix)?.numbers(key),
        };
        let k = numbers("camera_matrix", self.camera_matrix, self.k)?;
        let d = numbers("distortion_coefficients", self.distortion_coefficients, self.d);
        let is_fisheye = self.fisheye_model.is_some_and(|flag| flag != 0);
        let of_opencv = opencv::lens_model(text, is_fisheye, d.as_ref().map_or(0, Vec::len));
        let model = present("distortion_model", self.distortion_model.or(of_opencv.map(str::to_owned)))?;
        let d = d?;
        Calibration::from_ros(&RosCalibration {
            width,
            height,
            k: &k,
            distortion_model: &model,
            d: &d,
            region,
        })
    }

    fn region(&self) -> SensorRegion {
        let RegionFields { x_offset, y_offset, width, height } = self.roi.unwrap_or_default();
        let (binning_x, binning_y) = (self.binning_x.unwrap_or(0), self.binning_y.unwrap_or(0));
        SensorRegion { x_offset, y_offset, width, height, binning_x, binning_y }
    }
}

impl Matrix {
    fn numbers(self, key: &'static str) -> Result<Vec<f64>, CalibrationError> {
        let missing = |part: &str| CalibrationError::Missing { key: format!("{key}: {part}") };
        let rows = self.rows.ok_or_else(|| missing("rows"))?;
        let cols = self.cols.ok_or_else(|| missing("cols"))?;
        let data = self.data.ok_or_else(|| missing("data"))?;
        if rows.checked_mul(cols) != Some(data.len()) {
            return Err(CalibrationError::Shape { key, rows, cols, got: data.len() });
        }
        Ok(data)
    }
}

fn present<T>(key: &str, value: Option<T>) -> Result<T, CalibrationError> {
    value.ok_or_else(|| CalibrationError::Missing { key: key.to_owned() })
}
