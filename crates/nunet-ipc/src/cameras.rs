//! Which cameras are published.

use iceoryx2::prelude::{CallbackProgression, Service as _};

use nunet_types::Topic;

use crate::access;
use crate::error::IpcError;
use crate::iceoryx::{Iceoryx, check_root, config, root};
use crate::name::CameraName;
use crate::recovery;
use crate::service::{open_topic, publisher_of};

/// The cameras whose `topic` a living process publishes, sorted by name. Cameras of users who do not share
/// memory with this one are not listed.
///
/// # Errors
/// [`IpcError::CannotJoin`], [`IpcError::NoAccess`], [`IpcError::Iceoryx`] when iceoryx2's folder cannot be
/// read.
pub fn list(topic: Topic) -> Result<Vec<CameraName>, IpcError> {
    check_root()?;
    // As a reader, it must not create the folder: it would belong to the reader's user.
    if !root().exists() {
        return Ok(Vec::new());
    }
    access::usable_folder()?;
    let mut cameras = Vec::new();
    Iceoryx::list(config(), |service| {
        cameras.extend(camera_of(service.static_details.name().as_str(), topic));
        CallbackProgression::Continue
    })
    .map_err(|cause| IpcError::iceoryx("list the services of iceoryx2", cause))?;
    if cameras.is_empty() {
        return Ok(cameras);
    }
    // Readers keep a service open after its publisher ended, so each service is opened to look for its
    // publisher.
    let node = recovery::create_node()?;
    cameras.retain(|camera| {
        let service = open_topic(&node, camera, topic).ok().flatten();
        service.as_ref().and_then(publisher_of).is_some_and(|publisher| publisher.alive)
    });
    cameras.sort();
    cameras.dedup();
    Ok(cameras)
}

/// The camera whose `topic` is carried by a service of that name.
fn camera_of(service: &str, topic: Topic) -> Option<CameraName> {
    let (camera, name) = service.strip_prefix("nunet/")?.split_once('/')?;
    CameraName::new(camera).ok().filter(|_| name == topic.name())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cameras_name_is_read_from_its_own_service_only() {
        let front = CameraName::new("front").unwrap();
        assert_eq!(camera_of(&front.service(Topic::Depth), Topic::Depth), Some(front.clone()));
        assert_eq!(camera_of(&front.service(Topic::Depth), Topic::Rgb), None);
        for service in [
            "nunet/depth",
            "other/front/depth",
            "nunet/front/x/depth",
            "my-nunet/front/depth",
            "nunet//depth",
        ] {
            assert_eq!(camera_of(service, Topic::Depth), None, "{service}");
        }
    }
}
