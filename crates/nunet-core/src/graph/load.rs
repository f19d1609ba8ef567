//! Loads a graph: a fused `.onnx`, a foreign one with its sidecar, or a staged `.toml`.

use std::collections::BTreeMap;
use std::io::Read as _;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

use crate::graph::manifest::{MAX_TOML_BYTES, Manifest};
use crate::graph::onnx::{OnnxModel, Runtime};
use crate::graph::wiring::{Contract, Unwired, Wired};
use crate::graph::{ElementType, GraphError, GraphOptions, ManifestError, Provider, Signature, trial};
use crate::model::{ExtraInput, ModelDescription, ModelError, SelfTest, Sidecar, SidecarError, StateTensor};
use crate::plain_file;
use crate::preprocess::TensorFormat;

/// The most bytes of a model file: the limit of protobuf.
const MAX_MODEL_BYTES: u64 = (1 << 31) - 1;

/// Everything of a graph except the memory to run it in.
pub(super) struct Loaded {
    pub(super) plan: Wired,
    /// The model of each stage, with the path of its file.
    pub(super) models: Vec<(PathBuf, OnnxModel)>,
    pub(super) description: ModelDescription,
    pub(super) provider: Provider,
    /// The format of a foreign network's image.
    pub(super) float_input: Option<TensorFormat>,
}

/// Loads and checks a graph.
pub(super) fn load(path: &Path, runtime: &Runtime, options: &GraphOptions) -> Result<Loaded, GraphError> {
    let loader = Loader::new(runtime, options)?;
    if is_manifest(path) { loader.staged(path, options) } else { loader.single(path, options) }
}

/// Every file of a graph: the model file and its sidecar if there is one, or the manifest and the files that
/// it names. Reads only manifests.
///
/// # Errors
/// A manifest that cannot be read or is invalid.
pub fn model_files(path: &Path) -> Result<Vec<PathBuf>, GraphError> {
    if is_manifest(path) {
        let (_, manifest) = read_manifest(path)?;
        let stages = manifest.stages.iter().map(|stage| file_of(path, &stage.model));
        return Ok(std::iter::once(path.to_owned()).chain(stages).collect());
    }
    let sidecar = Some(path.with_extension("toml")).filter(|sidecar| sidecar.is_file());
    Ok(std::iter::once(path.to_owned()).chain(sidecar).collect())
}

/// The SHA-256 of each of [`model_files`], in their order, for [`GraphOptions::allowed_hashes`].
///
/// # Errors
/// A manifest that cannot be read or is invalid; a file that is not a regular one, is empty, or is too large.
pub fn model_hashes(path: &Path) -> Result<Vec<[u8; 32]>, GraphError> {
    let hash = |file: PathBuf| -> Result<[u8; 32], GraphError> {
        let most = if is_manifest(&file) { MAX_TOML_BYTES } else { MAX_MODEL_BYTES };
        match read(&file, most) {
            Ok(bytes) => Ok(Sha256::digest(&bytes).into()),
            // Not a sidecar. Only a network that needs it is refused later.
            Err(_) if is_manifest(&file) && !is_manifest(path) => Ok([0; 32]),
            Err(error) => Err(error),
        }
    };
    model_files(path)?.into_iter().map(hash).collect()
}

fn is_manifest(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "toml")
}

/// The manifest's bytes and their content.
fn read_manifest(path: &Path) -> Result<(Vec<u8>, Manifest), GraphError> {
    let bytes = read(path, MAX_TOML_BYTES)?;
    let invalid = |source| GraphError::Manifest { path: path.to_owned(), source };
    let text = std::str::from_utf8(&bytes)
        .map_err(|error| invalid(ManifestError::Syntax { reason: error.to_string() }))?;
    let manifest = Manifest::parse(text).map_err(invalid)?;
    Ok((bytes, manifest))
}

/// A stage's file, which the manifest names relative to itself.
fn file_of(manifest: &Path, model: &str) -> PathBuf {
    manifest.parent().unwrap_or(Path::new("")).join(model)
}

struct Loader<'a> {
    runtime: &'a Runtime,
    allowed_hashes: &'a [[u8; 32]],
    provider: Provider,
    threads: NonZeroUsize,
}

impl<'a> Loader<'a> {
    fn new(runtime: &'a Runtime, options: &'a GraphOptions) -> Result<Self, GraphError> {
        let threads = options
            .threads
            .or_else(|| std::thread::available_parallelism().ok())
            .unwrap_or(NonZeroUsize::MIN);
        let provider = runtime.resolve(options.provider, threads).map_err(|error| GraphError::Provider {
            provider: error.provider,
            reason: error.reason.into(),
        })?;
        Ok(Self { runtime, allowed_hashes: &options.allowed_hashes, provider, threads })
    }

