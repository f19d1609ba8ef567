//! Latencies of a stream by stage, in histograms that never grow.

use hdrhistogram::Histogram;
use serde::Serialize;

/// The longest time that is told apart: one minute; a longer one counts as one minute.
const MAX_MICROS: u64 = 60_000_000;
/// Three significant digits: 0.1 %.
const DIGITS: u8 = 3;

/// Percentiles of a series of durations, in milliseconds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Summary {
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

/// Histograms of the total latency and of each stage.
#[derive(Debug, Clone)]
pub struct Latencies {
    total: Histogram<u64>,
    stages: Vec<(String, Histogram<u64>)>,
}

impl Latencies {
    /// Empty histograms for these stages.
    pub fn new<'a>(stages: impl IntoIterator<Item = &'a str>) -> Self {
        Self {
            total: histogram(),
            stages: stages.into_iter().map(|name| (name.to_owned(), histogram())).collect(),
        }
    }

    /// Adds one frame: its total, and the time of each stage in the order given to [`Latencies::new`].
    pub fn record(&mut self, total_micros: u64, stages_micros: impl IntoIterator<Item = u64>) {
        self.total.saturating_record(total_micros);
        for ((_, histogram), micros) in self.stages.iter_mut().zip(stages_micros) {
            histogram.saturating_record(micros);
        }
    }

    /// Another stream's frames beside these; its stages by their names.
    pub(crate) fn join(&mut self, other: &Self) {
        // All histograms have the same bounds.
        let add = |to: &mut Histogram<u64>, from| to.add(from).expect("histograms of the same bounds add up");
        add(&mut self.total, &other.total);
        for (name, histogram) in &other.stages {
            match self.stages.iter_mut().find(|(own, _)| own == name) {
                Some((_, own)) => add(own, histogram),
                None => self.stages.push((name.clone(), histogram.clone())),
            }
        }
    }

    /// From the source's hand-over to the wake-up of the readers.
    pub fn total(&self) -> Summary {
        summary(&self.total)
    }

    /// Name and percentiles of each stage.
    pub fn stages(&self) -> impl Iterator<Item = (&str, Summary)> {
        self.stages.iter().map(|(name, histogram)| (name.as_str(), summary(histogram)))
    }
}

fn histogram() -> Histogram<u64> {
    Histogram::new_with_bounds(1, MAX_MICROS, DIGITS).expect("constant bounds that the histogram accepts")
}

fn summary(histogram: &Histogram<u64>) -> Summary {
    if histogram.is_empty() {
        return Summary::default();
    }
    let ms = |micros: u64| micros as f64 / 1e3;
    Summary {
        p50: ms(histogram.value_at_quantile(0.5)),
        p90: ms(histogram.value_at_quantile(0.9)),
        p99: ms(histogram.value_at_quantile(0.99)),
        max: ms(histogram.max()),
        mean: histogram.mean() / 1e3,
    }
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
    fn a_stream_without_frames_has_zeros_and_not_nonsense() {
        assert_eq!(Latencies::new([]).total(), Summary::default());
    }

    #[test]
    fn a_time_beyond_the_range_is_kept_as_the_longest() {
        let mut latencies = Latencies::new([]);
        latencies.record(u64::MAX, []);
        assert!(latencies.total().max >= 59_000.0);
    }
}
