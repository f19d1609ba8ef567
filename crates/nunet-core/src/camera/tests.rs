//! Lenses compared with OpenCV, and `undistort` as the inverse of `distort`.

use proptest::prelude::*;
use serde_json::Value;

use super::*;

/// Made by `tests/golden/opencv_rays.py` beside it, with the release of OpenCV that it names.
const GOLDEN: &str = include_str!("../../tests/golden/opencv_rays.json");

/// OpenCV stops 1e-12 pixels off, this crate 1e-12 focal lengths; near the fold a ray moves a hundred times
/// as far as its pixel. Found: 1.3e-12 at most.
const RAY_TOLERANCE: f64 = 1e-10;

/// The same formulas on the same doubles in another order, some roundings of 2e-13 at column 1920. Found:
/// 5e-13 at most.
const PIXEL_TOLERANCE: f64 = 1e-11;

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

fn golden_camera(camera: &Value) -> Camera {
    let model: DistortionModel = camera["model"].as_str().unwrap().parse().unwrap();
    let distortion = (Distortion::entry(model).unwrap().new)(&numbers(&camera["distortion"])).unwrap();
    let [fx, fy, cx, cy] = numbers(&camera["intrinsics"])[..] else { panic!("{camera}") };
    let side = |key: &str| camera[key].as_u64().unwrap() as u32;
    let intrinsics = Intrinsics::new(fx, fy, cx, cy, side("width"), side("height")).unwrap();
    Camera { intrinsics, distortion }
}

fn ray_of(camera: &Camera, pixel: [f64; 2]) -> Option<[f64; 2]> {
    let Intrinsics { fx_px, fy_px, cx_px, cy_px, .. } = camera.intrinsics;
    let seen = Point2::new((pixel[0] - cx_px) / fx_px, (pixel[1] - cy_px) / fy_px);
    camera.distortion.undistort(seen).map(|ray| [ray.x, ray.y])
}

#[test]
fn every_lens_model_is_compared_with_opencv() {
    let golden: Value = serde_json::from_str(GOLDEN).unwrap();
    let cameras = golden["cameras"].as_array().unwrap();
    for &model in DistortionModel::ALL.iter().filter(|&&model| model != DistortionModel::None) {
        assert!(cameras.iter().any(|camera| camera["model"] == model.name()), "{model} has no camera");
    }
}

#[test]
fn pixels_see_where_opencv_says_they_see() {
    let golden: Value = serde_json::from_str(GOLDEN).unwrap();
    for recorded in golden["cameras"].as_array().unwrap() {
        let (name, camera) = (&recorded["name"], golden_camera(recorded));
        let rays = recorded["rays"].as_array().unwrap();
        assert!(rays.len() > 30, "{name}");
        for ray in rays.iter().map(numbers) {
            let [column, row, x, y] = ray[..] else { panic!("{ray:?}") };
            let found = ray_of(&camera, [column, row]);
            let found = found.unwrap_or_else(|| panic!("{name} has no ray at {column}, {row}"));
            let far = 1.0 + x.hypot(y);
            // A unit of tangent is less of an angle far from the axis.
            let off = (found[0] - x).hypot(found[1] - y) / (far * far);
            assert!(off < RAY_TOLERANCE, "{name} at {column}, {row}: {found:?}, not {x}, {y}");
        }
    }
}

#[test]
fn pixels_outside_the_lens_model_have_no_ray() {
    let golden: Value = serde_json::from_str(GOLDEN).unwrap();
    let mut beyond = 0;
    for recorded in golden["cameras"].as_array().unwrap() {
        let (name, camera) = (&recorded["name"], golden_camera(recorded));
        for pixel in recorded["beyond"].as_array().unwrap().iter().map(numbers) {
            assert_eq!(ray_of(&camera, [pixel[0], pixel[1]]), None, "{name} at {pixel:?}");
            beyond += 1;
        }
    }
    assert!(beyond > 20, "{beyond}");
}

#[test]
fn points_appear_where_opencv_says_they_appear() {
    let golden: Value = serde_json::from_str(GOLDEN).unwrap();
    for recorded in golden["cameras"].as_array().unwrap() {
        let (name, camera) = (&recorded["name"], golden_camera(recorded));
        for point in recorded["points"].as_array().unwrap().iter().map(numbers) {
            let [x, y, z, column, row] = point[..] else { panic!("{point:?}") };
            let found = camera.project([x, y, z]).unwrap_or_else(|| panic!("{name}: {point:?}"));
            let off = (found[0] - column).hypot(found[1] - row);
            assert!(off < PIXEL_TOLERANCE, "{name}: {found:?}, not {column}, {row}");
        }
    }
}

