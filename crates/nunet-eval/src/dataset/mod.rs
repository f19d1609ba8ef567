//! Images with true depth and labels: a folder with `rgb/`, `depth/` and perhaps `labels/` or `label40/`.

mod cameras;
mod ids;
mod labels;
mod mounts;
mod pairs;
mod table;
mod unpack;

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::path::{Path, PathBuf};

use nunet_core::camera::Camera;
use nunet_source::{
    CameraFile, Frame, IMAGE_EXTENSIONS, Rotation, Rotator, SingleChannelImage, SourceError, decode,
    decode_numbers,
};
use nunet_types::{ImageSize, PixelRect};
use tempfile::TempDir;

pub(crate) use self::ids::read_ids;
use self::ids::{Listing, list};
use self::labels::LabelFolder;
pub(crate) use self::mounts::ImageMounts;
use self::unpack::{Unpacked, unpack};
pub(crate) use self::unpack::{is_recording, refuse_own_depth};
use crate::error::EvalError;
use crate::event::{Event, OnEvent};
use crate::metrics::IGNORE;
use crate::options::{DepthUnits, EvalOptions, Window};

/// Endings of depth and labels.
const NUMBER_ENDINGS: [&str; 1] = ["png"];
/// The largest difference of the times of an image and its depth: half a frame at 25 Hz.
const MAX_APART_NANOS: u64 = 20_000_000;
const MILLIMETER_M: f64 = 0.001;
/// The value for no measurement in 16-bit images of some sensors, besides 0. 7-Scenes has both.
const NO_DEPTH: u16 = u16::MAX;

/// A folder of pairs, read one at a time.
#[derive(Debug)]
pub(crate) struct Dataset {
    root: PathBuf,
    pub(crate) ids: Vec<String>,
    /// The names of depth and labels, if they differ from the images' ids.
    partners: BTreeMap<String, String>,
    units: DepthUnits,
    window: Option<Window>,
    /// How images, depth and labels are rotated.
    rotation: Option<Rotation>,
    labels: Option<LabelFolder>,
    /// The camera of all images, if the dataset states it.
    camera: Option<Camera>,
    /// The cameras of single images, if the dataset states them.
    cameras: BTreeMap<String, Camera>,
    /// A recording's images as files; removed at the end.
    _unpacked: Option<TempDir>,
    /// The number of a recording's images without depth.
    pub(crate) unpaired: u64,
}

/// The true depth and labels of an image.
#[derive(Debug)]
pub(crate) struct Truth {
    pub(crate) size: ImageSize,
    /// Meters, NaN = none.
    pub(crate) depth_m: Vec<f32>,
    /// The network's classes, [`IGNORE`] = none.
    pub(crate) labels: Option<Vec<u8>>,
}

impl Truth {
    /// Removes the truth outside of a view, which the network does not see.
    pub(crate) fn blank_outside(&mut self, view: PixelRect) {
        if view == PixelRect::whole(self.size) {
            return;
        }
        let columns = view.x as usize..(view.x + view.width) as usize;
        let rows = view.y as usize..(view.y + view.height) as usize;
        let width = self.size.width as usize;
        let is_outside =
            |place: usize| !columns.contains(&(place % width)) || !rows.contains(&(place / width));
        let labels = self.labels.as_deref_mut().unwrap_or_default();
        labels.iter_mut().enumerate().filter(|(place, _)| is_outside(*place)).for_each(|(_, l)| *l = IGNORE);
        let depth = self.depth_m.iter_mut().enumerate();
        depth.filter(|(place, _)| is_outside(*place)).for_each(|(_, depth)| *depth = f32::NAN);
    }
}

impl Dataset {
    /// Lists the pairs. True labels are read only if they are of `classes`, those of the network.
    pub(crate) fn open(
        options: &EvalOptions,
        classes: &[String],
        on_event: OnEvent<'_>,
    ) -> Result<Self, EvalError> {
        if !is_recording(&options.dataset) {
            return Self::open_folder(options.dataset.clone(), options, classes, on_event);
        }
        let Unpacked { folder, camera, unpaired } = unpack(options, on_event)?;
        let dataset = Self::open_folder(folder.path().to_owned(), options, classes, on_event)?;
        Ok(Self { camera, unpaired, _unpacked: Some(folder), ..dataset })
    }

