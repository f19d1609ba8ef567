//! From `--model NAME|PATH` to a file: an existing path first, then the bundled models.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::bail;
use nunet_core::graph::model_files;

use crate::exit::NotFound;
use crate::installation;

/// Overrides where bundled models are looked up.
const FOLDER_VARIABLE: &str = "NUNET_MODELS";

/// The file that `name` means.
///
/// # Errors
/// Neither a path nor a bundled model: the places and the names to be had are listed.
pub(crate) fn find(name: &Path) -> anyhow::Result<PathBuf> {
    if name.exists() {
        return Ok(name.to_owned());
    }
    let folders = folders();
    let bundled =
        is_bare_name(name).then(|| folders.iter().find_map(|folder| model_in(folder, name))).flatten();
    match bundled {
        Some(path) => Ok(path),
        None => bail!(NotFound(not_found(name, &folders))),
    }
}

/// Only a bare name is looked up: `--model ./x.onnx` must not find another file than it says.
fn is_bare_name(name: &Path) -> bool {
    name.components().count() == 1 && !name.starts_with(".")
}

fn model_in(folder: &Path, name: &Path) -> Option<PathBuf> {
    let exact = folder.join(name);
    [exact.clone(), exact.with_added_extension("onnx"), exact.with_added_extension("toml")]
        .into_iter()
        .find(|path| path.is_file())
}

/// What the installation says, else beside the executable, or in the checkout it was built in.
fn folders() -> Vec<PathBuf> {
    if let Some(folder) = std::env::var_os(FOLDER_VARIABLE).filter(|folder| !folder.is_empty()) {
        return vec![PathBuf::from(folder)];
    }
    if let Some(installation) = installation::described() {
        return installation.model_folders.clone();
    }
    let exe = std::env::current_exe().unwrap_or_default();
    let beside = exe.parent().unwrap_or(Path::new("."));
    let installed = [beside.join("models"), beside.with_file_name("share").join("nunet/models")];
    // target/release/nunetd, target/debug/deps/test-0123
    let checkouts = exe.ancestors().skip(1).take(4).map(|folder| folder.join("models"));
    installed.into_iter().chain(checkouts.skip(1)).collect()
}

fn not_found(name: &Path, folders: &[PathBuf]) -> String {
    let mut text = format!("no model `{}`: no such file", name.display());
    if is_bare_name(name) {
        let names = bundled_names(folders);
        text += ", and no bundled model of that name";
        text += &if names.is_empty() {
            let looked: Vec<_> = folders.iter().map(|folder| format!("`{}`", folder.display())).collect();
            format!(
                "\nhint: {FOLDER_VARIABLE}=FOLDER says where bundled models are, or give a path; looked in {}",
                looked.join(", ")
            )
        } else {
            format!("\nhint: bundled models: {}", names.join(", "))
        };
    } else {
        text += "\nhint: a path is taken as it stands; a bundled model is called by its bare name, such as `wnet_c.onnx`";
    }
    text
}

/// All but the stages that a manifest beside them joins: alone they give no depth.
fn bundled_names(folders: &[PathBuf]) -> Vec<String> {
    let files = folders.iter().filter_map(|folder| folder.read_dir().ok()).flatten().flatten();
    let is_model =
        |path: &PathBuf| path.extension().is_some_and(|ending| ending == "onnx" || ending == "toml");
    let models: BTreeSet<_> = files.map(|file| file.path()).filter(is_model).collect();
    let manifests = models.iter().filter(|path| path.extension().is_some_and(|ending| ending == "toml"));
    let stages: BTreeSet<_> = manifests
        .filter_map(|path| model_files(path).ok())
        .flat_map(|files| files.into_iter().skip(1))
        .collect();
    let names = models.difference(&stages).filter_map(|path| path.file_name());
    names.map(|name| name.to_string_lossy().into_owned()).collect::<BTreeSet<_>>().into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_existing_path_comes_before_a_bundled_model() {
        let file = tempfile::NamedTempFile::new().unwrap();
        assert_eq!(find(file.path()).unwrap(), file.path());
    }

    #[test]
    fn a_bundled_model_is_found_with_and_without_its_ending() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("wnet_c.onnx"), "").unwrap();
        for name in ["wnet_c", "wnet_c.onnx"] {
            assert_eq!(model_in(folder.path(), Path::new(name)), Some(folder.path().join("wnet_c.onnx")));
        }
    }

    #[test]
    fn a_path_never_falls_back_to_a_bundled_model() {
        let error = find(Path::new("./wnet_c_missing/wnet_c.onnx")).unwrap_err().to_string();
        assert!(error.contains("a path is taken as it stands"), "{error}");
    }

    #[test]
    fn where_there_is_no_model_at_all_the_folders_are_told() {
        let folders = [PathBuf::from("/opt/none/models"), PathBuf::from("/opt/share/nunet/models")];
        let text = not_found(Path::new("wnet_c.onnx"), &folders);
        let expected = "\nhint: NUNET_MODELS=FOLDER says where bundled models are, or give a path; looked in \
                        `/opt/none/models`, `/opt/share/nunet/models`";
        assert!(text.ends_with(expected), "{text}");
    }

    #[test]
    fn an_unknown_name_lists_what_there_is() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["unet.onnx", "wnet_c.onnx", "wnet_c.segmentation.onnx", "wnet_c.depth.onnx"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        let manifest = include_str!("../../../models/wnet_c.toml");
        std::fs::write(folder.path().join("wnet_c.toml"), manifest).unwrap();
        let text = not_found(Path::new("unett"), &[folder.path().to_owned()]);
        assert_eq!(
            text,
            "no model `unett`: no such file, and no bundled model of that name\nhint: bundled models: unet.onnx, \
             wnet_c.onnx, wnet_c.toml"
        );
    }
}
