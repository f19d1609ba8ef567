//! Results as ROS 2 messages in an MCAP file that opens wherever it was cut.

use std::collections::BTreeMap;
use std::fs::{File, TryLockError};
use std::io::{BufWriter, ErrorKind, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};

use mcap::records::{MessageHeader, Metadata};
use mcap::{Compression, McapError, WriteOptions, Writer};

use crate::messages::{
    CAMERA_INFO, COMPRESSED_IMAGE, CompressedImage, Header, IMAGE, Image, POINT_CLOUD, PointCloud2,
    PointField, Schema, TF_MESSAGE, TfMessage, Time,
};
use crate::mount::Mount;
use crate::picture::bytes;
use crate::records::io;
use crate::{CameraDescription, RecordingError, cdr};

/// The name of the metadata that says whose results a recording holds.
pub(crate) const ABOUT: &str = "nunet";
/// The name of the metadata that says what depth is from a time on: ROS' messages have no place for it.
const SCALE: &str = "nunet.scale";
/// Messages that are compressed together.
const CHUNK_BYTES: u64 = 4 << 20;
/// Depth is noise to a compressor: more effort takes time and saves nothing.
const ZSTD_LEVEL: u32 = 1;

/// The cloud's points: 16 bytes, colour and label where ROS' tools look for them.
const POINT_FIELDS: [PointField; 5] = [
    PointField { name: "x", offset: 0, datatype: PointField::FLOAT32, count: 1 },
    PointField { name: "y", offset: 4, datatype: PointField::FLOAT32, count: 1 },
    PointField { name: "z", offset: 8, datatype: PointField::FLOAT32, count: 1 },
    PointField { name: "rgb", offset: 12, datatype: PointField::FLOAT32, count: 1 },
    PointField { name: "label", offset: 15, datatype: PointField::UINT8, count: 1 },
];
const POINT_BYTES: u32 = 16;

/// What a recording is of.
#[derive(Debug, Clone)]
pub struct WriterOptions {
    /// First part of the topics' names.
    pub camera: String,
    /// Coordinate frame of pictures, depth and cloud: the camera's optical frame.
    pub frame_id: String,
    /// Where the camera is on the robot.
    pub mount: Option<Mount>,
    /// What is kept about the recording as a whole: model, provider ...
    pub about: BTreeMap<String, String>,
    /// Overwrite a file that is there.
    pub force: bool,
}

/// A JPEG or PNG file in memory.
#[derive(Debug, Clone, Copy)]
pub struct EncodedPicture<'a> {
    /// `jpeg` or `png`.
    pub format: &'a str,
    /// The file.
    pub data: &'a [u8],
}

/// A depth map, `[height][width]`, NaN = none.
#[derive(Debug, Clone, Copy)]
pub struct DepthRecord<'a> {
    /// What its numbers are and where their scale comes from, in the words of shared memory: `metre` and `focal_scaled`.
    pub scale: [&'a str; 2],
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// Little-endian `f32`, rows from the top.
    pub bytes: &'a [u8],
}

/// An organised cloud: `x y z` as `f32`, then bytes `b g r label`.
#[derive(Debug, Clone, Copy)]
pub struct CloudRecord<'a> {
    /// Points.
    pub width: u32,
    /// Points.
    pub height: u32,
    /// 16 bytes a point, rows from the top.
    pub bytes: &'a [u8],
}

/// Everything that is recorded of a frame.
#[derive(Debug, Clone, Copy)]
pub struct FrameRecord<'a> {
    /// When the frame was recorded, nanoseconds of the recording's clock.
    pub log_nanos: u64,
    /// When it was taken, nanoseconds since 1970.
    pub stamp_nanos: i64,
    /// The picture.
    pub picture: Option<EncodedPicture<'a>>,
    /// Its camera.
    pub camera: Option<&'a CameraDescription>,
    /// Depth.
    pub depth: DepthRecord<'a>,
    /// The camera at the size of depth and labels.
    pub depth_camera: Option<&'a CameraDescription>,
    /// Class indices, of the size of depth.
    pub labels: Option<&'a [u8]>,
    /// The cloud.
    pub cloud: Option<CloudRecord<'a>>,
}

