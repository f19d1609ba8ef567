//! `--filter`: what readers, files and recordings see of depth that was filtered.

use std::time::Instant;

use nunet_ipc::{CameraName, FrameSet, Reader, Topic};
use nunet_testkit::models;

use crate::support::{Bench, Guarded, SIZE, TIMEOUT, camera, nunetd, run_well, text};

/// Pixels on each side of a block, and blocks in the image.
const FACTOR: usize = 4;
const SMALL: (u32, u32) = (SIZE.0 / FACTOR as u32, SIZE.1 / FACTOR as u32);

fn first_set(camera: &str) -> FrameSet {
    let topics = [Topic::Depth, Topic::Labels, Topic::Cloud];
    let mut reader = Reader::open(&CameraName::new(camera).unwrap(), &topics, TIMEOUT).unwrap();
    let start = Instant::now();
    while start.elapsed() < TIMEOUT {
        if let Some(set) = reader.next_set().unwrap() {
            return set;
        }
        reader.wait(std::time::Duration::from_millis(100)).unwrap();
    }
    panic!("no complete frame within {TIMEOUT:?}")
}

/// The means and the majorities of the blocks of an image. Sums of these depths are exact.
fn expected(image: &image::RgbImage) -> (Vec<f32>, Vec<u8>) {
    let (mut depth_m, mut labels) = (Vec::new(), Vec::new());
    for (row, column) in (0..SMALL.1).flat_map(|row| (0..SMALL.0).map(move |column| (row, column))) {
        let (left, top) = (column * FACTOR as u32, row * FACTOR as u32);
        let block = (0..16).map(|i| image.get_pixel(left + i % 4, top + i / 4).0);
        depth_m.push(block.clone().map(models::connected_depth).sum::<f32>() / 16.0);
        let votes = |class| block.clone().filter(|&pixel| models::label(pixel) == class).count();
        labels.push((0..3).rev().max_by_key(|&class| votes(class)).unwrap());
    }
    (depth_m, labels)
}

#[test]
fn decimated_depth_labels_and_cloud_are_published_with_their_own_size_and_camera() {
    let bench = Bench::new();
    bench.add_image("images/0.png", 3);
    let (model, images, name) = (bench.arg("model.onnx"), bench.arg("images"), camera("decimated"));
    let stream = ["-q", "--model", &model, "--source", &images, "--loop", "--rate", "20", "--camera", &name];
    let rest = ["--intrinsics", "520,518,321,238.5", "--focal", "off", "--filter", "decimation=4"];
    let _daemon = Guarded::start(nunetd(&[&stream[..], &rest[..]].concat()));
    let set = first_set(&name);

    let image = image::open(bench.path("images/0.png")).unwrap().into_rgb8();
    let (depth_m, labels) = expected(&image);
    for frame in set.iter() {
        let header = frame.header();
        assert_eq!((header.width, header.height), SMALL);
        // A pixel is the middle of its block: (321 + 0.5) / 4 - 0.5 and so on.
        assert_eq!((header.fx, header.fy, header.cx, header.cy), (130.0, 129.5, 79.875, 59.25));
        assert_eq!(header.invalid_pixels, 0);
        // queue, preprocess, network, decode, decimation, cloud
        assert_eq!(header.stages().len(), 6);
    }
    let map = set.get(Topic::Depth).unwrap();
    assert_eq!(map.header().row_stride_bytes, 4 * SMALL.0);
    assert_eq!(map.header().payload_bytes, u64::from(4 * SMALL.0 * SMALL.1));
    assert!(map.depth().unwrap() == depth_m, "depth is not the blocks' means");
    assert!(
        set.get(Topic::Labels).unwrap().labels().unwrap() == labels,
        "labels are not the blocks' majorities"
    );

    let cloud = set.get(Topic::Cloud).unwrap();
    let (header, points) = (cloud.header(), cloud.points().unwrap());
    assert_eq!(points.len(), depth_m.len());
    for (index, point) in points.iter().enumerate() {
        let (column, row) = ((index % SMALL.0 as usize) as f64, (index / SMALL.0 as usize) as f64);
        assert_eq!((point.z, point.label), (depth_m[index], labels[index]), "point {index}");
        let u = f64::from(point.x / point.z) * header.fx + header.cx;
        let v = f64::from(point.y / point.z) * header.fy + header.cy;
        assert!((u - column).abs() < 1e-3 && (v - row).abs() < 1e-3, "point {index} appears at {u}, {v}");
    }
}

/// The depth map in a folder of results, and its width and height.
fn depth_file(bench: &Bench, folder: &str) -> (Vec<f32>, (u64, u64)) {
    let file = std::fs::read(bench.path(folder).join("depth.npy")).unwrap();
    let depth = npyz::NpyFile::new(&file[..]).unwrap();
    let size = (depth.shape()[1], depth.shape()[0]);
    (depth.into_vec().unwrap(), size)
}

