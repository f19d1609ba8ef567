//! Which cameras there are, for whoever does not know their names or has mistyped one.

use iceoryx2::prelude::{CallbackProgression, Service as _};

use crate::access;
use crate::error::IpcError;
use crate::name::CameraName;
use crate::node::{self, Iceoryx, config};
use crate::service::{open_topic, owner_of};
use nunet_types::Topic;

/// The cameras whose `topic` a living process publishes, by name. Those of users who do not share memory with this one are
/// not seen.
///
/// # Errors
/// [`IpcError::CannotJoin`], [`IpcError::NoAccess`], [`IpcError::Iceoryx`] when iceoryx2's folder cannot be read.
pub fn list(topic: Topic) -> Result<Vec<CameraName>, IpcError> {
    // As a reader, it must not be the one who makes the folder.
    if !access::has_folder() {
        return Ok(Vec::new());
    }
    let node = node::create()?;
    let mut cameras = Vec::new();
    Iceoryx::list(config(), |service| {
        cameras.extend(camera_of(service.static_details.name().as_str(), topic));
        CallbackProgression::Continue
    })
    .map_err(|cause| IpcError::iceoryx("list the services of iceoryx2", cause))?;
    // Its readers keep a service open when its owner is gone. One that cannot be opened is nobody's to read.
    cameras.retain(|camera| {
        let service = open_topic(&node, camera, topic).ok().flatten();
        service.as_ref().and_then(owner_of).is_some_and(|owner| owner.alive)
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
    fn a_cameras_name_is_read_from_its_service_and_from_nobody_elses() {
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
