//! The self-test: one procedural picture and the answer that the network gave to it when it was exported.
//!
//! It catches a provider, a processor or a quantisation that computes something else. Picture, grid and format are
//! those of `docs/model-file.md`, to the byte.

use std::collections::BTreeMap;
use std::fmt;

use serde::Deserialize;

/// Cells of the answer's grid from left to right.
pub const GRID_WIDTH: usize = 8;
/// Cells of the answer's grid from top to bottom.
pub const GRID_HEIGHT: usize = 6;
/// The format of the answer that this program reads.
const VERSION: u32 = 1;
/// The name of [`picture`].
const PICTURE: &str = "nunet-selftest-1";

/// The answer that a model file carries.
#[derive(Debug, Clone, PartialEq)]
pub struct SelfTest {
    /// The precision of the file itself, `fp32`, `int8`, ...
    pub precision: String,
    /// What the network answered at export.
    pub answer: SelfTestGrid,
    /// How far another runtime may be off, by the precision in which it computes.
    pub tolerance: BTreeMap<String, Tolerance>,
}

/// An answer to the self-test picture: 8 x 6 cells.
#[derive(Debug, Clone, PartialEq)]
pub struct SelfTestGrid {
    /// `[row][column]`: the lower median of the decoded depth's finite values, `None` where there is none.
    pub depth: [[Option<f32>; GRID_WIDTH]; GRID_HEIGHT],
    /// `[row][column]`: the most frequent label, the lowest of equals.
    pub labels: Option<[[u8; GRID_WIDTH]; GRID_HEIGHT]>,
}

/// How far an answer may be off.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub struct Tolerance {
    /// The largest difference of a cell's depth, in the unit of the depth.
    pub depth: f32,
    /// How many cells may differ in label.
    pub label_cells: u32,
}

/// A self-test that passed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SelfTestReport {
    /// `false` where the model carries no answer: the run was a warm-up and nothing more.
    pub checked: bool,
    /// The largest difference of a cell's depth.
    pub worst_depth: f32,
    /// The difference that is allowed.
    pub tolerance: f32,
    /// Cells whose label differs.
    pub label_cells: u32,
}

impl SelfTestReport {
    /// The report of a model that carries no answer.
    pub(crate) const UNCHECKED: Self = Self {
        checked: false,
        worst_depth: 0.0,
        tolerance: 0.0,
        label_cells: 0,
    };
}

impl fmt::Display for SelfTestReport {
    /// `passed, off by 0.0003 of 0.002 allowed` or `none in the file`
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if !self.checked {
            return f.write_str("none in the file");
        }
        write!(
            f,
            "passed, off by {:.2e} of {:.2e} allowed",
            self.worst_depth, self.tolerance
        )
    }
}

/// The picture `nunet-selftest-1`: `[height][width][3]`, RGB, rows top to bottom. No side may be 0.
///
/// Integers alone, so that every language draws the same; no symmetry in colour, left to right or top to bottom, so
/// that swapped channels or a mirrored picture give another answer.
#[must_use]
pub fn picture(width: u32, height: u32) -> Vec<u8> {
    let mut rgb = Vec::with_capacity(3 * width as usize * height as usize);
    for y in 0..u64::from(height) {
        for x in 0..u64::from(width) {
            let u = 256 * x / u64::from(width);
            let v = 256 * y / u64::from(height);
            rgb.extend(pixel(u as i32, v as i32).map(|value| value as u8));
        }
    }
    rgb
}

/// The colour at (u, v), both 0 to 255.
fn pixel(u: i32, v: i32) -> [i32; 3] {
    let fine = (7 * u + 13 * v + u * v / 32) % 23;
    let in_disc = (u - 140).pow(2) + (v - 180).pow(2) < 28 * 28;
    if in_disc {
        [30 + fine, 150 - u / 4, 40 + v / 4]
    } else if (168..232).contains(&u) && (24..104).contains(&v) {
        [60 + fine, 140 + v / 5, 200 + u / 8]
    } else if (24..92).contains(&u) && (88..208).contains(&v) {
        [170 - v / 4 + fine, 40 + u / 4, 40 + fine]
    } else if v >= 168 {
        let check = ((u + v) / 24 + (v - 168) / 12) % 2;
        [
            90 + 40 * check + fine,
            70 + 30 * check + fine,
            50 + 10 * check + v / 8,
        ]
    } else {
        [150 - u / 4 + fine, 130 - v / 4 + fine, 100 + u / 8 + fine]
    }
}

