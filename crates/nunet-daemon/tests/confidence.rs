//! The confidence of depth: what readers, files, recordings and `eval` see of it.

use std::time::{Duration, Instant};

use nunet_ipc::{CameraName, Encoding, Reader, Topic};
use nunet_testkit::models;

use crate::support::{Bench, Guarded, SIZE, TIMEOUT, camera, nunetd, run_well};

/// A folder with a model whose confidence is the red channel, and an image.
fn bench() -> Bench {
    let bench = Bench::new();
    bench.add_image("images/0.png", 3);
    models::with_confidence(models::wnet(SIZE, true), SIZE).write(bench.path("sure.onnx"));
    bench
}

/// The red channel of the image.
fn expected(bench: &Bench) -> Vec<u8> {
    let image = image::open(bench.path("images/0.png")).unwrap().into_rgb8();
    image.pixels().map(|pixel| pixel.0[0]).collect()
}

#[test]
fn readers_receive_it_beside_depth_and_nothing_is_copied() {
    let bench = bench();
    let (model, images, name) = (bench.arg("sure.onnx"), bench.arg("images"), camera("sure"));
    let stream = ["-q", "--model", &model, "--source", &images, "--loop", "--rate", "20", "--camera", &name];
    let _daemon = Guarded::start(nunetd(&stream));
    let topics = [Topic::Depth, Topic::Confidence];
    let mut reader = Reader::open(&CameraName::new(&name).unwrap(), &topics, TIMEOUT).unwrap();
    let start = Instant::now();
    let set = loop {
        assert!(start.elapsed() < TIMEOUT, "no complete frame within {TIMEOUT:?}");
        if let Some(set) = reader.next_set().unwrap() {
            break set;
        }
        reader.wait(Duration::from_millis(100)).unwrap();
    };
    let frame = set.get(Topic::Confidence).unwrap();
    assert!(frame.confidence().unwrap() == expected(&bench), "it is not the red channel");
    let header = frame.header();
    assert_eq!(header.encoding().unwrap(), Encoding::ConfidenceU8);
    assert_eq!((header.width, header.height, header.row_stride_bytes), (SIZE.0, SIZE.1, SIZE.0));
    assert_eq!(header.bytes_copied, 0);
    assert_eq!(header.sequence, set.get(Topic::Depth).unwrap().header().sequence);
}

#[test]
fn files_and_recordings_have_it_only_if_the_model_has_it() {
    let bench = bench();
    let (images, photo) = (bench.arg("images"), bench.arg("images/0.png"));
    for (model, is_there) in [("sure.onnx", true), ("model.onnx", false)] {
        let (name, of_run, of_infer) = (camera("sure_files"), bench.arg("run"), bench.arg("infer"));
        let (model, recording) = (bench.arg(model), bench.arg("recording.mcap"));
        let run = ["-q", "run", "--source", &images, "--camera", &name, "--out", &of_run, "--model", &model];
        run_well(nunetd(&[&run[..], &["--record", &recording, "--force"]].concat()));
        run_well(nunetd(&["-q", "infer", &photo, "--out", &of_infer, "--model", &model]));
        for folder in ["run", "infer"] {
            let file = bench.path(folder).join("confidence.png");
            assert_eq!(file.is_file(), is_there, "{}", file.display());
            if is_there {
                let found = image::open(&file).unwrap().into_luma8();
                assert!(found.as_raw() == &expected(&bench), "{folder}: it is not the red channel");
            }
            std::fs::remove_dir_all(bench.path(folder)).unwrap();
        }
        let bytes = std::fs::read(&recording).unwrap();
        let topic = format!("/{name}/labels/confidence");
        let found = bytes.windows(topic.len()).any(|window| window == topic.as_bytes());
        assert_eq!(found, is_there, "{topic} in the recording");
    }
}

#[test]
fn eval_reports_the_error_of_the_most_certain_pixels() {
    let bench = bench();
    for folder in ["data/rgb", "data/depth"] {
        std::fs::create_dir_all(bench.path(folder)).unwrap();
    }
    // The certain half is right, the other one is off by a quarter of the truth.
    let rgb = |x: u32| image::Rgb([if x < SIZE.0 / 2 { 200 } else { 100 }, 0, 0]);
    image::RgbImage::from_fn(SIZE.0, SIZE.1, |x, _| rgb(x)).save(bench.path("data/rgb/a.png")).unwrap();
    let truth_m = |x: u32| models::connected_depth(rgb(x).0) * if x < SIZE.0 / 2 { 1.0 } else { 0.8 };
    let truth =
        image::ImageBuffer::from_fn(SIZE.0, SIZE.1, |x, _| image::Luma([(truth_m(x) * 1000.0) as u16]));
    truth.save(bench.path("data/depth/a.png")).unwrap();
    let data = bench.arg("data");
    let eval = |model: &str| {
        let model = bench.arg(model);
        let how = ["-q", "eval", &data, "--model", &model, "--focal", "off", "--depth-cap", "40", "--json"];
        serde_json::from_slice::<serde_json::Value>(&run_well(nunetd(&how)).stdout).unwrap()
    };
    let found = &eval("sure.onnx")["sparsification"];
    let value = |name: &str| found[name].as_f64().unwrap();
    assert_eq!(found["images"], 1);
    assert!((value("abs_rel") - 0.125).abs() < 1e-3, "{found}");
    assert!(value("certain_50") < 1e-3 && value("area") < 1e-3, "it is the oracle: {found}");
    assert!(value("area_random") > 0.05, "{found}");
    assert!(found["median_fit"]["abs_rel"].is_number(), "{found}");
    assert!(eval("model.onnx").get("sparsification").is_none());
}
