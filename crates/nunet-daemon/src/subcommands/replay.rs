//! `nunetd replay`: re-runs a recording through the model into another recording, every frame,
//! deterministically.

use anyhow::Context as _;
use indicatif::ProgressBar;
use nunet_core::pipeline::{FrameReport, Pipeline};
use nunet_engine::{Buffers, Engine, EngineOptions, MonotonicClock, file_sha256, find_model, hexadecimal};
use nunet_ipc::CameraName;
use nunet_sink::attitude::{AttitudeConfig, AttitudeSource, AttitudeStage};
use nunet_sink::empty_depth::EmptyDepthWarning;
use nunet_sink::file_plan::FilePlan;
use nunet_sink::frame_writer::{FrameWriter, RecordingOptions, settings};
use nunet_sink::obstacle_record::obstacle_frame;
use nunet_sink::record::RecordedFrame;
use nunet_telemetry::RateLimit;
use serde_json::json;
use sha2::{Digest as _, Sha256};
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::Instant;
use tracing::{error, info, warn};

use super::load::{load_unless, tested_pipeline};
use super::progress::progress;
use crate::Outcome;
use crate::config::{ModelConfig, MountOption, ProcessingConfig, Publish, default_frame_id};
use crate::exit::{is_usage, warn_of_camera};
use crate::sink::Results;
use crate::sink::recording::refuse_output;
use crate::sink::stats::ModelName;
use crate::source::{
    CameraResolver, Continuity, Fill, Frame, OpenOptions, RecordingSource, Rotated, Source, StartingWith,
};
use crate::stream::{FrameHandler, Pace, SourceEnd, Stop, Stopped, drive};
use nunet_sink::stdout::print;

/// The output is synced after this many frames, so that a full disk loses at most these.
const SYNC_FRAMES: u64 = 50;

/// The options of `replay`.
pub(crate) struct ReplayOptions {
    pub(crate) input: PathBuf,
    pub(crate) output: PathBuf,
    pub(crate) model: PathBuf,
    /// The image topic, if there are several.
    pub(crate) topic: Option<String>,
    /// The first part of the names of the new topics.
    pub(crate) camera: CameraName,
    /// The coordinate frame; `None` for that of the images.
    pub(crate) frame_id: Option<String>,
    pub(crate) mount: Option<MountOption>,
    pub(crate) publish: Vec<Publish>,
    /// Overwrite the output.
    pub(crate) force: bool,
    pub(crate) processing: ProcessingConfig,
    pub(crate) engine: EngineOptions,
    pub(crate) json: bool,
}

/// Replays until the recording ends, is truncated, or a stop is requested.
pub(crate) fn replay(options: &ReplayOptions) -> anyhow::Result<Outcome> {
    let stop = Stop::on_signals()?;
    match replay_unless(options, &stop) {
        Err(error) if error.is::<Stopped>() => {
            warn!("{error}: there is no `{}`", options.output.display());
            Ok(Outcome::Lost)
        }
        outcome => outcome,
    }
}

