//! Why the stages of a graph do not fit together.

use std::borrow::Cow;

use nunet_types::Hint;

use crate::error_kind::ErrorKind;

/// Why the stages of a graph do not fit together.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what each field is")]
pub enum WiringError {
    /// No stage takes the image.
    #[error("no stage takes the image")]
    NoImage,
    /// A stage takes an image that the graph cannot provide.
    #[error("stage `{stage}` takes the image as `{tensor}` of {kind}, but the image is {expected}")]
    Image { stage: Box<str>, tensor: Box<str>, kind: Box<str>, expected: Box<str> },
    /// Two stages take different images.
    #[error("stage `{stage}` takes an image of {kind}, but stage `{first}` takes one of {first_kind}")]
    ImagesDiffer { first: Box<str>, first_kind: Box<str>, stage: Box<str>, kind: Box<str> },
    /// The image has sides beyond any camera's.
    #[error("an image of {kind} is larger than any camera's")]
    TooLarge { kind: Box<str> },
    /// `every` of 0.
    #[error("stage `{stage}` has `every = 0`")]
    EveryZero { stage: Box<str> },
    /// The stage of the depth output, or of its confidence, does not run for each frame.
    #[error(
        "stage `{stage}` has `every = {every}`, but computes the {role}, which is measured for each frame"
    )]
    DepthSkipped { role: &'static str, stage: Box<str>, every: u32 },
    /// One tensor as two results.
    #[error("the outputs `labels` and `confidence` are both `{reference}`")]
    SameResult { reference: Box<str> },
    /// Two stages of one name.
    #[error("two stages are named `{stage}`")]
    DuplicateStage { stage: Box<str> },
    /// No stage and no output of the graph uses a stage.
    #[error("stage `{stage}` is not used: no later stage and no output of the graph reads its tensors")]
    UnusedStage { stage: Box<str> },
    /// The manifest or the sidecar names an input that the file does not have.
    #[error("stage `{stage}` has no input `{tensor}`; its inputs are {inputs}")]
    UnknownInput { stage: Box<str>, tensor: Box<str>, inputs: Box<str> },
    /// The file has an input without a source.
    #[error("input `{tensor}` of stage `{stage}`, {kind}, has no source")]
    Unbound { stage: Box<str>, tensor: Box<str>, kind: Box<str>, in_sidecar: bool },
    /// A value of the sidecar that does not fit its input.
    #[error("input `{tensor}` is {kind}, which the sidecar's value of {elements} elements does not fit")]
    ExtraInput { tensor: Box<str>, kind: Box<str>, elements: Box<str> },
    /// A reference to a stage that does not exist.
    #[error("{user} takes `{reference}`, but no stage has that name; the stages are {stages}")]
    UnknownStage { user: Box<str>, reference: Box<str>, stages: Box<str> },
    /// A reference to the stage itself or a later one.
    #[error("{user} takes a tensor of stage `{stage}`, which runs later")]
    NotEarlier { user: Box<str>, stage: Box<str> },
    /// A reference to a tensor that the stage does not have.
    #[error("{user} takes `{tensor}` of stage `{stage}`, whose outputs are {outputs}")]
    UnknownTensor { user: Box<str>, stage: Box<str>, tensor: Box<str>, outputs: Box<str> },
    /// A tensor that is used, but whose size is not fixed or too large.
    #[error("output `{tensor}` of stage `{stage}` is {kind}, whose size is not fixed or too large")]
    OpenOutput { stage: Box<str>, tensor: Box<str>, kind: Box<str> },
    /// Both sides exist and differ.
    #[error("stage `{stage}` expects `{input}` of {expected}, but `{tensor}` of stage `{from}` is {given}")]
    Mismatch {
        stage: Box<str>,
        input: Box<str>,
        expected: Box<str>,
        from: Box<str>,
        tensor: Box<str>,
        given: Box<str>,
    },
    /// A state tensor that the file does not have.
    #[error(
        "the state of stage `{stage}` has the {side} `{tensor}`, but the {side}s of its file are {there}"
    )]
    StateMissing { stage: Box<str>, side: &'static str, tensor: Box<str>, there: Box<str> },
    /// A state tensor of another type or shape in the file.
    #[error(
        "the state of stage `{stage}` has the {side} `{tensor}` of {expected}, but its file has it of {given}"
    )]
    StateKind { stage: Box<str>, side: &'static str, tensor: Box<str>, expected: Box<str>, given: Box<str> },
    /// A state input with another source.
    #[error("input `{tensor}` of stage `{stage}` is part of its state, but is also bound to `{source_name}`")]
    StateBound { stage: Box<str>, tensor: Box<str>, source_name: Box<str> },
    /// The depth map is part of a state.
    #[error("output `depth` is `{reference}`, which is also part of a state")]
    StateIsDepth { reference: Box<str> },
    /// A result of the graph that is not as the contract specifies.
    #[error(
        "output `{role}` is `{reference}` of {given}, expected {expected} for an image of {width}x{height}"
    )]
    Result {
        role: &'static str,
        reference: Box<str>,
        given: Box<str>,
        expected: Box<str>,
        width: u32,
        height: u32,
    },
}

impl WiringError {
    /// [`ErrorKind::Wiring`].
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        ErrorKind::Wiring
    }
}

