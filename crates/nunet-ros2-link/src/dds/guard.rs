//! Which datagrams are passed to `dust_dds` 0.16, and which parts of them.
//!
//! Some values, which any machine can send, make it panic and end its thread. So it receives only what it
//! needs, in the form that ROS 2 sends: submessages of listed kinds, with all fields in their ranges and
//! lengths as it computes them.

use std::ops::Range;

use dust_dds::rtps::message_receiver::MessageReceiver;
use dust_dds::rtps_messages::overall_structure::RtpsMessageRead;

use super::announcement::{is_sound, limit_endpoints, simplify};
use super::rtps::{
    ACKNACK, DATA, DATA_FRAG, FLAG_DATA, FLAG_INLINE_QOS, FLAG_KEY, FLAG_LITTLE_ENDIAN, GAP, HEADER_BYTES,
    HEARTBEAT, HEARTBEAT_FRAG, INFO_DESTINATION, INFO_TIMESTAMP, NACK_FRAG, PAD, SENTINEL,
    SUBMESSAGE_HEADER_BYTES, Submessage, VENDOR_SUBMESSAGES, number, parameters, sender, submessages,
};

/// The flag of `INFO_TIMESTAMP` without a timestamp.
const FLAG_INVALID: u8 = 2;
/// The largest number of missing messages or fragments in a set.
const MAX_SET: u32 = 256;
/// The library continues counting from the numbers that it receives.
const MAX_SEQUENCE: i64 = 1 << 62;
const MAX_FRAGMENT: u32 = 1 << 31;

/// The writers by which participants announce themselves, their writers and their readers.
const ANNOUNCING_WRITERS: [[u8; 4]; 3] = [[0, 1, 0, 0xc2], [0, 0, 3, 0xc2], [0, 0, 4, 0xc2]];

/// Whether a datagram is RTPS as ROS 2 sends it.
pub(super) fn is_acceptable(datagram: &[u8]) -> bool {
    if sender(datagram).is_none() {
        return false;
    }
    let mut end = HEADER_BYTES;
    for part in submessages(datagram) {
        end = part.body.end;
        let Some(body) = datagram.get(part.body.clone()) else { return false };
        let is_empty_allowed = [PAD, INFO_TIMESTAMP, DATA, DATA_FRAG].contains(&part.id);
        if (part.length == 0 && !is_empty_allowed) || !Fields::new(&part, body).are_sound() {
            return false;
        }
    }
    // The walk ends early at a submessage that is longer than the datagram. The library ignores up to three
    // bytes.
    datagram.len() - end < SUBMESSAGE_HEADER_BYTES
}

/// Hides from the library what it does not need or misunderstands. The datagram must be
/// [acceptable](is_acceptable).
pub(super) fn hide_misunderstood(datagram: &mut [u8]) {
    let parts: Vec<_> = submessages(datagram).collect();
    for part in parts {
        let is_hidden = match part.id {
            // Subscribers get their messages from the transport.
            DATA => datagram.get(part.body.clone()).is_none_or(|body| !is_announcement(body)),
            DATA_FRAG => true,
            _ => false,
        };
        let Some(header) = datagram.get_mut(part.body.start - SUBMESSAGE_HEADER_BYTES..part.body.start)
        else {
            return;
        };
        if let [id, flags, length @ ..] = header {
            // Length 0 is "up to the end" for some kinds only.
            let explicit = u16::try_from(part.body.len()).unwrap_or_default();
            let is_little = *flags & FLAG_LITTLE_ENDIAN != 0;
            let bytes = if is_little { explicit.to_le_bytes() } else { explicit.to_be_bytes() };
            length.copy_from_slice(&bytes);
            *id = if is_hidden { PAD } else { *id };
        }
        let Some(body) = datagram.get_mut(part.body.clone()) else { return };
        match part.id {
            DATA if !is_hidden => hide_in_announcement(body, part.flags),
            GAP => shorten_gap(body, part.flags),
            _ => {}
        }
    }
}

/// The payload of the announcement of a participant, if a datagram has one.
pub(super) fn participant_payload(datagram: &[u8]) -> Option<Range<usize>> {
    let part = submessages(datagram).find(|part| part.id == DATA && part.flags & FLAG_DATA != 0)?;
    let body = datagram.get(part.body.clone())?;
    let is_participant = body.get(8..12)? == ANNOUNCING_WRITERS[0];
    let start = payload_start(body, part.flags).filter(|_| is_participant)?;
    Some(part.body.start + start..part.body.end)
}

fn is_announcement(body: &[u8]) -> bool {
    body.get(8..12).is_some_and(|writer| ANNOUNCING_WRITERS.iter().any(|known| known == writer))
}

fn hide_in_announcement(body: &mut [u8], flags: u8) {
    let Some(start) = payload_start(body, flags) else { return };
    if flags & FLAG_DATA != 0
        && let Some(payload) = body.get_mut(start..)
    {
        simplify(payload);
        limit_endpoints(payload);
    }
}

