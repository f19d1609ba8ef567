//! Proof that the stages of a graph fit together, before anything runs: [`Unwired`] -> [`Wired`].
//!
//! Pure: signatures in, a plan or an error out. What a plan says has been checked here once, and nobody checks it again.

mod error;
mod picture;
mod state;
#[cfg(test)]
mod tests;

use std::ops::Range;

use crate::graph::manifest::{Manifest, ManifestStage};
use crate::graph::signature::{ElementType, Signature, TensorSpec, kind};
use crate::model::StateTensor;

pub use error::WiringError;

/// The most bytes of one tensor: more than any network for pictures needs, and small enough to be had.
const MAX_TENSOR_BYTES: usize = 1 << 30;
/// How a manifest names the picture.
const IMAGE: &str = "image";

/// Stages that nobody has proved to fit.
pub(crate) struct Unwired<'a> {
    /// What the user wrote.
    pub(crate) manifest: &'a Manifest,
    /// What each stage's file takes and gives, in the manifest's order.
    pub(crate) signatures: Vec<Signature>,
    /// What each stage's file says that it remembers, in the same order.
    pub(crate) memories: Vec<Vec<StateTensor>>,
    /// What the whole graph must take and give.
    pub(crate) contract: Contract,
}

/// What the whole graph must take and give.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Contract {
    /// Camera bytes to depth, as `docs/book/model-file.md` says.
    Nunet,
    /// What a sidecar says of a foreign network: the element type and the shape of its picture, and its size.
    Foreign {
        /// `float32` or `uint8`.
        element: ElementType,
        /// Batch, channels, height and width in the sidecar's layout.
        image: [i64; 4],
        /// Width and height, pixels.
        size: (u32, u32),
    },
}

/// The plan of a graph that fits.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Wired {
    /// The stages in the order in which they run.
    pub(crate) stages: Vec<WiredStage>,
    /// All tensors that stages give, in the order in which they come to be; the name is `stage.tensor`.
    pub(crate) tensors: Vec<TensorSpec>,
    /// The picture.
    pub(crate) image: TensorSpec,
    /// Width and height of picture, depth and labels, pixels.
    pub(crate) size: (u32, u32),
    /// Which tensor is the depth map.
    pub(crate) depth: usize,
    /// Which tensor is the labels.
    pub(crate) labels: Option<usize>,
    /// What all stages remember, in their order.
    pub(crate) states: Vec<WiredState>,
}

/// A tensor that a stage keeps for its next run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct WiredState {
    /// Which tensor of the plan the stage gives.
    pub(crate) output: usize,
    /// The stage runs each n-th frame.
    pub(crate) every: u32,
}

/// One stage of the plan.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct WiredStage {
    pub(crate) name: String,
    /// It runs each n-th frame; never 0.
    pub(crate) every: u32,
    /// Where each input of the file comes from, in the file's order.
    pub(crate) inputs: Vec<Source>,
    /// Which tensors it gives, in the file's order.
    pub(crate) outputs: Range<usize>,
    /// What it remembers from one of its runs to the next.
    pub(crate) memory: Vec<StateTensor>,
}

/// Where an input comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Source {
    /// The picture.
    Image,
    /// A tensor of an earlier stage.
    Tensor(usize),
    /// What the stage itself left in its last run: an index into [`Wired::states`].
    State(usize),
}

/// Whether a stage that runs each `every`-th frame runs in frame number `run`.
pub(crate) fn is_due(every: u32, run: u64) -> bool {
    run.is_multiple_of(u64::from(every))
}

