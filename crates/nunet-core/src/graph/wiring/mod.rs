//! Checks that the stages of a graph fit together, before anything runs: [`Unwired`] -> [`Wired`].
//!
//! Pure: signatures in, a plan or an error out. A plan is correct by construction; nothing checks it again.
//!
//! Approach: stages are wired in the order of the manifest, so every input of a stage can only come from the
//! image, an earlier stage's tensor, the stage's own state, or a value that the sidecar feeds. Each input is
//! looked up in exactly these places and compared in type and shape. The results of the graph are compared
//! with the contract at the end.

mod error;
mod extras;
mod image;
mod results;
mod state;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::ops::Range;

use nunet_types::ImageSize;

use crate::graph::manifest::{Manifest, ManifestStage};
use crate::graph::signature::{ElementType, Signature, TensorSpec};
use crate::model::{ExtraInput, StateTensor};

pub use error::WiringError;
pub(in crate::graph) use extras::wired_extra;

/// The most bytes of one tensor: more than any network for images needs, and small enough to allocate.
const MAX_TENSOR_BYTES: usize = 1 << 30;
/// The name of the image in a manifest.
const IMAGE: &str = "image";

/// Stages that have not been checked.
pub(crate) struct Unwired<'a> {
    /// The manifest as written.
    pub(crate) manifest: &'a Manifest,
    /// Inputs and outputs of each stage's file, in the manifest's order.
    pub(crate) signatures: Vec<Signature>,
    /// The state tensors of each stage's file, in the same order.
    pub(crate) states: Vec<Vec<StateTensor>>,
    /// The values of the sidecar for inputs other than the image.
    pub(crate) extra_inputs: &'a BTreeMap<String, ExtraInput>,
    /// What the whole graph must take and return.
    pub(crate) contract: Contract,
}

/// What the whole graph must take and return.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Contract {
    /// Camera bytes to depth, as `docs/book/model-file.md` specifies.
    Nunet,
    /// A foreign network as its sidecar describes it.
    Foreign {
        /// The element type of its image, `float32` or `uint8`.
        element: ElementType,
        /// Batch, channels, height and width in the sidecar's layout.
        image: [i64; 4],
        /// Width and height, pixels.
        size: ImageSize,
    },
}

/// The plan of a graph whose stages fit.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Wired {
    /// The stages in the order in which they run.
    pub(crate) stages: Vec<WiredStage>,
    /// The outputs of all stages, in order; the name is `stage.tensor`.
    pub(crate) tensors: Vec<TensorSpec>,
    /// The image.
    pub(crate) image: TensorSpec,
    /// Width and height of image, depth and labels, pixels.
    pub(crate) size: ImageSize,
    /// The index of the depth map in `tensors`.
    pub(crate) depth: usize,
    /// Width and height of that tensor, pixels; another size than `size` is resized to it.
    pub(crate) depth_size: ImageSize,
    /// The index of the labels in `tensors`.
    pub(crate) labels: Option<usize>,
    /// The index of the confidence in `tensors`.
    pub(crate) confidence: Option<usize>,
    /// The state of all stages, in their order.
    pub(crate) states: Vec<WiredState>,
    /// The inputs that the sidecar feeds.
    pub(crate) extras: Vec<WiredExtra>,
}

/// A state tensor that a stage keeps for its next run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct WiredState {
    /// The index in [`Wired::tensors`] of the output that writes it.
    pub(crate) output: usize,
    /// The stage runs each n-th frame.
    pub(crate) every: u32,
}

/// An input that the sidecar feeds.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct WiredExtra {
    /// Name, type, and shape without open dimensions.
    pub(crate) spec: TensorSpec,
    /// Its value.
    pub(crate) value: ExtraInput,
}

/// One stage of the plan.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct WiredStage {
    pub(crate) name: String,
    /// It runs each n-th frame; never 0.
    pub(crate) every: u32,
    /// Where each input of the file comes from, in the file's order.
    pub(crate) inputs: Vec<InputSource>,
    /// Its outputs in [`Wired::tensors`], in the file's order.
    pub(crate) outputs: Range<usize>,
    /// Its state tensors.
    pub(crate) state: Vec<StateTensor>,
}

/// The source of an input.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum InputSource {
    /// The image.
    Image,
    /// A tensor of an earlier stage.
    Tensor(usize),
    /// The state of the stage after its last run: an index into [`Wired::states`].
    State(usize),
    /// A value that the sidecar feeds: an index into [`Wired::extras`].
    Extra(usize),
}

