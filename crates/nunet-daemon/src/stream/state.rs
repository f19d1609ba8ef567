//! The state that the capture thread and the inference thread of one camera share.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use nunet_telemetry::Ledger;
use tracing::Span;

use super::stop::Stop;
use crate::source::{Frame, Mailbox, Notify};

/// Shared by both ends of a camera's mailbox.
#[derive(Debug)]
pub(crate) struct StreamState {
    pub(crate) mailbox: Mailbox<Frame>,
    pub(crate) ledger: Ledger,
    pub(crate) stop: Stop,
    /// Names the camera in log lines if there are several.
    pub(crate) span: Span,
    is_waiting: AtomicBool,
    has_reported_waiting: AtomicBool,
    /// Whether the source needs a frame back that the inference thread keeps.
    needs_frame: AtomicBool,
    notify: Arc<Notify>,
}

impl StreamState {
    pub(crate) fn new(stop: Stop, notify: Arc<Notify>, span: Span) -> Self {
        Self {
            mailbox: Mailbox::with_notify(Arc::clone(&notify)),
            ledger: Ledger::default(),
            stop,
            span,
            is_waiting: false.into(),
            has_reported_waiting: false.into(),
            needs_frame: false.into(),
            notify,
        }
    }

    /// Requests the frame that the inference thread keeps: the source lends no other before.
    pub(super) fn request_frame(&self) {
        self.needs_frame.store(true, Ordering::Relaxed);
        self.notify.notify();
    }

    /// Whether a frame was requested since the last call.
    pub(super) fn take_frame_request(&self) -> bool {
        self.needs_frame.swap(false, Ordering::Relaxed)
    }

    /// Whether the source waits for its device or publisher.
    pub(crate) fn is_waiting(&self) -> bool {
        self.is_waiting.load(Ordering::Relaxed)
    }

    /// Whether the source reported since [`StreamState::forget_report`] that it waits. A source that hangs
    /// reports nothing.
    pub(super) fn has_reported_waiting(&self) -> bool {
        self.has_reported_waiting.load(Ordering::Relaxed)
    }

    /// Requests a new report.
    pub(super) fn forget_report(&self) {
        self.has_reported_waiting.store(false, Ordering::Relaxed);
    }

    /// Records whether the source waits.
    pub(super) fn report_waiting(&self, is_waiting: bool) {
        self.is_waiting.store(is_waiting, Ordering::Relaxed);
        self.has_reported_waiting.store(is_waiting, Ordering::Relaxed);
    }
}

/// Closes the mailbox when one of its threads ends, even by a panic: the other one must not wait forever.
pub(crate) struct CloseOnDrop<'a>(pub(crate) &'a StreamState);

impl Drop for CloseOnDrop<'_> {
    fn drop(&mut self) {
        self.0.mailbox.close();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    impl Default for StreamState {
        fn default() -> Self {
            Self::new(Stop::default(), Arc::default(), Span::none())
        }
    }

    #[test]
    fn a_report_of_waiting_counts_until_a_new_one_is_asked_for() {
        let state = StreamState::default();
        state.report_waiting(true);
        assert!(state.is_waiting() && state.has_reported_waiting());
        state.forget_report();
        assert!(state.is_waiting() && !state.has_reported_waiting(), "it may hang by now");
        state.report_waiting(true);
        assert!(state.has_reported_waiting());
        state.report_waiting(false);
        assert!(!state.is_waiting() && !state.has_reported_waiting());
    }
}
