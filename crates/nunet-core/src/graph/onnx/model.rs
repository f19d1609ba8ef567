//! One model file, loaded: what it takes and gives, and what it says of itself.

use std::collections::BTreeMap;
use std::num::NonZeroUsize;

use ort::session::builder::{GraphOptimizationLevel, SessionBuilder};
use ort::value::{Outlet, TensorElementType};

use super::{Provider, Runtime, Session};
use crate::graph::{ElementType, Signature, TensorSpec};

/// A loaded model file, before it is known which of its outputs are wanted.
pub(in crate::graph) struct Model {
    session: ort::session::Session,
    signature: Signature,
    metadata: BTreeMap<String, String>,
}

impl Model {
    /// Loads a model from the bytes of its file. From bytes and not by path, so that what was hashed is what runs.
    ///
    /// `provider` is resolved, not `auto`.
    ///
    /// # Errors
    /// ONNX Runtime's words.
    pub(in crate::graph) fn load(
        bytes: &[u8],
        runtime: &Runtime,
        provider: Provider,
        threads: NonZeroUsize,
    ) -> Result<Self, String> {
        let session = builder(runtime, provider, threads)
            .and_then(|mut builder| builder.commit_from_memory(bytes))
            .map_err(|error| first_line(error.message()))?;
        let signature = Signature { inputs: specs(session.inputs()), outputs: specs(session.outputs()) };
        let metadata = metadata(&session).map_err(|error| first_line(error.message()))?;
        Ok(Self { session, signature, metadata })
    }

    /// What the model takes and gives.
    pub(in crate::graph) fn signature(&self) -> &Signature {
        &self.signature
    }

    /// The entries of `metadata_props`.
    pub(in crate::graph) fn metadata(&self) -> &BTreeMap<String, String> {
        &self.metadata
    }

    /// Ready to run with these inputs and outputs, in this order.
    ///
    /// # Errors
    /// A name that C cannot take.
    pub(in crate::graph) fn into_session(
        self,
        inputs: &[TensorSpec],
        outputs: &[TensorSpec],
    ) -> Result<Session, String> {
        Session::new(self.session, inputs, outputs)
    }
}

/// Where ONNX Runtime shall look for weights outside the model's file: nowhere. By default it would look in the
/// working directory, and a frame's model hash would not say what computed it.
const NO_FOLDER: (&str, &str) = ("session.model_external_initializers_file_folder_path", "/dev/null");

/// Threads spin between the operators of a run and sleep as soon as it ends: waking one for each of 160 operators costs
/// an eighth of a frame, and spinning between two frames would burn the cores that the rest of the robot needs.
const SLEEP_AFTER_RUN: (&str, &str) = ("session.force_spinning_stop", "1");

/// A number of threads is always set, because ONNX Runtime pins the threads of its own default to cores.
fn builder(runtime: &Runtime, provider: Provider, threads: NonZeroUsize) -> ort::Result<SessionBuilder> {
    let builder = SessionBuilder::new(runtime.environment())?
        .with_optimization_level(GraphOptimizationLevel::All)?
        .with_intra_threads(threads.get())?
        .with_inter_threads(1)?
        .with_intra_op_spinning(true)?
        .with_inter_op_spinning(false)?
        .with_config_entry(SLEEP_AFTER_RUN.0, SLEEP_AFTER_RUN.1)?
        .with_config_entry(NO_FOLDER.0, NO_FOLDER.1)?;
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

/// ONNX Runtime appends stack traces to some messages.
fn first_line(message: &str) -> String {
    message.lines().next().unwrap_or_default().trim_end().to_owned()
}
