//! Depth, labels and point clouds as files, and depth in colors.
//!
//! | file | content | function |
//! |---|---|---|
//! | `depth.npy` | float32 `(H, W)`, NaN = no measurement | [`write_npy`], [`read_npy`] |
//! | `depth_mm.png` | 16-bit millimeters, 0 = no measurement | [`write_depth_mm`] |
//! | `depth.png` | colors with a scale | [`depth_image`] |
//! | `labels.png` | 8-bit class indices | [`write_results`] |
//! | `confidence.png` | 8-bit confidence, 255 = certain | [`write_results`] |
//! | `cloud.ply` | the points that have a position | [`write_cloud`] |
//! | `obstacles.png` | obstacles from above | [`BirdsEye`] |
//!
//! `nunetd infer`, `nunetd --out`, `nunetd eval` and the Python package write their files with it. A new file
//! format gets a module here and a line in [`write_results`].
//!
//! # Example: the results of one frame
//! ```
//! use nunet_files::{ResultArrays, write_results};
//! use nunet_types::ImageSize;
//!
//! # let folder = tempfile::tempdir()?;
//! let depth_m = [1.0, 1.5, 2.0, f32::NAN, 3.0, 3.5];
//! let results = ResultArrays {
//!     size: ImageSize::new(3, 2),
//!     depth: &depth_m,
//!     metric: true,
//!     labels: Some(&[0, 0, 1, 1, 1, 2]),
//!     confidence: None,
//!     cloud: None,
//! };
//! let files = write_results(folder.path(), &results)?;
//! let names: Vec<_> = files.iter().filter_map(|path| path.file_name()).collect();
//! assert_eq!(names, ["depth.npy", "depth_mm.png", "depth.png", "labels.png"]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Errors have a [kind](FilesError::kind) and a [hint](nunet_types::Hint).

mod color;
mod error;
mod folder;
mod json;
mod npy;
mod obstacles;
mod ply;
mod png;
mod results;
mod save;
mod whole;

pub use color::{color_range, colorize, depth_image, draw_text};
pub use error::{FilesError, FilesErrorKind};
pub use folder::{check_folder, make_folder};
pub use json::{check_writable, write_json};
pub use npy::{MAX_NPY_BYTES, read_npy, write_npy};
pub use obstacles::{BIRDS_EYE_LEGEND, BIRDS_EYE_ROWS, BirdsEye, draw_obstacle_points};
pub use ply::write_cloud;
pub use png::{millimeters, write_depth_mm, write_rgb};
pub use results::ResultArrays;
pub use save::{RESULT_FILES, write_results};
pub use whole::write_whole;
