//! Shared memory for results: the planned topics, and the chunks for the results of one frame.

use anyhow::Context as _;
use nunet_core::obstacle::{ObstacleOptions, Obstacles};
use nunet_core::pipeline::{Outputs, Pipeline};
use nunet_ipc::{CloudPoint, Loan, ObstacleRecord, StatsRecord, Topic, TopicPlan};
use nunet_sink::obstacle_record::fill_record;

use crate::config::Publish;

/// Chunks of shared memory for one frame's results.
pub(crate) struct Loans {
    pub(super) depth: Loan,
    pub(super) labels: Option<Loan>,
    pub(super) confidence: Option<Loan>,
    pub(super) cloud: Option<Loan>,
    pub(super) obstacles: Option<Loan>,
}

impl Loans {
    /// The buffers for the pipeline. Labels go into `spare_labels` if nobody needs them; the confidence stays
    /// inside then.
    pub(crate) fn outputs<'a>(
        &'a mut self,
        spare_labels: Option<&'a mut [u8]>,
    ) -> anyhow::Result<Outputs<'a>> {
        let points = self.cloud.as_mut().map(Loan::slice_mut).transpose()?;
        Ok(Outputs {
            depth_m: self.depth.slice_mut()?,
            labels: self.labels.as_mut().map(Loan::bytes_mut).or(spare_labels),
            confidence: self.confidence.as_mut().map(Loan::bytes_mut),
            cloud: points,
        })
    }

    /// Writes the obstacles of the frame, if a reader or a sink needs them.
    pub(crate) fn set_obstacles(
        &mut self,
        found: &Obstacles,
        options: &ObstacleOptions,
        used_attitude: bool,
    ) -> anyhow::Result<()> {
        let Some(loan) = &mut self.obstacles else { return Ok(()) };
        let record = loan.slice_mut::<ObstacleRecord>()?.first_mut();
        let record = record.context("the chunk is too small for the obstacles")?;
        fill_record(record, found, options, used_attitude);
        Ok(())
    }
}

/// The topics of a pipeline's results.
pub(crate) fn plans(pipeline: &Pipeline, publish: &[Publish], obstacles: bool) -> Vec<TopicPlan> {
    let (pixels, points) = (pipeline.size().pixel_count(), pipeline.cloud_size().pixel_count());
    let labels = publish.contains(&Publish::Labels) && pipeline.graph().has_labels();
    let confidence = publish.contains(&Publish::Confidence) && pipeline.graph().has_confidence();
    let cloud = publish.contains(&Publish::Cloud);
    let all = [
        (true, Topic::Depth, pixels * size_of::<f32>()),
        (labels, Topic::Labels, pixels),
        (confidence, Topic::Confidence, pixels),
        (cloud, Topic::Cloud, points * size_of::<CloudPoint>()),
        (obstacles, Topic::Obstacles, size_of::<ObstacleRecord>()),
        (true, Topic::Stats, size_of::<StatsRecord>()),
    ];
    let wanted = all.into_iter().filter(|(wanted, ..)| *wanted);
    wanted.map(|(_, topic, payload_bytes)| TopicPlan { topic, payload_bytes }).collect()
}
