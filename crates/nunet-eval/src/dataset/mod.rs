//! Images with true depth and labels: a folder with `rgb/`, `depth/` and perhaps `labels/` or `label40/`.

mod cameras;
mod depth;
mod ids;
mod image_path;
mod labels;
mod mounts;
mod pairs;
mod table;
mod unpack;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use nunet_core::camera::Camera;
use nunet_source::{
    BitDepthCheck, DecodedFile, Frame, IMAGE_EXTENSIONS, Rotation, Rotator, SourceError, decode,
    decode_numbers,
};
use nunet_types::{ImageSize, PixelRect, counted};
use tempfile::TempDir;

use self::depth::{DepthFile, UnitError};
pub(crate) use self::ids::read_ids;
use self::ids::{Listing, list};
use self::image_path::{image_path, missing_image};
use self::labels::LabelFolder;
pub(crate) use self::mounts::ImageMounts;
use self::pairs::TimePairs;
pub(crate) use self::table::wrong_separator;
use self::unpack::{Topics, Unpacked, unpack};
pub(crate) use self::unpack::{is_recording, refuse_own_depth};
use crate::error::EvalError;
use crate::event::{Event, OnEvent};
use crate::image_name::ImageName;
use crate::metrics::IGNORE;
use crate::options::{DepthUnits, EvalOptions, Window};

