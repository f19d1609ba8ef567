//! `--aspect`: images of another aspect ratio than the network's, from the file to the headers and
//! recordings.

use std::time::{Duration, Instant};

use nunet_ipc::{CameraName, FrameHeader, PixelRect, Reader, Topic};
use serde_json::{Value, json};

use crate::support::{Bench, Guarded, TIMEOUT, camera, nunetd, run_well, text};

const INTRINSICS: &str = "100,101,79.5,40@160x90";

/// A bench with an image of this size in the folder `images`.
fn bench_with_image(width: u32, height: u32) -> Bench {
    let bench = Bench::new();
    let pixel = |x: u32, y: u32| image::Rgb([(x * 255 / width) as u8, (y * 255 / height) as u8, 40]);
    std::fs::create_dir(bench.path("images")).unwrap();
    image::RgbImage::from_fn(width, height, pixel).save(bench.path("images/0.png")).unwrap();
    bench
}

/// The stats of `infer`, and what it logged.
fn inferred(bench: &Bench, rest: &[&str]) -> (Value, String) {
    let (model, photo, out) = (bench.arg("model.onnx"), bench.arg("images/0.png"), bench.arg("out"));
    let output = run_well(nunetd(&[&["infer", &photo, "--out", &out, "--model", &model], rest].concat()));
    let stats = serde_json::from_slice(&std::fs::read(bench.path("out/stats.json")).unwrap()).unwrap();
    (stats, text(&output.stderr))
}

#[test]
fn the_files_and_a_warning_say_what_depth_covers() {
    let bench = bench_with_image(160, 90);
    let whole = json!([0, 0, 160, 90]);
    let crop = "images of 160x90 are cropped to 120x90 at (20, 0): 25 % of their width have no depth";
    for (aspect, view, warning) in [
        (&[][..], json!([20, 0, 120, 90]), Some(crop)),
        (&["--aspect", "crop"], json!([20, 0, 120, 90]), Some(crop)),
        (&["--aspect", "stretch"], whole.clone(), Some("images of 160x90 are stretched to 640x480")),
        (&["--aspect", "letterbox"], whole, None),
    ] {
        let (stats, log) = inferred(&bench, aspect);
        assert_eq!(stats["view"], view, "{aspect:?}");
        match warning {
            Some(warning) => assert!(log.contains(warning) && log.contains("--aspect letterbox"), "{log}"),
            None => assert!(!log.contains("images of"), "{log}"),
        }
    }
    let (stats, log) = inferred(&bench_with_image(64, 48), &[]);
    assert_eq!(stats["view"], json!([0, 0, 64, 48]));
    assert!(!log.contains("images of"), "{log}");
}

/// An EXIF block that states only orientation 6: the camera was turned by 90 degrees.
const EXIF_TURNED: [u8; 36] =
    *b"\xff\xe1\x00\x22Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0";

#[test]
fn an_image_rotated_by_exif_is_cropped_upright() {
    let bench = bench_with_image(160, 90);
    let stored = image::open(bench.path("images/0.png")).unwrap();
    stored.save(bench.path("stored.jpg")).unwrap();
    let file = std::fs::read(bench.path("stored.jpg")).unwrap();
    std::fs::write(bench.path("turned.jpg"), [&file[..2], &EXIF_TURNED, &file[2..]].concat()).unwrap();
    image::open(bench.path("stored.jpg")).unwrap().rotate90().save(bench.path("upright.png")).unwrap();
    let model = bench.arg("model.onnx");
    let results = ["turned.jpg", "upright.png"].map(|name| {
        let (photo, out) = (bench.arg(name), bench.arg(&format!("out_{name}")));
        // The intrinsics of the upright image.
        let rest = ["--model", &model, "--aspect", "crop", "--intrinsics", "100,101,40,79.5@90x160"];
        run_well(nunetd(&[&["infer", &photo, "--out", &out][..], &rest].concat()));
        let read = |file| std::fs::read(bench.path(&format!("out_{name}/{file}"))).unwrap();
        let stats: Value = serde_json::from_slice(&read("stats.json")).unwrap();
        (stats["view"].clone(), read("depth.npy"), read("cloud.ply"))
    });
    assert_eq!(results[0].0, json!([0, 46, 90, 68]), "of the upright image");
    assert!(results[0] == results[1], "the same depth and points as of the image without EXIF");
}

