//! The confidence of depth, at the size of the results.

use super::network::Network;
use crate::filter::{Decimation, FilterError};
use crate::graph::SerialGraph;

/// Where the confidence of the last frame is; 0 where depth is invalid or was filled in by a filter.
///
/// It is adapted in the memory that the network wrote, the caller's or its own. Only decimation makes another
/// map.
pub(super) struct ConfidenceMap {
    /// `[H, W]` at the size of the results; empty without decimation, and for a network without confidence.
    reduced: Vec<u8>,
    /// Whether the last one was written into the caller's memory.
    is_left: bool,
}

impl ConfidenceMap {
    pub(super) fn new(graph: &SerialGraph, decimation: Option<&Decimation>) -> Self {
        let decimation = decimation.filter(|_| graph.has_confidence());
        let pixels = decimation.map_or(0, |decimation| decimation.size().pixel_count());
        Self { reduced: vec![0; pixels], is_left: false }
    }

    /// Takes note of where the confidence of a frame is: in `memory`, else where `network` kept it. There it
    /// is adapted to `filtered` depth, if there are filters: it is adapted to decoded depth already. With
    /// decimation, it is the mean of each block.
    pub(super) fn finish(
        &mut self,
        network: &mut Network,
        decimation: Option<&Decimation>,
        memory: Option<&mut [u8]>,
        filtered: Option<&[f32]>,
    ) -> Result<(), FilterError> {
        self.is_left = memory.is_some();
        let Some(depth) = filtered else { return Ok(()) };
        let Some(decimation) = decimation else {
            if let Some(values) = memory.or(network.confidence_mut()) {
                blank(values, depth);
            }
            return Ok(());
        };
        let Some(of_network) = network.confidence() else { return Ok(()) };
        let values = memory.unwrap_or(&mut self.reduced);
        decimation.mean_of_blocks(of_network, values)?;
        blank(values, depth);
        Ok(())
    }

    /// `[H, W]` at the size of the results; `None` if the network has none, or it was written into the
    /// caller's memory.
    pub(super) fn values<'a>(&'a self, network: &'a Network) -> Option<&'a [u8]> {
        let of_network = network.confidence().filter(|_| !self.is_left)?;
        Some(if self.reduced.is_empty() { of_network } else { &self.reduced })
    }
}

/// Writes 0 where depth is invalid.
pub(super) fn blank(values: &mut [u8], depth: &[f32]) {
    for (value, depth) in values.iter_mut().zip(depth) {
        if depth.is_nan() {
            *value = 0;
        }
    }
}
