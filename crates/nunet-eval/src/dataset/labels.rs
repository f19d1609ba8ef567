//! True labels: their folder, and the network's class of each number.

use std::path::Path;

use nunet_source::SingleChannelImage;
use nunet_types::NYU13_CLASSES;

use crate::error::EvalError;
use crate::metrics::IGNORE;

/// The network's own classes.
const OWN_FOLDER: &str = "labels";
/// The 40 classes of NYU Depth V2.
const NYU40_FOLDER: &str = "label40";

/// The folder of true labels, and the classes of their numbers.
#[derive(Debug)]
pub(super) struct LabelFolder {
    pub(super) name: &'static str,
    /// The network's class of each number, [`IGNORE`] = none; `None` for invalid numbers.
    table: Vec<Option<u8>>,
}

/// The network's class of each NYU40 class, counted from 0, for the 13 classes of Couprie et al., "Indoor
/// semantic segmentation using depth information", 2013. 39 is "otherprop" or unlabeled, so it has no class.
const NYU13_OF_NYU40: [u8; 39] = [
    11, 4, 5, 0, 3, 8, 9, 11, 12, 5, 7, 5, 12, 9, 5, 12, 5, 6, 6, 4, 6, 2, 1, 5, 10, 6, 6, 6, 6, 6, 6, 5, 6,
    6, 6, 6, 6, 6, 5,
];

impl LabelFolder {
    /// `labels/` holds the network's own classes, 255 = none; `label40/` NYU's 40 classes from 0.
    pub(super) fn find(root: &Path, classes: &[String]) -> Option<Self> {
        let is_none = |label: u8| (label == IGNORE).then_some(IGNORE);
        let own = |label: u8| Some(label).filter(|&label| usize::from(label) < classes.len());
        let nyu = |label: u8| NYU13_OF_NYU40.get(usize::from(label)).copied();
        let other = |label: u8| (usize::from(label) == NYU13_OF_NYU40.len()).then_some(IGNORE);
        let numbers = 0..=IGNORE;
        if classes.is_empty() {
            None
        } else if root.join(OWN_FOLDER).is_dir() {
            Some(Self {
                name: OWN_FOLDER,
                table: numbers.map(|label| own(label).or(is_none(label))).collect(),
            })
        } else if root.join(NYU40_FOLDER).is_dir() && classes == NYU13_CLASSES {
            let class = |label| nyu(label).or(other(label)).or(is_none(label));
            Some(Self { name: NYU40_FOLDER, table: numbers.map(class).collect() })
        } else {
            None
        }
    }

    /// The network's class of each label. `path` is the file, for errors.
    pub(super) fn classes(&self, labels: &SingleChannelImage, path: &Path) -> Result<Vec<u8>, EvalError> {
        let class = |&label: &u16| match self.table.get(usize::from(label)) {
            Some(&Some(class)) => Ok(class),
            _ => Err(EvalError::UnknownLabel {
                path: path.to_owned(),
                label,
                // One of the known numbers stands for no label.
                last: self.table.iter().flatten().count().saturating_sub(2),
                is_nyu40: self.name == NYU40_FOLDER,
            }),
        };
        labels.values.iter().map(class).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn classes(folder: &str, names: &[String], label: u16) -> Result<Vec<u8>, EvalError> {
        let root = tempfile::tempdir().unwrap();
        std::fs::create_dir(root.path().join(folder)).unwrap();
        let labels = LabelFolder::find(root.path(), names).unwrap();
        labels.classes(
            &SingleChannelImage { size: (1, 1).into(), values: vec![label], bits: 8 },
            Path::new("a.png"),
        )
    }

    #[test]
    fn the_numbers_of_the_own_classes_are_the_classes() {
        let names = ["floor", "wall"].map(str::to_owned);
        assert_eq!(classes(OWN_FOLDER, &names, 1).unwrap(), [1]);
        assert_eq!(classes(OWN_FOLDER, &names, 255).unwrap(), [IGNORE]);
        let error = classes(OWN_FOLDER, &names, 2).unwrap_err();
        assert!(
            matches!(error, EvalError::UnknownLabel { label: 2, last: 1, is_nyu40: false, .. }),
            "{error}"
        );
    }

    #[test]
    fn the_40_classes_fold_into_13() {
        let names = NYU13_CLASSES.map(str::to_owned);
        for (label, expected) in [(0, 11), (3, 0), (38, 5), (39, IGNORE), (255, IGNORE)] {
            assert_eq!(classes(NYU40_FOLDER, &names, label).unwrap(), [expected], "{label}");
        }
        let error = classes(NYU40_FOLDER, &names, 40).unwrap_err();
        assert!(matches!(error, EvalError::UnknownLabel { label: 40, is_nyu40: true, .. }), "{error}");
    }
}