/// Endings of labels.
const LABEL_ENDINGS: [&str; 1] = ["png"];
/// The largest difference of the times of an image and its depth: half a frame at 25 Hz.
const MAX_APART_NANOS: u64 = 20_000_000;
const MAX_APART_MS: u64 = MAX_APART_NANOS / 1_000_000;
/// How many ignored files a warning names.
const NAMED_STRAYS: usize = 3;

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
    bit_depth: BitDepthCheck,
    /// A recording's images as files, which are removed at the end, and its topics.
    unpacked: Option<(TempDir, Topics)>,
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
    /// Whether the file or message is in meters, so that no other unit can be stated.
    pub(crate) is_meters: bool,
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
        let named = options.ids.as_deref().map(read_ids).transpose()?;
        Self::open_named(options, named, classes, on_event)
    }

    /// As [`open`](Self::open), with the list of ids of `options`, which was read before.
    pub(crate) fn open_named(
        options: &EvalOptions,
        named: Option<Vec<String>>,
        classes: &[String],
        on_event: OnEvent<'_>,
    ) -> Result<Self, EvalError> {
        if !is_recording(&options.dataset) {
            if let Some(topic) = options.topic.as_ref().or(options.depth_topic.as_ref()) {
                let folder = options.dataset.display();
                let message = format!("`{folder}` is a folder of images, which has no topic `{topic}`");
                let error = SourceError::bad_arguments(message);
                return Err(error.with_hint("name topics only for recordings").into());
            }
            return Self::open_folder(options.dataset.clone(), options, named, classes, on_event);
        }
        let Unpacked { folder, camera, topics, unpaired } = unpack(options, on_event)?;
        let dataset = Self::open_folder(folder.path().to_owned(), options, named, classes, on_event)?;
        Ok(Self { camera, unpaired, unpacked: Some((folder, topics)), ..dataset })
    }

    fn open_folder(
        root: PathBuf,
        options: &EvalOptions,
        named: Option<Vec<String>>,
        classes: &[String],
        on_event: OnEvent<'_>,
    ) -> Result<Self, EvalError> {
        if let Some(missing) = ["rgb", "depth"].into_iter().find(|folder| !root.join(folder).is_dir()) {
            return Err(EvalError::NotADataset { path: root, missing });
        }
        let images = list_known(&root.join("rgb"), &IMAGE_EXTENSIONS, named.is_none(), on_event)?;
        let depths = list_known(&root.join("depth"), &depth::ENDINGS, named.is_none(), on_event)?;
        let pairs = TimePairs::find(&images, &depths);
        report_pairs(&pairs, named.is_none(), on_event);
        let TimePairs { depth_of: partners, strays, .. } = pairs;
        // Depth that belongs to an image of another name is not an image without a partner.
        let paired: BTreeSet<&String> = partners.values().collect();
        let is_own = |id: &String| !(paired.contains(id) || strays.contains(id));
        // Ids of depth are included: a missing image is reported when it is measured. A list is not
        // shortened: what it names is measured or reported.
        let all = || images.into_iter().chain(depths).filter(is_own).collect::<BTreeSet<_>>();
        let ids = named.unwrap_or_else(|| all().into_iter().collect());
        if ids.is_empty() {
            return Err(EvalError::NoImages { path: root });
        }
        let (camera, cameras) = (cameras::of_all(&root)?, cameras::read(&root)?);
        if camera.is_none() && options.camera.calibration.is_none() && options.camera.intrinsics.is_none() {
            cameras::report_missing(&cameras, &ids, on_event);
        }
        Ok(Self {
            labels: LabelFolder::find(&root, classes),
            camera,
            cameras,
            units: options.units,
            window: options.window,
            rotation: options.camera.rotation,
            bit_depth: BitDepthCheck::default(),
            unpacked: None,
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
    pub(crate) fn image(
        &mut self,
        id: &str,
        frame: &mut Frame,
        on_event: OnEvent<'_>,
    ) -> Result<(), EvalError> {
        let path = self.joined("rgb", id, id, &IMAGE_EXTENSIONS)?;
        frame.camera = self.cameras.get(id).copied().or(self.camera);
        let name = self.name("rgb", id, &path);
        let decoded = decode(&path, frame).and_then(|decoded| refuse_turned(frame).map(|()| decoded));
        match decoded {
            Ok(decoded) => report_dim(&mut self.bit_depth, &decoded, &name, on_event),
            Err(source) => return Err(EvalError::ReadImage { image: name.into(), source }),
        }
        let rotated = self.rotation.map_or(Ok(()), |to| Rotator::new(to).rotate(frame));
        rotated.map_err(|source| EvalError::ReadImage { image: name.into(), source })
    }

    /// Reads the truth of an image, which must have the size `image` if that is given.
    pub(crate) fn truth(&self, id: &str, image: Option<ImageSize>) -> Result<Truth, EvalError> {
        let path = self.joined("depth", id, self.partner(id), &depth::ENDINGS)?;
        let name = || self.name("depth", id, &path);
        let depth = DepthFile::read(&path);
        let depth = depth.map_err(|source| EvalError::ReadImage { image: name().into(), source })?;
        let depth = self.rotation.into_iter().fold(depth, DepthFile::rotated);
        let (size, is_meters) = (depth.size(), depth.is_meters());
        let expected = image.unwrap_or(size);
        if size != expected {
            return Err(EvalError::Size { image: name(), got: size, expected, is_labels: false });
        }
        let mut depth_m = depth.meters(self.units).map_err(|error| match error {
            UnitError::Unknown => EvalError::UnknownUnit { depth: name() },
            UnitError::Fixed => EvalError::FixedUnit { depth: name().to_string() },
        })?;
        let labels = self.labels.as_ref().map(|folder| self.labels_of(folder, id, size));
        let mut labels = labels.transpose()?;
        self.blank_outside(size.width, &mut depth_m, f32::NAN);
        self.blank_outside(size.width, labels.as_deref_mut().unwrap_or_default(), IGNORE);
        Ok(Truth { size, depth_m, labels, is_meters })
    }

    fn labels_of(&self, folder: &LabelFolder, id: &str, size: ImageSize) -> Result<Vec<u8>, EvalError> {
        let file = self.partner(id);
        let path = image_path(&self.root.join(folder.name), file, &LABEL_ENDINGS)?;
        let path = path.ok_or_else(|| self.missing(folder.name, file, &LABEL_ENDINGS))?;
        let name = || ImageName::from(&*path);
        let labels = decode_numbers(&path);
        let labels = labels.map_err(|source| EvalError::ReadImage { image: name().into(), source })?;
        let labels = match self.rotation {
            Some(rotation) => labels.rotated(rotation),
            None => labels,
        };
        if labels.size != size {
            return Err(EvalError::Size { image: name(), got: labels.size, expected: size, is_labels: true });
        }
        folder.classes(&labels, &path)
    }

    /// The name of an image's depth and labels.
    fn partner<'a>(&'a self, id: &'a str) -> &'a str {
        self.partners.get(id).map_or(id, String::as_str)
    }

    /// How errors name an image or its depth.
    fn name(&self, folder: &str, id: &str, path: &Path) -> ImageName {
        match &self.unpacked {
            None => path.into(),
            Some((_, Topics { images, depth })) => {
                let topic = if folder == "rgb" { images } else { depth };
                ImageName::Message { id: id.to_owned(), topic: topic.clone() }
            }
        }
    }

    /// The file of an image or of its depth, which has the name `file`. Where names are times, a missing file
    /// is a time without a partner.
    fn joined(
        &self,
        folder: &'static str,
        id: &str,
        file: &str,
        endings: &[&str],
    ) -> Result<PathBuf, EvalError> {
        match image_path(&self.root.join(folder), file, endings)? {
            Some(path) => Ok(path),
            None if self.partners.is_empty() => Err(self.missing(folder, file, endings)),
            None => Err(EvalError::NoPartner { folder, id: id.to_owned(), apart_ms: MAX_APART_MS }),
        }
    }

    /// The error for a file that does not exist.
    fn missing(&self, folder: &str, file: &str, endings: &[&str]) -> EvalError {
        let path = self.root.join(folder);
        let image = match &self.unpacked {
            None => missing_image(&path, file, endings),
            Some(_) => self.name(folder, file, &path),
        };
        EvalError::ReadImage { image: image.into(), source: SourceError::bad_frame("there is no such image") }
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

/// Reports the first image of 16 bits that uses only the lower ones.
pub(crate) fn report_dim(
    check: &mut BitDepthCheck,
    decoded: &DecodedFile,
    image: &ImageName,
    on_event: OnEvent<'_>,
) {
    let found = check.find(|| decoded.maximum_16_bit, format_args!("{image}"));
    found.iter().for_each(|found| on_event(Event::DimImages(found)));
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
            "ignored {} in `{folder}`: expected names that end in {expected}",
            counted(others, "file")
        )));
    }
    Ok(ids)
}

