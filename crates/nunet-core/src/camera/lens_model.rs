//! What a lens model states about itself, and the macro that makes [`Distortion`] of all models.

use nalgebra::Point2;
use nunet_types::DistortionModel;

use super::coefficients::MAX_COEFFICIENTS;
use super::{CameraError, Distortion};

/// A lens model: its names, its coefficients and its formula.
pub(super) trait LensModel: Copy + Into<Distortion> {
    /// The names of its coefficients, in order.
    const COEFFICIENT_NAMES: &'static [&'static str];
    /// Accepted counts of coefficients, rising.
    const COUNTS: &'static [usize];
    /// Whether coefficients that are all 0 distort, as those of an ideal fisheye do.
    const ZEROS_DISTORT: bool;
    /// Its names in ROS, the one with the fewest coefficients first.
    const ROS_MODELS: &'static [RosModel];

    /// The lens with these coefficients.
    ///
    /// # Errors
    /// A count that the model does not have, a coefficient that is not finite or out of range.
    fn from_coefficients(coefficients: &[f64]) -> Result<Self, CameraError>;

    /// The coefficients in the model's order, followed by zeros.
    fn all_coefficients(&self) -> [f64; MAX_COEFFICIENTS];

    /// Where a point at depth 1 appears; `None` where the model folds back.
    fn distort(&self, point: Point2<f64>) -> Option<Point2<f64>>;

    /// The inverse of [`Self::distort`]; `None` where no point in front of the camera appears at `distorted`.
    fn undistort(&self, distorted: Point2<f64>) -> Option<Point2<f64>>;

    /// The lens after its image was rotated by quarter turns or mirrored, as `vector` does with vectors of
    /// the image plane.
    ///
    /// # Errors
    /// The model cannot describe the rotated lens.
    fn transformed(&self, vector: &dyn Fn([f64; 2]) -> [f64; 2]) -> Result<Self, CameraError>;
}

/// A lens model as ROS and related tools name it.
pub(super) struct RosModel {
    /// ROS's name (`sensor_msgs/distortion_models.hpp`).
    pub(super) name: &'static str,
    /// The names of the same model in Kalibr, Foxglove, OpenCV and depthai, lower case.
    pub(super) aliases: &'static [&'static str],
    /// Camera and lens on Kalibr's command line.
    pub(super) kalibr: Option<&'static str>,
    /// Accepted counts of coefficients, rising.
    pub(super) counts: &'static [usize],
    /// The counts that mean this model if a message names none.
    pub(super) unnamed_counts: &'static [usize],
    /// The counts that ROS tools expect, rising.
    pub(super) written_counts: &'static [usize],
}

/// The constants of a [`LensModel`], found by its number or name.
pub(super) struct LensEntry {
    pub(super) coefficient_names: &'static [&'static str],
    pub(super) counts: &'static [usize],
    pub(super) zeros_distort: bool,
    pub(super) ros_models: &'static [RosModel],
    /// [`LensModel::from_coefficients`].
    pub(super) new: fn(&[f64]) -> Result<Distortion, CameraError>,
}

impl LensEntry {
    pub(super) const fn of<L: LensModel>() -> Self {
        Self {
            coefficient_names: L::COEFFICIENT_NAMES,
            counts: L::COUNTS,
            zeros_distort: L::ZEROS_DISTORT,
            ros_models: L::ROS_MODELS,
            new: distortion::<L>,
        }
    }

    /// How many coefficients the model has at most.
    pub(super) fn max_count(&self) -> usize {
        self.counts.last().copied().unwrap_or(0)
    }
}

fn distortion<L: LensModel>(coefficients: &[f64]) -> Result<Distortion, CameraError> {
    L::from_coefficients(coefficients).map(Into::into)
}

impl Distortion {
    /// All lens models, in the order of their numbers.
    pub(super) fn entries() -> impl Iterator<Item = &'static LensEntry> {
        DistortionModel::ALL.iter().filter_map(|&model| Self::entry(model))
    }
}

