//! A mount that the floor contradicts: what is seen, what was expected, and the likely mistake.

use std::borrow::Cow;
use std::f32::consts::{FRAC_PI_2, PI};
use std::fmt;

use nunet_types::Hint;

use super::FloorView;
use crate::camera::Mount;

/// A roll this near to half or a quarter turn is the mistake itself, radians.
const ROLL_REACH_RAD: f32 = 0.5;

/// The floor that images show, and the one that the mount promises.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FloorMismatch {
    /// What is seen.
    pub seen: FloorView,
    /// What the mount says.
    pub expected: FloorView,
}

impl FloorMismatch {
    /// The mismatch of one image; `None` if the errors of depth can explain the difference.
    #[must_use]
    pub fn of_image(seen: FloorView, mount: &Mount) -> Option<Self> {
        let expected = FloorView::of_mount(mount);
        seen.contradicts(&expected).then_some(Self { seen, expected })
    }

    /// The mismatch of one of many frames in which the floor was not where the mount expects it. A smaller
    /// difference counts.
    #[must_use]
    pub fn of_frames(seen: FloorView, mount: &Mount) -> Option<Self> {
        let expected = FloorView::of_mount(mount);
        seen.contradicts_steadily(&expected).then_some(Self { seen, expected })
    }
}

impl fmt::Display for FloorMismatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { seen, expected } = self;
        write!(f, "the floor in the images is {seen}, but with the mount it is {expected}")
    }
}

impl Hint for FloorMismatch {
    fn hint(&self) -> Option<Cow<'static, str>> {
        let roll = self.expected.roll_rad();
        let is_near = |angle: f32| (roll - angle).abs() < ROLL_REACH_RAD;
        let is_upright = self.seen.roll_rad().abs() < ROLL_REACH_RAD;
        Some(if is_upright && (is_near(PI) || is_near(-PI)) {
            "for a camera that is upside down, rotate the images by 180 degrees and give a roll of 0".into()
        } else if is_upright && is_near(-FRAC_PI_2) {
            "give the pose of the camera's body frame (x forward, such as `camera_link` in tf2), not of its \
             optical frame"
                .into()
        } else if !self.seen.points_elsewhere(&self.expected) {
            "check the height z of the mount, in meters; if it is right, measure the scale of the depth"
                .into()
        } else {
            "check the mount: z is in meters, pitch in radians, and a positive pitch looks down".into()
        })
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, PI};

    use super::*;

    /// The mismatch of what a camera with the first mount sees, for one that is given as the second.
    fn mismatch(real: [f64; 3], given: [f64; 3]) -> FloorMismatch {
        let [seen, given] = [real, given].map(|angles| Mount::new([0.0, 0.0, 0.25], angles).unwrap());
        FloorMismatch::of_image(FloorView::of_mount(&seen), &given).unwrap()
    }

    #[test]
    fn the_text_names_what_is_seen_and_what_was_given_also_their_roll() {
        assert_eq!(
            mismatch([0.0, -0.1, 0.0], [PI, -0.07, 0.0]).to_string(),
            "the floor in the images is 0.25 m below the camera with a roll of 0.00 rad and a pitch of -0.10 rad, but \
             with the mount it is 0.25 m below the camera with a roll of 3.14 rad and a pitch of -0.07 rad"
        );
    }

    #[test]
    fn the_hint_names_the_likely_mistake() {
        for (given, part) in [
            ([PI, -0.07, 0.0], "180 degrees"),
            ([-3.1, -0.07, 0.0], "180 degrees"),
            ([-FRAC_PI_2, 0.0, -FRAC_PI_2], "optical frame"),
            ([0.0, 0.3, 0.0], "positive pitch looks down"),
            ([FRAC_PI_2, 0.0, 0.0], "positive pitch looks down"),
        ] {
            let hint = mismatch([0.0, -0.1, 0.0], given).hint().unwrap();
            assert!(hint.contains(part), "{given:?}: {hint}");
        }
    }

    #[test]
    fn a_wrong_height_may_also_be_a_wrong_scale() {
        let [seen, given] = [0.25, 0.1].map(|z| Mount::new([0.0, 0.0, z], [0.0, -0.07, 0.0]).unwrap());
        let seen = FloorView::of_mount(&seen);
        assert_eq!(FloorMismatch::of_image(seen, &given), None, "too little for one image");
        let hint = FloorMismatch::of_frames(seen, &given).unwrap().hint().unwrap();
        assert!(hint.contains("height z") && hint.contains("scale"), "{hint}");
    }

    #[test]
    fn a_small_difference_is_no_mismatch() {
        let [seen, given] =
            [-0.07, -0.1].map(|pitch| Mount::new([0.0, 0.0, 0.25], [0.0, pitch, 0.0]).unwrap());
        assert_eq!(FloorMismatch::of_image(FloorView::of_mount(&seen), &given), None);
    }
}
