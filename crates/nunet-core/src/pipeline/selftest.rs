//! The self-test of the network.

use nunet_types::ImageSize;

use super::{Pipeline, PipelineError};
use crate::clock::Clock;
use crate::graph::GraphOutputs;
use crate::model::{SelfTestGrid, SelfTestReport, selftest};

impl Pipeline {
    /// Runs the self-test image and compares the outputs with those in the model file. Also warms up the
    /// network. State is reset before and after. Only the network is tested, not the filters.
    ///
    /// # Errors
    /// Outputs that differ by more than the tolerance, and ONNX Runtime's errors.
    pub fn selftest(&mut self, clock: &dyn Clock) -> Result<SelfTestReport, PipelineError> {
        let ImageSize { width, height } = self.network.graph.size();
        let pixels = self.network.graph.size().pixel_count();
        let (mut depth, mut labels) =
            (vec![0.0; pixels], self.network.graph.has_labels().then(|| vec![0; pixels]));
        let image = selftest::image(width, height);

        self.network.graph.reset();
        let (input, _) = self.network.input.fill(&image);
        self.network.graph.run(
            input,
            GraphOutputs { depth: &mut depth, labels: labels.as_deref_mut(), confidence: None },
            clock,
        )?;
        self.network.graph.reset();

        self.decoder.decode_unscaled(&mut depth);
        match &self.network.graph.description().selftest {
            Some(expected) => {
                Ok(expected.compare(&SelfTestGrid::of(&depth, labels.as_deref(), width, height))?)
            }
            None => Ok(SelfTestReport::UNCHECKED),
        }
    }
}
