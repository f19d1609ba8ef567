//! From the camera's image to the network's raw outputs, pixel on pixel with the results.

use nunet_types::ImageSize;

use super::PipelineError;
use super::input::GraphImage;
use super::letterbox::Letterbox;
use super::timer::StageTimer;
use crate::clock::Clock;
use crate::filter::Appearance;
use crate::frame::ImageView;
use crate::framing::{AspectMode, Framing};
use crate::graph::{GraphOutputs, GraphReport, SerialGraph};
use crate::preprocess::{Preprocessor, TensorFormat};

/// The mean color of the training images as the recipe subtracts it, for padding.
const MEAN_COLOR: [u8; 3] = [127; 3];

/// The graph with what converts its image.
pub(super) struct Network {
    framing: Framing,
    preprocessor: Preprocessor,
    letterbox: Option<Letterbox>,
    pub(super) input: GraphImage,
    pub(super) graph: SerialGraph,
}

impl Network {
    /// For images of the network's size.
    pub(super) fn new(graph: SerialGraph) -> Self {
        let size = graph.size();
        Self {
            framing: Framing::new(AspectMode::Stretch, size, size),
            preprocessor: Preprocessor::new(size.width, size.height),
            letterbox: None,
            input: GraphImage::new(&graph),
            graph,
        }
    }

    pub(super) fn framing(&self) -> &Framing {
        &self.framing
    }

    /// Takes images of another size.
    pub(super) fn set_framing(&mut self, framing: Framing) {
        let ImageSize { width, height } = framing.target().size();
        if framing.target() != self.framing.target() {
            self.preprocessor = Preprocessor::new(width, height);
            let color = self.graph.float_input().map_or(MEAN_COLOR, TensorFormat::mean_color);
            self.letterbox = framing.is_padded().then(|| Letterbox::new(&framing, color, &self.graph));
        }
        self.preprocessor.set_view(framing.is_cropped().then(|| framing.view()));
        self.framing = framing;
    }

    /// Runs the graph on a frame; returns its report and how many bytes were copied for its input. With
    /// padding, the results stay inside until [`Self::take_results`].
    pub(super) fn run(
        &mut self,
        frame: &ImageView<'_>,
        results: GraphOutputs<'_>,
        clock: &dyn Clock,
        timer: &mut StageTimer<'_>,
    ) -> Result<(GraphReport, u64), PipelineError> {
        let Self { preprocessor, letterbox: Some(letterbox), input, graph, .. } = self else {
            let (input, bytes_copied) = timer.time(|| {
                let image = self.preprocessor.prepare(frame);
                let (input, bytes_filled) = self.input.fill(image.rgb);
                (input, image.bytes_copied + bytes_filled)
            });
            return Ok((timer.extend(self.graph.run(input, results, clock)?), bytes_copied));
        };
        let Letterbox { canvas, inner } = letterbox;
        let (input, bytes_copied) = timer.time(|| {
            let image = preprocessor.prepare(frame);
            let (rgb, bytes_padded) = canvas.pad(image.rgb);
            inner.take_colors(rgb);
            let (input, bytes_filled) = input.fill(rgb);
            (input, image.bytes_copied + bytes_padded + bytes_filled)
        });
        let padded = GraphOutputs { depth: &mut inner.depth, labels: None, confidence: None };
        Ok((timer.extend(graph.run(input, padded, clock)?), bytes_copied))
    }

    /// Fills `results` if they have not been filled by [`Self::run`]: without the padding. Returns how many
    /// bytes were copied.
    pub(super) fn take_results(&mut self, results: GraphOutputs<'_>) -> u64 {
        let Some(Letterbox { inner, .. }) = &mut self.letterbox else { return 0 };
        inner.take_results(results, &self.graph)
    }

    /// The confidence of the last frame's depth, pixel on pixel with the results, if the network has one. It
    /// is valid only if it was not written into the caller's memory.
    pub(super) fn confidence(&self) -> Option<&[u8]> {
        let padded = self.graph.confidence()?;
        Some(self.letterbox.as_ref().map_or(padded, |letterbox| &letterbox.inner.confidence[..]))
    }

    /// The same, to be adapted.
    pub(super) fn confidence_mut(&mut self) -> Option<&mut [u8]> {
        let padded = self.graph.confidence_mut()?;
        Some(self.letterbox.as_mut().map_or(padded, |letterbox| &mut letterbox.inner.confidence[..]))
    }

    /// Colors and labels of the last frame, which was `frame`, pixel on pixel with the results. Labels are
    /// valid only if they were not written into the caller's memory.
    pub(super) fn appearance<'a>(&'a self, frame: &ImageView<'a>) -> Appearance<'a> {
        match &self.letterbox {
            None => Appearance { rgb: self.preprocessor.last(frame), labels: self.graph.labels() },
            Some(Letterbox { inner, .. }) => {
                Appearance { rgb: &inner.rgb, labels: self.graph.labels().map(|_| &inner.labels[..]) }
            }
        }
    }
}
