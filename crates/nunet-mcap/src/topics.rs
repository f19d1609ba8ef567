//! The content of topics, judged by their names, and the choice among several.
//!
//! Drivers spell their streams differently: `/camera/color/image_raw`, `/zed/zed_node/rgb/image_rect_color`,
//! `/oak/rgb/image_raw`, `/rgb_to_depth/image_raw`. The last part of a name that contains a known word
//! decides. Of `A_to_B` only `A` counts: an image of A in the frame of B.

/// The content of an image topic, judged by its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum TopicContent {
    /// Labels, masks or confidence: images of ROS, but not camera images.
    Result,
    /// Depth or disparity.
    Depth,
    /// Infrared, thermal or gray images.
    Infrared,
    /// Unknown from the name.
    Unmarked,
    /// Color, by its name.
    Color,
}

const RESULT: [&str; 13] = [
    "label",
    "labels",
    "mask",
    "masks",
    "segmentation",
    "segmented",
    "semantic",
    "semantics",
    "instance",
    "confidence",
    "optical",
    "flow",
    "normals",
];
const DEPTH: [&str; 8] =
    ["depth", "depths", "disparity", "compresseddepth", "range", "ranges", "distance", "tof"];
const INFRARED: [&str; 10] =
    ["infra", "infrared", "ir", "nir", "lwir", "thermal", "mono", "gray", "grey", "intensity"];
const COLOR: [&str; 5] = ["color", "colour", "rgb", "bgr", "colored"];

/// Words for rectified images.
const RECTIFIED: [&str; 2] = ["rect", "rectified"];

/// Names of `image_transport`s that follow an image's topic.
const TRANSPORTS: [&str; 5] = ["compressed", "compressedDepth", "theora", "ffmpeg", "zstd"];

impl TopicContent {
    pub(crate) fn of(topic: &str) -> Self {
        topic.rsplit('/').find_map(Self::of_part).unwrap_or(Self::Unmarked)
    }

    fn of_part(part: &str) -> Option<Self> {
        let part = part.to_ascii_lowercase();
        let subject = part.split("_to_").next().unwrap_or_default();
        let words =
            || subject.split(['_', '-', '.']).map(|word| word.trim_end_matches(|c: char| c.is_ascii_digit()));
        let holds = |known: &[&str]| words().any(|word| known.contains(&word));
        // `depth_confidence` is not depth, and `depth_registered_color` is not color: the least usable
        // content decides.
        let contents = [
            (Self::Result, &RESULT[..]),
            (Self::Depth, &DEPTH),
            (Self::Infrared, &INFRARED),
            (Self::Color, &COLOR),
        ];
        contents.into_iter().find(|(_, known)| holds(known)).map(|(content, _)| content)
    }
}

/// A topic without the name of its transport.
pub(crate) fn stream(topic: &str) -> &str {
    let (parent, last) = topic.rsplit_once('/').unwrap_or(("", topic));
    if TRANSPORTS.contains(&last) { parent } else { topic }
}

/// Whether a topic has rectified images, or describes them, by ROS' names: `image_rect`, `image_rect_color`,
/// `image_color_rect`, `image_rect/compressed`.
pub(crate) fn is_rectified(topic: &str) -> bool {
    let is_marked = |part: &str| words(part).any(|word| RECTIFIED.contains(&word.as_str()));
    // A namespace named `rect` may hold any image; transports follow a part that begins with `image`.
    is_marked(last_name(stream(topic)))
        || topic.split('/').any(|part| part.starts_with("image") && is_marked(part))
}

/// The words of a name, in lower case.
pub(crate) fn words(name: &str) -> impl Iterator<Item = String> {
    name.split(|letter: char| !letter.is_alphanumeric()).map(str::to_lowercase)
}

fn last_name(topic: &str) -> &str {
    topic.rsplit('/').next().unwrap_or_default()
}

/// The common prefix of the streams of one camera: `/oak` for `/oak/rgb/image_raw`. `None` if the name
/// has no prefix.
fn device(topic: &str) -> Option<&str> {
    let (stream, _image) = stream(topic).rsplit_once('/')?;
    let (device, _name) = stream.rsplit_once('/')?;
    (!device.is_empty()).then_some(device)
}

/// Keeps one transport of each stream: the raw image is preferred to the compressed one.
pub(crate) fn one_transport_each<'a>(topics: &[&'a str]) -> Vec<&'a str> {
    let shortest = |topic: &&str| topics.iter().all(|other| stream(other) != stream(topic) || other >= topic);
    topics.iter().copied().filter(shortest).collect()
}

/// The color topics among all image topics; those that cannot be told apart remain.
pub(crate) fn color_topics<'a>(topics: &[&'a str]) -> Vec<&'a str> {
    let best = topics.iter().map(|topic| TopicContent::of(topic)).max().unwrap_or(TopicContent::Unmarked);
    let kept: Vec<&str> = match best {
        // If a camera has an `rgb` stream, its `left` and `right` streams are gray or stereo images.
        TopicContent::Color => {
            let color: Vec<&str> =
                topics.iter().copied().filter(|topic| TopicContent::of(topic) == best).collect();
            let beside = |topic: &str| {
                device(topic).is_some_and(|own| color.iter().any(|color| device(color) == Some(own)))
            };
            let unmarked = |topic: &str| TopicContent::of(topic) == TopicContent::Unmarked && !beside(topic);
            topics.iter().copied().filter(|topic| color.contains(topic) || unmarked(topic)).collect()
        }
        best => topics.iter().copied().filter(|topic| TopicContent::of(topic) == best).collect(),
    };
    one_transport_each(&kept)
}

