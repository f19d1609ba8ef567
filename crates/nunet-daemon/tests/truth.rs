//! A network that returns the exact depth of the demo scene: published results must equal it, bit by bit. It
//! compares the image it gets with the one it expects, so swapped colors, a mirrored image or a shifted row
//! turn depth into NaN.

use std::time::Instant;

use nunet_ipc::{CameraName, FrameSet, Reader, ScaleSource, Topic, Units};
use nunet_testkit::demo::DemoScene;
use nunet_testkit::models;
use nunet_testkit::onnx::{ModelBuilder, OnnxElement};

use crate::support::{Bench, Guarded, SIZE, TIMEOUT, camera, nunetd};

const SEED: u64 = 1;
const PIXELS: usize = (SIZE.0 * SIZE.1) as usize;

struct Truth {
    scene: DemoScene,
    rgb: Vec<u8>,
    depth_m: Vec<f32>,
    labels: Vec<u8>,
}

impl Truth {
    fn new() -> Self {
        let mut scene = DemoScene::new(SEED, SIZE.0, SIZE.1);
        let (mut rgb, mut depth_m, mut labels) = (vec![0; 3 * PIXELS], vec![0.0; PIXELS], vec![0; PIXELS]);
        scene.render(0, &mut rgb, Some(&mut depth_m), Some(&mut labels));
        Self { scene, rgb, depth_m, labels }
    }

    /// Exact depth where the image is this one to the byte, NaN elsewhere.
    fn network(&self) -> ModelBuilder {
        let (width, height) = (i64::from(SIZE.0), i64::from(SIZE.1));
        let expected: Vec<f32> = self.rgb.iter().map(|&value| f32::from(value)).collect();
        let labels: Vec<f32> = self.labels.iter().map(|&label| f32::from(label)).collect();
        let float = [("to", (OnnxElement::F32 as i64).into())];
        let byte = [("to", (OnnxElement::U8 as i64).into())];
        let model = ModelBuilder::new()
            .input("rgb", OnnxElement::U8, &[1, height, width, 3])
            .constant_f32("expected", &[1, height, width, 3], &expected)
            .constant_f32("truth", &[1, 1, height, width], &self.depth_m)
            .constant_f32("classes", &[1, height, width], &labels)
            .constant_f32("nan", &[1], &[f32::NAN])
            .constant_f32("zero", &[1], &[0.0])
            .constant_i64("channels", &[1], &[3])
            .constant_i64("shape", &[4], &[1, 1, height, width])
            .node("Cast", &["rgb"], &["got"], &float)
            .node("Sub", &["got", "expected"], &["difference"], &[])
            .node("Abs", &["difference"], &["distance"], &[])
            .node("ReduceSum", &["distance", "channels"], &["wrong"], &[("keepdims", 0.into())])
            .node("Reshape", &["wrong", "shape"], &["wrong_map"], &[])
            .node("Greater", &["wrong_map", "zero"], &["is_wrong"], &[])
            .node("Where", &["is_wrong", "nan", "truth"], &["depth"], &[])
            .node("Cast", &["classes"], &["labels"], &byte)
            .output("depth", OnnxElement::F32, &[1, 1, height, width])
            .output("labels", OnnxElement::U8, &[1, height, width]);
        let intrinsics = self.scene.intrinsics();
        let camera = format!(
            r#"{{"width": {width}, "height": {height}, "fx": {}, "fy": {}}}"#,
            intrinsics.fx_px, intrinsics.fy_px
        );
        let classes: Vec<_> = (0..13).map(|index| format!("\"class {index}\"")).collect();
        models::describe(model, "wnet_c", true)
            .metadata("nunet.camera", &camera)
            .metadata("nunet.classes", &format!("[{}]", classes.join(", ")))
    }
}

/// The camera as a flag; Rust prints the shortest digits that read back as the same number.
fn intrinsics_flag(truth: &Truth) -> String {
    let camera = truth.scene.intrinsics();
    format!("{},{},{},{}", camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)
}

fn next_set(reader: &mut Reader) -> FrameSet {
    let start = Instant::now();
    while start.elapsed() < TIMEOUT {
        if let Some(set) = reader.next_set().unwrap() {
            return set;
        }
        reader.wait(std::time::Duration::from_millis(100)).unwrap();
    }
    panic!("no complete frame within {TIMEOUT:?}")
}

#[test]
fn published_depth_labels_and_cloud_equal_the_truth_of_the_demo_scene() {
    let truth = Truth::new();
    let bench = Bench::new();
    bench.add_model("oracle.onnx", &truth.network());
    bench.add_image("images/0.png", 0);
    let name = camera("truth");
    let (model, images, intrinsics) =
        (bench.arg("oracle.onnx"), bench.arg("images"), intrinsics_flag(&truth));
    let _daemon = Guarded::start(nunetd(&[
        "-q",
        "--model",
        &model,
        "--source",
        &images,
        "--loop",
        "--rate",
        "20",
        "--camera",
        &name,
        "--intrinsics",
        &intrinsics,
    ]));
    let topics = [Topic::Depth, Topic::Labels, Topic::Cloud];
    let mut reader = Reader::open(&CameraName::new(&name).unwrap(), &topics, TIMEOUT).unwrap();
    let set = next_set(&mut reader);

    let depth = set.get(Topic::Depth).unwrap();
    let bits = |values: &[f32]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
    assert!(bits(depth.depth().unwrap()) == bits(&truth.depth_m), "published depth is not the truth");
    let header = depth.header();
    assert_eq!((header.width, header.height), SIZE);
    assert_eq!(header.units(), Ok(Units::Metre));
    assert_eq!(header.scale_source(), Ok(ScaleSource::FocalScaled));
    assert_eq!((header.bytes_copied, header.invalid_pixels), (0, 0));
    assert!((header.fx - truth.scene.intrinsics().fx_px).abs() < 1e-9);

    assert!(
        set.get(Topic::Labels).unwrap().labels().unwrap() == truth.labels,
        "published labels are not the truth"
    );
    check_cloud(&truth, set.get(Topic::Cloud).unwrap().points().unwrap());
}

/// Each point against the pinhole formula in double precision: x = (u - cx) z / fx (Hartley and Zisserman,
/// 6.1).
fn check_cloud(truth: &Truth, points: &[nunet_ipc::CloudPoint]) {
    let camera = truth.scene.intrinsics();
    assert_eq!(points.len(), PIXELS);
    for (index, point) in points.iter().enumerate() {
        let (u, v) = ((index % SIZE.0 as usize) as f64, (index / SIZE.0 as usize) as f64);
        let z = f64::from(truth.depth_m[index]);
        let expected = [(u - camera.cx_px) * z / camera.fx_px, (v - camera.cy_px) * z / camera.fy_px, z];
        for (got, want) in [point.x, point.y, point.z].into_iter().zip(expected) {
            // 1e-6 of the depth: a few roundings of f32 (6e-8 each) at coordinates no larger than the depth.
            assert!(
                (f64::from(got) - want).abs() <= 1e-6 * z,
                "point {index}: {point:?}, expected {expected:?}"
            );
        }
        let rgb = &truth.rgb[3 * index..3 * index + 3];
        assert_eq!([point.r, point.g, point.b], rgb, "point {index}");
        assert_eq!(point.label, truth.labels[index], "point {index}");
    }
}
