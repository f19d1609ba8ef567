//! The description of a camera in a recording.

use nunet_types::ImageSize;

use crate::messages::{Header, RegionOfInterest, RosCameraInfo};

/// The description of a camera in a recording.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CameraDescription {
    /// Pixels of the images that it describes.
    pub width: u32,
    /// Pixels of the images that it describes.
    pub height: u32,
    /// fx, fy, cx, cy in pixels.
    pub intrinsics: [f64; 4],
    /// The skew `K[0][1]`, pixels; 0 for almost every camera.
    pub skew: f64,
    /// The lens model as the recording names it, such as `plumb_bob`; Foxglove and some drivers use other
    /// names than ROS. Empty for none.
    pub distortion_model: String,
    /// Its coefficients, in the model's order.
    pub coefficients: Vec<f64>,
    /// Why the values above must not be used: the message is inconsistent or cannot be read.
    pub fault: Option<String>,
}

/// The matrices of a camera's message, row by row.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CameraMatrices<'a> {
    /// 3 x 3.
    pub(crate) k: &'a [f64],
    /// 3 x 4.
    pub(crate) p: &'a [f64],
}

impl CameraDescription {
    /// A camera whose message cannot be read.
    pub(crate) fn unreadable(reason: &str) -> Self {
        Self::unusable(format!("its message cannot be read: {reason}"))
    }

    /// A camera that must not be used.
    pub(crate) fn unusable(reason: String) -> Self {
        Self { fault: Some(reason), ..Self::default() }
    }

    /// From ROS 2's message.
    pub(crate) fn of_ros(info: &RosCameraInfo<'_>, rectified: bool) -> Self {
        let matrices = CameraMatrices { k: &info.k, p: &info.p };
        let size = ImageSize::new(info.width, info.height);
        Self::of_matrices(size, matrices, &info.distortion_model, info.d.clone(), rectified).captured(info)
    }

    /// Rectified images have the camera of the projection P, without distortion; K and D describe the
    /// unrectified image. The lengths of the matrices were checked; protobuf omits an unknown one. A matrix
    /// of zeros is unknown too: ROS writes it for a camera that is not calibrated.
    pub(crate) fn of_matrices(
        size: ImageSize,
        CameraMatrices { k, p }: CameraMatrices<'_>,
        model: &str,
        coefficients: Vec<f64>,
        rectified: bool,
    ) -> Self {
        let is_unknown = |matrix: &[f64]| matrix.iter().all(|&number| number == 0.0);
        let state = |matrix: &[f64]| if matrix.is_empty() { "has no values" } else { "is all zeros" };
        let fault = match (rectified, is_unknown(k), is_unknown(p)) {
            (_, true, true) => format!("it is not calibrated: K {}", state(k)),
            (true, _, true) => format!("P {}, but the images are rectified", state(p)),
            (false, true, _) => format!("K {}, but the images are not rectified", state(k)),
            (true, _, false) => return Self::of_projection(size, p),
            (false, false, _) => return Self::of_camera_matrix(size, k, model, coefficients),
        };
        Self::unusable(fault)
    }

    /// Converts the camera of the full sensor, which K, P, width and height of the ROS 2 message
    /// describe, to the camera of the images (region of interest and binning).
    fn captured(mut self, info: &RosCameraInfo<'_>) -> Self {
        if self.fault.is_some() {
            return self;
        }
        let [fx, fy, cx, cy] = self.intrinsics;
        match info.region().captured(ImageSize::new(self.width, self.height), [fx, self.skew, cx, fy, cy]) {
            Ok((ImageSize { width, height }, [fx, skew, cx, fy, cy])) => {
                Self { width, height, intrinsics: [fx, fy, cx, cy], skew, ..self }
            }
            Err(error) => {
                self.fault = Some(error.to_string());
                self
            }
        }
    }

    /// From the matrix P of rectified images, row by row.
    fn of_projection(size: ImageSize, p: &[f64]) -> Self {
        let &[fx, _, cx, _, _, fy, cy, ..] = p else { return Self::unusable("P is too short".to_owned()) };
        Self::of_camera_matrix(size, &[fx, 0.0, cx, 0.0, fy, cy], "", Vec::new())
    }

    /// From the matrix K, row by row.
    fn of_camera_matrix(size: ImageSize, k: &[f64], model: &str, coefficients: Vec<f64>) -> Self {
        let &[fx, skew, cx, _, fy, cy, ..] = k else { return Self::unusable("K is too short".to_owned()) };
        Self {
            width: size.width,
            height: size.height,
            intrinsics: [fx, fy, cx, cy],
            skew,
            distortion_model: model.to_owned(),
            coefficients,
            fault: None,
        }
    }

