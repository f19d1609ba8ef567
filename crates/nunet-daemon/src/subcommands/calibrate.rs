//! `nunetd calibrate`: measures the factor of a camera's depth, and writes it into a calibration file.

use std::io::Write as _;
use std::num::NonZeroU64;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use nunet_core::camera::{Calibration, ScaleNote};
use nunet_core::pipeline::PipelineOptions;
use nunet_engine::{Engine, EngineOptions, ModelName, model_folders};
use nunet_eval::{Agreement, CalibrateError, Calibrator, EvalOptions, Event, Reference};
use nunet_files::write_whole;
use nunet_types::Hint as _;
use serde_json::json;
use tracing::{info, warn};

use super::eval::Printer;
use super::load::{load, tested_pipeline};
use crate::Outcome;
use crate::config::SourceConfig;
use crate::exit::{WithHint, warn_of_unknown_camera};
use crate::source::{CameraGeometry, CameraResolver, Frame, OpenOptions};
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
    pub(crate) json: bool,
}

/// Measures the factor, prints it, and writes it into the calibration file.
pub(crate) fn calibrate(options: &CalibrateOptions) -> anyhow::Result<Outcome> {
    let stop = Stop::on_signals()?;
    let resolver = CameraResolver::new(&options.geometry)?;
    let loaded = load(&Engine::start(options.engine.clone())?, &options.model)?;
    let model = loaded.model_name();
    let pipeline = tested_pipeline(loaded, options.pipeline)?;
    let mut calibrator = Calibrator::new(pipeline, resolver);
    let mut printer = Printer::default();
    let mut print = |event: Event<'_>| printer.print(event);
    let collected = match &options.evidence {
        Evidence::Frames(source, reference) => take_frames(&mut calibrator, source, *reference, &stop),
        Evidence::Readings(path) => calibrator.add_readings(path, &mut print).map_err(explained),
        Evidence::Truth(truth) => calibrator.add_truth(truth, &mut print).map_err(explained),
    };
    printer.finish();
    collected?;
    let found = calibrator.agreement().map_err(explained)?;
    let written = write(options, &calibrator, &found, &model)?;
    report(options, &found, &model, written)?;
    Ok(Outcome::Done)
}

/// An error with its hint; wrong arguments stay wrong arguments.
fn explained(error: CalibrateError) -> anyhow::Error {
    let Some(hint) = error.hint() else { return error.into() };
    let (text, hint) = (error.to_string(), hint.into_owned());
    if error.is_argument() { WithHint::usage(text, hint).into() } else { WithHint::new(text, hint).into() }
}

/// Adds the frames of a source.
struct Taker<'a> {
    calibrator: &'a mut Calibrator,
    reference: Reference,
}

impl FrameHandler for Taker<'_> {
    fn on_frame(&mut self, frame: Frame) -> anyhow::Result<ControlFlow<()>> {
        let assumption = self.calibrator.add_frame(&frame, &self.reference).map_err(explained)?;
        assumption.into_iter().for_each(warn_of_unknown_camera);
        Ok(ControlFlow::Continue(()))
    }

    fn on_lost(&mut self, _frame: Frame) {}
}

fn take_frames(
    calibrator: &mut Calibrator,
    source: &SourceConfig,
    reference: Reference,
    stop: &Stop,
) -> anyhow::Result<()> {
    let folders = model_folders();
    let how = OpenOptions { stopped: Some(stop.flag()), model_folders: &folders, ..source.open_options() };
    let mut opened = source.name.open(how)?;
    let limit = source.frames.or(NonZeroU64::new(FRAMES));
    let pace = Pace { limit, ..Pace::of(source) };
    drive(&mut *opened, pace, stop, &mut Taker { calibrator, reference })?;
    Ok(stop.check()?)
}

/// Writes the calibration file, if requested: the given calibration, else the known intrinsics.
fn write<'a>(
    options: &'a CalibrateOptions,
    calibrator: &Calibrator,
    found: &Agreement,
    model: &ModelName,
) -> anyhow::Result<Option<&'a Path>> {
    let Some(out) = options.out.as_deref() else { return Ok(None) };
    let text = match (&options.geometry.calibration, calibrator.camera()) {
        (Some(path), _) => {
            std::fs::read_to_string(path).with_context(|| format!("cannot read `{}`", path.display()))?
        }
        (None, Some(camera)) => Calibration::file_of(camera),
        (None, None) => {
            let text = format!("cannot write `{}`: the intrinsics are unknown", out.display());
            let hint =
                format!("pass --intrinsics or --calibration, or use the factor: --scale {:.4}", found.factor);
            return Err(WithHint::usage(text, hint).into());
        }
    };
    let note = ScaleNote {
        factor: found.factor,
        spread: found.spread,
        agreeing: found.agreeing,
        model: model.name.clone(),
        model_sha256: model.hash.clone(),
    };
    write_whole(out, |file| Ok(file.write_all(note.written_into(&text).as_bytes())?))?;
    Ok(Some(out))
}

fn report(
    options: &CalibrateOptions,
    found: &Agreement,
    model: &ModelName,
    written: Option<&Path>,
) -> anyhow::Result<()> {
    let Agreement { factor, spread, observations, agreeing } = *found;
    let text = if options.json {
        json!({
            "contract": nunet_ipc::CONTRACT_VERSION,
            "factor": factor,
            "spread": spread.is_finite().then_some(spread),
            "observations": observations,
            "agreeing": agreeing,
            "model": model,
            "file": written,
        })
        .to_string()
    } else {
        let spread =
            if spread.is_finite() { format!("{:.1} %", 100.0 * spread) } else { "unknown".to_owned() };
        format!("factor {factor:.4}, spread {spread}, {agreeing} of {observations} observations agree")
    };
    print(&text)?;
    match written {
        Some(path) => info!("use it: --calibration {}", path.display()),
        None => info!("use it: --scale {factor:.4}; --out FILE.yaml writes a calibration file"),
    }
    if observations > 1 && agreeing < observations {
        warn!("{} of {observations} observations are outliers", observations - agreeing);
    }
    Ok(())
}