fn replay_unless(options: &ReplayOptions, stop: &Stop) -> anyhow::Result<Outcome> {
    file_plan(options).check()?;
    refuse_output(&options.output, options.force)?;
    let resolver = CameraResolver::new(&options.processing.geometry)?;
    let how =
        OpenOptions { topic: options.topic.as_deref(), stopped: Some(stop.flag()), ..OpenOptions::default() };
    let source = RecordingSource::open(&options.input, how);
    stop.check()?;
    let rotation = options.processing.geometry.rotation;
    let mut source = Rotated::new(source?, rotation);
    let engine = Engine::start(options.engine.clone())?;
    let loaded = load_unless(&engine, &ModelConfig { path: options.model.clone(), every: Vec::new() }, stop)?;
    stop.check()?;
    let model = ModelName { name: loaded.name(), hash: loaded.hash() };
    let pipeline = tested_pipeline(loaded, options.processing.pipeline)?;

    stop.check()?;
    let mut frame = Frame::default();
    let first = first_fill(&mut source, &mut frame, stop);
    // The coordinate frame of the images is not that of the rotated ones.
    let stated = if rotation.is_some() { "" } else { source.source().frame_id() };
    let frame_id = options.frame_id.as_deref().unwrap_or(stated);
    let unnamed = default_frame_id(options.camera.as_str());
    let about = RecordingOptions {
        camera: options.camera.as_str(),
        frame_id: if frame_id.is_empty() { &unnamed } else { frame_id },
        mount: options.mount.map(Into::into),
        model: &model.name,
        model_sha256: &model.hash,
        provider: pipeline.graph().provider().name(),
        settings: settings(&pipeline),
        force: options.force,
        lossless: true,
    };
    let writer = FrameWriter::create(&options.output, &about)?;
    let mut replay = Replay::new(pipeline, resolver, writer, options);
    replay.run(&mut source, frame, first, stop)?;
    replay.finish(options)
}

fn file_plan(options: &ReplayOptions) -> FilePlan {
    let mut files = FilePlan::default();
    nunet_mcap::files(&options.input).into_iter().for_each(|file| files.read("the input", file));
    find_model(&options.model).iter().for_each(|model| files.read_model(model));
    options.processing.geometry.calibration.iter().for_each(|file| files.read("the calibration", file));
    files.write("the output", &options.output);
    files
}

/// The first result that is not idle. Other topics may have many messages before the first image, which
/// states the coordinate frame.
fn first_fill(source: &mut dyn Source, frame: &mut Frame, stop: &Stop) -> Fill {
    loop {
        match source.fill(frame) {
            Fill::Nothing | Fill::Crowded if !stop.requested() => {}
            fill => return fill,
        }
    }
}

/// The pipeline, and the recording that it fills.
struct Replay {
    pipeline: Pipeline,
    camera: CameraResolver,
    attitude: Option<AttitudeStage>,
    continuity: Continuity,
    buffers: Buffers,
    record: RecordedFrame,
    writer: FrameWriter,
    labels: bool,
    confidence: bool,
    cloud: bool,
    /// Independent of other recorded data.
    depth_and_labels_hash: Sha256,
    frames: u64,
    failed: u64,
    cut: bool,
    /// The memory of the next frame.
    frame: Frame,
    progress: ProgressBar,
    lost: RateLimit,
    empty_depth: EmptyDepthWarning,
}

impl FrameHandler for Replay {
    fn buffer(&mut self) -> Frame {
        std::mem::take(&mut self.frame)
    }

    fn on_frame(&mut self, mut frame: Frame) -> anyhow::Result<ControlFlow<()>> {
        match self.replay_frame(&mut frame) {
            Ok(()) => self.frames += 1,
            Err(ReplayError::Frame(error)) => {
                if let Some(text) = self.lost.lost_frame(Instant::now(), frame.sequence, &error) {
                    self.progress.suspend(|| warn!("{text}"));
                }
                self.failed += 1;
            }
            Err(ReplayError::Fatal(error)) => return Err(error),
        }
        self.progress.inc(1);
        self.frame = frame;
        Ok(ControlFlow::Continue(()))
    }

    fn on_lost(&mut self, frame: Frame) {
        self.failed += 1;
        self.progress.inc(1);
        self.frame = frame;
    }

    fn on_idle(&mut self, frame: Frame, _is_crowded: bool) {
        self.frame = frame;
    }

    fn around_log(&self, log: &mut dyn FnMut()) {
        self.progress.suspend(log);
    }
}

