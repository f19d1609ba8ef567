//! Files as robots leave them: whole, cut anywhere, damaged, and none at all.
#![expect(clippy::unwrap_used, reason = "a test may stop at the first thing that is wrong")]

use std::collections::{BTreeMap, BTreeSet};
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::mpsc::channel;
use std::time::Duration;

use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions};
use nunet_mcap::{
    CameraDescription, DepthRecord, EncodedImage, FrameRecord, Next, RecordedImage, Recording,
    RecordingError, RecordingWriter, ScaleRecord, WriterOptions, model_of_results,
};
use nunet_testkit::allocations::{CountingAllocator, largest_allocation_during};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

const IMAGES: u8 = 6;

/// A `sensor_msgs/msg/Image` in CDR of 4x2 gray pixels, laid out by hand.
fn gray_image(value: u8) -> Vec<u8> {
    let mut cdr = vec![0, 1, 0, 0];
    cdr.extend([value, 0, 0, 0, 0, 0, 0, 0]); // stamp
    cdr.extend([4, 0, 0, 0, b'e', b'y', b'e', 0]);
    cdr.extend([2, 0, 0, 0, 4, 0, 0, 0]);
    cdr.extend([6, 0, 0, 0, b'm', b'o', b'n', b'o', b'8', 0, 0, 0]);
    cdr.extend([4, 0, 0, 0, 8, 0, 0, 0]);
    cdr.extend([value; 8]);
    cdr
}

