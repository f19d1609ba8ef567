//! The evaluator: compares results of the production pipeline with true depth and labels. The mean image is
//! the baseline.
//!
//! [`EvalOptions`] says what is measured, [`Evaluator::new`] checks it, [`Evaluator::run`] measures every
//! image, and [`Evaluation`] gives the [`Report`] and writes files. The library prints nothing: progress and
//! problems are [`Event`]s. `nunetd eval` makes these calls and prints their results.
//!
//! | module | what it does |
//! |---|---|
//! | `dataset` | folders, pairs by time stamp, lists of ids, recordings |
//! | `comparison`, `metrics` | which pixels are compared, and the sums over them ([`DepthMetrics`], [`LabelMetrics`]) |
//! | `baseline`, `mean_image` | the trivial prediction |
//! | `fit` | results of the network at the size of the truth |
//! | `obstacles` | obstacles of the network against those of the true depth |
//! | `calibrate` | the factor of a camera ([`Calibrator`]) from a distance, readings, true depth or the floor |
//! | `report`, `sheet` | JSON, table, CSV, contact sheet |
//!
//! # Example: the error of a model on a folder of images with depth
//! ```no_run
//! use nunet_core::pipeline::PipelineOptions;
//! use nunet_engine::{Engine, EngineOptions};
//! use nunet_eval::{EvalOptions, Evaluator, Event};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let evaluator = Evaluator::new(EvalOptions::new("models/clip"))?;
//!
//! let engine = Engine::start(EngineOptions::default())?;
//! let model = engine.load("wnet_c.onnx".as_ref(), &[], &Default::default())?;
//! let name = model.model_name();
//! let (pipeline, _selftest) = model.into_pipeline(PipelineOptions::default())?;
//!
//! let evaluation = evaluator.run(pipeline, &mut |event| {
//!     if let Event::Skipped { id, reason, .. } = event {
//!         eprintln!("skipped {id}: {reason}");
//!     }
//! })?;
//! let report = evaluation.report(name);
//! if let Some(depth) = report.depth() {
//!     println!("rmse {:.3} m, delta1 {:.3}", depth.rmse, depth.delta1);
//! }
//! println!("{}", report.text());
//! # Ok(())
//! # }
//! ```
//!
//! # Example: metrics of depth maps that you have already
//! ```
//! use nunet_eval::DepthMetrics;
//!
//! let mut metrics = DepthMetrics::default();
//! for (predicted_m, true_m) in [(2.0, 1.0), (3.0, 4.0), (5.0, f32::NAN)] {
//!     metrics.add(predicted_m, true_m);
//! }
//! let scores = metrics.scores().ok_or("no pixel has truth")?;
//! assert_eq!((metrics.pixels, scores.rmse, scores.abs_rel), (2, 1.0, 0.625));
//! # Ok::<(), &str>(())
//! ```
//!
//! Errors have a [kind](EvalError::kind) and a [hint](nunet_types::Hint).

mod baseline;
mod calibrate;
mod comparison;
mod dataset;
mod error;
mod error_hint;
mod error_kind;
mod evaluation;
mod event;
mod far_truth;
mod fit;
mod image_name;
mod mean_image;
mod median;
mod metrics;
mod npy_file;
mod obstacles;
mod options;
mod report;
mod reported;
mod sheet;
mod sparsification;
mod text_file;
mod truth_floor;

pub use calibrate::{
    Agreement, CalibrateError, Calibrator, FactorDoubt, Pixel, Point, Reference, ReferenceKind,
    files_of_readings,
};
pub use error::{EvalError, EvalErrorKind};
pub use evaluation::{Evaluation, Evaluator, FILES};
pub use event::Event;
pub use far_truth::{NOT_METERS, cap_for};
pub use image_name::ImageName;
pub use metrics::{DepthMetrics, DepthScores, IGNORE, LabelMetrics, LabelScores};
pub use obstacles::{ObstacleEval, ObstacleGroup, ObstacleScores};
pub use options::{BaselineChoice, DepthUnits, EvalOptions, Protocol, Window, parse_meters, parse_units};
pub use report::Report;
