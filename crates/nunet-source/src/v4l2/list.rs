//! The cameras of this machine, for reports.

use std::path::Path;

use nunet_types::Hint as _;

use super::device::{Device, FourCc, Host, Sizes};
use super::fault::CameraFault;
use super::linux::Linux;
use super::negotiate::{RequestedMode, choose, is_readable};
use crate::CameraReport;

/// Every camera of this machine. Devices of other kinds, such as a camera's second one for its metadata, are
/// skipped.
#[must_use]
pub fn cameras() -> Vec<CameraReport> {
    cameras_of(&mut Linux)
}

pub(super) fn cameras_of(host: &mut dyn Host) -> Vec<CameraReport> {
    let mut cameras = Vec::new();
    for path in host.nodes() {
        let offer = match describe(host, &path) {
            Err(CameraFault::NoCapture { .. } | CameraFault::NoVideo | CameraFault::Missing) => continue,
            // This is not a failure: the device is of another kind.
            Err(fault @ CameraFault::OtherCapture { .. }) => {
                Ok(format!("{fault}; {}", fault.hint().unwrap_or_default()))
            }
            result => result.map_err(|fault| (fault.to_string(), fault.hint())),
        };
        cameras.push(CameraReport { path, offer });
    }
    cameras
}

/// The camera's name.
///
/// # Errors
/// The device is not a camera, or not one that can be read.
pub(super) fn name_of_camera(device: &mut dyn Device) -> Result<String, CameraFault> {
    let can = device.capability().map_err(CameraFault::at("ask what it is"))?;
    let name = can.name;
    match (can.captures, can.streams) {
        (true, true) => Ok(name),
        (true, false) => Err(CameraFault::OtherCapture { name, what: "without mapped buffers" }),
        (false, _) => Err(CameraFault::NoCapture { name }),
    }
}

fn describe(host: &mut dyn Host, path: &Path) -> Result<String, CameraFault> {
    let mut device = host.open(path).map_err(CameraFault::at("open it"))?;
    let name = name_of_camera(device.as_mut())?;
    let formats = device.formats().map_err(CameraFault::at("list its formats"))?;
    let mut offers = Vec::new();
    for format in formats {
        let sizes = device.sizes(format).map_err(CameraFault::at("list its sizes"))?;
        offers.push(offer(format, &sizes));
    }
    let verdict = match choose(device.as_mut(), RequestedMode::default()) {
        Ok(choice) => format!("nunetd takes {choice}"),
        Err(CameraFault::NoFormat { .. }) => "nunetd reads none of them".into(),
        Err(fault) => return Err(fault),
    };
    let offers = if offers.is_empty() { "no format".into() } else { offers.join(", ") };
    Ok(format!("{name} offers {offers}; {verdict}"))
}

/// A format with its smallest and largest size.
fn offer(format: FourCc, sizes: &[Sizes]) -> String {
    let ends = sizes.iter().flat_map(|&sizes| match sizes {
        Sizes::One(size) => [size; 2],
        Sizes::Range { least, most, .. } => [least, most],
    });
    let mut ends: Vec<_> = ends.collect();
    ends.sort_unstable_by_key(|size| size.pixel_count());
    let range = match (ends.first(), ends.last()) {
        (Some(least), Some(most)) if least != most => format!(" {least} to {most}"),
        (Some(only), _) => format!(" {only}"),
        _ => String::new(),
    };
    let remark = if is_readable(format) { "" } else { " (not read)" };
    format!("{format}{range}{remark}")
}
