//! A recorded picture and its camera, whatever message they came in.

use serde_bytes::Bytes;

use crate::messages::{CameraInfo, CompressedImage, Header, Image, RegionOfInterest};

/// How a recorded picture's bytes lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    /// A JPEG or PNG file.
    File,
    /// Three bytes a pixel: red, green, blue.
    Rgb8,
    /// Three bytes a pixel: blue, green, red.
    Bgr8,
    /// One byte a pixel.
    Mono8,
    /// Two pixels in four bytes: Y, U, Y, V.
    Yuyv,
    /// A plane of Y, then one of U and V in turn, half as high and wide; both with the same stride.
    Nv12,
    /// Depth: little-endian `f32` metres, NaN or 0 = none (ROS' 32FC1, REP 118).
    DepthMetres,
    /// Depth: little-endian `u16` millimetres, 0 = none (ROS' 16UC1, REP 118).
    DepthMillimetres,
}

impl Encoding {
    /// Whether it is no picture but depth.
    #[must_use]
    pub fn is_depth(self) -> bool {
        matches!(self, Self::DepthMetres | Self::DepthMillimetres)
    }
}

/// A recorded picture. Its memory is used again for the next one.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Picture {
    /// The file, or rows from the top.
    pub data: Vec<u8>,
    /// How the bytes lie; `None` before the first picture.
    pub encoding: Option<Encoding>,
    /// Pixels; 0 of a [`Encoding::File`], which says it itself.
    pub width: u32,
    /// Pixels; 0 of a [`Encoding::File`].
    pub height: u32,
    /// Bytes from row to row; 0 of a [`Encoding::File`].
    pub row_stride: u32,
    /// When it was taken as the message says, nanoseconds since 1970; 0 where it does not say.
    pub stamp_nanos: i64,
    /// When it was recorded, nanoseconds of the recording's clock.
    pub log_nanos: u64,
    /// The coordinate frame of the camera.
    pub frame_id: String,
}

/// What a recording says of a camera.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CameraDescription {
    /// Pixels of the pictures that it is for.
    pub width: u32,
    /// Pixels of the pictures that it is for.
    pub height: u32,
    /// fx, fy, cx, cy in pixels.
    pub intrinsics: [f64; 4],
    /// `plumb_bob`, `rational_polynomial`, `equidistant` ...; empty for none.
    pub distortion_model: String,
    /// Its coefficients, in the model's order.
    pub coefficients: Vec<f64>,
    /// Why the numbers above must not be used, where the message contradicts itself.
    pub fault: Option<String>,
}

impl CameraDescription {
    /// Of ROS 2's message; `None` of an uncalibrated camera, which has zeros. Pictures that were rectified are those of
    /// the projection P, which has no lens; K and D are of the picture before.
    pub(crate) fn of_ros(info: &CameraInfo<'_>, rectified: bool) -> Option<Self> {
        let size = (info.width, info.height);
        let whole = if rectified {
            Self::of_projection(size, &info.p)
        } else {
            Self::new(size, &info.k, &info.distortion_model, info.d.clone())
        };
        whole.map(|camera| camera.captured(info))
    }

    /// From the camera of the whole sensor, which K, P, width and height of ROS 2's message are of, to that of the pictures:
    /// the region of interest, in pixels of the whole, whose blocks of `binning` pixels are one each.
    fn captured(mut self, info: &CameraInfo<'_>) -> Self {
        let RegionOfInterest { x_offset, y_offset, width, height, .. } = info.roi;
        let x = Side::captured(self.width, x_offset, width, info.binning_x);
        let y = Side::captured(self.height, y_offset, height, info.binning_y);
        let (Some(x), Some(y)) = (x, y) else {
            self.fault = Some(format!(
                "its region of interest of {width}x{height} pixels from column {x_offset} and row {y_offset} on is not \
                 within the sensor's {}x{}",
                self.width, self.height
            ));
            return self;
        };
        let [fx, fy, cx, cy] = self.intrinsics;
        self.intrinsics = [x.focal(fx), y.focal(fy), x.centre(cx), y.centre(cy)];
        (self.width, self.height) = (x.pixels, y.pixels);
        self
    }