/// The library counts through a gap, which may have 2^62 messages. Its last one has the same effect.
fn shorten_gap(body: &mut [u8], flags: u8) {
    let fields = Fields { id: GAP, flags, body };
    let (Some(start), Some(end)) = (fields.sequence(8), fields.sequence(16)) else { return };
    let last = end - 1;
    if start < last
        && let Some(place) = body.get_mut(8..16)
    {
        let is_little = flags & FLAG_LITTLE_ENDIAN != 0;
        for (word, value) in place.chunks_exact_mut(4).zip([(last >> 32) as u32, last as u32]) {
            word.copy_from_slice(&if is_little { value.to_le_bytes() } else { value.to_be_bytes() });
        }
    }
}

/// Where the data of a `DATA` or `DATA_FRAG` submessage begins, behind its inline parameters.
pub(super) fn payload_start(body: &[u8], flags: u8) -> Option<usize> {
    let is_little = flags & FLAG_LITTLE_ENDIAN != 0;
    let start = 4 + usize::from(number(body, 2, is_little)?);
    if flags & FLAG_INLINE_QOS == 0 {
        return Some(start).filter(|start| *start <= body.len());
    }
    let mut end = start;
    // The library refuses other lengths.
    let are_aligned = parameters(body, start, is_little).all(|(_, _, value)| {
        end = value.end;
        value.len().is_multiple_of(4)
    });
    (are_aligned && number(body, end, is_little)? == SENTINEL && end + 4 <= body.len()).then_some(end + 4)
}

/// The body of a submessage.
struct Fields<'a> {
    id: u8,
    flags: u8,
    body: &'a [u8],
}

impl<'a> Fields<'a> {
    fn new(part: &Submessage, body: &'a [u8]) -> Self {
        Self { id: part.id, flags: part.flags, body }
    }

    fn are_sound(&self) -> bool {
        let sound = match self.id {
            PAD | VENDOR_SUBMESSAGES.. => Some(true),
            INFO_TIMESTAMP => Some(self.flags & FLAG_INVALID != 0 || self.body.len() >= 8),
            INFO_DESTINATION => Some(self.body.len() >= 12),
            HEARTBEAT => self.sequence(8).zip(self.sequence(16)).map(|_| self.body.len() >= 28),
            HEARTBEAT_FRAG => self.sequence(8).map(|_| self.body.len() >= 24),
            ACKNACK => self.sequence(8).and_then(|_| self.has_set(16, 4)),
            NACK_FRAG => self.sequence(8).and_then(|_| self.fragment(16)).and_then(|_| self.has_set(20, 4)),
            GAP => self.sequence(8).zip(self.sequence(16)).and_then(|_| self.has_set(24, 0)),
            DATA => self.is_data(),
            DATA_FRAG => self.sequence(12).map(|_| self.body.len() >= 32),
            // INFO_REPLY and INFO_SOURCE among them, which no middleware of ROS 2 sends.
            _ => None,
        };
        sound.unwrap_or(false)
    }

    fn is_data(&self) -> Option<bool> {
        self.sequence(12)?;
        let payload = self.body.get(payload_start(self.body, self.flags)?..)?;
        let has_payload = self.flags & (FLAG_DATA | FLAG_KEY) != 0;
        Some(!has_payload || !is_announcement(self.body) || is_sound(payload))
    }

    fn word(&self, at: usize) -> Option<u32> {
        let bytes = self.body.get(at..at + 4)?.try_into().ok()?;
        let is_little = self.flags & FLAG_LITTLE_ENDIAN != 0;
        Some(if is_little { u32::from_le_bytes(bytes) } else { u32::from_be_bytes(bytes) })
    }

    /// A sequence number that can be counted with.
    fn sequence(&self, at: usize) -> Option<i64> {
        let sequence = (i64::from(self.word(at)?) << 32) | i64::from(self.word(at + 4)?);
        (0..MAX_SEQUENCE).contains(&sequence).then_some(sequence)
    }

    fn fragment(&self, at: usize) -> Option<u32> {
        self.word(at).filter(|fragment| (1..MAX_FRAGMENT).contains(fragment))
    }

    /// Whether there are the size of a set, its bits and `behind` more bytes.
    fn has_set(&self, at: usize, behind: usize) -> Option<bool> {
        let size = self.word(at).filter(|size| *size <= MAX_SET)?;
        let words = usize::try_from(size.div_ceil(32)).ok()?;
        Some(self.body.len() >= at + 4 + 4 * words + behind)
    }
}

/// How many submessages the library reads in a datagram; `None` if it does not get it. For tests with damaged
/// ones.
#[must_use]
pub fn submessages_read(datagram: &[u8]) -> Option<usize> {
    if !is_acceptable(datagram) {
        return None;
    }
    let mut hidden = datagram.to_vec();
    hide_misunderstood(&mut hidden);
    let read = RtpsMessageRead::try_from(hidden.as_slice()).ok()?;
    MessageReceiver::new(&read).for_each(drop);
    Some(read.submessages().len())
}

#[cfg(test)]
mod tests;
