//! The run: each stage in turn, each reading what the earlier ones left.

use std::collections::BTreeMap;
use std::path::Path;

use nunet_types::Quality;

use crate::clock::Clock;
use crate::graph::io::{GraphInput, GraphOptions, GraphOutputs, GraphReport, StageInfo, TensorView};
use crate::graph::load::{Loaded, load};
use crate::graph::onnx::{CallerTensor, Lent, LentTensors, OwnTensors, Session};
use crate::graph::state::State;
use crate::graph::wiring::{Source, Wired, WiredStage, is_due};
use crate::graph::{GraphError, Provider, Runtime};
use crate::model::ModelDescription;
use crate::preprocess::TensorFormat;

/// N components in series, proved to fit, ready to run.
pub struct SerialGraph {
    description: ModelDescription,
    stages: Vec<StageInfo>,
    provider: Provider,
    float_input: Option<TensorFormat>,
    plan: Wired,
    sessions: Vec<Session>,
    image: CallerTensor,
    depth: CallerTensor,
    labels: Option<CallerTensor>,
    own: OwnTensors,
    state: State,
    /// Runs since the last reset; `every` counts in it.
    runs: u64,
    /// Whether the labels of the last run went into the caller's memory.
    labels_left: bool,
}

impl SerialGraph {
    /// Loads a fused `.onnx` file, or a staged graph's `.toml` with the files that it names.
    ///
    /// # Errors
    /// Files that cannot be read or that ONNX Runtime does not take, stages that do not fit, and a description that
    /// is missing or wrong.
    pub fn load(path: &Path, runtime: &Runtime, options: &GraphOptions) -> Result<Self, GraphError> {
        let Loaded { plan, models, description, provider, float_input } = load(path, runtime, options)?;
        let mut stages = Vec::with_capacity(models.len());
        let mut sessions = Vec::with_capacity(models.len());
        for (stage, (file, model)) in plan.stages.iter().zip(models) {
            let info = StageInfo::new(stage, &plan, file, model.signature());
            let session = model
                .into_session(&info.inputs, &info.outputs)
                .map_err(|reason| GraphError::Run { stage: stage.name.clone(), reason })?;
            sessions.push(session);
            stages.push(info);
        }
        Self::around(plan, sessions, description, stages, provider, float_input)
    }

    /// Another graph that runs the same sessions: weights are in memory once, and everything else is its own. What one of
    /// them remembers, keeps or reuses of its frames, the other never sees. For several streams of frames.
    ///
    /// # Errors
    /// No memory for the tensors between the stages.
    pub fn sibling(&self) -> Result<Self, GraphError> {
        Self::around(
            self.plan.clone(),
            self.sessions.iter().map(Session::sibling).collect(),
            self.description.clone(),
            self.stages.clone(),
            self.provider,
            self.float_input,
        )
    }

    /// A graph before its first frame.
    fn around(
        plan: Wired,
        sessions: Vec<Session>,
        description: ModelDescription,
        stages: Vec<StageInfo>,
        provider: Provider,
        float_input: Option<TensorFormat>,
    ) -> Result<Self, GraphError> {
        let spec = |index: usize| plan.tensors[index].clone();
        Ok(Self {
            description,
            stages,
            provider,
            float_input,
            sessions,
            image: CallerTensor::new("image", plan.image.clone()),
            depth: CallerTensor::new("depth", spec(plan.depth)),
            labels: plan.labels.map(|index| CallerTensor::new("labels", spec(index))),
            own: OwnTensors::new(&State::with_buffers(&plan))?,
            state: State::new(&plan),
            plan,
            runs: 0,
            labels_left: false,
        })
    }

    /// What the model file says of itself.
    #[must_use]
    pub fn description(&self) -> &ModelDescription {
        &self.description
    }

    /// The stages in the order in which they run.
    #[must_use]
    pub fn stages(&self) -> &[StageInfo] {
        &self.stages
    }

    /// Width and height of the picture, the depth map and the labels, in pixels.
    #[must_use]
    pub fn size(&self) -> (u32, u32) {
        self.plan.size
    }

    /// Whether the graph gives labels.
    #[must_use]
    pub fn has_labels(&self) -> bool {
        self.plan.labels.is_some()
    }

    /// The provider that does the arithmetic; never [`Provider::Auto`].
    #[must_use]
    pub fn provider(&self) -> Provider {
        self.provider
    }

    /// How many nodes of all stages each provider computes, by ONNX Runtime's names, such as `CPUExecutionProvider`.
    /// What a provider cannot compute goes to the processor, silently. Nodes are counted as providers took them, before
    /// they fuse them.
    ///
    /// # Errors
    /// ONNX Runtime's words.
    pub fn placement(&self) -> Result<BTreeMap<String, usize>, GraphError> {
        let mut placement = BTreeMap::new();
        for (stage, session) in self.stages.iter().zip(&self.sessions) {
            let part = session
                .placement()
                .map_err(|reason| GraphError::Run { stage: stage.name.clone(), reason })?;
            for (provider, nodes) in part {
                *placement.entry(provider).or_default() += nodes;
            }
        }
        Ok(placement)
    }

    /// How a foreign network wants its picture ([`GraphInput::Float`]); `None` where it takes camera bytes
    /// ([`GraphInput::Rgb`]).
    #[must_use]
    pub fn float_input(&self) -> Option<&TensorFormat> {
        self.float_input.as_ref()
    }

