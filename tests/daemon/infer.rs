//! `nunetd infer`: files that hold what the network said.

use nunet_testkit::models;

use crate::support::{Bench, SIZE, nunetd, run_well};

#[test]
fn the_files_of_a_picture_hold_the_numbers_that_the_network_computes_by_hand() {
    let bench = Bench::new();
    bench.add_picture("photo.png", 7);
    let (model, photo, out) = (bench.arg("model.onnx"), bench.arg("photo.png"), bench.arg("out"));
    run_well(nunetd(&["-q", "infer", &photo, "--out", &out, "--model", &model, "--focal", "off"]));
    let rgb = image::open(&photo).unwrap().into_rgb8();
    let depth = bench.depth("out");
    let labels = image::open(bench.path("out/labels.png")).unwrap().into_luma8();
    let millimetres = image::open(bench.path("out/depth_mm.png")).unwrap().into_luma16();
    for (index, pixel) in rgb.pixels().enumerate() {
        let expected = models::connected_depth(pixel.0);
        assert_eq!(depth[index], expected, "pixel {index}");
        assert_eq!(labels.as_raw()[index], models::label(pixel.0), "pixel {index}");
        assert_eq!(f32::from(millimetres.as_raw()[index]), (expected * 1000.0).round(), "pixel {index}");
    }
}

#[test]
fn a_small_photograph_is_enlarged_to_the_networks_size() {
    let bench = Bench::new();
    let photo = image::RgbImage::from_fn(32, 24, |x, _| image::Rgb([if x < 16 { 10 } else { 200 }, 0, 0]));
    photo.save(bench.path("small.png")).unwrap();
    let (model, small, out) = (bench.arg("model.onnx"), bench.arg("small.png"), bench.arg("out"));
    run_well(nunetd(&["-q", "infer", &small, "--out", &out, "--model", &model, "--focal", "off"]));
    let depth = bench.depth("out");
    assert_eq!(depth[0], models::connected_depth([10, 0, 0]));
    assert_eq!(depth[SIZE.0 as usize - 1], models::connected_depth([200, 0, 0]));
}