fn recording(options: WriteOptions, messages: &[(u64, Vec<u8>)]) -> Vec<u8> {
    let mut file = Cursor::new(Vec::new());
    let mut writer = options.create(&mut file).unwrap();
    let schema = writer.add_schema("sensor_msgs/msg/Image", "ros2msg", b"").unwrap();
    let channel_id = writer.add_channel(schema, "/eye/image_raw", "cdr", &BTreeMap::new()).unwrap();
    for (sequence, (log_time, data)) in (0..).zip(messages) {
        let header = MessageHeader { channel_id, sequence, log_time: *log_time, publish_time: *log_time };
        writer.write_to_known_channel(&header, data).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    file.into_inner()
}

fn images() -> Vec<(u64, Vec<u8>)> {
    (1..=IMAGES).map(|value| (u64::from(value) * 10, gray_image(value))).collect()
}

fn all_options() -> [(&'static str, WriteOptions); 4] {
    let chunks = |compression| {
        WriteOptions::new().compression(compression).compression_threads(0).chunk_size(Some(150))
    };
    [
        ("without chunks", WriteOptions::new().use_chunks(false)),
        ("plain chunks", chunks(None)),
        ("zstd", chunks(Some(Compression::Zstd))),
        ("lz4", chunks(Some(Compression::Lz4))),
    ]
}

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn file(&self, bytes: &[u8]) -> PathBuf {
        let path = self.0.path().join("a.mcap");
        std::fs::write(&path, bytes).unwrap();
        path
    }
}

/// The images' values and how the file ended; an error of opening has none.
fn read(path: &Path) -> Result<(Vec<u8>, Next), RecordingError> {
    let mut recording = Recording::open(path, None)?;
    let (mut image, mut values) = (RecordedImage::default(), Vec::new());
    loop {
        match recording.next(&mut image) {
            Next::Image => {
                let value = image.data[0];
                assert_eq!(image.data, [value; 8], "no image is mixed with another");
                assert_eq!(image.log_nanos, u64::from(value) * 10);
                assert_eq!(image.stamp_nanos, i64::from(value) * 1_000_000_000);
                values.push(value);
            }
            Next::Bad(_) | Next::Nothing => {}
            end => return Ok((values, end)),
        }
    }
}

#[test]
fn every_image_of_a_whole_file_is_read_however_it_is_compressed() {
    let folder = Folder::new();
    for (name, options) in all_options() {
        let (values, end) = read(&folder.file(&recording(options, &images()))).unwrap();
        assert_eq!(values, (1..=IMAGES).collect::<Vec<_>>(), "{name}");
        assert!(matches!(end, Next::End), "{name}");
    }
}

#[test]
fn a_pipe_is_refused_as_a_recording_without_waiting() {
    let folder = Folder::new();
    let pipe = folder.0.path().join("pipe.mcap");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let (send, opened) = channel();
    // On a thread of its own: a pipe that is opened waits for ever.
    std::thread::spawn(move || send.send(Recording::open(&pipe, None).map(drop).unwrap_err().to_string()));
    let error = opened.recv_timeout(Duration::from_secs(60)).unwrap();
    assert!(error.ends_with("pipe.mcap` is not an MCAP file: it is not a regular file"), "{error}");
}

#[test]
fn a_file_cut_at_any_byte_gives_every_complete_image_before_the_cut() {
    let folder = Folder::new();
    for (name, options) in all_options() {
        let plain = !matches!(name, "zstd" | "lz4");
        let whole = recording(options, &images());
        let end_of = |value: u8| {
            let pixels = [value; 8];
            whole.windows(8).position(|window| window == pixels).map(|at| at + 8)
        };
        let mut before = 0;
        for length in 0..whole.len() {
            let read = read(&folder.file(&whole[..length]));
            let values = read.as_ref().map_or(Vec::new(), |(values, _)| values.clone());
            let is_reported = !matches!(read, Ok((_, Next::End)));
            assert!(
                is_reported || length >= whole.len() - mcap::MAGIC.len(),
                "{name} cut at {length} passes for whole"
            );
            assert_eq!(values, (1..).take(values.len()).collect::<Vec<u8>>(), "{name} cut at {length}");
            assert!(values.len() >= before, "{name} cut at {length} gives fewer than a shorter file");
            before = values.len();
            if plain {
                let complete = (1..=IMAGES).filter(|&value| end_of(value).unwrap() <= length).count();
                assert_eq!(values.len(), complete, "{name} cut at {length}");
            }
        }
        assert_eq!(before, usize::from(IMAGES), "{name}: only the end is missing");
    }
}

#[test]
fn truncated_data_is_an_error_and_a_missing_index_is_not() {
    let folder = Folder::new();
    let whole = recording(WriteOptions::new().compression(None).chunk_size(Some(150)), &images());
    let (values, end) = read(&folder.file(&whole[..whole.len() / 3])).unwrap();
    assert!(!values.is_empty() && values.len() < usize::from(IMAGES));
    assert!(matches!(end, Next::Cut(RecordingError::Damaged { .. })), "{end:?}");
    let unindexed = WriteOptions::new().emit_summary_records(false).emit_summary_offsets(false);
    let (values, end) = read(&folder.file(&recording(unindexed, &images()))).unwrap();
    assert_eq!((values.len(), matches!(end, Next::End)), (usize::from(IMAGES), true));
}

#[test]
fn flipped_bytes_never_panic_and_never_mix_images() {
    let folder = Folder::new();
    for (name, options) in all_options() {
        let whole = recording(options, &images());
        let mut read = 0;
        for place in (8..whole.len()).step_by(7) {
            let mut flipped = whole.clone();
            flipped[place] ^= 0x55;
            let path = folder.file(&flipped);
            let Ok(mut recording) = Recording::open(&path, None) else { continue };
            let mut image = RecordedImage::default();
            for _ in 0..100 {
                match recording.next(&mut image) {
                    Next::Image => {
                        let ours = |value: &&u8| (1..=IMAGES).contains(*value);
                        let of: BTreeSet<_> = image.data.iter().filter(ours).collect();
                        assert!(of.len() <= 1, "place {place}: {:?}", image.data);
                        read += 1;
                    }
                    Next::End | Next::Cut(_) => break,
                    Next::Bad(_) | Next::Nothing => {}
                }
            }
        }
        assert!(read > 0, "{name}: no image was read");
    }
}

#[test]
fn the_search_of_a_file_without_an_index_can_be_canceled() {
    let folder = Folder::new();
    let whole = recording(WriteOptions::new().use_chunks(false), &images());
    let path = folder.file(&whole[..whole.len() - 30]);
    let asked = std::cell::Cell::new(0);
    let third_time = || asked.replace(asked.get() + 1) == 2;
    let refused = Recording::open_unless(&path, None, &third_time).map(drop);
    assert!(matches!(refused, Err(RecordingError::GivenUp { .. })), "{refused:?}");
    assert_eq!(asked.get(), 3, "it was read until then");
    assert!(Recording::open_unless(&path, None, &|| false).is_ok());
}

/// The values of the images that are read, how many are reported as lost, and how it ends.
fn losses(path: &Path) -> (Vec<u8>, usize, Next) {
    let mut recording = Recording::open(path, None).unwrap();
    let (mut image, mut values, mut lost) = (RecordedImage::default(), Vec::new(), 0);
    loop {
        match recording.next(&mut image) {
            Next::Image => values.push(image.data[0]),
            Next::Bad(_) => lost += 1,
            Next::Nothing => {}
            end => return (values, lost, end),
        }
    }
}

#[test]
fn a_chunk_with_a_wrong_checksum_loses_its_own_images_and_no_others() {
    let folder = Folder::new();
    let chunks = |compression| {
        WriteOptions::new().compression(compression).compression_threads(0).chunk_size(Some(150))
    };
    // Two images in a chunk; in the first one schema and channel too, which the index repeats.
    for value in 1..=IMAGES {
        let mut whole = recording(chunks(None), &images());
        let at = whole.windows(8).position(|window| window == [value; 8]).unwrap();
        whole[at..at + 8].fill(9); // another valid image
        let (values, lost, end) = losses(&folder.file(&whole));
        assert!(!values.contains(&value) && !values.contains(&9), "{values:?}");
        assert_eq!(values.len() + lost, usize::from(IMAGES), "{values:?} and {lost} lost of {value}");
        assert!((1..=3).contains(&lost), "{lost} lost of {value}");
        assert!(matches!(end, Next::End), "{end:?}");
    }
    for compression in [Compression::Zstd, Compression::Lz4] {
        let whole = recording(chunks(Some(compression)), &images());
        let starts: Vec<usize> = places_of_chunks(&whole);
        for &start in &starts {
            let mut flipped = whole.clone();
            flipped[start + 9 + 32 + 4 + 8 + 20] ^= 0x55;
            let (values, lost, end) = losses(&folder.file(&flipped));
            assert_eq!(
                values.len() + lost,
                usize::from(IMAGES),
                "{compression:?}: {values:?} and {lost} lost"
            );
            assert!(
                (1..=3).contains(&lost) && matches!(end, Next::End),
                "{compression:?}: {lost} lost, {end:?}"
            );
        }
        assert!(starts.len() >= 2);
    }
}

/// Without an index nothing states how many images a chunk had.
#[test]
fn each_damaged_chunk_without_an_index_is_one_lost_image_at_least() {
    let folder = Folder::new();
    let options = WriteOptions::new()
        .compression(None)
        .chunk_size(Some(150))
        .emit_message_indexes(false)
        .emit_summary_records(false);
    let whole = recording(options, &images());
    let starts = places_of_chunks(&whole);
    let (all, lost, end) = losses(&folder.file(&whole));
    assert!(all.len() == usize::from(IMAGES) && lost == 0 && matches!(end, Next::End), "{lost} {end:?}");
    let damage = |which: std::ops::Range<usize>| {
        let mut damaged = whole.clone();
        for &start in &starts[which] {
            damaged[start + 9 + 8 + 8 + 8] ^= 0x55; // the checksum
        }
        damaged
    };
    let last = starts.len();
    assert!(last >= 3, "{starts:?}");
    for which in [1..2, 1..3, 1..last, last - 2..last] {
        let count = which.len();
        let damaged = damage(which.clone());
        let (values, lost, end) = losses(&folder.file(&damaged));
        assert!(lost == count && matches!(end, Next::End), "{which:?}: {lost} lost, {end:?}");
        assert!(values.len() < all.len(), "{values:?}");
        let mut cut = damaged;
        cut.truncate(starts[last - 1] + 20);
        let whole_chunks = count - usize::from(which.end == last);
        let (_, lost, end) = losses(&folder.file(&cut));
        assert!(lost == whole_chunks && matches!(end, Next::Cut(_)), "{which:?}, cut: {lost} lost, {end:?}");
    }
}

/// Where chunks begin, from record to record.
fn places_of_chunks(file: &[u8]) -> Vec<usize> {
    let (mut at, mut places) = (mcap::MAGIC.len(), Vec::new());
    while at + 9 < file.len() - mcap::MAGIC.len() {
        if file[at] == 0x06 {
            places.push(at);
        }
        at += 9 + u64::from_le_bytes(file[at + 1..at + 9].try_into().unwrap()) as usize;
    }
    places
}

/// What a writer leaves that is killed before its first chunk is complete: sizes of all ones, then a part of
/// the chunk.
#[test]
fn the_images_of_an_open_chunk_are_read() {
    let folder = Folder::new();
    for (name, compression) in
        [("plain", None), ("zstd", Some(Compression::Zstd)), ("lz4", Some(Compression::Lz4))]
    {
        let options =
            WriteOptions::new().compression(compression).compression_threads(0).chunk_size(Some(1 << 30));
        let many: Vec<_> = (1..=20_000_u32).map(|value| (u64::from(value), noise(value))).collect();
        let whole = recording(options, &many);
        let [start] = places_of_chunks(&whole)[..] else { panic!("one chunk") };
        let mut open = whole[..start + 400_000].to_vec();
        let name_bytes = compression.map_or(0, |_| name.len());
        for (from, length) in [(1, 8), (9 + 16, 8), (9 + 24, 4), (9 + 32 + name_bytes, 8)] {
            open[start + from..start + from + length].fill(0xff);
        }
        let (values, lost, end) = losses(&folder.file(&open));
        assert!(values.len() > 1000, "{name}: {} images", values.len());
        assert_eq!(lost, 0, "{name}");
        assert!(matches!(end, Next::Cut(RecordingError::Damaged { .. })), "{name}: {end:?}");
    }
}

/// An image that compressors cannot shorten.
fn noise(seed: u32) -> Vec<u8> {
    let mut image = gray_image(1);
    let pixels = image.len() - 8;
    let mut state = seed.wrapping_mul(2_654_435_761) | 1;
    for byte in &mut image[pixels..] {
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        *byte = state as u8;
    }
    image
}

#[test]
fn a_file_that_is_cut_off_before_its_first_message_says_so() {
    let folder = Folder::new();
    let whole = recording(WriteOptions::new(), &images());
    for length in [8, 20, places_of_chunks(&whole)[0] + 60] {
        let error = Recording::open(&folder.file(&whole[..length]), None).map(drop).unwrap_err();
        assert!(matches!(error, RecordingError::NothingLeft { .. }), "{length}: {error}");
    }
}

#[test]
fn parts_of_a_bag_are_read_in_the_order_of_their_time_and_bad_ones_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let part =
        |from: u8| recording(WriteOptions::new(), &images()[usize::from(from) - 1..usize::from(from) + 1]);
    let list = |names: &str| {
        let text = format!(
            "rosbag2_bagfile_information: {{storage_identifier: mcap, relative_file_paths: [{names}]}}"
        );
        std::fs::write(path("metadata.yaml"), text).unwrap();
    };
    for (name, from) in [("d_0.mcap", 1), ("d_1.mcap", 3), ("d_2.mcap", 5)] {
        std::fs::write(path(name), part(from)).unwrap();
    }
    list("d_2.mcap, d_0.mcap, d_1.mcap, d_0.mcap");
    let (values, lost, end) = losses(folder.path());
    assert_eq!((values, lost), (vec![1, 2, 3, 4, 5, 6], 0));
    assert!(matches!(end, Next::End));
    std::fs::write(path("d_1.mcap"), "").unwrap();
    list("d_0.mcap, d_1.mcap, d_2.mcap, d_3.mcap");
    let (values, lost, _) = losses(folder.path());
    assert_eq!((values, lost), (vec![1, 2, 5, 6], 2), "one is empty and one does not exist");
    std::fs::remove_file(path("metadata.yaml")).unwrap();
    std::fs::remove_file(path("d_1.mcap")).unwrap();
    let (values, lost, _) = losses(folder.path());
    assert_eq!((values, lost), (vec![1, 2, 5, 6], 1), "number 1 is missing");
}

