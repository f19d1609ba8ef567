//! `nunetd doctor`: checks this machine and reports every problem with its fix, not only the first.

use std::path::Path;

use nunet_core::graph::{Provider, SerialGraph};
use nunet_core::pipeline::{Pipeline, PipelineOptions};
use nunet_engine::{Engine, EngineOptions, TELEMETRY_VARIABLE, Telemetry, cache_folder};
use nunet_ipc::orphans::{self, Cleaning};
use nunet_ipc::{IpcError, Limits, Reservation, Topic, cameras, free_shared_memory_bytes};
use nunet_types::counted;

use super::load::load;
use crate::Outcome;
use crate::config::Publish;
use crate::exit::WithHint;
use crate::sink::loans::plans;
use crate::source;
use nunet_sink::stdout::print;

mod machine;
mod report;

use report::{Checks, Finding, Problem};

/// Runs every check. If there is a problem, the exit code is 1.
pub(crate) fn doctor(model: &Path, engine: EngineOptions, json: bool) -> anyhow::Result<Outcome> {
    let mut checks = Checks::default();
    let pipeline = check_engine(&mut checks, model, engine);
    checks.add("network", network(Telemetry::state()));
    checks.add("shared memory", shared_memory(pipeline.as_ref()));
    checks.add("orphans", orphans());
    checks.add("cache", cache());
    for (name, finding) in machine::checks() {
        checks.add(name, finding);
    }
    checks.add("published", published().map_err(Problem::of));
    check_cameras(&mut checks);
    let text = if json { checks.json() } else { checks.text() };
    print(text.trim_end())?;
    match checks.problems() {
        0 => Ok(Outcome::Done),
        problems => anyhow::bail!("{} found", counted(problems, "problem")),
    }
}

/// Library, model, provider and self-test; each check needs the previous one.
fn check_engine(checks: &mut Checks, model: &Path, engine: EngineOptions) -> Option<Pipeline> {
    let engine = match Engine::start(engine) {
        Ok(engine) => engine,
        Err(error) => {
            checks.add("library", Err(Problem::of(error)));
            return None;
        }
    };
    let library = engine.library();
    let (version, path) = (engine.runtime().version(), library.path.display());
    checks.add("library", Ok(format!("ONNX Runtime {version} at `{path}` ({})", library.place)));
    let loaded = match load(&engine, model) {
        Ok(loaded) => loaded,
        Err(error) => {
            checks.add("model", Err(Problem::of(error)));
            return None;
        }
    };
    let trained =
        if loaded.graph().description().trained { "" } else { ", untrained: its depth is meaningless" };
    checks.add("model", Ok(format!("`{}`{trained}", loaded.path().display())));
    checks.add("provider", provider(loaded.graph()));
    match loaded.into_pipeline(PipelineOptions::default()) {
        Ok((pipeline, report)) => {
            checks.add("self-test", Ok(report.to_string()));
            Some(pipeline)
        }
        Err(error) => {
            checks.add("self-test", Err(Problem::of(error)));
            None
        }
    }
}

/// ONNX Runtime's name of the provider that can compute every node.
const CPU_PROVIDER: &str = "CPUExecutionProvider";

/// The provider, and how many of the network's nodes each provider computes. Nodes that the chosen one does
/// not support run on the processor without a message.
fn provider(graph: &SerialGraph) -> Finding {
    let provider = graph.provider();
    let nodes = graph.node_assignment().map_err(Problem::of)?;
    let shares: Vec<_> =
        nodes.iter().map(|(name, nodes)| format!("{} on {name}", counted(*nodes, "node"))).collect();
    let detail = format!("{provider}: {}", shares.join(", "));
    if provider != Provider::Cpu && nodes.keys().all(|name| name == CPU_PROVIDER) {
        return Err(Problem::new(detail, "no node runs on it: --provider cpu is equivalent"));
    }
    Ok(detail)
}

/// nunet itself opens no connection. ONNX Runtime may, if the user allows it.
fn network(telemetry: Telemetry) -> Finding {
    Ok(match telemetry {
        Telemetry::Off => format!("no connections; ONNX Runtime's telemetry is off ({TELEMETRY_VARIABLE}=1)"),
        Telemetry::On => format!(
            "ONNX Runtime's telemetry is on, because {TELEMETRY_VARIABLE} is 0: it sends data to its vendor"
        ),
    })
}

fn shared_memory(pipeline: Option<&Pipeline>) -> Finding {
    let free = free_shared_memory_bytes().map_err(Problem::of)?;
    let megabytes = free / 1_000_000;
    let Some(pipeline) = pipeline else {
        return Ok(format!("{megabytes} MB free; how much is needed depends on the model"));
    };
    let everything = Publish::DEFAULT;
    let need = Reservation::new(&plans(pipeline, &everything, false), &Limits::default());
    need.check(free).map_err(Problem::of)?;
    Ok(format!("{megabytes} MB free, a camera needs {need}"))
}

/// Cleans up after dead processes, as every start of a publisher or a reader does.
fn orphans() -> Finding {
    match orphans::clean().map_err(Problem::of)? {
        Cleaning { removed: 0, failed: 0 } => Ok("no resources of dead processes".to_owned()),
        Cleaning { removed, failed: 0 } => Ok(format!("cleaned up after dead processes: {removed}")),
        Cleaning { failed, .. } => Err(Problem::new(
            format!("dead processes whose resources cannot be removed: {failed}"),
            format!(
                "they belong to another user or are damaged: stop every program that uses iceoryx2 and remove `{}`",
                nunet_ipc::root().display()
            ),
        )),
    }
}

/// Without a cache, every start runs the model check again.
fn cache() -> Finding {
    let Some(folder) = cache_folder() else {
        return Err(Problem::new("neither HOME nor XDG_CACHE_HOME is set", "set one of them"));
    };
    let probe = folder.join(format!("doctor-{}", std::process::id()));
    let written = std::fs::create_dir_all(&folder).and_then(|()| std::fs::write(&probe, ""));
    match written.and_then(|()| std::fs::remove_file(&probe)) {
        Ok(()) => Ok(format!("`{}`", folder.display())),
        Err(error) => Err(Problem::new(
            format!("cannot write to `{}`: {error}", folder.display()),
            "make this user the owner of the folder",
        )),
    }
}

/// The cameras that readers can find. A name that is not listed is mistyped or belongs to another user.
fn published() -> Result<String, IpcError> {
    let list = |what: &str, topic| {
        cameras::list(topic).map(|there| {
            let names: Vec<_> = there.iter().map(|name| format!("`{name}`")).collect();
            if names.is_empty() { format!("no {what}") } else { format!("{what} of {}", names.join(", ")) }
        })
    };
    Ok(format!("{}; {}", list("depth", Topic::Depth)?, list("images", Topic::Rgb)?))
}

/// A machine without a camera is not a problem, because there are other sources.
fn check_cameras(checks: &mut Checks) {
    let cameras = source::cameras();
    if cameras.is_empty() {
        checks.add("cameras", Ok("none at /dev/video*".to_owned()));
    }
    for camera in cameras {
        let name = format!("camera {}", camera.path.display());
        let offer = camera.offer.map_err(|(problem, hint)| match hint {
            Some(hint) => Problem::of(WithHint::new(problem, hint)),
            None => Problem::of(anyhow::Error::msg(problem)),
        });
        checks.add(name, offer);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn doctor_says_whether_onnx_runtime_may_send_data() {
        assert!(network(Telemetry::Off).unwrap().contains("telemetry is off"));
        assert!(network(Telemetry::On).unwrap().contains("telemetry is on"));
    }
}
