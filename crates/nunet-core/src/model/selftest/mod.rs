//! The self-test: one procedural image and the network's answer to it at export.
//!
//! It detects a provider, processor or quantization that computes something else. Image, grid and format are
//! specified to the byte in `docs/book/model-file.md`.

mod grid;
mod image;

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt;

use nunet_types::{Hint, NO_LABEL, counted};
use serde::Deserialize;

use crate::error_kind::ErrorKind;

use grid::cells;
pub use grid::{GRID_HEIGHT, GRID_WIDTH, SelfTestGrid};
pub use image::image;

/// The supported version of the answer's format.
const VERSION: u32 = 1;
/// The name of [`image`].
const IMAGE: &str = "nunet-selftest-1";

/// A tolerance that is larger than this and than all depths of the answer would let any answer pass. Not 0,
/// because depth without a unit may be 0 everywhere, and not 1, because depth of `minmax` is at most 1.
const MIN_TOLERANCE_LIMIT: f32 = 0.01;

/// The expected answer in a model file.
#[derive(Debug, Clone, PartialEq)]
pub struct SelfTest {
    /// The precision of the file itself, `fp32`, `int8`, ...
    pub precision: String,
    /// The network's answer at export.
    pub answer: SelfTestGrid,
    /// The tolerance for another runtime, by the precision in which it computes.
    pub tolerance: BTreeMap<String, Tolerance>,
}

/// How far an answer may differ.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub struct Tolerance {
    /// The largest difference of a cell's depth, in the unit of the depth.
    pub depth: f32,
    /// How many cells may differ in label.
    pub label_cells: u32,
}

/// The result of a self-test that did not fail.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SelfTestReport {
    /// `false` if the model has no answer to compare with: the run was only a warm-up.
    pub checked: bool,
    /// The largest difference of a cell's depth.
    pub worst_depth: f32,
    /// The difference that is allowed.
    pub tolerance: f32,
    /// Cells whose label differs.
    pub label_cells: u32,
}

impl SelfTestReport {
    /// The report of a model without an answer.
    pub(crate) const UNCHECKED: Self =
        Self { checked: false, worst_depth: 0.0, tolerance: 0.0, label_cells: 0 };
}

impl fmt::Display for SelfTestReport {
    /// `passed: depth differs by 3.00e-4, allowed 2.00e-3` or `none in the file`
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if !self.checked {
            return f.write_str("none in the file");
        }
        write!(f, "passed: depth differs by {:.2e}, allowed {:.2e}", self.worst_depth, self.tolerance)
    }
}

