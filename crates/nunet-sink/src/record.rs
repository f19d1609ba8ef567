//! A copy of one frame with its results; the memory is reused. Everything is little-endian, like shared
//! memory.

use nunet_core::camera::Camera;
use nunet_core::obstacle::Obstacles;
use nunet_ipc::Units;
use nunet_mcap::{CameraDescription, CloudRecord, DepthRecord, ObstacleMapRecord, ScaleRecord};
use nunet_source::{Frame, Pixels};
use nunet_types::{ImageSize, MAX_OBSTACLE_POINTS};

use crate::results::Results;

/// A copy of a frame for a recording.
#[derive(Debug, Default)]
pub struct RecordedFrame {
    /// The image and its times.
    pub frame: Frame,
    /// The camera at the image's size.
    pub camera: Option<Camera>,
    /// The camera at the size of depth.
    pub depth_camera: Option<Camera>,
    scale: ScaleRecord,
    size: ImageSize,
    depth: Vec<u8>,
    labels: Vec<u8>,
    confidence: Vec<u8>,
    cloud_size: ImageSize,
    cloud: Vec<u8>,
    /// The obstacles of the last frame that had some; their memory is reused.
    obstacles: Option<Obstacles>,
    has_obstacles: bool,
    obstacle_frame: &'static str,
    roll_pitch_rad: Option<[f32; 2]>,
}

impl RecordedFrame {
    /// Takes a frame, and its camera at the image's size. Memory of another process is returned at once.
    pub fn take(&mut self, mut frame: Frame, camera: Option<Camera>) {
        if let Pixels::Shared(sample) = &frame.pixels {
            frame.pixels = Pixels::Owned(sample.bytes().to_vec());
        }
        self.frame = frame;
        self.camera = camera;
    }

    /// Copies a frame, and its camera at the size of the image. If the image came as a file, the file is
    /// enough.
    pub fn copy_frame(&mut self, frame: &Frame, camera: Option<Camera>) {
        let own = &mut self.frame;
        // The length of files varies. Room for the raw image is enough for all of them, so that later frames
        // allocate nothing.
        own.file.clear();
        own.file.reserve(frame.file.len().max(raw_bytes(frame.size)));
        own.file.extend_from_slice(&frame.file);
        if frame.file.is_empty()
            && let Ok(view) = frame.view()
        {
            own.buffer(view.bytes().len()).copy_from_slice(view.bytes());
        }
        own.is_turned = frame.is_turned;
        (own.size, own.row_stride, own.format) = (frame.size, frame.row_stride, frame.format);
        (own.sequence, own.capture, own.ready_nanos) = (frame.sequence, frame.capture, frame.ready_nanos);
        (own.camera, own.segment, own.in_real_time) = (frame.camera, frame.segment, frame.in_real_time);
        own.frame_id.clone_from(&frame.frame_id);
        self.camera = camera;
    }

    /// Copies the results of a frame.
    pub fn copy_results(&mut self, results: &Results<'_>) {
        self.clear();
        self.scale = ScaleRecord {
            units: results.scale.units.name(),
            source: results.scale.source.name(),
            factor: results.scale.factor,
            age_nanos: results.scale.age_nanos,
        };
        self.size = results.size;
        self.depth.extend_from_slice(bytemuck::cast_slice(results.depth));
        self.labels.extend_from_slice(results.labels.unwrap_or_default());
        self.confidence.extend_from_slice(results.confidence.unwrap_or_default());
        self.cloud_size = results.cloud_size;
        self.cloud.extend_from_slice(bytemuck::cast_slice(results.cloud.unwrap_or_default()));
        self.depth_camera = results.camera;
        self.copy_obstacles(results.obstacles);
        self.obstacle_frame = results.obstacle_frame;
        self.roll_pitch_rad = results.roll_pitch_rad;
    }

    fn copy_obstacles(&mut self, found: Option<&Obstacles>) {
        self.has_obstacles = found.is_some();
        match (&mut self.obstacles, found) {
            (_, None) => {}
            (Some(own), Some(found)) => {
                // Field by field, so that the memory is reused. The pattern names all fields, so that a new
                // field is not forgotten.
                let Obstacles {
                    ground,
                    sectors,
                    points,
                    angle_min_rad,
                    angle_step_rad,
                    max_range_m,
                    used_labels,
                } = found;
                own.sectors.clone_from(sectors);
                own.points.clone_from(points);
                (own.ground, own.used_labels, own.max_range_m) = (*ground, *used_labels, *max_range_m);
                (own.angle_min_rad, own.angle_step_rad) = (*angle_min_rad, *angle_step_rad);
            }
            (own @ None, Some(found)) => {
                let own = own.insert(found.clone());
                // The number of points varies. Room for the largest number is reserved, so that later frames
                // allocate nothing.
                own.points.reserve_exact(MAX_OBSTACLE_POINTS.saturating_sub(own.points.len()));
            }
        }
    }

