//! Messages that recordings do not have.

use nunet_mcap::ros::{Header, Time};
use serde::Serialize;

/// `vision_msgs/msg/LabelInfo`
#[derive(Debug, Serialize)]
pub(crate) struct LabelInfo<'a> {
    header: Header<'a>,
    class_map: Vec<VisionClass<'a>>,
    threshold: f32,
}

/// `vision_msgs/msg/VisionClass`
#[derive(Debug, Serialize)]
struct VisionClass<'a> {
    class_id: u16,
    class_name: &'a str,
}

impl<'a> LabelInfo<'a> {
    /// The classes in the order of their indices.
    pub(crate) fn new(header: Header<'a>, classes: &'a [String]) -> Self {
        let classes = (0..=u16::MAX).zip(classes);
        let class_map = classes.map(|(class_id, class_name)| VisionClass { class_id, class_name }).collect();
        Self { header, class_map, threshold: 0.0 }
    }
}

/// `diagnostic_msgs/msg/DiagnosticArray`
#[derive(Debug, Serialize)]
pub(crate) struct DiagnosticArray<'a> {
    pub(crate) header: Header<'a>,
    pub(crate) status: Vec<DiagnosticStatus<'a>>,
}

/// `diagnostic_msgs/msg/DiagnosticStatus`
#[derive(Debug, Serialize)]
pub(crate) struct DiagnosticStatus<'a> {
    pub(crate) level: u8,
    pub(crate) name: String,
    pub(crate) message: String,
    pub(crate) hardware_id: &'a str,
    pub(crate) values: Vec<KeyValue>,
}

impl DiagnosticStatus<'_> {
    pub(crate) const OK: u8 = 0;
    pub(crate) const WARN: u8 = 1;
    pub(crate) const STALE: u8 = 3;

    /// The level of a stream and its reason; `problems` are those of its connections.
    pub(crate) fn of_stream(is_up: bool, is_unstable: bool, mut problems: Vec<String>) -> (u8, String) {
        if !is_up {
            return (Self::STALE, "the source gives no frames".to_owned());
        }
        if is_unstable {
            problems.push("depth is unstable although the image does not change".to_owned());
        }
        if problems.is_empty() {
            return (Self::OK, "frames arrive".to_owned());
        }
        (Self::WARN, problems.join("; "))
    }
}

/// `diagnostic_msgs/msg/KeyValue`
#[derive(Debug, Serialize)]
pub(crate) struct KeyValue {
    pub(crate) key: &'static str,
    pub(crate) value: String,
}

/// The header of messages that belong to no coordinate frame.
pub(crate) fn header_now() -> Header<'static> {
    let since_1970 = std::time::SystemTime::UNIX_EPOCH.elapsed().unwrap_or_default();
    let nanos = i64::try_from(since_1970.as_nanos()).unwrap_or(i64::MAX);
    Header { stamp: Time::from_unix_nanos(nanos), frame_id: "".into() }
}
