//! `cargo xtask demo`: from a fresh clone to depth images, a point cloud and a recording of the demo.

use std::fs;
use std::path::Path;
use std::process::Command;

use anyhow::{Context as _, Result, ensure};

use crate::run::{cargo, print, run};
use crate::{latency_table, paths, setup};

const FOLDER: &str = "target/demo";
/// Paced like a camera: a source that renders ahead would put its own waiting time into the latencies.
const HZ: &str = "10";
const FRAMES: &str = "81"; // the last one looks through the door into the corridor
const STATS: &str = "stats.json";
/// Where the camera of the drive is: 0.25 m above the floor, looking 4 degrees up.
const MOUNT: &str = "0,0,0.25,0,-0.07,0";
const RECORDING: &str = "demo.mcap";

/// What is left in the folder, and how to look at it.
const RESULTS: [(&str, &str); 9] = [
    ("depth.png", "depth of the last frame in colors, with a scale in meters; open this first"),
    ("obstacles.png", "obstacles of the last frame from above: green is free, red dots are obstacles"),
    (RECORDING, "all frames with image, depth, labels, cloud, obstacles and scan; open it in Foxglove"),
    ("cloud.ply", "points of the last frame with colors; open it in MeshLab or CloudCompare"),
    ("labels.png", "class of each pixel of the last frame"),
    ("confidence.png", "how certain the depth of each pixel of the last frame is; white is certain"),
    ("depth.npy", "depth of the last frame as float32 meters, for numpy.load"),
    ("obstacles.json", "free distance of each direction of the last frame"),
    (STATS, "counts and latencies of the run"),
];

/// Sets up, builds, runs the demo, prints the latencies and what to open.
pub(crate) fn demo() -> Result<()> {
    setup::onnxruntime()?;
    run(&mut cargo(&["build", "--release", "--package", "nunet-daemon"]))?;

    let folder = paths::root().join(FOLDER);
    remove_results(&folder)?;
    let (stats, recording) = (format!("{FOLDER}/{STATS}"), format!("{FOLDER}/{RECORDING}"));
    let mut nunetd = Command::new(paths::nunetd("release")?);
    nunetd.args(["--model", "models/wnet_c.onnx", "--source", "demo", "--rate", HZ, "--frames", FRAMES]);
    nunetd.args(["--mount", MOUNT]);
    // Every fourth row and column of the cloud: a recording of whole clouds takes 5.5 MB per frame.
    nunetd.args(["--cloud-stride", "4"]);
    nunetd.args(["--stats-json", &stats, "--out", FOLDER, "--record", &recording]);
    // Several cameras named `demo` cannot run on one machine at the same time; this one has a name of its
    // own.
    run(nunetd.args(["--camera", &format!("xtask-demo-{}", std::process::id())]))?;

    let names = RESULTS.iter().map(|(name, _)| *name);
    let missing: Vec<&str> = names.filter(|name| !folder.join(name).is_file()).collect();
    ensure!(missing.is_empty(), "nunetd left no {} in `{FOLDER}`", missing.join(", "));
    let text = fs::read_to_string(folder.join(STATS)).with_context(|| format!("cannot read `{stats}`"))?;
    print(&latency_table::render(&text).with_context(|| format!("cannot parse `{stats}`"))?);
    print(&format!("\n{}", guide()));
    Ok(())
}

/// A result of an earlier run must not pass for one of this run.
fn remove_results(folder: &Path) -> Result<()> {
    for (name, _) in RESULTS {
        if let Err(error) = fs::remove_file(folder.join(name))
            && error.kind() != std::io::ErrorKind::NotFound
        {
            return Err(error).with_context(|| format!("cannot remove `{FOLDER}/{name}`"));
        }
    }
    Ok(())
}

/// One line per result.
fn guide() -> String {
    let widest = RESULTS.iter().map(|(name, _)| name.len()).max().unwrap_or_default();
    let lines = RESULTS.map(|(name, about)| format!("  {FOLDER}/{name:widest$}  {about}"));
    format!("Results:\n{}", lines.join("\n"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_guide_names_each_result_and_begins_with_the_one_to_open_first() {
        let guide = guide();
        assert!(RESULTS.iter().all(|(name, _)| guide.contains(&format!("{FOLDER}/{name}"))), "{guide}");
        assert!(guide.lines().nth(1).unwrap().contains("open this first"), "{guide}");
    }
}
