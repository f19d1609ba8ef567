//! Writes a recording with images and depth as a folder, which the rest of this crate reads.

use std::collections::BTreeMap;
use std::path::Path;

use image::ExtendedColorType;
use nunet_core::camera::Camera;
use nunet_core::preprocess::Preprocessor;
use nunet_files::{FilesError, write_depth_mm, write_npy};
use nunet_mcap::{ImageEncoding, Next, RecordedImage, Recording, model_of_results};
use nunet_source::{Fill, Frame, OpenOptions, RecordingSource, Source as _, from_recording_error};
use nunet_types::{ImageSize, counted};
use tempfile::TempDir;

use super::{MAX_APART_MS, MAX_APART_NANOS, refuse_turned};
use crate::error::{Cause, EvalError};
use crate::event::{Event, OnEvent};
use crate::image_name::ImageName;
use crate::options::{DepthUnits, EvalOptions};

/// A recording's pairs as files.
pub(super) struct Unpacked {
    pub(super) folder: TempDir,
    pub(super) camera: Option<Camera>,
    pub(super) topics: Topics,
    /// Images without depth, or unreadable.
    pub(super) unpaired: u64,
}

/// The topics of a recording's pairs.
#[derive(Debug)]
pub(super) struct Topics {
    pub(super) images: String,
    pub(super) depth: String,
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

/// Writes each image with the depth nearest to it in time. Messages may be in any order, so the times of all
/// depth are read first. Then images are written, and last the depth that belongs to them.
pub(super) fn unpack(options: &EvalOptions, on_event: OnEvent<'_>) -> Result<Unpacked, EvalError> {
    let path = &options.dataset;
    let open = OpenOptions { topic: options.topic.as_deref(), ..OpenOptions::default() };
    let mut source = RecordingSource::open(path, open)?;
    let mut depths =
        Recording::open_depth(path, options.depth_topic.as_deref()).map_err(from_recording_error)?;
    let times = DepthTime::of_all(&mut depths, options.units, on_event)?;
    let folder = empty_folder().map_err(unwritable)?;
    let mut images = Images::default();
    images.write(&mut source, path, &times, folder.path(), on_event)?;
    let topics = Topics { images: source.topic().to_owned(), depth: depths.topic().to_owned() };
    images.report_alone(&topics, on_event);
    if images.pairs == 0 {
        return Err(EvalError::NoPairs { path: path.clone(), apart_ms: MAX_APART_MS });
    }
    depths.rewind().map_err(from_recording_error)?;
    for_each_depth(&mut depths, &mut |_| {}, |number, depth| {
        let mut ids = images.ids_of_depth.get(&number).into_iter().flatten();
        ids.try_for_each(|id| write_depth(folder.path(), id, depth)).map_err(unwritable)
    })?;
    Ok(Unpacked { camera: images.camera, unpaired: images.unreadable + images.alone, folder, topics })
}

/// The error of the temporary copy.
fn unwritable<E: Into<Cause>>(error: E) -> EvalError {
    let folder = std::env::temp_dir();
    EvalError::system(format!("cannot copy the images of the recording into `{}`", folder.display()))(error)
}

fn empty_folder() -> std::io::Result<TempDir> {
    let folder = tempfile::tempdir()?;
    for name in ["rgb", "depth"] {
        std::fs::create_dir(folder.path().join(name))?;
    }
    Ok(folder)
}

/// Calls `each` with the number and the content of every readable depth message.
fn for_each_depth(
    depths: &mut Recording,
    on_event: OnEvent<'_>,
    mut each: impl FnMut(usize, &RecordedImage) -> Result<(), EvalError>,
) -> Result<(), EvalError> {
    let (mut image, mut number) = (RecordedImage::default(), 0);
    loop {
        match depths.next(&mut image) {
            Next::Image if image.encoding.is_some_and(ImageEncoding::is_depth) => {
                each(number, &image)?;
                number += 1;
            }
            Next::Image | Next::Nothing => {}
            Next::Bad(error) => on_event(Event::Warning(&format!("depth is skipped: {error}"))),
            // The images are in the same file, and their end is reported.
            Next::End | Next::Cut(_) => return Ok(()),
        }
    }
}

/// When depth was captured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct DepthTime {
    unix_nanos: i64,
    /// Its place among all depth in the file.
    number: usize,
}