/// Whether a stage that runs each `every`-th frame runs in frame number `run`.
pub(crate) fn is_due(every: u32, run: u64) -> bool {
    run.is_multiple_of(u64::from(every))
}

impl Unwired<'_> {
    /// Checks that every input of every stage has a matching source, and that the results follow the
    /// contract.
    ///
    /// # Errors
    /// The first mismatch, with both sides.
    pub(crate) fn wire(self) -> Result<Wired, WiringError> {
        self.check_stages()?;
        let image = self.image()?;
        let mut plan = Wired {
            stages: Vec::new(),
            tensors: Vec::new(),
            size: self.size(&image)?,
            image,
            depth: 0,
            depth_size: ImageSize::new(0, 0),
            labels: None,
            confidence: None,
            states: Vec::new(),
            extras: self.extras()?,
        };
        for index in 0..self.manifest.stages.len() {
            self.wire_stage(index, &mut plan)?;
        }
        self.wire_results(&mut plan)?;
        check_depth_each_frame(&plan)?;
        state::check_depth_is_not_state(&plan)?;
        self.check_all_used(&plan)?;
        Ok(plan)
    }

    /// Adds a stage to the plan that has those before it.
    fn wire_stage(&self, index: usize, plan: &mut Wired) -> Result<(), WiringError> {
        let (stage, signature, state) =
            (&self.manifest.stages[index], &self.signatures[index], &self.states[index]);
        let inputs = signature.inputs.iter().map(|input| self.wire_input(stage, input, state, plan));
        let inputs = inputs.collect::<Result<_, _>>()?;
        let first = plan.tensors.len();
        plan.tensors.extend(self.outputs_to_fetch(stage, signature));
        let outputs = first..plan.tensors.len();
        for tensor in state {
            let reference = format!("{}.{}", stage.name, tensor.output);
            let output = self.find(&format!("the state of stage `{}`", stage.name), &reference, plan)?;
            plan.states.push(WiredState { output, every: stage.every });
        }
        let (name, every, state) = (stage.name.clone(), stage.every, state.clone());
        plan.stages.push(WiredStage { name, every, inputs, outputs, state });
        Ok(())
    }

    /// A stage whose outputs are not used would cost its time in every frame.
    fn check_all_used(&self, plan: &Wired) -> Result<(), WiringError> {
        let is_read = |index: &usize| {
            let source = InputSource::Tensor(*index);
            plan.stages.iter().any(|stage| stage.inputs.contains(&source))
                || *index == plan.depth
                || [plan.labels, plan.confidence].contains(&Some(*index))
        };
        match plan.stages.iter().find(|stage| !stage.outputs.clone().any(|index| is_read(&index))) {
            Some(stage) => Err(WiringError::UnusedStage { stage: stage.name.clone().into() }),
            None => Ok(()),
        }
    }

    /// Checks each stage by itself.
    fn check_stages(&self) -> Result<(), WiringError> {
        let stages = &self.manifest.stages;
        for (index, (stage, signature)) in stages.iter().zip(&self.signatures).enumerate() {
            if stage.every == 0 {
                return Err(WiringError::EveryZero { stage: stage.name.clone().into() });
            }
            if stages[..index].iter().any(|earlier| earlier.name == stage.name) {
                return Err(WiringError::DuplicateStage { stage: stage.name.clone().into() });
            }
            if let Some(unknown) = stage.inputs.keys().find(|name| named(&signature.inputs, name).is_none()) {
                return Err(WiringError::UnknownInput {
                    stage: stage.name.clone().into(),
                    tensor: unknown.clone().into(),
                    inputs: list(&signature.inputs).into(),
                });
            }
            state::check_state(stage, signature, &self.states[index])?;
        }
        Ok(())
    }

    fn wire_input(
        &self,
        stage: &ManifestStage,
        input: &TensorSpec,
        state: &[StateTensor],
        plan: &Wired,
    ) -> Result<InputSource, WiringError> {
        if let Some(place) = state.iter().position(|tensor| tensor.input == input.name) {
            return Ok(InputSource::State(plan.states.len() + place));
        }
        if let Some(place) = plan.extras.iter().position(|extra| extra.spec.name == input.name) {
            return Ok(InputSource::Extra(place));
        }
        let Some(source) = stage.inputs.get(&input.name) else {
            return Err(WiringError::Unbound {
                stage: stage.name.clone().into(),
                tensor: input.name.clone().into(),
                kind: input.kind().into(),
                in_sidecar: matches!(self.contract, Contract::Foreign { .. }),
            });
        };
        if source == IMAGE {
            return Ok(InputSource::Image);
        }
        let index = self.find(&format!("stage `{}`", stage.name), source, plan)?;
        let given = &plan.tensors[index];
        if given.element == input.element && agree(&input.shape, &given.shape) {
            return Ok(InputSource::Tensor(index));
        }
        let (from, tensor) = split(source);
        Err(WiringError::Mismatch {
            stage: stage.name.clone().into(),
            input: input.name.clone().into(),
            expected: input.kind().into(),
            from: from.to_owned().into(),
            tensor: tensor.to_owned().into(),
            given: given.kind().into(),
        })
    }

    /// The index of the tensor that `reference` names, among the outputs of earlier stages.
    fn find(&self, user: &str, reference: &str, plan: &Wired) -> Result<usize, WiringError> {
        if let Some(index) = plan.tensors.iter().position(|tensor| tensor.name == reference) {
            return Ok(index);
        }
        let (stage, tensor) = split(reference);
        let Some(position) = self.manifest.stages.iter().position(|candidate| candidate.name == stage) else {
            let stages = self.manifest.stages.iter().map(|stage| stage.name.as_str());
            return Err(WiringError::UnknownStage {
                user: user.into(),
                reference: reference.to_owned().into(),
                stages: quoted(stages).into(),
            });
        };
        if position >= plan.stages.len() {
            return Err(WiringError::NotEarlier { user: user.into(), stage: stage.into() });
        }
        let outputs = &self.signatures[position].outputs;
        match named(outputs, tensor) {
            Some(open) => Err(WiringError::OpenOutput {
                stage: stage.into(),
                tensor: open.name.clone().into(),
                kind: open.kind().into(),
            }),
            None => Err(WiringError::UnknownTensor {
                user: user.into(),
                stage: stage.into(),
                tensor: tensor.to_owned().into(),
                outputs: list(outputs).into(),
            }),
        }
    }

    /// The outputs of a stage that have a known size and so can be allocated. Another output that something
    /// uses is refused by [`Self::find`].
    fn outputs_to_fetch<'s>(
        &'s self,
        stage: &'s ManifestStage,
        signature: &'s Signature,
    ) -> impl Iterator<Item = TensorSpec> + 's {
        signature.outputs.iter().filter_map(move |output| {
            let name = format!("{}.{}", stage.name, output.name);
            let spec = TensorSpec { name, element: output.element, shape: output.shape.clone() };
            spec.bytes().is_some_and(|bytes| (1..=MAX_TENSOR_BYTES).contains(&bytes)).then_some(spec)
        })
    }
}