    /// From the matrix P of rectified pictures, row by row.
    pub(crate) fn of_projection(size: (u32, u32), p: &[f64]) -> Option<Self> {
        let &[fx, _, cx, _, _, fy, cy, ..] = p else { return None };
        Self::new(size, &[fx, 0.0, cx, 0.0, fy, cy], "", Vec::new())
    }

    /// Whether the lens is a fisheye's, after Kannala and Brandt.
    #[must_use]
    pub fn is_fisheye(&self) -> bool {
        self.distortion_model == FISHEYE
    }

    /// From the matrix K, row by row.
    pub(crate) fn new(size: (u32, u32), k: &[f64], model: &str, coefficients: Vec<f64>) -> Option<Self> {
        let &[fx, _, cx, _, fy, cy, ..] = k else { return None };
        // Foxglove's name for ROS' model.
        let model = if model == "kannala_brandt" { FISHEYE } else { model };
        (fx != 0.0).then(|| Self {
            width: size.0,
            height: size.1,
            intrinsics: [fx, fy, cx, cy],
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
            // ROS' tools expect five coefficients of `plumb_bob`, also where all are 0.
            d: if self.coefficients.is_empty() { vec![0.0; 5] } else { self.coefficients.clone() },
            k: [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
            r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            p: [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
            binning_x: 0,
            binning_y: 0,
            roi: crate::messages::RegionOfInterest::default(),
        }
    }
}

/// Width or height of what a camera gives of its sensor.
struct Side {
    /// Where it begins, pixels of the sensor.
    offset: f64,
    /// Pixels of the sensor that are one of the picture.
    binning: f64,
    /// Of the picture.
    pixels: u32,
}

impl Side {
    /// ROS' zeros are the whole sensor, and no binning; `None` of a region that reaches beyond the sensor.
    fn captured(sensor: u32, offset: u32, size: u32, binning: u32) -> Option<Self> {
        let size = if (offset, size) == (0, 0) { sensor } else { size };
        let binning = binning.max(1);
        let within = (size > 0 || sensor == 0) && offset.checked_add(size)? <= sensor;
        within.then(|| Self { offset: offset.into(), binning: binning.into(), pixels: size / binning })
    }

    fn focal(&self, pixels: f64) -> f64 {
        pixels / self.binning
    }

    /// The middle of a block becomes the middle of a pixel. (ROS' own `image_geometry` divides alone, which is off by
    /// less than half a pixel.)
    fn centre(&self, pixels: f64) -> f64 {
        let within = pixels - self.offset;
        // Not the same to the last bit, and almost nobody bins.
        if self.binning > 1.0 { (within + 0.5) / self.binning - 0.5 } else { within }
    }
}

/// ROS' name of the fisheye's model.
const FISHEYE: &str = "equidistant";

/// A raw picture as a message has it.
pub(crate) struct Raw<'a> {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) step: u32,
    pub(crate) encoding: &'a str,
    pub(crate) data: &'a [u8],
}

impl Picture {
    /// When it was taken, nanoseconds since 1970: as the message says, else as it was recorded.
    #[must_use]
    pub fn unix_nanos(&self) -> i64 {
        if self.stamp_nanos == 0 {
            i64::try_from(self.log_nanos).unwrap_or(i64::MAX)
        } else {
            self.stamp_nanos
        }
    }

    /// Metres of a depth picture, rows without padding, NaN = none; nothing of any other.
    #[must_use]
    pub fn depth_m(&self) -> Vec<f32> {
        let rows = self.data.chunks_exact(self.row_stride.max(1) as usize);
        let width = self.width as usize;
        let known = |metres: f32| if metres > 0.0 { metres } else { f32::NAN };
        match self.encoding {
            Some(Encoding::DepthMetres) => rows
                .flat_map(|row| {
                    row.as_chunks().0.iter().take(width).map(|&bytes| known(f32::from_le_bytes(bytes)))
                })
                .collect(),
            Some(Encoding::DepthMillimetres) => rows
                .flat_map(|row| {
                    let values = row.as_chunks().0.iter().take(width);
                    values.map(|&bytes| known(f32::from(u16::from_le_bytes(bytes)) / 1000.0))
                })
                .collect(),
            _ => Vec::new(),
        }
    }

    pub(crate) fn set_ros_image(&mut self, image: &Image<'_>) -> Result<(), String> {
        let bytes_a_number = if matches!(&*image.encoding, "32FC1" | "16UC1" | "mono16") { 2 } else { 1 };
        if image.is_bigendian != 0 && bytes_a_number > 1 {
            return Err(format!("big-endian `{}` cannot be read", image.encoding));
        }
        self.set_header(image.header.stamp.unix_nanos(), &image.header.frame_id);
        let Image { width, height, step, .. } = *image;
        self.set_raw(&Raw { width, height, step, encoding: &image.encoding, data: image.data })
    }

    pub(crate) fn set_ros_compressed(&mut self, image: &CompressedImage<'_>) -> Result<(), String> {
        self.set_header(image.header.stamp.unix_nanos(), &image.header.frame_id);
        self.set_file(image.data, &image.format)
    }

    pub(crate) fn set_header(&mut self, stamp_nanos: i64, frame_id: &str) {
        self.stamp_nanos = stamp_nanos;
        frame_id.clone_into(&mut self.frame_id);
    }

    /// A JPEG or PNG: told by its first bytes, since formats are written in many ways ("rgb8; jpeg compressed bgr8").
    pub(crate) fn set_file(&mut self, data: &[u8], format: &str) -> Result<(), String> {
        if !data.starts_with(&[0xff, 0xd8, 0xff]) && !data.starts_with(b"\x89PNG\r\n\x1a\n") {
            return Err(format!("compressed as `{format:.60}`, which is neither JPEG nor PNG"));
        }
        self.encoding = Some(Encoding::File);
        (self.width, self.height, self.row_stride) = (0, 0, 0);
        data.clone_into(&mut self.data);
        Ok(())
    }

    pub(crate) fn set_raw(&mut self, raw: &Raw<'_>) -> Result<(), String> {
        let (encoding, bytes_per_pixel, change) = layout(raw.encoding)
            .ok_or_else(|| format!("encoding `{:.60}` cannot be read; expected {KNOWN}", raw.encoding))?;
        let (width, height, step) = (raw.width, raw.height, raw.step);
        let colour_rows = if encoding == Encoding::Nv12 { height.div_ceil(2) } else { 0 };
        let rows = u64::from(height) + u64::from(colour_rows);
        let (row, needed) = (u64::from(width) * bytes_per_pixel, u64::from(step) * rows);
        if width == 0 || height == 0 || u64::from(step) < row || (raw.data.len() as u64) < needed {
            return Err(format!(
                "{width}x{height} `{:.60}` with {step} bytes a row needs rows of {row} bytes and {needed} in all, got {}",
                raw.encoding,
                raw.data.len()
            ));
        }
        self.encoding = Some(encoding);
        (self.width, self.height, self.row_stride) = (width, height, step);
        self.data.clear();
        let data = raw.data.get(..needed as usize).unwrap_or_default();
        match change {
            Change::None => self.data.extend_from_slice(data),
            Change::SwapPairs => self.data.extend(data.chunks_exact(2).flat_map(|pair| [pair[1], pair[0]])),
            Change::DropFourth => {
                for row in data.chunks_exact(step as usize) {
                    let pixels = row.chunks_exact(4).take(width as usize);
                    self.data.extend(pixels.flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]));
                }
                self.row_stride = 3 * width;
            }
        }
        Ok(())
    }
}

