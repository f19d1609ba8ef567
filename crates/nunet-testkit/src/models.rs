//! Networks whose outputs can be computed by hand exactly: every weight is a power of two.
//!
//! | network | answer for a pixel (r, g, b) |
//! |---|---|
//! | [`unet`] | depth = 0.5 + (r + 2g + 3b) / 64 |
//! | [`wnet`], plain | labels = the brightest channel; depth as [`unet`]'s |
//! | [`wnet`], connected | labels as above; depth = [`unet`]'s + r / 32 |
//! | [`refine_stage`] | depth = 2 x coarse (+ g / 32 where connected) |
//! | [`trail_stage`] | trail_out = trail_in / 2 + r / 32, state, the next frame's trail_in |
//! | [`remembering`] | depth = [`unet`]'s + trail_in, with the state of [`trail_stage`] |
//! | [`with_confidence`] | confidence = r |

use nunet_types::ImageSize;

use crate::onnx::{ModelBuilder, OnnxElement};

/// Weights of the depth head for the channels r, g, b of the image or of the logits.
const DEPTH_WEIGHTS: [f32; 3] = [1.0 / 64.0, 2.0 / 64.0, 3.0 / 64.0];
const DEPTH_BIAS: f32 = 0.5;
/// What the image adds if the second component takes it as well.
const CONNECTED_WEIGHT: f32 = 1.0 / 32.0;

/// The depth that [`unet`] and the plain [`wnet`] give for a pixel.
#[must_use]
pub fn plain_depth([r, g, b]: [u8; 3]) -> f32 {
    DEPTH_BIAS + (f32::from(r) + 2.0 * f32::from(g) + 3.0 * f32::from(b)) / 64.0
}

/// The depth that the connected [`wnet`] gives for a pixel.
#[must_use]
pub fn connected_depth(pixel: [u8; 3]) -> f32 {
    plain_depth(pixel) + f32::from(pixel[0]) * CONNECTED_WEIGHT
}

/// The label that every segmentation here gives for a pixel: its brightest channel, the first of equals.
#[must_use]
pub fn label([r, g, b]: [u8; 3]) -> u8 {
    match () {
        () if r >= g && r >= b => 0,
        () if g >= b => 1,
        () => 2,
    }
}

/// One component, from `rgb` to `depth`, metric, described as the contract wants it.
#[must_use]
pub fn unet(size: impl Into<ImageSize>) -> ModelBuilder {
    let size = size.into();
    describe(undescribed_unet(size), "unet", false)
}

/// [`unet`] without any metadata: a file without a description.
#[must_use]
pub fn undescribed_unet(size: impl Into<ImageSize>) -> ModelBuilder {
    let size = size.into();
    depth_head(image_planes(size), "planes", size)
}

/// Two components in one file: `rgb` to `depth` and `labels`.
#[must_use]
pub fn wnet(size: impl Into<ImageSize>, connected: bool) -> ModelBuilder {
    let size = size.into();
    let model = segmentation_labels(image_planes(size), "planes", size);
    let model = if connected {
        connected_depth_head(model, "planes", "planes", size)
    } else {
        depth_head(model, "planes", size)
    };
    describe(model, if connected { "wnet_c" } else { "wnet" }, true)
}

/// The first stage of a W-Net: `rgb` to `logits` `[1, 3, H, W]` and `labels`.
#[must_use]
pub fn segmentation_stage(size: impl Into<ImageSize>) -> ModelBuilder {
    let size = size.into();
    let model = image_planes(size).node("Identity", &["planes"], &["logits"], &[]).output(
        "logits",
        OnnxElement::F32,
        &planes(3, size),
    );
    segmentation_labels(model, "logits", size)
}

/// The second stage of a W-Net: `features` `[1, 3, H, W]`, and `rgb` where connected, to `depth`. It carries
/// the metadata of the whole graph.
#[must_use]
pub fn depth_stage(size: impl Into<ImageSize>, connected: bool) -> ModelBuilder {
    let size = size.into();
    let features = |model: ModelBuilder| model.input("features", OnnxElement::F32, &planes(3, size));
    let model = if connected {
        connected_depth_head(features(image_planes(size)), "planes", "features", size)
    } else {
        depth_head(features(ModelBuilder::new()), "features", size)
    };
    describe(model, if connected { "wnet_c" } else { "wnet" }, true)
}

