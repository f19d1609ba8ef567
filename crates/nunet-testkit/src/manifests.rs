//! Manifests of staged graphs, for the networks in [`models`](crate::models).

/// Two stages with depth and labels: `segmentation.onnx`, a
/// [`segmentation_stage`](crate::models::segmentation_stage) that runs for each `every`-th frame, and
/// `depth.onnx`, a [`depth_stage`](crate::models::depth_stage).
#[must_use]
pub fn two_stages(connected: bool, every: u32) -> String {
    let image = if connected { "rgb = \"image\", " } else { "" };
    format!(
        r#"version = 1
[[stage]]
name = "segmentation"
model = "segmentation.onnx"
inputs = {{ rgb = "image" }}
every = {every}
[[stage]]
name = "depth"
model = "depth.onnx"
inputs = {{ {image}features = "segmentation.logits" }}
[outputs]
depth = "depth.depth"
labels = "segmentation.labels"
"#
    )
}