const KNOWN: &str = "rgb8, bgr8, rgba8, bgra8, mono8, yuv422 (uyvy), yuv422_yuy2 (yuyv) or nv12";

enum Change {
    None,
    /// U Y V Y to Y U Y V.
    SwapPairs,
    /// The alpha channel.
    DropFourth,
}

/// Our encoding, the message's bytes a pixel, and what is to be changed, by ROS' and Foxglove's names.
fn layout(encoding: &str) -> Option<(Encoding, u64, Change)> {
    Some(match encoding {
        "rgb8" => (Encoding::Rgb8, 3, Change::None),
        "bgr8" | "8UC3" => (Encoding::Bgr8, 3, Change::None),
        "rgba8" => (Encoding::Rgb8, 4, Change::DropFourth),
        "bgra8" | "8UC4" => (Encoding::Bgr8, 4, Change::DropFourth),
        "mono8" | "8UC1" => (Encoding::Mono8, 1, Change::None),
        "yuv422_yuy2" | "yuyv" => (Encoding::Yuyv, 2, Change::None),
        "yuv422" | "uyvy" => (Encoding::Yuyv, 2, Change::SwapPairs),
        "nv12" => (Encoding::Nv12, 1, Change::None),
        "32FC1" => (Encoding::DepthMetres, 4, Change::None),
        "16UC1" | "mono16" => (Encoding::DepthMillimetres, 2, Change::None),
        _ => return None,
    })
}

