//! Writes a recording with images and depth as a folder, which the rest of this crate reads.

use std::path::Path;

use image::ExtendedColorType;
use nunet_core::camera::Camera;
use nunet_core::preprocess::Preprocessor;
use nunet_files::write_depth_mm;
use nunet_mcap::{Next, RecordedImage, Recording, model_of_results};
use nunet_source::{
    Fill, Frame, OpenOptions, RecordingSource, Source as _, SourceError, from_recording_error,
};
use nunet_types::ImageSize;
use tempfile::TempDir;

use super::{MAX_APART_NANOS, refuse_turned};
use crate::error::EvalError;
use crate::event::{Event, OnEvent};
use crate::options::EvalOptions;

/// A recording's pairs as files.
pub(super) struct Unpacked {
    pub(super) folder: TempDir,
    pub(super) camera: Option<Camera>,
    /// Images without depth, or unreadable.
    pub(super) unpaired: u64,
}

/// Refuses a recording of nunetd, whose depth comes from a network: compared with it, the same network would
/// have no error.
pub(crate) fn refuse_own_depth(options: &EvalOptions) -> Result<(), EvalError> {
    let path = &options.dataset;
    if options.depth_topic.is_some() || !is_recording(path) {
        return Ok(());
    }
    match model_of_results(path) {
        Some(model) => Err(EvalError::OwnDepth { path: path.clone(), model }),
        None => Ok(()),
    }
}

/// Whether a dataset is a recording, not a folder.
pub(crate) fn is_recording(dataset: &Path) -> bool {
    !dataset.join("rgb").is_dir() && nunet_mcap::is_recording(dataset)
}

/// Writes each image with the depth nearest to it in time. Both topics are in the order of their stamps.
pub(super) fn unpack(options: &EvalOptions, on_event: OnEvent<'_>) -> Result<Unpacked, EvalError> {
    let path = &options.dataset;
    let open = OpenOptions { topic: options.topic.as_deref(), ..OpenOptions::default() };
    let mut images = RecordingSource::open(path, open)?;
    let mut depths = Depths::open(path, options.depth_topic.as_deref(), on_event)?;
    let folder =
        empty_folder().map_err(EvalError::system("cannot create a folder for the recording's images"))?;
    let (mut frame, mut camera, mut pairs, mut unpaired) = (Frame::default(), None, 0_u64, 0);
    loop {
        match images.fill(&mut frame) {
            Fill::Frame => {}
            Fill::Failed(error) => {
                on_event(Event::Warning(&format!("an image is skipped: {error:#}")));
                unpaired += 1;
                continue;
            }
            Fill::Cut(error) => {
                on_event(Event::Warning(&format!("the recording ends early: {error:#}")));
                unpaired += 1;
                break;
            }
            Fill::Nothing => continue,
            _ => break,
        }
        refuse_turned(&frame).map_err(|source| EvalError::ReadImage { path: path.clone(), source })?;
        camera = camera.or(frame.camera);
        match depths.nearest(frame.capture.unix_nanos, on_event) {
            Some(depth) => {
                write_pair(folder.path(), &format!("{pairs:06}"), &frame, depth)?;
                pairs += 1;
            }
            None => unpaired += 1,
        }
    }
    if pairs == 0 {
        return Err(EvalError::NoPairs { path: path.clone(), apart_ms: MAX_APART_NANOS / 1_000_000 });
    }
    Ok(Unpacked { folder, camera, unpaired })
}

fn empty_folder() -> std::io::Result<TempDir> {
    let folder = tempfile::tempdir()?;
    for name in ["rgb", "depth"] {
        std::fs::create_dir(folder.path().join(name))?;
    }
    Ok(folder)
}

/// Depth in the order of time.
struct Depths {
    recording: Recording,
    current: Option<RecordedImage>,
    next: Option<RecordedImage>,
}

impl Depths {
    fn open(path: &Path, topic: Option<&str>, on_event: OnEvent<'_>) -> Result<Self, SourceError> {
        let recording = Recording::open_depth(path, topic).map_err(from_recording_error)?;
        let mut depths = Self { recording, current: None, next: None };
        depths.advance(on_event);
        depths.advance(on_event);
        Ok(depths)
    }

    fn advance(&mut self, on_event: OnEvent<'_>) {
        self.current = self.next.take();
        let mut image = RecordedImage::default();
        loop {
            match self.recording.next(&mut image) {
                Next::Image if !image.depth_m().is_empty() => {
                    self.next = Some(image);
                    return;
                }
                Next::Image | Next::Nothing => {}
                Next::Bad(error) => on_event(Event::Warning(&format!("depth is skipped: {error}"))),
                Next::End | Next::Cut(_) => return,
            }
        }
    }

    /// The depth nearest to a time, if it is near enough.
    fn nearest(&mut self, nanos: i64, on_event: OnEvent<'_>) -> Option<&RecordedImage> {
        let apart = |image: &RecordedImage| image.unix_nanos().abs_diff(nanos);
        while let (Some(current), Some(next)) = (&self.current, &self.next)
            && apart(next) <= apart(current)
        {
            self.advance(on_event);
        }
        if self.current.is_none() {
            self.advance(on_event);
        }
        self.current.as_ref().filter(|current| apart(current) <= MAX_APART_NANOS)
    }
}

fn write_pair(folder: &Path, id: &str, frame: &Frame, depth: &RecordedImage) -> Result<(), EvalError> {
    let ending = if frame.file.starts_with(&[0xff, 0xd8]) { "jpg" } else { "png" };
    let rgb = folder.join("rgb").join(format!("{id}.{ending}"));
    if frame.file.is_empty() {
        let ImageSize { width, height } = frame.size;
        let mut to_rgb = Preprocessor::new(width, height);
        let image = to_rgb.prepare(&frame.view()?);
        image::save_buffer(&rgb, image.rgb, width, height, ExtendedColorType::Rgb8)
            .map_err(EvalError::write(&rgb))?;
    } else {
        std::fs::write(&rgb, &frame.file).map_err(EvalError::write(&rgb))?;
    }
    let path = folder.join("depth").join(format!("{id}.png"));
    Ok(write_depth_mm(&path, &depth.depth_m(), (depth.width, depth.height).into())?)
}