/// A third stage: `coarse` `[1, 1, H, W]`, and `rgb` where connected, to `depth`.
#[must_use]
pub fn refine_stage(size: impl Into<ImageSize>, connected: bool) -> ModelBuilder {
    let size = size.into();
    let model = if connected { image_planes(size) } else { ModelBuilder::new() };
    let model = model.input("coarse", OnnxElement::F32, &planes(1, size)).node(
        "Add",
        &["coarse", "coarse"],
        &[if connected { "doubled" } else { "depth" }],
        &[],
    );
    let model = if connected {
        model
            .constant_f32("green", &[1, 3, 1, 1], &[0.0, CONNECTED_WEIGHT, 0.0])
            .node("Conv", &["planes", "green"], &["from_image"], &[])
            .node("Add", &["doubled", "from_image"], &["depth"], &[])
    } else {
        model
    };
    describe(model.output("depth", OnnxElement::F32, &planes(1, size)), "nunet3_c", true)
}

/// The `nunet.state` of [`trail_stage`] and [`remembering`]: `trail` `[1, 1, H, W]`, and `count` `[1]`, the
/// frames since it began.
#[must_use]
pub fn trail_state(size: impl Into<ImageSize>) -> String {
    let ImageSize { width, height } = size.into();
    format!(
        r#"[{{"input": "trail_in", "output": "trail_out", "shape": [1, 1, {height}, {width}]}},
            {{"input": "count_in", "output": "count_out", "shape": [1]}}]"#
    )
}

/// The trail that follows `trail` after a pixel.
#[must_use]
pub fn next_trail(trail: f32, [r, _, _]: [u8; 3]) -> f32 {
    trail / 2.0 + f32::from(r) * CONNECTED_WEIGHT
}

/// One recurrent component, `rgb` to `depth`.
#[must_use]
pub fn remembering(size: impl Into<ImageSize>) -> ModelBuilder {
    let size = size.into();
    let model = trail(image_planes(size), size)
        .constant_f32("weights", &[1, 3, 1, 1], &DEPTH_WEIGHTS)
        .constant_f32("bias", &[1], &[DEPTH_BIAS])
        .node("Conv", &["planes", "weights", "bias"], &["plain"], &[])
        .node("Add", &["plain", "trail_in"], &["depth"], &[])
        .output("depth", OnnxElement::F32, &planes(1, size));
    describe(model, "unet_lstm", false)
}

/// A recurrent first stage, `rgb` to its state. It has no metadata except `nunet.state`.
#[must_use]
pub fn trail_stage(size: impl Into<ImageSize>) -> ModelBuilder {
    let size = size.into();
    trail(image_planes(size), size)
}

/// Adds an output that cannot be computed, so that the run fails, where the first number of `value` is 4 or
/// more.
#[must_use]
pub fn fragile(model: ModelBuilder, value: &str) -> ModelBuilder {
    model
        .constant_i64("in_a_row", &[1], &[-1])
        .constant_i64("from_first", &[1], &[0])
        .constant_i64("to_second", &[1], &[1])
        .constant_f32("four", &[4], &[1.0; 4])
        .node("Reshape", &[value, "in_a_row"], &["row"], &[])
        .node("Slice", &["row", "from_first", "to_second"], &["first"], &[])
        .node("Cast", &["first"], &["index"], &[("to", (OnnxElement::I64 as i64).into())])
        .node("Gather", &["four", "index"], &["probe"], &[])
        .output("probe", OnnxElement::F32, &[1])
}

/// Adds the output `confidence`, which is the red channel, to a network of this size that takes the image.
#[must_use]
pub fn with_confidence(model: ModelBuilder, size: impl Into<ImageSize>) -> ModelBuilder {
    let ImageSize { width, height } = size.into();
    let shape = [1, i64::from(height), i64::from(width)];
    model
        .constant_f32("red_alone", &[1, 3, 1, 1], &[1.0, 0.0, 0.0])
        .constant_i64("of_pixels", &[3], &shape)
        .node("Conv", &["planes", "red_alone"], &["red_plane"], &[])
        .node("Reshape", &["red_plane", "of_pixels"], &["red_values"], &[])
        .node("Cast", &["red_values"], &["confidence"], &[("to", (OnnxElement::U8 as i64).into())])
        .output("confidence", OnnxElement::U8, &shape)
}

