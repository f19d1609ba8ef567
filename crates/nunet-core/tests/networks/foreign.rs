//! Foreign networks by sidecar: layouts, channel orders, normalization, open dimensions.

use nunet_core::depth::DepthError;
use nunet_core::frame::{ImageView, PixelFormat};
use nunet_core::graph::{GraphError, WiringError};
use nunet_core::model::{ModelError, SidecarError};
use nunet_core::pipeline::{Outputs, Pipeline, PipelineOptions};
use nunet_testkit::models;
use nunet_testkit::onnx::{ModelBuilder, OnnxElement};

use crate::{Folder, SIZE, error_of, image, pixels, ticking, wiring_error};

const F32: OnnxElement = OnnxElement::F32;

/// `y` = 4 times the first channel + twice the second + the third, of a tensor `x` of 3 planes.
fn weighted_planes(input: &[i64], output: &[i64]) -> ModelBuilder {
    ModelBuilder::new()
        .input("x", F32, input)
        .constant_f32("weights", &[1, 3, 1, 1], &[4.0, 2.0, 1.0])
        .node("Conv", &["x", "weights"], &["y"], &[])
        .output("y", F32, output)
}

/// The same for a tensor `x` of 3 values a pixel.
fn weighted_values() -> ModelBuilder {
    ModelBuilder::new()
        .input("x", F32, &[1, 3, 6, 3])
        .constant_f32("weights", &[3, 1], &[4.0, 2.0, 1.0])
        .node("MatMul", &["x", "weights"], &["y"], &[])
        .output("y", F32, &[1, 3, 6, 1])
}

fn depth_of(folder: &Folder) -> (Vec<f32>, u64) {
    let mut pipeline = Pipeline::new(folder.load("m.onnx").unwrap(), PipelineOptions::default()).unwrap();
    let rgb = image(SIZE);
    let mut depth_m = vec![0.0; rgb.len() / 3];
    let frame = ImageView::packed(&rgb, SIZE.width, SIZE.height, PixelFormat::Rgb8).unwrap();
    let outputs = Outputs { depth_m: &mut depth_m, labels: None, confidence: None, cloud: None };
    let report = pipeline.process(&frame, outputs, &ticking()).unwrap();
    (depth_m, report.bytes_copied)
}

fn sidecar(input: &str) -> String {
    format!(
        "[input]\ntensor = \"x\"\nsize = [3, 6]\n{input}\n[output]\ndepth = \"y\"\nencoding = \"relative\"\n"
    )
}

#[test]
fn planes_and_values_in_either_channel_order_are_fed_as_the_sidecar_says() {
    let planes = || weighted_planes(&[1, 3, 3, 6], &[1, 1, 3, 6]);
    for (model, layout, color) in [
        (planes(), "nchw", "rgb"),
        (planes(), "nchw", "bgr"),
        (weighted_values(), "nhwc", "rgb"),
        (weighted_values(), "nhwc", "bgr"),
    ] {
        let text = sidecar(&format!("layout = \"{layout}\"\ncolor = \"{color}\""));
        let folder = Folder::new().model("m.onnx", &model).text("m.toml", &text);
        let expected: Vec<f32> = pixels(&image(SIZE))
            .map(|pixel| pixel.map(f32::from))
            .map(|[r, g, b]| if color == "rgb" { 4.0 * r + 2.0 * g + b } else { 4.0 * b + 2.0 * g + r })
            .collect();
        let (depth, bytes_copied) = depth_of(&folder);
        assert_eq!(depth, expected, "{layout} {color}");
        assert_eq!(bytes_copied, 4 * 3 * 18, "filling the tensor is counted");
    }
}

