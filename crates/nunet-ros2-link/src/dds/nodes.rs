//! Which node of ROS 2 has which publishers and subscribers: DDS knows participants only.

use std::collections::BTreeMap;

use nunet_mcap::ros::encode;
use serde::Serialize;

/// The topic by which ROS 2 learns which node has which publishers and subscribers.
pub(super) const TOPIC: &str = "ros_discovery_info";
pub(super) const TYPE: &str = "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_";
pub(super) const TYPE_HASH: &str = "RIHS01_91a0593bacdcc50ea9bdcf849a938b128412cc1ea821245c663bcd26f83c295e";

/// Identifies a participant, a writer or a reader.
pub(super) type Identifier = [u8; 16];

/// The nodes of this process, by their names.
#[derive(Debug, Default)]
pub(super) struct Nodes(BTreeMap<String, Entities>);

#[derive(Debug, Default)]
struct Entities {
    readers: Vec<Identifier>,
    writers: Vec<Identifier>,
}

impl Nodes {
    pub(super) fn add_writer(&mut self, node: &str, writer: Identifier) {
        self.0.entry(node.to_owned()).or_default().writers.push(writer);
    }

    pub(super) fn add_reader(&mut self, node: &str, reader: Identifier) {
        self.0.entry(node.to_owned()).or_default().readers.push(reader);
    }

    /// A node without any subscribers and publishers stays: it waits for a topic.
    pub(super) fn remove_reader(&mut self, reader: Identifier) {
        self.0.values_mut().for_each(|node| node.readers.retain(|own| *own != reader));
    }

    /// The message that announces them.
    pub(super) fn message(&self, participant: Identifier) -> Result<Vec<u8>, String> {
        let nodes = self.0.iter().map(|(name, Entities { readers, writers })| NodeEntities {
            namespace: "/",
            name,
            readers,
            writers,
        });
        let mut message = Vec::new();
        encode(&ParticipantEntities { participant, nodes: nodes.collect() }, &mut message)?;
        Ok(message)
    }
}

/// `rmw_dds_common/msg/ParticipantEntitiesInfo`
#[derive(Debug, Serialize)]
struct ParticipantEntities<'a> {
    participant: Identifier,
    nodes: Vec<NodeEntities<'a>>,
}

/// `rmw_dds_common/msg/NodeEntitiesInfo`
#[derive(Debug, Serialize)]
struct NodeEntities<'a> {
    namespace: &'static str,
    name: &'a str,
    readers: &'a [Identifier],
    writers: &'a [Identifier],
}
