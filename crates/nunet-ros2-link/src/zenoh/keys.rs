//! The names that `rmw_zenoh` gives to topics, nodes, publishers and subscribers, as its document `design.md`
//! describes them.
//!
//! - A topic is a key expression: `DOMAIN/TOPIC/TYPE/HASH`.
//! - A node, a publisher or a subscriber is a liveliness token:
//!   `@ros2_lv/DOMAIN/SESSION/NODE/ENTITY/KIND/ENCLAVE/NAMESPACE/NAME`, and for the last two
//!   `/TOPIC/TYPE/HASH/QOS`. Slashes within a part are written as `%`.

use crate::link::{Delivery, Endpoint};
use crate::name::{dds_type, ros_type};

/// The first part of all tokens.
const TOKENS: &str = "@ros2_lv";
/// The root namespace and the root enclave.
const ROOT: &str = "%";
/// Where the type is in the token of a publisher.
const TYPE_PART: usize = 10;
/// Where the session is.
const SESSION_PART: usize = 2;

/// A topic with its type.
#[derive(Debug, Clone)]
pub(super) struct TopicKey {
    /// The full name, such as `/front/scan`.
    name: String,
    /// The type as DDS names it, such as `sensor_msgs::msg::dds_::Image_`.
    type_name: String,
    hash: &'static str,
}

impl From<&Endpoint<'_>> for TopicKey {
    fn from(endpoint: &Endpoint<'_>) -> Self {
        let Endpoint { topic, message_type } = *endpoint;
        let type_name = dds_type(message_type.name());
        Self { name: topic.to_owned(), type_name, hash: message_type.hash() }
    }
}

impl TopicKey {
    /// The key expression that its messages are published under.
    pub(super) fn key(&self, domain: u16) -> String {
        self.key_of_hash(domain, self.hash)
    }

    /// The key expression of messages whose type has any hash. Distributions have different hashes for types
    /// that differ in comments or default values only.
    pub(super) fn key_of_any_hash(&self, domain: u16) -> String {
        self.key_of_hash(domain, "*")
    }

    fn key_of_hash(&self, domain: u16, hash: &str) -> String {
        let Self { name, type_name, .. } = self;
        format!("{domain}/{}/{type_name}/{hash}", name.trim_matches('/'))
    }
}

/// A node, publisher or subscriber of a session. Identifiers count up within the session.
#[derive(Debug, Clone, Copy)]
pub(super) struct Entity<'a> {
    pub(super) domain: u16,
    pub(super) session: &'a str,
    pub(super) node: &'a str,
    pub(super) node_id: u64,
    pub(super) id: u64,
}

impl Entity<'_> {
    /// The token of a node.
    pub(super) fn node_token(&self) -> String {
        self.token("NN")
    }

    /// The token of a publisher.
    pub(super) fn publisher_token(&self, topic: &TopicKey, delivery: Delivery) -> String {
        // Reliable, keep last: the defaults, which are omitted. 1 is transient local.
        let durability = if delivery.is_kept { "1" } else { "" };
        self.endpoint_token("MP", topic, &format!(":{durability}:,{}:,:,:,,", delivery.depth))
    }

    /// The token of a subscriber: best effort, keep last 1.
    pub(super) fn subscriber_token(&self, topic: &TopicKey) -> String {
        self.endpoint_token("MS", topic, "2::,1:,:,:,,")
    }

    fn endpoint_token(&self, kind: &str, topic: &TopicKey, qos: &str) -> String {
        let TopicKey { name, type_name, hash } = topic;
        format!("{}/{}/{type_name}/{hash}/{qos}", self.token(kind), mangled(name))
    }

    fn token(&self, kind: &str) -> String {
        let Self { domain, session, node, node_id, id } = self;
        format!("{TOKENS}/{domain}/{session}/{node_id}/{id}/{kind}/{ROOT}/{ROOT}/{node}")
    }
}

