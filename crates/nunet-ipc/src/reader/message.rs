//! Messages as a reader receives them.

use std::sync::Arc;

use bytemuck::Pod;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::sample::Sample;
use nunet_types::{CloudPoint, Encoding, Topic};

use crate::contract::{
    AttitudeRecord, BLOCK_BYTES, Block64, CONTRACT_VERSION, FrameHeader, ObstacleRecord, StatsRecord,
};
use crate::error::IpcError;
use crate::iceoryx::Iceoryx;

/// One message, in shared memory, read-only.
///
/// It does not change until this value is dropped, even if the reader and the publisher end earlier. It keeps
/// its reader's place in the service until then. `Send`: it may be moved to another thread.
#[derive(Debug)]
pub struct Message {
    // Dropped before the port: fields are dropped in this order.
    sample: Sample<Iceoryx, [Block64], FrameHeader>,
    // When a port ends, the publisher takes back every chunk that went through it, whether or not a sample
    // still points there. So each message keeps its port.
    _port: Arc<TopicSubscriber>,
    topic: Topic,
    // The checked value: the sender may change the header's field later.
    payload_bytes: usize,
}

/// The port that receives the messages of a topic.
pub(crate) type TopicSubscriber = Subscriber<Iceoryx, [Block64], FrameHeader>;

impl Message {
    pub(crate) fn new(
        sample: Sample<Iceoryx, [Block64], FrameHeader>,
        port: Arc<TopicSubscriber>,
        topic: Topic,
    ) -> Result<Self, IpcError> {
        let header = sample.user_header();
        let room = sample.payload().len() * BLOCK_BYTES;
        let bad = |detail: String| Err(IpcError::BadMessage { topic, detail });
        if header.contract_version != CONTRACT_VERSION {
            return bad(format!("it is of version `{}`, not `{CONTRACT_VERSION}`", header.contract_version));
        }
        if header.topic() != Ok(topic) {
            return bad(format!("its header says topic `{}`", header.topic));
        }
        let claimed = header.payload_bytes;
        let payload_bytes = usize::try_from(claimed).unwrap_or(usize::MAX);
        if payload_bytes > room {
            return bad(format!("its header says {claimed} bytes, but there are {room}"));
        }
        Ok(Self { sample, _port: port, topic, payload_bytes })
    }

    /// The topic that it was received on.
    #[must_use]
    pub fn topic(&self) -> Topic {
        self.topic
    }

    /// Its header.
    #[must_use]
    pub fn header(&self) -> &FrameHeader {
        self.sample.user_header()
    }

    /// The payload, aligned to 64 bytes, in shared memory.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &bytemuck::cast_slice(self.sample.payload())[..self.payload_bytes]
    }

    /// The depth map: `[height, width]`, rows from the top, in the header's units; NaN where there is none.
    ///
    /// # Errors
    /// [`IpcError::WrongEncoding`] when the payload is not depth, [`IpcError::BadMessage`] when its size
    /// contradicts its header.
    pub fn depth(&self) -> Result<&[f32], IpcError> {
        self.grid(Encoding::DepthF32)
    }

    /// The class of each pixel: `[height, width]`, rows from the top.
    ///
    /// # Errors
    /// Those of [`depth`](Self::depth).
    pub fn labels(&self) -> Result<&[u8], IpcError> {
        self.grid(Encoding::LabelsU8)
    }

    /// The confidence of each pixel's depth: `[height, width]`, rows from the top, 255 = certain.
    ///
    /// # Errors
    /// Those of [`depth`](Self::depth).
    pub fn confidence(&self) -> Result<&[u8], IpcError> {
        self.grid(Encoding::ConfidenceU8)
    }

    /// The cloud's points: `[height, width]`, rows from the top.
    ///
    /// # Errors
    /// Those of [`depth`](Self::depth).
    pub fn points(&self) -> Result<&[CloudPoint], IpcError> {
        self.grid(Encoding::Points)
    }

    /// The daemon's stats.
    ///
    /// # Errors
    /// Those of [`depth`](Self::depth).
    pub fn stats(&self) -> Result<&StatsRecord, IpcError> {
        self.record(Encoding::StatsRecord)
    }

    /// The obstacles around the robot.
    ///
    /// # Errors
    /// Those of [`depth`](Self::depth).
    pub fn obstacles(&self) -> Result<&ObstacleRecord, IpcError> {
        self.record(Encoding::ObstacleRecord)
    }

    /// The attitude of the robot's base.
    ///
    /// # Errors
    /// Those of [`depth`](Self::depth).
    pub fn attitude(&self) -> Result<&AttitudeRecord, IpcError> {
        self.record(Encoding::AttitudeRecord)
    }

    fn record<T: Pod>(&self, encoding: Encoding) -> Result<&T, IpcError> {
        self.expect(encoding)?;
        let records = bytemuck::try_cast_slice::<u8, T>(self.bytes()).unwrap_or_default();
        let (bytes, expected) = (self.bytes().len(), size_of::<T>());
        records.first().ok_or_else(|| self.bad(format!("{bytes} bytes, but a record of {expected} bytes")))
    }

    fn grid<T: Pod>(&self, encoding: Encoding) -> Result<&[T], IpcError> {
        self.expect(encoding)?;
        let (width, height) = (self.header().width as usize, self.header().height as usize);
        let cells = bytemuck::try_cast_slice::<u8, T>(self.bytes()).unwrap_or_default();
        if width.checked_mul(height) == Some(cells.len()) && !cells.is_empty() {
            return Ok(cells);
        }
        let (bytes, each) = (self.bytes().len(), size_of::<T>());
        Err(self.bad(format!("{width}x{height} cells of {each} bytes, but a payload of {bytes} bytes")))
    }

    fn expect(&self, expected: Encoding) -> Result<(), IpcError> {
        match self.header().encoding() {
            Ok(found) if found == expected => Ok(()),
            Ok(found) => Err(IpcError::WrongEncoding { expected, found: found.to_string() }),
            Err(unknown) => Err(IpcError::WrongEncoding { expected, found: unknown.value.to_string() }),
        }
    }

    fn bad(&self, detail: String) -> IpcError {
        IpcError::BadMessage { topic: self.topic, detail }
    }
}

/// The messages of one frame in several topics: they have the same sequence number and capture time.
#[derive(Debug)]
pub struct FrameSet {
    pub(crate) frames: [Option<Message>; Topic::ALL.len()],
}

impl FrameSet {
    /// The message of a topic; `None` for one that the reader did not open.
    #[must_use]
    pub fn get(&self, topic: Topic) -> Option<&Message> {
        self.frames[topic as usize].as_ref()
    }

    /// Takes the message of a topic out, to keep it longer than the others.
    pub fn take(&mut self, topic: Topic) -> Option<Message> {
        self.frames[topic as usize].take()
    }

    /// The messages that were not taken out, in the order of their topics.
    pub fn iter(&self) -> impl Iterator<Item = &Message> {
        self.frames.iter().flatten()
    }
}
