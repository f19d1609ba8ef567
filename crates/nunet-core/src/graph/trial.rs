//! A trial run of a foreign network whose file does not fix the size of its depth.

use std::path::Path;

use nunet_types::ImageSize;

use crate::camera::Intrinsics;
use crate::graph::onnx::{OnnxModel, OwnTensors};
use crate::graph::wiring::{WiredExtra, wired_extra};
use crate::graph::{GraphError, Signature, TensorSpec};
use crate::model::{ExtraInput, Sidecar};

/// The signature of a foreign network with the size of its depth, found by one run where the file leaves it
/// open.
///
/// Such networks round the image to their own step (vision transformers to multiples of 14), fail at other
/// sizes, or return depth of a fraction of the size. None of that is in the file. An image that is not
/// resized as a whole would give depth at the wrong place, so depth must be a whole fraction of the image, or
/// the image of the depth.
///
/// # Errors
/// A size at which the network does not run, or of which it cuts off a part.
pub(super) fn with_depth_size(
    path: &Path,
    model: &OnnxModel,
    sidecar: &Sidecar,
) -> Result<Signature, GraphError> {
    let mut signature = model.signature().clone();
    let is_open =
        |output: &&mut TensorSpec| output.name == sidecar.depth && output.shape.iter().any(|&dim| dim < 0);
    let Some(inputs) = inputs(model.signature(), sidecar) else { return Ok(signature) };
    let Some(depth) = signature.outputs.iter_mut().find(is_open) else { return Ok(signature) };
    let ImageSize { width, height } = sidecar.size;
    depth.shape = run(model, &inputs, depth, sidecar.size).map_err(|reason| GraphError::ImageSize {
        path: path.to_owned(),
        width,
        height,
        reason: reason.into(),
    })?;
    let mut sides = depth.shape.iter().filter(|&&dim| dim != 1).map(|&dim| u32::try_from(dim).unwrap_or(0));
    match (sides.next(), sides.next(), sides.next()) {
        (Some(depth_height), Some(depth_width), None)
            if !is_whole_ratio(height, depth_height) || !is_whole_ratio(width, depth_width) =>
        {
            Err(GraphError::DepthSize { path: path.to_owned(), width, height, depth_width, depth_height })
        }
        // Anything else that is not a depth map is refused by the wiring.
        _ => Ok(signature),
    }
}

/// Whether one of two sides is a multiple of the other.
fn is_whole_ratio(image: u32, depth: u32) -> bool {
    image > 0 && depth > 0 && (image.is_multiple_of(depth) || depth.is_multiple_of(image))
}

/// All inputs without open dimensions; `None` where one of them has no source, which the wiring refuses.
fn inputs(signature: &Signature, sidecar: &Sidecar) -> Option<Vec<WiredExtra>> {
    let closed = |input: &TensorSpec| {
        if input.name == sidecar.input {
            let spec = TensorSpec { shape: sidecar.image_shape().to_vec(), ..input.clone() };
            let fits = spec.shape.len() == input.shape.len()
                && spec.shape.iter().zip(&input.shape).all(|(want, &dim)| dim < 0 || dim == *want);
            let black = ExtraInput::Constant(vec![0.0]);
            return fits.then_some(WiredExtra { spec, value: black });
        }
        wired_extra(input, sidecar.extra_inputs.get(&input.name)?).ok()
    };
    signature.inputs.iter().map(closed).collect()
}

/// The shape of the depth for a black image.
fn run(
    model: &OnnxModel,
    inputs: &[WiredExtra],
    depth: &TensorSpec,
    ImageSize { width, height }: ImageSize,
) -> Result<Vec<i64>, String> {
    // As wide as far: 53 degrees.
    let (focal, middle) = (f64::from(width), |side: u32| (f64::from(side) - 1.0) / 2.0);
    let camera = Intrinsics::new(focal, focal, middle(width), middle(height), width, height);
    let specs: Vec<TensorSpec> = inputs.iter().map(|input| input.spec.clone()).collect();
    let mut tensors = OwnTensors::new(&specs).map_err(|error| error.to_string())?;
    let camera = camera.map_err(|error| error.to_string())?;
    for (index, input) in inputs.iter().enumerate() {
        let bytes = input.bytes(&camera).ok_or("an input cannot be filled")?;
        tensors.write(index, &bytes);
    }
    let mut session = model.session(&specs, std::slice::from_ref(depth))?;
    let lent = tensors.lend();
    let shapes = session.output_shapes((0..specs.len()).map(|index| lent.get(index)))?;
    shapes.into_iter().next().ok_or_else(|| "the run returned nothing".to_owned())
}
