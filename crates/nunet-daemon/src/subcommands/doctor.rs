//! `nunetd doctor`: every problem of this machine with its mend, not only the first.

use std::io::Write as _;

use nunet_core::graph::{Provider, SerialGraph};
use nunet_core::pipeline::Pipeline;
use nunet_engine::cache_folder;
use nunet_ipc::orphans::{self, Cleaning};
use nunet_ipc::{Limits, Reservation, Topic, cameras, free_shared_memory_bytes};
use nunet_types::text_with_hint;
use serde::Serialize;
use serde_json::json;

use crate::Outcome;
use crate::cli::{CameraArgs, DoctorArgs, Publish};
use crate::engine::{Engine, tested};
use crate::sink::shm::plans;
use crate::source;

mod machine;

/// Runs every check; a problem is exit code 1.
pub(super) fn doctor(arguments: &DoctorArgs) -> anyhow::Result<Outcome> {
    let mut checks = Checks::default();
    let pipeline = check_engine(&mut checks, arguments);
    check_shared_memory(&mut checks, pipeline.as_ref());
    check_orphans(&mut checks);
    check_cache(&mut checks);
    for (name, found) in machine::checks() {
        match found {
            Ok(detail) => checks.good(name, detail),
            Err(problem) => checks.bad(name, &problem),
        }
    }
    check_published(&mut checks);
    check_cameras(&mut checks);
    let text = if arguments.json { checks.json() } else { checks.text() };
    writeln!(std::io::stdout(), "{}", text.trim_end())?;
    match checks.problems() {
        0 => Ok(Outcome::Done),
        1 => anyhow::bail!("1 problem found"),
        problems => anyhow::bail!("{problems} problems found"),
    }
}

/// One thing that was looked at.
#[derive(Debug, Serialize)]
struct Check {
    /// No two have the same.
    name: String,
    ok: bool,
    detail: String,
    hint: Option<String>,
}

#[derive(Debug, Default)]
struct Checks(Vec<Check>);

impl Checks {
    fn good(&mut self, name: impl Into<String>, detail: impl ToString) {
        self.0.push(Check { name: name.into(), ok: true, detail: detail.to_string(), hint: None });
    }

    /// A problem; the mend is the message's last line where it has one.
    fn bad(&mut self, name: impl Into<String>, problem: &str) {
        let (detail, hint) = match problem.split_once("\nhint: ") {
            Some((detail, hint)) => (detail.to_owned(), Some(hint.replace("\nhint: ", "; "))),
            None => (problem.to_owned(), None),
        };
        self.0.push(Check { name: name.into(), ok: false, detail, hint });
    }

    fn problems(&self) -> usize {
        self.0.iter().filter(|check| !check.ok).count()
    }

    fn json(&self) -> String {
        let json = json!({
            "contract": nunet_ipc::CONTRACT_VERSION,
            "ok": self.problems() == 0,
            "checks": self.0,
        });
        format!("{json:#}")
    }

    fn text(&self) -> String {
        let line = |check: &Check| {
            let mark = if check.ok { "ok     " } else { "PROBLEM" };
            let hint =
                check.hint.as_ref().map(|hint| format!("\n          hint: {hint}")).unwrap_or_default();
            format!("{mark}  {}: {}{hint}\n", check.name, check.detail)
        };
        self.0.iter().map(line).collect()
    }
}

/// ONNX Runtime's name of the provider that can compute everything.
const PROCESSOR: &str = "CPUExecutionProvider";

/// Library, model, provider and self-test; each needs the one before.
fn check_engine(checks: &mut Checks, arguments: &DoctorArgs) -> Option<Pipeline> {
    let engine = match Engine::start(&arguments.engine) {
        Ok(engine) => engine,
        Err(error) => {
            checks.bad("library", &format!("{error:#}"));
            return None;
        }
    };
    let library = engine.library();
    checks.good(
        "library",
        format!(
            "ONNX Runtime {} at `{}` ({})",
            engine.runtime().version(),
            library.path.display(),
            library.place
        ),
    );
    let loaded = match engine.load(&arguments.model, &[]) {
        Ok(loaded) => loaded,
        Err(error) => {
            checks.bad("model", &format!("{error:#}"));
            return None;
        }
    };
    let trained =
        if loaded.graph().description().trained { "" } else { ", untrained: its depth means nothing" };
    checks.good("model", format!("`{}`{trained}", loaded.path().display()));
    match placement(loaded.graph()) {
        Ok(detail) => checks.good("provider", detail),
        Err(problem) => checks.bad("provider", &problem),
    }
    match tested(loaded, &CameraArgs::default()) {
        Ok((pipeline, report)) => {
            checks.good("self-test", report);
            Some(pipeline)
        }
        Err(error) => {
            checks.bad("self-test", &format!("{error:#}"));
            None
        }
    }
}

