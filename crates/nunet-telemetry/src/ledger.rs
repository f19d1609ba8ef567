//! Every captured frame ends in exactly one of published, superseded, failed; until then it is in flight.

use std::sync::Mutex;

use serde::Serialize;

/// The counts of a stream at one moment.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// Frames that reached the source, readable or not.
    pub captured: u64,
    /// Published frames.
    pub published: u64,
    /// Frames that a newer one replaced, or that were waiting at a stop.
    pub superseded: u64,
    /// Frames without a result: unreadable, or refused by the pipeline.
    pub failed: u64,
    /// Frames that have not ended yet.
    pub in_flight: u64,
}

impl std::ops::AddAssign for Counts {
    /// The counts of two streams together.
    fn add_assign(&mut self, other: Self) {
        self.captured += other.captured;
        self.published += other.published;
        self.superseded += other.superseded;
        self.failed += other.failed;
        self.in_flight += other.in_flight;
    }
}

impl Counts {
    /// `captured = published + superseded + failed + in_flight`.
    pub fn balances(&self) -> bool {
        self.captured == self.published + self.superseded + self.failed + self.in_flight
    }
}

/// How a frame ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameEnd {
    /// It was published.
    Published,
    /// A newer frame or a stop came first.
    Superseded,
    /// There is no result; the reason has been logged.
    Failed,
}

/// The ledger of one stream, shared by its threads.
///
/// A mutex rather than five atomics: a reader must never see counts that do not add up. It is held for a few
/// additions.
#[derive(Debug, Default)]
pub struct Ledger(Mutex<Counts>);

impl Ledger {
    /// Counts a captured frame.
    pub fn captured(&self) {
        self.update(|counts| {
            counts.captured += 1;
            counts.in_flight += 1;
        });
    }

    /// Counts frames that newer ones replaced before the source delivered them.
    pub fn superseded(&self, count: u64) {
        self.update(|counts| {
            counts.captured += count;
            counts.superseded += count;
        });
    }

    /// Counts the end of a frame in flight.
    ///
    /// # Panics
    /// If no frame is in flight: a frame was ended twice, which is a bug of the caller.
    pub fn ended(&self, end: FrameEnd) {
        self.update(|counts| {
            counts.in_flight = counts.in_flight.checked_sub(1).expect("a frame ends once");
            match end {
                FrameEnd::Published => counts.published += 1,
                FrameEnd::Superseded => counts.superseded += 1,
                FrameEnd::Failed => counts.failed += 1,
            }
        });
    }

    /// The counts now; they always balance.
    pub fn counts(&self) -> Counts {
        *self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }

    fn update(&self, change: impl FnOnce(&mut Counts)) {
        let mut counts = self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        change(&mut counts);
        debug_assert!(counts.balances());
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[derive(Debug, Clone, Copy)]
    enum Step {
        Capture,
        End(FrameEnd),
    }

    fn step() -> impl Strategy<Value = Step> {
        prop_oneof![
            2 => Just(Step::Capture),
            1 => Just(Step::End(FrameEnd::Published)),
            1 => Just(Step::End(FrameEnd::Superseded)),
            1 => Just(Step::End(FrameEnd::Failed)),
        ]
    }

    proptest! {
        #[test]
        fn counts_balance_after_any_history(steps in prop::collection::vec(step(), 0..200)) {
            let ledger = Ledger::default();
            let mut ends = [0_u64; 3];
            for step in steps {
                match step {
                    Step::Capture => ledger.captured(),
                    Step::End(end) if ledger.counts().in_flight > 0 => {
                        ledger.ended(end);
                        ends[end as usize] += 1;
                    }
                    Step::End(_) => {}
                }
                prop_assert!(ledger.counts().balances());
            }
            let counts = ledger.counts();
            prop_assert_eq!([counts.published, counts.superseded, counts.failed], ends);
        }
    }

    #[test]
    #[should_panic(expected = "ends once")]
    fn finishing_a_frame_twice_panics() {
        let ledger = Ledger::default();
        ledger.captured();
        ledger.ended(FrameEnd::Published);
        ledger.ended(FrameEnd::Published);
    }

    #[test]
    fn counts_seen_from_another_thread_always_balance() {
        let ledger = Ledger::default();
        std::thread::scope(|scope| {
            for _ in 0..2 {
                scope.spawn(|| {
                    for _ in 0..10_000 {
                        ledger.captured();
                        ledger.ended(FrameEnd::Superseded);
                    }
                });
            }
            for _ in 0..1_000 {
                assert!(ledger.counts().balances());
            }
        });
        assert_eq!(ledger.counts(), Counts { captured: 20_000, superseded: 20_000, ..Counts::default() });
    }
}
