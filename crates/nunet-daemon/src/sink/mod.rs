//! Where results go.

pub mod files;
pub(crate) mod shm;
