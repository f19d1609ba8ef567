//! Obstacles around the robot.

use std::error::Error;

use numpy::ndarray::Array2;
use numpy::{PyArray1, PyArray2};
use nunet_core::camera::{Camera, Mount};
use nunet_core::depth::DepthImage;
use nunet_core::obstacle::{ObstacleDetector, ObstacleOptions};
use nunet_ipc::{ObstacleRecord, ObstacleSector};
use nunet_types::{ObstacleMap, counted};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use crate::argument::taken;
use crate::error::hinted;

/// Obstacles in the leveled base frame of the robot: x forward, y left, z up, origin on the floor. Meters and
/// radians.
///
/// A direction is free only up to its range, and only if its floor was seen. Sectors are sorted
/// counterclockwise: the first one is the rightmost. The floor nearer than `seen_from` is below the image and
/// was not seen.
///
/// Attributes
/// ----------
/// states : tuple of str
///     (N): what is at the range of each sector: `occupied` (an obstacle), `drop` (the floor ends), `unknown`
///     (nothing is known from there on) or `free` (the search range or the image ends).
/// ranges : numpy.ndarray
///     float32 (N): how far each sector is free.
/// angles : numpy.ndarray
///     float32 (N): the middle of each sector; 0 is forward, positive is left.
/// obstacle_ranges : numpy.ndarray
///     float32 (N): the nearest obstacle, whatever the state; NaN without one.
/// heights : numpy.ndarray
///     float32 (N, 2): the lowest and highest point of the nearest obstacle above ground; NaN without one.
/// seen_from : numpy.ndarray
///     float32 (N): the nearest floor that the camera sees; NaN if it sees none.
/// labels : numpy.ndarray
///     uint8 (N): the class of the nearest obstacle; 255 without one.
/// remembered : numpy.ndarray
///     bool (N): whether the obstacle was seen in an earlier frame and left the image at the bottom.
/// points : numpy.ndarray
///     float32 (M, 4): points of obstacles: x, y, z, and height above ground.
/// point_labels : numpy.ndarray
///     uint8 (M): their classes; 255 for none.
/// point_confidences : numpy.ndarray
///     uint8 (M): 255 = certain.
/// ground : tuple of float
///     Rise per meter forward, rise per meter to the left, height at the origin.
/// ground_refined : bool
///     Whether the ground was measured. If not, it is the plane that follows from the mount.
/// floor_fraction : float
///     The share of the image that shows floor.
/// used_labels : bool
///     Whether labels identified floor and glass; if not, only geometry did.
/// used_attitude : bool
///     Whether the robot's attitude at the capture time turned the mount (`nunetd --attitude`). If not, the
///     robot counts as level.
#[pyclass(frozen, get_all, name = "Obstacles", module = "nunet_py")]
pub(crate) struct PyObstacles {
    states: Py<PyTuple>,
    ranges: Py<PyArray1<f32>>,
    angles: Py<PyArray1<f32>>,
    obstacle_ranges: Py<PyArray1<f32>>,
    heights: Py<PyArray2<f32>>,
    seen_from: Py<PyArray1<f32>>,
    labels: Py<PyArray1<u8>>,
    remembered: Py<PyArray1<bool>>,
    points: Py<PyArray2<f32>>,
    point_labels: Py<PyArray1<u8>>,
    point_confidences: Py<PyArray1<u8>>,
    ground: (f32, f32, f32),
    ground_refined: bool,
    floor_fraction: f32,
    used_labels: bool,
    used_attitude: bool,
}

const MOUNT_EXAMPLE: &str =
    "pass (x, y, z, roll, pitch, yaw), meters and radians, such as (0.1, 0, 0.25, 0, -0.07, 0)";

/// The common fields of obstacles in a message and obstacles of a depth map.
struct ObstacleParts<'a> {
    map: ObstacleMap<'a>,
    ground: (f32, f32, f32),
    ground_refined: bool,
    floor_fraction: f32,
    used_labels: bool,
    used_attitude: bool,
}

impl PyObstacles {
    /// The obstacles of a message.
    pub(crate) fn of_record(py: Python<'_>, record: &ObstacleRecord) -> PyResult<Self> {
        Self::new(
            py,
            &ObstacleParts {
                map: record.map(),
                ground: (record.ground_slope_x, record.ground_slope_y, record.ground_height_m),
                ground_refined: record.ground_refined != 0,
                floor_fraction: record.floor_fraction,
                used_labels: record.used_labels != 0,
                used_attitude: record.used_attitude != 0,
            },
        )
    }