#[test]
fn a_length_beyond_the_file_is_refused_without_memory_for_it() {
    let folder = Folder::new();
    let mut file = mcap::MAGIC.to_vec();
    file.push(0x05); // a message
    file.extend(u64::MAX.to_le_bytes());
    let error = Recording::open(&folder.file(&file), None).map(drop).unwrap_err();
    assert!(matches!(error, RecordingError::NothingLeft { .. }), "{error}");
}

#[test]
fn a_long_name_of_the_compression_of_an_open_chunk_is_refused_without_memory_for_it() {
    const NAME_BYTES: u32 = 64 << 20;
    let folder = Folder::new();
    let mut start = mcap::MAGIC.to_vec();
    start.push(0x06); // a chunk
    start.extend([0xff; 8 + 8 + 8 + 8 + 4]); // its lengths, times and checksum are not known yet
    start.extend(NAME_BYTES.to_le_bytes());
    let path = folder.file(&start);
    let file = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
    file.set_len(2 * u64::from(NAME_BYTES)).unwrap();
    let largest = largest_allocation_during(|| {
        let error = Recording::open(&path, None).map(drop).unwrap_err();
        assert!(matches!(error, RecordingError::NothingLeft { .. }), "{error}");
    });
    assert!(largest < 1 << 20, "{largest} bytes");
}

