//! What is sent beside each message: its number, its time and its publisher.

use zenoh::bytes::ZBytes;
use zenoh_ext::z_serialize;

/// Identifies a publisher.
pub(super) type Gid = [u8; 16];

/// What a message says of its origin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Origin {
    /// The publisher counts its messages from 1.
    pub(super) sequence: i64,
    pub(super) publisher: Gid,
}

/// The attachment of a message, 33 bytes: number, time, the length of the identifier, the identifier.
/// `rmw_zenoh` of distributions after Kilted omits the length, and reads attachments that have it.
pub(super) fn write(origin: Origin, unix_nanos: i64) -> ZBytes {
    z_serialize(&(origin.sequence, unix_nanos, origin.publisher))
}

/// The origin that an attachment states, with or without the length of the identifier.
pub(super) fn read(attachment: &[u8]) -> Option<Origin> {
    let (length, gid) = attachment.get(16..)?.split_last_chunk()?;
    let sequence = i64::from_le_bytes(*attachment.first_chunk()?);
    let is_known = length.is_empty() || *length == [16];
    is_known.then_some(Origin { sequence, publisher: *gid })
}

#[cfg(test)]
mod tests {
    use super::*;

    const ORIGIN: Origin = Origin { sequence: 0x0102, publisher: [7; 16] };

    #[test]
    fn an_attachment_has_the_bytes_of_rmw_zenoh() {
        let bytes = write(ORIGIN, 3);
        let expected = [&[2, 1, 0, 0, 0, 0, 0, 0, 3, 0, 0, 0, 0, 0, 0, 0, 16][..], &[7; 16]].concat();
        assert_eq!(*bytes.to_bytes(), *expected);
    }

    #[test]
    fn both_forms_are_read_and_others_are_ignored() {
        let long = write(ORIGIN, 3).to_bytes().into_owned();
        assert_eq!(read(&long), Some(ORIGIN));
        let short = [&long[..16], &long[17..]].concat();
        assert_eq!(read(&short), Some(ORIGIN));
        for bytes in [&[][..], &[1; 33], &[0; 34], &[0; 31], &[0; 8]] {
            assert_eq!(read(bytes), None);
        }
    }
}
