//! From `--model NAME|PATH` to a file: an existing path first, then the bundled models.

use std::path::{Path, PathBuf};

use anyhow::bail;

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
    installed.into_iter().chain(checkouts.skip(1)).filter(|folder| folder.is_dir()).collect()
}

fn not_found(name: &Path, folders: &[PathBuf]) -> String {
    let mut text = format!("no model `{}`: no such file", name.display());
    if is_bare_name(name) {
        let names = bundled_names(folders);
        text += ", and no bundled model of that name";
        text += &if names.is_empty() {
            format!(
                "\nhint: bundled models are looked up in the folder that {FOLDER_VARIABLE} names; give a path otherwise"
            )
        } else {
            format!("\nhint: bundled models: {}", names.join(", "))
        };
    } else {
        text += "\nhint: a path is taken as it stands; a bundled model is called by its bare name, such as `wnet_c.onnx`";
    }
    text
}

fn bundled_names(folders: &[PathBuf]) -> Vec<String> {
    let files = folders.iter().filter_map(|folder| folder.read_dir().ok()).flatten().flatten();
    let names = files.map(|file| file.file_name().to_string_lossy().into_owned());
    let mut names: Vec<_> = names.filter(|name| name.ends_with(".onnx") || name.ends_with(".toml")).collect();
    names.sort();
    names.dedup();
    names
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
    fn an_unknown_name_lists_what_there_is() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("unet.onnx"), "").unwrap();
        let text = not_found(Path::new("unett"), &[folder.path().to_owned()]);
        assert_eq!(
            text,
            "no model `unett`: no such file, and no bundled model of that name\nhint: bundled models: unet.onnx"
        );
    }
}
