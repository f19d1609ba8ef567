//! Exposure and gain of a camera, as the user asks for them.

use std::str::FromStr;

/// What is changed in a camera before it is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CameraSettings {
    /// The exposure time, microseconds; `None` leaves it as it is.
    pub exposure: Option<CameraSetting>,
    /// The gain, in the driver's own steps; `None` leaves it as it is.
    pub gain: Option<CameraSetting>,
}

impl CameraSettings {
    /// The camera stays as it is.
    pub const UNCHANGED: Self = Self { exposure: None, gain: None };
}

/// One setting.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CameraSetting {
    /// The camera chooses.
    Auto,
    /// A value.
    Value(u32),
}

impl FromStr for CameraSetting {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.parse() {
            _ if text == "auto" => Ok(Self::Auto),
            Ok(value) => Ok(Self::Value(value)),
            Err(_) => Err(format!("expected `auto` or a whole number, got `{text}`")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_setting_is_auto_or_a_whole_number() {
        assert_eq!("auto".parse(), Ok(CameraSetting::Auto));
        assert_eq!("8000".parse(), Ok(CameraSetting::Value(8000)));
        for text in ["", "Auto", "-1", "1.5", "8ms", "5000000000"] {
            let error = text.parse::<CameraSetting>().unwrap_err();
            assert_eq!(error, format!("expected `auto` or a whole number, got `{text}`"));
        }
    }
}
