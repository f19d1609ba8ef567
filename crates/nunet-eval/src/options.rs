//! What is measured, and how.

use std::path::PathBuf;
use std::str::FromStr;

use nunet_source::CameraGeometry;

use crate::obstacles::ObstacleEval;

/// The least and the most meters: beyond them, the single-precision depth is 0 or infinite.
const METERS: [f64; 2] = [1e-9, 1e9];
/// The most units, of either sign.
const MAX_UNITS: f64 = 1e6;

/// What is measured, and how.
#[derive(Debug, Clone)]
pub struct EvalOptions {
    /// A recording (a file or the folder of a bag) with images and depth, or a folder with `rgb/ID.jpg` or
    /// `.png`, `depth/ID.png` (integers) or `.npy` (float32, meters) and, for labels, `labels/ID.png` or
    /// `label40/ID.png`.
    pub dataset: PathBuf,
    /// The topic with images, if a recording has several.
    pub topic: Option<String>,
    /// The topic with true depth, if a recording has several. Also allows the depth that nunetd has recorded.
    pub depth_topic: Option<String>,
    /// A file with the ids of the images to measure, one per line; `None` for all.
    pub ids: Option<PathBuf>,
    /// Where the mean image comes from.
    pub baseline: BaselineChoice,
    /// What is compared.
    pub protocol: Protocol,
    /// True depth from here on is not compared, and predictions end here, in meters.
    pub depth_cap_m: f32,
    /// What the numbers of a depth image mean.
    pub units: DepthUnits,
    /// Pixels outside of it have no truth.
    pub window: Option<Window>,
    /// Whether the images are consecutive frames of one video; those of a recording always are.
    pub clip: bool,
    /// Whether obstacles are compared too, and how they are found.
    pub obstacles: Option<ObstacleEval>,
    /// The camera, if the dataset does not state it.
    pub camera: CameraGeometry,
}

impl EvalOptions {
    /// All images of `dataset`, whole, up to 10 m, in millimeters.
    pub fn new(dataset: impl Into<PathBuf>) -> Self {
        Self {
            dataset: dataset.into(),
            topic: None,
            depth_topic: None,
            ids: None,
            baseline: BaselineChoice::default(),
            protocol: Protocol::default(),
            depth_cap_m: 10.0,
            units: DepthUnits::default(),
            window: None,
            clip: false,
            obstacles: None,
            camera: CameraGeometry::default(),
        }
    }

    /// The files and folders that are read.
    #[must_use]
    pub fn files(&self) -> Vec<PathBuf> {
        let images = ["rgb", "depth", "labels", "label40"].map(|folder| self.dataset.join(folder));
        let baseline = match &self.baseline {
            BaselineChoice::Automatic => None,
            BaselineChoice::Ids(file) | BaselineChoice::File(file) => Some(file.clone()),
        };
        let others = [self.ids.clone(), baseline, self.camera.calibration.clone()].into_iter().flatten();
        nunet_mcap::files(&self.dataset).into_iter().chain(images).chain(others).collect()
    }
}

/// Where the mean image comes from.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub enum BaselineChoice {
    /// For each image the mean of the other scenes, if ids name scenes; otherwise the mean of the measured
    /// images.
    #[default]
    Automatic,
    /// The mean of the images whose ids are in this file.
    Ids(PathBuf),
    /// A mean image that an earlier evaluation has written.
    File(PathBuf),
}

/// What the integers of a depth image mean: meters = (value + offset) * scale. 65535 is no measurement, and
/// neither is 0 without an offset. Depth in floating point is in meters, so that a unit for it is an error.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct DepthUnits {
    /// Meters per unit; `None` for millimeters in 16-bit images.
    pub scale: Option<f64>,
    /// Added to each value before scaling.
    pub offset: f64,
}

impl DepthUnits {
    /// Whether any unit is stated.
    pub(crate) fn are_stated(self) -> bool {
        self != Self::default()
    }
}

/// The meters of a unit or of a limit of depth. The error names `example`.
///
/// # Errors
/// What is expected instead.
pub fn parse_meters(text: &str, example: f64) -> Result<f64, String> {
    let [least, most] = METERS;
    let meters = text.parse().ok().filter(|meters: &f64| (least..=most).contains(meters));
    meters
        .ok_or_else(|| format!("expected meters from {least:e} to {most:e}, such as {example}, got `{text}`"))
}

/// The offset of units.
///
/// # Errors
/// What is expected instead.
pub fn parse_units(text: &str) -> Result<f64, String> {
    let units = text.parse().ok().filter(|units: &f64| units.abs() <= MAX_UNITS);
    units.ok_or_else(|| format!("expected at most {MAX_UNITS:e} units, such as 1, got `{text}`"))
}

/// Which pixels are compared.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Protocol {
    /// Every pixel that has truth.
    #[default]
    Full,
    /// Rows 45 to 471 and columns 41 to 601 of 640x480 images: the crop of Eigen et al. for NYU Depth V2.
    Eigen,
}

impl Protocol {
    /// As the user writes it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Full => "full",
            Self::Eigen => "eigen",
        }
    }
}

/// A part of an image, in pixels; `bottom` and `right` are the first ones outside.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// The first row.
    pub top: u32,
    /// The first column.
    pub left: u32,
    /// The row after the last one.
    pub bottom: u32,
    /// The column after the last one.
    pub right: u32,
}

impl Window {
    /// Whether a pixel lies inside.
    #[must_use]
    pub fn contains(&self, column: u32, row: u32) -> bool {
        (self.top..self.bottom).contains(&row) && (self.left..self.right).contains(&column)
    }
}

impl FromStr for Window {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts: Result<Vec<u32>, _> = text.split(',').map(|part| part.trim().parse()).collect();
        match parts.as_deref() {
            Ok(&[top, left, bottom, right]) if top < bottom && left < right => {
                Ok(Self { top, left, bottom, right })
            }
            _ => {
                Err("expected four whole numbers `top,left,bottom,right`, the first two the smaller"
                    .to_owned())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn meters_and_units_have_limits_and_the_error_has_a_fitting_example() {
        assert_eq!((parse_meters("0.001", 10.0), parse_units("-5")), (Ok(0.001), Ok(-5.0)));
        for wrong in ["0", "-1", "nan", "inf", "1e300", "far"] {
            let error = parse_meters(wrong, 10.0).unwrap_err();
            assert!(error.contains("such as 10,") && error.ends_with(&format!("got `{wrong}`")), "{error}");
        }
        assert!(parse_meters("0", 0.001).unwrap_err().contains("such as 0.001,"));
        for wrong in ["nan", "inf", "-1e300", ""] {
            assert!(parse_units(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_window_is_four_numbers_in_order() {
        let window: Window = "1, 2,3,4".parse().unwrap();
        assert_eq!(window, Window { top: 1, left: 2, bottom: 3, right: 4 });
        assert!(window.contains(2, 1) && !window.contains(4, 1) && !window.contains(2, 3));
        for wrong in ["", "1,2,3", "3,2,1,4", "1,4,3,2", "1,2,3,4,5", "1,2,3,-4"] {
            assert!(wrong.parse::<Window>().is_err(), "{wrong}");
        }
    }
}
