//! The confidence of depth, at the size of the results.

use crate::depth::BorderFill;
use crate::filter::Decimation;
use crate::graph::SerialGraph;

/// The confidence of the last frame's depth; 0 where depth is invalid or was filled in by a filter. Nothing is done for a
/// network without one.
pub(super) struct ConfidenceMap {
    /// `[H, W]` at the network's size; empty if the network has no confidence.
    network: Vec<u8>,
    /// `[H, W]` at the size of the results; empty without decimation.
    reduced: Vec<u8>,
}

impl ConfidenceMap {
    pub(super) fn new(graph: &SerialGraph, decimation: Option<&Decimation>) -> Self {
        let bytes = |pixels| vec![0; if graph.has_confidence() { pixels } else { 0 }];
        let reduced = decimation.map_or(0, |decimation| decimation.size().pixel_count());
        Self { network: bytes(graph.size().pixel_count()), reduced: bytes(reduced) }
    }

    /// Takes what the network gave for a frame, if it has a confidence.
    pub(super) fn take(&mut self, network: Option<&[u8]>) {
        if let Some(values) = network {
            self.network.copy_from_slice(values);
        }
    }

    /// Bytes that are copied for each frame.
    pub(super) fn bytes_copied(&self) -> u64 {
        self.network.len() as u64
    }

    /// Adapts it to decoded depth at the network's size. At the border it is that of the pixels whose depth is taken.
    pub(super) fn of_decoded(&mut self, border: Option<BorderFill>, depth: &[f32]) -> Option<&[u8]> {
        if let Some(border) = border {
            border.apply(&mut self.network);
        }
        blank(&mut self.network, depth);
        (!self.network.is_empty()).then_some(&self.network)
    }

    /// Adapts it to depth after the filters. With decimation, it is the mean of each block.
    pub(super) fn finish(&mut self, decimation: Option<&Decimation>, depth: &[f32]) {
        match decimation.filter(|_| !self.reduced.is_empty()) {
            None => blank(&mut self.network, depth),
            Some(decimation) => {
                decimation.mean_of_blocks(&self.network, &mut self.reduced);
                blank(&mut self.reduced, depth);
            }
        }
    }

    /// `[H, W]` at the size of the results; `None` if the network has no confidence.
    pub(super) fn values(&self) -> Option<&[u8]> {
        let values = if self.reduced.is_empty() { &self.network } else { &self.reduced };
        (!values.is_empty()).then_some(values)
    }
}

fn blank(values: &mut [u8], depth: &[f32]) {
    for (value, depth) in values.iter_mut().zip(depth) {
        if depth.is_nan() {
            *value = 0;
        }
    }
}