    fn open_folder(
        root: PathBuf,
        options: &EvalOptions,
        classes: &[String],
        on_event: OnEvent<'_>,
    ) -> Result<Self, EvalError> {
        if let Some(missing) = ["rgb", "depth"].into_iter().find(|folder| !root.join(folder).is_dir()) {
            return Err(EvalError::NotADataset { path: root, missing });
        }
        let images = list_known(&root.join("rgb"), &IMAGE_EXTENSIONS, options.ids.is_none(), on_event)?;
        let depths = list_known(&root.join("depth"), &NUMBER_ENDINGS, options.ids.is_none(), on_event)?;
        let partners = pairs::by_time(&images, &depths);
        let mut ids = match &options.ids {
            Some(list) => read_ids(list)?,
            // Ids of depth are included: a missing image is reported when it is measured.
            None => images.into_iter().chain(depths).collect::<BTreeSet<_>>().into_iter().collect(),
        };
        // Depth that belongs to an image of another name is not an image without a partner.
        let paired: HashSet<&String> = partners.values().collect();
        ids.retain(|id| !paired.contains(id));
        if ids.is_empty() {
            return Err(EvalError::NoImages { path: root });
        }
        Ok(Self {
            labels: LabelFolder::find(&root, classes),
            camera: camera_of(&root)?,
            cameras: cameras::read(&root)?,
            units: options.units,
            window: options.window,
            rotation: options.camera.rotation,
            _unpacked: None,
            unpaired: 0,
            root,
            ids,
            partners,
        })
    }

    /// Whether there are true labels of the network's classes.
    pub(crate) fn has_labels(&self) -> bool {
        self.labels.is_some()
    }

    /// Reads an image.
    pub(crate) fn image(&self, id: &str, frame: &mut Frame) -> Result<(), EvalError> {
        let path = self.path("rgb", id, &IMAGE_EXTENSIONS);
        frame.camera = self.cameras.get(id).copied().or(self.camera);
        let decoded = decode(&path, frame).and_then(|_| refuse_turned(frame));
        let decoded =
            decoded.and_then(|()| self.rotation.map_or(Ok(()), |to| Rotator::new(to).rotate(frame)));
        decoded.map_err(|source| EvalError::ReadImage { path, source })
    }

    /// Reads the truth of an image, which must have the size `image` if that is given.
    pub(crate) fn truth(&self, id: &str, image: Option<ImageSize>) -> Result<Truth, EvalError> {
        let (path, depth) = self.numbers("depth", id)?;
        let size = depth.size;
        same_size(&path, size, image.unwrap_or(size))?;
        let mut depth_m = meters(&depth, self.units).ok_or(EvalError::UnknownUnit { path })?;
        let labels = self.labels.as_ref().map(|folder| {
            let (path, labels) = self.numbers(folder.name, id)?;
            same_size(&path, labels.size, size)?;
            folder.classes(&labels, &path)
        });
        let mut labels = labels.transpose()?;
        self.blank_outside(size.width, &mut depth_m, f32::NAN);
        self.blank_outside(size.width, labels.as_deref_mut().unwrap_or_default(), IGNORE);
        Ok(Truth { size, depth_m, labels })
    }

    fn numbers(&self, folder: &str, id: &str) -> Result<(PathBuf, SingleChannelImage), EvalError> {
        let path = self.path(folder, self.partners.get(id).map_or(id, String::as_str), &NUMBER_ENDINGS);
        match decode_numbers(&path) {
            Ok(numbers) => Ok((
                path,
                match self.rotation {
                    Some(rotation) => numbers.rotated(rotation),
                    None => numbers,
                },
            )),
            Err(source) => Err(EvalError::ReadImage { path, source }),
        }
    }

    /// The file of an image. If there is none, the expected path.
    fn path(&self, folder: &str, id: &str, endings: &[&str]) -> PathBuf {
        let folder = self.root.join(folder);
        let named = |ending: &str| folder.join(format!("{id}.{ending}"));
        let mut spellings = endings.iter().flat_map(|ending| [named(ending), named(&ending.to_uppercase())]);
        spellings.find(|path| path.is_file()).unwrap_or_else(|| named(endings[0]))
    }

    fn blank_outside<T: Copy>(&self, width: u32, values: &mut [T], none: T) {
        let Some(window) = self.window else { return };
        for (index, value) in (0_u32..).zip(values) {
            if !window.contains(index % width, index / width) {
                *value = none;
            }
        }
    }
}

/// Refuses an image that was rotated by EXIF, because its depth was not rotated.
fn refuse_turned(frame: &Frame) -> Result<(), SourceError> {
    if !frame.is_turned {
        return Ok(());
    }
    Err(SourceError::bad_frame("its EXIF orientation rotates it, but not its depth")
        .with_hint("store image and depth upright, without an EXIF orientation"))
}

