//! Files that are no models, and models that are not what they should be.

use std::io::ErrorKind;
use std::path::Path;

use nunet_core::graph::{GraphError, GraphOptions, ManifestError, SerialGraph, WiringError, model_hashes};
use nunet_core::hint_of;
use nunet_core::model::ModelError;
use nunet_testkit::models;
use nunet_testkit::onnx::{ModelBuilder, OnnxElement};

use crate::{Folder, SIZE, chain, error_of, options, refusal, runtime, wiring_error};

const F32: OnnxElement = OnnxElement::F32;

/// A described network with these tensors, whose depth is a constant of the output's shape.
fn constant(input: (OnnxElement, &[i64]), output: (OnnxElement, &[i64])) -> ModelBuilder {
    let ones: Vec<i64> = vec![1; output.1.len()];
    let model = ModelBuilder::new()
        .input("rgb", input.0, input.1)
        .constant_f32("one", &ones, &[1.0])
        .constant_i64("shape", &[output.1.len() as i64], output.1)
        .node("Expand", &["one", "shape"], &["float"], &[])
        .node("Cast", &["float"], &["depth"], &[("to", (output.0 as i64).into())])
        .output("depth", output.0, output.1);
    models::describe(model, "constant", false)
}

fn refused(model: &ModelBuilder) -> GraphError {
    error_of(Folder::new().model("m.onnx", model).load("m.onnx"))
}

/// What is wrong with the model's description.
fn description_error(model: &ModelBuilder) -> ModelError {
    match refused(model) {
        GraphError::Description { source, .. } => source,
        other => panic!("{other}"),
    }
}

fn is_absent(error: &GraphError, name: &str) -> bool {
    match error {
        GraphError::Read { path, source } => path.ends_with(name) && source.kind() == ErrorKind::NotFound,
        _ => false,
    }
}

#[test]
fn a_missing_file_is_named() {
    let folder = Folder::new();
    let error = error_of(folder.load("absent.onnx"));
    assert!(is_absent(&error, "absent.onnx"), "{error}");
}

#[test]
fn a_folder_is_not_a_model() {
    let error = error_of(Folder::new().load(""));
    assert!(matches!(error, GraphError::NotAFile { .. }), "{error}");
}

#[test]
fn a_file_without_an_end_is_not_read() {
    let error = model_hashes(Path::new("/dev/zero")).unwrap_err();
    assert!(matches!(error, GraphError::NotAFile { .. }), "{error}");
}

#[test]
fn a_file_that_changed_after_it_was_hashed_is_not_loaded() {
    let folder = Folder::new().model("m.onnx", &models::unet(SIZE));
    let path = folder.path("m.onnx");
    let only = |allowed_hashes| GraphOptions { allowed_hashes, ..options() };
    let hashes = model_hashes(&path).unwrap();
    SerialGraph::load(&path, &runtime(), &only(hashes.clone())).unwrap();
    let folder = folder.model("m.onnx", &models::wnet(SIZE, true));
    let error = error_of(SerialGraph::load(&path, &runtime(), &only(hashes)));
    assert!(matches!(&error, GraphError::Changed { path: changed } if *changed == path), "{error}");
    assert!(hint_of(&error).is_some(), "{error}");
    drop(folder);
}

#[test]
fn a_sidecar_is_hashed_too_and_another_file_beside_the_model_is_ignored() {
    let folder = Folder::new().model("m.onnx", &models::unet(SIZE));
    let path = folder.path("m.onnx");
    let alone = model_hashes(&path).unwrap();
    let folder = folder.text("m.toml", "");
    let beside = model_hashes(&path).unwrap();
    assert_eq!((alone.len(), beside.len(), beside[0]), (1, 2, alone[0]));
    SerialGraph::load(&path, &runtime(), &GraphOptions { allowed_hashes: beside.clone(), ..options() })
        .unwrap();
    let _folder = folder.text("m.toml", "x = 1");
    assert_ne!(model_hashes(&path).unwrap(), beside);
}

