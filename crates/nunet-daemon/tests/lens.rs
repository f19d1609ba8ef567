//! A camera's lens from the calibration file to the points of the cloud, through every process on the way.

use std::time::Instant;

use nunet_core::pipeline::MAX_RAY_ANGLE_RAD;
use nunet_ipc::{CameraName, DistortionModel, FrameHeader, FrameSet, Reader, ScaleSource, Topic};

use crate::support::{Bench, Guarded, SIZE, TIMEOUT, calibration, camera, nunetd};

const FISHEYE: [f64; 4] = [-0.0123, 0.0034, -0.0025, 0.0004];

/// At twice the size of the images, so that it is scaled. Its circle of 180 degrees is smaller than the
/// image.
fn fisheye() -> String {
    let camera = [340.0, 342.0, 641.0, 475.0];
    calibration((1280, 960), camera, "equidistant", &FISHEYE)
}

fn first_set(camera: &str) -> FrameSet {
    let mut reader =
        Reader::open(&CameraName::new(camera).unwrap(), &[Topic::Depth, Topic::Cloud], TIMEOUT).unwrap();
    let start = Instant::now();
    while start.elapsed() < TIMEOUT {
        if let Some(set) = reader.next_set().unwrap() {
            return set;
        }
        reader.wait(std::time::Duration::from_millis(100)).unwrap();
    }
    panic!("no complete frame within {TIMEOUT:?}")
}

fn check_fisheye(header: &FrameHeader) {
    assert_eq!(header.distortion_model(), Ok(DistortionModel::KannalaBrandt));
    assert_eq!(header.distortion[..4], FISHEYE);
    assert_eq!(header.distortion[4..], [0.0; 10]);
}

#[test]
fn the_daemon_uses_the_fisheye_of_a_fed_camera_for_its_points() {
    let bench = Bench::new();
    bench.add_image("images/0.png", 0);
    std::fs::write(bench.path("fisheye.yaml"), fisheye()).unwrap();
    let (model, images, file) = (bench.arg("model.onnx"), bench.arg("images"), bench.arg("fisheye.yaml"));
    let (front, depth) = (camera("fisheye"), camera("fisheye_depth"));
    let _feeder = Guarded::start(nunetd(&[
        "-q",
        "feed",
        &images,
        "--camera",
        &front,
        "--loop",
        "--rate",
        "20",
        "--calibration",
        &file,
    ]));
    let source = format!("shm:{front}");
    let _daemon = Guarded::start(nunetd(&[
        "-q",
        "--model",
        &model,
        "--source",
        &source,
        "--camera",
        &depth,
        "--cloud-stride",
        "2",
        "--max-range",
        "1000", // near 85 degrees points are far away; the angle alone is tested here
    ]));
    let set = first_set(&depth);

    let map = set.get(Topic::Depth).unwrap();
    check_fisheye(map.header());
    assert_eq!((map.header().fx, map.header().fy), (170.0, 171.0), "half the size of the calibration");
    assert_eq!((map.header().cx, map.header().cy), (320.25, 237.25));
    assert_eq!(map.header().scale_source(), Ok(ScaleSource::FocalScaled));
    let cloud = set.get(Topic::Cloud).unwrap();
    check_fisheye(cloud.header());
    assert_eq!((cloud.header().fx, cloud.header().cx), (85.0, 160.125), "every second column");
    check_points(map.depth().unwrap(), cloud.header(), cloud.points().unwrap());
}

/// Each point is projected onto its pixel by the formula of Kannala and Brandt (2006, equation 6, as OpenCV
/// writes it), or its pixel is beyond the largest angle of a cloud's rays.
fn check_points(depth_m: &[f32], header: &FrameHeader, points: &[nunet_ipc::CloudPoint]) {
    let [k1, k2, k3, k4] = FISHEYE;
    let distorted = |angle: f64| {
        let u = angle * angle;
        angle * (1.0 + k1 * u + k2 * u * u + k3 * u.powi(3) + k4 * u.powi(4))
    };
    let circle = distorted(MAX_RAY_ANGLE_RAD);
    let (mut seen, mut unseen) = (0, 0);
    for (index, point) in points.iter().enumerate() {
        let (column, row) = (index % header.width as usize, index / header.width as usize);
        let x = (column as f64 - header.cx) / header.fx;
        let y = (row as f64 - header.cy) / header.fy;
        let z = depth_m[2 * row * SIZE.0 as usize + 2 * column];
        assert!(z.is_finite(), "this network measures everywhere");
        if x.hypot(y) >= circle {
            unseen += 1;
            assert!(point.x.is_nan() && point.y.is_nan() && point.z.is_nan(), "{column}, {row}: {point:?}");
            continue;
        }
        seen += 1;
        assert_eq!(point.z, z, "{column}, {row}");
        let (ray_x, ray_y) = (f64::from(point.x / z), f64::from(point.y / z));
        let radius = ray_x.hypot(ray_y);
        // A ten-thousandth of a focal length is a hundredth of a pixel here; the rays are f32.
        if radius > 0.0 {
            let scale = distorted(radius.atan()) / radius;
            let off = (ray_x * scale - x).hypot(ray_y * scale - y);
            assert!(off < 1e-4, "{column}, {row}: {point:?} is off by {off}");
        }
    }
    assert!(seen > 10_000 && unseen > 10_000, "{seen} seen, {unseen} not");
}

#[test]
fn a_given_calibration_overrides_that_of_the_source() {
    let bench = Bench::new();
    let lens = [-0.31, 0.11, 0.0007, -0.0004, 0.02];
    let text = calibration(SIZE, [520.0, 521.0, 318.0, 242.0], "plumb_bob", &lens);
    std::fs::write(bench.path("webcam.yaml"), text).unwrap();
    let (model, file, name) = (bench.arg("model.onnx"), bench.arg("webcam.yaml"), camera("named_lens"));
    let _daemon = Guarded::start(nunetd(&[
        "-q",
        "--model",
        &model,
        "--source",
        "demo",
        "--rate",
        "20",
        "--camera",
        &name,
        "--calibration",
        &file,
    ]));
    let set = first_set(&name);
    for frame in set.iter() {
        let header = frame.header();
        assert_eq!(header.distortion_model(), Ok(DistortionModel::BrownConrady));
        assert_eq!(header.distortion[..5], lens);
        assert_eq!((header.fx, header.cy), (520.0, 242.0));
    }
}
