//! Libraries that are not ONNX Runtime, or not a good one: an error that says so, never a panic or a wait.

use std::path::{Path, PathBuf};
use std::process::Command;

use nunet_core::graph::{GraphError, GraphOptions, Provider, Runtime, RuntimeError, SerialGraph};
use nunet_core::hint_of;
use nunet_testkit::models;

use crate::{Folder, SIZE, chain, error_of, options, runtime};

/// A shared library of one C file, made by the C compiler that the project assumes.
fn shared_library(folder: &Folder, name: &str, source: &str) -> PathBuf {
    let (code, library) = (folder.path(&format!("{name}.c")), folder.path(&format!("{name}.so")));
    std::fs::write(&code, source).unwrap();
    let made = Command::new("cc").args(["-shared", "-fPIC", "-o"]).arg(&library).arg(&code).status().unwrap();
    assert!(made.success());
    library
}

fn load_error(library: &Path) -> RuntimeError {
    match Runtime::load(library) {
        Ok(_) => panic!("`{}` was taken for ONNX Runtime", library.display()),
        Err(error) => error,
    }
}

#[test]
fn the_library_has_a_version_and_a_path() {
    let runtime = runtime();
    assert!(runtime.version().starts_with("1."), "{}", runtime.version());
    assert!(runtime.library().is_absolute());
}

#[test]
fn a_missing_library_is_an_error() {
    let nowhere = Path::new("/nowhere/libonnxruntime.so");
    let error = load_error(nowhere);
    assert!(matches!(&error, RuntimeError::Missing { library, .. } if library == nowhere), "{error}");
}

#[test]
fn a_text_file_is_an_error() {
    let folder = Folder::new().text("libonnxruntime.so", "this is not a library\n");
    let error = load_error(&folder.path("libonnxruntime.so"));
    assert!(matches!(error, RuntimeError::NotALibrary { .. }), "{error}");
}

#[test]
fn a_folder_and_a_pipe_are_errors() {
    let folder = Folder::new();
    let pipe = folder.path("pipe");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    for path in [folder.path(""), pipe] {
        assert!(matches!(load_error(&path), RuntimeError::NotAFile { .. }));
    }
}

#[test]
fn another_shared_library_is_an_error() {
    let folder = Folder::new();
    let library = shared_library(&folder, "other", "int answer(void) { return 42; }");
    let error = load_error(&library);
    assert!(matches!(error, RuntimeError::NotOnnxRuntime { .. }), "{error}");
}

#[test]
fn a_library_without_an_interface_is_an_error() {
    let folder = Folder::new();
    let source = "void *OrtGetApiBase(void) { return 0; }";
    let error = load_error(&shared_library(&folder, "null", source));
    assert!(matches!(error, RuntimeError::NotOnnxRuntime { .. }), "{error}");
}

#[test]
fn a_library_that_is_too_old_is_an_error_with_both_versions() {
    let folder = Folder::new();
    let source = r#"
        static const void *api(unsigned version) { return version <= 17 ? &api : 0; }
        static const char *version(void) { return "1.17.3"; }
        static const struct { const void *(*api)(unsigned); const char *(*version)(void); } base = { api, version };
        const void *OrtGetApiBase(void) { return &base; }
    "#;
    let error = load_error(&shared_library(&folder, "old", source));
    let is_old = matches!(&error, RuntimeError::TooOld { version, minimum: 24, .. } if version == "1.17.3");
    assert!(is_old, "{error}");
}

#[test]
fn a_second_library_is_refused_naming_the_first() {
    let first = runtime();
    let folder = Folder::new();
    let copy = folder.path("libonnxruntime.so");
    std::fs::copy(first.library(), &copy).unwrap();
    let error = load_error(&copy);
    assert!(matches!(error, RuntimeError::AnotherLoaded { .. }), "{error}");
    assert!(error.to_string().contains(&*first.library().to_string_lossy()), "{error}");
}

#[test]
fn providers_that_the_library_does_not_have_are_errors() {
    let folder = Folder::new().model("unet.onnx", &models::unet(SIZE));
    for provider in [Provider::OpenVino, Provider::Cuda, Provider::TensorRt] {
        let options = GraphOptions { provider, ..options() };
        let error = error_of(SerialGraph::load(&folder.path("unet.onnx"), &runtime(), &options));
        let is_of_it = matches!(&error, GraphError::Provider { provider: named, .. } if *named == provider);
        assert!(is_of_it && hint_of(&error).is_some(), "{error}");
    }
}

#[test]
fn auto_chooses_the_cpu_if_there_is_nothing_else() {
    let folder = Folder::new().model("unet.onnx", &models::unet(SIZE));
    assert_eq!(folder.load("unet.onnx").unwrap().provider(), Provider::Cpu);
}

#[test]
fn providers_are_named_as_on_the_command_line() {
    for provider in Provider::ALL {
        assert_eq!(provider.name().parse::<Provider>().unwrap(), provider);
    }
    let error = "gpu".parse::<Provider>().unwrap_err();
    assert!(chain(&error).contains(" auto, cpu"), "{}", chain(&error));
}

#[test]
fn every_node_has_a_provider_that_computes_it_also_of_a_staged_graph() {
    let fused = Folder::new().model("m.onnx", &models::wnet(SIZE, true)).load("m.onnx").unwrap();
    let assignment = fused.node_assignment().unwrap();
    assert_eq!(assignment.keys().collect::<Vec<_>>(), ["CPUExecutionProvider"]);
    assert!(assignment["CPUExecutionProvider"] > 1, "{assignment:?}");
    assert_eq!(fused.share_sessions().unwrap().node_assignment().unwrap(), assignment);
    let one = Folder::new().model("m.onnx", &models::unet(SIZE)).load("m.onnx").unwrap();
    let fewer = one.node_assignment().unwrap()["CPUExecutionProvider"];
    assert!(fewer < assignment["CPUExecutionProvider"], "one component has fewer nodes than two");
}
