//! The version of the interfaces to other programs.

/// Version of the shared-memory contract and of everything that nunet prints as JSON.
pub const CONTRACT_VERSION: u32 = 1;