impl DepthTime {
    /// The times of all depth, in order. Depth in meters must not have another unit.
    fn of_all(
        depths: &mut Recording,
        units: DepthUnits,
        on_event: OnEvent<'_>,
    ) -> Result<Vec<Self>, EvalError> {
        let (mut times, topic) = (Vec::new(), format!("`{}`", depths.topic()));
        for_each_depth(depths, on_event, |number, depth| {
            if depth.encoding == Some(ImageEncoding::DepthMeters) && units.are_stated() {
                return Err(EvalError::FixedUnit { depth: topic.clone() });
            }
            times.push(Self { unix_nanos: depth.unix_nanos(), number });
            Ok(())
        })?;
        times.sort_unstable();
        Ok(times)
    }

    /// The nearest depth of those in order, and its distance in nanoseconds.
    fn nearest(times: &[Self], unix_nanos: i64) -> Option<(u64, Self)> {
        let later = times.partition_point(|time| time.unix_nanos < unix_nanos);
        let near = times[later.saturating_sub(1)..].iter().take(2);
        near.map(|&time| (time.unix_nanos.abs_diff(unix_nanos), time)).min()
    }
}

/// The images of a recording.
#[derive(Default)]
struct Images {
    camera: Option<Camera>,
    /// The ids of the images that each depth belongs to.
    ids_of_depth: BTreeMap<usize, Vec<String>>,
    pairs: u64,
    unreadable: u64,
    /// Images without depth near in time.
    alone: u64,
    /// The time of the first of them, and its distance from the nearest depth; nanoseconds.
    first_alone: Option<(i64, Option<u64>)>,
}

impl Images {
    /// Writes those that have depth.
    fn write(
        &mut self,
        source: &mut RecordingSource,
        path: &Path,
        times: &[DepthTime],
        folder: &Path,
        on_event: OnEvent<'_>,
    ) -> Result<(), EvalError> {
        let mut frame = Frame::default();
        loop {
            match source.fill(&mut frame) {
                Fill::Frame => {}
                Fill::Failed(error) => {
                    on_event(Event::Warning(&format!("an image is skipped: {error:#}")));
                    self.unreadable += 1;
                    continue;
                }
                Fill::Cut(error) => {
                    on_event(Event::Warning(&format!("the recording ends early: {error:#}")));
                    self.unreadable += 1;
                    return Ok(());
                }
                Fill::Nothing => continue,
                Fill::Broken(error) => return Err(error.into()),
                _ => return Ok(()),
            }
            refuse_turned(&frame)
                .map_err(|source| EvalError::ReadImage { image: ImageName::from(path).into(), source })?;
            self.camera = self.camera.or(frame.camera);
            if let Some(id) = self.join(frame.capture.unix_nanos, times) {
                write_image(folder, &id, &frame)?;
            }
        }
    }

    /// The id of an image if it has depth.
    fn join(&mut self, unix_nanos: i64, times: &[DepthTime]) -> Option<String> {
        let nearest = DepthTime::nearest(times, unix_nanos);
        let Some((_, depth)) = nearest.filter(|(apart, _)| *apart <= MAX_APART_NANOS) else {
            self.alone += 1;
            self.first_alone.get_or_insert((unix_nanos, nearest.map(|(apart, _)| apart)));
            return None;
        };
        let id = format!("{:06}", self.pairs);
        self.ids_of_depth.entry(depth.number).or_default().push(id.clone());
        self.pairs += 1;
        Some(id)
    }

    fn report_alone(&self, topics: &Topics, on_event: OnEvent<'_>) {
        let Some((unix_nanos, apart)) = self.first_alone else { return };
        let Topics { images, depth } = topics;
        let distance = apart
            .map_or(String::new(), |nanos| format!(", {:.1} ms from the nearest depth", nanos as f64 / 1e6));
        on_event(Event::Warning(&format!(
            "skipped {} of `{images}`: `{depth}` has no depth within {MAX_APART_MS} ms; the first one is at {:.3} \
             s{distance}",
            counted(self.alone, "image"),
            unix_nanos as f64 / 1e9,
        )));
    }
}

