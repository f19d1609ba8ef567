//! The few parts of RTPS messages that the transport looks at (DDSI-RTPS 2.5, sections 8.3 and 9.4).

use std::ops::Range;

/// What identifies a participant: the first bytes of the identifiers of all its readers and writers.
pub(super) type Prefix = [u8; 12];

pub(super) const HEADER_BYTES: usize = 20;
pub(super) const SUBMESSAGE_HEADER_BYTES: usize = 4;

pub(super) const PAD: u8 = 0x01;
pub(super) const ACKNACK: u8 = 0x06;
pub(super) const HEARTBEAT: u8 = 0x07;
pub(super) const GAP: u8 = 0x08;
pub(super) const INFO_TIMESTAMP: u8 = 0x09;
pub(super) const INFO_DESTINATION: u8 = 0x0e;
pub(super) const NACK_FRAG: u8 = 0x12;
pub(super) const HEARTBEAT_FRAG: u8 = 0x13;
pub(super) const DATA: u8 = 0x15;
pub(super) const DATA_FRAG: u8 = 0x16;
/// The first of those that vendors define. All others skip them.
pub(super) const VENDOR_SUBMESSAGES: u8 = 0x80;

pub(super) const FLAG_LITTLE_ENDIAN: u8 = 1;
pub(super) const FLAG_INLINE_QOS: u8 = 2;
pub(super) const FLAG_DATA: u8 = 4;
pub(super) const FLAG_KEY: u8 = 8;

pub(super) const SENTINEL: u16 = 0x0001;

/// The participant that sent a datagram; `None` if it is not RTPS.
pub(super) fn sender(datagram: &[u8]) -> Option<Prefix> {
    let header = datagram.get(..HEADER_BYTES).filter(|header| header.starts_with(b"RTPS"))?;
    header.get(8..)?.try_into().ok()
}

/// The participant that a datagram is for.
pub(super) fn destination(datagram: &[u8]) -> Option<Prefix> {
    let named = submessages(datagram).find(|part| part.id == INFO_DESTINATION)?;
    datagram.get(named.body)?.get(..12)?.try_into().ok()
}

/// A reader and a writer.
pub(super) type Endpoints = [u8; 8];

/// Whether they belong to a topic, and not to discovery.
pub(super) fn is_of_topic(endpoints: Endpoints) -> bool {
    const BUILT_IN: u8 = 0xc0;
    endpoints[7] & BUILT_IN != BUILT_IN
}

/// Whether a datagram has something of a writer of a topic.
pub(super) fn carries_topic(datagram: &[u8]) -> bool {
    submessages(datagram).any(|part| {
        let body = datagram.get(part.body).unwrap_or_default();
        let endpoints = match part.id {
            HEARTBEAT | GAP => body.get(..8),
            DATA | DATA_FRAG => body.get(4..12),
            _ => None,
        };
        endpoints.and_then(|endpoints| endpoints.try_into().ok()).is_some_and(is_of_topic)
    })
}

/// A heartbeat, which a reader has to answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Question {
    peer: Prefix,
    pub(super) endpoints: Endpoints,
    /// The number of the last message, in little endian words.
    last: [u32; 2],
}

/// The heartbeat in a datagram that the library sends.
pub(super) fn question(datagram: &[u8]) -> Option<Question> {
    let peer = destination(datagram)?;
    let part = submessages(datagram).find(|part| part.id == HEARTBEAT)?;
    let body = datagram.get(part.body)?;
    let is_little = part.flags & FLAG_LITTLE_ENDIAN != 0;
    let last = [word(body, 16, is_little)?, word(body, 20, is_little)?];
    Some(Question { peer, endpoints: body.get(..8)?.try_into().ok()?, last })
}

