//! One loaded model file: its inputs, outputs and metadata.

use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::sync::{Arc, Mutex};

use ort::session::builder::{GraphOptimizationLevel, SessionBuilder};
use ort::value::{Outlet, TensorElementType};

use super::runtime::Runtime;
use super::session::{Session, SharedSession};
use crate::graph::{ElementType, Provider, Signature, TensorSpec};

/// A loaded model file, before its outputs are chosen.
pub(in crate::graph) struct OnnxModel {
    session: SharedSession,
    signature: Signature,
    metadata: BTreeMap<String, String>,
}

impl OnnxModel {
    /// Loads a model from the bytes of its file, not by path, so that the hashed bytes are those that run.
    ///
    /// `provider` is resolved, not `auto`.
    ///
    /// # Errors
    /// ONNX Runtime's message.
    pub(in crate::graph) fn load(
        bytes: &[u8],
        runtime: &Runtime,
        provider: Provider,
        threads: NonZeroUsize,
    ) -> Result<Self, String> {
        let session = builder(runtime, provider, threads)
            .and_then(|mut builder| builder.commit_from_memory(bytes))
            .map_err(|error| error.message().to_owned())?;
        let signature = Signature { inputs: specs(session.inputs()), outputs: specs(session.outputs()) };
        let metadata = metadata(&session).map_err(|error| error.message().to_owned())?;
        Ok(Self { session: Arc::new(Mutex::new(session)), signature, metadata })
    }

    /// Its inputs and outputs.
    pub(in crate::graph) fn signature(&self) -> &Signature {
        &self.signature
    }

    /// The entries of `metadata_props`.
    pub(in crate::graph) fn metadata(&self) -> &BTreeMap<String, String> {
        &self.metadata
    }

    /// A session for runs with these inputs and outputs, in this order.
    ///
    /// # Errors
    /// A name with a zero byte.
    pub(in crate::graph) fn session(
        &self,
        inputs: &[TensorSpec],
        outputs: &[TensorSpec],
    ) -> Result<Session, String> {
        Session::new(Arc::clone(&self.session), inputs, outputs)
    }
}

/// The folder for weights outside the model file: none. ONNX Runtime's default is the working directory, and
/// then a frame's model hash would not identify the model.
const NO_FOLDER: (&str, &str) = ("session.model_external_initializers_file_folder_path", "/dev/null");

/// Threads sleep as soon as a run ends. Spinning between two frames would use CPU time that the rest of the
/// robot needs.
const SLEEP_AFTER_RUN: (&str, &str) = ("session.force_spinning_stop", "1");

/// Within a run a thread that waits for another one spins for 50 us, then sleeps.
///
/// Most of the 160 operators of a network end within that, so threads are rarely woken. Without a limit, a
/// thread spins for as long as the thread that it waits for has lost its core to another process.
/// `wnet_c.onnx` on two cores, median in ms, quiet and with another process on one core: unlimited 27.1 and
/// 80.8, 50 us 27.3 and 47.4, 20 us 27.7 and 46.6, no spinning 30.4 and 46.2, one thread 45.7 and 45.4.
/// Before ONNX Runtime 1.31 the option does not exist and is ignored.
const SPIN_DURATION: (&str, &str) = ("session.intra_op.spin_duration_us", "50");

/// Exact 8-bit arithmetic on x86 processors without VNNI, where ONNX Runtime's fast one adds pairs of
/// products in 16 bits that saturate: depth of `wnet_c.onnx` with 8-bit weights was then 4.2 % off instead of
/// 2.1 % (mean of an image, against float32), and its self-test failed. Costs nothing with weights of 7 bits,
/// which `wnet_c.onnx` has now, and has no effect on other processors. Source:
/// `kOrtSessionOptionsAvx2PrecisionMode` in `onnxruntime_session_options_config_keys.h`.
const EXACT_INTEGERS: (&str, &str) = ("session.x64quantprecision", "1");

/// Keeps the provider of each node for [`Session::node_assignment`]: a few names per node.
const RECORD_ASSIGNMENT: (&str, &str) = ("session.record_ep_graph_assignment_info", "1");

/// The number of threads is always set, because ONNX Runtime pins threads to cores by default.
fn builder(runtime: &Runtime, provider: Provider, threads: NonZeroUsize) -> ort::Result<SessionBuilder> {
    let builder = SessionBuilder::new(runtime.environment())?
        .with_optimization_level(GraphOptimizationLevel::All)?
        .with_intra_threads(threads.get())?
        .with_inter_threads(1)?
        .with_intra_op_spinning(true)?
        .with_inter_op_spinning(false)?
        .with_config_entry(SLEEP_AFTER_RUN.0, SLEEP_AFTER_RUN.1)?
        .with_config_entry(SPIN_DURATION.0, SPIN_DURATION.1)?
        .with_config_entry(EXACT_INTEGERS.0, EXACT_INTEGERS.1)?
        .with_config_entry(NO_FOLDER.0, NO_FOLDER.1)?
        .with_config_entry(RECORD_ASSIGNMENT.0, RECORD_ASSIGNMENT.1)?;
    provider.register(builder, threads)
}

fn metadata(session: &ort::session::Session) -> ort::Result<BTreeMap<String, String>> {
    let metadata = session.metadata()?;
    let keys = metadata.custom_keys()?;
    Ok(keys.into_iter().filter_map(|key| metadata.custom(&key).map(|value| (key, value))).collect())
}

fn specs(outlets: &[Outlet]) -> Vec<TensorSpec> {
    let spec = |outlet: &Outlet| TensorSpec {
        name: outlet.name().to_owned(),
        element: outlet.dtype().tensor_type().map_or(ElementType::Other, element),
        shape: outlet.dtype().tensor_shape().map_or_else(Vec::new, |shape| shape.to_vec()),
    };
    outlets.iter().map(spec).collect()
}

fn element(element: TensorElementType) -> ElementType {
    match element {
        TensorElementType::Bool => ElementType::Bool,
        TensorElementType::Uint8 => ElementType::Uint8,
        TensorElementType::Int8 => ElementType::Int8,
        TensorElementType::Uint16 => ElementType::Uint16,
        TensorElementType::Int16 => ElementType::Int16,
        TensorElementType::Int32 => ElementType::Int32,
        TensorElementType::Int64 => ElementType::Int64,
        TensorElementType::Float16 => ElementType::Float16,
        TensorElementType::Bfloat16 => ElementType::Bfloat16,
        TensorElementType::Float32 => ElementType::Float32,
        TensorElementType::Float64 => ElementType::Float64,
        _ => ElementType::Other,
    }
}
