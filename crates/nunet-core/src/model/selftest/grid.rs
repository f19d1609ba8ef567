//! The answer: medians and majorities of 8 x 6 cells.

/// Cells of the answer's grid from left to right.
pub const GRID_WIDTH: usize = 8;
/// Cells of the answer's grid from top to bottom.
pub const GRID_HEIGHT: usize = 6;
/// An answer to the self-test image: 8 x 6 cells.
#[derive(Debug, Clone, PartialEq)]
pub struct SelfTestGrid {
    /// `[row][column]`: the lower median of the decoded depth's finite values, `None` where there is none.
    pub depth: [[Option<f32>; GRID_WIDTH]; GRID_HEIGHT],
    /// `[row][column]`: the most frequent label, the lowest of equals.
    pub labels: Option<[[u8; GRID_WIDTH]; GRID_HEIGHT]>,
}

/// Rows and columns of all cells.
pub(super) fn cells() -> impl Iterator<Item = (usize, usize)> + Clone {
    (0..GRID_HEIGHT).flat_map(|row| (0..GRID_WIDTH).map(move |column| (row, column)))
}

impl SelfTestGrid {
    /// The grid of a decoded depth map, NaN where there is no measurement, and of its labels: both
    /// `[height][width]`.
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

#[cfg(test)]
mod tests {
    use super::*;

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
        let holes: Vec<_> = cells().filter(|&(row, column)| grid.depth[row][column].is_none()).collect();
        assert_eq!(holes, [(2, 3)]);
    }
}