    /// A fused file, or a foreign network with its sidecar: a graph of one stage.
    fn single(&self, path: &Path, options: &GraphOptions) -> Result<Loaded, GraphError> {
        let (model, hash) = self.model(path)?;
        let file = path.file_name().unwrap_or_default().to_string_lossy();
        let described = |source| GraphError::Description { path: path.to_owned(), source };
        if ModelDescription::is_in(model.metadata()) {
            let description = ModelDescription::from_metadata(model.metadata(), hash).map_err(described)?;
            let outputs = &model.signature().outputs;
            let optional = ["labels", "confidence"]
                .map(|name| outputs.iter().any(|output| output.name == name).then_some(name));
            let manifest = Manifest::fused(&file, "rgb", "depth", optional);
            let models = vec![(path.to_owned(), model)];
            return self.wire(path, manifest, models, description, options);
        }
        self.foreign(path, model, hash, options)
    }

    /// A foreign network with its sidecar.
    fn foreign(
        &self,
        path: &Path,
        model: OnnxModel,
        hash: [u8; 32],
        options: &GraphOptions,
    ) -> Result<Loaded, GraphError> {
        let file = path.file_name().unwrap_or_default().to_string_lossy();
        let sidecar = self.sidecar_of(path)?;
        let manifest = Manifest::fused(&file, &sidecar.input, &sidecar.depth, [None; 2]);
        let contract = Contract::Foreign {
            element: if sidecar.format.is_some() { ElementType::Float32 } else { ElementType::Uint8 },
            image: sidecar.image_shape(),
            size: sidecar.size,
        };
        let signature = trial::with_depth_size(path, &model, &sidecar)?;
        let parts = WiringInput {
            manifest,
            signatures: vec![signature],
            states: vec![Vec::new()],
            extra_inputs: &sidecar.extra_inputs,
            contract,
        };
        let plan = parts.wire(path, options)?;
        Ok(Loaded {
            plan,
            models: vec![(path.to_owned(), model)],
            description: sidecar.describe(hash),
            provider: self.provider,
            float_input: sidecar.format,
        })
    }

    /// A manifest and the files that it names.
    fn staged(&self, path: &Path, options: &GraphOptions) -> Result<Loaded, GraphError> {
        let (bytes, manifest) = read_manifest(path)?;
        self.hash(path, &bytes)?;
        let mut hash = Sha256::new_with_prefix(&bytes);
        let mut models = Vec::with_capacity(manifest.stages.len());
        for stage in &manifest.stages {
            let file = file_of(path, &stage.model);
            let (model, file_hash) = self.model(&file)?;
            hash.update(file_hash);
            models.push((file, model));
        }
        // The stage of the depth output contains the description of the whole graph.
        let depth_stage = manifest.outputs.depth.split('.').next().unwrap_or_default();
        let speaker =
            manifest.stages.iter().position(|stage| stage.name == depth_stage).unwrap_or(models.len() - 1);
        let (file, model) = &models[speaker];
        let mut description = ModelDescription::from_metadata(model.metadata(), hash.finalize().into())
            .map_err(|source| GraphError::Description { path: file.clone(), source })?;
        if manifest.outputs.labels.is_none() {
            // The graph does not use the network's labels.
            description.selftest = description.selftest.map(SelfTest::without_labels);
        }
        self.wire(path, manifest, models, description, options)
    }

    fn model(&self, path: &Path) -> Result<(OnnxModel, [u8; 32]), GraphError> {
        let bytes = read(path, MAX_MODEL_BYTES)?;
        // Before ONNX Runtime reads anything of it.
        let hash = self.hash(path, &bytes)?;
        let model = OnnxModel::load(&bytes, self.runtime, self.provider, self.threads)
            .map_err(|reason| GraphError::Model { path: path.to_owned(), reason: reason.into() })?;
        Ok((model, hash))
    }

    /// The hash of a file that may be loaded.
    fn hash(&self, path: &Path, bytes: &[u8]) -> Result<[u8; 32], GraphError> {
        let hash: [u8; 32] = Sha256::digest(bytes).into();
        if self.allowed_hashes.is_empty() || self.allowed_hashes.contains(&hash) {
            Ok(hash)
        } else {
            Err(GraphError::Changed { path: path.to_owned() })
        }
    }