impl SelfTest {
    /// Parses the value of `nunet.selftest`.
    ///
    /// # Errors
    /// What is wrong, as text for [`super::ModelError::Invalid`].
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        let file: SelftestFile = serde_json::from_str(text).map_err(|error| error.to_string())?;
        if file.version != VERSION || file.image != IMAGE {
            return Err(format!("expected version {VERSION} of the image `{IMAGE}`"));
        }
        if !file.tolerance.contains_key(&file.precision) {
            return Err(format!("no tolerance for the file's own precision `{}`", file.precision));
        }
        let sound = |tolerance: &Tolerance| tolerance.depth.is_finite() && tolerance.depth >= 0.0;
        if !file.tolerance.values().all(sound)
            || !file.depth.iter().flatten().flatten().all(|z| z.is_finite())
        {
            return Err("depths and tolerances must be finite".to_owned());
        }
        let largest =
            file.depth.iter().flatten().flatten().fold(MIN_TOLERANCE_LIMIT, |most, z| most.max(z.abs()));
        let useful = |it: &Tolerance| it.depth <= largest && it.label_cells <= cells().count() as u32;
        if !file.tolerance.values().all(useful) {
            return Err(format!(
                "a tolerance is larger than the answers, {largest}, or than the grid's cells"
            ));
        }
        let answer = SelfTestGrid { depth: file.depth, labels: file.labels };
        Ok(Self { precision: file.precision, answer, tolerance: file.tolerance })
    }

    /// Checks that each label of the answer is one of `classes` classes, if there are any.
    pub(super) fn check_labels(&self, classes: usize) -> Result<(), String> {
        let is_known = |label: u8| classes == 0 || usize::from(label) < classes || label == NO_LABEL;
        match self.answer.labels.iter().flatten().flatten().find(|&&label| !is_known(label)) {
            Some(label) => Err(format!("the answer has label {label}, but there are {classes} classes")),
            None => Ok(()),
        }
    }

    /// The same test for a graph that does not use the labels.
    #[must_use]
    pub fn without_labels(mut self) -> Self {
        self.answer.labels = None;
        self
    }

    /// Compares an answer with that at export, with the tolerance of the file's own precision.
    ///
    /// # Errors
    /// The cell whose depth differs most, or the first one whose label differs.
    pub fn compare(&self, got: &SelfTestGrid) -> Result<SelfTestReport, SelfTestMismatch> {
        let tolerance = self.tolerance[&self.precision];
        let worst_depth = self.compare_depth(got, tolerance.depth)?;
        let label_cells = self.compare_labels(got, tolerance.label_cells)?;
        Ok(SelfTestReport { checked: true, worst_depth, tolerance: tolerance.depth, label_cells })
    }

    fn compare_depth(&self, got: &SelfTestGrid, tolerance: f32) -> Result<f32, SelfTestMismatch> {
        let mut worst = Worst { off: 0.0, row: 0, column: 0 };
        for (row, column) in cells() {
            let off = match (got.depth[row][column], self.answer.depth[row][column]) {
                (Some(got), Some(expected)) => (got - expected).abs(),
                (None, None) => 0.0,
                _ => f32::INFINITY,
            };
            if off > worst.off {
                worst = Worst { off, row, column };
            }
        }
        if worst.off <= tolerance {
            return Ok(worst.off);
        }
        let Worst { row, column, .. } = worst;
        Err(SelfTestMismatch::Depth {
            row,
            column,
            got: CellDepth(got.depth[row][column]),
            expected: CellDepth(self.answer.depth[row][column]),
            tolerance,
        })
    }

    fn compare_labels(&self, got: &SelfTestGrid, allowed: u32) -> Result<u32, SelfTestMismatch> {
        let (Some(got), Some(expected)) = (&got.labels, &self.answer.labels) else {
            return if got.labels.is_some() == self.answer.labels.is_some() {
                Ok(0)
            } else {
                Err(SelfTestMismatch::LabelsMissing)
            };
        };
        let mut differing = cells().filter(|&(row, column)| got[row][column] != expected[row][column]);
        let count = differing.clone().count() as u32;
        match differing.next() {
            Some((row, column)) if count > allowed => Err(SelfTestMismatch::Label {
                row,
                column,
                got: got[row][column],
                expected: expected[row][column],
                cells: count,
                allowed,
            }),
            _ => Ok(count),
        }
    }
}

struct Worst {
    off: f32,
    row: usize,
    column: usize,
}

#[derive(Deserialize)]
struct SelftestFile {
    version: u32,
    /// The name of the test image.
    #[serde(rename = "picture")]
    image: String,
    precision: String,
    depth: [[Option<f32>; GRID_WIDTH]; GRID_HEIGHT],
    labels: Option<[[u8; GRID_WIDTH]; GRID_HEIGHT]>,
    tolerance: BTreeMap<String, Tolerance>,
}

/// A cell's depth for messages.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CellDepth(
    /// `None` if nothing was measured.
    pub Option<f32>,
);

impl std::fmt::Display for CellDepth {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.0 {
            Some(depth) => write!(f, "{depth}"),
            None => f.write_str("none"),
        }
    }
}

/// A self-test that failed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what each field is")]
pub enum SelfTestMismatch {
    /// A cell's depth differs by more than the tolerance; the cell that differs most.
    #[error("depth of cell (row {row}, column {column}) is {got}, expected {expected} within {tolerance}")]
    Depth { row: usize, column: usize, got: CellDepth, expected: CellDepth, tolerance: f32 },
    /// More cells than allowed have another label; the first of them.
    #[error(
        "{} with another label, expected at most {allowed}; the first is (row {row}, column {column}) with {got}, expected \
         {expected}",
        counted(*cells, "cell")
    )]
    Label { row: usize, column: usize, got: u8, expected: u8, cells: u32, allowed: u32 },
    /// Only one of the graph and the answer has labels.
    #[error("only one of the graph and the answer in its metadata has labels")]
    LabelsMissing,
}

impl SelfTestMismatch {
    /// [`ErrorKind::Inference`].
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        ErrorKind::Inference
    }
}

