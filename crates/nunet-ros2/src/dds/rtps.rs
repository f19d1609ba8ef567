//! The few parts of RTPS messages that the transport looks at (DDSI-RTPS 2.5, sections 8.3 and 9.4).

/// What identifies a participant: the first bytes of the identifiers of all its readers and writers.
pub(super) type Prefix = [u8; 12];

const HEADER_BYTES: usize = 20;
const SUBMESSAGE_HEADER_BYTES: usize = 4;

const PAD: u8 = 0x01;
const HEARTBEAT: u8 = 0x07;
const INFO_TIMESTAMP: u8 = 0x09;
const INFO_DESTINATION: u8 = 0x0e;
const INFO_REPLY: u8 = 0x0f;
const DATA: u8 = 0x15;

const FLAG_LITTLE_ENDIAN: u8 = 1;
const FLAG_INLINE_QOS: u8 = 2;
const FLAG_DATA: u8 = 4;

const SENTINEL: u16 = 0x0001;
const LIVELINESS: u16 = 0x001b;
const DEADLINE: u16 = 0x0023;
const TYPE_INFORMATION: u16 = 0x0075;
/// Parameters of vendors are ignored by others.
const VENDOR_SPECIFIC: u8 = 0x80;

/// The writers by which participants announce their writers and readers.
const ENDPOINT_WRITERS: [[u8; 4]; 2] = [[0, 0, 3, 0xc2], [0, 0, 4, 0xc2]];

/// The participant that sent a datagram; `None` if it is not RTPS.
pub(super) fn sender(datagram: &[u8]) -> Option<Prefix> {
    let header = datagram.get(..HEADER_BYTES).filter(|header| header.starts_with(b"RTPS"))?;
    header.get(8..)?.try_into().ok()
}

/// Whether `dust_dds` 0.16 can take a datagram: it panics at `INFO_REPLY`, which no middleware of ROS 2 sends.
pub(super) fn is_acceptable(datagram: &[u8]) -> bool {
    sender(datagram).is_some() && submessages(datagram).all(|part| part.id != INFO_REPLY)
}

/// The participant whose answer a datagram asks for by a heartbeat.
pub(super) fn asks_for_answer(datagram: &[u8]) -> Option<Prefix> {
    let mut destination = None;
    for Submessage { id, body, .. } in submessages(datagram) {
        match id {
            INFO_DESTINATION => {
                destination = datagram.get(body).and_then(|body| body.get(..12)?.try_into().ok());
            }
            HEARTBEAT => return destination,
            _ => {}
        }
    }
    None
}

/// Hides parameters that `dust_dds` 0.16 misunderstands when endpoints are announced:
/// - type information, because it would compare the type with that of [`RawMessage`](super::raw_message::RawMessage);
///   without it, types are compared by name, as between ROS 2 nodes of different vendors;
/// - deadlines and liveliness that are infinite in the way of Fast DDS, which it takes for finite ones and refuses.
pub(super) fn hide_misunderstood(datagram: &mut [u8]) {
    let announcements: Vec<_> = submessages(datagram).filter(|part| part.id == DATA).collect();
    for Submessage { flags, body, .. } in announcements {
        if let Some(body) = datagram.get_mut(body) {
            hide_in_announcement(body, flags);
        }
    }
}

fn hide_in_announcement(body: &mut [u8], flags: u8) {
    let Some(writer) = body.get(8..12) else { return };
    if flags & FLAG_DATA == 0 || !ENDPOINT_WRITERS.iter().any(|known| known == writer) {
        return;
    }
    let Some(payload) = payload_start(body, flags) else { return };
    // The encapsulation's second byte: 3 is a parameter list in little endian, 2 in big endian.
    let is_little = body.get(payload + 1) == Some(&3);
    let found: Vec<_> = parameters(body, payload + 4, is_little).collect();
    for (at, id, value) in found {
        let value = body.get(value).unwrap_or_default();
        if id == TYPE_INFORMATION || ([DEADLINE, LIVELINESS].contains(&id) && ends_infinite(value)) {
            let high_byte = at + usize::from(is_little);
            body.get_mut(high_byte).into_iter().for_each(|byte| *byte = VENDOR_SPECIFIC);
        }
    }
}

