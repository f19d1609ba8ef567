//! The topic that describes the camera of an image topic.
//!
//! ROS' drivers publish `camera_info` beside the image. Other publishers, of stereo cameras or of rectified
//! images, name it after the image: `left_camera_info`, `camera_info_rect`. A topic that by its name
//! describes another image is not used, because its intrinsics would be wrong and nothing would show it.

use std::cmp::Reverse;
use std::collections::BTreeSet;

use crate::topics::{is_rectified, stream, words};

/// The last part of the topic on which ROS' drivers describe a camera.
const CAMERA_INFO: &str = "camera_info";
/// Words that do not tell cameras apart.
const GENERIC: [&str; 7] = ["", "cam", "camera", "info", "calib", "calibration", "image"];

/// The topic on which ROS' drivers describe the camera of an image topic: `camera_info` in its namespace
/// (`image_transport::getCameraInfoTopic`). A transport's name does not count as a namespace.
#[must_use]
pub fn camera_topic(image_topic: &str) -> String {
    format!("{}/{CAMERA_INFO}", parent(stream(image_topic)))
}

/// Chooses among the topics of a recording; `None` if there is no camera in the image's namespace. A topic in
/// another namespace belongs to another camera.
///
/// # Errors
/// Why none of the topics in the namespace is used.
pub(crate) fn choose(image: &str, images: &[&str], cameras: &[&str]) -> Result<Option<String>, String> {
    // `/front/image_raw/compressed` and `/front/image_raw` both belong to `/front/camera_info`.
    for namespace in [parent(image), parent(parent(image))] {
        let beside: BTreeSet<&str> =
            cameras.iter().copied().filter(|camera| parent(camera) == namespace).collect();
        let exact = format!("{namespace}/{CAMERA_INFO}");
        if beside.contains(exact.as_str()) {
            return Ok(Some(exact));
        }
        if !beside.is_empty() {
            let images: Vec<&str> =
                images.iter().copied().filter(|other| name_in(namespace, other).is_some()).collect();
            return by_name(namespace, image, &images, &beside).map(Some);
        }
    }
    Ok(None)
}

/// The topic whose name matches the image better than the others and better than another image.
fn by_name(
    namespace: &str,
    image: &str,
    images: &[&str],
    cameras: &BTreeSet<&str>,
) -> Result<String, String> {
    let likeness = |image: &str, camera: &str| likeness(namespace, image, camera);
    let is_of_another = |camera: &str| {
        (is_rectified(camera) && !is_rectified(image))
            || images.iter().any(|other| likeness(other, camera) > likeness(image, camera))
    };
    let own: Vec<&str> = cameras.iter().copied().filter(|camera| !is_of_another(camera)).collect();
    let best = own.iter().map(|camera| likeness(image, camera)).max();
    let alike: Vec<&str> = own.into_iter().filter(|camera| Some(likeness(image, camera)) == best).collect();
    match alike.as_slice() {
        [camera] => Ok((*camera).to_owned()),
        [] => Err(format!("by their names, other images are described by {}", list(cameras.iter().copied()))),
        several => Err(format!("several topics may describe it: {}", list(several.iter().copied()))),
    }
}

/// How many words the names share, then how few words of the camera's name the image's name lacks.
fn likeness(namespace: &str, image: &str, camera: &str) -> (usize, Reverse<usize>) {
    let of_image: BTreeSet<String> = words(name_in(namespace, image).unwrap_or(image)).collect();
    let of_camera = words(name_in(namespace, camera).unwrap_or(camera));
    let (shared, extra): (Vec<_>, Vec<_>) =
        of_camera.filter(|word| !GENERIC.contains(&word.as_str())).partition(|word| of_image.contains(word));
    (shared.len(), Reverse(extra.len()))
}

fn parent(topic: &str) -> &str {
    topic.rsplit_once('/').map_or("", |(parent, _)| parent)
}

/// The rest of a topic's name behind a namespace; `None` if it is in another one.
fn name_in<'a>(namespace: &str, topic: &'a str) -> Option<&'a str> {
    topic.strip_prefix(namespace).filter(|rest| namespace.is_empty() || rest.starts_with('/'))
}

fn list<'a>(topics: impl Iterator<Item = &'a str>) -> String {
    topics.map(|topic| format!("`{topic:.60}`")).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chosen(image: &str, others: &[&str], cameras: &[&str]) -> Result<Option<String>, String> {
        let images: Vec<&str> = others.iter().copied().chain([image]).collect();
        let forward = choose(image, &images, cameras);
        let backward: Vec<&str> = cameras.iter().rev().copied().collect();
        assert_eq!(choose(image, &images, &backward), forward, "the order of the channels decides nothing");
        forward
    }

    #[track_caller]
    fn check(image: &str, others: &[&str], cameras: &[&str], expected: &str) {
        assert_eq!(chosen(image, others, cameras), Ok(Some(expected.to_owned())));
    }

    #[test]
    fn a_ros_driver_describes_the_camera_in_the_namespace_of_the_image() {
        for topic in ["/front/image_raw", "/front/image_raw/compressed", "/front/image_rect"] {
            assert_eq!(camera_topic(topic), "/front/camera_info");
            check(topic, &[], &["/front/camera_info", "/rear/camera_info"], "/front/camera_info");
        }
        assert_eq!(camera_topic("/image"), "/camera_info");
        assert_eq!(chosen("/c/image_raw", &[], &["/a/camera_info", "/b/camera_info"]), Ok(None));
    }

    #[test]
    fn camera_info_itself_precedes_other_names() {
        let cameras = ["/left/camera_info_rect", "/left/camera_info", "/left/zz_info"];
        check("/left/image_raw", &[], &cameras, "/left/camera_info");
        check("/left/image_raw/compressed", &["/left/image_rect"], &cameras, "/left/camera_info");
    }

    #[test]
    fn the_name_of_a_stereo_image_decides() {
        let cameras = ["/cam/right_camera_info", "/cam/left_camera_info"];
        check("/cam/left_image", &["/cam/right_image"], &cameras, "/cam/left_camera_info");
        check("/cam/right_image/compressed", &[], &cameras, "/cam/right_camera_info");
        check("/cam/left/image_raw", &[], &cameras, "/cam/left_camera_info");
        let rect = ["/cam/left_camera_info", "/cam/left_camera_info_rect", "/cam/right_camera_info_rect"];
        check("/cam/left_image_rect", &[], &rect, "/cam/left_camera_info_rect");
        check("/cam/left_image_raw", &[], &rect, "/cam/left_camera_info");
    }

    #[test]
    fn the_only_camera_is_taken_whatever_its_name() {
        check("/c/image", &[], &["/c/calibration"], "/c/calibration");
        check("/c/color_image", &["/c/color_image/compressed"], &["/c/rgb_info"], "/c/rgb_info");
    }

    #[test]
    fn a_camera_of_another_image_is_not_used_and_named() {
        let error =
            chosen("/cam/left_image", &["/cam/right_image"], &["/cam/right_camera_info"]).unwrap_err();
        assert_eq!(error, "by their names, other images are described by `/cam/right_camera_info`");
        assert!(chosen("/c/image_raw", &[], &["/c/camera_info_rect"]).is_err(), "it is rectified");
    }

    #[test]
    fn cameras_that_match_equally_well_are_named() {
        let error = chosen("/c/image", &[], &["/c/b_info", "/c/a_info"]).unwrap_err();
        assert_eq!(error, "several topics may describe it: `/c/a_info`, `/c/b_info`");
    }
}