    /// The sidecar beside a model file without metadata.
    fn sidecar_of(&self, model: &Path) -> Result<Sidecar, GraphError> {
        let path = model.with_extension("toml");
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let invalid = |source| GraphError::Description { path: model.to_owned(), source };
        if !path.exists() {
            return Err(invalid(ModelError::Undescribed { sidecar: name }));
        }
        let bytes = read(&path, MAX_TOML_BYTES)?;
        self.hash(&path, &bytes)?;
        let text =
            std::str::from_utf8(&bytes).map_err(|error| SidecarError::Syntax { reason: error.to_string() });
        let parsed = text.and_then(Sidecar::parse);
        parsed.map_err(|source| invalid(ModelError::Sidecar { sidecar: name, source }))
    }

    /// Checks a graph of the contract.
    fn wire(
        &self,
        path: &Path,
        manifest: Manifest,
        models: Vec<(PathBuf, OnnxModel)>,
        description: ModelDescription,
        options: &GraphOptions,
    ) -> Result<Loaded, GraphError> {
        let states = models.iter().map(|(file, model)| {
            StateTensor::list(model.metadata())
                .map_err(|source| GraphError::Description { path: file.clone(), source })
        });
        let parts = WiringInput {
            manifest,
            signatures: models.iter().map(|(_, model)| model.signature().clone()).collect(),
            states: states.collect::<Result<_, _>>()?,
            extra_inputs: &BTreeMap::new(),
            contract: Contract::Nunet,
        };
        let plan = parts.wire(path, options)?;
        Ok(Loaded { plan, models, description, provider: self.provider, float_input: None })
    }
}

/// The input of the wiring.
struct WiringInput<'a> {
    manifest: Manifest,
    signatures: Vec<Signature>,
    states: Vec<Vec<StateTensor>>,
    extra_inputs: &'a BTreeMap<String, ExtraInput>,
    contract: Contract,
}

impl WiringInput<'_> {
    fn wire(mut self, path: &Path, options: &GraphOptions) -> Result<Wired, GraphError> {
        override_every(&mut self.manifest, options)?;
        let Self { manifest, signatures, states, extra_inputs, contract } = self;
        Unwired { manifest: &manifest, signatures, states, extra_inputs, contract }
            .wire()
            .map_err(|source| GraphError::Wiring { path: path.to_owned(), source: Box::new(source) })
    }
}

/// Applies [`GraphOptions::every`] to a manifest.
fn override_every(manifest: &mut Manifest, options: &GraphOptions) -> Result<(), GraphError> {
    for (index, (name, every)) in options.every.iter().enumerate() {
        if let Some((_, first)) = options.every[..index].iter().find(|(earlier, _)| earlier == name) {
            return Err(GraphError::EveryTwice { stage: name.clone(), first: *first, second: *every });
        }
        let names: Vec<String> = manifest.stages.iter().map(|stage| format!("`{}`", stage.name)).collect();
        let stage = manifest
            .stages
            .iter_mut()
            .find(|stage| stage.name == *name)
            .ok_or_else(|| GraphError::UnknownStage { stage: name.clone(), stages: names.join(", ") })?;
        stage.every = *every;
    }
    Ok(())
}

/// A whole file, if it is a regular one of a reasonable size.
fn read(path: &Path, most: u64) -> Result<Vec<u8>, GraphError> {
    let failed = |source| GraphError::Read { path: path.to_owned(), source };
    let Some(mut file) = plain_file::open(path, most).map_err(failed)? else {
        return Err(GraphError::NotAFile { path: path.to_owned() });
    };
    match file.get_ref().metadata().map_err(failed)?.len() {
        0 => {
            return Err(GraphError::Empty { path: path.to_owned() });
        }
        bytes if bytes > most => {
            return Err(GraphError::TooLarge { path: path.to_owned(), bytes, most });
        }
        _ => {}
    }
    let mut bytes = Vec::new();
    // A file that grows meanwhile is cut off here and refused when it is parsed.
    file.read_to_end(&mut bytes).map_err(failed)?;
    if bytes.starts_with(b"version https://git-lfs.github.com/spec/") {
        return Err(GraphError::LfsPointer { path: path.to_owned() });
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pointer_of_git_lfs_is_not_taken_for_a_damaged_model() {
        let path = std::env::temp_dir().join(format!("nunet_lfs_{}.onnx", std::process::id()));
        std::fs::write(&path, "version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 1\n").unwrap();
        let error = read(&path, 1000).unwrap_err();
        std::fs::remove_file(&path).unwrap();
        assert!(matches!(error, GraphError::LfsPointer { .. }), "{error}");
    }
}