/// 0x7fffffff seconds and 0xffffffff fractions of a second.
fn ends_infinite(value: &[u8]) -> bool {
    value.ends_with(&[0xff, 0xff, 0xff, 0x7f, 0xff, 0xff, 0xff, 0xff])
        || value.ends_with(&[0x7f, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff])
}

/// Where the data of a DATA submessage begins, behind its inline parameters.
fn payload_start(body: &[u8], flags: u8) -> Option<usize> {
    let is_little = flags & FLAG_LITTLE_ENDIAN != 0;
    let start = 4 + usize::from(number(body, 2, is_little)?);
    if flags & FLAG_INLINE_QOS == 0 {
        return Some(start);
    }
    let mut at = start;
    while number(body, at, is_little)? != SENTINEL {
        at += 4 + usize::from(number(body, at + 2, is_little)?);
    }
    Some(at + 4)
}

/// Place, identifier and value of each parameter, up to the sentinel.
fn parameters(
    body: &[u8],
    start: usize,
    is_little: bool,
) -> impl Iterator<Item = (usize, u16, std::ops::Range<usize>)> {
    let mut at = start;
    std::iter::from_fn(move || {
        let id = number(body, at, is_little).filter(|id| *id != SENTINEL)?;
        let length = usize::from(number(body, at + 2, is_little)?);
        let here = at;
        at += 4 + length;
        Some((here, id, here + 4..at))
    })
}

fn number(bytes: &[u8], at: usize, is_little: bool) -> Option<u16> {
    let bytes = bytes.get(at..at.checked_add(2)?)?.try_into().ok()?;
    Some(if is_little { u16::from_le_bytes(bytes) } else { u16::from_be_bytes(bytes) })
}

/// A part of a datagram.
struct Submessage {
    id: u8,
    flags: u8,
    body: std::ops::Range<usize>,
}

fn submessages(datagram: &[u8]) -> impl Iterator<Item = Submessage> {
    let mut at = if sender(datagram).is_some() { HEADER_BYTES } else { datagram.len() };
    std::iter::from_fn(move || {
        let &[id, flags, ..] = datagram.get(at..at + SUBMESSAGE_HEADER_BYTES)? else { return None };
        let start = at + SUBMESSAGE_HEADER_BYTES;
        let length = usize::from(number(datagram, at + 2, flags & FLAG_LITTLE_ENDIAN != 0)?);
        // Length 0 means: up to the end, but not for those that may be empty.
        let is_last = length == 0 && ![PAD, INFO_TIMESTAMP].contains(&id);
        at = if is_last { datagram.len() } else { (start + length).min(datagram.len()) };
        Some(Submessage { id, flags, body: start..at })
    })
}