fn write_image(folder: &Path, id: &str, frame: &Frame) -> Result<(), EvalError> {
    let ending = if frame.file.starts_with(&[0xff, 0xd8]) { "jpg" } else { "png" };
    let rgb = folder.join("rgb").join(format!("{id}.{ending}"));
    if !frame.file.is_empty() {
        return std::fs::write(&rgb, &frame.file).map_err(unwritable);
    }
    let ImageSize { width, height } = frame.size;
    let mut to_rgb = Preprocessor::new(width, height);
    let image = to_rgb.prepare(&frame.view()?);
    image::save_buffer(&rgb, image.rgb, width, height, ExtendedColorType::Rgb8).map_err(unwritable)
}

/// Integers stay integers, whose unit the user may state. Millimeters of 16 bits could not hold all meters.
fn write_depth(folder: &Path, id: &str, depth: &RecordedImage) -> Result<(), FilesError> {
    let (meters, size) = (depth.depth_m(), (depth.width, depth.height).into());
    let path = |ending: &str| folder.join("depth").join(format!("{id}.{ending}"));
    match depth.encoding {
        Some(ImageEncoding::DepthMillimeters) => write_depth_mm(&path("png"), &meters, size),
        _ => write_npy(&path("npy"), &meters, size),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_depth_is_found_wherever_it_was_recorded() {
        let mut times: Vec<DepthTime> = [30, 10, 20]
            .iter()
            .enumerate()
            .map(|(number, &unix_nanos)| DepthTime { unix_nanos, number })
            .collect();
        times.sort_unstable();
        for (nanos, expected) in [(0, (10, 1)), (10, (0, 1)), (24, (4, 2)), (26, (4, 0)), (99, (69, 0))] {
            let (apart, depth) = DepthTime::nearest(&times, nanos).unwrap();
            assert_eq!((apart, depth.number), expected, "{nanos}");
        }
        assert_eq!(DepthTime::nearest(&[], 5), None);
    }

    #[test]
    fn images_without_depth_are_counted_and_the_first_is_named() {
        let times = [DepthTime { unix_nanos: 1_030_000_000, number: 0 }];
        let topics = Topics { images: "/rgb".into(), depth: "/depth".into() };
        let mut images = Images::default();
        let warnings = |images: &Images| {
            let mut warnings = Vec::new();
            images.report_alone(&topics, &mut |event| match event {
                Event::Warning(text) => warnings.push(text.to_owned()),
                other => panic!("{other:?}"),
            });
            warnings
        };
        assert_eq!(images.join(1_011_000_000, &times).as_deref(), Some("000000"));
        assert!(warnings(&images).is_empty());
        assert_eq!(images.join(1_000_000_000, &times), None);
        assert_eq!(images.join(2_000_000_000, &times), None);
        let expected = "skipped 2 images of `/rgb`: `/depth` has no depth within 20 ms; the first one is at 1.000 s, \
                        30.0 ms from the nearest depth";
        assert_eq!(warnings(&images), [expected]);
    }

    #[test]
    fn integers_are_copied_as_they_are_and_meters_without_a_limit() {
        let folder = empty_folder().unwrap();
        let depth = |encoding, data: Vec<u8>| RecordedImage {
            row_stride: data.len() as u32,
            data,
            encoding: Some(encoding),
            width: 3,
            height: 1,
            ..RecordedImage::default()
        };
        let values = [1_u16, 40_000, u16::MAX];
        let bytes = values.into_iter().flat_map(u16::to_le_bytes).collect();
        write_depth(folder.path(), "a", &depth(ImageEncoding::DepthMillimeters, bytes)).unwrap();
        let written = nunet_source::decode_numbers(&folder.path().join("depth/a.png")).unwrap();
        assert_eq!(written.values, values);
        let meters = [0.0001_f32, 70.25, 5000.0];
        let bytes = meters.into_iter().flat_map(f32::to_le_bytes).collect();
        write_depth(folder.path(), "b", &depth(ImageEncoding::DepthMeters, bytes)).unwrap();
        let (written, _) = crate::npy_file::read(&folder.path().join("depth/b.npy")).unwrap();
        assert_eq!(written, meters);
    }
}
