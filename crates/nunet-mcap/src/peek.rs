//! Looks at the first images of topics, whose content is not clear from their names.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use crate::RecordingError;
use crate::bag::RecordingPart;
use crate::channels::{Channels, FirstImages};
use crate::decode::{self, ReadMode};
use crate::image::{IS_DEPTH, RecordedImage};
use crate::record::Record;
use crate::records::Records;

/// The number of records, and of bytes in messages, that are searched for first messages.
pub(crate) const LOOK_AHEAD: usize = 10_000;
pub(crate) const LOOK_AHEAD_BYTES: usize = 64 << 20;

/// Reads the first message of topics, to see whether they carry depth.
pub(crate) struct Peek<'a>(pub(crate) &'a [RecordingPart]);

impl FirstImages for Peek<'_> {
    fn are_depth(&self, topics: &BTreeSet<&str>) -> BTreeMap<String, bool> {
        let found = RefCell::new(BTreeMap::new());
        for part in self.0 {
            // A file that cannot be read is reported by the next read.
            let _ = peek(&part.path, topics, &mut found.borrow_mut());
            if found.borrow().len() == topics.len() {
                break;
            }
        }
        found.into_inner()
    }
}

fn peek(
    path: &Path,
    topics: &BTreeSet<&str>,
    found: &mut BTreeMap<String, bool>,
) -> Result<(), RecordingError> {
    let (mut records, mut channels, mut bytes) = (Records::open(path)?, Channels::default(), 0);
    for _ in 0..LOOK_AHEAD {
        let more = records.next(|record| {
            channels.learn(&record);
            let Record::Message { channel_id, data, .. } = record else { return };
            bytes += data.len();
            let Some(channel) = channels.get(channel_id) else { return };
            if !topics.contains(channel.topic.as_str()) || found.contains_key(&channel.topic) {
                return;
            }
            let read_mode = ReadMode::of_image_topic(&channel.topic);
            let mut image = RecordedImage::default();
            let read = channel.kind().map(|kind| decode::image(kind, data, read_mode, &mut image));
            let is_depth = match read {
                Some(Ok(())) => image.encoding.is_some_and(|encoding| encoding.is_depth()),
                Some(Err(reason)) => reason.ends_with(IS_DEPTH),
                None => false,
            };
            found.insert(channel.topic.clone(), is_depth);
        });
        if matches!(more, Err(RecordingError::DamagedChunk { .. })) {
            continue;
        }
        if more?.is_none() || found.len() == topics.len() || bytes > LOOK_AHEAD_BYTES {
            break;
        }
    }
    Ok(())
}
