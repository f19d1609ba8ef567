#![expect(unsafe_code, reason = "exported names")]
//! Functions without a handle.

use std::ffi::c_char;

use nunet_ipc::{CONTRACT_VERSION, monotonic_nanos};

/// The library's version, such as `0.1.0`. A static string. `NUNET_VERSION` is that of the header.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_version() -> *const c_char {
    const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), "\0");
    VERSION.as_ptr().cast()
}

/// The version of the shared-memory contract that the library implements. `NUNET_CONTRACT_VERSION` is that of
/// the header.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_contract_version() -> u32 {
    CONTRACT_VERSION
}

/// Now, in nanoseconds of `CLOCK_MONOTONIC`: the clock of `publish_nanos`, and of `capture_nanos` where
/// `capture_clock` says so.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_monotonic_nanos() -> i64 {
    monotonic_nanos()
}