/// Writes a recording.
pub struct RecordingWriter {
    path: PathBuf,
    /// The writer's file once more: its name may be another file's by now.
    file: File,
    writer: Option<Writer<BufWriter<File>>>,
    channels: BTreeMap<String, u16>,
    camera: String,
    frame_id: String,
    mount: Option<Mount>,
    message: Vec<u8>,
    frames: u32,
    scale: [String; 2],
    /// Everything before this place of the file can be read.
    whole: u64,
}

/// An empty file at `path`, locked for as long as it is open: two writers of one file would leave neither's recording.
fn own_file(path: &Path, force: bool) -> Result<File, RecordingError> {
    let mut how = File::options();
    how.write(true);
    if force {
        how.create(true).truncate(false)
    } else {
        how.create_new(true)
    };
    let file = how.open(path).map_err(|source| match source.kind() {
        ErrorKind::AlreadyExists => RecordingError::Exists { path: path.to_owned() },
        _ => io("create", path, source),
    })?;
    // Where a file system has no locks, nobody can be asked.
    if matches!(file.try_lock(), Err(TryLockError::WouldBlock)) {
        return Err(RecordingError::InUse { path: path.to_owned() });
    }
    if force && file.metadata().is_ok_and(|file| file.is_file()) {
        file.set_len(0).map_err(|source| io("empty", path, source))?;
    }
    Ok(file)
}

impl RecordingWriter {
    /// Makes the file.
    ///
    /// # Errors
    /// A file that is there already or is being written by somebody, or a place where none can be made.
    pub fn create(path: &Path, options: WriterOptions) -> Result<Self, RecordingError> {
        let file = own_file(path, options.force)?;
        let same_file = file.try_clone().map_err(|source| io("create", path, source))?;
        let write = WriteOptions::new()
            .profile("ros2")
            .library("nunet")
            .compression(Some(Compression::Zstd))
            .compression_level(ZSTD_LEVEL)
            .compression_threads(0) // the same bytes on every machine
            .chunk_size(Some(CHUNK_BYTES));
        let mut recording = Self {
            path: path.to_owned(),
            file: same_file,
            writer: None,
            channels: BTreeMap::new(),
            camera: options.camera,
            frame_id: options.frame_id,
            mount: options.mount,
            message: Vec::new(),
            frames: 0,
            scale: Default::default(),
            whole: 0,
        };
        let writer = write.create(BufWriter::new(file)).map_err(|source| recording.failed(source))?;
        recording.writer = Some(writer);
        let about = Metadata { name: ABOUT.to_owned(), metadata: options.about };
        recording.with(|writer| writer.write_metadata(&about))?;
        Ok(recording)
    }