impl Hint for WiringError {
    fn hint(&self) -> Option<Cow<'static, str>> {
        Some(match self {
            Self::NoImage => "bind an input of the first stage to `image`".into(),
            Self::Image { kind, expected, .. } => image_hint(kind, expected).into(),
            Self::Result { role, given, expected, .. } => result_hint(role, given, expected)?.into(),
            Self::ImagesDiffer { .. } => "export all stages for one image size".into(),
            Self::EveryZero { .. } => "1 runs the stage for each frame, 2 for every second one".into(),
            Self::DepthSkipped { .. } => "skip an earlier stage instead".into(),
            Self::SameResult { .. } => "leave the output out that the model does not have".into(),
            Self::UnusedStage { .. } => "remove the stage, or use one of its tensors".into(),
            Self::Unbound { tensor, in_sidecar: true, .. } => format!(
                "feed it in the sidecar's `[inputs]`: `{tensor} = 1800` (a constant or a list), or `{tensor} = \
                 \"intrinsics\"` (the camera matrix)"
            )
            .into(),
            Self::Unbound { tensor, .. } => format!(
                "write `inputs = {{ {tensor} = \"image\" }}`, or a tensor of an earlier stage, \"stage.tensor\""
            )
            .into(),
            Self::ExtraInput { .. } => "write as many numbers as the input has elements, of its type".into(),
            Self::UnknownStage { .. } => "write `image`, or `stage.tensor`".into(),
            Self::NotEarlier { .. } => "stages run in the order of the file".into(),
            Self::OpenOutput { .. } => "export the model with fixed dimensions".into(),
            Self::Mismatch { .. } => "export both stages for one size and element type".into(),
            Self::StateMissing { .. } => "`nunet.state` lists tensors of the file; export the model again".into(),
            Self::StateKind { .. } => {
                "a state is float32 of one fixed shape, the same for input, output and `nunet.state`".into()
            }
            Self::StateBound { tensor, .. } => {
                format!("remove `{tensor}` from the stage's `inputs`, or from `nunet.state`").into()
            }
            Self::StateIsDepth { .. } => "give the state an output of its own".into(),
            _ => return None,
        })
    }
}

/// The element type in the text of a tensor: `float16` of `float16 [1, 1, 48, 64]`.
fn element(kind: &str) -> &str {
    kind.split(' ').next().unwrap_or_default()
}

/// How to keep half precision inside of a network.
const KEEP_FLOAT32: &str = "keep inputs and outputs in float32 when you convert to float16: \
                            `convert_float_to_float16(model, keep_io_types=True)` of onnxconverter-common";

/// How to make a network take the image of the contract, or of its sidecar.
fn image_hint(found: &str, expected: &str) -> &'static str {
    match (element(found), element(expected)) {
        (found, expected) if found == expected => {
            "set `layout` and `size` in the sidecar to those of the network, or export it again"
        }
        ("float16" | "bfloat16", _) => KEEP_FLOAT32,
        ("float64", _) => "export the network in float32: call `model.float()` before `torch.onnx.export`",
        ("uint8", "float32") => "set `dtype = \"uint8\"` in the sidecar",
        (_, "uint8") => {
            "export the network with its normalization inside, or describe its input in a sidecar (`dtype`, `mean`, `std`)"
        }
        _ => "convert the image inside of the network, and export it with a float32 input",
    }
}

/// How to make a network give depth or labels as the contract wants them. `None` if only the shape differs.
fn result_hint(role: &str, found: &str, expected: &str) -> Option<&'static str> {
    let (found, expected) = (element(found), element(expected));
    Some(match found {
        _ if found == expected => return None,
        _ if role != "depth" => "end the network with `.to(torch.uint8)`, then export it again",
        "float16" | "bfloat16" => KEEP_FLOAT32,
        "float64" => "export the network in float32: call `model.float()` before `torch.onnx.export`",
        _ => {
            "end the network with `.float()`, then export it again; the depth's `scale` belongs into its description"
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn depth(given: &str) -> WiringError {
        let (given, expected) = (given.into(), "float32 [1, 1, 48, 64]".into());
        WiringError::Result { role: "depth", reference: "out".into(), given, expected, width: 64, height: 48 }
    }

    #[test]
    fn every_other_element_type_has_a_hint_that_says_how_to_convert_it() {
        for (given, word) in
            [("float16", "keep_io_types"), ("float64", "model.float()"), ("int32", "`.float()`")]
        {
            let error = depth(&format!("{given} [1, 1, 48, 64]"));
            assert!(error.hint().is_some_and(|hint| hint.contains(word)), "{error}: {:?}", error.hint());
            let text = error.to_string();
            assert!(
                text.contains("`out`") && text.contains(given) && text.contains("expected float32"),
                "{text}"
            );
        }
        assert_eq!(depth("float32 [1, 1, 64, 48]").hint(), None);
        assert!(
            result_hint("labels", "int64 [1, 48, 64]", "uint8 [1, 48, 64]")
                .is_some_and(|hint| hint.contains("uint8"))
        );
    }

    #[test]
    fn an_image_of_another_type_or_shape_has_a_hint() {
        let image = "float32 [1, 3, 48, 64]";
        for (found, word) in [
            ("float16 [1, 3, 48, 64]", "keep_io_types"),
            ("uint8 [1, 3, 48, 64]", "uint8"),
            ("float32 [1, 48, 64, 3]", "layout"),
        ] {
            assert!(image_hint(found, image).contains(word), "{found}");
        }
        assert!(image_hint(image, "uint8 [1, H, W, 3]").contains("sidecar"));
    }
}