#[test]
fn a_bad_image_is_an_error_with_its_number_and_the_next_is_read() {
    let folder = Folder::new();
    let mut messages = images();
    messages[1].1.truncate(30);
    let mut recording =
        Recording::open(&folder.file(&recording(WriteOptions::new(), &messages)), None).unwrap();
    let mut image = RecordedImage::default();
    assert!(matches!(recording.next(&mut image), Next::Image));
    let Next::Bad(error) = recording.next(&mut image) else { panic!("it is cut off") };
    assert!(error.to_string().starts_with("message 2 on topic `/eye/image_raw`: it is cut off"), "{error}");
    assert!(matches!(recording.next(&mut image), Next::Image));
    assert_eq!(image.data[0], 3);
}

fn write_frames(path: &Path, frames: u8) -> RecordingWriter {
    let options = WriterOptions {
        camera: "front".to_owned(),
        frame_id: "eye".to_owned(),
        mount: None,
        about: BTreeMap::new(),
        force: true,
    };
    let mut writer = RecordingWriter::create(path, options).unwrap();
    for frame in 0..frames {
        // A zoom lens whose camera is known from the second frame on.
        let source = if frame == 0 { "assumed_camera" } else { "focal_scaled" };
        // Small changes are not written.
        let factor = if frame == 0 { 1.0 } else { 0.5 + 0.001 * f32::from(frame) };
        let scale = ScaleRecord { units: "metre", source, factor, age_nanos: 500_000_000 };
        let intrinsics = [3.0 + f64::from(frame), 4.0, 0.5, 0.0];
        let camera = CameraDescription { width: 2, height: 1, intrinsics, ..Default::default() };
        let depth: Vec<u8> =
            [f32::from(frame), f32::NAN].iter().flat_map(|meters| meters.to_le_bytes()).collect();
        writer
            .write(&FrameRecord {
                log_nanos: frame.into(),
                stamp_nanos: frame.into(),
                image: Some(EncodedImage { format: "png", data: b"\x89PNG\r\n\x1a\n..." }),
                camera: Some(&camera),
                depth: DepthRecord { scale, width: 2, height: 1, bytes: &depth },
                depth_camera: None,
                labels: None,
                confidence: None,
                cloud: None,
            })
            .unwrap();
    }
    writer
}