/// Depth with a new capture time must be computed for it, and so must its confidence: their stages run for
/// each frame.
fn check_depth_each_frame(plan: &Wired) -> Result<(), WiringError> {
    for (role, index) in [("depth", Some(plan.depth)), ("confidence", plan.confidence)] {
        let is_of = |stage: &&WiredStage| index.is_some_and(|index| stage.outputs.contains(&index));
        if let Some(stage) = plan.stages.iter().find(is_of).filter(|stage| stage.every != 1) {
            let (stage, every) = (stage.name.clone().into(), stage.every);
            return Err(WiringError::DepthSkipped { role, stage, every });
        }
    }
    Ok(())
}

/// Whether `shape` equals `expected`, except for its open dimensions.
fn agree(shape: &[i64], expected: &[i64]) -> bool {
    shape.len() == expected.len() && shape.iter().zip(expected).all(|(&dim, &want)| dim < 0 || dim == want)
}

/// `stage.tensor` split at its first dot: names of tensors may have dots, names of stages have none.
fn split(reference: &str) -> (&str, &str) {
    reference.split_once('.').unwrap_or((reference, ""))
}

fn named<'a>(specs: &'a [TensorSpec], name: &str) -> Option<&'a TensorSpec> {
    specs.iter().find(|spec| spec.name == name)
}

fn list(specs: &[TensorSpec]) -> String {
    quoted(specs.iter().map(|spec| spec.name.as_str()))
}

fn quoted<'a>(names: impl Iterator<Item = &'a str>) -> String {
    names.map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ")
}
