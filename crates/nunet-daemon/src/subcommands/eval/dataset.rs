//! Images with true depth and labels: a folder with `rgb/`, `depth/` and perhaps `labels/` or `label40/`.

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::io::Read as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};

use nunet_core::camera::Camera;
use nunet_core::plain_file;
use tempfile::TempDir;
use tracing::warn;

use super::metrics::IGNORE;
use super::pairs;
use super::unpack::{Unpacked, is_recording, unpack};
use crate::cli::{DepthUnitArgs, EvalArgs, Window};
use crate::exit::{BadArguments, WithHint};
use crate::source::{CameraFile, Frame, IMAGE_EXTENSIONS, Numbers, decode, decode_numbers};

/// What some editors begin a text with.
const BYTE_ORDER_MARK: char = '\u{feff}';

/// Endings of depth and labels.
const NUMBER_ENDINGS: [&str; 1] = ["png"];
/// A million ids of 64 characters.
const MAX_LIST_BYTES: u64 = 64 << 20;
const MILLIMETRE_M: f64 = 0.001;
/// What sensors write into 16-bit images where they measured nothing, besides 0: 7-Scenes has both.
const NO_DEPTH: u16 = u16::MAX;
/// The 13 classes that NYU's 40 fold into, index = label.
const CLASS_NAMES: [&str; 13] = [
    "bed",
    "books",
    "ceiling",
    "chair",
    "floor",
    "furniture",
    "objects",
    "picture",
    "sofa",
    "table",
    "tv",
    "wall",
    "window",
];

/// A folder of pairs, read one at a time.
#[derive(Debug)]
pub(super) struct Dataset {
    root: PathBuf,
    pub(super) ids: Vec<String>,
    /// The names of depth and labels, where they differ from the images' ids.
    partners: BTreeMap<String, String>,
    units: DepthUnitArgs,
    window: Option<Window>,
    labels: Option<LabelFolder>,
    /// The camera of all images, where the dataset says it.
    camera: Option<Camera>,
    /// A recording's images as files; removed at the end.
    _unpacked: Option<TempDir>,
    /// Images of a recording without depth beside them.
    pub(super) unpaired: u64,
}

/// What is known of an image.
#[derive(Debug)]
pub(super) struct Truth {
    /// Width and height, pixels.
    pub(super) size: (u32, u32),
    /// Metres, NaN = none.
    pub(super) depth_m: Vec<f32>,
    /// The network's classes, [`IGNORE`] = none.
    pub(super) labels: Option<Vec<u8>>,
}

impl Dataset {
    /// Lists the pairs; with `with_labels` true labels are read too, where there are some.
    pub(super) fn open(arguments: &EvalArgs, classes: &[String]) -> anyhow::Result<Self> {
        if is_recording(&arguments.dataset) {
            let Unpacked { folder, camera, unpaired } = unpack(arguments)?;
            let inside = EvalArgs { dataset: folder.path().to_owned(), ..arguments.clone() };
            let dataset = Self::open(&inside, classes)?;
            return Ok(Self { camera, unpaired, _unpacked: Some(folder), ..dataset });
        }
        let root = arguments.dataset.clone();
        for folder in ["rgb", "depth"] {
            if !root.join(folder).is_dir() {
                bail!(WithHint::usage(
                    format!("`{}` is not a dataset: it has no folder `{folder}`", root.display()),
                    "expected rgb/ID.jpg or .png and depth/ID.png, or a recording"
                ));
            }
        }
        let ids = match &arguments.ids {
            Some(list) => read_ids(list)?,
            None => all_ids(&root)?,
        };
        let partners = pairs::by_time(
            &stems(&root, "rgb", &IMAGE_EXTENSIONS)?,
            &stems(&root, "depth", &NUMBER_ENDINGS)?,
        );
        // Depth that belongs to an image of another name is not an image without a partner.
        let paired: HashSet<&String> = partners.values().collect();
        let ids = ids.into_iter().filter(|id| !paired.contains(id)).collect();
        let labels = LabelFolder::find(&root, classes);
        let (units, window, camera) = (arguments.units, arguments.window, camera_of(&root)?);
        Ok(Self { root, ids, partners, units, window, labels, camera, _unpacked: None, unpaired: 0 })
    }

    /// Whether there are true labels of the network's classes.
    pub(super) fn has_labels(&self) -> bool {
        self.labels.is_some()
    }

    /// Reads an image.
    pub(super) fn picture(&self, id: &str, frame: &mut Frame) -> anyhow::Result<()> {
        let path = self.path("rgb", id, &IMAGE_EXTENSIONS);
        frame.camera = self.camera;
        decode(&path, frame).with_context(|| format!("cannot read the image `{}`", path.display()))
    }

