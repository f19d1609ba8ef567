//! How stable depth is over a stream: drift and flicker of its frames, and when they are too much.

use serde::Serialize;

/// The recent values are means over about this number of frames, and known after as many.
pub const STABILITY_FRAMES: u32 = 8;

/// Drift and flicker of a stream. Shares: 0.01 is one percent.
#[derive(Debug, Clone, Default)]
pub struct StabilityTotals {
    /// Drift and flicker of the last frames.
    recent: [f64; 2],
    /// Frames in a row whose change is known, up to [`STABILITY_FRAMES`].
    in_a_row: u32,
    limit: Option<f64>,
    /// Sums over all frames whose change is known.
    sums: [f64; 2],
    frames: u64,
    unstable_frames: u64,
}

/// Drift and flicker per frame; each a share, 0.01 is one percent.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Stability {
    /// The growth of the scale; negative if it became smaller.
    pub drift: f64,
    /// By how much points changed besides the scale.
    pub flicker: f64,
}

/// The stability of a whole stream.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct StabilitySummary {
    /// Frames whose image did not change, so that their depth could be compared with that of the frame
    /// before.
    pub frames: u64,
    /// Mean over these frames; `null` without any.
    pub drift: Option<f64>,
    /// Mean over these frames; `null` without any.
    pub flicker: Option<f64>,
    /// Frames at which recent drift or flicker was above the limit.
    pub unstable_frames: u64,
}

impl StabilityTotals {
    /// Sets the share above which recent drift or flicker is too much; `None` for never.
    pub fn set_limit(&mut self, limit: Option<f64>) {
        self.limit = limit;
    }

    /// Adds a frame: its drift and flicker, `None` if they are unknown, which starts the recent values again.
    /// So do values that are not finite: one of them would remain in all later means.
    pub fn add(&mut self, change: Option<Stability>) {
        let is_finite = |change: &Stability| change.drift.is_finite() && change.flicker.is_finite();
        let Some(Stability { drift, flicker }) = change.filter(is_finite) else {
            self.in_a_row = 0;
            return;
        };
        self.in_a_row = (self.in_a_row + 1).min(STABILITY_FRAMES);
        // The mean of the first frames, then an exponential one.
        let weight = 1.0 / f64::from(self.in_a_row);
        for (recent, value) in self.recent.iter_mut().zip([drift, flicker]) {
            // The first frame replaces what was before.
            *recent = if self.in_a_row == 1 { value } else { *recent + weight * (value - *recent) };
        }
        self.sums = [self.sums[0] + drift, self.sums[1] + flicker];
        self.frames += 1;
        self.unstable_frames += u64::from(self.is_unstable());
    }

    /// The mean of the last frames; `None` unless the image did not change for [`STABILITY_FRAMES`] frames.
    #[must_use]
    pub fn recent(&self) -> Option<Stability> {
        let [drift, flicker] = self.recent;
        (self.in_a_row == STABILITY_FRAMES).then_some(Stability { drift, flicker })
    }

    /// Whether recent drift or flicker is above the limit.
    #[must_use]
    pub fn is_unstable(&self) -> bool {
        let is_above = |recent: Stability, limit| recent.drift.abs() > limit || recent.flicker > limit;
        self.recent().zip(self.limit).is_some_and(|(recent, limit)| is_above(recent, limit))
    }

    /// The stability of the whole stream.
    #[must_use]
    pub fn summary(&self) -> StabilitySummary {
        let mean = |sum: f64| (self.frames > 0).then(|| sum / self.frames as f64);
        StabilitySummary {
            frames: self.frames,
            drift: mean(self.sums[0]),
            flicker: mean(self.sums[1]),
            unstable_frames: self.unstable_frames,
        }
    }

    /// Adds the sums of another stream. The recent values stay those of this one.
    pub(crate) fn join(&mut self, other: &Self) {
        self.sums = [self.sums[0] + other.sums[0], self.sums[1] + other.sums[1]];
        self.frames += other.frames;
        self.unstable_frames += other.unstable_frames;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const QUIET: Stability = Stability { drift: 0.0, flicker: 0.0 };

    fn totals(changes: impl IntoIterator<Item = Option<Stability>>) -> StabilityTotals {
        let mut totals = StabilityTotals::default();
        totals.set_limit(Some(0.05));
        changes.into_iter().for_each(|change| totals.add(change));
        totals
    }

    #[test]
    fn a_constant_drift_is_its_own_mean_after_eight_frames() {
        let change = Stability { drift: -0.125, flicker: 0.25 };
        assert_eq!(totals([Some(change); 7]).recent(), None);
        let after = totals([Some(change); 8]);
        assert_eq!(after.recent(), Some(change));
        assert!(after.is_unstable());
        let summary =
            StabilitySummary { frames: 8, drift: Some(-0.125), flicker: Some(0.25), unstable_frames: 1 };
        assert_eq!(after.summary(), summary);
    }

    #[test]
    fn a_frame_with_another_image_makes_the_recent_values_unknown() {
        let change = Some(Stability { drift: 0.5, flicker: 0.5 });
        let frames = [change; 8].into_iter().chain([None]).chain([Some(QUIET); 8]);
        let mut after = totals(frames.clone().take(9));
        assert_eq!((after.recent(), after.is_unstable()), (None, false));
        after = totals(frames);
        assert_eq!(after.recent(), Some(QUIET), "the earlier frames do not count");
        assert_eq!(after.summary().frames, 16);
    }

    #[test]
    fn values_that_are_not_finite_are_unknown() {
        let change = Stability { drift: 0.25, flicker: 0.5 };
        for wrong in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            for bad in [Stability { drift: wrong, ..change }, Stability { flicker: wrong, ..change }] {
                let after = totals([change, bad].into_iter().chain([change; 8]).map(Some));
                assert_eq!(after.recent(), Some(change));
                let StabilitySummary { frames, drift, flicker, .. } = after.summary();
                assert_eq!((frames, drift, flicker), (9, Some(0.25), Some(0.5)));
                assert_eq!(totals([change; 7].into_iter().chain([bad]).map(Some)).recent(), None);
            }
        }
    }

    #[test]
    fn one_bad_frame_in_eight_is_less_than_lasting_flicker() {
        let step = Stability { drift: 0.2, flicker: 0.0 };
        let one = totals([Some(step)].into_iter().chain([Some(QUIET); 7]));
        assert!(!one.is_unstable() && (one.recent().unwrap().drift - 0.025).abs() < 1e-12);
        assert!(totals([Some(Stability { drift: 0.0, flicker: 0.06 }); 8]).is_unstable());
        assert!(!totals([Some(Stability { drift: -0.05, flicker: 0.05 }); 8]).is_unstable(), "at the limit");
        let mut without = totals([]);
        without.set_limit(None);
        (0..9).for_each(|_| without.add(Some(step)));
        assert!(!without.is_unstable());
    }

    #[test]
    fn streams_are_joined_by_their_frames_and_an_empty_one_has_no_mean() {
        let mut both = totals([Some(Stability { drift: 0.1, flicker: 0.3 }); 2]);
        both.join(&totals([Some(Stability { drift: 0.4, flicker: 0.0 })]));
        let StabilitySummary { frames, drift, flicker, .. } = both.summary();
        assert_eq!(frames, 3);
        assert!((drift.unwrap() - 0.2).abs() < 1e-12 && (flicker.unwrap() - 0.2).abs() < 1e-12);
        assert_eq!(totals([None]).summary().drift, None);
    }
}
