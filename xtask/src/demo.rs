//! `cargo xtask demo`: from a fresh clone to depth pictures of the demo scene.

use std::fs;
use std::process::Command;

use anyhow::{Context as _, Result, ensure};

use crate::run::{cargo, print, run, say};
use crate::{latency_table, paths, setup};

const FOLDER: &str = "target/demo";
const FRAMES: &str = "100";
const STATS: &str = "stats.json";
const RESULTS: [&str; 5] = ["depth.png", "depth.npy", "labels.png", "cloud.ply", STATS];

/// Set up, build, run 100 frames, show the latencies.
pub(crate) fn demo() -> Result<()> {
    setup::onnxruntime()?;
    run(&mut cargo(&["build", "--release", "--package", "nunet-daemon"]))?;

    let folder = paths::root().join(FOLDER);
    for name in RESULTS {
        // A result of an earlier run must not pass for one of this run.
        if let Err(error) = fs::remove_file(folder.join(name))
            && error.kind() != std::io::ErrorKind::NotFound
        {
            return Err(error).with_context(|| format!("cannot remove `{FOLDER}/{name}`"));
        }
    }
    let stats = format!("{FOLDER}/{STATS}");
    let mut nunetd = Command::new(paths::nunetd("release")?);
    nunetd.args(["--model", "models/wnet_c.onnx", "--source", "demo", "--frames", FRAMES]);
    run(nunetd.args(["--stats-json", &stats, "--out", FOLDER]))?;

    let missing: Vec<&str> = RESULTS.into_iter().filter(|name| !folder.join(name).is_file()).collect();
    ensure!(missing.is_empty(), "nunetd left no {} in `{FOLDER}`", missing.join(", "));
    let text = fs::read_to_string(folder.join(STATS)).with_context(|| format!("cannot read `{stats}`"))?;
    print(&latency_table::render(&text).with_context(|| format!("cannot understand `{stats}`"))?);
    say(&format!("demo: {} in {FOLDER}", RESULTS.join(", ")));
    Ok(())
}
