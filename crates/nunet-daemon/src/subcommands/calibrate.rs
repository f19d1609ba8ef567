//! `nunetd calibrate`: measures the factor of a camera's depth, and writes it into a calibration file.

use std::num::NonZeroU64;
use std::ops::ControlFlow;
use std::path::PathBuf;

use anyhow::bail;
use nunet_core::pipeline::PipelineOptions;
use nunet_engine::{Engine, EngineOptions, ModelName, find_model, model_folders};
use nunet_eval::{Agreement, CalibrateError, Calibrator, EvalOptions, Event, Reference, files_of_readings};
use nunet_files::check_writable;
use nunet_sink::file_plan::{FilePlan, place};
use nunet_types::{Hint as _, counted};
use serde_json::json;
use tracing::{error, info, warn};

use super::eval::{Printer, depth_cap_hint, with_flags};
use super::load::{load, tested_pipeline};
use crate::Outcome;
use crate::config::SourceConfig;
use crate::exit::{WithHint, warn_of_camera};
use crate::sink::recording::refuse_output;
use crate::source::{CameraGeometry, CameraResolver, Frame, OpenOptions, Rotation};
use crate::stream::{FrameHandler, Pace, Stop, drive};
use nunet_sink::stdout::print;

/// Frames of a source that are compared by default.
const FRAMES: u64 = 30;

/// The observations that the factor is computed from.
pub(crate) enum Evidence {
    /// Frames of a source, each compared with a reference.
    Frames(SourceConfig, Reference),
    /// A table of readings.
    Readings(PathBuf),
    /// Images with true depth.
    Truth(EvalOptions),
}

/// The options of `calibrate`.
pub(crate) struct CalibrateOptions {
    pub(crate) evidence: Evidence,
    pub(crate) geometry: CameraGeometry,
    pub(crate) model: PathBuf,
    pub(crate) pipeline: PipelineOptions,
    pub(crate) engine: EngineOptions,
    /// The calibration file to write.
    pub(crate) out: Option<PathBuf>,
    /// Whether an existing file, other than the named calibration, may be overwritten.
    pub(crate) force: bool,
    pub(crate) json: bool,
}

/// Measures the factor, prints it, and writes it into the calibration file.
pub(crate) fn calibrate(options: &CalibrateOptions) -> anyhow::Result<Outcome> {
    // A source is stopped between two frames. Otherwise nothing is lost if a signal ends the process at once.
    let has_source = matches!(options.evidence, Evidence::Frames(..));
    let stop = if has_source { Stop::on_signals()? } else { Stop::default() };
    check_files(options)?;
    let resolver = CameraResolver::new(&options.geometry)?;
    let loaded = load(&Engine::start(options.engine.clone())?, &options.model)?;
    let model = loaded.model_name();
    let pipeline = tested_pipeline(loaded, options.pipeline)?;
    let mut calibrator = Calibrator::new(pipeline, resolver).require_camera(options.out.is_some());
    let mut printer = Printer::default();
    let mut print = |event: Event<'_>| printer.print(event);
    let collected = match &options.evidence {
        Evidence::Frames(source, reference) => {
            take_frames(&mut calibrator, source, options.geometry.rotation, *reference, &stop)
        }
        Evidence::Readings(path) => calibrator.add_readings(path, &mut print).map_err(explained),
        Evidence::Truth(truth) => calibrator.add_truth(truth, &mut print).map_err(explained),
    };
    printer.finish();
    collected?;
    let found = calibrator.agreement().map_err(explained)?;
    if let Some(out) = &options.out {
        let named = options.geometry.calibration.as_deref();
        let written = calibrator.write_calibration(out, named, &found, (&model.name, &model.hash));
        written.map_err(explained)?;
    }
    report(options, (&found, calibrator.unusable()), &model)?;
    calibrator.doubts(&found).iter().for_each(|doubt| warn!(hint = doubt.hint().as_deref(), "{doubt}"));
    if calibrator.skipped() == 0 {
        return Ok(Outcome::Done);
    }
    error!("images that were skipped: {}", calibrator.skipped());
    Ok(Outcome::Lost)
}

