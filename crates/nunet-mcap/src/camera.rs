//! The description of a camera in a recording.

use nunet_types::ImageSize;

use crate::messages::{CameraInfo, Header, RegionOfInterest};

/// ROS' name for the fisheye model.
const FISHEYE: &str = "equidistant";

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
    /// `plumb_bob`, `rational_polynomial`, `equidistant` ...; empty for none.
    pub distortion_model: String,
    /// Its coefficients, in the model's order.
    pub coefficients: Vec<f64>,
    /// Why the values above must not be used: the message is inconsistent or cannot be read.
    pub fault: Option<String>,
}

impl CameraDescription {
    /// A camera whose message cannot be read.
    pub(crate) fn unreadable(reason: &str) -> Self {
        Self { fault: Some(format!("its message cannot be read: {reason}")), ..Self::default() }
    }

    /// From ROS 2's message; `None` for an uncalibrated camera, which has zeros. Rectified images have the
    /// camera of the projection P, without distortion; K and D describe the unrectified image.
    pub(crate) fn of_ros(info: &CameraInfo<'_>, rectified: bool) -> Option<Self> {
        let size = ImageSize::new(info.width, info.height);
        let whole = if rectified {
            Self::of_projection(size, &info.p)
        } else {
            Self::new(size, &info.k, &info.distortion_model, info.d.clone())
        };
        whole.map(|camera| camera.captured(info))
    }

    /// Converts the camera of the full sensor, which K, P, width and height of the ROS 2 message
    /// describe, to the camera of the images (region of interest and binning).
    fn captured(mut self, info: &CameraInfo<'_>) -> Self {
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
    pub(crate) fn of_projection(size: ImageSize, p: &[f64]) -> Option<Self> {
        let &[fx, _, cx, _, _, fy, cy, ..] = p else { return None };
        Self::new(size, &[fx, 0.0, cx, 0.0, fy, cy], "", Vec::new())
    }

    /// Whether the lens is a fisheye (the model of Kannala and Brandt).
    #[must_use]
    pub fn is_fisheye(&self) -> bool {
        self.distortion_model == FISHEYE
    }

    /// From the matrix K, row by row.
    pub(crate) fn new(size: ImageSize, k: &[f64], model: &str, coefficients: Vec<f64>) -> Option<Self> {
        let &[fx, skew, cx, _, fy, cy, ..] = k else { return None };
        // Foxglove and some drivers use another name for the model.
        let model = if matches!(model, "kannala_brandt" | "fisheye") { FISHEYE } else { model };
        (fx != 0.0).then(|| Self {
            width: size.width,
            height: size.height,
            intrinsics: [fx, fy, cx, cy],
            skew,
            distortion_model: model.to_owned(),
            coefficients,
            fault: None,
        })
    }

    pub(crate) fn ros_message<'a>(&'a self, header: Header<'a>) -> CameraInfo<'a> {
        let [fx, fy, cx, cy] = self.intrinsics;
        CameraInfo {
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

    #[test]
    fn foxgloves_fisheye_is_ros() {
        let k = [500.0, 0.0, 320.0, 0.0, 500.0, 240.0, 0.0, 0.0, 1.0];
        let camera =
            CameraDescription::new(ImageSize::new(640, 480), &k, "kannala_brandt", vec![0.0; 4]).unwrap();
        assert!(camera.is_fisheye());
        assert!(
            !CameraDescription::new(ImageSize::new(640, 480), &k, "plumb_bob", vec![0.0; 5])
                .unwrap()
                .is_fisheye()
        );
    }

    #[test]
    fn rectified_images_have_the_projections_camera_and_no_lens() {
        let p = [400.0, 0.0, 310.0, 0.0, 0.0, 401.0, 230.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        let camera = CameraDescription::of_projection(ImageSize::new(640, 480), &p).unwrap();
        assert_eq!((camera.intrinsics, camera.coefficients.len()), ([400.0, 401.0, 310.0, 230.0], 0));
    }

    /// A sensor of 640x480 pixels of which the region of interest is 320x240 in the middle, and the camera of its images.
    fn cropped(change: impl Fn(&mut CameraInfo<'_>), rectified: bool) -> CameraDescription {
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
        CameraDescription::of_ros(&info, rectified).unwrap()
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
    fn an_uncalibrated_camera_is_none() {
        assert_eq!(CameraDescription::new(ImageSize::new(640, 480), &[0.0; 9], "", Vec::new()), None);
    }
}