/// What the reader would answer that has got everything.
pub(super) fn answer(question: &Question, count: u32) -> Vec<u8> {
    const FLAG_FINAL: u8 = 2;
    let [high, low] = question.last;
    let next = ((u64::from(high) << 32) | u64::from(low)) + 1;
    let words = [(next >> 32) as u32, next as u32, 0, count];
    let body: Vec<u8> =
        question.endpoints.into_iter().chain(words.into_iter().flat_map(u32::to_le_bytes)).collect();
    let header = [ACKNACK, FLAG_LITTLE_ENDIAN | FLAG_FINAL, body.len() as u8, 0];
    [&b"RTPS\x02\x04\0\0"[..], &question.peer, &header, &body].concat()
}

/// Replaces the numbers of confirmations.
pub(super) fn renumber(datagram: &mut [u8], mut number: impl FnMut(Endpoints, u32) -> u32) {
    let parts: Vec<_> = submessages(datagram).filter(|part| part.id == ACKNACK).collect();
    for Submessage { flags, body, .. } in parts {
        let is_little = flags & FLAG_LITTLE_ENDIAN != 0;
        let Some(body) = datagram.get_mut(body) else { continue };
        let place = word(body, 16, is_little).map(|bits| 20 + 4 * bits.div_ceil(32) as usize);
        let endpoints = body.get(..8).and_then(|endpoints| endpoints.try_into().ok());
        let (Some(place), Some(endpoints)) = (place, endpoints) else { continue };
        let Some(count) = word(body, place, is_little) else { continue };
        let count = number(endpoints, count);
        let bytes = if is_little { count.to_le_bytes() } else { count.to_be_bytes() };
        body.get_mut(place..place + 4).into_iter().for_each(|own| own.copy_from_slice(&bytes));
    }
}

/// Place, identifier and value of each parameter, up to the sentinel or to one that is longer than what is
/// left.
pub(super) fn parameters(
    body: &[u8],
    start: usize,
    is_little: bool,
) -> impl Iterator<Item = (usize, u16, Range<usize>)> {
    let mut at = start;
    std::iter::from_fn(move || {
        let id = number(body, at, is_little).filter(|id| *id != SENTINEL)?;
        let value = at + 4..at + 4 + usize::from(number(body, at + 2, is_little)?);
        let here = std::mem::replace(&mut at, value.end);
        (value.end <= body.len()).then_some((here, id, value))
    })
}

pub(super) fn number(bytes: &[u8], at: usize, is_little: bool) -> Option<u16> {
    let bytes = bytes.get(at..at.checked_add(2)?)?.try_into().ok()?;
    Some(if is_little { u16::from_le_bytes(bytes) } else { u16::from_be_bytes(bytes) })
}

pub(super) fn word(bytes: &[u8], at: usize, is_little: bool) -> Option<u32> {
    let bytes = bytes.get(at..at.checked_add(4)?)?.try_into().ok()?;
    Some(if is_little { u32::from_le_bytes(bytes) } else { u32::from_be_bytes(bytes) })
}

/// A part of a datagram.
pub(super) struct Submessage {
    pub(super) id: u8,
    pub(super) flags: u8,
    /// As stated.
    pub(super) length: usize,
    pub(super) body: Range<usize>,
}

/// The submessages of a datagram, up to one that is longer than what is left.
pub(super) fn submessages(datagram: &[u8]) -> impl Iterator<Item = Submessage> {
    let mut at = if sender(datagram).is_some() { HEADER_BYTES } else { datagram.len() };
    std::iter::from_fn(move || {
        let &[id, flags, ..] = datagram.get(at..at + SUBMESSAGE_HEADER_BYTES)? else { return None };
        let start = at + SUBMESSAGE_HEADER_BYTES;
        let length = usize::from(number(datagram, at + 2, flags & FLAG_LITTLE_ENDIAN != 0)?);
        // Length 0 means: up to the end, but not for those that may be empty.
        let is_last = length == 0 && ![PAD, INFO_TIMESTAMP].contains(&id);
        at = if is_last { datagram.len() } else { start + length };
        (at <= datagram.len()).then_some(Submessage { id, flags, length, body: start..at })
    })
}

