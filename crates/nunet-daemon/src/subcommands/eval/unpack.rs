//! A recording with images and depth, as the folder that everything else here reads.

use std::path::Path;

use anyhow::{Context as _, bail};
use image::ExtendedColorType;
use nunet_core::camera::Camera;
use nunet_core::preprocess::Preprocessor;
use nunet_mcap::{Next, RecordedImage, Recording, model_of_results};
use tempfile::TempDir;
use tracing::warn;

use crate::cli::EvalArgs;
use crate::exit::{WithHint, source_error};
use crate::sink::files::write_depth_mm;
use crate::source::{Fill, Frame, OpenOptions, RecordingSource, Source as _, from_recording_error};

/// An image and depth whose stamps differ by no more belong together: half a frame at 25 Hz.
const MAX_APART_NANOS: i64 = 20_000_000;

/// A recording's pairs as files.
pub(super) struct Unpacked {
    pub(super) folder: TempDir,
    pub(super) camera: Option<Camera>,
    /// Images without depth beside them, or unreadable.
    pub(super) unpaired: u64,
}

/// A recording that nunetd has written holds a network's depth: measured against it, the same network would be perfect.
pub(super) fn refuse_own_depth(arguments: &EvalArgs) -> Result<(), WithHint> {
    let path = &arguments.dataset;
    if arguments.depth_topic.is_some() || !is_recording(path) {
        return Ok(());
    }
    let Some(model) = model_of_results(path) else { return Ok(()) };
    Err(WithHint::usage(
        format!(
            "`{}` was written by nunetd: its depth is a prediction of `{model:.60}`, not truth",
            path.display()
        ),
        "pass --depth-topic TOPIC to compare the model with it anyway",
    ))
}

/// Whether a dataset is a recording, and no folder.
pub(super) fn is_recording(dataset: &Path) -> bool {
    !dataset.join("rgb").is_dir() && nunet_mcap::is_recording(dataset)
}

/// Writes each image with the depth nearest to it in time. Both topics are in the order of their stamps.
pub(super) fn unpack(arguments: &EvalArgs) -> anyhow::Result<Unpacked> {
    let path = &arguments.dataset;
    let options = OpenOptions { topic: arguments.topic.as_deref(), ..OpenOptions::default() };
    let mut pictures = RecordingSource::open(path, options).map_err(source_error)?;
    let mut depths = Depths::open(path, arguments.depth_topic.as_deref())?;
    let folder = tempfile::tempdir().context("cannot make a folder for the recording's pictures")?;
    for name in ["rgb", "depth"] {
        std::fs::create_dir(folder.path().join(name))
            .context("cannot make a folder for the recording's pictures")?;
    }
    let (mut frame, mut camera, mut pairs, mut unpaired) = (Frame::default(), None, 0_u64, 0);
    loop {
        match pictures.fill(&mut frame) {
            Fill::Frame => {}
            Fill::Failed(error) => {
                warn!("an image is skipped: {error:#}");
                unpaired += 1;
                continue;
            }
            Fill::Cut(error) => {
                warn!("the recording ends early: {error:#}");
                unpaired += 1;
                break;
            }
            Fill::Nothing => continue,
            _ => break,
        }
        camera = camera.or(frame.camera);
        match depths.nearest(frame.capture.unix_nanos) {
            Some(depth) => {
                write_pair(folder.path(), &format!("{pairs:06}"), &frame, depth)?;
                pairs += 1;
            }
            None => unpaired += 1,
        }
    }
    if pairs == 0 {
        let apart_ms = MAX_APART_NANOS / 1_000_000;
        bail!(WithHint::new(
            format!("`{}` has no image with depth within {apart_ms} ms of it", path.display()),
            "choose the topics: --topic and --depth-topic"
        ));
    }
    Ok(Unpacked { folder, camera, unpaired })
}

/// Depth in the order of time.
struct Depths {
    recording: Recording,
    current: Option<RecordedImage>,
    next: Option<RecordedImage>,
}

impl Depths {
    fn open(path: &Path, topic: Option<&str>) -> anyhow::Result<Self> {
        let recording =
            Recording::open_depth(path, topic).map_err(|error| source_error(from_recording_error(error)))?;
        let mut depths = Self { recording, current: None, next: None };
        depths.advance();
        depths.advance();
        Ok(depths)
    }

    fn advance(&mut self) {
        self.current = self.next.take();
        let mut picture = RecordedImage::default();
        loop {
            match self.recording.next(&mut picture) {
                Next::Image if !picture.depth_m().is_empty() => {
                    self.next = Some(picture);
                    return;
                }
                Next::Image | Next::Nothing => {}
                Next::Bad(error) => warn!("depth is skipped: {error}"),
                Next::End | Next::Cut(_) => return,
            }
        }
    }

    /// The depth nearest to a time, if it is near enough.
    fn nearest(&mut self, nanos: i64) -> Option<&RecordedImage> {
        let apart = |picture: &RecordedImage| picture.unix_nanos().abs_diff(nanos);
        while let (Some(current), Some(next)) = (&self.current, &self.next)
            && apart(next) <= apart(current)
        {
            self.advance();
        }
        if self.current.is_none() {
            self.advance();
        }
        self.current.as_ref().filter(|current| apart(current) <= MAX_APART_NANOS.unsigned_abs())
    }
}

fn write_pair(folder: &Path, id: &str, frame: &Frame, depth: &RecordedImage) -> anyhow::Result<()> {
    let context = || format!("cannot unpack pair `{id}` of the recording");
    let ending = if frame.file.starts_with(&[0xff, 0xd8]) { "jpg" } else { "png" };
    let rgb = folder.join("rgb").join(format!("{id}.{ending}"));
    if frame.file.is_empty() {
        let (width, height) = frame.size;
        let mut to_rgb = Preprocessor::new(width, height);
        let picture = to_rgb.prepare(&frame.view()?);
        image::save_buffer(&rgb, picture.rgb, width, height, ExtendedColorType::Rgb8)
            .with_context(context)?;
    } else {
        std::fs::write(&rgb, &frame.file).with_context(context)?;
    }
    let path = folder.join("depth").join(format!("{id}.png"));
    write_depth_mm(&path, &depth.depth_m(), (depth.width, depth.height)).with_context(context)
}
