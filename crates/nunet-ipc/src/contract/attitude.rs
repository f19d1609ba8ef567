//! The payload of the topic `attitude`.

use bytemuck::Zeroable as _;
use nunet_types::contract_struct;
use nunet_types::layout::FieldType;

use super::CONTRACT_VERSION;

/// The name under which other languages know [`AttitudeRecord`].
pub const ATTITUDE_TYPE_NAME: &str = "nunet.v1.AttitudeRecord";

/// Samples that a record has room for: more than a second of a sensor with 200 per second.
pub const MAX_ATTITUDE_SAMPLES: usize = 256;

contract_struct! {
    /// The attitude of the robot's base at one time (REP 103: x forward, y left, z up).
    AttitudeSample, 16 bytes {
        /// When it was measured, nanoseconds of the header's `capture_clock`.
        pub capture_nanos: i64,
        /// Rotation about x, radians. Positive: the right side is lower.
        pub roll_rad: f32,
        /// Rotation about y, radians. Positive: the front is lower.
        pub pitch_rad: f32,
    }
}

impl FieldType for AttitudeSample {
    const KIND: &'static str = "nunet.v1.AttitudeSample";
}

contract_struct! {
    /// The last samples of the attitude of the robot's base, so that a frame which is processed later finds
    /// the sample of its capture time.
    AttitudeRecord, 4160 bytes {
        /// [`CONTRACT_VERSION`].
        pub contract_version: u32,
        /// How many of `samples` are in use.
        pub sample_count: u32,
        /// Zero; room for later fields.
        pub reserved: [u8; 56],
        /// The samples, oldest first. Unused entries are undefined.
        pub samples: [AttitudeSample; MAX_ATTITUDE_SAMPLES],
    }
}

impl Default for AttitudeRecord {
    /// No samples.
    fn default() -> Self {
        Self { contract_version: CONTRACT_VERSION, ..Self::zeroed() }
    }
}

impl AttitudeRecord {
    /// The samples in use, oldest first; a count beyond the array is cut to it.
    #[must_use]
    pub fn samples(&self) -> &[AttitudeSample] {
        &self.samples[..(self.sample_count as usize).min(MAX_ATTITUDE_SAMPLES)]
    }

    /// Adds a sample as the newest one. A full record drops its oldest.
    pub fn push(&mut self, sample: AttitudeSample) {
        let count = self.samples().len();
        let place = if count == MAX_ATTITUDE_SAMPLES {
            self.samples.copy_within(1.., 0);
            count - 1
        } else {
            count
        };
        self.samples[place] = sample;
        self.sample_count = place as u32 + 1;
    }

    /// The sample nearest to a time, nanoseconds of the samples' clock; the newest of several at the same
    /// distance.
    #[must_use]
    pub fn nearest(&self, nanos: i64) -> Option<&AttitudeSample> {
        self.samples().iter().rev().min_by_key(|sample| sample.capture_nanos.abs_diff(nanos))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(capture_nanos: i64) -> AttitudeSample {
        AttitudeSample { capture_nanos, ..AttitudeSample::zeroed() }
    }

    #[test]
    fn a_full_record_drops_its_oldest_sample() {
        let mut record = AttitudeRecord::default();
        assert_eq!(record.nearest(0), None);
        (0..MAX_ATTITUDE_SAMPLES as i64 + 3).for_each(|nanos| record.push(sample(nanos)));
        let times: Vec<i64> = record.samples().iter().map(|sample| sample.capture_nanos).collect();
        assert_eq!((times.len(), times[0], times[255]), (MAX_ATTITUDE_SAMPLES, 3, 258));
        record.sample_count = u32::MAX; // as a hostile sender might write
        assert_eq!(record.samples().len(), MAX_ATTITUDE_SAMPLES);
    }

    #[test]
    fn the_nearest_sample_is_found_before_between_and_after_all() {
        let mut record = AttitudeRecord::default();
        [10, 20, 40].into_iter().for_each(|nanos| record.push(sample(nanos)));
        let nearest = |nanos| record.nearest(nanos).unwrap().capture_nanos;
        let times = [i64::MIN, 14, 15, 29, 31, i64::MAX].map(nearest);
        assert_eq!(times, [10, 10, 20, 20, 40, 40]);
    }
}