/// Checks before anything is computed that the output can be written and destroys nothing. Only the named
/// calibration may be overwritten without `--force`, because all of it stays.
fn check_files(options: &CalibrateOptions) -> anyhow::Result<()> {
    let mut files = FilePlan::default();
    find_model(&options.model).iter().for_each(|model| files.read_model(model));
    let (role, inputs) = match &options.evidence {
        Evidence::Frames(source, _) => ("the source", source.name.files()),
        Evidence::Readings(table) => ("a file of the readings", files_of_readings(table)?),
        Evidence::Truth(truth) => ("an input", truth.files()),
    };
    let named = options.geometry.calibration.as_deref();
    // The named calibration is an input too, of which all stays.
    let others = inputs.into_iter().filter(|file| named.is_none_or(|named| place(named) != place(file)));
    others.for_each(|file| files.read(role, file));
    let Some(out) = &options.out else { return Ok(()) };
    files.write("the calibration to write", out);
    files.check()?;
    refuse_output(out, options.force || named.is_some_and(|named| place(named) == place(out)))?;
    Ok(check_writable(out)?)
}

/// An error of a dataset names the flags.
fn explained(error: CalibrateError) -> anyhow::Error {
    match error {
        CalibrateError::Dataset(error) => with_flags(error),
        CalibrateError::TruthTooFar { far_m, is_meters, .. } => {
            WithHint::new(error.to_string(), depth_cap_hint(far_m, is_meters)).into()
        }
        error => error.into(),
    }
}

/// Adds the frames of a source.
struct Taker<'a> {
    calibrator: &'a mut Calibrator,
    reference: Reference,
    frames: u64,
}

impl FrameHandler for Taker<'_> {
    fn on_frame(&mut self, frame: Frame) -> anyhow::Result<ControlFlow<()>> {
        warn_of_camera(&self.calibrator.add_frame(&frame, &self.reference).map_err(explained)?);
        self.frames += 1;
        Ok(ControlFlow::Continue(()))
    }

    fn on_lost(&mut self, _frame: Frame) {}
}

fn take_frames(
    calibrator: &mut Calibrator,
    source: &SourceConfig,
    rotation: Option<Rotation>,
    reference: Reference,
    stop: &Stop,
) -> anyhow::Result<()> {
    let folders = model_folders();
    let how = OpenOptions {
        rotation,
        stopped: Some(stop.flag()),
        model_folders: &folders,
        ..source.open_options()
    };
    let mut opened = source.name.open(how)?;
    let pace = Pace { limit: source.frames.or(NonZeroU64::new(FRAMES)), ..Pace::of(source) };
    let mut taker = Taker { calibrator, reference, frames: 0 };
    drive(&mut *opened, pace, stop, &mut taker)?;
    match taker.frames {
        0 => Ok(stop.check()?),
        n if stop.requested() => bail!("stopped after {}, before the factor was known", counted(n, "frame")),
        _ => Ok(()),
    }
}

fn report(
    options: &CalibrateOptions,
    (found, unusable): (&Agreement, usize),
    model: &ModelName,
) -> anyhow::Result<()> {
    let Agreement { factor, spread, observations, agreeing } = *found;
    let text = if options.json {
        json!({
            "contract": nunet_ipc::CONTRACT_VERSION,
            "factor": factor,
            "spread": spread, // `null` if it is unknown
            "observations": observations,
            "agreeing": agreeing,
            "unusable": unusable,
            "model": model,
            "file": options.out,
        })
        .to_string()
    } else {
        found.to_string()
    };
    print(&text)?;
    match &options.out {
        Some(path) => info!("use it: --calibration {}", path.display()),
        None => info!("use it: --scale {factor:.4}; --out FILE.yaml writes a calibration file"),
    }
    Ok(())
}