/// The tokens of all publishers of a topic, whatever its type is.
pub(super) fn publishers_of(domain: u16, topic: &str) -> String {
    format!("{TOKENS}/{domain}/*/*/*/MP/*/*/*/{}/*/*/*", mangled(topic))
}

/// The session and the type that the token of a publisher states, such as `sensor_msgs/msg/Image`.
pub(super) fn publisher_of(token: &str) -> Option<(&str, String)> {
    let session = token.split('/').nth(SESSION_PART)?;
    let type_name = token.split('/').nth(TYPE_PART)?;
    Some((session, ros_type(&type_name.replace('%', "/"))))
}

fn mangled(name: &str) -> String {
    name.replace('/', "%")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message_type::MessageType;

    const HASH: &str = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18";

    fn chatter() -> TopicKey {
        let type_name = dds_type("std_msgs/msg/String");
        TopicKey { name: "/chatter".to_owned(), type_name, hash: HASH }
    }

    /// The examples of `rmw_zenoh`'s `design.md`.
    #[test]
    fn names_are_those_of_the_documented_examples() {
        let topic = chatter();
        assert_eq!(topic.key(0), format!("0/chatter/std_msgs::msg::dds_::String_/{HASH}"));
        let listener = Entity {
            domain: 2,
            session: "aac3178e146ba6f1fc6e6a4085e77f21",
            node: "listener",
            node_id: 0,
            id: 0,
        };
        assert_eq!(listener.node_token(), "@ros2_lv/2/aac3178e146ba6f1fc6e6a4085e77f21/0/0/NN/%/%/listener");
        let talker =
            Entity { session: "8b20917502ee955ac4476e0266340d5c", node: "talker", id: 10, ..listener };
        assert_eq!(
            talker.publisher_token(&topic, Delivery { depth: 7, is_kept: false }),
            format!(
                "@ros2_lv/2/8b20917502ee955ac4476e0266340d5c/0/10/MP/%/%/talker/%chatter/\
                 std_msgs::msg::dds_::String_/{HASH}/::,7:,:,:,,"
            )
        );
    }

    #[test]
    fn quality_of_service_differs_from_the_defaults_where_stated() {
        let endpoint = Endpoint { topic: "/front/depth/image_raw", message_type: MessageType::Image };
        let topic = TopicKey::from(&endpoint);
        let entity = Entity { domain: 0, session: "a1", node: "nunetd_front", node_id: 0, id: 3 };
        let kept = entity.publisher_token(&topic, Delivery { depth: 1, is_kept: true });
        assert!(kept.ends_with("/:1:,1:,:,:,,"), "{kept}");
        let subscriber = entity.subscriber_token(&topic);
        assert!(subscriber.contains("/0/3/MS/%/%/nunetd_front/%front%depth%image_raw/"), "{subscriber}");
        assert!(subscriber.ends_with("/2::,1:,:,:,,"), "{subscriber}");
        let key = topic.key_of_any_hash(0);
        assert_eq!(key, "0/front/depth/image_raw/sensor_msgs::msg::dds_::Image_/*");
    }

    #[test]
    fn tokens_of_publishers_are_found_and_read() {
        use zenoh::key_expr::KeyExpr;
        let entity = Entity { domain: 2, session: "a1", node: "talker", node_id: 0, id: 1 };
        let token = entity.publisher_token(&chatter(), Delivery { depth: 7, is_kept: false });
        let is_found = |topic| {
            let wanted = KeyExpr::try_from(publishers_of(2, topic)).unwrap();
            wanted.intersects(&KeyExpr::try_from(token.clone()).unwrap())
        };
        assert!(is_found("/chatter") && !is_found("/chat"));
        assert_eq!(publisher_of(&token), Some(("a1", "std_msgs/msg/String".to_owned())));
        for token in ["", "@ros2_lv/0/a1", "a/b/c/d/e/f/g/h/i/j"] {
            assert_eq!(publisher_of(token), None);
        }
    }
}
