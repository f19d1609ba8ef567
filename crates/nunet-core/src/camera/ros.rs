//! Lens models by their ROS names.

use super::error::listed;
use super::lens_model::{LensEntry, RosModel};
use super::{CalibrationError, CameraError, Distortion};

/// What ROS's tools expect of a pinhole camera: five coefficients, all 0.
const PINHOLE: (&str, usize) = ("plumb_bob", 5);

/// A lens model and one of its names in ROS.
type Named = (&'static LensEntry, &'static RosModel);

/// All lens models by all their names in ROS.
fn ros_models() -> impl Iterator<Item = Named> {
    Distortion::entries().flat_map(|lens| lens.ros_models.iter().map(move |ros| (lens, ros)))
}

/// The lens model that ROS or a related tool calls `name`.
fn named(name: &str) -> Option<Named> {
    let is_name = |known: &str| known.eq_ignore_ascii_case(name);
    ros_models().find(|(_, ros)| is_name(ros.name) || ros.aliases.iter().any(|alias| is_name(alias)))
}

impl Distortion {
    /// The lens of a ROS `CameraInfo`: `distortion_model` and `d`.
    ///
    /// No coefficients mean no distortion, and so do zeros, except for `equidistant`, whose zeros are an
    /// ideal fisheye. Without a model's name, the count of coefficients decides ([`Distortion::model_of`]).
    ///
    /// Zeros after a model's last coefficient are ignored: the camera `RealSense` T265 writes `equidistant`
    /// with a fifth one.
    ///
    /// # Errors
    /// An unsupported model, a nonzero coefficient that the model does not have, another count of
    /// coefficients than the model has, a coefficient out of range.
    pub fn from_ros(model: &str, coefficients: &[f64]) -> Result<Self, CalibrationError> {
        if coefficients.is_empty() {
            return Ok(Self::None);
        }
        let name = if model.is_empty() { Self::model_of(coefficients).unwrap_or_default() } else { model };
        let found = named(name);
        let all_zero = coefficients.iter().all(|&coefficient| coefficient == 0.0);
        let is_known = found.is_some() || name.is_empty() || name.eq_ignore_ascii_case("none");
        if all_zero && is_known && !Self::zeros_distort(name) {
            return Ok(Self::None);
        }
        let (lens, ros) = found.ok_or_else(|| CalibrationError::UnknownModel { model: model.to_owned() })?;
        let coefficients = ros.without_trailing_zeros(coefficients, lens.coefficient_names)?;
        Ok((lens.new)(coefficients)?)
    }

    /// Whether coefficients that are all 0 are a lens, such as an ideal fisheye, not a pinhole. `model` is
    /// the lens model's name in ROS or a related tool. False for unknown models.
    #[must_use]
    pub fn zeros_distort(model: &str) -> bool {
        named(model).is_some_and(|(lens, _)| lens.zeros_distort)
    }

    /// The lens model that a ROS `CameraInfo` without a `distortion_model` means: by ROS's convention
    /// `plumb_bob` for 4 or 5 coefficients and `rational_polynomial` for 8, 12 or 14. `None` for other
    /// counts, and for zeros, which are no lens.
    #[must_use]
    pub fn model_of(coefficients: &[f64]) -> Option<&'static str> {
        if coefficients.iter().all(|&coefficient| coefficient == 0.0) {
            return None;
        }
        let count = coefficients.len();
        ros_models().find(|(_, ros)| ros.unnamed_counts.contains(&count)).map(|(_, ros)| ros.name)
    }

    /// The ROS name of the lens model, and the number of coefficients that ROS tools expect.
    #[must_use]
    pub fn to_ros(&self) -> (&'static str, Vec<f64>) {
        let all = self.coefficients();
        let used = all.iter().rposition(|&coefficient| coefficient != 0.0).map_or(0, |last| last + 1);
        let names = Self::entry(self.model()).into_iter().flat_map(|lens| lens.ros_models);
        let mut written =
            names.flat_map(|ros| ros.written_counts.iter().map(move |&count| (ros.name, count)));
        let (name, count) = written.find(|&(_, count)| used <= count).unwrap_or(PINHOLE);
        (name, all[..count].to_vec())
    }

    /// The ROS names of all lens models, as in "`a`, `b` and `c`".
    pub(super) fn ros_names() -> String {
        let names: Vec<String> = ros_models().map(|(_, ros)| format!("`{}`", ros.name)).collect();
        listed(&names, "and")
    }

    /// What Kalibr calls the lens models that it has, as in "`a` and `b`".
    pub(super) fn kalibr_names() -> String {
        let names = ros_models().filter_map(|(_, ros)| ros.kalibr);
        listed(&names.map(|name| format!("`{name}`")).collect::<Vec<_>>(), "and")
    }

    /// The ROS name of the lens model `name` with more coefficients, if there is one.
    pub(super) fn longer_ros_name(name: &str) -> Option<&'static str> {
        let (lens, short) = named(name)?;
        let longer = lens.ros_models.iter().find(|ros| ros.counts.last() > short.counts.last());
        longer.map(|ros| ros.name)
    }
}

