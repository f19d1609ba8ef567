//! What the user can choose.

use std::collections::BTreeSet;
use std::str::FromStr;

use nunet_mcap::CameraMount;
use nunet_ros2_link::name::is_valid_part;
use nunet_ros2_link::{LinkName, Ros2Error, check};
use nunet_telemetry::MessageCounts;

use crate::topic::Topic;

/// How depth is encoded in images.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum DepthFormat {
    /// `32FC1`: meters, NaN = no measurement.
    #[default]
    Meters,
    /// `16UC1`: millimeters, 0 = no measurement. Depth beyond 65.535 m has none.
    Millimeters,
}

impl FromStr for DepthFormat {
    type Err = Ros2Error;

    fn from_str(text: &str) -> Result<Self, Ros2Error> {
        match text {
            "32FC1" => Ok(Self::Meters),
            "16UC1" => Ok(Self::Millimeters),
            _ => Err(unknown("encoding of depth", text, "32FC1 or 16UC1")),
        }
    }
}

fn unknown(what: &'static str, value: &str, expected: impl Into<String>) -> Ros2Error {
    Ros2Error::Unknown { what, value: value.to_owned(), expected: expected.into() }
}

/// The topics of a camera.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub enum Topics {
    /// Those that fit into ordinary networks, as far as the camera has them.
    #[default]
    Default,
    /// Those, and these, which the camera must have.
    DefaultAnd(BTreeSet<Topic>),
    /// All that the camera has.
    All,
    /// Those of a recording, as far as the camera has them, and no others.
    Recorded,
    /// These.
    These(BTreeSet<Topic>),
}

impl FromStr for Topics {
    type Err = Ros2Error;

    fn from_str(text: &str) -> Result<Self, Ros2Error> {
        let mut names: Vec<_> = text.split(',').map(str::trim).collect();
        if names == ["all"] {
            return Ok(Self::All);
        }
        let listed = names.len();
        names.retain(|name| *name != "default");
        let has_default = names.len() < listed;
        let topics = names.into_iter().map(topic_named).collect::<Result<BTreeSet<_>, _>>()?;
        Ok(match (has_default, topics.is_empty()) {
            (true, true) => Self::Default,
            (true, false) => Self::DefaultAnd(topics),
            (false, _) => Self::These(topics),
        })
    }
}

fn topic_named(name: &str) -> Result<Topic, Ros2Error> {
    let choosable = Topic::ALL.into_iter().filter(|topic| !Topic::ALWAYS.contains(topic));
    choosable.clone().find(|topic| topic.name() == name).ok_or_else(|| {
        let names: Vec<_> = choosable.map(Topic::name).collect();
        unknown("topic", name, format!("`all` alone, or a list of default, {}", names.join(", ")))
    })
}

/// What a camera has beside depth.
#[derive(Debug, Clone, Copy, Default)]
pub struct Available {
    /// Labels.
    pub labels: bool,
    /// Confidence.
    pub confidence: bool,
    /// Obstacles.
    pub obstacles: bool,
}

impl Topics {
    /// The topics of a camera that has this.
    ///
    /// # Errors
    /// A topic was asked for that it does not have.
    pub fn of_camera(&self, available: Available) -> Result<BTreeSet<Topic>, Ros2Error> {
        let missing = |topic: Topic| match topic {
            _ if topic.needs_obstacles() && !available.obstacles => {
                Some("obstacles, which need a mount and depth in meters")
            }
            _ if topic.needs_labels() && !available.labels => Some("a model with labels"),
            _ if topic.needs_confidence() && !available.confidence => Some("a model with confidence"),
            _ => None,
        };
        let present = |topics: &[Topic]| -> BTreeSet<Topic> {
            topics.iter().copied().filter(|topic| missing(*topic).is_none()).collect()
        };
        let chosen = match self {
            Self::Default => present(&Topic::DEFAULT),
            Self::DefaultAnd(topics) => &present(&Topic::DEFAULT) | topics,
            Self::All => present(&Topic::ALL),
            Self::Recorded => return Ok(present(&Topic::RECORDED)),
            Self::These(topics) => topics.clone(),
        };
        let failed = chosen.iter().find_map(|&topic| Some((topic.name(), missing(topic)?)));
        if let Some((topic, needed)) = failed {
            return Err(Ros2Error::Missing { topic, needed });
        }
        Ok(chosen.into_iter().chain(Topic::ALWAYS).collect())
    }
}

