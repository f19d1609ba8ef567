//! Results of the last frame for readers that joined after it.

use nunet_telemetry::FrameEnd;
use tracing::warn;

use super::StreamTask;
use crate::source::Frame;
use crate::stream::state::StreamState;

impl StreamTask {
    /// Keeps a published frame whose other results may still be needed, and returns any other one to the
    /// source.
    pub(super) fn keep_or_give_back(&mut self, frame: Frame, end: FrameEnd, state: &StreamState) {
        // A request from before may be outdated; if not, the source repeats it.
        state.take_frame_request();
        if end == FrameEnd::Published && self.can_serve_late_readers() {
            self.kept = Some(frame);
        } else {
            state.mailbox.give_back(frame);
        }
    }

    /// Returns the kept frame if the source lends no more frames without it. The next frame is worth more.
    pub(super) fn give_back_if_requested(&mut self, state: &StreamState) {
        if state.take_frame_request() {
            self.kept.take().into_iter().for_each(|kept| state.mailbox.give_back(kept));
        }
    }

    /// Whether results of the last frame can still be computed for a reader that joins later. A network or
    /// filter with a state must not process a frame twice.
    fn can_serve_late_readers(&self) -> bool {
        self.publisher.has_omitted_results() && self.pipeline.is_stateless()
    }

    /// Computes labels and cloud of the last frame for readers that joined since. The frame has been counted
    /// already.
    pub(super) fn serve_late_readers(&mut self) {
        let Some(frame) = self.kept.take() else { return };
        match self.try_serve_late_readers(&frame) {
            Ok(()) => self.kept = Some(frame),
            // The frame is not kept, because it would fail again five times per second.
            Err(error) => warn!("late readers do not receive frame {}: {error:#}", frame.sequence),
        }
    }

    fn try_serve_late_readers(&mut self, frame: &Frame) -> anyhow::Result<()> {
        let Some(mut loans) = self.publisher.loan_for_late_readers()? else { return Ok(()) };
        let report = self.process(frame, &mut loans, self.publisher.has_obstacle_readers())?;
        self.publisher.publish_to_late_readers(loans, frame, &report)
    }
}
