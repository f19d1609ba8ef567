//! The publishers of a camera, and the connections that they belong to.

use std::sync::Arc;

use nunet_ros2_link::{Link, MessagePublisher};

use crate::topic::Topic;

/// The publishers of a camera.
#[derive(Default)]
pub(crate) struct TopicPublishers(Vec<(Topic, Vec<Box<dyn MessagePublisher>>)>);

impl TopicPublishers {
    pub(crate) fn add(&mut self, topic: Topic, publishers: Vec<Box<dyn MessagePublisher>>) {
        self.0.push((topic, publishers));
    }

    /// All topics with their publishers, one for each connection.
    pub(crate) fn iter(&self) -> impl Iterator<Item = &(Topic, Vec<Box<dyn MessagePublisher>>)> {
        self.0.iter()
    }

    /// The publishers of a topic, one for each connection; none if the camera does not have it.
    pub(crate) fn of(&self, topic: Topic) -> &[Box<dyn MessagePublisher>] {
        let found = self.iter().find(|(own, _)| *own == topic);
        found.map_or(&[][..], |(_, publishers)| publishers.as_slice())
    }

    /// The topics that something subscribes to, as bits.
    pub(crate) fn wanted(&self) -> u32 {
        let is_wanted =
            |publishers: &[Box<dyn MessagePublisher>]| publishers.iter().any(|one| one.subscribers() > 0);
        self.0.iter().filter(|(_, publishers)| is_wanted(publishers)).map(|(topic, _)| bit(*topic)).sum()
    }
}

/// A topic in a set of topics.
pub(crate) const fn bit(topic: Topic) -> u32 {
    1 << topic as u32
}

/// Topics whose messages are not made of frames.
pub(crate) const WITHOUT_FRAME: u32 = bit(Topic::LabelInfo) | bit(Topic::TfStatic) | bit(Topic::Diagnostics);
/// Topics that are made of depth.
pub(crate) const WITH_DEPTH: u32 = bit(Topic::Depth) | bit(Topic::HalfDepth);
/// Topics that are made of obstacles.
pub(crate) const WITH_OBSTACLES: u32 = bit(Topic::ObstaclePoints) | bit(Topic::Scan);

/// The names of an output that sends the messages of topics.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct OutputName {
    /// In log lines.
    pub text: &'static str,
    /// Of its counts in metrics and `stats.json`, and of its threads.
    pub id: &'static str,
}

impl OutputName {
    /// ROS 2, over DDS and Zenoh.
    pub const ROS_2: Self = Self { text: "ROS 2", id: "ros2" };
}

/// The connections of a camera.
#[derive(Default)]
pub(crate) struct Connections {
    pub(crate) output: OutputName,
    pub(crate) links: Vec<Arc<dyn Link>>,
    /// Those that have not announced the camera's node yet.
    pub(crate) unannounced: Vec<Arc<dyn Link>>,
}
