//! Writes results as ROS 2 messages into an MCAP file that stays readable if it is truncated.

use std::collections::BTreeMap;
use std::fs::{File, TryLockError};
use std::io::{BufWriter, ErrorKind};
use std::path::{Path, PathBuf};

use crate::BASE_FRAME;
use crate::RecordingError;
use crate::file_end::FileEnd;
use crate::frame_record::{DepthRecord, FrameRecord, ScaleRecord, WriterOptions};
use crate::messages::{Header, Schema, Time};
use crate::mount::CameraMount;
use crate::obstacles::ObstacleMapRecord;
use crate::records::io;
use crate::ros::{ImagePixels, RosMessage};
use mcap::records::{MessageHeader, Metadata};
use mcap::{Compression, McapError, WriteOptions, Writer};

/// Name of the metadata with the model of a recording's results.
pub(crate) const ABOUT: &str = "nunet";
/// Name of the metadata with the units and scale of depth from a given time, because ROS messages have no
/// field for them.
const SCALE: &str = "nunet.scale";
/// Messages that are compressed together.
const CHUNK_BYTES: u64 = 4 << 20;
/// Depth hardly compresses, so higher levels take more time without a smaller file.
const ZSTD_LEVEL: u32 = 1;

/// Writes a recording.
pub struct RecordingWriter {
    path: PathBuf,
    end: FileEnd,
    writer: Option<Writer<BufWriter<File>>>,
    channels: BTreeMap<String, u16>,
    camera: String,
    frame_id: String,
    mount: Option<CameraMount>,
    message: Vec<u8>,
    frames: u32,
    scale: ScaleRecord,
}

/// An empty file at `path`, locked while it is open: two writers of one file would destroy both recordings.
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
    // On a file system without locks the check is not possible.
    if matches!(file.try_lock(), Err(TryLockError::WouldBlock)) {
        return Err(RecordingError::InUse { path: path.to_owned() });
    }
    if force && file.metadata().is_ok_and(|file| file.is_file()) {
        file.set_len(0).map_err(|source| io("empty", path, source))?;
    }
    Ok(file)
}

