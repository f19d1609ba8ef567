//! `--record FILE.mcap` and `nunetd replay`: frames and their results as a recording.

mod recorder;
mod writer;

#[cfg(test)]
pub(crate) use nunet_sink::archive::Archive;
pub(crate) use nunet_sink::record::Record;
pub(crate) use recorder::open;
#[cfg(test)]
pub(crate) use recorder::record_into;
pub(crate) use writer::{About, FrameWriter, recording_path, refuse_output, settings};