#[test]
fn an_equidistant_fisheye_of_known_angles() {
    let lens = Distortion::KannalaBrandt(KannalaBrandt::new(&[0.0; 4]).unwrap());
    let ray = lens.undistort(Point2::new(std::f64::consts::FRAC_PI_4, 0.0)).unwrap();
    assert!((ray.x - 1.0).abs() < 1e-12 && ray.y == 0.0, "{ray}");
    assert_eq!(lens.undistort(Point2::origin()), Some(Point2::origin()));
    assert!(lens.undistort(Point2::new(0.0, 1.57)).is_some(), "89.95 degrees");
    assert_eq!(lens.undistort(Point2::new(0.0, 1.571)), None, "90.01 degrees have no point at depth 1");
}

#[test]
fn a_barrel_that_folds_back_has_rays_only_up_to_the_fold() {
    // r (1 - r² / 3) rises until r = 1, where it is 2/3.
    let lens = Distortion::BrownConrady(BrownConrady::new(&[-1.0 / 3.0, 0.0, 0.0, 0.0]).unwrap());
    let ray = lens.undistort(Point2::new(0.0, -0.666)).unwrap();
    assert!(ray.y < -0.9 && ray.y > -1.0, "{ray}");
    assert_eq!(lens.undistort(Point2::new(0.0, -0.667)), None);
    assert_eq!(
        lens.distort(Point2::new(0.8, 0.7)),
        None,
        "beyond the fold, points appear where nearer ones do"
    );
}

#[test]
fn points_beside_or_behind_the_camera_are_not_projected() {
    let intrinsics = Intrinsics::new(300.0, 300.0, 320.0, 240.0, 640, 480).unwrap();
    let fisheye = Distortion::KannalaBrandt(KannalaBrandt::new(&[0.0; 4]).unwrap());
    for distortion in [Distortion::None, fisheye] {
        let camera = Camera { intrinsics, distortion };
        for point in [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 0.0, f64::NAN], [0.0; 3]] {
            assert_eq!(camera.project(point), None, "{point:?}");
        }
    }
}

#[test]
fn the_table_of_a_wide_fisheye_has_nan_outside_its_circle_and_rays_inside() {
    // 90 degrees are 157 pixels from the center.
    let intrinsics = Intrinsics::new(100.0, 100.0, 199.5, 199.5, 400, 400).unwrap();
    let distortion = Distortion::KannalaBrandt(KannalaBrandt::new(&[0.0; 4]).unwrap());
    let table = RayTable::new(&Camera { intrinsics, distortion });
    for (index, ray) in table.rays().iter().enumerate() {
        let (column, row) = ((index % 400) as f64, (index / 400) as f64);
        let in_front = (column - 199.5).hypot(row - 199.5) < 50.0 * std::f64::consts::PI;
        assert_eq!(ray.iter().all(|side| side.is_finite()), in_front, "{column}, {row}: {ray:?}");
        assert_eq!(ray.iter().any(|side| side.is_nan()), !in_front, "{column}, {row}: {ray:?}");
    }
}

#[test]
fn coefficients_that_no_lens_has_are_refused_by_name() {
    let error = BrownConrady::new(&[0.0, f64::NAN, 0.0, 0.0, 0.0]).unwrap_err();
    assert!(matches!(error, CameraError::Coefficient { name: "k2", limit: 1e6, .. }), "{error}");
    let mut tilted = [0.0; MAX_COEFFICIENTS];
    tilted[13] = 1.6;
    let error = BrownConrady::new(&tilted).unwrap_err();
    assert_eq!(error, CameraError::Coefficient { name: "tilt_y", value: 1.6, limit: 1.5 });
    let error = KannalaBrandt::new(&[0.0; 5]).unwrap_err();
    assert_eq!(error, CameraError::CoefficientCount { model: "kannala_brandt", got: 5, expected: &[4] });
}

