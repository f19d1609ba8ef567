//! Why a factor on which all observations agree may still be wrong.
//!
//! A wrong mount or unit changes all observations alike, so their spread does not show it.

use std::borrow::Cow;
use std::fmt;

use nunet_core::camera::Mount;
use nunet_core::obstacle::{FloorMismatch, FloorView};
use nunet_types::Hint;

use super::kind::ReferenceKind;
use super::{Agreement, Calibrator};

/// A factor is unusual outside of this range of multiples of the focal lengths' ratio.
const USUAL: std::ops::RangeInclusive<f64> = 0.4..=2.5;

/// Why a factor may be wrong.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum FactorDoubt {
    /// Some observations do not agree.
    Outliers {
        /// How many.
        outliers: usize,
        /// All of them.
        observations: usize,
    },
    /// Some frames, readings or images gave no observation.
    Unusable {
        /// How many.
        unusable: usize,
        /// The others.
        observations: usize,
        /// What the network's depth was compared with.
        reference: ReferenceKind,
    },
    /// The direction of the floor in the frames contradicts the mount. The heights mean nothing, because the
    /// scale is not known.
    Mount(FloorMismatch),
    /// The factor is far from the ratio of the focal lengths.
    Unusual {
        /// The factor.
        factor: f64,
        /// The ratio of the camera's focal length and that of the training camera.
        of_focal_length: f64,
    },
}

impl fmt::Display for FactorDoubt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Outliers { outliers, observations } => {
                write!(f, "{outliers} of {observations} observations are outliers")
            }
            Self::Unusable { unusable, observations, reference } => {
                write!(
                    f,
                    "{} without a factor: {unusable} of {}",
                    reference.observed(),
                    unusable + observations
                )
            }
            Self::Mount(FloorMismatch { seen, expected }) => write!(
                f,
                "the factor is probably wrong: the floor in the frames shows {}, but the mount has {}",
                seen.angles_text(),
                expected.angles_text()
            ),
            Self::Unusual { factor, of_focal_length } => write!(
                f,
                "the factor {factor:.4} is unusual: by the focal length alone it is {of_focal_length:.4}, expected \
                 {} to {} times that",
                USUAL.start(),
                USUAL.end()
            ),
        }
    }
}

impl Hint for FactorDoubt {
    fn hint(&self) -> Option<Cow<'static, str>> {
        match self {
            Self::Outliers { .. } => None,
            // As if there were none at all: what is true for most is probably wrong for all.
            Self::Unusable { unusable, observations, reference } if unusable > observations => {
                Some(reference.hint(0).into())
            }
            Self::Unusable { observations, reference, .. } => Some(reference.hint(*observations).into()),
            Self::Mount(mismatch) => mismatch.hint(),
            Self::Unusual { .. } => Some(
                "check the reference (distances and the mount's z are in meters) and the intrinsics".into(),
            ),
        }
    }
}

impl Calibrator {
    /// Why a factor may be wrong although the observations agree.
    #[must_use]
    pub fn doubts(&self, found: &Agreement) -> Vec<FactorDoubt> {
        let Agreement { factor, observations, agreeing, .. } = *found;
        let outliers = observations.saturating_sub(agreeing);
        let spread = (outliers > 0).then_some(FactorDoubt::Outliers { outliers, observations });
        let (unusable, reference) = (self.unusable, self.kind);
        // Readings have a warning with lines.
        let has_lost = unusable > 0 && reference != ReferenceKind::Readings;
        let lost = has_lost.then_some(FactorDoubt::Unusable { unusable, observations, reference });
        let mount = self.gauge.as_ref().and_then(|(_, mount, _)| doubt_of_mount(&self.floors, mount));
        let unusual = self.factor_of_focal_length().and_then(|ratio| unusual(factor, ratio));
        [spread, lost, mount, unusual].into_iter().flatten().collect()
    }

    /// The factor without a measurement; `None` if the camera or the training camera is unknown, or if the
    /// network corrects for the camera itself.
    fn factor_of_focal_length(&self) -> Option<f64> {
        let graph = self.pipeline.graph();
        let training_fx_px = graph.training_fx_px().filter(|_| !graph.needs_camera())?;
        let camera = self.pipeline.framing().camera_of_network(self.camera.as_ref()?).ok()?;
        Some(camera.intrinsics.fx_px / training_fx_px)
    }
}

/// The floors of a few frames differ too much from each other.
fn doubt_of_mount(floors: &[FloorView], mount: &Mount) -> Option<FactorDoubt> {
    let seen = FloorView::median(floors).filter(|_| floors.len() >= ReferenceKind::Floor.needed())?;
    let expected = FloorView::of_mount(mount);
    let mismatch = FloorMismatch { seen, expected };
    seen.points_elsewhere(&expected).then_some(FactorDoubt::Mount(mismatch))
}

fn unusual(factor: f64, of_focal_length: f64) -> Option<FactorDoubt> {
    let is_usual = USUAL.contains(&(factor / of_focal_length));
    (!is_usual).then_some(FactorDoubt::Unusual { factor, of_focal_length })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mount(height_m: f64, pitch: f64) -> Mount {
        Mount::new([0.0, 0.0, height_m], [0.0, pitch, 0.0]).unwrap()
    }

    #[test]
    fn a_pitch_with_the_wrong_sign_is_a_doubt_whatever_the_scale() {
        let floors =
            |height_m| [-0.09, -0.05, -0.08].map(|pitch| FloorView::of_mount(&mount(height_m, pitch)));
        for height_m in [0.05, 0.25, 2.0] {
            let doubt = doubt_of_mount(&floors(height_m), &mount(0.25, 0.07)).unwrap();
            assert_eq!(
                doubt.to_string(),
                "the factor is probably wrong: the floor in the frames shows a roll of 0.00 rad and a pitch of -0.08 rad, \
                 but the mount has a roll of 0.00 rad and a pitch of 0.07 rad"
            );
            assert!(doubt.hint().is_some_and(|hint| hint.contains("looks down")), "{doubt}");
            assert_eq!(doubt_of_mount(&floors(height_m), &mount(0.25, -0.07)), None);
        }
        assert_eq!(doubt_of_mount(&floors(0.25)[..2], &mount(0.25, 0.07)), None, "too few");
    }

    #[test]
    fn most_frames_without_a_factor_point_to_the_mount() {
        let doubt = |unusable, observations| FactorDoubt::Unusable {
            unusable,
            observations,
            reference: ReferenceKind::Floor,
        };
        assert_eq!(doubt(14, 6).to_string(), "frames without a factor: 14 of 20");
        assert!(doubt(14, 6).hint().is_some_and(|hint| hint.contains("pitch")));
        assert!(doubt(2, 18).hint().is_some_and(|hint| hint.contains("level floor")));
    }

    #[test]
    fn a_factor_far_from_that_of_the_focal_length_is_unusual() {
        for usual in [1.0126, 0.6424, 0.41, 2.5] {
            assert_eq!(unusual(usual, 1.01), None, "{usual}");
        }
        let doubt = unusual(5.0657, 1.01).unwrap();
        assert_eq!(
            doubt.to_string(),
            "the factor 5.0657 is unusual: by the focal length alone it is 1.0100, expected 0.4 to 2.5 times that"
        );
        assert!(doubt.hint().is_some_and(|hint| hint.contains("meters")), "{doubt}");
        assert!(unusual(0.1, 1.01).is_some());
    }
}
