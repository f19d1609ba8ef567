//! `--record FILE.mcap`: frames and their results as a recording.

use std::path::Path;
use std::sync::Arc;

use nunet_sink::frame_writer::{FrameWriter, RecordingOptions, settings};
use nunet_sink::output_file::check_output;
use nunet_sink::recorder::record_into;

use super::{Sink, SinkContext};
use crate::exit::WithHint;

/// Opens the sink if `--record` is given.
pub(crate) fn open(context: &SinkContext<'_>) -> anyhow::Result<Option<Box<dyn Sink>>> {
    let (Some(path), Some(options)) = (context.record, &context.config.record) else { return Ok(None) };
    let about = RecordingOptions {
        camera: context.config.name.as_str(),
        frame_id: &context.config.frame_id,
        mount: context.config.mount.map(Into::into),
        model: &context.common.model.name,
        model_sha256: &context.common.model.hash,
        provider: context.common.provider,
        settings: settings(context.pipeline),
        force: options.force,
        lossless: options.lossless,
    };
    let writer = FrameWriter::create(path, &about)?;
    record_into(Box::new(writer), Arc::clone(&context.on_room)).map(Some)
}

/// Refuses an output that exists, before any work is done.
pub(crate) fn refuse_output(output: &Path, force: bool) -> anyhow::Result<()> {
    check_output(output, force)
        .map_err(|error| WithHint::usage(error.to_string(), "pass --force to overwrite it").into())
}
