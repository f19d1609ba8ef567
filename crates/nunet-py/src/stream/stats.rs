//! The statistics that the daemon publishes.

use nunet_engine::hexadecimal;
use nunet_ipc::StatsRecord;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Statistics of the daemon: counts of frames, rates and latencies. A copy, not a view.
///
/// `captured == published + superseded + failed + in_flight` at any time.
#[pyclass(frozen, name = "Stats", module = "nunet_py")]
#[derive(Debug, Clone)]
pub(crate) struct PyStats {
    /// Frames delivered by the source.
    #[pyo3(get)]
    captured: u64,
    /// Frames whose depth was published.
    #[pyo3(get)]
    published: u64,
    /// Frames replaced by a newer one before they were processed.
    #[pyo3(get)]
    superseded: u64,
    /// Frames that ended with an error.
    #[pyo3(get)]
    failed: u64,
    /// Frames that are still being processed.
    #[pyo3(get)]
    in_flight: u64,
    /// Published frames per second, since the first one.
    #[pyo3(get)]
    fps: f64,
    /// Mean number of bytes copied per frame.
    #[pyo3(get)]
    bytes_copied_per_frame: f64,
    /// Mean number of heap allocations per frame; NaN if they are not counted.
    #[pyo3(get)]
    allocations_per_frame: f64,
    /// Growth of the scale of depth per frame, mean of the last frames: 0.01 is one percent. `None` while the
    /// image changes.
    #[pyo3(get)]
    depth_drift: Option<f64>,
    /// Change of points per frame beside the scale, mean of the last frames: 0.01 is one percent. `None`
    /// while the image changes.
    #[pyo3(get)]
    depth_flicker: Option<f64>,
    /// Whether drift or flicker is above the daemon's `--stability-limit`.
    #[pyo3(get)]
    is_unstable: bool,
    /// The name of the model file.
    #[pyo3(get)]
    model_name: String,
    /// SHA-256 of the model file, in hexadecimal.
    #[pyo3(get)]
    model_hash: String,
    /// The execution provider.
    #[pyo3(get)]
    provider: String,
    total: Times,
    stages: Vec<(String, Times)>,
}

/// p50, p90, p99, max and mean, in microseconds.
type Times = [f64; 5];

const TIME_NAMES: [&str; 5] = ["p50", "p90", "p99", "max", "mean"];

impl PyStats {
    pub(super) fn read(record: &StatsRecord) -> Self {
        let stages = record.stage_names().enumerate().map(|(index, name)| {
            let times = [
                record.stage_p50_us[index],
                record.stage_p90_us[index],
                record.stage_p99_us[index],
                record.stage_max_us[index],
                record.stage_mean_us[index],
            ];
            (name.into_owned(), times)
        });
        Self {
            captured: record.captured,
            published: record.published,
            superseded: record.superseded,
            failed: record.failed,
            in_flight: record.in_flight,
            fps: record.fps,
            bytes_copied_per_frame: record.bytes_copied_per_frame,
            allocations_per_frame: record.allocations_per_frame,
            depth_drift: record.stability().map(|[drift, _]| drift),
            depth_flicker: record.stability().map(|[_, flicker]| flicker),
            is_unstable: record.is_unstable == 1,
            model_name: record.model_name().into_owned(),
            model_hash: hexadecimal(&record.model_hash),
            provider: record.provider().into_owned(),
            total: [
                record.total_p50_us,
                record.total_p90_us,
                record.total_p99_us,
                record.total_max_us,
                record.total_mean_us,
            ],
            stages: stages.collect(),
        }
    }
}

#[pymethods]
impl PyStats {
    /// Milliseconds from the image's arrival at the daemon to publication: `p50`, `p90`, `p99`, `max`,
    /// `mean`.
    #[getter]
    fn total_ms<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        in_ms(py, &self.total)
    }

    /// Milliseconds of each stage by its name, in the order in which they run, with the keys of `total_ms`.
    #[getter]
    fn stages_ms<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let stages = PyDict::new(py);
        for (name, times) in &self.stages {
            stages.set_item(name, in_ms(py, times)?)?;
        }
        Ok(stages)
    }

    fn __repr__(&self) -> String {
        format!(
            "Stats(captured={}, published={}, superseded={}, failed={}, in_flight={}, fps={:.1}, model_name={:?})",
            self.captured,
            self.published,
            self.superseded,
            self.failed,
            self.in_flight,
            self.fps,
            self.model_name
        )
    }
}

fn in_ms<'py>(py: Python<'py>, times: &Times) -> PyResult<Bound<'py, PyDict>> {
    let named = PyDict::new(py);
    for (name, micros) in TIME_NAMES.iter().zip(times) {
        named.set_item(name, micros / 1e3)?;
    }
    Ok(named)
}
