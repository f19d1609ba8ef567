//! One frame with its results, in memory of its own that is used again.

use nunet_core::camera::Camera;
use nunet_core::cloud::CloudPoint;
use nunet_core::depth::Scale;
use nunet_ipc::{FrameSet, Topic, Units};
use nunet_mcap::{CameraDescription, CloudRecord, DepthRecord};

use crate::source::{Frame, Pixels, camera_in};

/// A frame as it is recorded.
#[derive(Debug, Default)]
pub(crate) struct Record {
    /// The picture and its times.
    pub(crate) frame: Frame,
    /// The camera at the picture's size.
    pub(crate) camera: Option<CameraDescription>,
    /// The camera at the size of depth.
    pub(crate) depth_camera: Option<CameraDescription>,
    /// Units of depth, and where its scale comes from.
    scale: [&'static str; 2],
    size: (u32, u32),
    depth: Vec<u8>,
    labels: Vec<u8>,
    cloud_size: (u32, u32),
    cloud: Vec<u8>,
}

/// Results as a pipeline leaves them.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Results<'a> {
    pub(crate) scale: Scale,
    pub(crate) size: (u32, u32),
    pub(crate) depth: &'a [f32],
    pub(crate) labels: Option<&'a [u8]>,
    pub(crate) cloud_size: (u32, u32),
    pub(crate) cloud: &'a [CloudPoint],
    /// The camera at the size of depth, where it is known.
    pub(crate) camera: Option<Camera>,
}

impl Record {
    /// Takes a frame, and its camera at the picture's size. Memory that another process lends is given back at once.
    pub(crate) fn take(&mut self, mut frame: Frame, camera: Option<Camera>) {
        if let Pixels::Shared(sample) = &frame.pixels {
            frame.pixels = Pixels::Owned(sample.bytes().to_vec());
        }
        self.frame = frame;
        self.camera = camera.map(|camera| describe(&camera));
    }

    /// Copies results out of shared memory.
    pub(crate) fn copy_set(&mut self, set: &FrameSet) {
        self.clear();
        for topic in [Topic::Depth, Topic::Labels, Topic::Cloud] {
            let Some(sample) = set.get(topic) else { continue };
            let size = (sample.header().width, sample.header().height);
            match topic {
                Topic::Labels => sample.bytes().clone_into(&mut self.labels),
                Topic::Cloud => {
                    self.cloud_size = size;
                    sample.bytes().clone_into(&mut self.cloud);
                }
                _ => {
                    self.size = size;
                    sample.bytes().clone_into(&mut self.depth);
                    let header = sample.header();
                    self.scale = [
                        header.units().map_or("", |units| units.name()),
                        header.scale_source().map_or("", |source| source.name()),
                    ];
                    self.depth_camera = camera_in(header).ok().flatten().map(|camera| describe(&camera));
                }
            }
        }
    }

    /// Copies results of a pipeline.
    pub(crate) fn copy_results(&mut self, results: &Results<'_>) {
        self.clear();
        self.scale = [results.scale.units.name(), results.scale.source.name()];
        self.size = results.size;
        self.depth.extend(results.depth.iter().flat_map(|metres| metres.to_le_bytes()));
        self.labels.extend_from_slice(results.labels.unwrap_or_default());
        self.cloud_size = results.cloud_size;
        for point in results.cloud {
            for coordinate in [point.x, point.y, point.z] {
                self.cloud.extend(coordinate.to_le_bytes());
            }
            self.cloud.extend([point.b, point.g, point.r, point.label]);
        }
        self.depth_camera = results.camera.map(|camera| describe(&camera));
    }

    fn clear(&mut self) {
        self.depth.clear();
        self.labels.clear();
        self.cloud.clear();
        self.depth_camera = None;
    }

    pub(crate) fn depth(&self) -> DepthRecord<'_> {
        let Self { scale, size: (width, height), depth, .. } = self;
        DepthRecord { scale: *scale, width: *width, height: *height, bytes: depth }
    }

    pub(crate) fn labels(&self) -> Option<&[u8]> {
        (!self.labels.is_empty()).then_some(&self.labels)
    }

    /// Points are metres to everybody who reads ROS' messages: there are none of depth without a unit.
    pub(crate) fn cloud(&self) -> Option<CloudRecord<'_>> {
        let (width, height) = self.cloud_size;
        (!self.cloud.is_empty() && self.scale[0] == Units::Metre.name()).then_some(CloudRecord {
            width,
            height,
            bytes: &self.cloud,
        })
    }
}

/// A camera in ROS' words.
fn describe(camera: &Camera) -> CameraDescription {
    let intrinsics = camera.intrinsics;
    let (model, coefficients) = camera.distortion.to_ros();
    CameraDescription {
        width: intrinsics.width,
        height: intrinsics.height,
        intrinsics: [intrinsics.fx_px, intrinsics.fy_px, intrinsics.cx_px, intrinsics.cy_px],
        distortion_model: model.to_owned(),
        coefficients,
        fault: None,
    }
}
