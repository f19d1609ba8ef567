//! Messages of publishers within datagrams: `DATA` and `DATA_FRAG` (DDSI-RTPS 2.5, sections 9.4.5.4 and
//! 9.4.5.5).

use super::guard::payload_start;
use super::rtps::{
    DATA, DATA_FRAG, FLAG_DATA, FLAG_LITTLE_ENDIAN, Submessage, number, sender, submessages, word,
};

/// The payload of `DATA_FRAG` is a key, not data.
const FLAG_FRAGMENT_KEY: u8 = 4;
/// The bits of an entity's kind that tell the middleware's own entities from those of users, which have none
/// of them (section 9.3.1.2).
const NOT_OF_USERS: u8 = 0xc0;

/// Identifies a writer: its participant, and its number there.
pub(super) type Guid = [u8; 16];

/// A message of a user's writer, or consecutive fragments of one.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Piece<'a> {
    pub(super) writer: Guid,
    /// Counts the writer's messages.
    pub(super) sequence: i64,
    /// `None` for a whole message.
    pub(super) fragments: Option<Fragments>,
    pub(super) bytes: &'a [u8],
}

/// Which part of a message a piece is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Fragments {
    /// Counts from 0.
    pub(super) first: u32,
    /// Bytes of each fragment but the last.
    pub(super) fragment_bytes: u16,
    pub(super) message_bytes: u32,
}

/// The messages and fragments of users' writers in a datagram.
pub(super) fn pieces(datagram: &[u8]) -> impl Iterator<Item = Piece<'_>> {
    let participant = sender(datagram).unwrap_or_default();
    submessages(datagram).filter_map(move |Submessage { id, flags, body, .. }| {
        let body = datagram.get(body)?;
        let writer: [u8; 4] = body.get(8..12)?.try_into().ok()?;
        let is_data = match id {
            DATA => flags & FLAG_DATA != 0,
            DATA_FRAG => flags & FLAG_FRAGMENT_KEY == 0,
            _ => false,
        };
        if !is_data || writer[3] & NOT_OF_USERS != 0 {
            return None;
        }
        let is_little = flags & FLAG_LITTLE_ENDIAN != 0;
        let mut guid = [0; 16];
        guid[..12].copy_from_slice(&participant);
        guid[12..].copy_from_slice(&writer);
        Some(Piece {
            writer: guid,
            sequence: sequence_number(body, is_little)?,
            fragments: if id == DATA { None } else { Some(fragments(body, is_little)?) },
            bytes: body.get(payload_start(body, flags)?..)?,
        })
    })
}

/// Whether a datagram carries messages of users' writers, and nothing for the middleware but times and
/// addresses.
pub(super) fn is_only_user_data(datagram: &[u8]) -> bool {
    let carries_data = |part: &Submessage| [DATA, DATA_FRAG].contains(&part.id);
    let count = submessages(datagram).filter(carries_data).count();
    count > 0 && count == pieces(datagram).count()
}

/// Two numbers of 32 bits, the higher one first; it begins with 1.
fn sequence_number(body: &[u8], is_little: bool) -> Option<i64> {
    let (high, low) = (word(body, 12, is_little)?, word(body, 16, is_little)?);
    i64::try_from(u64::from(high) << 32 | u64::from(low)).ok().filter(|number| *number > 0)
}

fn fragments(body: &[u8], is_little: bool) -> Option<Fragments> {
    Some(Fragments {
        first: word(body, 20, is_little)?.checked_sub(1)?,
        fragment_bytes: number(body, 26, is_little)?,
        message_bytes: word(body, 28, is_little)?,
    })
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in super::super) const WRITER: Guid = [9, 9, 9, 9, 9, 9, 9, 9, 9, 9, 9, 9, 0, 0, 0x12, 3];

    /// A datagram with one submessage, as Fast DDS writes it.
    fn datagram(id: u8, flags: u8, fields: &[u8], payload: &[u8]) -> Vec<u8> {
        let length = (fields.len() + payload.len()) as u16;
        [
            &b"RTPS\x02\x03\x01\x0f"[..],
            &WRITER[..12],
            &[9, 1, 8, 0, 0, 0, 0, 0, 0, 0, 0, 0],
            &[id, flags],
            &length.to_le_bytes(),
            fields,
            payload,
        ]
        .concat()
    }

    pub(in super::super) fn whole(sequence: u32, payload: &[u8]) -> Vec<u8> {
        let fields =
            [&[0, 0, 16, 0, 0, 0, 0, 0][..], &WRITER[12..], &[0; 4], &sequence.to_le_bytes()].concat();
        datagram(DATA, 5, &fields, payload)
    }

    /// Fragments from number `first` (from 1) on.
    pub(in super::super) fn fragment(
        sequence: u32,
        first: u32,
        sizes: (u16, u32),
        payload: &[u8],
    ) -> Vec<u8> {
        let fields = [
            &[0, 0, 28, 0, 0, 0, 0, 0][..],
            &WRITER[12..],
            &[0; 4],
            &sequence.to_le_bytes(),
            &first.to_le_bytes(),
            &[1, 0],
            &sizes.0.to_le_bytes(),
            &sizes.1.to_le_bytes(),
        ]
        .concat();
        datagram(DATA_FRAG, 1, &fields, payload)
    }

    #[test]
    fn messages_and_fragments_are_found_with_their_writer() {
        let datagram = whole(7, &[1, 2, 3]);
        let found: Vec<_> = pieces(&datagram).collect();
        assert_eq!(found, [Piece { writer: WRITER, sequence: 7, fragments: None, bytes: &[1, 2, 3] }]);
        assert!(is_only_user_data(&datagram));
        let datagram = fragment(8, 2, (4, 10), &[5, 6, 7, 8]);
        let fragments = Some(Fragments { first: 1, fragment_bytes: 4, message_bytes: 10 });
        let found: Vec<_> = pieces(&datagram).collect();
        assert_eq!(found, [Piece { writer: WRITER, sequence: 8, fragments, bytes: &[5, 6, 7, 8] }]);
    }

    #[test]
    fn inline_parameters_are_skipped_and_other_submessages_are_no_data() {
        let fields = [&[0, 0, 16, 0, 0, 0, 0, 0][..], &WRITER[12..], &[0; 4], &[1, 0, 0, 0]].concat();
        let parameters = [0x70, 0, 4, 0, 1, 2, 3, 4, 1, 0, 0, 0, 42];
        let with_parameters = datagram(DATA, 7, &fields, &parameters);
        assert_eq!(pieces(&with_parameters).next().unwrap().bytes, [42]);
        let disposed = datagram(DATA, 3, &fields, &parameters);
        assert_eq!(pieces(&disposed).count(), 0);
        let of_the_middleware = [&fields[..11], &[0xc2], &fields[12..]].concat();
        let announcement = datagram(DATA, 5, &of_the_middleware, &[0; 8]);
        assert!(pieces(&announcement).count() == 0 && !is_only_user_data(&announcement));
        let heartbeat = datagram(7, 1, &[0; 28], &[]);
        assert!(!is_only_user_data(&heartbeat));
    }
}