fn count(path: &Path) -> (usize, bool) {
    let mut recording = Recording::open(path, None).unwrap();
    assert_eq!(recording.camera().unwrap().intrinsics, [3.0, 4.0, 0.5, 0.0]);
    let mut image = RecordedImage::default();
    let mut images = 0;
    loop {
        match recording.next(&mut image) {
            Next::Image => images += 1,
            Next::Bad(error) => panic!("{error}"),
            end => return (images, matches!(end, Next::End)),
        }
    }
}

#[test]
fn a_recording_that_begins_again_has_its_first_camera_again() {
    let folder = Folder::new();
    let path = folder.0.path().join("zoom.mcap");
    write_frames(&path, 3).finish().unwrap();
    let mut recording = Recording::open(&path, None).unwrap();
    let focal_length = |recording: &Recording| recording.camera().unwrap().intrinsics[0];
    for _ in 0..2 {
        assert_eq!(focal_length(&recording), 3.0);
        let images =
            (0..10).take_while(|_| matches!(recording.next(&mut RecordedImage::default()), Next::Image));
        assert_eq!(images.count(), 3);
        assert_eq!(focal_length(&recording), 5.0);
        recording.rewind().unwrap();
    }
}

#[test]
fn each_image_has_the_attitude_that_was_recorded_for_it() {
    let folder = Folder::new();
    let path = folder.0.path().join("tilt.mcap");
    let mut writer = write_frames(&path, 0);
    let recorded = [(1, Some([0.1, -0.2])), (2, None), (3, Some([0.3, 0.0]))];
    for (nanos, attitude) in recorded {
        if let Some(roll_pitch_rad) = attitude {
            writer.write_attitude(roll_pitch_rad, nanos as u64, nanos).unwrap();
        }
        let depth = DepthRecord { scale: ScaleRecord::default(), width: 1, height: 1, bytes: &[0; 4] };
        let frame = FrameRecord {
            log_nanos: nanos as u64,
            stamp_nanos: nanos,
            image: Some(EncodedImage { format: "png", data: b"\x89PNG\r\n\x1a\n..." }),
            camera: None,
            depth,
            depth_camera: None,
            labels: None,
            confidence: None,
            cloud: None,
        };
        writer.write(&frame).unwrap();
    }
    // The image that it belongs to is missing.
    writer.write_attitude([0.5, 0.5], 4, 4).unwrap();
    writer.finish().unwrap();
    let (mut recording, mut image) = (Recording::open(&path, None).unwrap(), RecordedImage::default());
    for _ in 0..2 {
        for (nanos, attitude) in recorded {
            assert!(matches!(recording.next(&mut image), Next::Image));
            assert_eq!((image.stamp_nanos, image.roll_pitch_rad), (nanos, attitude));
        }
        assert!(matches!(recording.next(&mut image), Next::End));
        recording.rewind().unwrap();
    }
}