impl SelfTest {
    /// Reads the value of `nunet.selftest`.
    ///
    /// # Errors
    /// What is wrong, in words.
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        let file: File = serde_json::from_str(text).map_err(|error| error.to_string())?;
        if file.version != VERSION || file.picture != PICTURE {
            return Err(format!(
                "version {VERSION} of picture `{PICTURE}` is all that this program knows"
            ));
        }
        if !file.tolerance.contains_key(&file.precision) {
            return Err(format!(
                "no tolerance for the file's own precision `{}`",
                file.precision
            ));
        }
        let sound = |tolerance: &Tolerance| tolerance.depth.is_finite() && tolerance.depth >= 0.0;
        if !file.tolerance.values().all(sound)
            || !file.depth.iter().flatten().flatten().all(|z| z.is_finite())
        {
            return Err("depths and tolerances must be finite".to_owned());
        }
        let answer = SelfTestGrid {
            depth: file.depth,
            labels: file.labels,
        };
        Ok(Self {
            precision: file.precision,
            answer,
            tolerance: file.tolerance,
        })
    }

    /// Compares an answer of this machine with the one of the export, computing in the file's own precision.
    ///
    /// # Errors
    /// The cell that differs most, or the first one whose label differs.
    pub fn compare(&self, got: &SelfTestGrid) -> Result<SelfTestReport, SelfTestMismatch> {
        let tolerance = self.tolerance[&self.precision];
        let worst_depth = self.compare_depth(got, tolerance.depth)?;
        let label_cells = self.compare_labels(got, tolerance.label_cells)?;
        Ok(SelfTestReport {
            checked: true,
            worst_depth,
            tolerance: tolerance.depth,
            label_cells,
        })
    }

    fn compare_depth(&self, got: &SelfTestGrid, tolerance: f32) -> Result<f32, SelfTestMismatch> {
        let mut worst = Worst {
            off: 0.0,
            row: 0,
            column: 0,
        };
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
            got: Cell(got.depth[row][column]),
            expected: Cell(self.answer.depth[row][column]),
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

fn cells() -> impl Iterator<Item = (usize, usize)> + Clone {
    (0..GRID_HEIGHT).flat_map(|row| (0..GRID_WIDTH).map(move |column| (row, column)))
}

impl SelfTestGrid {
    /// The grid of a decoded depth map, NaN where there is no measurement, and of its labels: both `[height][width]`.
    #[must_use]
    pub fn of(depth: &[f32], labels: Option<&[u8]>, width: u32, height: u32) -> Self {
        let (width, height) = (width as usize, height as usize);
        let mut grid = Self {
            depth: [[None; GRID_WIDTH]; GRID_HEIGHT],
            labels: labels.map(|_| [[0; GRID_WIDTH]; GRID_HEIGHT]),
        };
        for (row, column) in cells() {
            let rows = row * height / GRID_HEIGHT..(row + 1) * height / GRID_HEIGHT;
            let columns = column * width / GRID_WIDTH..(column + 1) * width / GRID_WIDTH;
            let spans = rows.map(|y| y * width + columns.start..y * width + columns.end);
            grid.depth[row][column] = lower_median(spans.clone().flat_map(|span| &depth[span]).copied());
            if let (Some(grid), Some(labels)) = (&mut grid.labels, labels) {
                grid[row][column] = majority(spans.flat_map(|span| &labels[span]).copied());
            }
        }
        grid
    }
}

/// `sorted[(n - 1) / 2]` of the finite values.
fn lower_median(values: impl Iterator<Item = f32>) -> Option<f32> {
    let mut finite: Vec<f32> = values.filter(|value| value.is_finite()).collect();
    let middle = finite.len().checked_sub(1)? / 2;
    Some(*finite.select_nth_unstable_by(middle, f32::total_cmp).1)
}

/// The most frequent value, the lowest of equals.
fn majority(values: impl Iterator<Item = u8>) -> u8 {
    let mut counts = [0_u32; 256];
    values.for_each(|value| counts[usize::from(value)] += 1);
    let most = counts.iter().max().copied().unwrap_or(0);
    counts.iter().position(|&count| count == most).unwrap_or(0) as u8
}

#[derive(Deserialize)]
struct File {
    version: u32,
    picture: String,
    precision: String,
    depth: [[Option<f32>; GRID_WIDTH]; GRID_HEIGHT],
    labels: Option<[[u8; GRID_WIDTH]; GRID_HEIGHT]>,
    tolerance: BTreeMap<String, Tolerance>,
}

/// A cell's depth as messages show it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cell(
    /// `None` where nothing was measured.
    pub Option<f32>,
);

