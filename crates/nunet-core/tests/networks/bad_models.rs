//! Files that are no models, and models that are not what they should be.

use std::path::Path;

use nunet_core::graph::{GraphError, GraphOptions, SerialGraph, model_hashes};
use nunet_testkit::models;
use nunet_testkit::onnx::{ModelBuilder, OnnxElement};

use crate::{Folder, SIZE, options, refusal, runtime};

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

fn message(model: &ModelBuilder) -> String {
    refusal(Folder::new().model("m.onnx", model).load("m.onnx"))
}

#[test]
fn a_missing_file_is_named() {
    let folder = Folder::new();
    let message = refusal(folder.load("absent.onnx"));
    assert!(message.contains("absent.onnx`: No such file"), "{message}");
}

#[test]
fn a_folder_is_not_a_model() {
    assert!(refusal(Folder::new().load("")).ends_with("is not a file"));
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
    let message = refusal(SerialGraph::load(&path, &runtime(), &only(hashes)));
    assert!(message.contains("m.onnx` has changed since it was checked\nhint: "), "{message}");
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
    assert!(refusal(Folder::new().text("m.onnx", "").load("m.onnx")).ends_with("m.onnx` is empty"));
}

#[test]
fn a_text_is_not_a_model() {
    let message = refusal(Folder::new().text("m.onnx", "not a model at all, just words\n").load("m.onnx"));
    assert!(message.starts_with("cannot load the model `"), "{message}");
    assert!(message.contains("\nhint: the file is damaged or is not an ONNX model"), "{message}");
    assert_eq!(message.lines().count(), 2, "{message}");
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
    let message = message(&models::describe(model, "unet", false));
    assert!(message.contains("\nhint: keep the weights inside the file"), "{message}");
}

#[test]
fn the_error_for_a_model_without_metadata_has_a_hint() {
    let message = message(&models::undescribed_unet(SIZE));
    assert!(
        message.contains("there is no sidecar `m.toml`\nhint: describe a foreign network in `m.toml`"),
        "{message}"
    );
}

#[test]
fn another_version_of_the_contract_is_refused_by_name() {
    let message = message(&models::unet(SIZE).metadata("nunet.version", "7"));
    assert!(message.contains("`nunet.version` is `7`, expected `1`"), "{message}");
}

#[test]
fn malformed_metadata_is_named_with_its_key() {
    let message = message(&models::unet(SIZE).metadata("nunet.classes", "[\"wall\""));
    assert!(message.contains("`nunet.classes` is `[\"wall\"`: EOF while parsing"), "{message}");
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
        let message = message(&constant(input, depth));
        let expected = format!("takes the image as `rgb` of {kind}, but the image is uint8 [1, H, W, 3]");
        assert!(message.contains(&expected), "{message}");
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
        let message = message(&constant(image, output));
        let expected =
            format!("is `network.depth` of {kind}, expected float32 [1, 1, 3, 6] for an image of 6x3");
        assert!(message.contains(&expected), "{message}");
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
    let message = message(&model);
    assert!(message.contains("stage `network` has no input `rgb`; its inputs are `image`"), "{message}");
}

#[test]
fn a_constant_depth_is_written_to_the_caller_like_any_other() {
    let model = constant((OnnxElement::U8, &[1, 3, 6, 3]), (F32, &[1, 1, 3, 6]));
    let mut graph = Folder::new().model("m.onnx", &model).load("m.onnx").unwrap();
    assert_eq!(crate::run(&mut graph, &crate::image(SIZE)).depth, [1.0; 18]);
}

#[test]
fn staged_graphs_with_broken_files_are_refused() {
    for (manifest, says) in [
        ("", "missing field `version`"),
        ("version = 1\n[[stage]\n", "TOML parse error"),
        ("version = 3\n[outputs]\ndepth = \"a.depth\"\n", "`version` is 3, expected 1"),
        ("version = 1\n[outputs]\ndepth = \"a.depth\"\n", "there are 0 stages, expected 1 to"),
        (
            "version = 1\n[[stage]]\nname = \"a\"\nmodel = \"../a.onnx\"\ninputs = {}\n[outputs]\ndepth = \"a.depth\"\n",
            "model `../a.onnx` of stage `a` is outside the manifest's folder",
        ),
        (
            "version = 1\n[[stage]]\nname = \"a\"\nmodel = \"a.onnx\"\ninputs = {}\n[outputs]\ndepth = \"a.depth\"\n",
            "a.onnx`: No such file",
        ),
    ] {
        let folder = Folder::new().text("graph.toml", &format!("# a graph\n{manifest}"));
        let message = refusal(folder.load("graph.toml"));
        assert!(message.contains(says), "{message}");
    }
}

#[test]
fn a_huge_manifest_is_not_read() {
    let folder = Folder::new().text("graph.toml", &"#".repeat(100_000));
    assert!(refusal(folder.load("graph.toml")).contains("has 100000 bytes"));
}