#[test]
fn where_the_scale_comes_from_is_said_when_it_changes() {
    let folder = Folder::new();
    let path = folder.0.path().join("scale.mcap");
    write_frames(&path, 3).finish().unwrap();
    let file = std::fs::read(&path).unwrap();
    let summary = mcap::Summary::read(&file).unwrap().unwrap();
    let stated: Vec<_> = summary
        .metadata_indexes
        .iter()
        .filter(|index| index.name == "nunet.scale")
        .map(|index| mcap::read::metadata(&file, index).unwrap().metadata)
        .map(|metadata| {
            let keys = ["scale_source", "from_log_time", "units", "scale_factor", "scale_age_s"];
            keys.map(|key| metadata[key].clone())
        })
        .collect();
    let expected =
        [["assumed_camera", "0", "metre", "1", "0.5"], ["focal_scaled", "1", "metre", "0.501", "0.5"]];
    assert_eq!(stated, expected.map(|values| values.map(str::to_owned)));
}

#[test]
fn synced_frames_can_be_read_while_the_file_grows() {
    let folder = Folder::new();
    let path = folder.0.path().join("grows.mcap");
    let mut writer = write_frames(&path, 3);
    writer.sync().unwrap();
    assert_eq!(count(&path), (3, false));
    writer.finish().unwrap();
    assert_eq!(count(&path), (3, true));
}

