//! How much shared memory a camera needs, computed before anything is created.
//!
//! With the default [`Limits`] a VGA camera (640x480) that publishes everything reserves:
//!
//! | topic  | payload bytes | chunks | reserved |
//! |--------|--------------:|-------:|---------:|
//! | rgb    |       921 600 |     10 |   9.3 MB |
//! | depth  |     1 228 800 |     10 |  12.4 MB |
//! | labels |       307 200 |     10 |   3.1 MB |
//! | cloud  |     4 915 200 |      6 |  29.5 MB |
//! | stats  |         2 560 |     10 |   0.1 MB |
//! | all    |               |        |  54.5 MB |
//!
//! which leaves room in the 64 MB (67.1 million bytes) that `/dev/shm` has in a container.

use std::fmt;

use nunet_types::Topic;

use crate::contract::{BLOCK_BYTES, FrameHeader, blocks_for};

/// One topic of a publisher.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TopicPlan {
    /// The topic.
    pub topic: Topic,
    /// The largest payload, in bytes.
    pub payload_bytes: usize,
}

/// The number of readers, and of frames that each may hold. Memory is reserved for all of them, so that a
/// slow reader never takes a chunk that the publisher or another reader needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Readers of each topic other than the cloud.
    pub max_readers: usize,
    /// Readers of the cloud, by far the largest payload.
    pub max_cloud_readers: usize,
    /// Frames of a topic that one reader may hold at a time: the one that it processes and the next one.
    pub max_held_frames: usize,
    /// Frames of a topic that the publisher may fill at a time.
    pub max_loans: usize,
}

impl Limits {
    /// The defaults, for tables and help texts.
    pub const DEFAULT: Self = Self { max_readers: 4, max_cloud_readers: 2, max_held_frames: 2, max_loans: 1 };

    /// Readers that a topic is made for.
    #[must_use]
    pub const fn readers_of(&self, topic: Topic) -> usize {
        match topic {
            Topic::Cloud => self.max_cloud_readers,
            _ => self.max_readers,
        }
    }

    /// Chunks that a topic needs so that a loan never fails while the publisher keeps to `max_loans`.
    ///
    /// A chunk is in use when a reader holds it (`readers * held`), when it is the newest frame, or when the
    /// publisher fills it. Every reader's queue is one frame long, is overwritten by every send, and so holds
    /// nothing but the newest frame, which is also the one kept for late joiners: one chunk for all of them.
    /// iceoryx2's own count has a chunk more for each reader, because it allows for queues that hold
    /// different frames.
    #[must_use]
    pub const fn chunks_of(&self, topic: Topic) -> usize {
        self.readers_of(topic) * self.max_held_frames + 1 + self.max_loans
    }
}

impl Default for Limits {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// The memory of one topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TopicReservation {
    /// The topic and its largest payload.
    pub plan: TopicPlan,
    /// The number of payloads that fit.
    pub chunks: usize,
    /// Bytes of `/dev/shm`, iceoryx2's own records included.
    pub bytes: u64,
}

/// The shared memory that a publisher needs, before it is created.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reservation {
    /// Each topic's share.
    pub topics: Vec<TopicReservation>,
}

impl Reservation {
    /// Computes what these topics need.
    #[must_use]
    pub fn new(plans: &[TopicPlan], limits: &Limits) -> Self {
        let topics = plans.iter().map(|plan| {
            let chunks = limits.chunks_of(plan.topic);
            let records = RECORD_BYTES + limits.readers_of(plan.topic) as u64 * RECORD_BYTES_PER_READER;
            TopicReservation {
                plan: *plan,
                chunks,
                bytes: (chunks * chunk_bytes(plan.payload_bytes)) as u64 + records,
            }
        });
        Self { topics: topics.collect() }
    }

    /// Bytes of all topics together.
    #[must_use]
    pub fn total_bytes(&self) -> u64 {
        self.topics.iter().map(|topic| topic.bytes).sum()
    }
}

impl fmt::Display for Reservation {
    /// `21.7 MB (rgb 9.3, depth 12.4)`
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.1} MB (", megabytes(self.total_bytes()))?;
        for (index, topic) in self.topics.iter().enumerate() {
            let comma = if index == 0 { "" } else { ", " };
            write!(f, "{comma}{} {:.1}", topic.plan.topic, megabytes(topic.bytes))?;
        }
        write!(f, ")")
    }
}

pub(crate) fn megabytes(bytes: u64) -> f64 {
    bytes as f64 / 1e6
}

/// iceoryx2's own header in front of each [`FrameHeader`]
/// (`iceoryx2::service::header::publish_subscribe::Header`).
const ICEORYX_HEADER_BYTES: usize = 48;

/// Bytes of one chunk: both headers, then the payload, aligned.
pub(crate) const fn chunk_bytes(payload_bytes: usize) -> usize {
    (ICEORYX_HEADER_BYTES + size_of::<FrameHeader>()).next_multiple_of(BLOCK_BYTES)
        + blocks_for(payload_bytes) * BLOCK_BYTES
}

/// What iceoryx2 keeps in `/dev/shm` for a service besides the chunks, rounded up: measured by
/// `a_camera_uses_no_more_shared_memory_than_it_reserved`.
const RECORD_BYTES: u64 = 32 * 1024;

/// The same for each reader: its connection.
const RECORD_BYTES_PER_READER: u64 = 8 * 1024;

/// The mount point of shared memory on Linux.
pub const SHARED_MEMORY_FOLDER: &str = "/dev/shm";

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    const VGA: usize = 640 * 480;

    pub(crate) fn vga() -> [TopicPlan; 5] {
        [
            (Topic::Rgb, VGA * 3),
            (Topic::Depth, VGA * 4),
            (Topic::Labels, VGA),
            (Topic::Cloud, VGA * 16),
            (Topic::Stats, 2560),
        ]
        .map(|(topic, payload_bytes)| TopicPlan { topic, payload_bytes })
    }

    #[test]
    fn a_vga_camera_with_everything_fits_in_64_mb() {
        let reservation = Reservation::new(&vga(), &Limits::default());
        assert!(reservation.total_bytes() < 64 << 20, "{reservation}");
    }

    #[test]
    fn the_table_in_the_documentation_is_current() {
        let reservation = Reservation::new(&vga(), &Limits::default());
        let rows: Vec<String> = include_str!("plan.rs")
            .lines()
            .filter(|line| line.starts_with("//! | "))
            .map(|line| line[3..].replace(' ', ""))
            .collect();
        for topic in &reservation.topics {
            let TopicPlan { topic: name, payload_bytes } = topic.plan;
            let row = format!("|{name}|{payload_bytes}|{}|{:.1}MB|", topic.chunks, megabytes(topic.bytes));
            assert!(rows.contains(&row), "{row} is not in {rows:?}");
        }
        let sum = format!("|all|||{:.1}MB|", megabytes(reservation.total_bytes()));
        assert!(rows.contains(&sum), "{sum} is not in {rows:?}");
    }
}
