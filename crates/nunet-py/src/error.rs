//! Exceptions, and which of them a failure becomes.

use pyo3::create_exception;
use pyo3::exceptions::PyException;
use pyo3::prelude::*;

create_exception!(
    nunet_py,
    NunetError,
    PyException,
    "What nunet_py raises where Python has no exception of its own. The text says what, where, expected and got, and \
     ends with a line `hint: ...`."
);
create_exception!(
    nunet_py,
    ModelError,
    NunetError,
    "A model file that cannot be used, or a network that did not run."
);
create_exception!(nunet_py, WiringError, NunetError, "Stages of a graph that do not fit together.");
create_exception!(
    nunet_py,
    CameraError,
    NunetError,
    "Intrinsics or a lens that no camera has, or that do not fit the picture."
);
create_exception!(
    nunet_py,
    ContractVersionError,
    NunetError,
    "A daemon that publishes another version of the shared-memory contract."
);

pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    module.add("NunetError", py.get_type::<NunetError>())?;
    module.add("ModelError", py.get_type::<ModelError>())?;
    module.add("WiringError", py.get_type::<WiringError>())?;
    module.add("CameraError", py.get_type::<CameraError>())?;
    module.add("ContractVersionError", py.get_type::<ContractVersionError>())
}