#[test]
fn the_producer_of_results_is_known_only_for_our_own_recordings() {
    let folder = Folder::new();
    let path = folder.0.path().join("own.mcap");
    let options = WriterOptions {
        camera: "front".to_owned(),
        frame_id: "eye".to_owned(),
        mount: None,
        about: BTreeMap::from([("model".to_owned(), "wnet_c.onnx".to_owned())]),
        force: true,
    };
    RecordingWriter::create(&path, options).unwrap().finish().unwrap();
    assert_eq!(model_of_results(&path).as_deref(), Some("wnet_c.onnx"));
    assert_eq!(model_of_results(&folder.file(&recording(WriteOptions::new(), &images()))), None);
    assert_eq!(model_of_results(&folder.file(b"no recording")), None);
    assert_eq!(model_of_results(&folder.0.path().join("missing.mcap")), None);
}

#[test]
fn an_existing_file_is_not_overwritten() {
    let folder = Folder::new();
    let path = folder.file(b"precious");
    let options = WriterOptions {
        camera: "front".to_owned(),
        frame_id: String::new(),
        mount: None,
        about: BTreeMap::new(),
        force: false,
    };
    let error = RecordingWriter::create(&path, options).map(drop).unwrap_err();
    assert!(matches!(error, RecordingError::Exists { .. }), "{error}");
    assert_eq!(std::fs::read(&path).unwrap(), b"precious");
}

#[test]
fn a_recording_that_is_being_written_is_not_overwritten_even_by_force() {
    let folder = Folder::new();
    let path = folder.0.path().join("live.mcap");
    let mut first = write_frames(&path, 2);
    let options = WriterOptions {
        camera: "other".to_owned(),
        frame_id: String::new(),
        mount: None,
        about: BTreeMap::new(),
        force: true,
    };
    first.sync().unwrap();
    let written = std::fs::metadata(&path).unwrap().len();
    let error = RecordingWriter::create(&path, options).map(drop).unwrap_err();
    assert!(matches!(error, RecordingError::InUse { .. }), "{error}");
    assert_eq!(std::fs::metadata(&path).unwrap().len(), written);
    first.finish().unwrap();
}

/// `/dev/full` takes no byte. A disk that fills up later is tried with the daemon.
#[test]
fn a_write_error_of_the_disk_is_returned() {
    let options = WriterOptions {
        camera: "front".to_owned(),
        frame_id: String::new(),
        mount: None,
        about: BTreeMap::new(),
        force: true,
    };
    let writer = RecordingWriter::create(Path::new("/dev/full"), options);
    let failed = writer.and_then(|mut writer| writer.sync());
    assert!(failed.is_err());
}

#[test]
fn writers_and_mcaps_own_reader_agree() {
    let folder = Folder::new();
    let path = folder.0.path().join("whole.mcap");
    write_frames(&path, 4).finish().unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let messages: Vec<_> = mcap::MessageStream::new(&bytes).unwrap().collect::<Result<_, _>>().unwrap();
    assert_eq!(messages.len(), 4 * 3);
}

/// How many images a recording gives, and how it ends.
fn outcome(path: &Path) -> Result<(usize, Next), RecordingError> {
    let mut recording = Recording::open(path, None)?;
    let (mut image, mut count) = (RecordedImage::default(), 0);
    loop {
        match recording.next(&mut image) {
            Next::Image => count += 1,
            Next::Bad(_) | Next::Nothing => {}
            end => return Ok((count, end)),
        }
    }
}

#[test]
fn a_file_that_lost_its_last_bytes_is_cut_off_and_not_complete() {
    let folder = Folder::new();
    for (name, options) in all_options() {
        let whole = recording(options, &images());
        for lost in 1..=8 {
            let (count, end) = outcome(&folder.file(&whole[..whole.len() - lost])).unwrap();
            assert_eq!(count, usize::from(IMAGES), "{name}, {lost} bytes lost");
            assert!(matches!(end, Next::Cut(_)), "{name}, {lost} bytes lost: {end:?}");
        }
    }
}