#[test]
fn files_of_run_and_infer_have_the_decimated_size_too() {
    let bench = Bench::new();
    bench.add_image("images/0.png", 3);
    let (model, images, photo) = (bench.arg("model.onnx"), bench.arg("images"), bench.arg("images/0.png"));
    let (of_run, of_infer, name) = (bench.arg("run"), bench.arg("infer"), camera("decimated_files"));
    let how = ["--model", &model, "--focal", "off", "--filter", "decimation=4"];
    run_well(nunetd(
        &[&["-q", "run", "--source", &images, "--camera", &name, "--out", &of_run], &how[..]].concat(),
    ));
    run_well(nunetd(&[&["-q", "infer", &photo, "--out", &of_infer], &how[..]].concat()));
    let image = image::open(&photo).unwrap().into_rgb8();
    let (depth_m, labels) = expected(&image);
    for folder in ["run", "infer"] {
        let (depth, size) = depth_file(&bench, folder);
        assert_eq!(size, (SMALL.0.into(), SMALL.1.into()), "{folder}");
        assert!(depth == depth_m, "{folder}: depth is not the blocks' means");
        let file = image::open(bench.path(folder).join("labels.png")).unwrap().into_luma8();
        assert_eq!((file.dimensions(), file.as_raw() == &labels), (SMALL, true), "{folder}");
    }
}

#[test]
fn temporal_is_reset_when_the_source_restarts_and_between_images_of_infer() {
    let bench = Bench::new();
    for step in 0..2 {
        bench.add_image(&format!("walk/{step}.png"), 40 * step);
    }
    let (model, walk, out) = (bench.arg("model.onnx"), bench.arg("walk"), bench.arg("out"));
    // Nothing new is taken where the depth changes by less than a meter.
    let filter = ["--model", &model, "--focal", "off", "--filter", "temporal=alpha:0,delta:1"];
    let own = |step: usize| -> Vec<f32> {
        let image = image::open(bench.path(&format!("walk/{step}.png"))).unwrap().into_rgb8();
        image.pixels().map(|pixel| models::connected_depth(pixel.0)).collect()
    };
    let run = |frames: &str| {
        let name = camera("temporal");
        let stream =
            ["-q", "--source", &walk, "--loop", "--frames", frames, "--camera", &name, "--out", &out];
        run_well(nunetd(&[&stream[..], &filter[..]].concat()));
        bench.depth("out")
    };
    let (first, second) = (own(0), own(1));
    let held = |(&old, &new): (&f32, &f32)| if (new - old).abs() < 1.0 { old } else { new };
    let expected: Vec<f32> = first.iter().zip(&second).map(held).collect();
    assert!(expected != second, "the images must have something in common");
    let far = run("2").iter().zip(&expected).filter(|(a, b)| (**a - **b).abs() > 1e-5).count();
    assert_eq!(far, 0, "pixels that are neither held nor new");
    assert!(run("3") == first, "the third frame is the first image again, and restarts the filter");
    let images = [0, 1].map(|step| bench.arg(&format!("walk/{step}.png")));
    run_well(nunetd(&[&["-q", "infer", &images[0], &images[1], "--out", &out], &filter[..]].concat()));
    assert!(bench.depth("out/1") == second, "single images are no stream");
}

#[test]
fn a_filtered_stream_is_recorded_and_replayed() {
    let bench = Bench::new();
    bench.add_image("images/0.png", 3);
    let (model, images, name) = (bench.arg("model.onnx"), bench.arg("images"), camera("filtered"));
    let (recorded, replayed) = (bench.arg("recorded.mcap"), bench.arg("replayed.mcap"));
    let all =
        ["--filter", "holes", "--filter", "temporal", "--filter", "spatial", "--filter", "decimation=3"];
    let how = [&["--model", &model][..], &all].concat();
    run_well(nunetd(
        &[&["-q", "run", "--source", &images, "--camera", &name, "--record", &recorded], &how[..]].concat(),
    ));
    let output = run_well(nunetd(&[&["-q", "replay", &recorded, &replayed], &how[..]].concat()));
    assert!(text(&output.stdout).starts_with("1 frame, 0 lost"), "{}", text(&output.stdout));
    let size = |path: &str| std::fs::metadata(path).unwrap().len();
    let plain = bench.arg("plain.mcap");
    run_well(nunetd(&["-q", "replay", &recorded, &plain, "--model", &model]));
    // A ninth of 640x480 points of 16 bytes and of depth of 4; the image is the same.
    assert!(size(&replayed) + 1_000_000 < size(&plain), "{} of {}", size(&replayed), size(&plain));
}

#[test]
fn eval_measures_filtered_depth_and_says_so() {
    let bench = Bench::new();
    std::fs::create_dir_all(bench.path("data/depth")).unwrap();
    // One color: every filter leaves its depth as it is.
    std::fs::create_dir_all(bench.path("data/rgb")).unwrap();
    let gray = image::RgbImage::from_pixel(SIZE.0, SIZE.1, image::Rgb([16; 3]));
    gray.save(bench.path("data/rgb/a.png")).unwrap();
    let millimeters = (models::connected_depth([16; 3]) * 1000.0) as u16;
    let truth = image::ImageBuffer::from_pixel(SIZE.0, SIZE.1, image::Luma([millimeters]));
    truth.save(bench.path("data/depth/a.png")).unwrap();
    let (data, model) = (bench.arg("data"), bench.arg("model.onnx"));
    let how = ["--filter", "holes", "--filter", "decimation=7", "--json"];
    let eval = ["-q", "eval", &data, "--model", &model, "--focal", "off"];
    let output = run_well(nunetd(&[&eval[..], &how[..]].concat()));
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["filters"], serde_json::json!(["decimation=factor:7", "holes=mode:farthest"]));
    assert_eq!(report["pixels"], SIZE.0 * SIZE.1, "640 is no multiple of 7, and every pixel is measured");
    assert_eq!(report["pixels_without_prediction"], 0);
    assert!(report["metrics"]["abs_rel"].as_f64().unwrap() < 1e-6, "{report}");
}
