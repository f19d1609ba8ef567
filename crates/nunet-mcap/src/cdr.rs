//! OMG's Common Data Representation, as ROS 2 writes it: four bytes that state the byte order, then the
//! message.

use byteorder::{BigEndian, LittleEndian};
use serde::{Deserialize, Serialize};

/// Plain CDR, big and little endian (OMG DDSI-RTPS 2.3, table 10.3).
const BIG_ENDIAN: [u8; 2] = [0, 0];
const LITTLE_ENDIAN: [u8; 2] = [0, 1];

/// The first bytes of zstd's data.
const ZSTD: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];
const PACKED: &str = "each message is compressed on its own (`ros2 bag record --compression-mode message`), which is not \
                      read: convert the recording with `ros2 bag convert`, or with `rosbags-convert` (`pip install rosbags`)";

/// Decodes one message; byte sequences are borrowed from it.
pub(crate) fn decode<'a, T: Deserialize<'a>>(message: &'a [u8]) -> Result<T, String> {
    let (header, body) = message.split_at_checked(4).ok_or_else(|| {
        format!("{} bytes are not a CDR message, which begins with 4 of header", message.len())
    })?;
    let decoded = match [header[0], header[1]] {
        LITTLE_ENDIAN => cdr_encoding::from_bytes::<T, LittleEndian>(body),
        BIG_ENDIAN => cdr_encoding::from_bytes::<T, BigEndian>(body),
        _ if header == ZSTD => return Err(PACKED.to_owned()),
        other => return Err(format!("encapsulation {:02x} {:02x} is not plain CDR", other[0], other[1])),
    };
    decoded.map(|(value, _)| value).map_err(|error| format!("it is cut off or of another type: {error:.200}"))
}

/// Encodes one message into `out`, which is emptied first.
pub(crate) fn encode<T: Serialize>(message: &T, out: &mut Vec<u8>) -> Result<(), String> {
    out.clear();
    out.extend([LITTLE_ENDIAN[0], LITTLE_ENDIAN[1], 0, 0]);
    cdr_encoding::to_writer::<T, LittleEndian, _>(&mut *out, message).map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::{Header, RosImage, Time};

    fn image(data: &[u8]) -> RosImage<'_> {
        RosImage {
            header: Header { stamp: Time { sec: 7, nanosec: 8 }, frame_id: "eye".into() },
            height: 1,
            width: 2,
            encoding: "mono8".into(),
            is_bigendian: 0,
            step: 2,
            data: serde_bytes::Bytes::new(data),
        }
    }

    /// Written by hand from the OMG's rules: strings end with a zero byte; alignment counts from the end of
    /// the first four bytes.
    #[test]
    fn an_image_is_laid_out_as_ros_lays_it_out() {
        let mut out = Vec::new();
        encode(&image(&[5, 6]), &mut out).unwrap();
        let expected: Vec<u8> = [
            &[0, 1, 0, 0][..],
            &[7, 0, 0, 0, 8, 0, 0, 0],
            &[4, 0, 0, 0, b'e', b'y', b'e', 0],
            &[1, 0, 0, 0, 2, 0, 0, 0],
            &[6, 0, 0, 0, b'm', b'o', b'n', b'o', b'8', 0],
            &[0, 0], // is_bigendian, padding
            &[2, 0, 0, 0],
            &[2, 0, 0, 0, 5, 6],
        ]
        .concat();
        assert_eq!(out, expected);
        assert_eq!(decode::<RosImage<'_>>(&out).unwrap(), image(&[5, 6]));
    }

    #[test]
    fn every_cut_of_a_message_is_an_error_and_never_a_panic() {
        let mut whole = Vec::new();
        encode(&image(&[1; 40]), &mut whole).unwrap();
        for length in 0..whole.len() {
            assert!(decode::<RosImage<'_>>(&whole[..length]).is_err(), "{length} bytes");
        }
    }

    #[test]
    fn big_endian_messages_are_read_and_other_encapsulations_named() {
        let little = cdr_encoding::to_vec::<_, BigEndian>(&image(&[9, 9])).unwrap();
        let message: Vec<u8> = [&[0, 0, 0, 0][..], &little].concat();
        assert_eq!(decode::<RosImage<'_>>(&message).unwrap(), image(&[9, 9]));
        let error = decode::<RosImage<'_>>(&[0, 7, 0, 0]).unwrap_err();
        assert_eq!(error, "encapsulation 00 07 is not plain CDR");
        let error = decode::<RosImage<'_>>(&[0x28, 0xb5, 0x2f, 0xfd, 0x20, 0]).unwrap_err();
        assert!(error.contains("--compression-mode message"), "{error}");
    }
}