    /// Writes a frame. An error is final: the file then ends with the last whole second.
    ///
    /// # Errors
    /// The disk is full, or a message cannot be encoded.
    pub fn write(&mut self, frame: &FrameRecord<'_>) -> Result<(), RecordingError> {
        self.frames += 1;
        let header = Header {
            stamp: Time::from_unix_nanos(frame.stamp_nanos),
            frame_id: self.frame_id.clone().into(),
        };
        let log = frame.log_nanos;
        self.say_scale(frame.depth.scale, log)?;
        if let Some(mount) = self.mount.filter(|_| self.frames == 1) {
            let transform = mount.transform(&header);
            self.put("/tf_static".to_owned(), &TF_MESSAGE, log, &TfMessage { transforms: vec![transform] })?;
        }
        if let Some(picture) = frame.picture {
            let message = CompressedImage {
                header: header.clone(),
                format: picture.format.into(),
                data: bytes(picture.data),
            };
            self.put(self.topic("image_raw/compressed"), &COMPRESSED_IMAGE, log, &message)?;
        }
        if let Some(camera) = frame.camera {
            self.put(self.topic("camera_info"), &CAMERA_INFO, log, &camera.ros_message(header.clone()))?;
        }
        if let Some(camera) = frame.depth_camera {
            self.put(
                self.topic("depth/camera_info"),
                &CAMERA_INFO,
                log,
                &camera.ros_message(header.clone()),
            )?;
        }
        let DepthRecord { width, height, bytes: depth, .. } = frame.depth;
        let image = |encoding: &'static str, bytes_per_pixel: u32, data| Image {
            header: header.clone(),
            height,
            width,
            encoding: encoding.into(),
            is_bigendian: 0,
            step: width * bytes_per_pixel,
            data: bytes(data),
        };
        if let Some(labels) = frame.labels {
            self.put(self.topic("labels/image_raw"), &IMAGE, log, &image("mono8", 1, labels))?;
        }
        if let Some(cloud) = frame.cloud {
            let message = cloud.message(header.clone());
            self.put(self.topic("depth/points"), &POINT_CLOUD, log, &message)?;
        }
        // Depth is last of a frame, as in shared memory.
        self.put(self.topic("depth/image_raw"), &IMAGE, log, &image("32FC1", 4, depth))
    }

    /// Where it is another than before.
    fn say_scale(&mut self, scale: [&str; 2], log_nanos: u64) -> Result<(), RecordingError> {
        if self.scale == scale {
            return Ok(());
        }
        self.scale = scale.map(str::to_owned);
        let [units, source] = self.scale.clone();
        let words = [("units", units), ("scale_source", source), ("from_log_time", log_nanos.to_string())];
        let metadata = words.map(|(key, value)| (key.to_owned(), value)).into();
        self.with(|writer| writer.write_metadata(&Metadata { name: SCALE.to_owned(), metadata }))
    }

    /// Brings everything written so far onto the disk.
    ///
    /// # Errors
    /// The disk is full.
    pub fn sync(&mut self) -> Result<(), RecordingError> {
        self.with(Writer::flush)?;
        let synced = self.file.sync_data().and_then(|()| self.file.metadata());
        self.whole = synced.map_err(|source| io("write", &self.path, source))?.len();
        Ok(())
    }

    /// Ends the file with its index.
    ///
    /// # Errors
    /// The disk is full.
    pub fn finish(mut self) -> Result<(), RecordingError> {
        self.with(|writer| writer.finish().map(drop))?;
        let writer = self.writer.take().map(Writer::into_inner);
        let file = writer.map(BufWriter::into_inner).transpose();
        let file = file.map_err(|error| io("write", &self.path, error.into_error()))?;
        file.map_or(Ok(()), |file| file.sync_all()).map_err(|source| io("write", &self.path, source))
    }

    fn topic(&self, name: &str) -> String {
        format!("/{}/{name}", self.camera)
    }

    fn put<T: serde::Serialize>(
        &mut self,
        topic: String,
        schema: &Schema,
        log_time: u64,
        message: &T,
    ) -> Result<(), RecordingError> {
        let mut encoded = std::mem::take(&mut self.message);
        let done = cdr::encode(message, &mut encoded)
            .map_err(|reason| RecordingError::Encode { topic: topic.clone(), reason });
        let sequence = self.frames;
        let written = done.and_then(|()| {
            let channel_id = self.channel(topic, schema)?;
            let header = MessageHeader { channel_id, sequence, log_time, publish_time: log_time };
            self.with(|writer| writer.write_to_known_channel(&header, &encoded))
        });
        self.message = encoded;
        written
    }

    fn channel(&mut self, topic: String, schema: &Schema) -> Result<u16, RecordingError> {
        if let Some(&id) = self.channels.get(&topic) {
            return Ok(id);
        }
        let id = self.with(|writer| {
            let schema = writer.add_schema(schema.name, "ros2msg", schema.text.as_bytes())?;
            writer.add_channel(schema, &topic, "cdr", &qos(&topic))
        })?;
        self.channels.insert(topic, id);
        Ok(id)
    }

    fn with<T>(
        &mut self,
        act: impl FnOnce(&mut Writer<BufWriter<File>>) -> Result<T, McapError>,
    ) -> Result<T, RecordingError> {
        let Some(writer) = &mut self.writer else {
            return Err(self.failed(McapError::AttemptedWriteAfterFailure));
        };
        act(writer).map_err(|source| {
            self.cut_back();
            self.failed(source)
        })
    }

    fn failed(&self, source: McapError) -> RecordingError {
        RecordingError::Write { path: self.path.clone(), source }
    }

    /// After a failure the file ends in the middle of a chunk. What was on the disk before stays, with an end that
    /// every reader takes; that needs fewer bytes than are given back.
    fn cut_back(&mut self) {
        // Dropping the writer would try to write its chunk once more.
        if let Some(writer) = self.writer.take() {
            let (_file, _unwritten) = writer.into_inner().into_parts();
        }
        if self.whole == 0 {
            return;
        }
        let ended = self.file.set_len(self.whole).and_then(|()| {
            // The position is the writer's too, which is gone.
            self.file.seek(SeekFrom::Start(self.whole))?;
            self.file.write_all(&END)?;
            self.file.sync_data()
        });
        // It could be read without an end as well, by readers that are less strict.
        let _ = ended;
    }
}