/// The depth topics among all image topics. Of several of one camera, the one in the frame of the color
/// camera is chosen.
pub(crate) fn depth_topics<'a>(topics: &[&'a str]) -> Vec<&'a str> {
    let depth: Vec<&str> =
        topics.iter().copied().filter(|topic| TopicContent::of(topic) == TopicContent::Depth).collect();
    let depth = one_transport_each(&depth);
    let registered = |topic: &&str| {
        ["aligned", "registered", "_to_color", "_to_rgb"].iter().any(|word| topic.contains(word))
    };
    let aligned: Vec<&str> = depth.iter().copied().filter(registered).collect();
    if aligned.len() == 1 { aligned } else { depth }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(topics: &[&str], color: &[&str], depth: &[&str]) {
        assert_eq!(color_topics(topics), color, "color of {topics:?}");
        assert_eq!(depth_topics(topics), depth, "depth of {topics:?}");
    }

    #[test]
    fn rectified_images_are_known_by_a_word_of_their_name() {
        for topic in [
            "/c/image_rect",
            "/c/image_rect/compressed",
            "/c/image_rect/jpeg",
            "/c/image_rect_color",
            "/c/image_rect_raw",
            "/kinect2/qhd/image_color_rect",
            "/c/image_mono_rect/compressed",
            "/c/image_rectified",
            "/c/left_rect",
        ] {
            assert!(is_rectified(topic), "{topic}");
        }
        for topic in
            ["/c/image_raw", "/c/rect/image", "/c/rectified/image_raw", "/c/image_direct", "/rect/c/image"]
        {
            assert!(!is_rectified(topic), "{topic}");
        }
    }

    #[test]
    fn realsense() {
        check(
            &[
                "/camera/camera/aligned_depth_to_color/image_raw",
                "/camera/camera/color/image_raw",
                "/camera/camera/depth/image_rect_raw",
                "/camera/camera/infra1/image_rect_raw",
                "/camera/camera/infra2/image_rect_raw",
            ],
            &["/camera/camera/color/image_raw"],
            &["/camera/camera/aligned_depth_to_color/image_raw"],
        );
        check(
            &["/camera/aligned_depth_to_infra1/image_raw", "/camera/color/image_raw/compressed"],
            &["/camera/color/image_raw/compressed"],
            &["/camera/aligned_depth_to_infra1/image_raw"],
        );
    }

    #[test]
    fn zed() {
        check(
            &[
                "/zed/zed_node/confidence/confidence_map",
                "/zed/zed_node/depth/depth_registered",
                "/zed/zed_node/left/image_rect_gray",
                "/zed/zed_node/rgb/image_rect_color",
                "/zed/zed_node/rgb/image_rect_color/compressed",
                "/zed/zed_node/right/image_rect_gray",
            ],
            &["/zed/zed_node/rgb/image_rect_color"],
            &["/zed/zed_node/depth/depth_registered"],
        );
    }

    #[test]
    fn oak_whose_depth_is_named_stereo_and_whose_gray_cameras_are_unmarked() {
        check(
            &["/oak/left/image_raw", "/oak/rgb/image_raw", "/oak/right/image_raw", "/oak/stereo/image_raw"],
            &["/oak/rgb/image_raw"],
            &[],
        );
    }

    #[test]
    fn kinects_and_orbbec() {
        check(
            &["/depth/image_raw", "/depth_to_rgb/image_raw", "/ir/image_raw", "/rgb/image_raw"],
            &["/rgb/image_raw"],
            &["/depth_to_rgb/image_raw"],
        );
        check(
            &["/depth/image_raw", "/ir/image_raw", "/rgb_to_depth/image_raw"],
            &["/rgb_to_depth/image_raw"],
            &["/depth/image_raw"],
        );
        check(
            &["/kinect2/qhd/image_color_rect", "/kinect2/qhd/image_depth_rect", "/kinect2/sd/image_ir"],
            &["/kinect2/qhd/image_color_rect"],
            &["/kinect2/qhd/image_depth_rect"],
        );
        check(
            &["/camera/color/image_raw", "/camera/depth/image_raw", "/camera/left_ir/image_raw"],
            &["/camera/color/image_raw"],
            &["/camera/depth/image_raw"],
        );
    }

    #[test]
    fn compressed_depth_is_never_color_and_is_depth_where_there_is_no_other() {
        check(
            &["/front/depth/image_raw/compressedDepth", "/front/image_raw/compressed"],
            &["/front/image_raw/compressed"],
            &["/front/depth/image_raw/compressedDepth"],
        );
        check(
            &["/front/depth/image_raw", "/front/depth/image_raw/compressedDepth", "/front/image_raw"],
            &["/front/image_raw"],
            &["/front/depth/image_raw"],
        );
    }

    #[test]
    fn an_unmarked_camera_is_color_beside_thermal_depth_and_labels() {
        check(
            &["/front/depth/image_raw", "/front/image_raw", "/front/labels/image_raw", "/thermal/image_raw"],
            &["/front/image_raw"],
            &["/front/depth/image_raw"],
        );
        check(&["/thermal/image_raw"], &["/thermal/image_raw"], &[]);
    }

    #[test]
    fn two_cameras_remain_two() {
        let both = ["/front/color/image_raw", "/rear/color/image_raw"];
        check(&both, &both, &[]);
        let both = ["/front/color/image_raw", "/rear/image_raw"];
        check(&both, &both, &[]);
        let both = ["/left/image_raw", "/right/image_raw"];
        check(&both, &both, &[]);
    }
}
