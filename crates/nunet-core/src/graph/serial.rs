//! The run: each stage in turn, reading the tensors of earlier stages.

use std::collections::BTreeMap;
use std::path::Path;

use nunet_types::{ImageSize, Quality};

use crate::camera::Intrinsics;
use crate::clock::Clock;
use crate::graph::depth_resize::DepthResize;
use crate::graph::io::{GraphInput, GraphOptions, GraphOutputs, GraphReport, StageInfo, TensorView};
use crate::graph::load::{Loaded, load};
use crate::graph::onnx::{CallerTensor, OwnTensors, Session};
use crate::graph::run_tensors::{RunTensors, copy_out, lend_image, lend_map};
use crate::graph::state::GraphState;
use crate::graph::wiring::{Wired, WiredExtra, WiredStage, is_due};
use crate::graph::{GraphError, Provider, Runtime, TensorSpec};
use crate::model::ModelDescription;
use crate::preprocess::TensorFormat;

/// N components in series, ready to run.
pub struct SerialGraph {
    description: ModelDescription,
    stages: Vec<StageInfo>,
    provider: Provider,
    float_input: Option<TensorFormat>,
    plan: Wired,
    sessions: Vec<Session>,
    image: CallerTensor,
    depth: CallerTensor,
    /// Resizes depth of another size than the image, which is kept in the graph's own memory.
    depth_resize: Option<DepthResize>,
    labels: Option<CallerTensor>,
    confidence: Option<CallerTensor>,
    own: OwnTensors,
    state: GraphState,
    /// Runs since the last reset; `every` counts in it.
    runs: u64,
    /// Whether the labels of the last run were written into the caller's memory.
    labels_left: bool,
    /// Whether its confidence was.
    confidence_left: bool,
}

impl SerialGraph {
    /// Loads a fused `.onnx` file, or a staged graph's `.toml` with the files that it names.
    ///
    /// # Errors
    /// Files that cannot be read or that ONNX Runtime does not load, stages that do not fit together, and a
    /// description that is missing or invalid.
    pub fn load(path: &Path, runtime: &Runtime, options: &GraphOptions) -> Result<Self, GraphError> {
        let Loaded { plan, models, description, provider, float_input } = load(path, runtime, options)?;
        let mut stages = Vec::with_capacity(models.len());
        let mut sessions = Vec::with_capacity(models.len());
        for (stage, (file, model)) in plan.stages.iter().zip(models) {
            let info = StageInfo::new(stage, &plan, file, model.signature());
            let session = model
                .session(&info.inputs, &info.outputs)
                .map_err(|reason| GraphError::Run { stage: stage.name.clone(), reason: reason.into() })?;
            sessions.push(session);
            stages.push(info);
        }
        Self::new(plan, sessions, description, stages, provider, float_input)
    }

    /// Another graph with the same ONNX Runtime sessions, for another stream of frames. Weights are in memory
    /// once; state, reused results and buffers are separate.
    ///
    /// # Errors
    /// No memory for the tensors between the stages.
    pub fn share_sessions(&self) -> Result<Self, GraphError> {
        Self::new(
            self.plan.clone(),
            self.sessions.iter().map(Session::share).collect(),
            self.description.clone(),
            self.stages.clone(),
            self.provider,
            self.float_input,
        )
    }

    /// A graph before its first frame.
    fn new(
        plan: Wired,
        sessions: Vec<Session>,
        description: ModelDescription,
        stages: Vec<StageInfo>,
        provider: Provider,
        float_input: Option<TensorFormat>,
    ) -> Result<Self, GraphError> {
        let spec = |index: usize| plan.tensors[index].clone();
        let is_resized = plan.depth_size != plan.size;
        let depth_spec = TensorSpec { shape: plan.depth_shape(is_resized), ..spec(plan.depth) };
        let mut graph = Self {
            description,
            stages,
            provider,
            float_input,
            sessions,
            image: CallerTensor::new("image", plan.image.clone()),
            depth: CallerTensor::new("depth", depth_spec),
            depth_resize: is_resized.then(|| DepthResize::new(plan.depth_size, plan.size)),
            labels: plan.labels.map(|index| CallerTensor::new("labels", spec(index))),
            confidence: plan.confidence.map(|index| CallerTensor::new("confidence", spec(index))),
            own: OwnTensors::new(&GraphState::with_buffers(&plan))?,
            state: GraphState::new(&plan),
            plan,
            runs: 0,
            labels_left: false,
            confidence_left: false,
        };
        graph.feed_extra_inputs(None);
        Ok(graph)
    }

