use std::process::Command;
use std::sync::mpsc::channel;
use std::time::Duration;

use image::{ImageFormat, Rgb, RgbImage};
use nunet_types::Hint as _;

use super::*;

fn image(color: [u8; 3]) -> RgbImage {
    RgbImage::from_pixel(4, 2, Rgb(color))
}

fn drain(source: &mut Files) -> (Vec<[u8; 3]>, Vec<String>) {
    let (mut colors, mut errors) = (Vec::new(), Vec::new());
    let mut frame = Frame::default();
    loop {
        match source.fill(&mut frame) {
            Fill::Frame => {
                let view = frame.view().unwrap();
                assert_eq!(view.size(), (4, 2).into());
                colors.push([view.bytes()[0], view.bytes()[1], view.bytes()[2]]);
            }
            Fill::Failed(error) => errors.push(format!("{error:#}")),
            Fill::Nothing | Fill::Crowded | Fill::Cut(_) | Fill::Broken(_) => {
                unreachable!("files are there at once and lend nothing")
            }
            Fill::End => return (colors, errors),
        }
    }
}

#[test]
fn a_folder_gives_its_images_by_name_and_a_bad_one_does_not_end_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name| folder.path().join(name);
    image([30, 0, 0]).save(path("c.png")).unwrap();
    image([10, 0, 0]).save(path("a.png")).unwrap();
    std::fs::write(path("b.jpg"), b"not a image").unwrap();
    std::fs::write(path("notes.txt"), b"ignored").unwrap();
    let mut source = Files::open(folder.path().to_str().unwrap(), false).unwrap();
    let (colors, errors) = drain(&mut source);
    assert_eq!(colors, [[10, 0, 0], [30, 0, 0]]);
    assert_eq!(errors.len(), 1);
    assert!(errors[0].contains("b.jpg`"), "{errors:?}");
}

#[test]
fn a_pipe_among_the_images_is_skipped() {
    let folder = tempfile::tempdir().unwrap();
    assert!(Command::new("mkfifo").arg(folder.path().join("a.png")).status().unwrap().success());
    image([10, 0, 0]).save(folder.path().join("b.png")).unwrap();
    let mut source = Files::open(folder.path().join("*").to_str().unwrap(), false).unwrap();
    let (send, drained) = channel();
    // On a thread of its own: a pipe that is opened waits for ever.
    std::thread::spawn(move || send.send(drain(&mut source)));
    let (colors, errors) = drained.recv_timeout(Duration::from_secs(60)).unwrap();
    assert_eq!(colors, [[10, 0, 0]]);
    let text = errors[0].replace(folder.path().to_str().unwrap(), "FOLDER");
    insta::assert_snapshot!(text, @"cannot read the image `FOLDER/a.png`: it is not a regular file");
    assert_eq!(errors.len(), 1, "{errors:?}");
}

#[test]
fn each_round_of_a_loop_is_its_own_segment() {
    let folder = tempfile::tempdir().unwrap();
    image([1, 0, 0]).save(folder.path().join("a.png")).unwrap();
    std::fs::write(folder.path().join("b.png"), b"not a image").unwrap();
    image([2, 0, 0]).save(folder.path().join("c.png")).unwrap();
    let mut source = Files::open(folder.path().to_str().unwrap(), true).unwrap();
    let mut frame = Frame::default();
    let mut seen = Vec::new();
    while seen.len() < 5 {
        if let Fill::Frame = source.fill(&mut frame) {
            seen.push((frame.sequence, frame.segment));
        }
    }
    assert_eq!(seen, [(0, 0), (2, 0), (3, 1), (5, 1), (6, 2)]);
}

#[test]
fn a_loop_ends_after_a_round_without_an_image() {
    let folder = tempfile::tempdir().unwrap();
    let images = ["a.png", "b.png"].map(|name| folder.path().join(name));
    for path in &images {
        image([1, 0, 0]).save(path).unwrap();
    }
    let mut source = Files::open(folder.path().to_str().unwrap(), true).unwrap();
    let mut frame = Frame::default();
    assert!(matches!(source.fill(&mut frame), Fill::Frame));
    for path in &images {
        std::fs::remove_file(path).unwrap();
    }
    for _ in 0..3 {
        assert!(matches!(source.fill(&mut frame), Fill::Failed(_)), "the rest of a round, and a whole one");
    }
    let Fill::Broken(error) = source.fill(&mut frame) else { panic!("there is nothing to repeat") };
    assert_eq!(error.kind(), SourceErrorKind::NothingReadable);
    insta::assert_snapshot!(
        error,
        @"no image could be read in a whole round, and the loop would repeat forever"
    );
}

