//! `nunetd replay`: a recording through the network into another recording; every frame, the same bytes each time.

use indicatif::ProgressBar;
use nunet_core::camera::Camera;
use nunet_core::pipeline::Pipeline;
use serde_json::json;
use sha2::{Digest as _, Sha256};
use std::io::Write as _;
use tracing::{error, info, warn};

use super::progress::progress;
use crate::Outcome;
use crate::buffers::Buffers;
use crate::cli::{Publish, ReplayArgs};
use crate::engine::{Engine, tested_pipeline};
use crate::exit::camera_name;
use crate::sink::recording::{About, FrameWriter, Record, Results, refuse_output, settings};
use crate::sink::stats::ModelName;
use crate::source::{Fill, Frame, Opening, RecordingSource, Source};
use crate::stream::{Continuity, Optics, Stop, Stopped};
use crate::telemetry::MonotonicClock;
use crate::words::hexadecimal;

/// How often the output is brought onto the disk: a full disk costs so many frames at the most.
const SYNC_FRAMES: u64 = 50;

/// Replays until the recording ends, is cut off, or a signal comes.
pub(super) fn replay(arguments: &ReplayArgs) -> anyhow::Result<Outcome> {
    let stop = Stop::on_signals()?;
    match replay_unless(arguments, &stop) {
        Err(error) if error.is::<Stopped>() => {
            warn!("{error}: there is no `{}`", arguments.output.display());
            Ok(Outcome::Lost)
        }
        outcome => outcome,
    }
}

fn replay_unless(arguments: &ReplayArgs, stop: &Stop) -> anyhow::Result<Outcome> {
    refuse_output(&arguments.output, Some(&arguments.input), arguments.force)?;
    let camera = camera_name(&arguments.camera)?;
    let optics = Optics::new(&arguments.optics.lens.geometry)?;
    let how = Opening { topic: arguments.topic.as_deref(), stopped: Some(stop.flag()), ..Opening::default() };
    let source = RecordingSource::open(&arguments.input, how);
    stop.check()?;
    let mut source = source?;
    let engine = Engine::start(&arguments.engine)?;
    let loaded = engine.load_unless(&arguments.model, &[], stop)?;
    stop.check()?;
    let model = ModelName { name: loaded.name(), hash: loaded.hash() };
    let pipeline = tested_pipeline(loaded, &arguments.optics)?;

    stop.check()?;
    let mut frame = Frame::default();
    let first = first_fill(&mut source, &mut frame, stop);
    let frame_id = arguments.frame_id.clone().or_else(|| Some(source.frame_id().to_owned()));
    let about = About {
        camera: camera.as_str(),
        frame_id: frame_id.as_deref().filter(|name| !name.is_empty()),
        mount: arguments.mount.mount,
        model: &model,
        provider: pipeline.graph().provider().name(),
        settings: settings(&pipeline),
        force: arguments.force,
    };
    let writer = FrameWriter::create(&arguments.output, &about)?;
    let mut replay = Replay::new(pipeline, optics, writer, &arguments.publish);
    replay.run(&mut source, frame, first, stop)?;
    replay.finish(arguments)
}

/// The first that is more than nothing: other topics may have had many messages before, and the pictures' coordinate frame is
/// known with the first picture alone.
fn first_fill(source: &mut dyn Source, frame: &mut Frame, stop: &Stop) -> Fill {
    loop {
        match source.fill(frame) {
            Fill::Nothing | Fill::Crowded if !stop.requested() => {}
            fill => return fill,
        }
    }
}

/// The pipeline and both recordings.
struct Replay {
    pipeline: Pipeline,
    optics: Optics,
    continuity: Continuity,
    buffers: Buffers,
    record: Record,
    writer: FrameWriter,
    labels: bool,
    cloud: bool,
    hash: Sha256,
    frames: u64,
    failed: u64,
    cut: bool,
}

impl Replay {
    fn new(pipeline: Pipeline, optics: Optics, writer: FrameWriter, publish: &[Publish]) -> Self {
        Self {
            buffers: Buffers::new(&pipeline),
            pipeline,
            optics,
            continuity: Continuity::default(),
            record: Record::default(),
            writer,
            labels: publish.contains(&Publish::Labels),
            cloud: publish.contains(&Publish::Cloud),
            hash: Sha256::new(),
            frames: 0,
            failed: 0,
            cut: false,
        }
    }