    /// Runs all stages that are due on one picture; their results are in `outputs` when it returns.
    ///
    /// The picture is read where it lies and the results are written where they shall be: nothing is copied, and
    /// nothing allocated on the Rust side once each buffer's address has been seen. Labels of a stage that does not
    /// run for each frame are the exception: they are kept inside, and copied out.
    ///
    /// # Errors
    /// Buffers of another length or type than the graph's, and what ONNX Runtime reports. After an error every stage
    /// is due again, and stages with a memory remember what they did before the run: as if the picture had not come.
    pub fn run(
        &mut self,
        image: GraphInput<'_>,
        outputs: GraphOutputs<'_>,
        clock: &dyn Clock,
    ) -> Result<GraphReport, GraphError> {
        let run = self.runs;
        self.runs = 0;
        let report = self.run_due_stages(run, image, outputs, clock)?;
        self.state.keep(run);
        self.runs = run + 1;
        Ok(report)
    }

    fn run_due_stages(
        &mut self,
        run: u64,
        image: GraphInput<'_>,
        outputs: GraphOutputs<'_>,
        clock: &dyn Clock,
    ) -> Result<GraphReport, GraphError> {
        let GraphOutputs { depth, labels } = outputs;
        let (labels, kept_labels) = if self.keeps_labels() { (None, labels) } else { (labels, None) };
        self.labels_left = labels.is_some();
        let homes = Homes {
            plan: &self.plan,
            image: match image {
                GraphInput::Rgb(bytes) => self.image.lend(bytes)?,
                GraphInput::Float(values) => self.image.lend(values)?,
            },
            depth: self.depth.lend_mut(depth)?,
            labels: match (labels, &mut self.labels) {
                (Some(memory), Some(tensor)) => Some(tensor.lend_mut(memory)?),
                (Some(_), None) => return Err(GraphError::NoLabels),
                (None, _) => None,
            },
            own: self.own.lend(),
            state: &self.state,
            run,
        };
        let mut report = GraphReport::default();
        for (stage, session) in self.plan.stages.iter().zip(&mut self.sessions) {
            let start = clock.nanos();
            if is_due(stage.every, run) {
                homes.run(stage, session)?;
            } else {
                report.quality = Quality::ReusedLabels;
            }
            report.stages.push(start, clock.nanos());
        }
        if let (Some(memory), Some(index)) = (kept_labels, self.plan.labels) {
            report.bytes_copied = copy_out(self.own.bytes(index), memory)?;
        }
        Ok(report)
    }

    /// Whether the labels have to outlive a run, because their stage will be skipped.
    fn keeps_labels(&self) -> bool {
        let gives = |index| move |stage: &&WiredStage| stage.outputs.contains(&index);
        self.plan
            .labels
            .is_some_and(|index| self.plan.stages.iter().find(gives(index)).is_some_and(|s| s.every > 1))
    }

    /// Whether a run depends on its picture alone: no stage remembers anything, and none is left out now and then.
    #[must_use]
    pub fn is_memoryless(&self) -> bool {
        self.state.is_empty() && self.plan.stages.iter().all(|stage| stage.every <= 1)
    }

    /// Forgets earlier frames: the next run runs every stage, and those with a memory begin with zeros.
    pub fn reset(&mut self) {
        self.runs = 0;
        self.state.forget(&mut self.own);
    }

    /// The labels of the last run, `[H, W]`, where they stayed inside: nobody asked for them, or their stage does not
    /// run for each frame.
    #[must_use]
    pub fn labels(&self) -> Option<&[u8]> {
        let index = self.plan.labels.filter(|_| self.runs > 0 && !self.labels_left)?;
        Some(self.own.bytes(index))
    }

    /// A tensor of the last run by `stage.tensor`, inner ones too; the one stage of a fused file is `network`.
    ///
    /// `None` for a name that no stage gives, before the first run, and for a result that went into the caller's
    /// memory.
    #[must_use]
    pub fn tensor(&self, name: &str) -> Option<TensorView<'_>> {
        let index = self.plan.tensors.iter().position(|spec| spec.name == name)?;
        let left = index == self.plan.depth || (self.labels_left && Some(index) == self.plan.labels);
        if left || self.runs == 0 {
            return None;
        }
        Some(TensorView {
            spec: &self.plan.tensors[index],
            bytes: self.own.bytes(self.state.place_after_run(index)),
        })
    }
}

/// Where each tensor of one run lies.
struct Homes<'run> {
    plan: &'run Wired,
    image: Lent<'run>,
    depth: Lent<'run>,
    labels: Option<Lent<'run>>,
    own: LentTensors<'run>,
    state: &'run State,
    run: u64,
}

impl Homes<'_> {
    fn run(&self, stage: &WiredStage, session: &mut Session) -> Result<(), GraphError> {
        let inputs = stage.inputs.iter().map(|&source| match source {
            Source::Image => self.image,
            Source::Tensor(index) => self.of(index),
            Source::State(index) => self.own.get(self.state.kept(index)),
        });
        session
            .run(inputs, stage.outputs.clone().map(|index| self.of(index)))
            .map_err(|reason| GraphError::Run { stage: stage.name.clone(), reason })
    }

    fn of(&self, index: usize) -> Lent<'_> {
        match self.labels {
            Some(labels) if Some(index) == self.plan.labels => labels,
            _ if index == self.plan.depth => self.depth,
            _ => self.own.get(self.state.place_in_run(index, self.run)),
        }
    }
}

fn copy_out(kept: &[u8], memory: &mut [u8]) -> Result<u64, GraphError> {
    if kept.len() != memory.len() {
        return Err(GraphError::Buffer { tensor: "labels", got: memory.len(), expected: kept.len() });
    }
    memory.copy_from_slice(kept);
    Ok(kept.len() as u64)
}
