//! From an image to the moment when a reader holds its depth.
//!
//! `network` is the same session's bare run in the same round: the difference is the overhead of the
//! pipeline.

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use nunet_core::clock::Clock;
use nunet_core::frame::{ImageView, PixelFormat};
use nunet_core::graph::{GraphInput, GraphOptions, GraphOutputs, Runtime, SerialGraph};
use nunet_core::pipeline::{Outputs, Pipeline, PipelineOptions};
use nunet_engine::MonotonicClock;
use nunet_ipc::{CameraName, Encoding, Limits, Publisher, Reader, Topic, TopicPlan, Wake, monotonic_nanos};
use nunet_testkit::demo::DemoScene;
use nunet_types::ImageSize;

const MODELS: [(&str, &str); 2] = [("tiny_wnet_c", "tiny/tiny_wnet_c.onnx"), ("wnet_c", "wnet_c.onnx")];

/// One model with its image, and what it writes into.
struct Bench {
    pipeline: Pipeline,
    image: Vec<u8>,
    publisher: Publisher,
    reader: Reader,
}

fn load(file: &str) -> SerialGraph {
    let runtime = Runtime::load(&nunet_testkit::runtime_library()).expect("the library that the tests use");
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models").join(file);
    SerialGraph::load(&path, &runtime, &GraphOptions::default()).expect("a model of this repository")
}

fn image(size: ImageSize) -> Vec<u8> {
    let mut rgb = vec![0; 3 * size.pixel_count()];
    DemoScene::new(1, size.width, size.height).render(0, &mut rgb, None, None);
    rgb
}

impl Bench {
    fn new(file: &str) -> Self {
        let pipeline =
            Pipeline::new(load(file), PipelineOptions::default()).expect("no camera that could not fit");
        let image = image(pipeline.size());
        let camera = CameraName::new(&format!("bench_{}", std::process::id())).expect("a good name");
        let plan = TopicPlan { topic: Topic::Depth, payload_bytes: image.len() / 3 * size_of::<f32>() };
        let publisher = Publisher::create(&camera, &[plan], &Limits::default()).expect("a camera of our own");
        let reader =
            Reader::open(&camera, &[Topic::Depth], std::time::Duration::ZERO).expect("our own camera");
        Self { pipeline, image, publisher, reader }
    }

    /// From the image to the depth in a reader's hands.
    fn frame(&mut self) {
        let ImageSize { width, height } = self.pipeline.size();
        let view = ImageView::packed(&self.image, width, height, PixelFormat::Rgb8).expect("a whole image");
        let mut loan = self.publisher.loan(Topic::Depth).expect("a free chunk");
        let depth_m = loan.slice_mut().expect("planned as floats");
        let outputs = Outputs { depth_m, labels: None, confidence: None, cloud: None };
        self.pipeline.process(&view, outputs, &MonotonicClock).expect("a frame");
        let header = loan.header_mut();
        header.set_encoding(Encoding::DepthF32);
        (header.width, header.height) = (width, height);
        loan.publish(monotonic_nanos()).expect("room for a frame");
        self.publisher.notify(Wake::Depth).expect("a reader to wake");
        let frame = self.reader.latest(Topic::Depth).expect("a sound frame").expect("a frame");
        assert!(frame.depth().is_ok());
    }
}

fn end_to_end(criterion: &mut Criterion) {
    for (name, file) in MODELS {
        let mut bench = Bench::new(file);
        let ImageSize { width, height } = bench.pipeline.size();
        let size = format!("{width}x{height}");
        let mut group = criterion.benchmark_group("end_to_end");
        group.bench_function(BenchmarkId::new(name, &size), |bencher| bencher.iter(|| bench.frame()));
        group.finish();

        let mut graph = load(file);
        let clock: &dyn Clock = &MonotonicClock;
        let mut depth = vec![0.0; bench.image.len() / 3];
        let mut group = criterion.benchmark_group("network");
        group.bench_function(BenchmarkId::new(name, &size), |bencher| {
            bencher.iter(|| {
                let outputs = GraphOutputs { depth: &mut depth, labels: None, confidence: None };
                graph.run(GraphInput::Rgb(&bench.image), outputs, clock).expect("a run")
            });
        });
        group.finish();
    }
}

criterion_group!(benches, end_to_end);
criterion_main!(benches);
