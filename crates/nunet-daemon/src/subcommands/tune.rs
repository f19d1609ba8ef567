//! `nunetd tune`: finds the fastest provider and number of threads for a model on this machine.

use std::io::Write as _;
use std::num::{NonZeroU32, NonZeroUsize};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, ensure};
use nunet_core::graph::Provider;
use nunet_core::pipeline::PipelineOptions;
use nunet_engine::{Engine, EngineOptions, find_model};
use nunet_files::{check_writable, write_whole};
use nunet_telemetry::host;
use nunet_types::printable;
use serde_json::{Value, json};
use tracing::warn;

use super::bench::{Subject, image_or_demo, predictions};
use super::load::{load, tested_pipeline};
use crate::Outcome;
use crate::exit::{BadArguments, WithHint};
use nunet_sink::stdout::print;

/// A combination with fewer threads is preferred if it is at most this much slower than the fastest, because
/// a robot has other work for its cores.
const AS_FAST: f64 = 1.05;

/// The options of `tune`.
pub(crate) struct TuneOptions {
    pub(crate) model: PathBuf,
    /// The image to predict from; `None` for the first of the demo scene.
    pub(crate) image: Option<PathBuf>,
    /// The number of predictions per combination.
    pub(crate) runs: NonZeroU32,
    /// Values that are set here are not varied.
    pub(crate) engine: EngineOptions,
    /// The configuration file to write.
    pub(crate) out: Option<PathBuf>,
    pub(crate) json: bool,
}

/// Measures all combinations interleaved, so that a disturbance affects all of them.
pub(crate) fn tune(options: &TuneOptions) -> anyhow::Result<Outcome> {
    options.out.as_deref().map_or(Ok(()), check_new)?;
    find_model(&options.model)?;
    let frame = image_or_demo(options.image.as_deref())?;
    let engine = Engine::start(options.engine.clone())?;
    let mut combinations = Vec::new();
    for (provider, threads) in options.engine.combinations(&engine.runtime().providers()) {
        match Combination::load(provider, threads, options) {
            Ok(combination) => combinations.push(combination),
            Err(error) => warn!("skipped: {error:#}"),
        }
    }
    for is_measured in predictions(options.runs) {
        for combination in &mut combinations {
            combination.subject.predict(&frame, is_measured)?;
        }
    }
    let median = |combination: &Combination| (combination.threads, combination.subject.median_ms());
    let medians: Vec<_> = combinations.iter().map(median).collect();
    let best = best(&medians)
        .ok_or_else(|| WithHint::new("no combination runs this model", "run `nunetd doctor`"))?;
    let text = if options.json {
        json(&combinations, &combinations[best], &engine).to_string()
    } else {
        table(&combinations, &combinations[best])
    };
    print(&text)?;
    if let Some(out) = &options.out {
        let config = config(&options.model, &combinations[best])?;
        write_whole(out, |file| Ok(file.write_all(config.as_bytes())?))?;
    }
    Ok(Outcome::Done)
}

/// Checks before a long run that the file can be written. One that exists may have been edited by hand.
fn check_new(out: &Path) -> anyhow::Result<()> {
    let exists = || BadArguments::new(format!("`{}` exists", out.display()));
    ensure!(!out.exists(), exists().with_hint("name a new file and copy the lines that you need"));
    Ok(check_writable(out)?)
}

/// A combination: a provider with a number of threads.
struct Combination {
    provider: Provider,
    threads: NonZeroUsize,
    subject: Subject,
}

impl Combination {
    fn load(provider: Provider, threads: NonZeroUsize, options: &TuneOptions) -> anyhow::Result<Self> {
        let engine = EngineOptions { provider, threads: Some(threads), ..options.engine.clone() };
        let load = || -> anyhow::Result<Subject> {
            let loaded = load(&Engine::start(engine.clone())?, &options.model)?;
            let (name, hash) = (loaded.name(), loaded.hash());
            Ok(Subject::new(name, hash, tested_pipeline(loaded, PipelineOptions::default())?))
        };
        let subject = load().with_context(|| format!("--provider {provider} --threads {threads}"))?;
        Ok(Self { provider, threads, subject })
    }
}

/// The index of the best combination, given threads and median times.
fn best(medians: &[(NonZeroUsize, f64)]) -> Option<usize> {
    let fastest = medians.iter().map(|combination| combination.1).min_by(f64::total_cmp)?;
    let as_fast = medians.iter().enumerate().filter(|(_, combination)| combination.1 <= AS_FAST * fastest);
    let chosen = as_fast.min_by(|(_, a), (_, b)| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    chosen.map(|(place, _)| place)
}

fn table(combinations: &[Combination], best: &Combination) -> String {
    let mut text = format!("{}\n  {}\n", printable::one_line(&best.subject.name), Subject::HEAD);
    for combination in combinations {
        let name = format!("{} {}", combination.provider, combination.threads);
        text += &format!("  {}\n", combination.subject.end_to_end_row(&name));
    }
    let (provider, threads, ms) = (best.provider, best.threads, best.subject.median_ms());
    text + &format!("--provider {provider} --threads {threads}: {ms:.1} ms per frame, end to end")
}

fn json(combinations: &[Combination], best: &Combination, engine: &Engine) -> Value {
    let combination_json = |combination: &Combination| {
        json!({
            "provider": combination.provider.name(),
            "threads": combination.threads,
            "end_to_end_ms": combination.subject.end_to_end_json(),
        })
    };
    json!({
        "contract": nunet_ipc::CONTRACT_VERSION,
        "host": host(),
        "onnxruntime": engine.runtime().version(),
        "model": { "name": best.subject.name, "hash": best.subject.hash },
        "combinations": combinations.iter().map(combination_json).collect::<Vec<_>>(),
        "best": { "provider": best.provider.name(), "threads": best.threads },
    })
}

/// The configuration file.
fn config(model: &Path, best: &Combination) -> anyhow::Result<String> {
    let mut table = toml::Table::new();
    let model =
        model.to_str().context("the model's path is not UTF-8, so no configuration file can name it")?;
    table.insert("model".to_owned(), model.into());
    table.insert("provider".to_owned(), best.provider.name().into());
    table.insert("threads".to_owned(), i64::try_from(best.threads.get())?.into());
    Ok(table.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn count(number: usize) -> NonZeroUsize {
        NonZeroUsize::new(number).unwrap()
    }

    #[test]
    fn of_equally_fast_combinations_the_one_with_fewer_threads_is_chosen() {
        let best = |combinations: &[(usize, f64)]| {
            best(&combinations.iter().map(|&(threads, ms)| (count(threads), ms)).collect::<Vec<_>>())
        };
        assert_eq!(best(&[(1, 44.0), (2, 24.0), (4, 23.5)]), Some(1));
        assert_eq!(best(&[(1, 44.0), (2, 24.0), (4, 20.0)]), Some(2));
        assert_eq!(best(&[(2, 24.0), (2, 23.9)]), Some(1));
        assert_eq!(best(&[]), None);
    }

    #[test]
    fn the_largest_number_of_predictions_is_one_and_the_first_are_not_measured() {
        let measured: Vec<bool> = predictions(NonZeroU32::MAX).take(5).collect();
        assert_eq!(measured, [false, false, false, true, true]);
        assert_eq!(predictions(NonZeroU32::MIN).filter(|is_measured| *is_measured).count(), 1);
    }
}