    /// Feeds the inputs that depend on the camera. `camera` is at the size of [`Self::size`].
    pub fn set_camera(&mut self, camera: &Intrinsics) {
        self.feed_extra_inputs(Some(camera));
    }

    /// Whether an input depends on the camera ([`Self::set_camera`]).
    #[must_use]
    pub fn needs_camera(&self) -> bool {
        self.plan.extras.iter().any(|extra| extra.value.needs_camera())
    }

    /// The focal length of the training camera for images of [`Self::size`], pixels.
    #[must_use]
    pub fn training_fx_px(&self) -> Option<f64> {
        let camera = self.description().camera?;
        Some(camera.fx * f64::from(self.size().width) / f64::from(camera.width))
    }

    /// Writes the extra inputs: all of them for a camera, the constants without one.
    fn feed_extra_inputs(&mut self, camera: Option<&Intrinsics>) {
        let placeholder = Intrinsics::new(1.0, 1.0, 0.0, 0.0, 1, 1).expect("valid intrinsics");
        let is_fed = |extra: &WiredExtra| camera.is_some() || !extra.value.needs_camera();
        for (index, extra) in self.plan.extras.iter().enumerate().filter(|(_, extra)| is_fed(extra)) {
            if let Some(bytes) = extra.bytes(camera.unwrap_or(&placeholder)) {
                self.own.write(GraphState::extra_index(&self.plan, index), &bytes);
            }
        }
    }

    /// The description of the model.
    #[must_use]
    pub fn description(&self) -> &ModelDescription {
        &self.description
    }

    /// The stages in the order in which they run.
    #[must_use]
    pub fn stages(&self) -> &[StageInfo] {
        &self.stages
    }

    /// Width and height of the image, the depth map and the labels, pixels.
    #[must_use]
    pub fn size(&self) -> ImageSize {
        self.plan.size
    }

    /// Whether the graph has labels.
    #[must_use]
    pub fn has_labels(&self) -> bool {
        self.plan.labels.is_some()
    }

    /// Whether the graph has a confidence.
    #[must_use]
    pub fn has_confidence(&self) -> bool {
        self.plan.confidence.is_some()
    }

    /// The execution provider; never [`Provider::Auto`].
    #[must_use]
    pub fn provider(&self) -> Provider {
        self.provider
    }

    /// How many nodes of all stages each provider executes, by ONNX Runtime's names, such as
    /// `CPUExecutionProvider`. ONNX Runtime assigns nodes that a provider does not support to the CPU without
    /// an error. Nodes are counted before providers fuse them.
    ///
    /// # Errors
    /// ONNX Runtime's message.
    pub fn node_assignment(&self) -> Result<BTreeMap<String, usize>, GraphError> {
        let mut assignment = BTreeMap::new();
        for (stage, session) in self.stages.iter().zip(&self.sessions) {
            let part = session
                .node_assignment()
                .map_err(|reason| GraphError::Run { stage: stage.name.clone(), reason: reason.into() })?;
            for (provider, nodes) in part {
                *assignment.entry(provider).or_default() += nodes;
            }
        }
        Ok(assignment)
    }

    /// The format of a foreign network's image ([`GraphInput::Float`]); `None` for camera bytes
    /// ([`GraphInput::Rgb`]).
    #[must_use]
    pub fn float_input(&self) -> Option<&TensorFormat> {
        self.float_input.as_ref()
    }

