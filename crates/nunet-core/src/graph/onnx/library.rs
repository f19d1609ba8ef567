#![expect(unsafe_code, reason = "checks a shared library before it is used")]

//! Checks whether a shared library is ONNX Runtime, and which version.
//!
//! ort panics for a wrong library, so it is checked first.

use std::ffi::CStr;
use std::path::Path;

use super::error::RuntimeError;

type GetApiBase = unsafe extern "C" fn() -> *const ort::sys::OrtApiBase;

/// The version of the ONNX Runtime at `path`, an absolute path to a plain file.
///
/// # Errors
/// A file that is not a shared library, a library other than ONNX Runtime, and one that is too old for the
/// interface of this build.
pub(super) fn version(path: &Path) -> Result<String, RuntimeError> {
    // SAFETY: loading runs the library's initializers, which is what the user asked for by naming it; it
    // stays loaded for the whole of this function, and everything read from it is copied.
    let library = unsafe { libloading::Library::new(path) }.map_err(|error| RuntimeError::NotALibrary {
        library: path.to_owned(),
        reason: reason(&error, path),
    })?;
    let not_onnx_runtime = || RuntimeError::NotOnnxRuntime { library: path.to_owned() };
    // SAFETY: the symbol has had this type in each ONNX Runtime since 1.0; no other library is known to
    // export it.
    let get_base = unsafe { library.get::<GetApiBase>(b"OrtGetApiBase") }.map_err(|_| not_onnx_runtime())?;
    // SAFETY: it takes nothing and returns a pointer to a static table, or null.
    let base = unsafe { get_base() };
    // SAFETY: the table is static in the library, which `library` keeps loaded.
    let base = unsafe { base.as_ref() }.ok_or_else(not_onnx_runtime)?;
    // SAFETY: a function of the table, which returns a static text.
    let text = unsafe { (base.GetVersionString)() };
    if text.is_null() {
        return Err(not_onnx_runtime());
    }
    // SAFETY: not null, static in the library, ends with a zero as the interface says.
    let version = unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned();
    // SAFETY: a function of the table; it returns null for an interface newer than the library.
    let api = unsafe { (base.GetApi)(ort::MINOR_VERSION) };
    if api.is_null() || minor(&version) < ort::MINOR_VERSION {
        return Err(RuntimeError::TooOld { library: path.to_owned(), version, minimum: ort::MINOR_VERSION });
    }
    Ok(version)
}

/// The linker's words without the path, which the error names already.
fn reason(error: &libloading::Error, path: &Path) -> String {
    let words = std::error::Error::source(error).map_or_else(|| error.to_string(), ToString::to_string);
    words.trim_start_matches(&*path.to_string_lossy()).trim_start_matches(": ").to_owned()
}

/// The second number of `1.31.1`, as ort itself reads it.
fn minor(version: &str) -> u32 {
    version.split('.').nth(1).and_then(|text| text.parse().ok()).unwrap_or(0)
}
