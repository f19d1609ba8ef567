//! Where results go.

pub(crate) mod collect;
pub mod files;
pub(crate) mod metrics;
pub(crate) mod patience;
pub(crate) mod recording;
pub(crate) mod shm;
pub(crate) mod stats;
pub(crate) mod writing;
