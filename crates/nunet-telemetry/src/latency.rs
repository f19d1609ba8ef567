//! Latencies of a stream by stage, in histograms that never grow.

use hdrhistogram::Histogram;
use serde::Serialize;

/// Percentiles are capped at one minute.
const MAX_MICROS: u64 = 60_000_000;
/// Three significant digits: 0.1 %.
const DIGITS: u8 = 3;

/// Percentiles of a series of durations, in milliseconds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct LatencySummary {
    /// Median.
    pub p50: f64,
    /// 90th percentile.
    pub p90: f64,
    /// 99th percentile.
    pub p99: f64,
    /// Longest.
    pub max: f64,
    /// Mean.
    pub mean: f64,
}

/// A histogram with exact sum and maximum. Computed from buckets, the mean could exceed the maximum.
#[derive(Debug, Clone)]
struct LatencyHistogram {
    histogram: Histogram<u64>,
    max_micros: u64,
    sum_micros: u64,
}

/// Histograms of the total latency and of each stage.
#[derive(Debug, Clone)]
pub struct Latencies {
    total: LatencyHistogram,
    stages: Vec<(String, LatencyHistogram)>,
}

impl Latencies {
    /// Empty histograms for these stages.
    pub fn new<'a>(stages: impl IntoIterator<Item = &'a str>) -> Self {
        let stages = stages.into_iter().map(|name| (name.to_owned(), LatencyHistogram::default()));
        Self { total: LatencyHistogram::default(), stages: stages.collect() }
    }

    /// Adds one frame: its total, and the time of each stage in the order given to [`Latencies::new`].
    pub fn record(&mut self, total_micros: u64, stages_micros: impl IntoIterator<Item = u64>) {
        self.total.record(total_micros);
        for ((_, stage), micros) in self.stages.iter_mut().zip(stages_micros) {
            stage.record(micros);
        }
    }

    /// Adds the frames of another stream; stages are matched by name.
    pub fn join(&mut self, other: &Self) {
        self.total.join(&other.total);
        for (name, series) in &other.stages {
            match self.stages.iter_mut().find(|(own, _)| own == name) {
                Some((_, own)) => own.join(series),
                None => self.stages.push((name.clone(), series.clone())),
            }
        }
    }

    /// From the delivery by the source to the wake-up of the readers.
    pub fn total(&self) -> LatencySummary {
        self.total.summary()
    }

    /// Name and percentiles of each stage.
    pub fn stages(&self) -> impl Iterator<Item = (&str, LatencySummary)> {
        self.stages.iter().map(|(name, series)| (name.as_str(), series.summary()))
    }
}

impl Default for LatencyHistogram {
    fn default() -> Self {
        let histogram = Histogram::new_with_bounds(1, MAX_MICROS, DIGITS);
        let histogram = histogram.expect("constant bounds that the histogram accepts");
        Self { histogram, max_micros: 0, sum_micros: 0 }
    }
}

impl LatencyHistogram {
    fn record(&mut self, micros: u64) {
        self.histogram.saturating_record(micros);
        self.max_micros = self.max_micros.max(micros);
        self.sum_micros = self.sum_micros.saturating_add(micros);
    }

    fn join(&mut self, other: &Self) {
        self.histogram.add(&other.histogram).expect("histograms of the same bounds add up");
        self.max_micros = self.max_micros.max(other.max_micros);
        self.sum_micros = self.sum_micros.saturating_add(other.sum_micros);
    }

    /// Percentiles are upper edges of buckets; the last one may exceed the maximum.
    fn summary(&self) -> LatencySummary {
        if self.histogram.is_empty() {
            return LatencySummary::default();
        }
        let ms = |micros: u64| micros as f64 / 1e3;
        let quantile = |part| ms(self.histogram.value_at_quantile(part).min(self.max_micros));
        LatencySummary {
            p50: quantile(0.5),
            p90: quantile(0.9),
            p99: quantile(0.99),
            max: ms(self.max_micros),
            mean: ms(self.sum_micros) / self.histogram.len() as f64,
        }
    }
}

/// Microseconds between two times in nanoseconds; 0 if the second is earlier.
#[must_use]
pub fn micros_between(start_nanos: u64, end_nanos: u64) -> u32 {
    u32::try_from(end_nanos.saturating_sub(start_nanos) / 1000).unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_of_a_known_series() {
        let mut latencies = Latencies::new(["graph"]);
        for micros in 1..=1000 {
            latencies.record(micros * 100, [micros]);
        }
        let total = latencies.total();
        assert!((total.p50 - 50.0).abs() < 0.1, "{total:?}");
        assert!((total.p99 - 99.0).abs() < 0.2, "{total:?}");
        assert!((total.mean - 50.05).abs() < 0.1, "{total:?}");
        let (name, graph) = latencies.stages().next().unwrap();
        assert_eq!(name, "graph");
        assert!((graph.max - 1.0).abs() < 0.01, "{graph:?}");
    }

    #[test]
    fn all_percentiles_of_one_frame_are_its_time() {
        let mut latencies = Latencies::new(["graph"]);
        latencies.record(109_889, [50_021]); // near the lower edge of a bucket of 64 us, and of 32 us
        for (summary, ms) in [(latencies.total(), 109.889), (latencies.stages().next().unwrap().1, 50.021)] {
            let LatencySummary { p50, p90, p99, max, mean } = summary;
            assert_eq!([p50, p90, p99, max, mean], [ms; 5]);
        }
    }

    #[test]
    fn streams_are_joined_by_the_names_of_their_stages() {
        let stream = |names: [&'static str; 2], micros: u64| {
            let mut latencies = Latencies::new(names);
            latencies.record(10 * micros, [micros, 2 * micros]);
            latencies
        };
        let mut both = stream(["graph", "cloud"], 1000);
        both.join(&stream(["graph", "temporal"], 3000));
        let max: Vec<_> = both.stages().map(|(name, summary)| (name, summary.max.round())).collect();
        assert_eq!(max, [("graph", 3.0), ("cloud", 2.0), ("temporal", 6.0)]);
        assert!((both.total().mean - 20.0).abs() < 0.1, "{:?}", both.total());
    }

    #[test]
    fn a_stream_without_frames_has_zeros() {
        assert_eq!(Latencies::new([]).total(), LatencySummary::default());
    }

    #[test]
    fn a_time_beyond_the_range_counts_as_the_longest() {
        let mut latencies = Latencies::new([]);
        latencies.record(90_000_000, []);
        let LatencySummary { p50, max, mean, .. } = latencies.total();
        assert_eq!((max, mean), (90_000.0, 90_000.0));
        assert!((59_000.0..=61_000.0).contains(&p50), "{p50}");
    }
}
