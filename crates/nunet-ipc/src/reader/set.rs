//! Joining the frames of several topics that belong together.

use nunet_types::Topic;

use super::{FrameSet, Reader};
use crate::error::IpcError;

impl Reader {
    /// The newest frames of all topics but `stats` and `attitude` that belong together, if all have arrived:
    /// they have one [`key`](crate::FrameHeader::key). Frames that arrived so far are kept for the next call;
    /// frames whose set cannot become complete any more are dropped.
    ///
    /// The daemon publishes results of one frame after the other, so of each result topic the newest frame is
    /// the right one. An image (`rgb`) is different: the camera publishes newer ones while the daemon still
    /// works on an older one. The image whose key the last results had is therefore kept until results of
    /// another key arrive, and only then replaced by the newest image, which is most likely the one that the
    /// daemon takes next. Replacing it earlier would let a fast camera overtake the daemon for ever, and no
    /// set would become complete.
    ///
    /// # Errors
    /// Those of [`next`](Self::next).
    pub fn next_set(&mut self) -> Result<Option<FrameSet>, IpcError> {
        let mut arrived = None;
        for index in 0..self.topics.len() {
            let topic = self.topics[index].topic;
            if is_result(topic) && self.replace_held(topic)? {
                arrived = self.held_key(topic);
            }
        }
        if self.topics().any(|topic| topic == Topic::Rgb) {
            let only_images = !self.topics().any(is_result);
            let held = self.held_key(Topic::Rgb);
            if only_images || held.is_none() || (arrived.is_some() && arrived != held) {
                self.replace_held(Topic::Rgb)?;
            }
        }
        let complete = self.is_set_complete();
        Ok(complete.then(|| FrameSet { frames: std::mem::take(&mut self.joining) }))
    }

    /// Whether every topic has a frame, and all have one key.
    fn is_set_complete(&self) -> bool {
        let joined = self.topics().filter(|topic| !matches!(topic, Topic::Stats | Topic::Attitude));
        let mut keys = joined.map(|topic| self.held_key(topic));
        let first = keys.next().flatten();
        first.is_some() && keys.all(|key| key == first)
    }

    /// Replaces the held frame of a topic by a newer one; returns whether there was one.
    fn replace_held(&mut self, topic: Topic) -> Result<bool, IpcError> {
        let more = self.has_more(topic)?;
        if more {
            drop(self.joining[topic as usize].take()); // first: a reader may hold few frames
            self.joining[topic as usize] = self.latest(topic)?;
        }
        Ok(more)
    }

    fn held_key(&self, topic: Topic) -> Option<(u64, i64)> {
        self.joining[topic as usize].as_ref().map(|frame| frame.header().key())
    }
}

/// Whether the daemon computes it from an image.
fn is_result(topic: Topic) -> bool {
    !matches!(topic, Topic::Stats | Topic::Attitude | Topic::Rgb)
}
