//! Several streams through the same sessions: what one of them left, the other never sees.

use nunet_core::graph::{Quality, SerialGraph};
use nunet_testkit::{manifests, models};

use crate::{Folder, SIZE, image, run};

/// An image for each stream and frame.
fn numbered(number: u8) -> Vec<u8> {
    image(SIZE).iter().map(|value| value.wrapping_mul(2 * number + 1)).collect()
}

#[test]
fn graphs_with_shared_sessions_keep_their_own_state() {
    let load = || Folder::new().model("m.onnx", &models::remembering(SIZE)).load("m.onnx").unwrap();
    let depths = |graph: &mut SerialGraph, numbers: &[u8]| -> Vec<Vec<f32>> {
        numbers.iter().map(|&number| run(graph, &numbered(number)).depth).collect()
    };
    let (front, rear) = (depths(&mut load(), &[1, 2, 3]), depths(&mut load(), &[7, 8, 9]));
    assert_ne!(front, rear);

    let mut first = load();
    // A graph that shares its sessions begins with zeros, whatever the first has seen.
    run(&mut first, &numbered(5));
    let mut second = first.share_sessions().unwrap();
    first.reset();
    for frame in 0..3 {
        assert_eq!(run(&mut first, &numbered([1, 2, 3][frame])).depth, front[frame]);
        assert_eq!(run(&mut second, &numbered([7, 8, 9][frame])).depth, rear[frame]);
    }
    drop(first);
    second.reset();
    assert_eq!(depths(&mut second, &[7, 8, 9]), rear, "sessions live as long as one who runs them");
}

#[test]
fn graphs_with_shared_sessions_count_their_own_frames_and_reuse_their_own_results() {
    let folder = Folder::new()
        .model("segmentation.onnx", &models::segmentation_stage(SIZE))
        .model("depth.onnx", &models::depth_stage(SIZE, true))
        .text("graph.toml", &manifests::two_stages(true, 3));
    let mut first = folder.load("graph.toml").unwrap();
    let mut second = first.share_sessions().unwrap();
    let begun = run(&mut first, &numbered(1));
    let other = run(&mut second, &numbered(4));
    assert_eq!((begun.report.quality, other.report.quality), (Quality::Full, Quality::Full));
    assert_ne!(begun.labels, other.labels);
    for _ in 0..2 {
        let (again, other_again) = (run(&mut first, &numbered(2)), run(&mut second, &numbered(5)));
        assert_eq!(again.report.quality, Quality::ReusedLabels);
        assert_eq!((again.labels, other_again.labels), (begun.labels.clone(), other.labels.clone()));
    }
    assert_eq!(run(&mut first, &numbered(2)).report.quality, Quality::Full);
}