/// The header of the first depth map of the images.
fn header_of(bench: &Bench, test: &str, rest: &[&str]) -> FrameHeader {
    let (model, images, name) = (bench.arg("model.onnx"), bench.arg("images"), camera(test));
    let arguments =
        ["-q", "--model", &model, "--source", &images, "--loop", "--rate", "20", "--camera", &name];
    let _daemon = Guarded::start(nunetd(&[&arguments, rest].concat()));
    let mut reader = Reader::open(&CameraName::new(&name).unwrap(), &[Topic::Depth], TIMEOUT).unwrap();
    let start = Instant::now();
    while start.elapsed() < TIMEOUT {
        if let Some(set) = reader.next_set().unwrap() {
            return *set.get(Topic::Depth).unwrap().header();
        }
        reader.wait(Duration::from_millis(100)).unwrap();
    }
    panic!("no frame within {TIMEOUT:?}")
}

#[test]
fn headers_have_the_view_and_the_intrinsics_of_the_depth_map() {
    // The pixel of depth that sees the image's pixel (u, v), and the intrinsics after the same mapping.
    let check = |header: FrameHeader, view: PixelRect| {
        assert_eq!((header.width, header.height, header.view()), (640, 480, Some(view)));
        let near = |got: f64, want: f64| assert!((got - want).abs() < 1e-9, "{got} {want}: {header:?}");
        let (scale_x, scale_y) = (640.0 / f64::from(view.width), 480.0 / f64::from(view.height));
        near(header.fx, 100.0 * scale_x);
        near(header.fy, 101.0 * scale_y);
        near(header.cx, (79.5 - f64::from(view.x) + 0.5) * scale_x - 0.5);
        near(header.cy, (40.0 - f64::from(view.y) + 0.5) * scale_y - 0.5);
    };
    let bench = bench_with_image(160, 90);
    let crop = PixelRect { x: 20, y: 0, width: 120, height: 90 };
    check(header_of(&bench, "aspect_crop", &["--intrinsics", INTRINSICS]), crop);
    // Numbers for twice the size; pixel centers are whole numbers.
    let twice = "200,202,159.5,80.5@320x180";
    check(header_of(&bench, "aspect_twice", &["--intrinsics", twice]), crop);
    let letterbox = ["--intrinsics", INTRINSICS, "--aspect", "letterbox"];
    let whole = PixelRect { x: 0, y: 0, width: 160, height: 90 };
    check(header_of(&bench, "aspect_letterbox", &letterbox), whole);

    let portrait = header_of(&bench_with_image(90, 160), "aspect_portrait", &[]);
    assert_eq!(portrait.view(), Some(PixelRect { x: 0, y: 46, width: 90, height: 68 }));
    assert!(!portrait.has_intrinsics(), "the view is known without them");
}

#[test]
fn a_recording_of_wide_images_is_replayed_with_the_same_bytes_each_time() {
    let bench = bench_with_image(160, 90);
    let (model, images, name) = (bench.arg("model.onnx"), bench.arg("images"), camera("aspect_replay"));
    let recorded = bench.arg("recorded.mcap");
    let arguments = ["-q", "--source", &images, "--camera", &name, "--record", &recorded, "--model", &model];
    run_well(nunetd(&[&arguments[..], &["--intrinsics", INTRINSICS]].concat()));
    let hash = |out: &str, aspect: &str| {
        let out = bench.arg(out);
        let arguments = ["-q", "replay", &recorded, &out, "--model", &model, "--aspect", aspect, "--json"];
        let output = run_well(nunetd(&[&arguments[..], &["--provider", "cpu", "--threads", "1"]].concat()));
        let report: Value = serde_json::from_slice(&output.stdout).unwrap();
        report["results_sha256"].as_str().unwrap().to_owned()
    };
    let [crop, again] = ["a.mcap", "b.mcap"].map(|out| hash(out, "crop"));
    let [letterbox, stretch] = ["letterbox", "stretch"].map(|mode| hash(&format!("{mode}.mcap"), mode));
    assert_eq!(crop, again);
    assert!(crop != letterbox && letterbox != stretch && stretch != crop);
}