impl Hint for SelfTestMismatch {
    fn hint(&self) -> Option<Cow<'static, str>> {
        match self {
            Self::Depth { .. } | Self::Label { .. } => {
                Some("try another execution provider; models are exported with `cpu`".into())
            }
            Self::LabelsMissing => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The answer of a network that says 2 m and class 3 everywhere.
    fn answer() -> SelfTest {
        SelfTest {
            precision: "fp32".to_owned(),
            answer: SelfTestGrid {
                depth: [[Some(2.0); GRID_WIDTH]; GRID_HEIGHT],
                labels: Some([[3; GRID_WIDTH]; GRID_HEIGHT]),
            },
            tolerance: BTreeMap::from([("fp32".to_owned(), Tolerance { depth: 0.01, label_cells: 1 })]),
        }
    }

    #[test]
    fn an_output_within_tolerance_passes_and_reports_its_error() {
        let mut got = answer().answer;
        got.depth[4][5] = Some(2.008);
        got.labels.as_mut().unwrap()[0][0] = 0;
        let report = answer().compare(&got).unwrap();
        assert!((report.worst_depth - 0.008).abs() < 1e-6);
        assert_eq!((report.checked, report.label_cells), (true, 1));
    }

    #[test]
    fn a_cell_that_is_off_is_named_with_both_numbers() {
        let mut grid = answer().answer;
        grid.depth[1][2] = Some(2.5);
        grid.depth[4][5] = Some(1.0);
        let (got, expected) = (CellDepth(Some(1.0)), CellDepth(Some(2.0)));
        let mismatch = SelfTestMismatch::Depth { row: 4, column: 5, got, expected, tolerance: 0.01 };
        assert_eq!(answer().compare(&grid), Err(mismatch));
    }

    #[test]
    fn a_cell_without_measurement_differs_from_one_with() {
        let mut grid = answer().answer;
        grid.depth[0][7] = None;
        let (got, expected) = (CellDepth(None), CellDepth(Some(2.0)));
        let mismatch = SelfTestMismatch::Depth { row: 0, column: 7, got, expected, tolerance: 0.01 };
        assert_eq!(answer().compare(&grid), Err(mismatch));
    }

    #[test]
    fn too_many_other_labels_are_refused_naming_the_first() {
        let mut got = answer().answer;
        let labels = got.labels.as_mut().unwrap();
        (labels[2][1], labels[3][3]) = (0, 1);
        let mismatch =
            SelfTestMismatch::Label { row: 2, column: 1, got: 0, expected: 3, cells: 2, allowed: 1 };
        assert_eq!(answer().compare(&got), Err(mismatch));
    }

    #[test]
    fn labels_on_one_side_alone_are_a_mismatch() {
        let mut got = answer().answer;
        got.labels = None;
        assert_eq!(answer().compare(&got), Err(SelfTestMismatch::LabelsMissing));
    }

    #[test]
    fn labels_of_the_answer_are_classes_of_the_model() {
        assert_eq!(answer().check_labels(4), Ok(()));
        assert_eq!(answer().check_labels(0), Ok(()), "a model that does not name its classes");
        let error = answer().check_labels(3).unwrap_err();
        assert_eq!(error, "the answer has label 3, but there are 3 classes");
    }

    #[test]
    fn malformed_expected_outputs_are_refused() {
        let good = serde_json::json!({
            "version": 1, "picture": IMAGE, "precision": "fp32", "depth": vec![vec![2.0; 8]; 6],
            "tolerance": {"fp32": {"depth": 0.01, "label_cells": 0}},
        });
        assert!(SelfTest::parse(&good.to_string()).is_ok());
        for (key, value) in [
            ("version", serde_json::json!(2)),
            ("picture", serde_json::json!("noise")),
            ("precision", serde_json::json!("int8")),
            ("depth", serde_json::json!(vec![vec![2.0; 7]; 6])),
            ("tolerance", serde_json::json!({"fp32": {"depth": -1.0, "label_cells": 0}})),
            ("tolerance", serde_json::json!({"fp32": {"depth": 1e30, "label_cells": 0}})),
            ("tolerance", serde_json::json!({"fp32": {"depth": 2.5, "label_cells": 0}})),
            ("tolerance", serde_json::json!({"fp32": {"depth": 0.01, "label_cells": 49}})),
        ] {
            let mut bad = good.clone();
            bad[key] = value;
            assert!(SelfTest::parse(&bad.to_string()).is_err(), "{key}");
        }
    }

    #[test]
    fn a_tolerance_that_lets_any_depth_pass_is_refused_also_for_small_depth() {
        let parse = |depth: f32, tolerance: f32| {
            let file = serde_json::json!({
                "version": 1, "picture": IMAGE, "precision": "fp32", "depth": vec![vec![depth; 8]; 6],
                "tolerance": {"fp32": {"depth": tolerance, "label_cells": 0}},
            });
            SelfTest::parse(&file.to_string())
        };
        assert!(parse(0.5, 0.4).is_ok() && parse(0.0, 0.001).is_ok());
        for (depth, tolerance) in [(0.5, 0.6), (0.5, 1.0), (-0.5, 0.6), (0.0, 0.1)] {
            let error = parse(depth, tolerance).unwrap_err();
            assert!(error.starts_with("a tolerance is larger than the answers"), "{error}");
        }
    }
}