/// A message by which `participant` would say that it leaves.
pub(super) fn farewell_of(participant: Prefix) -> Vec<u8> {
    const PARTICIPANT: [u8; 4] = [0, 0, 1, 0xc1];
    const PARTICIPANT_READER: [u8; 4] = [0, 1, 0, 0xc7];
    const PARTICIPANT_WRITER: [u8; 4] = [0, 1, 0, 0xc2];
    const DISPOSED_AND_UNREGISTERED: [u8; 4] = [0, 0, 0, 3];
    let body: Vec<u8> = [
        &[0, 0, 16, 0][..], // the inline parameters begin 16 bytes further
        &PARTICIPANT_READER,
        &PARTICIPANT_WRITER,
        &[0, 0, 0, 0, 1, 0, 0, 0], // sequence number
        &[0x70, 0, 16, 0],         // key hash
        &participant,
        &PARTICIPANT,
        &[0x71, 0, 4, 0], // status
        &DISPOSED_AND_UNREGISTERED,
        &[1, 0, 0, 0], // sentinel
    ]
    .concat();
    let length = (body.len() as u16).to_le_bytes();
    [
        &b"RTPS\x02\x04\0\0"[..],
        &participant,
        &[DATA, FLAG_LITTLE_ENDIAN | FLAG_INLINE_QOS, length[0], length[1]],
        &body,
    ]
    .concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    const PEER: Prefix = [9; 12];

    fn datagram(parts: &[&[u8]]) -> Vec<u8> {
        [&b"RTPS\x02\x04\x01\x0f"[..], &PEER, &parts.concat()].concat()
    }

    /// As Fast DDS announces a reader.
    fn announcement() -> Vec<u8> {
        let body: Vec<u8> = [
            &[0, 0, 16, 0][..],
            &[0, 0, 4, 0xc7],
            &[0, 0, 4, 0xc2],
            &[0, 0, 0, 0, 5, 0, 0, 0],
            &[0, 3, 0, 0],
            &[0x23, 0, 8, 0, 0xff, 0xff, 0xff, 0x7f, 0xff, 0xff, 0xff, 0xff],
            &[0x75, 0, 4, 0, 1, 2, 3, 4],
            &[0x1b, 0, 12, 0, 0, 0, 0, 0, 2, 0, 0, 0, 0, 0, 0, 0],
            &[1, 0, 0, 0],
        ]
        .concat();
        datagram(&[&[9, 1, 8, 0, 0, 0, 0, 0, 0, 0, 0, 0], &[DATA, 5, body.len() as u8, 0], &body])
    }

    #[test]
    fn what_the_library_misunderstands_is_hidden_and_nothing_else() {
        let (before, mut after) = (announcement(), announcement());
        hide_misunderstood(&mut after);
        let changed: Vec<_> = (0..before.len()).filter(|&at| before[at] != after[at]).collect();
        assert_eq!(
            changed.len(),
            2,
            "an infinite deadline and the type, not a finite liveliness: {changed:?}"
        );
        assert!(changed.iter().all(|&at| after[at] == VENDOR_SPECIFIC));
        assert_eq!((before[changed[0] - 1], before[changed[1] - 1]), (0x23, 0x75));
    }

    #[test]
    fn a_heartbeat_asks_the_participant_that_the_datagram_is_for() {
        let other = [7; 12];
        let destination = [&[INFO_DESTINATION, 1, 12, 0][..], &other].concat();
        let heartbeat = [&[HEARTBEAT, 1, 28, 0][..], &[0; 28]].concat();
        assert_eq!(asks_for_answer(&datagram(&[&destination, &heartbeat])), Some(other));
        assert_eq!(asks_for_answer(&datagram(&[&destination])), None);
        assert_eq!(sender(&datagram(&[])), Some(PEER));
        assert!(is_acceptable(&announcement()));
        assert!(!is_acceptable(&datagram(&[&destination, &[INFO_REPLY, 1, 4, 0, 0, 0, 0, 0]])));
    }

    #[test]
    fn cut_and_damaged_datagrams_never_panic() {
        let whole = announcement();
        for length in 0..whole.len() {
            hide_misunderstood(&mut whole[..length].to_vec());
            asks_for_answer(&whole[..length]);
        }
        for at in 0..whole.len() {
            for value in [0, 1, 2, 0x7f, 0xff] {
                let mut damaged = whole.clone();
                damaged[at] = value;
                hide_misunderstood(&mut damaged);
                asks_for_answer(&damaged);
            }
        }
    }

    #[test]
    fn a_farewell_is_one_submessage_of_the_participant_that_leaves() {
        let farewell = farewell_of(PEER);
        assert_eq!(sender(&farewell), Some(PEER));
        assert_eq!(farewell[28..36], [0, 1, 0, 0xc7, 0, 1, 0, 0xc2], "from the writer of announcements");
        let parts: Vec<_> = submessages(&farewell).collect();
        assert_eq!((parts.len(), parts[0].body.end), (1, farewell.len()));
        let found: Vec<_> = parameters(&farewell[24..], 20, true).map(|(_, id, _)| id).collect();
        assert_eq!(found, [0x70, 0x71]);
    }
}
