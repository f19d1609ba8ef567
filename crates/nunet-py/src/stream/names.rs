//! Whether an array is looked at by plain variables alone.

use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use super::view::references;

/// Frames that are searched: the one that leaves the block, and those of `contextlib` above it, such as `ExitStack`'s.
const FRAMES: usize = 4;

/// `CO_OPTIMIZED` of a code object: its variables are no dictionary.
const OPTIMIZED: u32 = 1;

/// Whether all references to `array`, but `ours`, are variables of the code that runs.
///
/// A variable is as read-only as the array itself. Anything else may be a buffer, a capsule or a tensor, which keeps the
/// right to write that it had when it was made. A reference does not tell which it is, so only those are let pass that are
/// found among the variables.
pub(super) fn are_all(array: &Bound<'_, PyAny>, ours: isize) -> bool {
    references(array) <= ours || search(array, ours).unwrap_or(false)
}

fn search(array: &Bound<'_, PyAny>, ours: isize) -> PyResult<bool> {
    let mut frame = array.py().import("sys")?.getattr("_getframe")?.call0()?;
    for _ in 0..FRAMES {
        let names = variables(&frame, array)?;
        // Counted last: nothing runs between the two but what is written here.
        if references(array) - ours <= names {
            return Ok(true);
        }
        let module = frame.getattr("f_globals")?.get_item("__name__")?;
        frame = frame.getattr("f_back")?;
        if frame.is_none() || module.extract::<String>()? != "contextlib" {
            break;
        }
    }
    Ok(false)
}

/// How many variables of a frame are this object.
fn variables(frame: &Bound<'_, PyAny>, object: &Bound<'_, PyAny>) -> PyResult<isize> {
    let flags: u32 = frame.getattr("f_code")?.getattr("co_flags")?.extract()?;
    let locals = || frame.getattr("f_locals");
    let Ok(copy) = locals()?.cast_into_exact::<PyDict>() else {
        // From Python 3.13 on a function's variables themselves, behind a proxy.
        let values = locals()?.call_method0("values")?;
        return Ok(count(&values.cast_into()?, object));
    };
    if flags & OPTIMIZED == 0 {
        return Ok(count(&copy.values(), object)); // of a module: the variables themselves
    }
    // Up to Python 3.12 a copy, which the frame keeps: it would hold what the variables hold, and longer than they do. Where
    // somebody else has it as well (by `locals()`) it stays as it is; what it holds is no variable.
    if references(copy.as_any()) > 2 {
        return Ok(0);
    }
    copy.clear();
    let found = count(&locals()?.cast_into::<PyDict>()?.values(), object);
    copy.clear();
    Ok(found)
}

fn count(values: &Bound<'_, PyList>, object: &Bound<'_, PyAny>) -> isize {
    values.iter().filter(|value| value.is(object)).count() as isize
}
