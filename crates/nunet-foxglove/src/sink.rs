//! The sink of one camera: that of `nunet-ros2`, and the parameters.

use std::sync::Arc;

use nunet_sink::results::Results;
use nunet_sink::sink::{FinishingSink, PublishedFrame, Sink, Status, Wants};
use nunet_telemetry::MessageCounts;

use crate::parameters::Parameters;

/// Passes frames on.
pub(crate) struct FoxgloveSink {
    pub(crate) camera: String,
    pub(crate) messages: Box<dyn Sink>,
    pub(crate) parameters: Arc<Parameters>,
}

impl Sink for FoxgloveSink {
    fn wants(&self) -> Wants {
        self.messages.wants()
    }

    fn on_frame(&mut self, published: &PublishedFrame<'_>) {
        self.parameters.update(&self.camera, |state| state.scale = Some(published.results.scale));
        self.messages.on_frame(published);
    }

    fn on_status(&mut self, status: &Status<'_>) {
        self.parameters.update(&self.camera, |state| state.fps = status.totals.fps());
        self.messages.on_status(status);
    }

    fn has_room(&mut self) -> bool {
        self.messages.has_room()
    }

    fn messages(&self) -> Option<(&'static str, MessageCounts)> {
        self.messages.messages()
    }

    fn finish(self: Box<Self>, last: Option<&Results<'_>>) -> FinishingSink {
        self.messages.finish(last)
    }
}