impl RosModel {
    /// The coefficients, cut to an accepted count where the rest is zeros. The model's are called `names`.
    fn without_trailing_zeros<'a>(
        &self,
        coefficients: &'a [f64],
        names: &[&str],
    ) -> Result<&'a [f64], CameraError> {
        let got = coefficients.len();
        let needed =
            coefficients.iter().rposition(|&coefficient| coefficient != 0.0).map_or(0, |last| last + 1);
        let most = self.counts.last().copied().unwrap_or(0);
        if needed > most {
            let place = most + coefficients[most..].iter().position(|&value| value != 0.0).unwrap_or(0);
            return Err(CameraError::ExtraCoefficient {
                model: self.name,
                most,
                place: place + 1,
                name: names.get(place).map_or_else(|| format!("k{}", place + 1), |&name| name.to_owned()),
                value: coefficients[place],
            });
        }
        let accepted = self.counts.iter().rev().find(|&&count| needed <= count && count <= got);
        accepted.map(|&count| &coefficients[..count]).ok_or(CameraError::CoefficientCount {
            model: self.name,
            got,
            expected: self.counts,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{BrownConrady, KannalaBrandt};

    const FISHEYE: [f64; 4] = [0.0175, -0.0031, 0.0003, -0.0007];

    fn fisheye(coefficients: &[f64]) -> Distortion {
        Distortion::KannalaBrandt(KannalaBrandt::new(coefficients).unwrap())
    }

    fn brown(coefficients: &[f64]) -> Distortion {
        Distortion::BrownConrady(BrownConrady::new(coefficients).unwrap())
    }

    #[test]
    fn a_lens_goes_to_ros_and_back() {
        let long = [0.1, 0.2, 0.001, 0.002, 0.3, 0.4, 0.5, 0.6, 0.01, 0.02, 0.03, 0.04, 0.05, -0.05];
        for count in [5, 8, 12, 14] {
            let lens = brown(&long[..count]);
            let (model, coefficients) = lens.to_ros();
            assert_eq!(model, if count == 5 { "plumb_bob" } else { "rational_polynomial" });
            assert_eq!(coefficients, long[..count]);
            assert_eq!(Distortion::from_ros(model, &coefficients), Ok(lens));
        }
        let lens = fisheye(&[0.1, 0.0, 0.0, 0.0]);
        assert_eq!(lens.to_ros(), ("equidistant", vec![0.1, 0.0, 0.0, 0.0]));
        assert_eq!(Distortion::None.to_ros(), ("plumb_bob", vec![0.0; 5]));
        assert_eq!(Distortion::from_ros("plumb_bob", &[0.0; 5]), Ok(Distortion::None));
    }

    #[test]
    fn without_a_name_the_count_of_coefficients_decides() {
        let long = [0.1, 0.2, 0.001, 0.002, 0.3, 0.4, 0.5, 0.6];
        for (count, model) in [(4, "plumb_bob"), (5, "plumb_bob"), (8, "rational_polynomial")] {
            let named = Distortion::from_ros(model, &long[..count]);
            assert!(named.is_ok(), "{named:?}");
            assert_eq!(Distortion::from_ros("", &long[..count]), named, "{count}");
        }
        for none in [&[][..], &[0.0; 4], &[0.0; 5], &[0.0; 8]] {
            assert_eq!(Distortion::from_ros("", none), Ok(Distortion::None), "{none:?}");
        }
        for count in [1, 3, 6, 7] {
            let error = Distortion::from_ros("", &long[..count]).unwrap_err();
            assert!(matches!(error, CalibrationError::UnknownModel { .. }), "{count}: {error}");
        }
    }

    #[test]
    fn zeros_after_the_last_coefficient_of_a_model_are_ignored() {
        let [k1, k2, k3, k4] = FISHEYE;
        for count in 5..=14 {
            let mut coefficients = vec![0.0; count];
            coefficients[..4].copy_from_slice(&[k1, k2, k3, k4]);
            assert_eq!(Distortion::from_ros("equidistant", &coefficients), Ok(fisheye(&FISHEYE)), "{count}");
        }
        assert_eq!(Distortion::from_ros("equidistant", &[0.0; 5]), Ok(fisheye(&[0.0; 4])));
        let five = [-0.3, 0.1, 0.001, 0.0005, 0.02];
        for count in 6..=14 {
            let mut coefficients = vec![0.0; count];
            coefficients[..5].copy_from_slice(&five);
            assert_eq!(Distortion::from_ros("plumb_bob", &coefficients), Ok(brown(&five)), "{count}");
        }
        let nine = [0.5, -2.7, 0.001, 0.0005, 1.5, 0.4, -2.5, 1.4, 0.0];
        assert_eq!(Distortion::from_ros("rational_polynomial", &nine), Ok(brown(&nine[..8])));
    }

    #[test]
    fn a_nonzero_coefficient_that_the_model_does_not_have_is_named() {
        let [k1, k2, k3, k4] = FISHEYE;
        for (model, coefficients, expected) in [
            ("equidistant", vec![k1, k2, k3, k4, 0.25], ("k5", 5, 4)),
            ("equidistant", vec![k1, k2, k3, k4, 0.0, 0.25], ("k6", 6, 4)),
            ("plumb_bob", vec![-0.3, 0.1, 0.0, 0.0, 0.0, 0.25], ("k4", 6, 5)),
            ("plumb_bob", vec![-0.3, 0.1, 0.0, 0.0, 0.0, 0.0, 0.25, 0.0], ("k5", 7, 5)),
        ] {
            let error = Distortion::from_ros(model, &coefficients).unwrap_err();
            let (name, place, most) = expected;
            let expected =
                CameraError::ExtraCoefficient { model, most, place, name: name.to_owned(), value: 0.25 };
            assert_eq!(error, CalibrationError::Lens(expected), "{coefficients:?}");
        }
    }

    #[test]
    fn another_count_than_the_model_has_is_refused() {
        for (model, got, expected) in [
            ("equidistant", 3, &[4][..]),
            ("plumb_bob", 3, &[4, 5]),
            ("rational_polynomial", 10, &[4, 5, 8, 12, 14]),
        ] {
            let error = Distortion::from_ros(model, &vec![0.01; got]).unwrap_err();
            assert_eq!(error, CalibrationError::Lens(CameraError::CoefficientCount { model, got, expected }));
        }
    }

    #[test]
    fn other_tools_names_of_the_same_models_are_read() {
        for name in ["equidistant", "kannala_brandt", "fisheye", "EQUIDISTANT"] {
            assert_eq!(Distortion::from_ros(name, &FISHEYE), Ok(fisheye(&FISHEYE)), "{name}");
        }
        let four = [-0.31, 0.11, 0.0007, -0.0004];
        for name in ["plumb_bob", "radtan", "Brown_Conrady", "rational_polynomial"] {
            assert_eq!(Distortion::from_ros(name, &four), Ok(brown(&four)), "{name}");
        }
        assert_eq!(Distortion::from_ros("", &[]), Ok(Distortion::None));
        assert_eq!(Distortion::from_ros("none", &[0.0; 5]), Ok(Distortion::None));
        let error = Distortion::from_ros("omni", &four).unwrap_err();
        assert_eq!(error, CalibrationError::UnknownModel { model: "omni".to_owned() });
    }

    #[test]
    fn zeros_are_a_lens_only_for_a_fisheye() {
        for name in ["equidistant", "kannala_brandt", "fisheye"] {
            assert!(Distortion::zeros_distort(name), "{name}");
        }
        for name in ["plumb_bob", "rational_polynomial", "none", "", "omni"] {
            assert!(!Distortion::zeros_distort(name), "{name}");
        }
    }
}