impl RecordingWriter {
    /// Creates the file.
    ///
    /// # Errors
    /// The file exists or is being written, or cannot be created.
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
            end: FileEnd::new(same_file),
            writer: None,
            channels: BTreeMap::new(),
            camera: options.camera,
            frame_id: options.frame_id,
            mount: options.mount,
            message: Vec::new(),
            frames: 0,
            scale: Default::default(),
        };
        let writer = write.create(BufWriter::new(file)).map_err(|source| recording.failed(source))?;
        recording.writer = Some(writer);
        let about = Metadata { name: ABOUT.to_owned(), metadata: options.about };
        recording.with(|writer| writer.write_metadata(&about))?;
        recording.with(Writer::flush)?;
        recording.end.reserve().map_err(|source| io("write", &recording.path, source))?;
        Ok(recording)
    }

    /// The coordinate frame of the frames to come.
    pub fn set_frame_id(&mut self, frame_id: &str) {
        frame_id.clone_into(&mut self.frame_id);
    }

    /// Writes a frame. An error is final: the file then ends at the last sync.
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
        self.write_scale(frame.depth.scale, log)?;
        if let Some(mount) = self.mount.filter(|_| self.frames == 1) {
            self.put("/tf_static".to_owned(), log, &header, RosMessage::TfStatic(mount))?;
        }
        if let Some(image) = frame.image {
            let topic = self.topic("image_raw/compressed");
            self.put(topic, log, &header, RosMessage::CompressedImage(image))?;
        }
        for (topic, camera) in [("camera_info", frame.camera), ("depth/camera_info", frame.depth_camera)] {
            if let Some(camera) = camera {
                self.put(self.topic(topic), log, &header, RosMessage::CameraInfo(camera))?;
            }
        }
        self.write_results(frame, &header)
    }

    /// Writes the obstacles of a frame, before the frame itself. Errors are final, as in [`Self::write`].
    ///
    /// # Errors
    /// The disk is full, or a message cannot be encoded.
    pub fn write_obstacles(
        &mut self,
        obstacles: &ObstacleMapRecord<'_>,
        log_nanos: u64,
        stamp_nanos: i64,
    ) -> Result<(), RecordingError> {
        let stamp = Time::from_unix_nanos(stamp_nanos);
        let header = Header { stamp, frame_id: obstacles.frame_id.into() };
        let points = RosMessage::ObstaclePoints(obstacles);
        self.put(self.topic("obstacles/points"), log_nanos, &header, points)?;
        self.put(self.topic("scan"), log_nanos, &header, RosMessage::Scan(obstacles))
    }

    /// Writes roll and pitch of the robot's base that were used for a frame, radians, before the frame
    /// itself. Errors are final, as in [`Self::write`].
    ///
    /// # Errors
    /// The disk is full, or a message cannot be encoded.
    pub fn write_attitude(
        &mut self,
        roll_pitch_rad: [f32; 2],
        log_nanos: u64,
        stamp_nanos: i64,
    ) -> Result<(), RecordingError> {
        let stamp = Time::from_unix_nanos(stamp_nanos);
        let header = Header { stamp, frame_id: BASE_FRAME.into() };
        self.put(self.topic("attitude"), log_nanos, &header, RosMessage::Attitude(roll_pitch_rad))
    }

    /// Depth is last in a frame, as in shared memory.
    fn write_results(&mut self, frame: &FrameRecord<'_>, header: &Header<'_>) -> Result<(), RecordingError> {
        let (log, DepthRecord { width, height, bytes: depth, .. }) = (frame.log_nanos, frame.depth);
        let image = |encoding, pixel_bytes, data| {
            RosMessage::Image(ImagePixels { width, height, encoding, pixel_bytes, data })
        };
        if let Some(labels) = frame.labels {
            self.put(self.topic("labels/image_raw"), log, header, image("mono8", 1, labels))?;
        }
        if let Some(confidence) = frame.confidence {
            self.put(self.topic("labels/confidence"), log, header, image("mono8", 1, confidence))?;
        }
        if let Some(cloud) = frame.cloud {
            self.put(self.topic("depth/points"), log, header, RosMessage::Cloud(cloud))?;
        }
        self.put(self.topic("depth/image_raw"), log, header, image("32FC1", 4, depth))
    }

    /// Writes unit and scale, if they changed.
    fn write_scale(&mut self, scale: ScaleRecord, log_nanos: u64) -> Result<(), RecordingError> {
        if scale.is_like(&self.scale) {
            return Ok(());
        }
        self.scale = scale;
        let time = [("from_log_time", log_nanos.to_string())];
        let entries = scale.entries().into_iter().chain(time);
        let metadata = entries.map(|(key, value)| (key.to_owned(), value)).collect();
        self.with(|writer| writer.write_metadata(&Metadata { name: SCALE.to_owned(), metadata }))
    }

    /// Flushes everything written so far to the disk.
    ///
    /// # Errors
    /// The disk is full.
    pub fn sync(&mut self) -> Result<(), RecordingError> {
        self.with(Writer::flush)?;
        self.end.sync().map_err(|source| io("write", &self.path, source))
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

    fn put(
        &mut self,
        topic: String,
        log_time: u64,
        header: &Header<'_>,
        message: RosMessage<'_>,
    ) -> Result<(), RecordingError> {
        let mut encoded = std::mem::take(&mut self.message);
        let done = message
            .encode(header, &mut encoded)
            .map_err(|reason| RecordingError::Encode { topic: topic.clone(), reason });
        let sequence = self.frames;
        let written = done.and_then(|()| {
            let channel_id = self.channel(topic, message.schema())?;
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

    /// Truncates the file to the last sync, because a failure leaves an incomplete chunk.
    fn cut_back(&mut self) {
        // Dropping the writer would try to write its chunk once more.
        if let Some(writer) = self.writer.take() {
            let (_file, _unwritten) = writer.into_inner().into_parts();
        }
        // A file without an end can still be read by readers that are less strict.
        let _ = self.end.cut_back();
    }
}

/// The publisher of `/tf_static` keeps it for late subscribers; `ros2 bag play` does so only with these
/// settings.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_that_was_moved_is_repaired_and_a_new_file_of_its_name_is_not() {
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
            image: None,
            camera: None,
            depth: DepthRecord {
                scale: ScaleRecord::default(),
                width: 1,
                height: 1,
                bytes: &1_f32.to_le_bytes(),
            },
            depth_camera: None,
            labels: None,
            confidence: None,
            cloud: None,
        };
        writer.write(&frame).unwrap();
        std::fs::rename(&path, &moved).unwrap();
        std::fs::write(&path, b"precious").unwrap();
        writer.sync().unwrap();
        let synced = std::fs::metadata(&moved).unwrap().len();
        writer.write(&frame).unwrap();
        writer.with(Writer::flush).unwrap();
        assert!(std::fs::metadata(&moved).unwrap().len() > synced, "it grows under its new name");

        writer.cut_back();
        let bytes = std::fs::read(&moved).unwrap();
        assert_eq!(bytes.len() as u64, synced + crate::file_end::END.len() as u64);
        let messages = mcap::MessageStream::new(&bytes).unwrap().collect::<Result<Vec<_>, _>>().unwrap();
        assert_eq!(messages.len(), 1, "what was synced, with an end");
        assert_eq!(std::fs::read(&path).unwrap(), b"precious");
    }
}