impl Unwired<'_> {
    /// Proves that every input of every stage is given what it wants, and that the graph gives what it must.
    ///
    /// # Errors
    /// The first thing that does not fit, with both sides.
    pub(crate) fn wire(self) -> Result<Wired, WiringError> {
        self.check_stages()?;
        let mut plan = Wired {
            stages: Vec::new(),
            tensors: Vec::new(),
            image: self.image()?,
            size: (0, 0),
            depth: 0,
            labels: None,
            states: Vec::new(),
        };
        plan.size = self.size(&plan.image)?;
        let stages = self.manifest.stages.iter().zip(&self.signatures).zip(&self.memories);
        for ((stage, signature), memory) in stages {
            let inputs = signature.inputs.iter().map(|input| self.wire_input(stage, input, memory, &plan));
            let inputs = inputs.collect::<Result<_, _>>()?;
            let first = plan.tensors.len();
            plan.tensors.extend(self.outputs_to_fetch(stage, signature));
            let outputs = first..plan.tensors.len();
            for tensor in memory {
                let reference = format!("{}.{}", stage.name, tensor.output);
                let output =
                    self.find(&format!("the memory of stage `{}`", stage.name), &reference, &plan)?;
                plan.states.push(WiredState { output, every: stage.every });
            }
            let (name, every, memory) = (stage.name.clone(), stage.every, memory.clone());
            plan.stages.push(WiredStage { name, every, inputs, outputs, memory });
        }
        let outputs = &self.manifest.outputs;
        plan.depth = self.result("depth", &outputs.depth, ElementType::Float32, &plan)?;
        if let Some(labels) = &outputs.labels {
            plan.labels = Some(self.result("labels", labels, ElementType::Uint8, &plan)?);
        }
        check_depth_each_frame(&plan)?;
        state::check_depth_leaves(&plan)?;
        Ok(plan)
    }

    /// What is wrong with a stage by itself, whatever it is connected to.
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
            state::check_memory(stage, signature, &self.memories[index])?;
        }
        Ok(())
    }

    fn wire_input(
        &self,
        stage: &ManifestStage,
        input: &TensorSpec,
        memory: &[StateTensor],
        plan: &Wired,
    ) -> Result<Source, WiringError> {
        if let Some(place) = memory.iter().position(|tensor| tensor.input == input.name) {
            return Ok(Source::State(plan.states.len() + place));
        }
        let Some(source) = stage.inputs.get(&input.name) else {
            return Err(WiringError::Unbound {
                stage: stage.name.clone().into(),
                tensor: input.name.clone().into(),
                kind: input.kind().into(),
            });
        };
        if source == IMAGE {
            return Ok(Source::Image);
        }
        let index = self.find(&format!("stage `{}`", stage.name), source, plan)?;
        let given = &plan.tensors[index];
        if given.element == input.element && agree(&input.shape, &given.shape) {
            return Ok(Source::Tensor(index));
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

    /// The index of the tensor that `reference` names, among those of earlier stages.
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

    /// What a stage gives that has a known size, and with it memory of ours to be written to. An output of open size
    /// that nobody uses is left alone; [`Self::find`] refuses it where somebody does.
    fn outputs_to_fetch<'s>(
        &'s self,
        stage: &'s ManifestStage,
        signature: &'s Signature,
    ) -> impl Iterator<Item = TensorSpec> + 's {
        signature.outputs.iter().filter_map(move |output| {
            let name = format!("{}.{}", stage.name, output.name);
            let shape = match self.contract {
                Contract::Foreign { size, .. } if name == self.manifest.outputs.depth => {
                    close(&output.shape, size)
                }
                _ => output.shape.clone(),
            };
            let spec = TensorSpec { name, element: output.element, shape };
            spec.bytes().is_some_and(|bytes| (1..=MAX_TENSOR_BYTES).contains(&bytes)).then_some(spec)
        })
    }

    /// A result of the whole graph: there, of the right type, of the picture's size.
    fn result(
        &self,
        role: &'static str,
        reference: &str,
        element: ElementType,
        plan: &Wired,
    ) -> Result<usize, WiringError> {
        let index = self.find(&format!("output `{role}`"), reference, plan)?;
        let given = &plan.tensors[index];
        let (width, height) = (i64::from(plan.size.0), i64::from(plan.size.1));
        let expected = if role == "depth" { vec![1, 1, height, width] } else { vec![1, height, width] };
        let shape_fits = match self.contract {
            Contract::Nunet => given.shape == expected,
            Contract::Foreign { .. } => {
                given.shape.iter().filter(|&&dim| dim != 1).eq(expected.iter().filter(|&&dim| dim != 1))
            }
        };
        if given.element == element && shape_fits {
            return Ok(index);
        }
        Err(WiringError::Result {
            role,
            reference: reference.to_owned().into(),
            given: given.kind().into(),
            expected: kind(element, &expected).into(),
            width: plan.size.0,
            height: plan.size.1,
        })
    }
}

/// A depth map under a new capture time is of that time: the stage that gives it runs for each frame.
fn check_depth_each_frame(plan: &Wired) -> Result<(), WiringError> {
    match plan.stages.iter().find(|stage| stage.outputs.contains(&plan.depth)) {
        Some(stage) if stage.every != 1 => {
            Err(WiringError::DepthSkipped { stage: stage.name.clone().into(), every: stage.every })
        }
        _ => Ok(()),
    }
}

/// Whether shapes are equal where neither is open.
fn agree(shape: &[i64], expected: &[i64]) -> bool {
    shape.len() == expected.len() && shape.iter().zip(expected).all(|(&dim, &want)| dim < 0 || dim == want)
}

/// A foreign depth map's shape with open dimensions filled in from the back: width, height, then ones.
fn close(shape: &[i64], (width, height): (u32, u32)) -> Vec<i64> {
    let mut expected = vec![1; shape.len().saturating_sub(2)];
    expected.extend([i64::from(height), i64::from(width)]);
    shape.iter().zip(expected).map(|(&dim, want)| if dim < 0 { want } else { dim }).collect()
}

/// `stage.tensor` at its first dot: stages have none in their names, tensors may.
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
