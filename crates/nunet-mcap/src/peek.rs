//! Looks at the first images of topics, whose content is not clear from their names and types.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use crate::RecordingError;
use crate::bag::RecordingPart;
use crate::channel::Channel;
use crate::channels::{Channels, FirstImage, FirstImages};
use crate::decode::{self, ReadMode};
use crate::encoding::ImageEncoding;
use crate::image::RecordedImage;
use crate::image_error::ImageError;
use crate::record::Record;
use crate::records::Records;

/// The number of records, and of bytes in messages, that are searched for first messages.
pub(crate) const LOOK_AHEAD: usize = 10_000;
pub(crate) const LOOK_AHEAD_BYTES: usize = 64 << 20;

/// Reads the first undamaged message of topics.
pub(crate) struct Peek<'a>(pub(crate) &'a [RecordingPart]);

impl FirstImages for Peek<'_> {
    fn first_images(&self, topics: &BTreeSet<&str>) -> BTreeMap<String, FirstImage> {
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
    found: &mut BTreeMap<String, FirstImage>,
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
            if let Some(first) = first_image(channel, data) {
                found.insert(channel.topic.clone(), first);
            }
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

/// `None` for a damaged message, and for one of another type.
fn first_image(channel: &Channel, data: &[u8]) -> Option<FirstImage> {
    let kind = channel.kind().filter(|kind| !kind.is_camera())?;
    let mut image = RecordedImage::default();
    match decode::image(kind, data, ReadMode::of_image_topic(&channel.topic), &mut image) {
        Ok(()) if image.encoding.is_some_and(ImageEncoding::is_depth) => Some(FirstImage::Depth),
        Ok(()) => Some(FirstImage::Image),
        Err(ImageError::Depth { .. }) => Some(FirstImage::Depth),
        Err(error @ ImageError::Encoding { .. }) => Some(FirstImage::Unreadable(error.to_string())),
        Err(ImageError::Message(_)) => None,
    }
}
