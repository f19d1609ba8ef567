//! The publishers of a topic, as other sessions state them.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use zenoh::pubsub::Subscriber as ZenohSubscriber;
use zenoh::sample::SampleKind;
use zenoh::{Session, Wait as _};

use super::keys;

/// Further publishers of a topic are ignored.
const MAX_PUBLISHERS: usize = 1000;

/// The types of publishers by their tokens.
type Types = BTreeMap<String, String>;

/// The publishers of a topic. They are followed until it is dropped.
pub(super) struct RemotePublishers {
    types: Arc<Mutex<Types>>,
    _tokens: ZenohSubscriber<()>,
}

impl RemotePublishers {
    /// Follows the publishers of a topic in sessions other than this one.
    pub(super) fn follow(session: &Session, domain: u16, topic: &str) -> zenoh::Result<Self> {
        let (types, own) = (Arc::<Mutex<Types>>::default(), session.zid().to_string());
        let known = Arc::clone(&types);
        let tokens = session.liveliness().declare_subscriber(keys::publishers_of(domain, topic));
        let tokens = tokens.history(true).callback(move |sample| {
            let token = sample.key_expr().as_str();
            update(&mut lock(&known), token, sample.kind(), &own);
        });
        Ok(Self { types, _tokens: tokens.wait()? })
    }

    /// Their types, each once.
    pub(super) fn types(&self) -> Vec<String> {
        let mut types: Vec<_> = lock(&self.types).values().cloned().collect();
        types.sort();
        types.dedup();
        types
    }

    /// How many have this type.
    pub(super) fn count(&self, type_name: &str) -> usize {
        lock(&self.types).values().filter(|known| *known == type_name).count()
    }
}

fn update(types: &mut Types, token: &str, kind: SampleKind, own: &str) {
    if kind == SampleKind::Delete {
        types.remove(token);
        return;
    }
    let publisher = keys::publisher_of(token).filter(|(session, _)| *session != own);
    if let Some((_, type_name)) = publisher
        && types.len() < MAX_PUBLISHERS
    {
        types.insert(token.to_owned(), type_name);
    }
}

fn lock(types: &Mutex<Types>) -> MutexGuard<'_, Types> {
    types.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn publishers_come_and_go_and_are_limited() {
        let token = |session: &str, id: usize| {
            format!("@ros2_lv/0/{session}/0/{id}/MP/%/%/camera/%image/sensor_msgs::msg::dds_::Image_/h/q")
        };
        let mut types = Types::new();
        update(&mut types, &token("own", 1), SampleKind::Put, "own");
        update(&mut types, "@ros2_lv/0", SampleKind::Put, "own");
        assert!(types.is_empty());
        for id in 0..MAX_PUBLISHERS + 5 {
            update(&mut types, &token("other", id), SampleKind::Put, "own");
        }
        assert_eq!(types.len(), MAX_PUBLISHERS);
        assert_eq!(types.values().next().unwrap(), "sensor_msgs/msg/Image");
        update(&mut types, &token("other", 3), SampleKind::Delete, "own");
        assert_eq!(types.len(), MAX_PUBLISHERS - 1);
    }
}
