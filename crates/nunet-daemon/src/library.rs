//! Where ONNX Runtime's shared library is looked up, in this order: the flag (or `ORT_DYLIB_PATH`), beside the
//! executable (in Python: the package `onnxruntime` of the same interpreter), the active environment's Python packages,
//! the cache that `cargo xtask setup` fills, the system.

use std::path::{Path, PathBuf};

use anyhow::bail;

use crate::installation;

/// The release that the checks of this version ran with.
const VERSION: &str = "1.31.1";

/// A library that was found, and by which rule.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Found {
    pub(crate) path: PathBuf,
    pub(crate) place: &'static str,
}

/// Finds the library.
///
/// # Errors
/// The named file does not exist, or no place holds a library: every place is listed.
pub(crate) fn find(named: Option<&Path>) -> anyhow::Result<Found> {
    if let Some(path) = named.filter(|path| !path.as_os_str().is_empty()) {
        if path.is_file() {
            return Ok(Found { path: path.to_owned(), place: "named" });
        }
        bail!(
            "no ONNX Runtime library at `{}` (from --onnxruntime or ORT_DYLIB_PATH)\nhint: name the file itself, \
             such as `libonnxruntime.so.{VERSION}`, or leave both away to look in the usual places",
            path.display()
        );
    }
    let places = places();
    let found = places.iter().find_map(|place| {
        library_in(&place.folder, place.search).map(|path| Found { path, place: place.name })
    });
    found.ok_or_else(|| not_found(&places, installation::described().is_some()))
}

/// In Python there is no flag but the command's, and often no checkout.
fn not_found(places: &[Place], in_python: bool) -> anyhow::Error {
    let list: Vec<_> =
        places.iter().map(|place| format!("\n    {}: {}", place.name, place.folder.display())).collect();
    let hint = if in_python {
        format!(
            "Python 3.11 or newer brings it with `pip install onnxruntime=={VERSION}`; else name the file by the \
             environment's variable ORT_DYLIB_PATH"
        )
    } else {
        format!(
            "`cargo xtask setup` in a checkout, or `pip install onnxruntime=={VERSION}`, or name it with --onnxruntime \
             PATH"
        )
    };
    anyhow::anyhow!("ONNX Runtime's shared library was not found; looked in{}\nhint: {hint}", list.concat())
}

/// How a folder is searched.
#[derive(Debug, Clone, Copy)]
enum Search {
    /// The library lies in the folder.
    Here,
    /// The folder holds Python packages.
    PythonPackages,
}

#[derive(Debug)]
struct Place {
    name: &'static str,
    folder: PathBuf,
    search: Search,
}

fn places() -> Vec<Place> {
    let mut places = Vec::new();
    let mut add = |name, folder: PathBuf, search| places.push(Place { name, folder, search });
    if let Some(installation) = installation::described() {
        for folder in &installation.library_folders {
            add("this Python package's `onnxruntime`", folder.clone(), Search::Here);
        }
    } else if let Some(folder) = std::env::current_exe().ok().and_then(|exe| exe.parent().map(Path::to_owned))
    {
        add("beside the executable", folder.clone(), Search::Here);
        add("beside the executable", folder.with_file_name("lib").join("nunet"), Search::Here);
    }
    for prefix in ["VIRTUAL_ENV", "CONDA_PREFIX"].into_iter().filter_map(std::env::var_os) {
        for folder in site_packages(Path::new(&prefix)) {
            add("Python packages", folder, Search::PythonPackages);
        }
    }
    if let Some(cache) = cache_folder() {
        add("cache of `cargo xtask setup`", cache.join(format!("onnxruntime-{VERSION}")), Search::Here);
    }
    for folder in SYSTEM_FOLDERS {
        add("system", PathBuf::from(folder), Search::Here);
    }
    places
}

const SYSTEM_FOLDERS: [&str; 5] =
    ["/usr/local/lib", "/usr/lib", "/usr/lib64", "/usr/lib/x86_64-linux-gnu", "/usr/lib/aarch64-linux-gnu"];

fn site_packages(prefix: &Path) -> Vec<PathBuf> {
    let pattern = prefix.join("lib/python3*/site-packages");
    let found = glob::glob(&pattern.to_string_lossy());
    found.map(|paths| paths.flatten().collect()).unwrap_or_default()
}

/// `$XDG_CACHE_HOME/nunet`, else `~/.cache/nunet`.
pub(crate) fn cache_folder() -> Option<PathBuf> {
    let absolute = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let base = absolute("XDG_CACHE_HOME").or_else(|| absolute("HOME").map(|home| home.join(".cache")));
    base.map(|base| base.join("nunet"))
}

fn library_in(folder: &Path, search: Search) -> Option<PathBuf> {
    let pattern = match search {
        Search::Here => folder.join("libonnxruntime.so*"),
        Search::PythonPackages => folder.join("onnxruntime/capi/libonnxruntime.so*"),
    };
    let mut found: Vec<_> = glob::glob(&pattern.to_string_lossy()).ok()?.flatten().collect();
    // Of several releases the newest.
    found.sort_by_key(|path| version_of(path));
    found.pop()
}

/// `libonnxruntime.so.1.31.1` -> `[1, 31, 1]`
fn version_of(path: &Path) -> Vec<u32> {
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    name.split('.').filter_map(|part| part.parse().ok()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_several_releases_the_newest_is_taken() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["libonnxruntime.so", "libonnxruntime.so.1.9.0", "libonnxruntime.so.1.31.1", "other.so.2"]
        {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        let found = library_in(folder.path(), Search::Here).unwrap();
        assert_eq!(found.file_name().unwrap(), "libonnxruntime.so.1.31.1");
    }

    #[test]
    fn a_named_file_that_is_missing_is_an_error_and_nothing_else_is_taken() {
        let error = find(Some(Path::new("/nonexistent/lib.so"))).unwrap_err().to_string();
        assert!(error.starts_with("no ONNX Runtime library at `/nonexistent/lib.so`"), "{error}");
        assert!(error.contains("\nhint: "), "{error}");
    }

    #[test]
    fn a_failed_search_lists_every_place_and_the_mend() {
        let places = places();
        let error = not_found(&places, false).to_string();
        for place in &places {
            assert!(error.contains(&place.folder.display().to_string()), "{error}");
        }
        assert!(error.contains("cargo xtask setup"), "{error}");
    }

    #[test]
    fn in_python_the_mend_is_one_of_pythons() {
        let error = not_found(&places(), true).to_string();
        assert!(error.contains("\nhint: Python 3.11 or newer"), "{error}");
        assert!(error.contains("ORT_DYLIB_PATH") && !error.contains("--onnxruntime"), "{error}");
    }
}