    /// Reads what is known of an image, whose size it must have where that is known.
    pub(super) fn truth(&self, id: &str, picture: Option<(u32, u32)>) -> anyhow::Result<Truth> {
        let (path, depth) = self.numbers("depth", id)?;
        if let Some(picture) = picture {
            same_size(&path, depth.size, picture)?;
        }
        let mut depth_m = metres(&depth, self.units).with_context(|| format!("`{}`", path.display()))?;
        let labels = self.labels.as_ref().map(|folder| {
            let (path, labels) = self.numbers(folder.name, id)?;
            same_size(&path, labels.size, depth.size)?;
            folder.classes(&labels).with_context(|| format!("`{}`", path.display()))
        });
        let mut labels = labels.transpose()?;
        self.blank_outside(depth.size.0, &mut depth_m, f32::NAN);
        self.blank_outside(depth.size.0, labels.as_deref_mut().unwrap_or_default(), IGNORE);
        Ok(Truth { size: depth.size, depth_m, labels })
    }

    fn numbers(&self, folder: &str, id: &str) -> anyhow::Result<(PathBuf, Numbers)> {
        let path = self.path(folder, self.partners.get(id).map_or(id, String::as_str), &NUMBER_ENDINGS);
        let numbers =
            decode_numbers(&path).with_context(|| format!("cannot read the image `{}`", path.display()))?;
        Ok((path, numbers))
    }

    /// The file of an image, or what it is called where there is none.
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

/// The camera that the dataset states in `camera.json`, as rendered clips have it.
fn camera_of(root: &Path) -> anyhow::Result<Option<Camera>> {
    let path = root.join("camera.json");
    if !path.is_file() {
        return Ok(None);
    }
    let unreadable = || format!("cannot read `{}`", path.display());
    let text = std::fs::read_to_string(&path).with_context(unreadable)?;
    let file: CameraFile = serde_json::from_str(&text).with_context(unreadable)?;
    Ok(Some(file.camera().with_context(unreadable)?))
}

/// Names of the files of a folder without their extensions.
fn stems(root: &Path, folder: &str, endings: &[&str]) -> anyhow::Result<Vec<String>> {
    let folder = root.join(folder);
    let unreadable = || format!("cannot list the folder `{}`", folder.display());
    let mut stems = Vec::new();
    for entry in folder.read_dir().with_context(unreadable)? {
        let path = entry.with_context(unreadable)?.path();
        let ending = path.extension().map(|ending| ending.to_ascii_lowercase());
        if ending.is_some_and(|ending| endings.iter().any(|known| ending == *known)) {
            stems.extend(path.file_stem().map(|stem| stem.to_string_lossy().into_owned()));
        }
    }
    Ok(stems)
}

/// Two images that belong together have one size.
fn same_size(path: &Path, got: (u32, u32), expected: (u32, u32)) -> anyhow::Result<()> {
    if got != expected {
        let ((width, height), (expected_width, expected_height)) = (got, expected);
        bail!("`{}` is {width}x{height}, its image {expected_width}x{expected_height}", path.display());
    }
    Ok(())
}

/// `(value + offset) * scale`, NaN = none.
fn metres(depth: &Numbers, units: DepthUnitArgs) -> anyhow::Result<Vec<f32>> {
    let scale = match units.depth_scale {
        Some(scale) => scale,
        None if depth.bits == 16 => MILLIMETRE_M,
        None => {
            bail!(WithHint::new(
                "depth of 8 bits cannot be millimeters",
                "state the unit of the depth images: --depth-scale METERS"
            ))
        }
    };
    let zero_is_none = units.depth_offset == 0.0;
    let is_none = |value: u16| (value == 0 && zero_is_none) || value == NO_DEPTH;
    let metres = |value: u16| ((f64::from(value) + units.depth_offset) * scale) as f32;
    let depth_m = depth.values.iter();
    Ok(depth_m.map(|&value| if is_none(value) { f32::NAN } else { metres(value) }).collect())
}

/// Where true labels lie and what their numbers mean.
#[derive(Debug)]
struct LabelFolder {
    name: &'static str,
    /// The network's class of each number, [`IGNORE`] = none; `None` for numbers that mean nothing.
    table: Vec<Option<u8>>,
}

/// The network's class of each NYU40 class, counted from 0, for the 13 classes of Couprie et al., "Indoor semantic
/// segmentation using depth information", 2013. 39 is "otherprop" or unlabelled and names no one thing.
const NYU13_OF_NYU40: [u8; 39] = [
    11, 4, 5, 0, 3, 8, 9, 11, 12, 5, 7, 5, 12, 9, 5, 12, 5, 6, 6, 4, 6, 2, 1, 5, 10, 6, 6, 6, 6, 6, 6, 5, 6,
    6, 6, 6, 6, 6, 5,
];
impl LabelFolder {
    /// `labels/` holds the network's own classes, 255 = none; `label40/` NYU's 40 classes from 0.
    fn find(root: &Path, classes: &[String]) -> Option<Self> {
        let is_none = |label: u8| (label == IGNORE).then_some(IGNORE);
        let own = |label: u8| Some(label).filter(|&label| usize::from(label) < classes.len());
        let nyu = |label: u8| NYU13_OF_NYU40.get(usize::from(label)).copied();
        let other = |label: u8| (usize::from(label) == NYU13_OF_NYU40.len()).then_some(IGNORE);
        let numbers = 0..=IGNORE;
        if classes.is_empty() {
            None
        } else if root.join("labels").is_dir() {
            Some(Self { name: "labels", table: numbers.map(|label| own(label).or(is_none(label))).collect() })
        } else if root.join("label40").is_dir() && classes == CLASS_NAMES {
            let class = |label| nyu(label).or(other(label)).or(is_none(label));
            Some(Self { name: "label40", table: numbers.map(class).collect() })
        } else {
            None
        }
    }

