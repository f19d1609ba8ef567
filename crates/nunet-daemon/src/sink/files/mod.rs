//! Results as files: `depth.npy`, `depth_mm.png`, `depth.png`, `labels.png`, `cloud.ply`.

mod colour;
mod npy;
mod ply;
mod png;

use std::path::Path;

use anyhow::{Context as _, bail};
use nunet_core::cloud::CloudPoint;

pub use colour::depth_picture;
pub(crate) use colour::{draw_text, paint, range};
pub(crate) use npy::{read as read_npy, write as write_npy};
pub use ply::write as write_cloud;
pub(crate) use png::write_depth_mm;

/// One frame's results, at the network's size.
#[derive(Debug, Clone, Copy)]
pub struct Results<'a> {
    /// Width and height of `depth` and `labels`, pixels.
    pub size: (u32, u32),
    /// `[H, W]`, rows top to bottom; metres where `metric`, NaN = no measurement.
    pub depth: &'a [f32],
    /// Whether `depth` has a unit.
    pub metric: bool,
    /// `[H, W]`, class indices.
    pub labels: Option<&'a [u8]>,
    /// Organised points in the optical frame, of the unit of `depth`.
    pub cloud: Option<&'a [CloudPoint]>,
}

/// Makes `folder` where it is missing, and makes sure that files can be made in it.
pub(crate) fn make_folder(folder: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder)
        .with_context(|| format!("cannot make the folder `{}`", folder.display()))?;
    probe(folder)
}

/// Makes sure that files can be made in `folder`, which may have to be made first. Nothing is left behind.
pub(crate) fn check_folder(folder: &Path) -> anyhow::Result<()> {
    // A relative path ends in nothing, which is the current folder.
    let there = folder.ancestors().find(|part| part.exists()).unwrap_or(Path::new("."));
    let shown = folder.display();
    if !there.is_dir() {
        bail!("cannot make the folder `{shown}`: `{}` is no folder\nhint: name another", there.display());
    }
    let probed = probe(there);
    if there == folder { probed } else { probed.with_context(|| format!("cannot make the folder `{shown}`")) }
}

fn probe(folder: &Path) -> anyhow::Result<()> {
    let probe = folder.join(format!(".nunetd-{}", std::process::id()));
    let written = std::fs::write(&probe, "").and_then(|()| std::fs::remove_file(&probe));
    written.with_context(|| format!("cannot write into the folder `{}`", folder.display()))
}

/// Writes every result into `folder`, which is made where it is missing.
///
/// `depth_mm.png` is left out where depth has no unit: its numbers would be taken for millimetres.
///
/// # Errors
/// The folder or a file cannot be written; the path is named.
pub fn write(folder: &Path, results: &Results<'_>) -> anyhow::Result<()> {
    make_folder(folder)?;
    let write_file = |name: &str, write: &dyn Fn(&Path) -> anyhow::Result<()>| {
        let path = folder.join(name);
        write(&path).with_context(|| format!("cannot write `{}`", path.display()))
    };
    write_file("depth.npy", &|path| npy::write(path, results.depth, results.size))?;
    if results.metric {
        write_file("depth_mm.png", &|path| png::write_depth_mm(path, results.depth, results.size))?;
    }
    write_file("depth.png", &|path| png::write_rgb(path, &depth_picture(results)))?;
    if let Some(labels) = results.labels {
        write_file("labels.png", &|path| png::write_gray(path, labels, results.size))?;
    }
    if let Some(cloud) = results.cloud {
        write_file("cloud.ply", &|path| ply::write(path, cloud, results.metric))?;
    }
    Ok(())
}