// One macro, so that no lens model is missing in one of the places. It is called in `mod.rs` and takes the
// names from there.
macro_rules! lens_models {
    ($($(#[$doc:meta])* $model:ident,)+) => {
        /// Lens distortion: where a point appears, compared with a pinhole camera.
        ///
        /// Not `non_exhaustive`: code that converts lenses must not compile until it handles a new model.
        #[derive(Debug, Clone, Copy, PartialEq, Default)]
        pub enum Distortion {
            /// A pinhole camera: straight lines stay straight.
            #[default]
            None,
            $($(#[$doc])* $model($model),)+
        }

        $(
            impl From<$model> for Distortion {
                fn from(lens: $model) -> Self {
                    Self::$model(lens)
                }
            }
        )+

        impl Distortion {
            /// The lens model that messages state.
            #[must_use]
            pub fn model(&self) -> DistortionModel {
                match self {
                    Self::None => DistortionModel::None,
                    $(Self::$model(_) => DistortionModel::$model,)+
                }
            }

            /// The lens model with this number in messages; `None` for a pinhole.
            fn entry(model: DistortionModel) -> Option<&'static LensEntry> {
                match model {
                    DistortionModel::None => None,
                    $(DistortionModel::$model => Some(const { &LensEntry::of::<$model>() }),)+
                }
            }

            /// The coefficients in the model's order, followed by zeros.
            #[must_use]
            pub fn coefficients(&self) -> [f64; MAX_COEFFICIENTS] {
                match self {
                    Self::None => [0.0; MAX_COEFFICIENTS],
                    $(Self::$model(lens) => LensModel::all_coefficients(lens),)+
                }
            }

            /// Where a `point` on the plane at depth 1 appears on that plane through the lens; `None` where
            /// the model folds back.
            fn distort(&self, point: Point2<f64>) -> Option<Point2<f64>> {
                match self {
                    Self::None => Some(point),
                    $(Self::$model(lens) => LensModel::distort(lens, point),)+
                }
            }

            /// The inverse of [`Self::distort`]; `None` where no point in front of the camera appears at
            /// `distorted`.
            fn undistort(&self, distorted: Point2<f64>) -> Option<Point2<f64>> {
                match self {
                    Self::None => Some(distorted),
                    $(Self::$model(lens) => LensModel::undistort(lens, distorted),)+
                }
            }

            /// The lens after its image was rotated by quarter turns or mirrored, as `vector` does with
            /// vectors of the image plane.
            ///
            /// # Errors
            /// [`CameraError::TiltedSensor`].
            pub fn transformed(&self, vector: impl Fn([f64; 2]) -> [f64; 2]) -> Result<Self, CameraError> {
                match self {
                    Self::None => Ok(Self::None),
                    $(Self::$model(lens) => LensModel::transformed(lens, &vector).map(Self::$model),)+
                }
            }
        }
    };
}
pub(super) use lens_models;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_lens_model_has_the_coefficients_that_the_contract_states() {
        for &model in DistortionModel::ALL {
            let Some(lens) = Distortion::entry(model) else {
                assert_eq!((model, model.max_coefficients()), (DistortionModel::None, 0));
                continue;
            };
            assert_eq!(lens.max_count(), model.max_coefficients(), "{model}");
            assert_eq!(lens.coefficient_names.len(), model.max_coefficients(), "{model}");
            assert!(lens.counts.is_sorted() && lens.max_count() <= MAX_COEFFICIENTS, "{model}");
            let zeros = [0.0; MAX_COEFFICIENTS];
            for &count in lens.counts {
                assert_eq!((lens.new)(&zeros[..count]).unwrap().model(), model, "{count}");
            }
        }
    }

    #[test]
    fn each_lens_model_has_ros_names_for_all_its_coefficients() {
        let mut names: Vec<&str> = Vec::new();
        for lens in Distortion::entries() {
            let written: Vec<usize> =
                lens.ros_models.iter().flat_map(|ros| ros.written_counts.iter().copied()).collect();
            assert!(written.is_sorted() && written.last() == lens.counts.last(), "{written:?}");
            for ros in lens.ros_models {
                for count in ros.unnamed_counts.iter().chain(ros.written_counts) {
                    assert!(ros.counts.contains(count), "{}: {count}", ros.name);
                }
                assert!(ros.counts.iter().all(|count| lens.counts.contains(count)), "{}", ros.name);
                names.push(ros.name);
                names.extend(ros.aliases);
            }
        }
        let count = names.len();
        names.sort_unstable();
        names.dedup();
        assert!(names.len() == count && count > 0, "a name of two models: {names:?}");
        assert!(names.iter().all(|name| *name == name.to_ascii_lowercase()), "{names:?}");
    }
}