/// The records `DataEnd` and `Footer` without checksums and summary, and the magic bytes (MCAP specification).
const END: [u8; 13 + 29 + 8] = {
    let mut end = [0; 50];
    end[0] = 0x0f;
    end[1] = 4;
    end[13] = 0x02;
    end[14] = 20;
    let magic = mcap::MAGIC;
    let mut index = 0;
    while index < magic.len() {
        end[42 + index] = magic[index];
        index += 1;
    }
    end
};

/// `/tf_static` is kept by its publisher for readers who come late; `ros2 bag play` does it only where this says so.
fn qos(topic: &str) -> BTreeMap<String, String> {
    const LATCHED: &str = "- history: 1\n  depth: 1\n  reliability: 1\n  durability: 1\n  deadline:\n    sec: 9223372036\n    \
                           nsec: 854775807\n  lifespan:\n    sec: 9223372036\n    nsec: 854775807\n  liveliness: 1\n  \
                           liveliness_lease_duration:\n    sec: 9223372036\n    nsec: 854775807\n  \
                           avoid_ros_namespace_conventions: false";
    if topic == "/tf_static" {
        BTreeMap::from([("offered_qos_profiles".to_owned(), LATCHED.to_owned())])
    } else {
        BTreeMap::new()
    }
}

impl<'a> CloudRecord<'a> {
    fn message<'b>(&'b self, header: Header<'b>) -> PointCloud2<'b> {
        PointCloud2 {
            header,
            height: self.height,
            width: self.width,
            fields: &POINT_FIELDS,
            is_bigendian: false,
            point_step: POINT_BYTES,
            row_step: POINT_BYTES * self.width,
            data: bytes(self.bytes),
            is_dense: false, // NaN where there is no depth
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_that_was_moved_is_mended_and_what_took_its_name_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let (path, moved) = (folder.path().join("a.mcap"), folder.path().join("moved.mcap"));
        let options = WriterOptions {
            camera: "front".to_owned(),
            frame_id: "eye".to_owned(),
            mount: None,
            about: BTreeMap::new(),
            force: false,
        };
        let mut writer = RecordingWriter::create(&path, options).unwrap();
        let frame = FrameRecord {
            log_nanos: 1,
            stamp_nanos: 1,
            picture: None,
            camera: None,
            depth: DepthRecord {
                scale: ["metre", "metric"],
                width: 1,
                height: 1,
                bytes: &1_f32.to_le_bytes(),
            },
            depth_camera: None,
            labels: None,
            cloud: None,
        };
        writer.write(&frame).unwrap();
        std::fs::rename(&path, &moved).unwrap();
        std::fs::write(&path, b"precious").unwrap();
        writer.sync().unwrap();
        let synced = std::fs::metadata(&moved).unwrap().len();
        assert_eq!(writer.whole, synced);
        writer.write(&frame).unwrap();
        writer.with(Writer::flush).unwrap();
        assert!(std::fs::metadata(&moved).unwrap().len() > synced, "it grows under its new name");

        writer.cut_back();
        let bytes = std::fs::read(&moved).unwrap();
        assert_eq!(bytes.len() as u64, synced + END.len() as u64);
        let messages = mcap::MessageStream::new(&bytes).unwrap().collect::<Result<Vec<_>, _>>().unwrap();
        assert_eq!(messages.len(), 1, "what was synced, with an end");
        assert_eq!(std::fs::read(&path).unwrap(), b"precious");
    }
}