/// Adds the metadata that the contract asks for: metric, untrained, 3 classes where it segments.
#[must_use]
pub fn describe(model: ModelBuilder, architecture: &str, segments: bool) -> ModelBuilder {
    let model = model
        .metadata("nunet.version", "1")
        .metadata("nunet.architecture", architecture)
        .metadata("nunet.depth.encoding", "metric")
        .metadata("nunet.depth.min_m", "0.1")
        .metadata("nunet.depth.max_m", "100")
        .metadata("nunet.camera", r#"{"width": 640, "height": 480, "fx": 525.0, "fy": 525.0}"#)
        .metadata("nunet.trained", "false")
        .metadata("nunet.license", "MIT OR Apache-2.0");
    if segments { model.metadata("nunet.classes", r#"["red", "green", "blue"]"#) } else { model }
}

/// `rgb` as float planes `[1, 3, H, W]`, named `planes`, in 0..255.
fn image_planes(ImageSize { width, height }: ImageSize) -> ModelBuilder {
    ModelBuilder::new()
        .input("rgb", OnnxElement::U8, &[1, i64::from(height), i64::from(width), 3])
        .node("Cast", &["rgb"], &["float"], &[("to", (OnnxElement::F32 as i64).into())])
        .node("Transpose", &["float"], &["planes"], &[("perm", [0, 3, 1, 2].into())])
}

fn segmentation_labels(
    model: ModelBuilder,
    logits: &str,
    ImageSize { width, height }: ImageSize,
) -> ModelBuilder {
    model
        .node("ArgMax", &[logits], &["class"], &[("axis", 1.into()), ("keepdims", 0.into())])
        .node("Cast", &["class"], &["labels"], &[("to", (OnnxElement::U8 as i64).into())])
        .output("labels", OnnxElement::U8, &[1, i64::from(height), i64::from(width)])
}

fn trail(model: ModelBuilder, size: ImageSize) -> ModelBuilder {
    model
        .input("trail_in", OnnxElement::F32, &planes(1, size))
        .input("count_in", OnnxElement::F32, &[1])
        .constant_f32("red", &[1, 3, 1, 1], &[CONNECTED_WEIGHT, 0.0, 0.0])
        .constant_f32("half", &[1], &[0.5])
        .constant_f32("one", &[1], &[1.0])
        .node("Conv", &["planes", "red"], &["new"], &[])
        .node("Mul", &["trail_in", "half"], &["faded"], &[])
        .node("Add", &["faded", "new"], &["trail_out"], &[])
        .node("Add", &["count_in", "one"], &["count_out"], &[])
        .output("trail_out", OnnxElement::F32, &planes(1, size))
        .output("count_out", OnnxElement::F32, &[1])
        .metadata("nunet.state", &trail_state(size))
}

fn depth_head(model: ModelBuilder, features: &str, size: ImageSize) -> ModelBuilder {
    model
        .constant_f32("weights", &[1, 3, 1, 1], &DEPTH_WEIGHTS)
        .constant_f32("bias", &[1], &[DEPTH_BIAS])
        .node("Conv", &[features, "weights", "bias"], &["depth"], &[])
        .output("depth", OnnxElement::F32, &planes(1, size))
}

fn connected_depth_head(model: ModelBuilder, image: &str, features: &str, size: ImageSize) -> ModelBuilder {
    let [r, g, b] = DEPTH_WEIGHTS;
    model
        .constant_f32("weights", &[1, 6, 1, 1], &[CONNECTED_WEIGHT, 0.0, 0.0, r, g, b])
        .constant_f32("bias", &[1], &[DEPTH_BIAS])
        .node("Concat", &[image, features], &["both"], &[("axis", 1.into())])
        .node("Conv", &["both", "weights", "bias"], &["depth"], &[])
        .output("depth", OnnxElement::F32, &planes(1, size))
}

fn planes(channels: i64, ImageSize { width, height }: ImageSize) -> [i64; 4] {
    [1, channels, i64::from(height), i64::from(width)]
}