    /// The obstacles of one depth map in meters.
    pub(crate) fn of_depth(
        py: Python<'_>,
        image: &DepthImage<'_>,
        camera: &Camera,
        mount: Mount,
        classes: &[String],
        options: ObstacleOptions,
    ) -> PyResult<Self> {
        let mut detector =
            ObstacleDetector::new(camera, mount, classes, options).map_err(|error| refused(&error))?;
        let found = py.detach(|| detector.detect(image, 0).cloned()).map_err(|error| refused(&error))?;
        let ground = found.ground;
        Self::new(
            py,
            &ObstacleParts {
                map: found.map(),
                ground: (ground.slope_x, ground.slope_y, ground.height_m),
                ground_refined: ground.is_refined,
                floor_fraction: ground.floor_fraction,
                used_labels: found.used_labels,
                used_attitude: false,
            },
        )
    }

    fn new(py: Python<'_>, parts: &ObstacleParts<'_>) -> PyResult<Self> {
        let ObstacleMap { sectors, points, .. } = parts.map;
        let of_sectors = |value: fn(&ObstacleSector) -> f32| floats(py, sectors.iter().map(value));
        Ok(Self {
            states: PyTuple::new(py, sectors.iter().map(|sector| sector.state().name()))?.unbind(),
            ranges: of_sectors(|sector| sector.range_m),
            angles: floats(py, (0..sectors.len()).map(|index| parts.map.angle_rad(index))),
            obstacle_ranges: of_sectors(|sector| sector.obstacle_m),
            heights: table(py, sectors.iter().map(|sector| [sector.min_height_m, sector.max_height_m])),
            seen_from: of_sectors(|sector| sector.seen_from_m),
            labels: PyArray1::from_iter(py, sectors.iter().map(|sector| sector.label)).unbind(),
            remembered: PyArray1::from_iter(py, sectors.iter().map(|sector| sector.remembered != 0)).unbind(),
            points: table(py, points.iter().map(|point| [point.x, point.y, point.z, point.height])),
            point_labels: PyArray1::from_iter(py, points.iter().map(|point| point.label)).unbind(),
            point_confidences: PyArray1::from_iter(py, points.iter().map(|point| point.confidence)).unbind(),
            ground: parts.ground,
            ground_refined: parts.ground_refined,
            floor_fraction: parts.floor_fraction,
            used_labels: parts.used_labels,
            used_attitude: parts.used_attitude,
        })
    }
}

#[pymethods]
impl PyObstacles {
    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let states: Vec<String> = self.states.extract(py)?;
        let count = |state: &str| states.iter().filter(|found| *found == state).count();
        let words = ["occupied", "free", "unknown", "drop"].map(|state| format!("{} {state}", count(state)));
        Ok(format!("Obstacles({})", words.join(", ")))
    }
}

fn floats(py: Python<'_>, values: impl ExactSizeIterator<Item = f32>) -> Py<PyArray1<f32>> {
    PyArray1::from_iter(py, values).unbind()
}

/// One row for each array.
fn table<const COLUMNS: usize>(
    py: Python<'_>,
    rows: impl ExactSizeIterator<Item = [f32; COLUMNS]>,
) -> Py<PyArray2<f32>> {
    let shape = (rows.len(), COLUMNS);
    let values = rows.flatten().collect();
    let array = Array2::from_shape_vec(shape, values).expect("every row has the same length");
    PyArray2::from_owned_array(py, array).unbind()
}

/// The exception for a mount or an option of `obstacles` that cannot be used.
pub(crate) fn refused(error: &(dyn Error + 'static)) -> PyErr {
    match nunet_core::hint_of(error) {
        Some(hint) => hinted::<PyValueError>(error, hint),
        None => PyValueError::new_err(error.to_string()),
    }
}

/// The argument `mount`: numbers.
pub(crate) fn mount_argument(object: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
    taken("mount", object, "six numbers", MOUNT_EXAMPLE)
}

/// The optional argument `mount`.
pub(crate) fn optional_mount_argument(object: &Bound<'_, PyAny>) -> PyResult<Option<Vec<f64>>> {
    taken("mount", object, "six numbers", MOUNT_EXAMPLE)
}

/// The camera's pose, from six numbers.
///
/// # Errors
/// `ValueError` for another length, and for a camera that is not above the floor or looks straight up.
pub(crate) fn mount(numbers: &[f64]) -> PyResult<Mount> {
    let &[x, y, z, roll, pitch, yaw] = numbers else {
        return Err(hinted::<PyValueError>(
            format!("`mount` has {}; expected 6", counted(numbers.len(), "number")),
            MOUNT_EXAMPLE,
        ));
    };
    Mount::new([x, y, z], [roll, pitch, yaw]).map_err(|error| refused(&error))
}

pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyObstacles>()
}
