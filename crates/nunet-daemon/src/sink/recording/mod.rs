//! `--record FILE.mcap` and `nunetd replay`: frames and their results as a recording.

mod disk;
mod record;
mod recorder;
mod writer;

pub(crate) use record::{Record, Results};
pub(crate) use recorder::{Ending, Recorder, Tally};
pub(crate) use writer::{About, Archive, FrameWriter, recording_path, refuse_output, settings};
