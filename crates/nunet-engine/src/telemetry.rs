#![expect(unsafe_code, reason = "ONNX Runtime reads the switch for its telemetry from the environment only")]

//! Keeps ONNX Runtime's telemetry off unless the user turns it on.
//!
//! The builds on the Python package index resolve their vendor's host about ten seconds after the library is
//! loaded, open a TLS connection, and send the executable's path, the machine's type and a hashed device ID.
//! The session option for telemetry does not prevent this. The environment variable [`TELEMETRY_VARIABLE`]
//! does, if it is set before the library is opened.

use std::ffi::OsStr;

/// Read by ONNX Runtime when its library is opened: 1 turns telemetry off, 0 leaves it on.
pub const TELEMETRY_VARIABLE: &str = "ORT_DISABLE_TELEMETRY";

const OFF: &str = "1";
const ON: &str = "0";

/// Whether ONNX Runtime may send telemetry, by the environment of this process.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Telemetry {
    /// It sends nothing.
    Off,
    /// It may send: the user set [`TELEMETRY_VARIABLE`] to 0, or nothing was set yet.
    On,
}

impl Telemetry {
    /// The state by the current environment.
    #[must_use]
    pub fn state() -> Self {
        Self::of(std::env::var_os(TELEMETRY_VARIABLE).as_deref())
    }

    fn of(value: Option<&OsStr>) -> Self {
        if value.is_some_and(|value| value == OFF) { Self::Off } else { Self::On }
    }

    /// Turns telemetry off for this process and its children, unless [`TELEMETRY_VARIABLE`] is 0.
    ///
    /// `Engine::start` calls this before it opens the library. A program that starts threads before that
    /// should call it first thing in `main`, or be started with the variable set: C code of another thread
    /// that reads the environment at the same moment would race with the write.
    pub fn turn_off_by_default() {
        if let Some(value) = value_to_set(std::env::var_os(TELEMETRY_VARIABLE).as_deref()) {
            // SAFETY: nunetd calls this before it starts any thread. Elsewhere Rust's own readers of the
            // environment take the standard library's lock, so that only a C function of another thread that
            // reads the environment at this moment could see half of the write; the documentation tells
            // callers.
            unsafe { std::env::set_var(TELEMETRY_VARIABLE, value) };
        }
    }
}

/// The new value of the variable, if it must change. ONNX Runtime leaves telemetry on for any value except 1.
fn value_to_set(value: Option<&OsStr>) -> Option<&'static str> {
    value.is_none_or(|value| value != ON && value != OFF).then_some(OFF)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn telemetry_is_off_unless_the_user_sets_the_variable_to_0() {
        for value in [None, Some(""), Some("yes"), Some("2")] {
            assert_eq!(value_to_set(value.map(OsStr::new)), Some(OFF), "{value:?}");
        }
        for value in [OFF, ON] {
            assert_eq!(value_to_set(Some(OsStr::new(value))), None, "{value}");
        }
    }

    #[test]
    fn the_state_is_what_onnx_runtime_reads() {
        assert_eq!(Telemetry::of(Some(OsStr::new(OFF))), Telemetry::Off);
        for value in [None, Some(""), Some(ON)] {
            assert_eq!(Telemetry::of(value.map(OsStr::new)), Telemetry::On, "{value:?}");
        }
    }

    #[test]
    fn telemetry_is_off_in_the_tests() {
        assert_eq!(Telemetry::state(), Telemetry::Off, "`.cargo/config.toml` sets {TELEMETRY_VARIABLE}");
    }
}