#[test]
fn a_glob_takes_only_what_it_matches() {
    let folder = tempfile::tempdir().unwrap();
    image([1, 2, 3]).save(folder.path().join("left_1.png")).unwrap();
    image([9, 9, 9]).save(folder.path().join("right_1.png")).unwrap();
    let mut source = Files::open(folder.path().join("left_*.png").to_str().unwrap(), false).unwrap();
    assert_eq!(drain(&mut source).0, [[1, 2, 3]]);
}

#[test]
fn a_single_file_that_is_no_image_is_a_bad_argument_with_a_hint() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("clip.any");
    let refused = |content: &[u8]| {
        std::fs::write(&path, content).unwrap();
        let error = Files::open(path.to_str().unwrap(), false).unwrap_err();
        assert!(error.kind() == SourceErrorKind::Argument, "{error:#}");
        let text = format!("{error} | {}", error.hint().unwrap());
        text.replace(path.to_str().unwrap(), "CLIP")
    };
    insta::assert_snapshot!(
        refused(b"\0\0\0\x20ftypisom"),
        @"`CLIP` is not a source: neither a JPEG or PNG image nor a recording | pipe a video into standard input, with `-` as the source: `ffmpeg -i CLIP -f yuv4mpegpipe -pix_fmt yuv420p -`"
    );
    insta::assert_snapshot!(
        refused(b""),
        @"`CLIP` is not a source: it is empty | copy or record it again"
    );
    for other in [&b"\0\0\0\x18ftypheic"[..], b"\xd4\xc3\xb2\xa1\x02\0"] {
        assert!(
            !refused(other).contains("ffmpeg"),
            "neither a HEIC image nor a capture of a network is a video"
        );
    }
    insta::assert_snapshot!(
        refused(b"YUV4MPEG2 W4 H2 F25:1\n"),
        @"`CLIP` is not a source: neither a JPEG or PNG image nor a recording | read it from standard input, with `-` as the source: `< CLIP`"
    );
    insta::assert_snapshot!(
        refused(b"BM\x46\0\0\0"),
        @"`CLIP` is not a source: neither a JPEG or PNG image nor a recording | save it as JPEG or PNG"
    );
    image([1, 2, 3]).save_with_format(&path, ImageFormat::Png).unwrap();
    assert_eq!(
        drain(&mut Files::open(path.to_str().unwrap(), false).unwrap()).0,
        [[1, 2, 3]],
        "whatever its name"
    );
}

#[test]
fn an_empty_folder_and_a_missing_one_are_bad_arguments() {
    let folder = tempfile::tempdir().unwrap();
    for pattern in [folder.path().to_owned(), folder.path().join("missing")] {
        let error = Files::open(pattern.to_str().unwrap(), false).unwrap_err();
        assert!(error.kind() == SourceErrorKind::Argument, "{error:#}");
    }
}

#[test]
fn a_url_of_another_kind_is_named_with_a_way_to_read_it_and_without_its_password() {
    for url in ["http://admin:s3cret@10.0.0.4/video.mjpg", "https://cam/a?b=1", "udp://@:1234"] {
        let error = Files::open(url, false).unwrap_err();
        assert_eq!(error.kind(), SourceErrorKind::Argument);
        let text = format!("{error:#} {}", error.hint().unwrap());
        assert!(text.contains("exec:ffmpeg -i") && !text.contains("s3cret"), "{text}");
    }
}

#[cfg(feature = "mcap")]
#[test]
fn recordings_of_other_formats_are_named_with_a_conversion() {
    let refused = |name: &str, content: &[u8], hint: &str| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, content).unwrap();
        let [by_file, by_folder] = [path.as_path(), folder.path()].map(|named| {
            let error = Files::open(named.to_str().unwrap(), false).unwrap_err();
            assert_eq!(error.kind(), SourceErrorKind::Argument, "{error:#}");
            assert!(error.hint().unwrap().contains(hint), "{:?}", error.hint());
            error.to_string().replace(folder.path().to_str().unwrap(), "FOLDER")
        });
        assert_eq!(by_file, by_folder);
        by_file
    };
    insta::assert_snapshot!(
        refused("drive.bag", b"#ROSBAG V2.0\n", "rosbags-convert --src"),
        @"`FOLDER/drive.bag` is not a source: it is a ROS 1 bag"
    );
    insta::assert_snapshot!(
        refused("drive.db3", b"SQLite format 3\0", "mcap convert"),
        @"`FOLDER/drive.db3` is not a source: it is a ROS 2 bag in SQLite"
    );
    insta::assert_snapshot!(
        refused("drive.mcap.zstd", b"\x28\xb5\x2f\xfd\0", "zstd -d"),
        @"`FOLDER/drive.mcap.zstd` is not a source: it is compressed with zstd as a whole"
    );
}
