//! Searches ONNX Runtime's shared library: the given path, the installation (beside the executable; in
//! Python, the package `onnxruntime`), the active environment's Python packages, the cache that `cargo xtask
//! setup` fills, the system's folders.

use std::path::{Path, PathBuf};

use nunet_core::graph::Runtime;
use nunet_types::printable;

use crate::error::EngineError;
use crate::installation::installation;
use crate::telemetry::Telemetry;
use crate::text::ONNX_RUNTIME_VERSION;

/// A library that was found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LibraryFile {
    /// The file.
    pub path: PathBuf,
    /// Which kind of place it was found in, such as `installation` or `system`.
    pub place: &'static str,
}

impl LibraryFile {
    /// Finds the library: at `path`, else in the usual places.
    ///
    /// # Errors
    /// The given path is not a file, or no library was found.
    pub fn find(path: Option<&Path>) -> Result<Self, EngineError> {
        if let Some(path) = path.filter(|path| !path.as_os_str().is_empty()) {
            return if path.is_file() {
                Ok(Self { path: path.to_owned(), place: "named" })
            } else {
                Err(EngineError::NoLibraryAt { path: path.to_owned() })
            };
        }
        let places = places();
        let found = places.iter().find_map(|place| {
            library_in(&place.folder, place.layout).map(|path| Self { path, place: place.name })
        });
        found.ok_or_else(|| not_found(&places))
    }
}

impl LibraryFile {
    /// Loads the library into this process, with its telemetry off by default, and asks for its version.
    ///
    /// # Errors
    /// A file that is not a usable ONNX Runtime, or another library than the process has loaded already.
    pub fn version(&self) -> Result<String, EngineError> {
        Telemetry::turn_off_by_default();
        Ok(Runtime::load(&self.path)?.version().to_owned())
    }
}

fn not_found(places: &[SearchFolder]) -> EngineError {
    let line = |place: &SearchFolder| {
        format!("\n    {}: {}", place.name, printable::one_line(&place.folder.to_string_lossy()))
    };
    EngineError::LibraryNotFound { places: places.iter().map(line).collect() }
}

/// The location of the library in a folder.
#[derive(Debug, Clone, Copy)]
enum FolderLayout {
    /// In the folder itself.
    Flat,
    /// In a package of the folder.
    PythonPackages,
}

#[derive(Debug)]
struct SearchFolder {
    name: &'static str,
    folder: PathBuf,
    layout: FolderLayout,
}

const SYSTEM_FOLDERS: [&str; 5] =
    ["/usr/local/lib", "/usr/lib", "/usr/lib64", "/usr/lib/x86_64-linux-gnu", "/usr/lib/aarch64-linux-gnu"];

fn places() -> Vec<SearchFolder> {
    let mut places = Vec::new();
    let mut add = |name, folder: PathBuf, layout| places.push(SearchFolder { name, folder, layout });
    for folder in &installation().library_folders {
        add("installation", folder.clone(), FolderLayout::Flat);
    }
    for prefix in ["VIRTUAL_ENV", "CONDA_PREFIX"].into_iter().filter_map(std::env::var_os) {
        for folder in site_packages(Path::new(&prefix)) {
            add("Python packages", folder, FolderLayout::PythonPackages);
        }
    }
    if let Some(cache) = cache_folder() {
        add(
            "cache of `cargo xtask setup`",
            cache.join(format!("onnxruntime-{ONNX_RUNTIME_VERSION}")),
            FolderLayout::Flat,
        );
    }
    for folder in SYSTEM_FOLDERS {
        add("system", PathBuf::from(folder), FolderLayout::Flat);
    }
    places
}

fn site_packages(prefix: &Path) -> Vec<PathBuf> {
    let pattern = prefix.join("lib/python3*/site-packages");
    let found = glob::glob(&pattern.to_string_lossy());
    found.map(|paths| paths.flatten().collect()).unwrap_or_default()
}

/// nunet's cache: `$XDG_CACHE_HOME/nunet`, else `~/.cache/nunet`. `None` if neither variable is an absolute
/// path.
#[must_use]
pub fn cache_folder() -> Option<PathBuf> {
    let absolute = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let base = absolute("XDG_CACHE_HOME").or_else(|| absolute("HOME").map(|home| home.join(".cache")));
    base.map(|base| base.join("nunet"))
}

fn library_in(folder: &Path, layout: FolderLayout) -> Option<PathBuf> {
    let pattern = match layout {
        FolderLayout::Flat => folder.join("libonnxruntime.so*"),
        FolderLayout::PythonPackages => folder.join("onnxruntime/capi/libonnxruntime.so*"),
    };
    let mut found: Vec<_> = glob::glob(&pattern.to_string_lossy()).ok()?.flatten().collect();
    // The newest of several releases.
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
    use nunet_types::Hint as _;

    use super::*;

    #[test]
    fn the_newest_of_several_releases_is_taken() {
        let folder = tempfile::tempdir().unwrap();
        let names =
            ["libonnxruntime.so", "libonnxruntime.so.1.9.0", "libonnxruntime.so.1.31.1", "other.so.2"];
        for name in names {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        let found = library_in(folder.path(), FolderLayout::Flat).unwrap();
        assert_eq!(found.file_name().unwrap(), "libonnxruntime.so.1.31.1");
    }

    #[test]
    fn a_path_that_does_not_exist_is_an_error_and_nothing_else_is_taken() {
        let error = LibraryFile::find(Some(Path::new("/nonexistent/lib.so"))).unwrap_err();
        assert!(matches!(&error, EngineError::NoLibraryAt { path } if path.ends_with("lib.so")), "{error}");
        assert!(error.hint().is_some());
    }

    #[test]
    fn a_failed_search_lists_every_place() {
        let places = places();
        let error = not_found(&places);
        for place in &places {
            assert!(error.to_string().contains(&place.folder.display().to_string()), "{error}");
        }
        assert!(error.hint().unwrap().contains("cargo xtask setup"));
    }
}