    /// Runs all stages that are due on one image and writes the results into `outputs`.
    ///
    /// ONNX Runtime reads the image and writes the results in place: nothing is copied, and nothing is
    /// allocated on the Rust side once each buffer's address has been seen. Exceptions are labels of a stage
    /// that does not run for each frame, which are kept inside and copied, and depth of another size than the
    /// image, which is resized.
    ///
    /// # Errors
    /// Buffers of another length or type than the graph's, and ONNX Runtime's errors. After an error every
    /// stage is due again, and state is that before the run.
    pub fn run(
        &mut self,
        image: GraphInput<'_>,
        outputs: GraphOutputs<'_>,
        clock: &dyn Clock,
    ) -> Result<GraphReport, GraphError> {
        let run = self.runs;
        self.runs = 0;
        let report = self.run_due_stages(run, image, outputs, clock)?;
        self.state.commit(run);
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
        let GraphOutputs { depth, labels, confidence } = outputs;
        let (labels, kept_labels) = if self.keeps_labels() { (None, labels) } else { (labels, None) };
        (self.labels_left, self.confidence_left) = (labels.is_some(), confidence.is_some());
        // Depth that is resized stays inside; lending it checks its length.
        let lent_depth = self.depth.lend_mut(&mut *depth)?;
        let tensors = RunTensors {
            plan: &self.plan,
            image: lend_image(&mut self.image, image)?,
            depth: self.depth_resize.is_none().then_some(lent_depth),
            labels: lend_map(self.labels.as_mut(), labels, GraphError::NoLabels)?,
            confidence: lend_map(self.confidence.as_mut(), confidence, GraphError::NoConfidence)?,
            own: self.own.lend(),
            state: &self.state,
            run,
        };
        let mut report = GraphReport::default();
        for (stage, session) in self.plan.stages.iter().zip(&mut self.sessions) {
            let start = clock.nanos();
            if is_due(stage.every, run) {
                tensors.run(stage, session)?;
            } else {
                report.quality = Quality::ReusedLabels;
            }
            report.stages.push(start, clock.nanos());
        }
        if let (Some(memory), Some(index)) = (kept_labels, self.plan.labels) {
            report.bytes_copied += copy_out(self.own.bytes(index), memory)?;
        }
        if let Some(resize) = &self.depth_resize {
            resize.fill(self.own.values(self.plan.depth), depth);
            report.bytes_copied += size_of_val(depth) as u64;
        }
        Ok(report)
    }

    /// Whether the labels must be kept after a run, because their stage is skipped in others.
    fn keeps_labels(&self) -> bool {
        let gives = |index| move |stage: &&WiredStage| stage.outputs.contains(&index);
        self.plan
            .labels
            .is_some_and(|index| self.plan.stages.iter().find(gives(index)).is_some_and(|s| s.every > 1))
    }

    /// Whether a run depends only on its image: no stage has state, and none is skipped in some frames.
    #[must_use]
    pub fn is_stateless(&self) -> bool {
        self.state.is_empty() && self.plan.stages.iter().all(|stage| stage.every <= 1)
    }

    /// Discards earlier frames: the next run runs every stage, and state starts with zeros.
    pub fn reset(&mut self) {
        self.runs = 0;
        self.state.clear(&mut self.own);
    }

    /// The labels of the last run, `[H, W]`, if they were not written into the caller's memory: they were not
    /// requested, or their stage does not run for each frame.
    #[must_use]
    pub fn labels(&self) -> Option<&[u8]> {
        let index = self.plan.labels.filter(|_| self.runs > 0 && !self.labels_left)?;
        Some(self.own.bytes(index))
    }

    /// The confidence of the last run's depth, `[H, W]`: 255 = certain, if it was not written into the
    /// caller's memory. In a pipeline it is adapted to the decoded depth, in place.
    #[must_use]
    pub fn confidence(&self) -> Option<&[u8]> {
        Some(self.own.bytes(self.own_confidence()?))
    }

    /// The same, to be adapted.
    pub(crate) fn confidence_mut(&mut self) -> Option<&mut [u8]> {
        let index = self.own_confidence()?;
        Some(self.own.bytes_mut(index))
    }

    /// The index of the last run's confidence, if it is in the graph's own memory.
    fn own_confidence(&self) -> Option<usize> {
        self.plan.confidence.filter(|_| self.runs > 0 && !self.confidence_left)
    }

    /// An output of any stage after the last run, by `stage.tensor`; the only stage of a fused file is
    /// `network`.
    ///
    /// `None` for an unknown name, before the first run, and for a result that was written into the caller's
    /// memory.
    #[must_use]
    pub fn tensor(&self, name: &str) -> Option<TensorView<'_>> {
        let index = self.plan.tensors.iter().position(|spec| spec.name == name)?;
        let is_outside = (index == self.plan.depth && self.depth_resize.is_none())
            || (self.labels_left && Some(index) == self.plan.labels)
            || (self.confidence_left && Some(index) == self.plan.confidence);
        if is_outside || self.runs == 0 {
            return None;
        }
        Some(TensorView {
            spec: &self.plan.tensors[index],
            bytes: self.own.bytes(self.state.buffer_after_run(index)),
        })
    }
}
