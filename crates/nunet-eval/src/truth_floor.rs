//! Warns of a mount that the floor of the true depth contradicts.
//!
//! True depth has no error, so the scores of obstacles say little if its floor is not where the mount expects
//! it.

use nunet_core::camera::Mount;
use nunet_core::depth::DepthImage;
use nunet_core::obstacle::{FloorMismatch, ObstacleDetector, Obstacles};
use nunet_types::{Hint as _, counted};

use crate::event::{Event, OnEvent};

/// Without labels, a plane in the lower half of an image may be a table. So many images must have one.
const UNLABELED: usize = 3;

/// Counts the images whose true floor contradicts their mount.
#[derive(Debug, Default)]
pub(crate) struct TruthFloor {
    /// The images that show floor.
    with_floor: usize,
    contradicting: usize,
    /// Whether any of these images has labels of floor.
    has_labels: bool,
    /// The first of these.
    first: Option<(String, FloorMismatch)>,
}

impl TruthFloor {
    /// Counts an image whose true depth `detector` has processed.
    pub(crate) fn add(
        &mut self,
        id: &str,
        detector: &ObstacleDetector,
        mount: &Mount,
        truth: &DepthImage<'_>,
    ) {
        let Obstacles { ground, used_labels, .. } = detector.last();
        if ground.is_refined && ground.is_near_expected() {
            self.with_floor += 1;
        } else if let Some(seen) = detector.floor_view(truth) {
            self.with_floor += 1;
            if let Some(found) = FloorMismatch::of_frames(seen, mount) {
                self.contradicting += 1;
                self.has_labels |= *used_labels;
                self.first.get_or_insert_with(|| (id.to_owned(), found));
            }
        }
    }

    /// Reports a mount that more than half of the images with floor contradict, and returns whether it did.
    pub(crate) fn report(&self, on_event: OnEvent<'_>) -> bool {
        let Self { with_floor, contradicting, has_labels, first } = self;
        let needed = if *has_labels { 1 } else { UNLABELED };
        let is_most = 2 * contradicting > *with_floor && *contradicting >= needed;
        let Some((id, found)) = first.as_ref().filter(|_| is_most) else { return false };
        let images = counted(*with_floor, "image");
        let text = format!(
            "the true floor contradicts the mount in {contradicting} of {images} with floor, first in `{id}`: \
             {found}"
        );
        on_event(Event::WrongMount { text: &text, hint: &found.hint().unwrap_or_default() });
        true
    }
}