/// A reader or writer of a participant.
type Entity = [u8; 4];

const PARTICIPANT: Entity = [0, 0, 1, 0xc1];
const PARTICIPANT_READER: Entity = [0, 1, 0, 0xc7];
const PARTICIPANT_WRITER: Entity = [0, 1, 0, 0xc2];
const READERS_READER: Entity = [0, 0, 4, 0xc7];
const READERS_WRITER: Entity = [0, 0, 4, 0xc2];
/// Higher than all numbers of announcements of a participant.
const LAST_ANNOUNCEMENT: u64 = 1 << 40;

/// The datagram by which `participant` announces that it leaves.
pub(super) fn departure_of(participant: Prefix, sequence: u64) -> Vec<u8> {
    let leaving = disposal([PARTICIPANT_READER, PARTICIPANT_WRITER], sequence, participant, PARTICIPANT);
    [&header_of(participant)[..], &leaving].concat()
}

/// How `participant` would say that its `readers` end.
pub(super) fn end_of_readers(participant: Prefix, readers: &[Endpoints]) -> Vec<u8> {
    let words =
        [0, 1, LAST_ANNOUNCEMENT >> 32, LAST_ANNOUNCEMENT & u64::from(u32::MAX), 0].map(|word| word as u32);
    let gap: Vec<u8> = [READERS_READER, READERS_WRITER].concat();
    let gap: Vec<u8> = gap.into_iter().chain(words.into_iter().flat_map(u32::to_le_bytes)).collect();
    let mut datagram = header_of(participant);
    datagram.extend([GAP, FLAG_LITTLE_ENDIAN, gap.len() as u8, 0]);
    datagram.extend(gap);
    for (&[a, b, c, d, ..], sequence) in readers.iter().zip(LAST_ANNOUNCEMENT..) {
        datagram.extend(disposal([READERS_READER, READERS_WRITER], sequence, participant, [a, b, c, d]));
    }
    datagram
}

fn header_of(participant: Prefix) -> Vec<u8> {
    [&b"RTPS\x02\x04\0\0"[..], &participant].concat()
}

/// DATA without data: an entity has been disposed of and is not written any more.
fn disposal([reader, writer]: [Entity; 2], sequence: u64, participant: Prefix, entity: Entity) -> Vec<u8> {
    const DISPOSED_AND_UNREGISTERED: [u8; 4] = [0, 0, 0, 3];
    let body: Vec<u8> = [
        &[0, 0, 16, 0][..], // the inline parameters begin 16 bytes further
        &reader,
        &writer,
        &((sequence >> 32) as u32).to_le_bytes(),
        &(sequence as u32).to_le_bytes(),
        &[0x70, 0, 16, 0], // key hash
        &participant,
        &entity,
        &[0x71, 0, 4, 0], // status
        &DISPOSED_AND_UNREGISTERED,
        &[1, 0, 0, 0], // sentinel
    ]
    .concat();
    [&[DATA, FLAG_LITTLE_ENDIAN | FLAG_INLINE_QOS, body.len() as u8, 0][..], &body].concat()
}

/// The library's departure, as all vendors understand it: Cyclone DDS cannot read the key that the library
/// sends as data.
pub(super) fn understood_departure(datagram: &[u8]) -> Option<Vec<u8>> {
    let part = submessages(datagram).find(|part| part.id == DATA)?;
    let body = datagram.get(part.body)?;
    let is_little = part.flags & FLAG_LITTLE_ENDIAN != 0;
    let is_departure =
        part.flags & (FLAG_DATA | FLAG_KEY) == FLAG_KEY && body.get(8..12)? == PARTICIPANT_WRITER;
    let sequence = (u64::from(word(body, 12, is_little)?) << 32) | u64::from(word(body, 16, is_little)?);
    if is_departure { Some(departure_of(sender(datagram)?, sequence)) } else { None }
}

#[cfg(test)]
pub(super) mod tests;
