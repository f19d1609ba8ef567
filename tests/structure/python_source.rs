//! What the tests read in Python files, by Python's own parser.

use std::process::{Command, Stdio};

use serde::de::DeserializeOwned;

/// Runs a script over files of (path, text), which it reads from `files`; `found` is the list that it makes.
pub(crate) fn run<T: DeserializeOwned>(script: &str, files: &[(String, String)]) -> Vec<T> {
    let script = format!(
        "import ast, json, sys\nfiles, found = json.load(sys.stdin), []\n{script}\njson.dump(found, sys.stdout)"
    );
    let mut python = Command::new("python3");
    python.args(["-c", &script]).stdin(Stdio::piped()).stdout(Stdio::piped());
    let mut child = python.spawn().expect("these tests need python3");
    serde_json::to_writer(child.stdin.take().expect("it is piped"), files).expect("python3 reads the files");
    let output = child.wait_with_output().expect("python3 ends");
    assert!(output.status.success(), "Python cannot parse the files");
    serde_json::from_slice(&output.stdout).expect("the script prints such a list")
}
