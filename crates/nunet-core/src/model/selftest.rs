//! The self-test: one procedural picture and the answer that the network gave to it when it was exported.

use std::collections::BTreeMap;

/// Cells of the answer's grid from left to right.
pub const GRID_WIDTH: usize = 8;
/// Cells of the answer's grid from top to bottom.
pub const GRID_HEIGHT: usize = 6;

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
#[derive(Debug, Clone, Copy, PartialEq, serde::Deserialize)]
#[serde(deny_unknown_fields)]
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

/// A self-test that failed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SelfTestMismatch {}
