//! Sets exposure and gain by the controls that a driver has.

use super::device::{ControlRange, Device, Errno};
use super::fault::CameraFault;
use crate::camera_settings::{CameraSetting, CameraSettings};

/// `V4L2_CID_EXPOSURE_AUTO`, a menu.
const EXPOSURE_MODE: u32 = 0x009a_0901;
/// `V4L2_EXPOSURE_MANUAL`
const MANUAL: i32 = 1;
/// `V4L2_EXPOSURE_AUTO`, and `V4L2_EXPOSURE_APERTURE_PRIORITY`, which webcams have instead: their aperture is
/// fixed.
const AUTOMATIC: [i32; 2] = [0, 3];
/// `V4L2_CID_EXPOSURE_ABSOLUTE`
const EXPOSURE_TIME: u32 = 0x009a_0902;
/// The unit of the exposure time, microseconds.
const EXPOSURE_UNIT_MICROS: u32 = 100;
/// `V4L2_CID_AUTOGAIN`
const AUTOMATIC_GAIN: u32 = 0x0098_0912;
/// `V4L2_CID_GAIN`
const GAIN: u32 = 0x0098_0913;

/// Changes what the user asked for, and nothing else.
///
/// # Errors
/// The camera does not have a control, or does not take the value.
pub(super) fn apply(device: &mut dyn Device, settings: CameraSettings) -> Result<(), CameraFault> {
    match settings.exposure {
        None => {}
        Some(CameraSetting::Auto) => set_automatic_exposure(device)?,
        Some(CameraSetting::Value(micros)) => set_exposure(device, micros)?,
    }
    match settings.gain {
        None => Ok(()),
        Some(CameraSetting::Auto) => {
            range(device, AUTOMATIC_GAIN, "automatic gain")?;
            set(device, AUTOMATIC_GAIN, 1)
        }
        Some(CameraSetting::Value(gain)) => set_gain(device, gain),
    }
}

fn set_automatic_exposure(device: &mut dyn Device) -> Result<(), CameraFault> {
    range(device, EXPOSURE_MODE, "automatic exposure")?;
    let [first, second] = AUTOMATIC;
    match device.set_control(EXPOSURE_MODE, first) {
        Err(Errno::INVAL | Errno::RANGE) => set(device, EXPOSURE_MODE, second),
        result => result.map_err(failed),
    }
}

fn set_exposure(device: &mut dyn Device, micros: u32) -> Result<(), CameraFault> {
    let ControlRange { least, most } = range(device, EXPOSURE_TIME, "the exposure time")?;
    let value = (micros.saturating_add(EXPOSURE_UNIT_MICROS / 2) / EXPOSURE_UNIT_MICROS) as i32;
    if !(least..=most).contains(&value) {
        let [least, most] = [least, most].map(|value| i64::from(value) * i64::from(EXPOSURE_UNIT_MICROS));
        let what = "exposure times";
        return Err(CameraFault::OutOfRange { what, given: micros, least, most, unit: " \u{b5}s" });
    }
    if has(device, EXPOSURE_MODE)? {
        set(device, EXPOSURE_MODE, MANUAL)?;
    }
    set(device, EXPOSURE_TIME, value)
}

fn set_gain(device: &mut dyn Device, gain: u32) -> Result<(), CameraFault> {
    let ControlRange { least, most } = range(device, GAIN, "gain")?;
    let Some(value) = i32::try_from(gain).ok().filter(|value| (least..=most).contains(value)) else {
        let (least, most) = (least.into(), most.into());
        return Err(CameraFault::OutOfRange { what: "gains", given: gain, least, most, unit: "" });
    };
    if has(device, AUTOMATIC_GAIN)? {
        set(device, AUTOMATIC_GAIN, 0)?;
    }
    set(device, GAIN, value)
}

fn range(device: &mut dyn Device, id: u32, what: &'static str) -> Result<ControlRange, CameraFault> {
    let found = device.control_range(id).map_err(CameraFault::at("ask for its controls"))?;
    found.ok_or(CameraFault::NoControl { what })
}

fn has(device: &mut dyn Device, id: u32) -> Result<bool, CameraFault> {
    Ok(device.control_range(id).map_err(CameraFault::at("ask for its controls"))?.is_some())
}

fn set(device: &mut dyn Device, id: u32, value: i32) -> Result<(), CameraFault> {
    device.set_control(id, value).map_err(failed)
}

fn failed(errno: Errno) -> CameraFault {
    CameraFault::at("set its exposure or gain")(errno)
}