impl Replay {
    fn new(pipeline: Pipeline, camera: CameraResolver, writer: FrameWriter, options: &ReplayOptions) -> Self {
        // Where no camera of a robot can be, the mount is for `/tf_static` alone: attitudes are not used.
        let mount = options.mount.and_then(|mount| mount.pose().ok());
        let attitude = mount.map(|mount| AttitudeConfig { source: AttitudeSource::Recording, mount });
        let publish = &options.publish;
        Self {
            attitude: attitude.map(|config| AttitudeStage::new(&options.camera, config)),
            buffers: Buffers::new(&pipeline),
            pipeline,
            camera,
            continuity: Continuity::default(),
            record: RecordedFrame::default(),
            writer,
            labels: publish.contains(&Publish::Labels),
            confidence: publish.contains(&Publish::Confidence),
            cloud: publish.contains(&Publish::Cloud),
            depth_and_labels_hash: Sha256::new(),
            frames: 0,
            failed: 0,
            cut: false,
            frame: Frame::default(),
            progress: ProgressBar::hidden(),
            lost: RateLimit::default(),
            empty_depth: EmptyDepthWarning::default(),
        }
    }

    /// Replays `first`, which is filled already, and all frames after it.
    fn run(
        &mut self,
        source: &mut Rotated<RecordingSource>,
        frame: Frame,
        first: Fill,
        stop: &Stop,
    ) -> anyhow::Result<()> {
        self.progress = progress("replay", source.source().image_count());
        self.frame = frame;
        let mut source = StartingWith::new(first, source);
        let end = drive(&mut source, Pace::ALL, stop, self)?;
        self.progress.finish_and_clear();
        self.cut = end != SourceEnd::Complete;
        if end == SourceEnd::Stopped {
            error!("stopped before the end of the recording");
        }
        Ok(())
    }

    /// The frame's memory is moved into the record and back.
    fn replay_frame(&mut self, frame: &mut Frame) -> Result<(), ReplayError> {
        let report = self.infer(frame).map_err(|error| {
            // The camera does not fit the images, so no frame of the recording can be replayed.
            if is_usage(&error) { ReplayError::Fatal(error) } else { ReplayError::Frame(error) }
        })?;
        // A bar that is hidden for each frame would flicker.
        if report.invalid_pixels as usize >= self.pipeline.size().pixel_count() {
            let size = self.pipeline.size();
            self.progress.suspend(|| self.empty_depth.check(frame.sequence, &report, size));
        }
        let camera = self.camera.camera_of(frame).map_err(|error| ReplayError::Frame(error.into()))?;
        self.record.take(std::mem::take(frame), camera);
        self.record.copy_results(&Results {
            scale: report.scale(),
            size: self.pipeline.size(),
            depth: self.buffers.depth(),
            labels: self.buffers.labels().filter(|_| self.labels),
            confidence: self.pipeline.confidence().filter(|_| self.confidence),
            cloud_size: self.pipeline.cloud_size(),
            cloud: self.cloud.then(|| self.buffers.cloud()),
            camera: report.camera,
            view: report.view,
            obstacles: None,
            obstacle_frame: obstacle_frame(false),
            roll_pitch_rad: self.attitude.as_ref().and_then(AttitudeStage::roll_pitch_rad),
        });
        let written = self.writer.write(&self.record);
        self.depth_and_labels_hash.update(self.record.depth().bytes);
        self.depth_and_labels_hash.update(self.record.labels().unwrap_or_default());
        *frame = std::mem::take(&mut self.record.frame);
        written.map_err(ReplayError::Fatal)?;
        // Counted in frames, not time, so that every replay writes the same bytes.
        if (self.frames + 1).is_multiple_of(SYNC_FRAMES) {
            self.writer.sync().map_err(ReplayError::Fatal)
        } else {
            Ok(())
        }
    }

