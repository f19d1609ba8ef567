//! Names of topics and types.

/// Whether ROS 2 accepts `name` as a part of a topic.
#[must_use]
pub fn is_valid_part(name: &str) -> bool {
    let is_word = |character: char| character.is_ascii_alphanumeric() || character == '_';
    !name.is_empty()
        && name.chars().all(is_word)
        && !name.contains("__")
        && !name.starts_with(|first: char| first.is_ascii_digit())
}

/// A name that ROS 2 accepts, made of one that it does not.
pub(crate) fn valid_part(name: &str) -> String {
    let word = |character: char| if character.is_ascii_alphanumeric() { character } else { '_' };
    let mut valid: String = name.chars().map(word).collect();
    while valid.contains("__") {
        valid = valid.replace("__", "_");
    }
    if is_valid_part(&valid) { valid } else { format!("camera_{valid}") }
}

/// The full name of a topic: `camera/image_raw` is `/camera/image_raw`. `None` if ROS 2 has no such name.
#[must_use]
pub fn full_name(topic: &str) -> Option<String> {
    let parts = topic.strip_prefix('/').unwrap_or(topic);
    parts.split('/').all(is_valid_part).then(|| format!("/{parts}"))
}

/// `sensor_msgs/msg/Image` as DDS names it: `sensor_msgs::msg::dds_::Image_`.
#[cfg(any(test, feature = "ros2-dds", feature = "ros2-zenoh"))]
pub(crate) fn dds_type(type_name: &str) -> String {
    let (package, name) = type_name.rsplit_once('/').unwrap_or(("", type_name));
    format!("{}::dds_::{name}_", package.replace('/', "::"))
}

/// The reverse of [`dds_type`]; other types stay as they are.
#[cfg(any(test, feature = "ros2-dds", feature = "ros2-zenoh"))]
pub(crate) fn ros_type(dds_type: &str) -> String {
    let named = dds_type.strip_suffix('_').and_then(|name| name.split_once("::dds_::"));
    named.map_or_else(
        || dds_type.to_owned(),
        |(package, name)| format!("{}/{name}", package.replace("::", "/")),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_that_ros_does_not_take_gets_one_that_it_takes() {
        for name in ["front", "_a", "left_arm0"] {
            assert!(is_valid_part(name), "{name}");
        }
        for name in ["left-arm.0", "0", "a__b", "", "é", "9-"] {
            assert!(!is_valid_part(name), "{name}");
            assert!(is_valid_part(&valid_part(name)), "{name}: {}", valid_part(name));
        }
    }

    #[test]
    fn a_topic_has_one_full_name_or_is_refused() {
        for topic in ["/camera/image_raw", "camera/image_raw"] {
            assert_eq!(full_name(topic).unwrap(), "/camera/image_raw");
        }
        assert_eq!(full_name("/image").unwrap(), "/image");
        for topic in ["", "/", "//a", "/a/", "/a//b", "/0a", "/a b", "~/a", "/a__b", "/a@1"] {
            assert!(full_name(topic).is_none(), "{topic}");
        }
    }

    #[test]
    fn types_are_named_as_dds_names_those_of_ros() {
        for (ros, dds) in [
            ("sensor_msgs/msg/Image", "sensor_msgs::msg::dds_::Image_"),
            ("tf2_msgs/msg/TFMessage", "tf2_msgs::msg::dds_::TFMessage_"),
        ] {
            assert_eq!((dds_type(ros).as_str(), ros_type(dds).as_str()), (dds, ros));
        }
        assert_eq!(ros_type("HelloWorld"), "HelloWorld");
    }
}
