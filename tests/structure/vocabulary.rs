//! One term per concept: replaced words do not return to code, comments, documents or tests. `identifiers.rs`
//! has the words that are wrong as names only.

use crate::assert_none;
use crate::repository;

/// A replaced word, in all its forms, and the term to write instead.
const REPLACED: [(&[&str], &str); 22] = [
    (&["picture", "pictures"], "image"),
    (&["verb", "verbs"], "subcommand"),
    (&["optics"], "camera, intrinsics"),
    (&["outlet", "outlets"], "publisher"),
    (&["wish", "wishes", "wished"], "requested mode, option"),
    (&["mend", "mends", "mended", "mending"], "repair, fix"),
    (&["bury", "buries", "buried"], "remove"),
    (&["hush", "hushed"], "silence"),
    (&["patience"], "timeout"),
    (&["vetting", "vetted"], "model check"),
    (&["thrown"], "distort"),
    (&["sibling", "siblings"], "share_sessions"),
    (&["told"], "reported"),
    (&["sweep", "sweeps", "swept"], "remove, feed_damaged"),
    (&["bell", "bells"], "Notify"),
    (&["journey", "journeys"], "process_frame, pipeline"),
    (&["jump", "jumps", "jumped"], "discontinuity"),
    (&["bent"], "distorted"),
    (&["binned"], "decimated, subsampled"),
    (&["whoever"], "a program that, a user who"),
    (&["somebody", "everybody", "anybody"], "a user, every process, all users"),
    (&["anew"], "again"),
];

/// Two-word terms that were replaced.
const PHRASES: [(&str, &str); 16] = [
    ("left out", "dropped, lost, skipped, omitted"),
    ("stands still", "is paused, stalls"),
    ("stood still", "was paused, stalled"),
    ("who comes late", "a late subscriber"),
    ("looks on", "watches"),
    ("goes on with", "continues"),
    ("beside each other", "concurrently, side by side"),
    ("hands out", "returns, publishes"),
    ("gives out", "returns"),
    ("lives on", "stays valid"),
    ("as it lies", "as stored, in place"),
    ("as they lie", "as stored, in place"),
    ("what there is", "the existing ones"),
    ("for people", "as text, for users"),
    ("all the same", "anyway"),
    ("'s figures", "'s stats, metrics"),
];

/// Beginnings of British spellings, and the American ones.
const BRITISH: [(&str, &str); 25] = [
    ("colour", "color"),
    ("metres", "meters"),
    ("millimetre", "millimeter"),
    ("centimetre", "centimeter"),
    ("kilometre", "kilometer"),
    ("centre", "center"),
    ("grey", "gray"),
    ("neighbour", "neighbor"),
    ("behaviour", "behavior"),
    ("favour", "favor"),
    ("licence", "license"),
    ("artefact", "artifact"),
    ("catalogue", "catalog"),
    ("labell", "label"),
    ("quantis", "quantiz"),
    ("dequantis", "dequantiz"),
    ("normalis", "normaliz"),
    ("initialis", "initializ"),
    ("optimis", "optimiz"),
    ("organis", "organiz"),
    ("recognis", "recogniz"),
    ("serialis", "serializ"),
    ("minimis", "minimiz"),
    ("equalis", "equaliz"),
    ("learnt", "learned"),
];

