//! `nunetd eval`: compares the pipeline's results with true depth. Prints the report of `nunet-eval`.

use std::path::PathBuf;

use indicatif::ProgressBar;
use nunet_core::pipeline::PipelineOptions;
use nunet_engine::{Engine, EngineOptions, find_model};
use nunet_eval::{EvalError, EvalErrorKind, EvalOptions, Evaluator, Event};
use nunet_eval::{NOT_METERS, cap_for};
use nunet_files::check_folder;
use nunet_sink::file_plan::FilePlan;
use nunet_types::{Hint as _, counted};
use tracing::{error, info, warn};

use super::load::{load, tested_pipeline};
use super::progress::progress;
use crate::Outcome;
use crate::exit::{WithHint, warn_of_camera};
use nunet_sink::stdout::print;

/// The hint for a file of ids that cannot be used.
const IDS_HINT: &str = "pass a text file with one id per line: the name of an image without its extension";

/// The options of `eval`.
pub(crate) struct EvalCommandOptions {
    pub(crate) evaluation: EvalOptions,
    pub(crate) model: PathBuf,
    pub(crate) pipeline: PipelineOptions,
    pub(crate) engine: EngineOptions,
    /// The folder for reports.
    pub(crate) out: Option<PathBuf>,
    pub(crate) json: bool,
}

/// Measures every image. An image that cannot be read is reported and counted.
pub(crate) fn eval(options: EvalCommandOptions) -> anyhow::Result<Outcome> {
    file_plan(&options).check()?;
    let evaluator = Evaluator::new(options.evaluation).map_err(with_flags)?;
    if let Some(out) = &options.out {
        check_folder(out)?;
    }
    let loaded = load(&Engine::start(options.engine)?, &options.model)?;
    let model = loaded.model_name();
    let pipeline = tested_pipeline(loaded, options.pipeline)?;
    let mut printer = Printer::default();
    let evaluation = evaluator.run(pipeline, &mut |event| printer.print(event));
    printer.finish();
    let mut evaluation = evaluation.map_err(with_flags)?;
    let report = evaluation.report(model);
    let text = if options.json { serde_json::to_string(&report)? } else { report.text() };
    print(&text)?;
    if !options.json && report.baseline_has_seen_the_images() {
        print("the baseline is the mean of the measured images themselves; pass --baseline-ids for others")?;
    }
    if let Some(out) = &options.out {
        evaluation.write(out, &report)?;
    }
    if evaluation.skipped() == 0 {
        return Ok(Outcome::Done);
    }
    error!("images that were skipped: {}", evaluation.skipped());
    Ok(Outcome::Lost)
}

fn file_plan(options: &EvalCommandOptions) -> FilePlan {
    let (evaluation, mut files) = (&options.evaluation, FilePlan::default());
    evaluation.files().into_iter().for_each(|file| files.read("an input", file));
    find_model(&options.model).iter().for_each(|model| files.read_model(model));
    options.out.iter().for_each(|out| files.write_folder(out, nunet_eval::FILES));
    files
}

/// Shows progress and problems.
#[derive(Default)]
pub(super) struct Printer(Option<ProgressBar>);

impl Printer {
    pub(super) fn print(&mut self, event: Event<'_>) {
        match event {
            Event::Started { what, count } => {
                self.finish();
                self.0 = Some(progress(what, Some(count)));
            }
            Event::Advanced => self.0.iter().for_each(|bar| bar.inc(1)),
            Event::Finished => self.finish(),
            // A log line would corrupt the progress bar.
            problem => match &self.0 {
                Some(bar) => bar.suspend(|| log(problem)),
                None => log(problem),
            },
        }
    }

    pub(super) fn finish(&mut self) {
        self.0.take().iter().for_each(ProgressBar::finish_and_clear);
    }
}

fn log(problem: Event<'_>) {
    match problem {
        Event::Skipped { id, reason, hint } => error!(hint, "skipped `{id}`: {reason}"),
        Event::SkippedAlike { count, reason, hint } => {
            error!(hint, "skipped {} for the same reason: {reason}", counted(count, "image"));
        }
        Event::Warning(text) => warn!("{text}"),
        Event::WrongMount { text, hint } => warn!(hint, "{text}"),
        Event::DimImages(found) => warn!(hint = found.hint().as_deref(), "{found}"),
        Event::Camera(news) => warn_of_camera(&news),
        Event::JoinedByTime { by_time, by_name, apart_ms } => info!(
            "joined {} with depth by time stamps (within {apart_ms} ms), {by_name} by equal names",
            counted(by_time, "image")
        ),
        Event::TruthBeyondCap { share, cap_m, farthest_m, is_meters } => {
            let (percent, hint) = (100.0 * share, depth_cap_hint(farthest_m, is_meters));
            warn!(hint, "{percent:.0} % of the true depth is at {cap_m} m or beyond and is not compared");
        }
        _ => {}
    }
}