/// The provider, and who computes how many of the network's nodes: what it cannot, the processor does, silently.
fn placement(graph: &SerialGraph) -> Result<String, String> {
    let provider = graph.provider();
    let nodes = graph.placement().map_err(|error| error.to_string())?;
    let shares: Vec<_> = nodes.iter().map(|(name, nodes)| format!("{nodes} nodes on {name}")).collect();
    let detail = format!("{provider}: {}", shares.join(", "));
    if provider != Provider::Cpu && nodes.keys().all(|name| name == PROCESSOR) {
        return Err(format!(
            "{detail}\nhint: it computes nothing of this network: --provider cpu is the same"
        ));
    }
    Ok(detail)
}

fn check_shared_memory(checks: &mut Checks, pipeline: Option<&Pipeline>) {
    let free = match free_shared_memory_bytes() {
        Ok(free) => free,
        Err(error) => return checks.bad("shared memory", &text_with_hint(&error)),
    };
    let Some(pipeline) = pipeline else {
        return checks
            .good("shared memory", format!("{} MB free; the need depends on the model", free / 1_000_000));
    };
    let everything = [Publish::Depth, Publish::Labels, Publish::Cloud];
    let need = Reservation::new(&plans(pipeline, &everything), &Limits::default());
    match need.check(free) {
        Ok(()) => {
            checks.good("shared memory", format!("{} MB free, a camera needs {need}", free / 1_000_000));
        }
        Err(error) => checks.bad("shared memory", &text_with_hint(&error)),
    }
}

/// Cleans up after dead processes, as every start of an owner or a reader does, and tells what could not be removed.
fn check_orphans(checks: &mut Checks) {
    match orphans::clean() {
        Ok(Cleaning { removed: 0, failed: 0 }) => checks.good("orphans", "no resources of dead processes"),
        Ok(Cleaning { removed, failed: 0 }) => {
            checks.good("orphans", format!("cleaned up after {removed} dead processes"));
        }
        Ok(Cleaning { failed, .. }) => checks.bad(
            "orphans",
            &format!(
                "{failed} dead processes left resources that cannot be removed\nhint: they are another user's, or \
                 damaged: stop every program that uses iceoryx2 and remove `{}`",
                nunet_ipc::root().display()
            ),
        ),
        Err(error) => checks.bad("orphans", &text_with_hint(&error)),
    }
}

/// Without it every start tests the model in a child process anew.
fn check_cache(checks: &mut Checks) {
    let Some(folder) = cache_folder() else {
        return checks.bad("cache", "neither HOME nor XDG_CACHE_HOME is set\nhint: set one of them");
    };
    let probe = folder.join(format!("doctor-{}", std::process::id()));
    let written = std::fs::create_dir_all(&folder).and_then(|()| std::fs::write(&probe, ""));
    match written.and_then(|()| std::fs::remove_file(&probe)) {
        Ok(()) => checks.good("cache", format!("`{}`", folder.display())),
        Err(error) => checks.bad(
            "cache",
            &format!("`{}` cannot be written: {error}\nhint: give this user the folder", folder.display()),
        ),
    }
}

/// What readers find at the moment: a name that is not among these is mistyped, or another user's.
fn check_published(checks: &mut Checks) {
    let list = |what: &str, topic| {
        cameras::list(topic).map(|there| {
            let names: Vec<_> = there.iter().map(|name| format!("`{name}`")).collect();
            if names.is_empty() { format!("no {what}") } else { format!("{what} of {}", names.join(", ")) }
        })
    };
    match list("depth", Topic::Depth).and_then(|depth| Ok((depth, list("pictures", Topic::Rgb)?))) {
        Ok((depth, pictures)) => checks.good("published", format!("{depth}; {pictures}")),
        Err(error) => checks.bad("published", &text_with_hint(&error)),
    }
}

/// A machine without a camera may have other sources.
fn check_cameras(checks: &mut Checks) {
    let cameras = source::cameras();
    if cameras.is_empty() {
        checks.good("cameras", "none at /dev/video*");
    }
    for camera in cameras {
        let name = format!("camera {}", camera.path.display());
        match camera.what {
            Ok(what) => checks.good(name, what),
            Err(problem) => checks.bad(name, &problem.to_string()),
        }
    }
}
