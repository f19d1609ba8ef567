//! Opens a depth model: finds the model and ONNX Runtime's library, first loads a new file in a child process
//! with limits, and computes nothing before the self-test has passed. [`Model`] processes images in this
//! process; the Python package wraps it. [`Engine`] creates the pipelines with which `nunetd` processes
//! streams. Errors have a [kind](EngineError::kind) and a [hint](nunet_types::Hint).
//!
//! # Example: depth of one image
//! ```no_run
//! use nunet_core::frame::{ImageView, PixelFormat};
//! use nunet_engine::{Model, ModelOptions};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let mut model = Model::open("wnet_c.onnx".as_ref(), ModelOptions::default())?;
//! let rgb = vec![0; 640 * 480 * 3]; // `[480, 640, 3]`, RGB, rows from the top
//! let image = ImageView::packed(&rgb, 640, 480, PixelFormat::Rgb8)?;
//! let result = model.infer(&image, None, false)?;
//!
//! let size = model.size();
//! let center = result.depth[(size.height / 2 * size.width + size.width / 2) as usize];
//! println!("{center} m ahead, {} pixels without depth", result.report.invalid_pixels);
//! # Ok(())
//! # }
//! ```
//!
//! The model check needs `nunetd` next to the program or in `PATH`; a program with its own nunetd describes
//! it ([`Installation`]). `NUNET_MODELS` names the folder of the bundled models, `ORT_DYLIB_PATH` the library
//! of [`Model::open`].

mod buffers;
mod checked_load;
mod clock;
mod engine;
mod error;
mod error_kind;
mod huge_pages;
mod installation;
mod library;
mod model;
mod model_check;
mod model_report;
mod models;
mod options;
mod pool;
mod telemetry;
mod text;
mod verdict;

pub use buffers::Buffers;
pub use checked_load::check_model_in_this_process;
pub use clock::MonotonicClock;
pub use engine::{Engine, LoadedModel, ModelName};
pub use error::{EngineError, details_of};
pub use error_kind::EngineErrorKind;
pub use installation::Installation;
pub use library::{LibraryFile, cache_folder};
pub use model::{Inferred, Model, ModelOptions};
pub use model_check::{CHECK_SUBCOMMAND, Refusal};
pub use model_report::ModelReport;
pub use models::{find_model, model_folders};
pub use options::EngineOptions;
pub use pool::Pooled;
pub use telemetry::{TELEMETRY_VARIABLE, Telemetry};
pub use text::{file_sha256, hexadecimal, sha256_bytes};