/// Lenses like those that calibrations find, and stronger ones.
fn lens() -> impl Strategy<Value = Distortion> {
    let plain = (-0.45..0.3f64, -0.2..0.2f64, -0.004..0.004f64, -0.004..0.004f64, -0.05..0.05f64)
        .prop_map(|(k1, k2, p1, p2, k3)| BrownConrady::new(&[k1, k2, p1, p2, k3]).unwrap());
    let rational = (proptest::array::uniform3(0.0..5.0f64), proptest::array::uniform2(-0.002..0.002f64))
        .prop_map(|([k4, k5, k6], [p1, p2])| {
            BrownConrady::new(&[k4 - 0.4, k5 - 0.1, p1, p2, 0.9 * k6, k4, k5, k6]).unwrap()
        });
    let tilted = (-0.3..0.2f64, proptest::array::uniform4(-0.002..0.002f64), -0.1..0.1f64, -0.1..0.1f64)
        .prop_map(|(k1, [s1, s2, s3, s4], tilt_x, tilt_y)| {
            let none = 0.0;
            let numbers = [k1, none, none, none, none, none, none, none, s1, s2, s3, s4, tilt_x, tilt_y];
            BrownConrady::new(&numbers).unwrap()
        });
    let fisheye = proptest::array::uniform4(-0.03..0.03f64)
        .prop_map(|numbers| Distortion::KannalaBrandt(KannalaBrandt::new(&numbers).unwrap()));
    prop_oneof![
        plain.prop_map(Distortion::BrownConrady),
        rational.prop_map(Distortion::BrownConrady),
        tilted.prop_map(Distortion::BrownConrady),
        fisheye
    ]
}

/// The largest radius up to which every point appears.
fn reach(lens: &Distortion) -> f64 {
    (0..200)
        .map(|step| 0.01 * f64::from(step))
        .take_while(|&r| lens.distort(Point2::new(r, 0.0)).is_some())
        .last()
        .unwrap_or(0.0)
}

proptest! {
    // Some lenses show nothing at most of the places that are drawn.
    #![proptest_config(ProptestConfig { max_global_rejects: 1 << 16, ..ProptestConfig::default() })]

    #[test]
    fn undistort_inverts_distort(lens in lens(), far in 0.0..0.85f64, around in 0.0..std::f64::consts::TAU) {
        let radius = far * reach(&lens);
        let ray = Point2::new(radius * around.cos(), radius * around.sin());
        let distorted = lens.distort(ray);
        prop_assert!(distorted.is_some(), "{ray}");
        let back = distorted.and_then(|distorted| lens.undistort(distorted));
        prop_assert!(back.is_some_and(|back| (back - ray).norm() < 1e-9), "{ray} came back as {back:?}");
    }

    #[test]
    fn distort_inverts_undistort(lens in lens(), x in -3.0..3.0f64, y in -3.0..3.0f64) {
        let seen = Point2::new(x, y);
        let ray = lens.undistort(seen);
        prop_assume!(ray.is_some());
        let distorted = ray.and_then(|ray| lens.distort(ray));
        prop_assert!(distorted.is_some_and(|back| (back - seen).norm() < 1e-9), "{seen} by {ray:?}: {distorted:?}");
    }

    #[test]
    fn a_resized_image_has_the_same_rays(lens in lens(), far in 0.0..0.8f64, width in 16u32..2000, height in 16u32..2000) {
        let intrinsics = Intrinsics::new(500.0, 510.0, 322.0, 236.0, 640, 480).unwrap();
        let camera = Camera { intrinsics, distortion: lens };
        let resized = camera.scaled_to(width, height).unwrap();
        let point = [far * reach(&lens) * 2.0, 0.1, 2.0];
        let (Some([column, row]), Some([small_column, small_row])) = (camera.project(point), resized.project(point))
        else {
            return Err(TestCaseError::reject("the lens does not show the point"));
        };
        prop_assert!(((column + 0.5) / 640.0 - (small_column + 0.5) / f64::from(width)).abs() < 1e-12);
        prop_assert!(((row + 0.5) / 480.0 - (small_row + 0.5) / f64::from(height)).abs() < 1e-12);
    }

    #[test]
    fn arbitrary_numbers_neither_panic_nor_hang(numbers in proptest::collection::vec(-1e6..1e6f64, 14), x in -1e3..1e3f64, y in -1e3..1e3f64) {
        for count in [4, 5, 8, 12] {
            let lens = BrownConrady::new(&numbers[..count]).unwrap();
            let _ = (lens.undistort(Point2::new(x, y)), lens.distort(Point2::new(x, y)));
        }
        let lens = KannalaBrandt::new(&numbers[..4]).unwrap();
        let _ = (lens.undistort(Point2::new(x, y)), lens.distort(Point2::new(x, y)));
    }
}