/// Bytes as serde takes them.
pub(crate) fn bytes(data: &[u8]) -> &Bytes {
    Bytes::new(data)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set(encoding: &str, (width, height): (u32, u32), step: u32, data: &[u8]) -> Result<Picture, String> {
        let mut picture = Picture::default();
        picture.set_raw(&Raw { width, height, step, encoding, data }).map(|()| picture)
    }

    #[test]
    fn alpha_is_dropped_and_rows_are_packed() {
        let picture = set("bgra8", (1, 2), 5, &[1, 2, 3, 255, 0, 4, 5, 6, 255, 0]).unwrap();
        assert_eq!((picture.encoding, picture.row_stride), (Some(Encoding::Bgr8), 3));
        assert_eq!(picture.data, [1, 2, 3, 4, 5, 6]);
    }

    #[test]
    fn depth_is_metres_whatever_it_was_and_nothing_is_nan() {
        let millimetres = set("16UC1", (2, 1), 6, &[0xd0, 0x07, 0, 0, 9, 9]).unwrap().depth_m();
        assert_eq!(millimetres[0], 2.0);
        assert!(millimetres[1].is_nan());
        let bytes: Vec<u8> =
            [1.5_f32, f32::NAN, 0.0].iter().flat_map(|metres| metres.to_le_bytes()).collect();
        let metres = set("32FC1", (3, 1), 12, &bytes).unwrap().depth_m();
        assert_eq!((metres[0], metres[1].is_nan(), metres[2].is_nan()), (1.5, true, true));
        assert!(set("mono8", (1, 1), 1, &[1]).unwrap().depth_m().is_empty());
    }

    #[test]
    fn uyvy_becomes_yuyv() {
        assert_eq!(set("uyvy", (2, 1), 4, &[10, 20, 30, 40]).unwrap().data, [20, 10, 40, 30]);
    }

    #[test]
    fn nv12_of_an_odd_height_keeps_the_colour_of_its_last_row() {
        let picture = set("nv12", (2, 3), 2, &[1, 2, 3, 4, 5, 6, 128, 127, 126, 125, 99]).unwrap();
        assert_eq!(picture.data, [1, 2, 3, 4, 5, 6, 128, 127, 126, 125]);
        let error = set("nv12", (2, 3), 2, &[0; 9]).unwrap_err();
        assert_eq!(error, "2x3 `nv12` with 2 bytes a row needs rows of 2 bytes and 10 in all, got 9");
    }

    #[test]
    fn a_size_that_contradicts_its_data_is_an_error_with_both() {
        let error = set("rgb8", (4, 2), 12, &[0; 23]).unwrap_err();
        assert_eq!(error, "4x2 `rgb8` with 12 bytes a row needs rows of 12 bytes and 24 in all, got 23");
        for (size, step) in [((0, 2), 12), ((5, 2), 12), ((u32::MAX, u32::MAX), u32::MAX)] {
            set("rgb8", size, step, &[0; 24]).unwrap_err();
        }
    }

    #[test]
    fn an_unknown_encoding_is_named_with_those_that_are_read() {
        let error = set("bayer_rggb8", (2, 2), 2, &[0; 4]).unwrap_err();
        assert_eq!(error, format!("encoding `bayer_rggb8` cannot be read; expected {KNOWN}"));
    }

    #[test]
    fn compressed_pictures_are_told_by_their_bytes() {
        let mut picture = Picture::default();
        picture.set_file(&[0xff, 0xd8, 0xff, 0xe0], "rgb8; jpeg compressed bgr8").unwrap();
        assert_eq!(picture.encoding, Some(Encoding::File));
        let error = picture.set_file(b"RIFF....WEBP", "webp").unwrap_err();
        assert_eq!(error, "compressed as `webp`, which is neither JPEG nor PNG");
    }

    #[test]
    fn foxgloves_fisheye_is_ros() {
        let k = [500.0, 0.0, 320.0, 0.0, 500.0, 240.0, 0.0, 0.0, 1.0];
        let camera = CameraDescription::new((640, 480), &k, "kannala_brandt", vec![0.0; 4]).unwrap();
        assert!(camera.is_fisheye());
        assert!(!CameraDescription::new((640, 480), &k, "plumb_bob", vec![0.0; 5]).unwrap().is_fisheye());
    }

    #[test]
    fn rectified_pictures_have_the_projections_camera_and_no_lens() {
        let p = [400.0, 0.0, 310.0, 0.0, 0.0, 401.0, 230.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        let camera = CameraDescription::of_projection((640, 480), &p).unwrap();
        assert_eq!((camera.intrinsics, camera.coefficients.len()), ([400.0, 401.0, 310.0, 230.0], 0));
    }

    /// Of 640x480 pixels of which the region of interest is 320x240 in the middle, and the camera of its pictures.
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
    fn binning_makes_one_pixel_of_a_block_of_the_region() {
        let camera = cropped(|info| (info.binning_x, info.binning_y) = (2, 4), false);
        assert_eq!((camera.width, camera.height), (160, 60));
        assert_eq!(camera.intrinsics, [250.0, 127.5, 120.5 / 2.0 - 0.5, 140.5 / 4.0 - 0.5]);
    }

    #[test]
    fn zeros_are_the_whole_sensor_on_either_side() {
        let whole = cropped(|info| info.roi = RegionOfInterest::default(), false);
        assert_eq!((whole.width, whole.height, whole.intrinsics), (640, 480, [500.0, 510.0, 320.0, 240.0]));
        let wide = cropped(|info| (info.roi.x_offset, info.roi.width) = (0, 0), false);
        assert_eq!((wide.width, wide.height, wide.intrinsics), (640, 240, [500.0, 510.0, 320.0, 140.0]));
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
        let changes: [fn(&mut CameraInfo<'_>); 3] =
            [|info| info.roi.height = 0, |info| info.roi.height = 381, |info| info.roi.y_offset = u32::MAX];
        for change in changes {
            assert!(cropped(change, true).fault.is_some());
        }
    }

    #[test]
    fn an_uncalibrated_camera_is_none() {
        assert_eq!(CameraDescription::new((640, 480), &[0.0; 9], "", Vec::new()), None);
    }
}
