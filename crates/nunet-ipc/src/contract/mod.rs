//! The bytes of a message, and the whole contract as tables.
//!
//! `nunetd contract --json` prints these tables, and bindings for other languages are checked against them.
//! They are taken from the types themselves: offsets from `offset_of!`, numbers from the enumerations.

mod attitude;
mod block;
mod header;
mod obstacles;
mod stats;
mod text;

use nunet_types::layout::{Field, FieldType};
use nunet_types::{
    Clock, CloudPoint, DistortionModel, Encoding, ObstaclePoint, ObstacleSector, Quality, ScaleSource,
    SectorState, Topic, Units, Wake,
};

pub use attitude::{ATTITUDE_TYPE_NAME, AttitudeRecord, AttitudeSample, MAX_ATTITUDE_SAMPLES};
pub use block::{BLOCK_BYTES, BLOCK_TYPE_NAME, Block64, blocks_for};
pub use header::{CONTRACT_VERSION, FrameHeader, HEADER_TYPE_NAME, MAX_COEFFICIENTS, MAX_STAGES};
pub use obstacles::{OBSTACLES_TYPE_NAME, ObstacleRecord};
pub use stats::{STAGE_NAME_BYTES, STATS_TYPE_NAME, StatsRecord};

/// The attribute that every service of this contract carries.
pub const CONTRACT_ATTRIBUTE: &str = "nunet.contract";

/// A struct of the contract.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StructLayout {
    /// The name of the type in other languages (iceoryx2's type name, if there is one).
    pub type_name: &'static str,
    /// Its size.
    pub bytes: usize,
    /// Its alignment.
    pub alignment: usize,
    /// Its fields; none for a block, which is bytes.
    pub fields: &'static [Field],
}

/// The user header of every message.
pub const HEADER: StructLayout = StructLayout {
    type_name: HEADER_TYPE_NAME,
    bytes: size_of::<FrameHeader>(),
    alignment: align_of::<FrameHeader>(),
    fields: FrameHeader::FIELDS,
};

/// The element of every payload's slice.
pub const BLOCK: StructLayout =
    StructLayout { type_name: BLOCK_TYPE_NAME, bytes: BLOCK_BYTES, alignment: BLOCK_BYTES, fields: &[] };

/// The payload of `stats`.
pub const STATS: StructLayout = StructLayout {
    type_name: STATS_TYPE_NAME,
    bytes: size_of::<StatsRecord>(),
    alignment: align_of::<StatsRecord>(),
    fields: StatsRecord::FIELDS,
};

/// The payload of `cloud`: one per pixel.
pub const POINT: StructLayout = StructLayout {
    type_name: "nunet.v1.Point",
    bytes: size_of::<CloudPoint>(),
    alignment: align_of::<CloudPoint>(),
    fields: CloudPoint::FIELDS,
};

/// The payload of `obstacles`.
pub const OBSTACLES: StructLayout = StructLayout {
    type_name: OBSTACLES_TYPE_NAME,
    bytes: size_of::<ObstacleRecord>(),
    alignment: align_of::<ObstacleRecord>(),
    fields: ObstacleRecord::FIELDS,
};

/// One direction of an obstacle record.
pub const OBSTACLE_SECTOR: StructLayout = StructLayout {
    type_name: <ObstacleSector as FieldType>::KIND,
    bytes: size_of::<ObstacleSector>(),
    alignment: align_of::<ObstacleSector>(),
    fields: ObstacleSector::FIELDS,
};

/// One point of an obstacle record.
pub const OBSTACLE_POINT: StructLayout = StructLayout {
    type_name: <ObstaclePoint as FieldType>::KIND,
    bytes: size_of::<ObstaclePoint>(),
    alignment: align_of::<ObstaclePoint>(),
    fields: ObstaclePoint::FIELDS,
};

/// The payload of `attitude`.
pub const ATTITUDE: StructLayout = StructLayout {
    type_name: ATTITUDE_TYPE_NAME,
    bytes: size_of::<AttitudeRecord>(),
    alignment: align_of::<AttitudeRecord>(),
    fields: AttitudeRecord::FIELDS,
};

