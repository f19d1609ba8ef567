//! A series of measured times, for benchmarks.

use serde_json::{Value, json};

/// The columns of [`Series::row`].
pub const SERIES_HEAD: &str =
    "ms                  mean       min       p50       p90       p99      p999       max";

/// All times in milliseconds: a benchmark has few.
#[derive(Debug, Default)]
pub struct Series(Vec<f64>);

impl Series {
    /// Adds a time, microseconds.
    pub fn add_micros(&mut self, micros: f64) {
        self.0.push(micros / 1e3);
    }

    /// The mean; 0 for an empty series.
    #[must_use]
    pub fn mean_ms(&self) -> f64 {
        self.0.iter().sum::<f64>() / self.0.len().max(1) as f64
    }

    /// The smallest time, in milliseconds, that a share of `quantile` does not exceed.
    #[must_use]
    pub fn quantile(&self, quantile: f64) -> f64 {
        let mut sorted = self.0.clone();
        sorted.sort_by(f64::total_cmp);
        let rank = (quantile * sorted.len() as f64).ceil() as usize;
        sorted.get(rank.saturating_sub(1)).copied().unwrap_or_default()
    }

    fn columns(&self) -> [(&'static str, f64); 7] {
        [
            ("mean", self.mean_ms()),
            ("min", self.quantile(0.0)),
            ("p50", self.quantile(0.5)),
            ("p90", self.quantile(0.9)),
            ("p99", self.quantile(0.99)),
            ("p999", self.quantile(0.999)),
            ("max", self.quantile(1.0)),
        ]
    }

    /// Mean and quantiles by their names, milliseconds.
    #[must_use]
    pub fn json(&self) -> Value {
        self.columns().into_iter().map(|(name, ms)| (name.to_owned(), json!(ms))).collect()
    }

    /// A line of a table, below [`SERIES_HEAD`].
    #[must_use]
    pub fn row(&self, name: &str) -> String {
        let cells: String = self.columns().iter().map(|(_, ms)| format!("{ms:>10.2}")).collect();
        format!("{name:<14}{cells}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_times_that_were_measured() {
        let mut series = Series::default();
        for ms in [5.0, 1.0, 4.0, 2.0, 3.0] {
            series.add_micros(ms * 1e3);
        }
        let columns: std::collections::HashMap<_, _> = series.columns().into_iter().collect();
        assert_eq!([columns["min"], columns["p50"], columns["p90"], columns["max"]], [1.0, 3.0, 5.0, 5.0]);
        assert!((columns["mean"] - 3.0).abs() < 1e-9);
    }

    #[test]
    fn an_empty_series_is_zero() {
        assert_eq!(Series::default().quantile(0.5), 0.0);
    }
}