#[test]
fn an_empty_file_is_reported_as_empty() {
    let error = error_of(Folder::new().text("m.onnx", "").load("m.onnx"));
    assert!(matches!(&error, GraphError::Empty { path } if path.ends_with("m.onnx")), "{error}");
}

#[test]
fn a_text_is_not_a_model() {
    let error = error_of(Folder::new().text("m.onnx", "not a model at all, just words\n").load("m.onnx"));
    assert!(matches!(&error, GraphError::Model { path, .. } if path.ends_with("m.onnx")), "{error}");
    // The other hint for a file that cannot be loaded names the option of the export.
    assert!(hint_of(&error).is_some_and(|hint| !hint.contains("external_data")), "{error}");
    assert_eq!(chain(&error).lines().count(), 2, "{error}");
}

#[test]
fn a_model_cut_at_any_length_is_refused() {
    let whole = models::wnet(SIZE, true).to_bytes();
    for length in (1..whole.len()).step_by(37) {
        let folder = Folder::new();
        std::fs::write(folder.path("m.onnx"), &whole[..length]).unwrap();
        refusal(folder.load("m.onnx"));
    }
}

/// The hash in each frame's header says which numbers computed it: there are no others than the file's.
#[test]
fn weights_outside_the_file_are_refused_even_where_they_can_be_found() {
    // The tests' working directory has this file, which is longer than the weights.
    assert!(std::fs::metadata("Cargo.toml").unwrap().len() > 12);
    let model = ModelBuilder::new()
        .input("rgb", OnnxElement::U8, &[1, 3, 6, 3])
        .constant_in_file("weights", &[3, 1], "Cargo.toml")
        .node("Cast", &["rgb"], &["float"], &[("to", 1.into())])
        .node("MatMul", &["float", "weights"], &["depth"], &[])
        .output("depth", F32, &[1, 3, 6, 1]);
    let error = refused(&models::describe(model, "unet", false));
    assert!(matches!(error, GraphError::Model { .. }), "{error}");
    assert!(hint_of(&error).is_some_and(|hint| hint.contains("external_data=False")), "{error}");
}

#[test]
fn the_error_for_a_model_without_metadata_has_a_hint() {
    let error = description_error(&models::undescribed_unet(SIZE));
    assert_eq!(error, ModelError::Undescribed { sidecar: "m.toml".to_owned() });
    assert!(hint_of(&error).is_some_and(|hint| hint.contains("`m.toml`")), "{error}");
}

#[test]
fn another_version_of_the_contract_is_refused_by_name() {
    let error = description_error(&models::unet(SIZE).metadata("nunet.version", "7"));
    assert_eq!(error, ModelError::Version { version: "7".to_owned(), expected: "1" });
}

#[test]
fn malformed_metadata_is_named_with_its_key() {
    let error = description_error(&models::unet(SIZE).metadata("nunet.classes", "[\"wall\""));
    let is_of_classes =
        matches!(&error, ModelError::Invalid { key: "nunet.classes", value, .. } if value == "[\"wall\"");
    assert!(is_of_classes, "{error}");
}

#[test]
fn images_of_another_kind_are_refused() {
    let depth = (F32, &[1, 1, 3, 6][..]);
    for (input, kind) in [
        ((F32, &[1, 3, 6, 3][..]), "float32 [1, 3, 6, 3]"),
        ((OnnxElement::U8, &[1, 3, 3, 6]), "uint8 [1, 3, 3, 6]"),
        ((OnnxElement::U8, &[3, 6, 3]), "uint8 [3, 6, 3]"),
        ((OnnxElement::U8, &[-1, 3, 6, 3]), "uint8 [?, 3, 6, 3]"),
        ((OnnxElement::U8, &[1, -1, -1, 3]), "uint8 [1, ?, ?, 3]"),
    ] {
        let expected = WiringError::Image {
            stage: "network".into(),
            tensor: "rgb".into(),
            kind: kind.into(),
            expected: "uint8 [1, H, W, 3]".into(),
        };
        assert_eq!(wiring_error(refused(&constant(input, depth))), expected);
    }
}