/// Adds a hint that names flags.
pub(super) fn with_flags(error: EvalError) -> anyhow::Error {
    let hint = match error {
        EvalError::NothingMeasured { source } => {
            return with_flags(*source).context("no image could be measured");
        }
        EvalError::OwnDepth { .. } => "pass --depth-topic TOPIC to compare the model with it anyway".into(),
        EvalError::Ids(_) => IDS_HINT.into(),
        EvalError::NoPairs { .. } => "choose the topics: --topic and --depth-topic".into(),
        EvalError::UnknownUnit { .. } => "state the unit of the depth images: --depth-scale METERS".into(),
        EvalError::FixedUnit { .. } => {
            "remove --depth-scale and --depth-offset: they are for integers (16UC1, PNG)".into()
        }
        EvalError::ProtocolSize { .. } => "compare whole images: --protocol full".into(),
        EvalError::NoMount { .. } => "pass --mount x,y,z,roll,pitch,yaw, meters and radians".into(),
        EvalError::NoTruth => "0 and NaN mean none; --window and --protocol exclude parts".into(),
        EvalError::TruthOutOfRange { far_m, is_meters, .. } => depth_cap_hint(far_m, is_meters),
        error => return error.into(),
    };
    match error.kind() {
        EvalErrorKind::Argument => WithHint::usage(error.to_string(), hint).into(),
        _ => WithHint::new(error.to_string(), hint).into(),
    }
}

/// The hint for true depth that is not compared because it is beyond the cap.
pub(super) fn depth_cap_hint(far_m: f32, is_meters: bool) -> String {
    match cap_for(far_m) {
        Some(cap_m) => format!("compare up to a larger distance: --depth-cap {cap_m}"),
        None if is_meters => NOT_METERS.to_owned(),
        None => "check the unit of the depth images: --depth-scale METERS".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use nunet_eval::BaselineChoice;

    use super::*;
    use crate::exit::{is_usage, message_and_hints};

    #[test]
    fn depth_beyond_the_cap_has_a_hint_about_the_cap_or_the_unit() {
        assert!(depth_cap_hint(42.5, true).ends_with("--depth-cap 43"));
        assert!(depth_cap_hint(30.0, false).ends_with("--depth-cap 31"), "the cap itself is not compared");
        assert!(depth_cap_hint(4000.0, false).contains("--depth-scale"));
        assert_eq!(depth_cap_hint(4000.0, true), NOT_METERS, "the unit of meters cannot be stated");
    }

    #[test]
    fn files_that_are_missing_are_found_before_the_model() {
        let list = || PathBuf::from("missing.txt");
        let image = BaselineChoice::File("missing.npy".into());
        for (ids, baseline, is_about_ids) in [
            (Some(list()), BaselineChoice::Automatic, true),
            (None, BaselineChoice::Ids(list()), true),
            (None, image, false),
        ] {
            let error = eval(EvalCommandOptions {
                evaluation: EvalOptions { ids, baseline, ..EvalOptions::new("data") },
                model: "missing.onnx".into(),
                pipeline: PipelineOptions::default(),
                engine: EngineOptions::default(),
                out: None,
                json: false,
            })
            .unwrap_err();
            let hints = message_and_hints(&error).1;
            assert!(is_usage(&error) && hints.len() == 1, "{error}");
            assert_eq!(hints == [IDS_HINT], is_about_ids, "{hints:?}");
            assert!(is_about_ids || hints[0].contains("mean_image.npy"), "{hints:?}");
        }
    }

    #[test]
    fn hints_name_flags_and_wrong_arguments_stay_wrong_arguments() {
        let unknown_unit = EvalError::UnknownUnit { depth: Path::new("a.png").into() };
        let error = with_flags(EvalError::NothingMeasured { source: unknown_unit.into() });
        assert_eq!(message_and_hints(&error).1, ["state the unit of the depth images: --depth-scale METERS"]);
        assert!(!is_usage(&error));
        let own = EvalError::OwnDepth { path: "a.mcap".into(), model: "m".into() };
        assert!(is_usage(&with_flags(own)));
        assert!(is_usage(&with_flags(EvalError::NoImages { path: "a".into() })));
    }
}