/// Each bit of each length, of records and of the texts in them: an error or fewer images, with memory for no
/// more than the file and its chunks hold.
#[test]
fn no_flipped_bit_of_a_small_file_requests_much_memory() {
    const MOST_BYTES: usize = 1 << 20;
    let folder = Folder::new();
    assert!(
        largest_allocation_during(|| drop(std::hint::black_box(vec![0_u8; 5000]))) >= 5000,
        "nothing counts"
    );
    for (name, options) in all_options() {
        let whole = recording(options, &images());
        for at in 0..whole.len() {
            for bit in [at % 7, 7] {
                let mut file = whole.clone();
                file[at] ^= 1 << bit;
                let path = folder.file(&file);
                let largest = largest_allocation_during(|| {
                    if let Err(error) = outcome(&path) {
                        let text = format!("{error:?} {error}");
                        assert!(!text.contains('\u{1b}') && !text.contains(".rs"), "{text}");
                    }
                });
                assert!(largest <= MOST_BYTES, "{name}: {largest} bytes for bit {bit} of byte {at}");
            }
        }
    }
}

/// A `foxglove.RawImage` in JSON whose pixels are an array of numbers.
#[test]
fn an_image_of_numbers_takes_no_more_memory_than_twice_its_text() {
    let numbers = "7,".repeat(1000 * 500 - 1) + "7";
    let size = r#""width": 1000, "height": 500, "step": 1000, "encoding": "mono8""#;
    let message = format!("{{{size}, \"data\": [{numbers}]}}");
    let mut file = Cursor::new(Vec::new());
    let mut writer = WriteOptions::new().use_chunks(false).create(&mut file).unwrap();
    let schema = writer.add_schema("foxglove.RawImage", "jsonschema", b"").unwrap();
    let channel_id = writer.add_channel(schema, "/image", "json", &BTreeMap::new()).unwrap();
    let header = MessageHeader { channel_id, sequence: 0, log_time: 1, publish_time: 1 };
    writer.write_to_known_channel(&header, message.as_bytes()).unwrap();
    writer.finish().unwrap();
    drop(writer);
    let (folder, mut image) = (Folder::new(), RecordedImage::default());
    let path = folder.file(&file.into_inner());
    let largest = largest_allocation_during(|| {
        let mut recording = Recording::open(&path, None).unwrap();
        assert!(matches!(recording.next(&mut image), Next::Image));
    });
    assert!(image.data.len() == 1000 * 500 && image.data.iter().all(|value| *value == 7));
    // Twice: memory that grows doubles. One `serde_json::Value` for each number would take 16 times the text.
    assert!(largest <= 2 * message.len() + (1 << 16), "{largest} bytes for a message of {}", message.len());
}

#[test]
fn the_parts_of_a_split_bag_are_one_recording_and_a_damaged_part_loses_only_its_own_images() {
    let folder = Folder::new();
    let part = |from: u8| -> Vec<(u64, Vec<u8>)> {
        (from..from + 3).map(|value| (u64::from(value) * 10, gray_image(value))).collect()
    };
    for (number, from) in [(0, 1), (2, 4), (10, 7)] {
        let file = recording(WriteOptions::new().use_chunks(false), &part(from));
        std::fs::write(folder.0.path().join(format!("drive_{number}.mcap")), file).unwrap();
    }
    let (values, end) = read(folder.0.path()).unwrap();
    assert_eq!(values, (1..=9).collect::<Vec<_>>());
    assert!(matches!(end, Next::End));
    assert_eq!(Recording::open(folder.0.path(), None).unwrap().image_count(), Some(9));

    let second = folder.0.path().join("drive_2.mcap");
    let bytes = std::fs::read(&second).unwrap();
    let at = bytes.windows(8).rposition(|window| window == [5; 8]).unwrap();
    std::fs::write(&second, &bytes[..at]).unwrap();
    let (values, end) = read(folder.0.path()).unwrap();
    assert_eq!(values, [1, 2, 3, 4, 7, 8, 9]);
    assert!(matches!(end, Next::End));
}