    fn run(
        &mut self,
        source: &mut RecordingSource,
        mut frame: Frame,
        first: Fill,
        stop: &Stop,
    ) -> anyhow::Result<()> {
        let progress = progress("replay", source.pictures());
        let (mut fill, mut over) = (first, false);
        while !stop.requested() {
            let was_frame = fill.had_frame();
            match fill {
                Fill::Frame => match self.take_through(&mut frame) {
                    Ok(()) => self.frames += 1,
                    Err(Trouble::Frame(error)) => self.lose(&progress, &frame, &error),
                    Err(Trouble::Output(error)) => return Err(error),
                },
                Fill::Failed(error) => self.lose(&progress, &frame, &error),
                Fill::Nothing | Fill::Crowded => {}
                Fill::End => {
                    over = true;
                    break;
                }
                Fill::Cut(error) => {
                    progress.suspend(|| error!("the source ends early: {error:#}"));
                    self.cut = true;
                    break;
                }
                Fill::Broken(error) => return Err(error),
            }
            progress.inc(u64::from(was_frame));
            fill = source.fill(&mut frame);
        }
        progress.finish_and_clear();
        if stop.requested() && !over {
            error!("stopped before the recording's end");
            self.cut = true;
        }
        Ok(())
    }

    fn lose(&mut self, progress: &ProgressBar, frame: &Frame, error: &anyhow::Error) {
        progress.suspend(|| warn!("frame {} is lost: {error:#}", frame.sequence));
        self.failed += 1;
    }

    /// The frame's memory travels into the record and back.
    fn take_through(&mut self, frame: &mut Frame) -> Result<(), Trouble> {
        let depth_camera = self.infer(frame).map_err(Trouble::Frame)?;
        let camera = self.optics.camera_of(frame).map_err(|error| Trouble::Frame(error.into()))?;
        self.record.take(std::mem::take(frame), camera);
        self.record.copy_results(&Results {
            scale: self.pipeline.scale(),
            size: self.pipeline.size(),
            depth: self.buffers.depth(),
            labels: self.buffers.labels().filter(|_| self.labels),
            cloud_size: self.pipeline.cloud_size(),
            cloud: if self.cloud { self.buffers.cloud() } else { &[] },
            camera: depth_camera,
        });
        let written = self.writer.write(&self.record);
        self.hash.update(self.record.depth().bytes);
        self.hash.update(self.record.labels().unwrap_or_default());
        *frame = std::mem::take(&mut self.record.frame);
        written.map_err(Trouble::Output)?;
        // By frames, not by time: the file is the same each time.
        if (self.frames + 1).is_multiple_of(SYNC_FRAMES) {
            self.writer.sync().map_err(Trouble::Output)
        } else {
            Ok(())
        }
    }

    fn infer(&mut self, frame: &Frame) -> anyhow::Result<Option<Camera>> {
        self.optics.follow(frame, &mut self.pipeline)?;
        if self.continuity.jump_to(frame).is_some() {
            self.pipeline.reset();
        }
        let report = self.pipeline.process(&frame.view()?, self.buffers.outputs(), &MonotonicClock)?;
        self.continuity.took(frame);
        Ok(report.camera)
    }

    fn finish(self, arguments: &ReplayArgs) -> anyhow::Result<Outcome> {
        let Self { frames, failed, cut, .. } = self;
        self.writer.finish()?;
        let hash = hexadecimal(self.hash.finalize().as_slice());
        let text = if arguments.json {
            json!({
                "contract": nunet_ipc::CONTRACT_VERSION,
                "frames": frames,
                "failed": failed,
                "cut": cut,
                "results_sha256": hash,
            })
            .to_string()
        } else {
            format!("{frames} frames, {failed} lost, results sha256 {hash}")
        };
        writeln!(std::io::stdout(), "{text}")?;
        info!("`{}` -> `{}`", arguments.input.display(), arguments.output.display());
        Ok(if failed == 0 && !cut { Outcome::Done } else { Outcome::Lost })
    }
}

/// A frame that cannot be processed is a loss; a file that cannot be written is the end.
enum Trouble {
    Frame(anyhow::Error),
    Output(anyhow::Error),
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use image::{ImageFormat, RgbImage};

    use super::*;
    use crate::source::write_recording;

    #[test]
    fn the_coordinate_frame_is_the_pictures_however_many_other_messages_come_before() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        let mut png = Cursor::new(Vec::new());
        RgbImage::new(2, 2).write_to(&mut png, ImageFormat::Png).unwrap();
        let mut pictures = vec![None; 600];
        pictures.push(Some(png.get_ref().as_slice()));
        write_recording(&path, "left_camera_optical", &pictures);
        let mut source = RecordingSource::open(&path, Opening::default()).unwrap();
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
    fn a_stop_is_seen_before_the_first_picture() {
        let stop = Stop::default();
        stop.request();
        assert!(matches!(first_fill(&mut Silent, &mut Frame::default(), &stop), Fill::Nothing));
    }
}