    fn infer(&mut self, frame: &Frame) -> anyhow::Result<FrameReport> {
        warn_of_camera(&self.camera.update(frame, &mut self.pipeline)?);
        if self.continuity.discontinuity_to(frame).is_some() {
            self.pipeline.reset();
        }
        self.pipeline.set_frame_nanos(frame.capture.nanos);
        // Most recordings have no attitude, which is not worth a warning.
        let has_some = |stage: &&mut AttitudeStage| frame.roll_pitch_rad.is_some() || stage.had_any();
        if let Some(attitude) = self.attitude.as_mut().filter(has_some) {
            attitude.follow(frame, &mut self.pipeline, None);
        }
        let report = self.pipeline.process(&frame.view()?, self.buffers.outputs(), &MonotonicClock)?;
        self.continuity.took(frame);
        Ok(report)
    }

    fn finish(self, options: &ReplayOptions) -> anyhow::Result<Outcome> {
        let Self { frames, failed, cut, .. } = self;
        self.writer.finish()?;
        let file_hash = file_sha256(&options.output)
            .with_context(|| format!("cannot read `{}` to compute its hash", options.output.display()))?;
        let hash = file_hash.unwrap_or_else(|| "unavailable: the output is not a regular file".to_owned());
        let text = if options.json {
            json!({
                "contract": nunet_ipc::CONTRACT_VERSION,
                "frames": frames,
                "failed": failed,
                "cut": cut,
                "results_sha256": hash,
                "depth_and_labels_sha256": hexadecimal(self.depth_and_labels_hash.finalize().as_slice()),
            })
            .to_string()
        } else {
            format!("{}, {failed} lost, results sha256 {hash}", nunet_types::counted(frames, "frame"))
        };
        print(&text)?;
        info!("`{}` -> `{}`", options.input.display(), options.output.display());
        Ok(if failed == 0 && !cut { Outcome::Done } else { Outcome::Lost })
    }
}

/// Why a frame is not in the output.
enum ReplayError {
    /// It cannot be processed, and is lost.
    Frame(anyhow::Error),
    /// The user's camera does not fit the images, or the output cannot be written: the replay ends.
    Fatal(anyhow::Error),
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use image::{ImageFormat, RgbImage};

    use super::*;
    use nunet_mcap::{DepthRecord, EncodedImage, FrameRecord, RecordingWriter, ScaleRecord, WriterOptions};

    #[test]
    fn the_coordinate_frame_is_the_images_however_many_other_messages_come_before() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        let mut png = Cursor::new(Vec::new());
        RgbImage::new(2, 2).write_to(&mut png, ImageFormat::Png).unwrap();
        let mut images = vec![None; 600];
        images.push(Some(png.get_ref().as_slice()));
        let options = WriterOptions {
            camera: "front".into(),
            frame_id: "left_camera_optical".into(),
            mount: None,
            about: std::collections::BTreeMap::new(),
            force: false,
        };
        let mut writer = RecordingWriter::create(&path, options).unwrap();
        for (log_nanos, image) in (1..).zip(images) {
            let image = image.map(|data| EncodedImage { format: "png", data });
            let depth = DepthRecord { scale: ScaleRecord::default(), width: 1, height: 1, bytes: &[0; 4] };
            let (camera, depth_camera, labels, cloud) = (None, None, None, None);
            writer
                .write(&FrameRecord {
                    log_nanos,
                    stamp_nanos: 1,
                    image,
                    camera,
                    depth,
                    depth_camera,
                    labels,
                    confidence: None,
                    cloud,
                })
                .unwrap();
        }
        writer.finish().unwrap();
        let mut source = RecordingSource::open(&path, OpenOptions::default()).unwrap();
        let first = first_fill(&mut source, &mut Frame::default(), &Stop::default());
        assert!(matches!(first, Fill::Frame), "{first:?}");
        assert_eq!(source.frame_id(), "left_camera_optical");
    }

    struct Silent;

    impl Source for Silent {
        fn fill(&mut self, _frame: &mut Frame) -> Fill {
            Fill::Nothing
        }
    }

    #[test]
    fn a_stop_is_seen_before_the_first_image() {
        let stop = Stop::default();
        stop.request();
        assert!(matches!(first_fill(&mut Silent, &mut Frame::default(), &stop), Fill::Nothing));
    }
}