#[test]
fn depth_of_another_kind_is_refused() {
    let image = (OnnxElement::U8, &[1, 3, 6, 3][..]);
    for (output, kind) in [
        ((OnnxElement::F64, &[1, 1, 3, 6][..]), "float64 [1, 1, 3, 6]"),
        ((OnnxElement::U8, &[1, 1, 3, 6]), "uint8 [1, 1, 3, 6]"),
        ((F32, &[1, 3, 6]), "float32 [1, 3, 6]"),
        ((F32, &[1, 1, 6, 12]), "float32 [1, 1, 6, 12]"),
        ((F32, &[1, 1, 6, 3]), "float32 [1, 1, 6, 3]"),
    ] {
        let expected = WiringError::Result {
            role: "depth",
            reference: "network.depth".into(),
            given: kind.into(),
            expected: "float32 [1, 1, 3, 6]".into(),
            width: 6,
            height: 3,
        };
        assert_eq!(wiring_error(refused(&constant(image, output))), expected);
    }
}

#[test]
fn an_input_of_another_name_is_refused_naming_it() {
    let model = models::describe(
        ModelBuilder::new()
            .input("image", OnnxElement::U8, &[1, 3, 6, 3])
            .node("Cast", &["image"], &["depth"], &[("to", 1.into())])
            .output("depth", F32, &[1, 3, 6, 3]),
        "unet",
        false,
    );
    let expected =
        WiringError::UnknownInput { stage: "network".into(), tensor: "rgb".into(), inputs: "`image`".into() };
    assert_eq!(wiring_error(refused(&model)), expected);
}

#[test]
fn a_constant_depth_is_written_to_the_caller_like_any_other() {
    let model = constant((OnnxElement::U8, &[1, 3, 6, 3]), (F32, &[1, 1, 3, 6]));
    let mut graph = Folder::new().model("m.onnx", &model).load("m.onnx").unwrap();
    assert_eq!(crate::run(&mut graph, &crate::image(SIZE)).depth, [1.0; 18]);
}

#[test]
fn staged_graphs_with_broken_files_are_refused() {
    let refused = |manifest: &str| {
        error_of(Folder::new().text("graph.toml", &format!("# a graph\n{manifest}")).load("graph.toml"))
    };
    let manifest_error = |manifest: &str| match refused(manifest) {
        GraphError::Manifest { source, .. } => source,
        other => panic!("{other}"),
    };
    for (manifest, named) in [("", "`version`"), ("version = 1\n[[stage]\n", "line 3")] {
        let error = manifest_error(manifest);
        let is_of_it = matches!(&error, ManifestError::Syntax { reason } if reason.contains(named));
        assert!(is_of_it, "{error}");
    }
    let outputs = "[outputs]\ndepth = \"a.depth\"\n";
    let error = manifest_error(&format!("version = 3\n{outputs}"));
    assert_eq!(error, ManifestError::Version { version: 3 });
    let error = manifest_error(&format!("version = 1\n{outputs}"));
    assert_eq!(error, ManifestError::StageCount { count: 0 });
    let of_file = |model: &str| {
        format!("version = 1\n[[stage]]\nname = \"a\"\nmodel = \"{model}\"\ninputs = {{}}\n{outputs}")
    };
    let outside = ManifestError::ModelOutside { stage: "a".to_owned(), model: "../a.onnx".to_owned() };
    assert_eq!(manifest_error(&of_file("../a.onnx")), outside);
    let error = refused(&of_file("a.onnx"));
    assert!(is_absent(&error, "a.onnx"), "{error}");
}

#[test]
fn a_huge_manifest_is_not_read() {
    let folder = Folder::new().text("graph.toml", &"#".repeat(100_000));
    let error = error_of(folder.load("graph.toml"));
    assert!(matches!(error, GraphError::TooLarge { bytes: 100_000, .. }), "{error}");
}