    pub(crate) fn ros_message<'a>(&'a self, header: Header<'a>) -> RosCameraInfo<'a> {
        let [fx, fy, cx, cy] = self.intrinsics;
        RosCameraInfo {
            header,
            height: self.height,
            width: self.width,
            distortion_model: (if self.distortion_model.is_empty() {
                "plumb_bob"
            } else {
                &self.distortion_model
            })
            .into(),
            // ROS' tools expect five coefficients of `plumb_bob`, even if all are 0.
            d: if self.coefficients.is_empty() { vec![0.0; 5] } else { self.coefficients.clone() },
            k: [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
            r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            p: [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
            binning_x: 0,
            binning_y: 0,
            roi: RegionOfInterest::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: ImageSize = ImageSize { width: 640, height: 480 };
    const K: [f64; 9] = [500.0, 0.0, 320.0, 0.0, 500.0, 240.0, 0.0, 0.0, 1.0];
    const P: [f64; 12] = [400.0, 0.0, 310.0, 0.0, 0.0, 401.0, 230.0, 0.0, 0.0, 0.0, 1.0, 0.0];

    fn of(k: &[f64], p: &[f64], model: &str, rectified: bool) -> CameraDescription {
        CameraDescription::of_matrices(SIZE, CameraMatrices { k, p }, model, vec![0.1; 4], rectified)
    }

    #[test]
    fn rectified_images_have_the_projections_camera_and_no_lens() {
        let camera = of(&K, &P, "plumb_bob", true);
        assert_eq!((camera.intrinsics, camera.coefficients.len()), ([400.0, 401.0, 310.0, 230.0], 0));
    }

    /// A sensor of 640x480 pixels of which the region of interest is 320x240 in the middle, and the camera of
    /// its images.
    fn cropped(change: impl Fn(&mut RosCameraInfo<'_>), rectified: bool) -> CameraDescription {
        let whole = CameraDescription {
            width: 640,
            height: 480,
            intrinsics: [500.0, 510.0, 320.0, 240.0],
            ..CameraDescription::default()
        };
        let header = Header { stamp: crate::messages::Time::default(), frame_id: "eye".into() };
        let mut info = whole.ros_message(header);
        info.p[0] = 400.0;
        info.roi =
            RegionOfInterest { x_offset: 200, y_offset: 100, width: 320, height: 240, do_rectify: true };
        change(&mut info);
        CameraDescription::of_ros(&info, rectified)
    }

    #[test]
    fn a_region_of_interest_moves_the_principal_point() {
        let camera = cropped(|_| {}, false);
        assert_eq!((camera.width, camera.height, camera.fault.as_deref()), (320, 240, None));
        assert_eq!(camera.intrinsics, [500.0, 510.0, 120.0, 140.0]);
        assert_eq!(cropped(|_| {}, true).intrinsics, [400.0, 510.0, 120.0, 140.0], "of the projection too");
    }

    #[test]
    fn binning_and_skew_are_those_of_the_images() {
        let camera = cropped(|info| (info.binning_x, info.binning_y, info.k[1]) = (2, 4, 3.0), false);
        assert_eq!((camera.width, camera.height, camera.skew), (160, 60, 1.5));
        assert_eq!(camera.intrinsics, [250.0, 127.5, 120.5 / 2.0 - 0.5, 140.5 / 4.0 - 0.5]);
    }

    #[test]
    fn a_region_beyond_the_sensor_makes_the_camera_useless() {
        let camera = cropped(|info| info.roi.x_offset = 321, false);
        assert_eq!(
            camera.fault.as_deref(),
            Some(
                "its region of interest of 320x240 pixels from column 321 and row 100 on is not within the sensor's \
                 640x480"
            )
        );
    }

    #[test]
    fn a_matrix_that_is_unknown_is_a_fault_and_the_other_one_does_not_replace_it() {
        let (no_k, no_p) = ([0.0; 9], [0.0; 12]);
        for (k, p, rectified, expected) in [
            (&no_k[..], &no_p[..], false, "it is not calibrated: K is all zeros"),
            (&no_k, &no_p, true, "it is not calibrated: K is all zeros"),
            (&[], &[], false, "it is not calibrated: K has no values"),
            (&no_k, &P, false, "K is all zeros, but the images are not rectified"),
            (&[], &P, false, "K has no values, but the images are not rectified"),
            (&K, &no_p, true, "P is all zeros, but the images are rectified"),
            (&K, &[], true, "P has no values, but the images are rectified"),
        ] {
            assert_eq!(of(k, p, "plumb_bob", rectified).fault.as_deref(), Some(expected));
        }
        assert_eq!(of(&K, &no_p, "plumb_bob", false).fault, None);
        assert_eq!(of(&no_k, &P, "plumb_bob", true).intrinsics, [400.0, 401.0, 310.0, 230.0]);
    }

    #[test]
    fn a_region_of_interest_of_an_uncalibrated_camera_is_not_its_fault() {
        let camera = cropped(|info| (info.k, info.p, info.roi.x_offset) = ([0.0; 9], [0.0; 12], 900), false);
        assert_eq!(camera.fault.as_deref(), Some("it is not calibrated: K is all zeros"));
    }
}