/// What the user chose.
#[derive(Debug, Clone, Default)]
pub struct Ros2Options {
    /// Where messages are sent; nowhere if it is empty.
    pub links: Vec<LinkName>,
    /// The topics of each camera.
    pub topics: Topics,
    /// How depth is encoded.
    pub depth: DepthFormat,
}

impl Ros2Options {
    /// Checks what can be checked without the network: the environment, Zenoh's configuration and the names
    /// of the cameras.
    ///
    /// # Errors
    /// ROS 2 does not take one of them.
    pub fn check<'a>(&self, mut cameras: impl Iterator<Item = &'a str>) -> Result<(), Ros2Error> {
        if self.links.is_empty() {
            return Ok(());
        }
        self.links.iter().try_for_each(|link| check(link, &link.environment()?))?;
        cameras.try_for_each(check_camera_name)
    }
}

/// A camera as other nodes see it.
#[derive(Debug, Clone, Copy)]
pub struct CameraOptions<'a> {
    /// First part of its topics.
    pub name: &'a str,
    /// The coordinate frame of its images, unless frames state another.
    pub frame_id: &'a str,
    /// The names of the classes, in the order of their indices; empty without labels.
    pub classes: &'a [String],
    /// Where it is on the robot.
    pub mount: Option<CameraMount>,
    /// Whether the model has labels.
    pub has_labels: bool,
    /// Whether the model has a confidence.
    pub has_confidence: bool,
    /// Whether obstacles are found.
    pub has_obstacles: bool,
    /// Counts its messages.
    pub counts: &'a MessageCounts,
    /// Facts that do not change: model, provider.
    pub about: &'a [(&'static str, String)],
}

/// Checks whether topics of a camera can have this name.
pub(crate) fn check_camera_name(name: &str) -> Result<(), Ros2Error> {
    if is_valid_part(name) { Ok(()) } else { Err(Ros2Error::CameraName { name: name.to_owned() }) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nunet_ros2_link::Ros2ErrorKind;

    #[test]
    fn an_unknown_topic_is_an_error_that_lists_the_known_ones() {
        for text in ["all,scan", "scan,", "", "default,,scan", "scan depth/points"] {
            assert!(text.parse::<Topics>().is_err(), "`{text}`");
        }
        let error = "scan,depht/image_raw".parse::<Topics>().unwrap_err().to_string();
        assert!(error.starts_with("unknown topic `depht/image_raw`, expected `all`"), "{error}");
        assert!(error.contains("depth/image_raw, depth/camera_info"), "{error}");
        assert!("/tf_static".parse::<Topics>().is_err(), "it is always there");
    }

    #[test]
    fn lists_may_have_spaces_and_contain_the_default() {
        let topics = |text: &str| text.parse::<Topics>().unwrap();
        assert_eq!((topics(" all "), topics("default,default")), (Topics::All, Topics::Default));
        assert_eq!(
            topics("depth/points, labels/image_raw"),
            Topics::These([Topic::Points, Topic::Labels].into())
        );
        let both = topics("default, depth/points");
        assert_eq!(both, topics("depth/points,default"));
        let nothing = Available::default();
        let expected = Topics::Default.of_camera(nothing).unwrap().into_iter().chain([Topic::Points]);
        assert_eq!(both.of_camera(nothing).unwrap(), expected.collect());
        assert!(topics("default,labels/image_raw").of_camera(nothing).is_err(), "the camera has no labels");
    }

    #[test]
    fn a_camera_has_the_topics_that_it_can_fill() {
        let nothing = Available::default();
        let default = Topics::Default.of_camera(nothing).unwrap();
        assert!(default.contains(&Topic::HalfDepth) && !default.contains(&Topic::Scan));
        let everything = Available { labels: true, confidence: true, obstacles: true };
        assert_eq!(Topics::All.of_camera(everything).unwrap().len(), Topic::ALL.len());
        let error = "scan".parse::<Topics>().unwrap().of_camera(nothing).unwrap_err();
        assert_eq!(error.kind(), Ros2ErrorKind::Argument);
        assert!("labels/image_raw".parse::<Topics>().unwrap().of_camera(nothing).is_err());
    }
}
