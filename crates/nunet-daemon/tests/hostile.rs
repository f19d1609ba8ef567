//! What the daemon reads, cut off anywhere and damaged: an error with few words, never a panic. The functions
//! are those of the fuzz targets.

#[expect(unreachable_pub, reason = "the fuzz targets are another crate")]
#[path = "../../../fuzz/src/daemon.rs"]
mod body;
#[expect(unreachable_pub, reason = "the fuzz targets are another crate")]
#[path = "../../../fuzz/src/header.rs"]
mod header;

use nunet_testkit::demo::DemoScene;
use nunet_testkit::hostile::{feed_damaged, greedy_texts, keep_for_fuzzing};
use proptest::prelude::*;

const CONFIG: &str = r#"model = "a.onnx"
source = "drive/*.jpg"
rate = 15.5
loop = true
frame_id = "eye"
publish = ["depth", "cloud"]
every = ["segmentation=3"]
readers = 2
filter = ["holes", "spatial=alpha:0.4,delta:0.1"]
intrinsics = "518.9,519.5,325.6,253.7@640x480"
mount = "0.1,0.2,1.5,0,0,0"
size = "640x480"
metrics = "127.0.0.1:9477"
"#;

fn y4m(header: &str, image_bytes: usize) -> Vec<u8> {
    let image = [b"FRAME\n".to_vec(), vec![9; image_bytes]].concat();
    [format!("YUV4MPEG2 {header}\n").into_bytes(), image.repeat(3)].concat()
}

/// Good pipes, one of each layout; raw ones begin with the byte that chooses it.
fn pipes() -> [Vec<u8>; 4] {
    [
        y4m("W6 H4 F30000:1001 Ip A1:1 C420jpeg XYSCSS=420JPEG", 36),
        y4m("W5 H3 F25:1 C422", 33),
        y4m("W4 H2 C444", 24),
        y4m("W4 H2 F0:1 Cmono XCOLORRANGE=FULL", 8),
    ]
}

/// A view of the demo scene in each of the files that are read.
fn images() -> Vec<(&'static str, Vec<u8>)> {
    let size = (32, 24);
    let mut rgb = vec![0; 3 * 32 * 24];
    DemoScene::new(1, size.0, size.1).render(0, &mut rgb, None, None);
    let rgb = image::DynamicImage::from(image::RgbImage::from_raw(size.0, size.1, rgb).unwrap());
    let file = |image: &image::DynamicImage, format| {
        let mut file = std::io::Cursor::new(Vec::new());
        image.write_to(&mut file, format).unwrap();
        file.into_inner()
    };
    vec![
        ("jpeg", file(&rgb, image::ImageFormat::Jpeg)),
        ("gray_jpeg", file(&rgb.to_luma8().into(), image::ImageFormat::Jpeg)),
        ("png", file(&rgb, image::ImageFormat::Png)),
        ("deep_png", file(&rgb.to_rgba16().into(), image::ImageFormat::Png)),
    ]
}

#[test]
fn damaged_y4m_never_panics() {
    for (number, pipe) in pipes().into_iter().enumerate() {
        keep_for_fuzzing("y4m", &number.to_string(), &pipe);
        feed_damaged("y4m", &pipe, body::y4m);
    }
}

#[test]
fn raw_images_of_every_format_and_length_never_panic() {
    for choice in [0, 9, 18, 27, 36, 44] {
        let pipe = [vec![choice], vec![1; 300]].concat();
        keep_for_fuzzing("raw", &choice.to_string(), &pipe);
        for length in 0..pipe.len() {
            body::raw(&pipe[..length]);
        }
    }
}

#[test]
fn damaged_configurations_never_panic() {
    keep_for_fuzzing("config", "all", CONFIG.as_bytes());
    feed_damaged("config", CONFIG.as_bytes(), body::config);
    for text in greedy_texts() {
        body::config(text.as_bytes());
    }
}

#[test]
fn damaged_images_never_panic() {
    for (name, file) in images() {
        keep_for_fuzzing("image", name, &file);
        feed_damaged(name, &file, body::image);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn headers_of_any_numbers_are_refused_or_make_sense(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
        header::header(&bytes);
    }

    #[test]
    fn headers_of_small_numbers_are_refused_or_make_sense(words in proptest::collection::vec(0_u32..9, 0..80)) {
        let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
        header::header(&bytes);
    }

    #[test]
    fn arbitrary_bytes_never_panic(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
        body::y4m(&bytes);
        body::y4m(&[b"YUV4MPEG2 ", bytes.as_slice()].concat());
        body::raw(&bytes);
        body::image(&bytes);
    }
}
