//! ONNX Runtime's messages without the parts that only its developers can use.
//!
//! A message may be
//! `[ONNXRuntimeError] : 6 : FAIL : /x/conv.cc:41 Status Conv::Compute(...) const Invalid input shape: {0}`
//! and go on with a stack trace. What matters of it is `Invalid input shape: {0}`.

use std::fmt;

/// A message of ONNX Runtime. `Display` shows the part that matters.
#[derive(Clone, PartialEq, Eq)]
pub struct OnnxMessage {
    plain: String,
    full: String,
}

impl OnnxMessage {
    /// The message as ONNX Runtime wrote it, with places in its source and a stack trace, for a log of
    /// details.
    #[must_use]
    pub fn full(&self) -> &str {
        &self.full
    }
}

impl From<String> for OnnxMessage {
    fn from(full: String) -> Self {
        Self { plain: plain(&full), full }
    }
}

impl From<&str> for OnnxMessage {
    fn from(full: &str) -> Self {
        full.to_owned().into()
    }
}

impl fmt::Display for OnnxMessage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.plain)
    }
}

impl fmt::Debug for OnnxMessage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(&self.full, f)
    }
}

/// What precedes a reason and says nothing about it.
const PREAMBLES: [&str; 4] = [
    "Exception during initialization: ",
    "Exception during loading: ",
    "Exception: ",
    "This is an invalid model. ",
];
/// ONNX Runtime's words for an operator that failed, and between its name and the reason.
const FAILED_NODE: &str = "Non-zero status code returned while running ";
const STATUS: &str = " Status Message: ";
/// A check of its source that failed, before the reason.
const CHECK_FAILED: &str = " was false.";
/// What a message is replaced by if nothing is left of it.
const NO_REASON: &str = "ONNX Runtime gives no reason";

/// The sentence of a message that says what is wrong.
fn plain(full: &str) -> String {
    // Stack traces follow on lines of their own.
    let line = full.lines().map(str::trim).find(|line| !line.is_empty()).unwrap_or_default();
    let mut text = without_status(line).to_owned();
    if let Some((before, rest)) = text.split_once(FAILED_NODE) {
        let (node, reason) = rest.split_once(STATUS).unwrap_or((rest, ""));
        text = format!("{before}{}: {reason}", node_name(node));
    }
    while let Some(shorter) = without_source_place(&text) {
        text = shorter;
    }
    text.push(' '); // a preamble may be all that is left
    for preamble in PREAMBLES {
        text = text.replace(preamble, "");
    }
    let text = text.trim().trim_end_matches([':', ' ']);
    if text.is_empty() { NO_REASON.to_owned() } else { text.to_owned() }
}

/// Without `[ONNXRuntimeError] : 1 : FAIL : `.
fn without_status(text: &str) -> &str {
    let Some(rest) = text.strip_prefix("[ONNXRuntimeError] : ") else { return text };
    rest.splitn(3, " : ").nth(2).unwrap_or(rest)
}

/// ``operator `/conv/Conv` (Conv)`` for `Conv node. Name:'/conv/Conv'`.
fn node_name(node: &str) -> String {
    let (kind, rest) = node.split_once(" node.").unwrap_or((node, ""));
    let name = rest.trim().strip_prefix("Name:'").and_then(|name| name.strip_suffix('\''));
    match name {
        Some(name) if !name.is_empty() => format!("operator `{name}` ({kind})"),
        _ => format!("an operator of type {kind}"),
    }
}

/// Without the first place in ONNX Runtime's source: `/path/file.cc:12 signature of a function`, and a
/// condition of its code behind it. `None` if there is none.
fn without_source_place(text: &str) -> Option<String> {
    let ends = [".cc:", ".h:", ".cpp:", ".hpp:", ".cu:"];
    let (end, extension) = ends.iter().filter_map(|end| Some((text.find(end)?, end.len()))).min()?;
    // Names of operators may have spaces of several bytes.
    let start = text[..end].rfind(|c: char| c.is_ascii_whitespace()).map_or(0, |space| space + 1);
    let after = &text[end + extension..];
    let digits = after.find(|c: char| !c.is_ascii_digit()).unwrap_or(after.len());
    let after = after[digits..].trim_start();
    let mut rest = &after[signature_bytes(after)..];
    if let Some((_, reason)) = rest.split_once(CHECK_FAILED) {
        rest = reason;
    }
    Some(format!("{}{}", &text[..start], rest.trim_start()))
}