#[test]
fn scale_mean_and_std_are_applied_in_that_order() {
    let text = sidecar("layout = \"nchw\"\nscale = 0.5\nmean = [8, 4, 2]\nstd = [2, 4, 8]");
    let model = weighted_planes(&[1, 3, 3, 6], &[1, 1, 3, 6]);
    let folder = Folder::new().model("m.onnx", &model).text("m.toml", &text);
    let expected: Vec<f32> = pixels(&image(SIZE))
        .map(|pixel| pixel.map(|value| f32::from(value) * 0.5))
        .map(|[r, g, b]| 4.0 * (r - 8.0) / 2.0 + 2.0 * (g - 4.0) / 4.0 + (b - 2.0) / 8.0)
        .collect();
    assert_eq!(depth_of(&folder).0, expected);
}

#[test]
fn interleaved_bytes_are_bound_without_a_copy() {
    let model = models::undescribed_unet(SIZE);
    let text = "[input]\ntensor = \"rgb\"\nlayout = \"nhwc\"\ndtype = \"uint8\"\nsize = [3, 6]\n\
                [output]\ndepth = \"depth\"\nencoding = \"metric\"\n";
    let folder = Folder::new().model("m.onnx", &model).text("m.toml", text);
    let expected: Vec<f32> = pixels(&image(SIZE)).map(models::plain_depth).collect();
    assert_eq!(depth_of(&folder), (expected, 0));
}

#[test]
fn dimensions_that_the_file_leaves_open_are_the_sidecars() {
    let text = sidecar("layout = \"nchw\"");
    let model = weighted_planes(&[-1, 3, -1, -1], &[-1, 1, -1, -1]);
    let folder = Folder::new().model("m.onnx", &model).text("m.toml", &text);
    let first = image(SIZE)[..3].iter().zip([4.0, 2.0, 1.0]).map(|(&v, w)| f32::from(v) * w).sum::<f32>();
    assert_eq!(depth_of(&folder).0[0], first);
}

#[test]
fn sidecars_that_do_not_fit_are_refused() {
    let model = weighted_planes(&[1, 3, 3, 6], &[1, 1, 3, 6]);
    let good = sidecar("layout = \"nchw\"");
    let refused =
        |text: &str| error_of(Folder::new().model("m.onnx", &model).text("m.toml", text).load("m.onnx"));
    let no_input =
        WiringError::UnknownInput { stage: "network".into(), tensor: "input".into(), inputs: "`x`".into() };
    let no_output = WiringError::UnknownTensor {
        user: "output `depth`".into(),
        stage: "network".into(),
        tensor: "z".into(),
        outputs: "`y`".into(),
    };
    let other_image = |expected: &str| WiringError::Image {
        stage: "network".into(),
        tensor: "x".into(),
        kind: "float32 [1, 3, 3, 6]".into(),
        expected: expected.into(),
    };
    for (from, to, expected) in [
        ("\"x\"", "\"input\"", no_input),
        ("\"y\"", "\"z\"", no_output),
        ("[3, 6]", "[6, 12]", other_image("float32 [1, 3, 6, 12]")),
        ("nchw", "nhwc", other_image("float32 [1, 3, 6, 3]")),
    ] {
        assert_eq!(wiring_error(refused(&good.replace(from, to))), expected, "{to}");
    }
    let sidecar_error = |text: &str| match refused(text) {
        GraphError::Description { source: ModelError::Sidecar { sidecar, source }, .. } => {
            assert_eq!(sidecar, "m.toml");
            source
        }
        other => panic!("{other}"),
    };
    let feet = SidecarError::Depth(DepthError::UnknownEncoding { text: "feet".to_owned() });
    assert_eq!(sidecar_error(&good.replace("relative", "feet")), feet);
    assert!(matches!(sidecar_error("version = 1\n"), SidecarError::Syntax { .. }));
}

#[test]
fn a_file_with_metadata_ignores_the_sidecar_beside_it() {
    // `wnet_c.toml`, the staged graph, may well lie beside `wnet_c.onnx`, the fused one.
    let folder = Folder::new().model("m.onnx", &models::unet(SIZE)).text("m.toml", "version = 1\n");
    assert_eq!(folder.load("m.onnx").unwrap().description().architecture, "unet");
}
