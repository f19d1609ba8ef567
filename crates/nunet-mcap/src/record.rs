//! Parses the kinds of records that this crate needs.
//!
//! mcap's own parser reserves memory for the length that a text states before it checks that the record has
//! as many bytes, and its errors contain a backtrace. Here a record is a slice, so no field can be longer
//! than the record.

use std::collections::BTreeMap;

use mcap::records::op;

/// One record.
#[derive(Debug)]
pub(crate) enum Record<'a> {
    Schema {
        id: u16,
        name: &'a str,
    },
    Channel {
        id: u16,
        schema_id: u16,
        topic: &'a str,
        encoding: &'a str,
    },
    Message {
        channel_id: u16,
        log_time: u64,
        data: &'a [u8],
    },
    Metadata {
        name: &'a str,
        entries: BTreeMap<&'a str, &'a str>,
    },
    /// Messages of each channel.
    Statistics {
        counts: BTreeMap<u16, u64>,
        /// Log time of the first one.
        start_nanos: u64,
    },
    /// The number of messages of a channel in the previous chunk.
    MessageIndex {
        channel_id: u16,
        messages: u64,
    },
    Other,
}

/// The error of an inconsistent record.
const CONTRADICTION: &str = "a record's fields do not fit its length";

impl<'a> Record<'a> {
    /// Parses a record's body.
    ///
    /// # Errors
    /// A body whose fields are longer than it is, or whose text is not UTF-8.
    pub(crate) fn parse(opcode: u8, body: &'a [u8]) -> Result<Self, &'static str> {
        let mut fields = Fields(body);
        let record = match opcode {
            op::SCHEMA => fields.u16().zip(fields.text()).map(|(id, name)| Self::Schema { id, name }),
            op::CHANNEL => fields.channel(),
            op::MESSAGE => fields.message(),
            op::METADATA => {
                fields.text().zip(fields.map()).map(|(name, entries)| Self::Metadata { name, entries })
            }
            op::STATISTICS => fields.statistics(),
            op::MESSAGE_INDEX => fields.message_index(),
            _ => Some(Self::Other),
        };
        record.ok_or(CONTRADICTION)
    }
}

/// Little-endian integers of eight bytes.
pub(crate) struct U64;

impl U64 {
    pub(crate) fn at(bytes: &[u8], place: usize) -> Option<u64> {
        bytes.get(place..place + 8)?.try_into().ok().map(u64::from_le_bytes)
    }
}

/// The remaining bytes of a record.
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(taken)
    }

    fn u16(&mut self) -> Option<u16> {
        self.take(2)?.try_into().ok().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        self.take(4)?.try_into().ok().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Option<u64> {
        self.take(8)?.try_into().ok().map(u64::from_le_bytes)
    }

    /// Bytes with their count before them.
    fn counted(&mut self) -> Option<&'a [u8]> {
        let count = self.u32()?;
        self.take(count as usize)
    }

    fn text(&mut self) -> Option<&'a str> {
        std::str::from_utf8(self.counted()?).ok()
    }

    fn map(&mut self) -> Option<BTreeMap<&'a str, &'a str>> {
        let (mut entries, mut map) = (Fields(self.counted()?), BTreeMap::new());
        while !entries.0.is_empty() {
            map.insert(entries.text()?, entries.text()?);
        }
        Some(map)
    }

    fn channel(&mut self) -> Option<Record<'a>> {
        let (id, schema_id) = (self.u16()?, self.u16()?);
        Some(Record::Channel { id, schema_id, topic: self.text()?, encoding: self.text()? })
    }

    /// Channel, sequence, log time, publish time, then the message.
    fn message(&mut self) -> Option<Record<'a>> {
        let (channel_id, _sequence, log_time, _publish_time) =
            (self.u16()?, self.u32()?, self.u64()?, self.u64()?);
        Some(Record::Message { channel_id, log_time, data: self.0 })
    }

    /// Message count, schemas, channels, attachments, metadata, chunks, first and last time, then the counts.
    fn statistics(&mut self) -> Option<Record<'a>> {
        self.take(8 + 2 + 4 + 4 + 4 + 4)?;
        let (start_nanos, _end_nanos) = (self.u64()?, self.u64()?);
        let (mut entries, mut counts) = (Fields(self.counted()?), BTreeMap::new());
        while !entries.0.is_empty() {
            counts.insert(entries.u16()?, entries.u64()?);
        }
        Some(Record::Statistics { counts, start_nanos })
    }

    /// Channel, then log time and place of each message.
    fn message_index(&mut self) -> Option<Record<'a>> {
        let (channel_id, entries) = (self.u16()?, self.counted()?);
        Some(Record::MessageIndex { channel_id, messages: (entries.len() / (8 + 8)) as u64 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A channel of the topic `/a` in CDR without metadata, as the MCAP specification lays it out.
    const CHANNEL: &[u8] = b"\x03\0\x07\0\x02\0\0\0/a\x03\0\0\0cdr\0\0\0\0";

    #[test]
    fn a_channel_is_read_as_the_specification_lays_it_out() {
        let record = Record::parse(op::CHANNEL, CHANNEL).unwrap();
        assert!(
            matches!(record, Record::Channel { id: 3, schema_id: 7, topic: "/a", encoding: "cdr" }),
            "{record:?}"
        );
    }

    #[test]
    fn a_text_longer_than_its_record_is_an_error_whatever_length_it_states() {
        for bit in 0..32 {
            let mut record = CHANNEL.to_vec();
            record[4 + bit / 8] ^= 1 << (bit % 8);
            // A topic that is one or two bytes shorter shifts the encoding: still within the record, or an
            // error.
            let parsed = Record::parse(op::CHANNEL, &record);
            assert!(bit < 5 || parsed.is_err(), "bit {bit}: {parsed:?}");
        }
    }

    #[test]
    fn metadata_and_counts_are_read() {
        let metadata = b"\x01\0\0\0n\x0a\0\0\0\x01\0\0\0k\x01\0\0\0v";
        let Ok(Record::Metadata { name, entries }) = Record::parse(op::METADATA, metadata) else { panic!() };
        assert_eq!((name, entries["k"]), ("n", "v"));
        let mut statistics = vec![0; 42];
        statistics.extend(b"\x0a\0\0\0\x05\0\x09\0\0\0\0\0\0\0");
        let Ok(Record::Statistics { counts, start_nanos: 0 }) = Record::parse(op::STATISTICS, &statistics)
        else {
            panic!()
        };
        assert_eq!(counts, BTreeMap::from([(5, 9)]));
    }
}