impl std::fmt::Display for Cell {
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
    /// A cell's depth is off by more than the tolerance; the cell that is off most.
    #[error(
        "self-test: depth of cell (row {row}, column {column}) is `{got}`, expected `{expected}` within \
         `{tolerance}`\nhint: try another `--provider`; `cpu` is the one that models are exported with"
    )]
    Depth {
        row: usize,
        column: usize,
        got: Cell,
        expected: Cell,
        tolerance: f32,
    },
    /// More cells than allowed have another label; the first of them.
    #[error(
        "self-test: `{cells}` cells have another label, `{allowed}` may; the first is (row {row}, column {column}) \
         with `{got}`, expected `{expected}`\nhint: try another `--provider`; `cpu` is the one that models are \
         exported with"
    )]
    Label {
        row: usize,
        column: usize,
        got: u8,
        expected: u8,
        cells: u32,
        allowed: u32,
    },
    /// Either the graph or the answer has labels, not both.
    #[error("self-test: the graph and the answer in its metadata do not both have labels")]
    LabelsMissing,
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
            tolerance: BTreeMap::from([(
                "fp32".to_owned(),
                Tolerance {
                    depth: 0.01,
                    label_cells: 1,
                },
            )]),
        }
    }

    #[test]
    fn the_picture_is_the_documented_one_to_the_byte() {
        let rgb = picture(640, 480);
        let first = [
            150, 130, 100, 150, 130, 100, 150, 130, 100, 157, 137, 107, 157, 137, 107, 164,
        ];
        assert_eq!(rgb[..16], first);
        let digest: String = {
            use sha2::Digest;
            sha2::Sha256::digest(&rgb)
                .iter()
                .map(|byte| format!("{byte:02x}"))
                .collect()
        };
        assert_eq!(
            digest,
            "f13ba5a29ec76e875ed3a4cebc8c294e8be9e184d3485a166b7446ac8cd72536"
        );
    }

    #[test]
    fn the_grid_takes_lower_medians_and_the_lowest_of_equally_frequent_labels() {
        // 16 x 6 pixels: two to a cell. The left one is the smaller depth and the larger label.
        let depth: Vec<f32> = (0..96).map(|i| if i % 2 == 0 { 1.0 } else { 5.0 }).collect();
        let labels: Vec<u8> = (0..96).map(|i| if i % 2 == 0 { 9 } else { 4 }).collect();
        let grid = SelfTestGrid::of(&depth, Some(&labels), 16, 6);
        assert_eq!(grid.depth, [[Some(1.0); GRID_WIDTH]; GRID_HEIGHT]);
        assert_eq!(grid.labels, Some([[4; GRID_WIDTH]; GRID_HEIGHT]));
    }

    #[test]
    fn a_cell_covers_its_own_pixels_and_no_others() {
        let mut depth = vec![1.0; 16 * 12];
        for (x, y) in [(6, 4), (7, 4), (6, 5), (7, 5)] {
            depth[y * 16 + x] = f32::NAN;
        }
        let grid = SelfTestGrid::of(&depth, None, 16, 12);
        let holes: Vec<_> = cells()
            .filter(|&(row, column)| grid.depth[row][column].is_none())
            .collect();
        assert_eq!(holes, [(2, 3)]);
    }

    #[test]
    fn an_answer_within_tolerance_passes_and_says_how_far_it_is_off() {
        let mut got = answer().answer;
        got.depth[4][5] = Some(2.008);
        got.labels.as_mut().unwrap()[0][0] = 0;
        let report = answer().compare(&got).unwrap();
        assert!((report.worst_depth - 0.008).abs() < 1e-6);
        assert_eq!((report.checked, report.label_cells), (true, 1));
    }

    #[test]
    fn a_cell_that_is_off_is_named_with_both_numbers() {
        let mut got = answer().answer;
        got.depth[1][2] = Some(2.5);
        got.depth[4][5] = Some(1.0);
        let error = answer().compare(&got).unwrap_err().to_string();
        assert!(
            error.contains("cell (row 4, column 5) is `1`, expected `2` within `0.01`"),
            "{error}"
        );
    }

    #[test]
    fn a_cell_without_measurement_differs_from_one_with() {
        let mut got = answer().answer;
        got.depth[0][7] = None;
        let error = answer().compare(&got).unwrap_err().to_string();
        assert!(
            error.contains("cell (row 0, column 7) is `none`, expected `2`"),
            "{error}"
        );
    }

    #[test]
    fn too_many_other_labels_are_refused_naming_the_first() {
        let mut got = answer().answer;
        let labels = got.labels.as_mut().unwrap();
        (labels[2][1], labels[3][3]) = (0, 1);
        let error = answer().compare(&got).unwrap_err().to_string();
        assert!(
            error.contains("`2` cells have another label, `1` may; the first is (row 2, column 1)"),
            "{error}"
        );
    }

    #[test]
    fn labels_on_one_side_alone_are_a_mismatch() {
        let mut got = answer().answer;
        got.labels = None;
        assert_eq!(answer().compare(&got), Err(SelfTestMismatch::LabelsMissing));
    }

    #[test]
    fn broken_answers_are_refused() {
        let good = serde_json::json!({
            "version": 1, "picture": PICTURE, "precision": "fp32", "depth": vec![vec![2.0; 8]; 6],
            "tolerance": {"fp32": {"depth": 0.01, "label_cells": 0}},
        });
        assert!(SelfTest::parse(&good.to_string()).is_ok());
        for (key, value) in [
            ("version", serde_json::json!(2)),
            ("picture", serde_json::json!("noise")),
            ("precision", serde_json::json!("int8")),
            ("depth", serde_json::json!(vec![vec![2.0; 7]; 6])),
            (
                "tolerance",
                serde_json::json!({"fp32": {"depth": -1.0, "label_cells": 0}}),
            ),
        ] {
            let mut bad = good.clone();
            bad[key] = value;
            assert!(SelfTest::parse(&bad.to_string()).is_err(), "{key}");
        }
    }
}