/// How long the signature of a C++ function is at the start of `text`: up to the end of its parameters and of
/// what follows them. 0 where there is none.
fn signature_bytes(text: &str) -> usize {
    let (mut depth, mut end) = (0_usize, 0);
    for (place, sign) in text.char_indices() {
        match sign {
            '(' => depth += 1,
            ')' if depth > 0 => {
                depth -= 1;
                let rest = &text[place + 1..];
                // `(anonymous namespace)::`, the parameter of a template, `operator()(`.
                if depth == 0 && !rest.starts_with([':', '>', ',', '(', '&', '*']) {
                    end = place + 1;
                    break;
                }
            }
            _ => {}
        }
    }
    // A sentence has no `::` and no pointer before its first parenthesis.
    let is_code = text[..end].contains("::") || text[..end].starts_with("void ");
    if !is_code {
        return 0;
    }
    let mut rest = &text[end..];
    for word in [" const", " noexcept"] {
        rest = rest.strip_prefix(word).unwrap_or(rest);
    }
    if let Some((_, behind)) = rest.strip_prefix(" [with ").and_then(|rest| rest.split_once(']')) {
        rest = behind;
    }
    text.len() - rest.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(full: &str, expected: &str) {
        let message = OnnxMessage::from(full);
        assert_eq!((message.to_string().as_str(), message.full()), (expected, full));
    }

    #[test]
    fn places_and_signatures_of_the_source_are_left_out() {
        check(
            "Non-zero status code returned while running Conv node. Name:'/a/Conv' Status Message: /src/core/conv.cc:123 \
             virtual onnxruntime::common::Status onnxruntime::Conv<float>::Compute(onnxruntime::OpKernelContext *) const \
             Input channels C is not equal to kernel channels * group. C: 3 kernel channels: 4",
            "operator `/a/Conv` (Conv): Input channels C is not equal to kernel channels * group. C: 3 kernel channels: 4",
        );
        check(
            "Exception during initialization: /src/core/framework/utils.cc:57 void \
             onnxruntime::(anonymous namespace)::Check(const std::function<void(int)>&, std::string) [with T = int] \
             status.IsOK() was false. the tensor is empty (0 of 3)",
            "the tensor is empty (0 of 3)",
        );
        check(
            "[ONNXRuntimeError] : 6 : RUNTIME_EXCEPTION : /a/b.h:1 onnxruntime::X::X(int) too large\nStacktrace:\n#1 0x12",
            "too large",
        );
    }

    #[test]
    fn sentences_remain_as_they_are() {
        for sentence in [
            "Protobuf parsing failed.",
            "Unsupported model IR version: 99, max supported IR version: 11",
            "No Op registered for Foo (in domain x) with domain_version of 17",
            "cannot read the file (see above)",
        ] {
            check(sentence, sentence);
        }
        check("This is an invalid model. Error in Node: Foo", "Error in Node: Foo");
        check(
            "Non-zero status code returned while running Gather node. Status Message: out of bounds",
            "an operator of type Gather: out of bounds",
        );
    }

    #[test]
    fn a_message_without_a_reason_says_so() {
        for full in ["", "\n\n", "/a/b.cc:12 onnxruntime::X::X(int)", "Exception: "] {
            assert_eq!(OnnxMessage::from(full).to_string(), NO_REASON, "{full:?}");
        }
    }

    #[test]
    fn odd_texts_do_not_panic() {
        for text in [".cc:", "a.cc:9 (((", "ä.cc:1 ö::ü(ß) ß", ".h:.h:.h:", "x.cc:1 a::b()"] {
            let _ = OnnxMessage::from(text).to_string();
        }
        check("a\u{a0}b.cc:1 c::d() too\u{2003}large", "too\u{2003}large");
        check("operator\u{2003}`x` /a/b.cc:1 c::d() e", "operator\u{2003}`x` e");
    }
}