    fn classes(&self, labels: &Numbers) -> anyhow::Result<Vec<u8>> {
        let class = |&label: &u16| match self.table.get(usize::from(label)) {
            Some(&Some(class)) => Ok(class),
            _ => Err(self.no_class(label)),
        };
        labels.values.iter().map(class).collect()
    }

    fn no_class(&self, label: u16) -> anyhow::Error {
        let known = self.table.iter().filter(|class| class.is_some()).count() - 1;
        let hint = match self.name {
            "labels" => "`labels/` holds the network's own classes; NYU's 40 belong into `label40/`",
            _ => "NYU's classes count from 0 here, 39 is \"otherprop\" or unlabelled",
        };
        anyhow::anyhow!("the label {label}; expected 0 to {}, or {IGNORE} for none\nhint: {hint}", known - 1)
    }
}

/// Ids of a list, one a line.
pub(super) fn read_ids(list: &Path) -> anyhow::Result<Vec<String>> {
    let unreadable = |error| BadArguments(format!("cannot read `{}`: {error:#}", list.display()));
    let text = read_list(list).map_err(unreadable)?;
    let lines = text.trim_start_matches(BYTE_ORDER_MARK).lines().map(str::trim);
    let ids: Vec<String> = lines.filter(|id| !id.is_empty()).map(str::to_owned).collect();
    let mut seen = HashSet::new();
    if let Some(twice) = ids.iter().find(|id| !seen.insert(id.as_str())) {
        bail!(BadArguments(format!("`{}` names the picture `{twice}` twice", list.display())));
    }
    if ids.is_empty() {
        bail!(BadArguments(format!("`{}` names no picture", list.display())));
    }
    Ok(ids)
}

fn read_list(list: &Path) -> anyhow::Result<String> {
    let Some(mut file) = plain_file::open(list, MAX_LIST_BYTES + 1)? else { bail!("it is no plain file") };
    let mut text = String::new();
    if file.read_to_string(&mut text)? as u64 > MAX_LIST_BYTES {
        bail!("a file of more than {MAX_LIST_BYTES} bytes is no list of ids");
    }
    Ok(text)
}

/// Ids of all images and of all depth, sorted: whose partner is missing is found when its turn comes. Files of other
/// formats are counted.
fn all_ids(root: &Path) -> anyhow::Result<Vec<String>> {
    let mut ids = BTreeSet::new();
    for (folder, endings) in [("rgb", &IMAGE_EXTENSIONS[..]), ("depth", &NUMBER_ENDINGS)] {
        let folder = root.join(folder);
        let unreadable = || format!("cannot list the folder `{}`", folder.display());
        let mut others = 0;
        for entry in folder.read_dir().with_context(unreadable)? {
            let path = entry.with_context(unreadable)?.path();
            let ending = path.extension().map(|ending| ending.to_string_lossy());
            let spelt =
                |known: &str| ending.as_ref().is_some_and(|is| *is == known || *is == known.to_uppercase());
            let known = endings.iter().any(|known| spelt(known));
            others += u64::from(!known);
            ids.extend(path.file_stem().filter(|_| known).map(|stem| stem.to_string_lossy().into_owned()));
        }
        if others > 0 {
            let expected = endings.iter().map(|ending| format!("`.{ending}`")).collect::<Vec<_>>().join(", ");
            warn!("`{}` holds files that do not end in {expected}: {others} passed over", folder.display());
        }
    }
    if ids.is_empty() {
        bail!(BadArguments(format!("`{}` holds no pictures", root.display())));
    }
    Ok(ids.into_iter().collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_id_is_a_line_of_a_list_and_may_have_spaces() {
        let list = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(list.path(), "\u{feff}kitchen 1\r\n\n  b  \n").unwrap();
        assert_eq!(read_ids(list.path()).unwrap(), ["kitchen 1", "b"]);
    }

    #[test]
    fn no_depth_is_0_unless_there_is_an_offset_and_65535_always() {
        let metres = |depth_offset| {
            let depth = Numbers { size: (3, 1), values: vec![0, 1500, 65535], bits: 16 };
            metres(&depth, DepthUnitArgs { depth_scale: None, depth_offset }).unwrap()
        };
        let millimetres = metres(0.0);
        assert!(
            millimetres[0].is_nan() && millimetres[1] == 1.5 && millimetres[2].is_nan(),
            "{millimetres:?}"
        );
        let offset = metres(500.0);
        assert!(offset[0] == 0.5 && offset[1] == 2.0 && offset[2].is_nan(), "{offset:?}");
    }
}
