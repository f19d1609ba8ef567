//! A recording with pictures and depth, as the folder that everything else here reads.

use std::path::Path;

use anyhow::{Context as _, bail};
use image::ExtendedColorType;
use nunet_core::camera::Camera;
use nunet_core::preprocess::Preprocessor;
use nunet_mcap::{Next, Picture, Recording, model_of_results};
use tempfile::TempDir;
use tracing::warn;

use crate::cli::EvalArgs;
use crate::exit::BadArguments;
use crate::sink::files::write_depth_mm;
use crate::source::{Fill, Frame, Opening, RecordingSource, Source as _, sorted};

/// A picture and depth whose stamps differ by no more belong together: half a frame at 25 Hz.
const MAX_APART_NANOS: i64 = 20_000_000;

/// A recording's pairs as files.
pub(super) struct Unpacked {
    pub(super) folder: TempDir,
    pub(super) camera: Option<Camera>,
    /// Pictures without depth beside them, or unreadable.
    pub(super) unpaired: u64,
}

/// A recording that nunetd has written holds a network's depth: measured against it, the same network would be perfect.
pub(super) fn refuse_own_depth(arguments: &EvalArgs) -> Result<(), BadArguments> {
    let path = &arguments.dataset;
    if arguments.depth_topic.is_some() || !is_recording(path) {
        return Ok(());
    }
    let Some(model) = model_of_results(path) else { return Ok(()) };
    Err(BadArguments(format!(
        "`{}` was written by nunetd: its depth is what `{model:.60}` said, not truth\nhint: --depth-topic TOPIC, if that is \
         what the model is to be compared with",
        path.display()
    )))
}

/// Whether a dataset is a recording, and no folder.
pub(super) fn is_recording(dataset: &Path) -> bool {
    dataset.extension().is_some_and(|ending| ending == "mcap")
}

/// Writes each picture with the depth nearest to it in time. Both topics are in the order of their stamps.
pub(super) fn unpack(arguments: &EvalArgs) -> anyhow::Result<Unpacked> {
    let path = &arguments.dataset;
    let how = Opening { topic: arguments.topic.as_deref(), ..Opening::default() };
    let mut pictures = RecordingSource::open(path, how)?;
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
                warn!("a picture is skipped: {error:#}");
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
        bail!(
            "`{}` has no picture with depth within {} ms of it\nhint: --topic and --depth-topic choose",
            path.display(),
            MAX_APART_NANOS / 1_000_000
        );
    }
    Ok(Unpacked { folder, camera, unpaired })
}

/// Depth in the order of time.
struct Depths {
    recording: Recording,
    current: Option<Picture>,
    next: Option<Picture>,
}

impl Depths {
    fn open(path: &Path, topic: Option<&str>) -> anyhow::Result<Self> {
        let recording = Recording::open_depth(path, topic).map_err(sorted)?;
        let mut depths = Self { recording, current: None, next: None };
        depths.advance();
        depths.advance();
        Ok(depths)
    }

    fn advance(&mut self) {
        self.current = self.next.take();
        let mut picture = Picture::default();
        loop {
            match self.recording.next(&mut picture) {
                Next::Picture if !picture.depth_m().is_empty() => {
                    self.next = Some(picture);
                    return;
                }
                Next::Picture | Next::Nothing => {}
                Next::Bad(error) => warn!("depth is skipped: {error}"),
                Next::End | Next::Cut(_) => return,
            }
        }
    }

    /// The depth nearest to a time, if it is near enough.
    fn nearest(&mut self, nanos: i64) -> Option<&Picture> {
        let apart = |picture: &Picture| picture.unix_nanos().abs_diff(nanos);
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

fn write_pair(folder: &Path, id: &str, frame: &Frame, depth: &Picture) -> anyhow::Result<()> {
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