/// Where a replaced word is right: the beginning of a path, a part of the line (lower case), and why.
const ALLOWED: [(&str, &str, &str); 29] = [
    ("tests/structure/vocabulary.rs", "", "the list itself"),
    ("tests/structure/identifiers.rs", "(\"", "a list of replaced names"),
    ("", "nunet-selftest", "a field of the model file"),
    ("crates/nunet-core/src/model/selftest/", "\"picture\"", "a field of the model file"),
    ("models/", "\"picture\"", "a class: a painting on a wall; a field of the model file"),
    ("models/recipe/", "\"pictures\"", "a key of `eval --json` and of the model file"),
    ("models/recipe/", "\"quantisation\"", "a key of the model file"),
    ("models/recipe/", "\"optimiser\"", "a key of checkpoints"),
    ("models/recipe/nunet_models/rendering/", "bent leaf", "plain English"),
    ("models/", "| picture |", "a class: a painting on a wall"),
    ("crates/nunet-types/src/classes.rs", "picture", "a class: a painting on a wall"),
    ("crates/nunet-testkit/src/demo/", "picture", "a class: a painting on a wall"),
    ("crates/nunet-eval/src/report.rs", "pictures", "a key of `eval --json`"),
    ("tests/python/", "[\"pictures\"]", "a key of `eval --json`"),
    ("crates/nunet-daemon/tests/cases.rs", "[\"pictures\"]", "a key of `eval --json`"),
    ("crates/nunet-daemon/tests/eval.rs", "[\"pictures\"]", "a key of `eval --json`"),
    ("docs/", "| class | bed |", "a class: a painting on a wall"),
    ("docs/", "`pictures`", "a key of `eval --json`"),
    ("crates/nunet-core/src/graph/onnx/model.rs", "outlet", "a type of ort"),
    ("crates/nunet-c/include/nunet.hpp", "thrown", "C++ exceptions"),
    ("crates/nunet-source/tests/", "counts_as_colour", "the name of a test case"),
    ("models/clip/README.md", "picture", "a class: a painting on a wall"),
    ("crates/nunet-mcap/src/topics.rs", "told apart", "plain English"),
    ("crates/nunet-source/src/recording.rs", "told apart", "plain English"),
    ("", "nunet_sweep", "an environment variable"),
    ("crates/nunet-source/", "grey", "a pixel format of V4L2; a test image"),
    ("docs/book/cameras.md", "grey,", "a pixel format of V4L2"),
    ("crates/nunet-mcap/src/", "\"grey\"", "spellings that other programs write"),
    ("crates/nunet-mcap/src/", "\"colour\"", "spellings that other programs write"),
];

/// The words of a line, lower case. Names such as `OldName` and `old_name` are two words.
fn words(line: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut after_lower = false;
    for c in line.chars() {
        if !c.is_alphabetic() || (c.is_uppercase() && after_lower) {
            words.push(String::new());
        }
        if c.is_alphabetic() {
            words.last_mut().expect("never empty").extend(c.to_lowercase());
        }
        after_lower = c.is_lowercase();
    }
    words.retain(|word| !word.is_empty());
    words
}

/// The term to write instead of a word, if it was replaced.
fn replacement(word: &str) -> Option<&'static str> {
    let replaced = REPLACED.iter().find(|(forms, _)| forms.contains(&word)).map(|(_, term)| *term);
    replaced.or_else(|| BRITISH.iter().find(|(british, _)| word.starts_with(british)).map(|(_, term)| *term))
}

fn replaced(path: &str, text: &str) -> Vec<String> {
    let mut problems = Vec::new();
    for (index, line) in text.lines().enumerate() {
        let lower = line.to_lowercase();
        if ALLOWED.iter().any(|(prefix, part, _)| path.starts_with(prefix) && lower.contains(part)) {
            continue;
        }
        let phrases = PHRASES.iter().filter(|(phrase, _)| lower.contains(phrase));
        let phrases = phrases.map(|(phrase, term)| ((*phrase).to_owned(), *term));
        let words = words(line).into_iter().filter_map(|word| replacement(&word).map(|term| (word, term)));
        for (old, term) in phrases.chain(words) {
            problems.push(format!("{path}:{}: `{old}`; write: {term}", index + 1));
        }
    }
    problems
}

fn is_written_by_us(path: &str) -> bool {
    let code = [".rs", ".py", ".pyi", ".h", ".hpp", ".c", ".cpp", ".js", ".html", ".css", ".sh", ".ci/run"];
    let texts = [".md", ".toml", ".yml", ".yaml", ".snap", ".ipynb", ".xml", ".cmake", ".in"];
    let packages =
        [".service", ".rules", ".tmpfiles", ".sysusers", "postinst", "postrm", "/changelog", "/copyright"];
    let endings = [&code[..], &texts, &packages, &["Containerfile"]].concat();
    endings.iter().any(|ending| path.ends_with(ending))
}

#[test]
fn no_replaced_word_is_left_in_code_or_documents() {
    let files = repository::texts(is_written_by_us);
    let problems: Vec<String> = files.iter().flat_map(|(path, text)| replaced(path, text)).collect();
    assert_none(&problems);
}

#[test]
fn a_replaced_word_is_found_in_every_spelling() {
    let lines = ["// a picture", "let picture_bytes = 1;", "struct RgbPicture;", "PICTURES", "fn mend() {}"];
    for line in lines.into_iter().chain(["Colours", "let is_quantised = 1;", "that is Left out"]) {
        assert_eq!(replaced("src/a.rs", line).len(), 1, "{line}");
    }
    assert_none(&replaced("src/a.rs", "amend depicture pictured"));
    assert_none(&replaced("tests/python/a.py", "found[\"pictures\"]"));
    assert_eq!(replaced("src/a.py", "found[\"pictures\"]").len(), 1);
}
