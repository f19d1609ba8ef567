//! The options of a model: provider, threads and filters.

use std::num::NonZeroUsize;

use nunet_core::filter::{FilterError, FilterOptions, FilterSpec};
use nunet_core::framing::AspectMode;
use nunet_core::graph::Provider;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyString;

use crate::argument::shown;
use crate::error::{exception, hinted, report};

/// The execution provider by its name.
pub(super) fn provider(name: &str) -> PyResult<Provider> {
    let names: Vec<_> = Provider::ALL.iter().map(|provider| provider.name()).collect();
    let known = Provider::ALL.into_iter().find(|provider| provider.name() == name);
    known.ok_or_else(|| {
        let hint = format!("pass one of {}", names.join(", "));
        hinted::<PyValueError>(format!("`provider` is `{name}`; expected an execution provider"), hint)
    })
}

/// The mode for images of another aspect ratio by its name.
pub(super) fn aspect(name: &str) -> PyResult<AspectMode> {
    let modes = [AspectMode::Crop, AspectMode::Stretch, AspectMode::Letterbox];
    modes.into_iter().find(|mode| mode.name() == name).ok_or_else(|| {
        let text = format!("`aspect` is `{name}`; expected a way to take images of another aspect ratio");
        hinted::<PyValueError>(text, format!("pass one of {}", modes.map(AspectMode::name).join(", ")))
    })
}

/// The number of threads; `None` for one per core.
pub(super) fn threads(count: Option<i64>) -> PyResult<Option<NonZeroUsize>> {
    let Some(count) = count else { return Ok(None) };
    match usize::try_from(count).ok().and_then(NonZeroUsize::new) {
        Some(threads) => Ok(Some(threads)),
        None => Err(hinted::<PyValueError>(
            format!("`threads` is `{count}`; expected 1 or more"),
            "omit it to use one per core",
        )),
    }
}

/// Filters as a user writes them: one, or several.
pub(super) fn filters(given: &Bound<'_, PyAny>) -> PyResult<Vec<FilterSpec>> {
    let words: Vec<String> = if given.is_instance_of::<PyString>() {
        vec![given.extract()?]
    } else {
        given.try_iter().and_then(|each| each.map(|word| word?.extract()).collect()).map_err(|_| {
            hinted::<PyTypeError>(
                format!("`filters` is `{}`; expected a str or a sequence of str", shown(given)),
                "write them as in `nunetd --filter`, `filters=[\"spatial\", \"temporal=alpha:0.4\"]`",
            )
        })?
    };
    let refused = |error: FilterError| exception::<PyValueError>(&report(&error));
    let filters: Vec<FilterSpec> =
        words.iter().map(|word| word.parse()).collect::<Result<_, _>>().map_err(refused)?;
    FilterOptions::new(&filters).map_err(refused)?;
    Ok(filters)
}
