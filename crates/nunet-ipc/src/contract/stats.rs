//! The payload of the topic `stats`.

use std::borrow::Cow;

use nunet_types::contract_struct;

use super::header::{CONTRACT_VERSION, MAX_STAGES};
use super::text::{set_text, text};

/// Bytes of a stage's name in a [`StatsRecord`].
pub const STAGE_NAME_BYTES: usize = 32;

/// The name under which other languages know [`StatsRecord`].
pub const STATS_TYPE_NAME: &str = "nunet.v1.StatsRecord";

contract_struct! {
    /// The daemon's stats: counts of frames, rates, and latencies in microseconds.
    ///
    /// `captured = published + superseded + failed + in_flight`, always.
    StatsRecord, 2560 bytes {
        /// [`CONTRACT_VERSION`].
        pub contract_version: u32,
        /// How many stages there are.
        pub stage_count: u32,
        /// Frames that the source delivered.
        pub captured: u64,
        /// Frames whose depth was published.
        pub published: u64,
        /// Frames that a newer one replaced before they were processed.
        pub superseded: u64,
        /// Frames that ended with an error.
        pub failed: u64,
        /// Frames that have not ended yet.
        pub in_flight: u64,
        /// Published frames a second, since the first one.
        pub fps: f64,
        /// Mean bytes copied, a frame.
        pub bytes_copied_per_frame: f64,
        /// Mean heap allocations of our crates, a frame; NaN when they are not counted.
        pub allocations_per_frame: f64,
        /// The median time from the image's arrival at the daemon to publication.
        pub total_p50_us: f64,
        /// The 90th percentile.
        pub total_p90_us: f64,
        /// The 99th percentile.
        pub total_p99_us: f64,
        /// The slowest frame.
        pub total_max_us: f64,
        /// The mean.
        pub total_mean_us: f64,
        /// SHA-256 of the model.
        pub model_hash: [u8; 32],
        /// The model file's name, UTF-8, padded with zeros.
        pub model_name: [u8; 64],
        /// The execution provider, UTF-8, padded with zeros.
        pub provider: [u8; 32],
        /// The stages' names in the order of [`FrameHeader::stage_micros`](crate::FrameHeader).
        pub stage_names: [[u8; STAGE_NAME_BYTES]; MAX_STAGES],
        /// Each stage's median.
        pub stage_p50_us: [f64; MAX_STAGES],
        /// Each stage's 90th percentile.
        pub stage_p90_us: [f64; MAX_STAGES],
        /// Each stage's 99th percentile.
        pub stage_p99_us: [f64; MAX_STAGES],
        /// Each stage's slowest run.
        pub stage_max_us: [f64; MAX_STAGES],
        /// Each stage's mean.
        pub stage_mean_us: [f64; MAX_STAGES],
        /// 1 if `depth_drift` and `depth_flicker` are known, 0 if not: the image changes.
        pub has_stability: u32,
        /// 1 while drift or flicker is above the daemon's limit.
        pub is_unstable: u32,
        /// Growth of the depth's scale per frame, mean of the last frames; 0.01 is one percent.
        pub depth_drift: f64,
        /// Change of points per frame beside the scale, mean of the last frames; 0.01 is one percent.
        pub depth_flicker: f64,
        /// Zero; room for later fields. Public only so that `..Default::default()` works.
        pub reserved: [u8; 1144],
    }
}

impl Default for StatsRecord {
    /// No frames and no stages; allocations are not counted.
    fn default() -> Self {
        Self {
            contract_version: CONTRACT_VERSION,
            stage_count: 0,
            captured: 0,
            published: 0,
            superseded: 0,
            failed: 0,
            in_flight: 0,
            fps: 0.0,
            bytes_copied_per_frame: 0.0,
            allocations_per_frame: f64::NAN,
            total_p50_us: 0.0,
            total_p90_us: 0.0,
            total_p99_us: 0.0,
            total_max_us: 0.0,
            total_mean_us: 0.0,
            model_hash: [0; 32],
            model_name: [0; 64],
            provider: [0; 32],
            stage_names: [[0; STAGE_NAME_BYTES]; MAX_STAGES],
            stage_p50_us: [0.0; MAX_STAGES],
            stage_p90_us: [0.0; MAX_STAGES],
            stage_p99_us: [0.0; MAX_STAGES],
            stage_max_us: [0.0; MAX_STAGES],
            stage_mean_us: [0.0; MAX_STAGES],
            has_stability: 0,
            is_unstable: 0,
            depth_drift: 0.0,
            depth_flicker: 0.0,
            reserved: [0; 1144],
        }
    }
}

impl StatsRecord {
    /// The names of the stages in use, in the order of their run.
    pub fn stage_names(&self) -> impl ExactSizeIterator<Item = Cow<'_, str>> {
        let count = (self.stage_count as usize).min(MAX_STAGES);
        self.stage_names[..count].iter().map(|name| text(name))
    }

    /// Sets the stages' names; those beyond [`MAX_STAGES`] are dropped, long ones cut.
    pub fn set_stage_names<'a>(&mut self, names: impl IntoIterator<Item = &'a str>) {
        self.stage_names = [[0; STAGE_NAME_BYTES]; MAX_STAGES];
        self.stage_count = 0;
        for (slot, name) in self.stage_names.iter_mut().zip(names) {
            set_text(slot, name);
            self.stage_count += 1;
        }
    }

    /// Drift and flicker of depth, shares per frame; `None` if they are unknown.
    #[must_use]
    pub fn stability(&self) -> Option<[f64; 2]> {
        (self.has_stability == 1).then_some([self.depth_drift, self.depth_flicker])
    }

    /// Sets drift and flicker of depth.
    pub fn set_stability(&mut self, stability: Option<[f64; 2]>) {
        self.has_stability = stability.is_some().into();
        [self.depth_drift, self.depth_flicker] = stability.unwrap_or_default();
    }

    /// The model file's name.
    #[must_use]
    pub fn model_name(&self) -> Cow<'_, str> {
        text(&self.model_name)
    }

    /// Sets the model file's name, cut to 64 bytes.
    pub fn set_model_name(&mut self, name: &str) {
        set_text(&mut self.model_name, name);
    }

    /// The execution provider.
    #[must_use]
    pub fn provider(&self) -> Cow<'_, str> {
        text(&self.provider)
    }

    /// Sets the execution provider, cut to 32 bytes.
    pub fn set_provider(&mut self, name: &str) {
        set_text(&mut self.provider, name);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stability_of_an_older_daemon_is_unknown() {
        let mut record = StatsRecord::default();
        assert_eq!(record.stability(), None);
        record.set_stability(Some([-0.01, 0.02]));
        assert_eq!(record.stability(), Some([-0.01, 0.02]));
        record.set_stability(None);
        assert_eq!((record.stability(), record.depth_flicker), (None, 0.0));
    }

    #[test]
    fn stage_names_read_back_as_they_were_set() {
        let mut record = StatsRecord::default();
        record.set_stage_names(["preprocess", "segmentation", "depth"]);
        assert_eq!(record.stage_names().collect::<Vec<_>>(), ["preprocess", "segmentation", "depth"]);
    }
}