/// The ids of a folder's images. Warns about files of other kinds if `with_warning`.
fn list_known(
    folder: &Path,
    endings: &[&str],
    with_warning: bool,
    on_event: OnEvent<'_>,
) -> Result<Vec<String>, EvalError> {
    let Listing { ids, others } = list(folder, endings)?;
    if others > 0 && with_warning {
        let expected: Vec<_> = endings.iter().map(|ending| format!("`.{ending}`")).collect();
        let (folder, expected) = (folder.display(), expected.join(", "));
        on_event(Event::Warning(&format!(
            "ignored {others} files in `{folder}` that do not end in {expected}"
        )));
    }
    Ok(ids)
}

/// The camera that the dataset states in `camera.json`, as rendered clips do.
fn camera_of(root: &Path) -> Result<Option<Camera>, EvalError> {
    let path = root.join("camera.json");
    if !path.is_file() {
        return Ok(None);
    }
    let text = std::fs::read_to_string(&path).map_err(EvalError::read(&path))?;
    let file: CameraFile = serde_json::from_str(&text).map_err(EvalError::read(&path))?;
    Ok(Some(file.camera().map_err(EvalError::read(&path))?))
}

/// Two images that belong together have one size.
fn same_size(path: &Path, got: ImageSize, expected: ImageSize) -> Result<(), EvalError> {
    if got == expected { Ok(()) } else { Err(EvalError::Size { path: path.to_owned(), got, expected }) }
}

/// `(value + offset) * scale`, NaN = none. `None` if the unit is not known.
fn meters(depth: &SingleChannelImage, units: DepthUnits) -> Option<Vec<f32>> {
    let scale = units.scale.or((depth.bits == 16).then_some(MILLIMETER_M))?;
    let zero_is_none = units.offset == 0.0;
    let is_none = |value: u16| (value == 0 && zero_is_none) || value == NO_DEPTH;
    let meters = |value: u16| ((f64::from(value) + units.offset) * scale) as f32;
    Some(depth.values.iter().map(|&value| if is_none(value) { f32::NAN } else { meters(value) }).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn depth(bits: u8) -> SingleChannelImage {
        SingleChannelImage { size: (3, 1).into(), values: vec![0, 1500, 65535], bits }
    }

    #[test]
    fn no_depth_is_0_unless_there_is_an_offset_and_65535_always() {
        let meters = |offset| meters(&depth(16), DepthUnits { scale: None, offset }).unwrap();
        let millimeters = meters(0.0);
        assert!(
            millimeters[0].is_nan() && millimeters[1] == 1.5 && millimeters[2].is_nan(),
            "{millimeters:?}"
        );
        let offset = meters(500.0);
        assert!(offset[0] == 0.5 && offset[1] == 2.0 && offset[2].is_nan(), "{offset:?}");
    }

    #[test]
    fn eight_bits_need_a_scale() {
        assert!(meters(&depth(8), DepthUnits::default()).is_none());
        let units = DepthUnits { scale: Some(0.1), offset: 0.0 };
        assert_eq!(meters(&depth(8), units).unwrap()[1], 150.0);
    }

    #[test]
    fn an_image_that_is_turned_upright_does_not_belong_to_its_depth() {
        let root = tempfile::tempdir().unwrap();
        for folder in ["rgb", "depth"] {
            std::fs::create_dir(root.path().join(folder)).unwrap();
        }
        let path = root.path().join("rgb/a.jpg");
        image::RgbImage::new(8, 8).save(&path).unwrap();
        image::ImageBuffer::<image::Luma<u16>, _>::new(8, 8).save(root.path().join("depth/a.png")).unwrap();
        let plain = std::fs::read(&path).unwrap();
        let read = || {
            let dataset = Dataset::open(&EvalOptions::new(root.path()), &[], &mut |_| {}).unwrap();
            dataset.image("a", &mut Frame::default())
        };
        for orientation in 1..=8 {
            let exif = [
                &b"\xff\xe1\x00\x22Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0"[..],
                &[orientation],
                &[0; 6],
            ]
            .concat();
            std::fs::write(&path, [&plain[..2], &exif, &plain[2..]].concat()).unwrap();
            match read() {
                Ok(()) => assert_eq!(orientation, 1),
                Err(error) => {
                    assert!(orientation > 1 && matches!(error, EvalError::ReadImage { .. }), "{error}");
                }
            }
        }
    }

    #[test]
    fn a_folder_without_depth_and_one_without_images_are_no_datasets() {
        let root = tempfile::tempdir().unwrap();
        let open = || Dataset::open(&EvalOptions::new(root.path()), &[], &mut |_| {});
        std::fs::create_dir(root.path().join("rgb")).unwrap();
        assert!(matches!(open(), Err(EvalError::NotADataset { missing: "depth", .. })));
        std::fs::create_dir(root.path().join("depth")).unwrap();
        assert!(matches!(open(), Err(EvalError::NoImages { .. })));
    }
}