/// Says whether times were used, and which files were ignored therefore.
fn report_pairs(pairs: &TimePairs, with_warning: bool, on_event: OnEvent<'_>) {
    let TimePairs { depth_of, by_name, strays } = pairs;
    if !depth_of.is_empty() {
        on_event(Event::JoinedByTime { by_time: depth_of.len(), by_name: *by_name, apart_ms: MAX_APART_MS });
    }
    if !strays.is_empty() && with_warning {
        let named: Vec<_> = strays.iter().take(NAMED_STRAYS).map(|name| format!("`{name}`")).collect();
        let more = strays.len() - named.len();
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        on_event(Event::Warning(&format!(
            "ignored files whose names are no time stamps, unlike the others: {}{more}",
            named.join(", ")
        )));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A folder of empty files, each a name in `rgb` or `depth`.
    fn folder(files: &[&str]) -> TempDir {
        let root = tempfile::tempdir().unwrap();
        for file in files {
            let path = root.path().join(file);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "").unwrap();
        }
        root
    }

    #[test]
    fn images_are_joined_by_name_and_the_others_by_time_and_the_rest_is_named() {
        let root = folder(&[
            "rgb/1.5.png",
            "rgb/2.0.png",
            "rgb/3.0.png",
            "rgb/thumb.png",
            "depth/1.5.png",
            "depth/2.015.png",
            "depth/3.021.png",
        ]);
        let (mut joined, mut warnings) = (Vec::new(), Vec::new());
        let dataset = Dataset::open(&EvalOptions::new(root.path()), &[], &mut |event| match event {
            Event::JoinedByTime { by_time, by_name, apart_ms } => joined.push((by_time, by_name, apart_ms)),
            Event::Warning(text) => warnings.push(text.to_owned()),
            _ => {}
        });
        let mut dataset = dataset.unwrap();
        assert_eq!(
            (&dataset.ids[..], joined),
            (&["1.5", "2.0", "3.0", "3.021"].map(str::to_owned)[..], vec![(1, 1, 20)])
        );
        let expected = "ignored files whose names are no time stamps, unlike the others: `thumb`";
        assert_eq!(warnings, [expected]);
        let error = dataset.truth("3.0", None).unwrap_err();
        assert_eq!(error.to_string(), "`depth/` has no file that is named `3.0` or within 20 ms of it");
        let error = dataset.image("3.021", &mut Frame::default(), &mut |_| {}).unwrap_err();
        assert!(matches!(error, EvalError::NoPartner { folder: "rgb", .. }), "{error}");
        let list = root.path().join("ids.txt");
        std::fs::write(&list, "2.0\n2.015\nthumb\n").unwrap();
        let options = EvalOptions { ids: Some(list), ..EvalOptions::new(root.path()) };
        let dataset = Dataset::open(&options, &[], &mut |_| {}).unwrap();
        assert_eq!(dataset.ids, ["2.0", "2.015", "thumb"], "a list is not shortened");
    }

    #[test]
    fn the_camera_file_may_begin_with_a_byte_order_mark() {
        let root = folder(&["rgb/a.png", "depth/a.png"]);
        let text = "\u{feff}{\"width\": 4, \"height\": 2, \"fx\": 5, \"fy\": 6, \"cx\": 1.5, \"cy\": 0.5}";
        std::fs::write(root.path().join("camera.json"), text).unwrap();
        let dataset = Dataset::open(&EvalOptions::new(root.path()), &[], &mut |_| {}).unwrap();
        assert_eq!(dataset.camera.unwrap().intrinsics.fx_px, 5.0);
    }

    #[test]
    fn depth_may_be_meters() {
        let root = folder(&["rgb/a.png", "rgb/b.png"]);
        std::fs::create_dir(root.path().join("depth")).unwrap();
        let depth = root.path().join("depth/a.npy");
        nunet_files::write_npy(&depth, &[70.0, 0.0], (2, 1).into()).unwrap();
        std::fs::write(root.path().join("depth/b.npy"), "no array").unwrap();
        let mut options = EvalOptions::new(root.path());
        let truth =
            |options: &EvalOptions, id| Dataset::open(options, &[], &mut |_| {}).unwrap().truth(id, None);
        let found = truth(&options, "a").unwrap();
        assert!(found.is_meters && found.depth_m[0] == 70.0 && found.depth_m[1].is_nan(), "{found:?}");
        assert!(matches!(truth(&options, "b"), Err(EvalError::ReadImage { .. })));
        options.units.scale = Some(0.001);
        assert!(matches!(truth(&options, "a"), Err(EvalError::FixedUnit { .. })));
    }

    #[test]
    fn an_image_whose_depth_has_two_files_is_not_measured_with_one_of_them() {
        let root =
            folder(&["rgb/a.png", "rgb/b.jpg", "rgb/b.png", "depth/a.png", "depth/a.npy", "depth/b.png"]);
        let mut dataset = Dataset::open(&EvalOptions::new(root.path()), &[], &mut |_| {}).unwrap();
        assert_eq!(dataset.ids, ["a", "b"]);
        let both = |error: EvalError, files: [&str; 2]| {
            let text = nunet_types::text_with_causes(&error);
            assert!(files.iter().all(|file| text.contains(file)), "{text}");
        };
        both(dataset.truth("a", None).unwrap_err(), ["depth/a.png", "depth/a.npy"]);
        let image = dataset.image("b", &mut Frame::default(), &mut |_| {});
        both(image.unwrap_err(), ["rgb/b.jpg", "rgb/b.png"]);
    }

    #[test]
    fn a_missing_file_is_named_with_every_ending_it_could_have() {
        let root = folder(&["rgb/a.png", "depth/b.npy", "labels/b.png"]);
        let classes = ["floor".to_owned()];
        let mut dataset = Dataset::open(&EvalOptions::new(root.path()), &classes, &mut |_| {}).unwrap();
        let name = |error| match error {
            EvalError::ReadImage { image, .. } => image.to_string(),
            other => panic!("{other}"),
        };
        let depth = name(dataset.truth("a", None).unwrap_err());
        assert!(depth.ends_with("/depth/a.png` or `a.npy`"), "{depth}");
        let image = name(dataset.image("b", &mut Frame::default(), &mut |_| {}).unwrap_err());
        assert!(image.ends_with("/rgb/b.jpg`, `b.jpeg` or `b.png`"), "{image}");
    }

    #[test]
    fn labels_of_another_size_are_an_error_of_labels() {
        let root = folder(&["rgb/a.png", "labels/a.png", "depth/a.png"]);
        image::ImageBuffer::<image::Luma<u16>, _>::new(8, 8).save(root.path().join("depth/a.png")).unwrap();
        image::GrayImage::new(4, 8).save(root.path().join("labels/a.png")).unwrap();
        let classes = ["floor".to_owned()];
        let dataset = Dataset::open(&EvalOptions::new(root.path()), &classes, &mut |_| {}).unwrap();
        let error = dataset.truth("a", None).unwrap_err();
        assert!(matches!(error, EvalError::Size { is_labels: true, .. }), "{error}");
        let error = dataset.truth("a", Some((4, 8).into())).unwrap_err();
        assert!(matches!(error, EvalError::Size { is_labels: false, .. }), "{error}");
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
            let mut dataset = Dataset::open(&EvalOptions::new(root.path()), &[], &mut |_| {}).unwrap();
            dataset.image("a", &mut Frame::default(), &mut |_| {})
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