/// One sample of an attitude record.
pub const ATTITUDE_SAMPLE: StructLayout = StructLayout {
    type_name: <AttitudeSample as FieldType>::KIND,
    bytes: size_of::<AttitudeSample>(),
    alignment: align_of::<AttitudeSample>(),
    fields: AttitudeSample::FIELDS,
};

/// An enumeration's name, and its words with their numbers.
pub type Enumeration = (&'static str, &'static [(&'static str, u32)]);

/// Every enumeration of the header, the ids of wake-up events, and the states of sectors.
pub const ENUMS: &[Enumeration] = &[
    (Topic::FIELD, Topic::NUMBERS),
    (Encoding::FIELD, Encoding::NUMBERS),
    (Units::FIELD, Units::NUMBERS),
    (ScaleSource::FIELD, ScaleSource::NUMBERS),
    (Clock::FIELD, Clock::NUMBERS),
    (DistortionModel::FIELD, DistortionModel::NUMBERS),
    (Quality::FIELD, Quality::NUMBERS),
    (Wake::FIELD, Wake::NUMBERS),
    (SectorState::FIELD, SectorState::NUMBERS),
];

/// The descriptions of the values of [`ENUMS`], in the same order, for headers and documents in other
/// languages.
pub const ENUM_DOCS: &[&[&str]] = &[
    Topic::DOCS,
    Encoding::DOCS,
    Units::DOCS,
    ScaleSource::DOCS,
    Clock::DOCS,
    DistortionModel::DOCS,
    Quality::DOCS,
    Wake::DOCS,
    SectorState::DOCS,
];

/// Every service; `CAMERA` is the camera's name. All are publish-subscribe services, except `wake`, which is
/// an event service.
pub const SERVICES: &[&str] = &[
    "nunet/CAMERA/rgb",
    "nunet/CAMERA/depth",
    "nunet/CAMERA/labels",
    "nunet/CAMERA/cloud",
    "nunet/CAMERA/obstacles",
    "nunet/CAMERA/stats",
    "nunet/CAMERA/confidence",
    "nunet/CAMERA/attitude",
    "nunet/CAMERA/wake",
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::name::CameraName;

    #[test]
    fn the_services_are_those_that_the_code_opens() {
        let camera = CameraName::new("CAMERA").unwrap();
        let topics = Topic::ALL.iter().map(|topic| camera.service(*topic));
        let opened: Vec<_> = topics.chain([camera.wake_service()]).collect();
        assert_eq!(opened, SERVICES);
    }

    #[test]
    fn every_word_and_every_field_has_a_description() {
        assert_eq!(ENUMS.len(), ENUM_DOCS.len());
        for ((name, words), docs) in ENUMS.iter().zip(ENUM_DOCS) {
            assert_eq!(words.len(), docs.len(), "{name}");
            assert!(docs.iter().all(|doc| doc.trim_end().ends_with('.')), "{name}: {docs:?}");
        }
        assert_eq!(
            ENUM_DOCS[0][Topic::Labels as usize],
            " The class of each pixel: `[height, width]`, `u8`.\n"
        );
        let records = [HEADER, STATS, POINT, OBSTACLES, OBSTACLE_SECTOR, OBSTACLE_POINT];
        for layout in records.into_iter().chain([ATTITUDE, ATTITUDE_SAMPLE]) {
            assert!(layout.fields.iter().all(|field| field.doc.trim_end().ends_with('.')), "{layout:?}");
        }
    }

    #[test]
    fn every_word_of_the_header_is_an_enumeration_of_its_field() {
        let fields =
            ["topic", "encoding", "units", "scale_source", "capture_clock", "distortion_model", "quality"];
        for field in fields {
            assert!(HEADER.fields.iter().any(|found| found.name == field && found.kind == "u32"), "{field}");
            assert!(ENUMS.iter().any(|(name, _)| *name == field), "{field}");
        }
    }
}