    fn clear(&mut self) {
        self.depth.clear();
        self.labels.clear();
        self.confidence.clear();
        self.cloud.clear();
        self.depth_camera = None;
    }

    /// Depth in the form of a recording.
    #[must_use]
    pub fn depth(&self) -> DepthRecord<'_> {
        let ImageSize { width, height } = self.size;
        DepthRecord { scale: self.scale, width, height, bytes: &self.depth }
    }

    /// Labels; `None` if the frame has none.
    #[must_use]
    pub fn labels(&self) -> Option<&[u8]> {
        (!self.labels.is_empty()).then_some(&self.labels)
    }

    /// The confidence of depth; `None` if the frame has none.
    #[must_use]
    pub fn confidence(&self) -> Option<&[u8]> {
        (!self.confidence.is_empty()).then_some(&self.confidence)
    }

    /// Obstacles; `None` if the frame has none.
    #[must_use]
    pub fn obstacles(&self) -> Option<ObstacleMapRecord<'_>> {
        let found = self.obstacles.as_ref().filter(|_| self.has_obstacles)?;
        Some(ObstacleMapRecord { frame_id: self.obstacle_frame, map: found.map() })
    }

    /// Roll and pitch of the robot's base that turned the mount, radians; `None` if it counts as level.
    #[must_use]
    pub fn roll_pitch_rad(&self) -> Option<[f32; 2]> {
        self.roll_pitch_rad
    }

    /// Points. Readers of ROS messages expect meters, so depth without a unit has no points.
    #[must_use]
    pub fn cloud(&self) -> Option<CloudRecord<'_>> {
        let ImageSize { width, height } = self.cloud_size;
        (!self.cloud.is_empty() && self.scale.units == Units::Metre.name()).then_some(CloudRecord {
            width,
            height,
            bytes: &self.cloud,
        })
    }
}

/// Bytes of an image in RGB; 0 if nothing can have that size.
fn raw_bytes(ImageSize { width, height }: ImageSize) -> usize {
    let bytes = u64::from(width).checked_mul(height.into()).and_then(|pixels| pixels.checked_mul(3));
    bytes.and_then(|bytes| bytes.try_into().ok()).unwrap_or(0)
}

/// A camera as ROS describes it.
#[must_use]
pub fn describe(camera: &Camera) -> CameraDescription {
    let intrinsics = camera.intrinsics;
    let (model, coefficients) = camera.distortion.to_ros();
    CameraDescription {
        width: intrinsics.width,
        height: intrinsics.height,
        intrinsics: [intrinsics.fx_px, intrinsics.fy_px, intrinsics.cx_px, intrinsics.cy_px],
        distortion_model: model.to_owned(),
        coefficients,
        skew: 0.0,
        fault: None,
    }
}

#[cfg(test)]
mod tests {
    use nunet_core::obstacle::{Ground, ObstaclePoint, ObstacleSector};

    use super::*;

    #[test]
    fn a_longer_file_fits_into_the_memory_of_a_shorter_one() {
        let mut record = RecordedFrame::default();
        let file = |bytes| Frame { file: vec![1; bytes], size: ImageSize::new(640, 480), ..Frame::default() };
        record.copy_frame(&file(50_000), None);
        let memory = record.frame.file.as_ptr();
        for bytes in [60_000, 10, 640 * 480 * 3] {
            record.copy_frame(&file(bytes), None);
            assert_eq!((record.frame.file.len(), record.frame.file.as_ptr()), (bytes, memory));
        }
        record.copy_frame(&Frame { size: ImageSize::new(u32::MAX, u32::MAX), ..file(7) }, None);
        assert_eq!(record.frame.file, [1; 7]);
    }

    #[test]
    fn more_obstacle_points_fit_into_the_memory_of_fewer() {
        const POINT: ObstaclePoint = ObstaclePoint {
            x: 1.0,
            y: 0.0,
            z: 0.1,
            height: 0.1,
            label: 0,
            confidence: 255,
            reserved: [0; 2],
        };
        let found = |points| Obstacles {
            ground: Ground::EXPECTED,
            sectors: vec![ObstacleSector::UNKNOWN; 72],
            points: vec![POINT; points],
            angle_min_rad: -0.5,
            angle_step_rad: 0.01,
            max_range_m: 5.0,
            used_labels: true,
        };
        let mut record = RecordedFrame::default();
        record.copy_obstacles(Some(&found(3)));
        let memory = record.obstacles.as_ref().unwrap().points.as_ptr();
        for points in [100, 0, MAX_OBSTACLE_POINTS] {
            record.copy_obstacles(Some(&found(points)));
            let own = record.obstacles.as_ref().unwrap();
            assert_eq!((own.points.len(), own.points.as_ptr()), (points, memory));
        }
    }
}
