//! The connections to ROS 2 that all cameras share.

use std::collections::BTreeSet;
use std::sync::Arc;

use nunet_ros2_link::{Endpoint, Link, Ros2Error, connect};
use nunet_sink::sink::Sink;
use tracing::{info, warn};

use crate::camera::CameraThread;
use crate::options::{Available, CameraOptions, Ros2Options, Topics, check_camera_name};
use crate::publishers::{Connections, OutputName, TopicPublishers};
use crate::topic::Topic;

/// Connections to ROS 2. They end with it.
pub struct Ros2Node {
    links: Vec<Arc<dyn Link>>,
    options: Ros2Options,
    output: OutputName,
}

impl Ros2Node {
    /// Connects by all transports of `options`.
    ///
    /// # Errors
    /// A variable of the environment is wrong, or the network cannot be used.
    pub fn open(options: &Ros2Options) -> Result<Self, Ros2Error> {
        let links = options.links.iter().map(|name| connect(name, &name.environment()?));
        let links = distinct(links.collect::<Result<_, _>>()?);
        Ok(Self { links, options: options.clone(), output: OutputName::ROS_2 })
    }

    /// Sends the messages of cameras over another transport, as the output `output`.
    #[must_use]
    pub fn over(link: Arc<dyn Link>, output: OutputName, topics: Topics) -> Self {
        Self { links: vec![link], options: Ros2Options { topics, ..Ros2Options::default() }, output }
    }

    /// Publishes the topics of a camera.
    ///
    /// # Errors
    /// The camera does not have a topic that was asked for, or its name cannot be part of a topic.
    pub fn add_camera(&self, camera: &CameraOptions<'_>) -> Result<Box<dyn Sink>, Ros2Error> {
        if self.output == OutputName::ROS_2 {
            check_camera_name(camera.name)?;
        }
        let topics = self.topics(camera)?;
        let mut outputs = TopicPublishers::default();
        let node = format!("nunetd_{}", camera.name);
        for topic in topics.iter().copied() {
            let name = topic.of_camera(camera.name);
            let endpoint = Endpoint { topic: &name, message_type: topic.message_type() };
            let publishers = self.links.iter().map(|link| link.publisher(&node, &endpoint, topic.delivery()));
            outputs.add(topic, publishers.collect::<Result<_, _>>()?);
        }
        info!("{} topics: {}", self.output.text, listed(&topics, camera.name));
        let unannounced = self.announce(camera.name);
        let connections = Connections { output: self.output, links: self.links.clone(), unannounced };
        Ok(Box::new(CameraThread::start(camera, self.options.depth, outputs, connections)?))
    }

    /// Announces the node of `camera`. Returns the connections that could not: topics work without it, and a
    /// node that has not confirmed the last announcement yet may hold back the next.
    fn announce(&self, camera: &str) -> Vec<Arc<dyn Link>> {
        let failed = self.links.iter().filter(|link| {
            let announced = link.announce_nodes();
            announced.inspect_err(|error| warn!("camera `{camera}`: {error}, will try again")).is_err()
        });
        failed.cloned().collect()
    }

    fn topics(&self, camera: &CameraOptions<'_>) -> Result<BTreeSet<Topic>, Ros2Error> {
        let available = Available {
            labels: camera.has_labels,
            confidence: camera.has_confidence,
            obstacles: camera.has_obstacles,
        };
        let mut topics = self.options.topics.of_camera(available)?;
        if camera.mount.is_none() {
            topics.remove(&Topic::TfStatic);
        }
        Ok(topics)
    }
}

/// Each connection once, because a second one would publish each message twice. Two names may be one
/// connection: `dds` and `dds:0`, `zenoh` and `zenoh:tcp/localhost:7447`.
pub(crate) fn distinct(links: Vec<Arc<dyn Link>>) -> Vec<Arc<dyn Link>> {
    let mut distinct: Vec<Arc<dyn Link>> = Vec::new();
    for link in links {
        if !distinct.iter().any(|known| Arc::ptr_eq(known, &link)) {
            distinct.push(link);
        }
    }
    distinct
}

fn listed(topics: &BTreeSet<Topic>, camera: &str) -> String {
    let names: Vec<_> = topics.iter().map(|topic| topic.of_camera(camera)).collect();
    names.join(" ")
}
