//! Why stages do not fit together: what one side gives, what the other wants, and the way out.

/// Why stages do not fit together.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what each field is")]
pub enum WiringError {
    /// No stage takes the picture.
    #[error("no stage takes the picture\nhint: bind an input of the first stage to `image`")]
    NoImage,
    /// A stage wants a picture that the graph cannot give.
    #[error("stage `{stage}` takes the picture as `{tensor}` of {kind}, but a picture is {expected}")]
    Image { stage: Box<str>, tensor: Box<str>, kind: Box<str>, expected: Box<str> },
    /// Two stages want pictures that differ.
    #[error(
        "stage `{stage}` takes a picture of {kind}, but stage `{first}` takes one of {first_kind}\nhint: export all \
         stages for one size of input"
    )]
    ImagesDiffer { first: Box<str>, first_kind: Box<str>, stage: Box<str>, kind: Box<str> },
    /// The picture has sides beyond any camera's.
    #[error("a picture of {kind} is larger than any camera's")]
    TooLarge { kind: Box<str> },
    /// `every` of 0.
    #[error("stage `{stage}` has `every = 0`\nhint: 1 runs it for each frame, 2 for each second one")]
    EveryZero { stage: Box<str> },
    /// The stage that gives the depth does not run for each frame.
    #[error(
        "stage `{stage}` has `every = {every}`, but it gives the depth\nhint: depth is measured for each frame; skip \
         an earlier stage"
    )]
    DepthSkipped { stage: Box<str>, every: u32 },
    /// Two stages of one name.
    #[error("two stages are named `{stage}`")]
    DuplicateStage { stage: Box<str> },
    /// The manifest binds an input that the file does not have.
    #[error("stage `{stage}` has no input `{tensor}`; its inputs are {inputs}")]
    UnknownInput { stage: Box<str>, tensor: Box<str>, inputs: Box<str> },
    /// The file has an input that the manifest does not bind.
    #[error(
        "stage `{stage}` is given nothing for its input `{tensor}` of {kind}\nhint: inputs = {{ {tensor} = \"image\" }} or a tensor of an earlier stage, \"stage.tensor\""
    )]
    Unbound { stage: Box<str>, tensor: Box<str>, kind: Box<str> },
    /// A reference to a stage that is not there.
    #[error(
        "{user} takes `{reference}`, but no stage has that name; the stages are {stages}\nhint: `image`, or `stage.tensor`"
    )]
    UnknownStage { user: Box<str>, reference: Box<str>, stages: Box<str> },
    /// A reference to the stage itself or a later one.
    #[error(
        "{user} takes a tensor of stage `{stage}`, which has not run by then\nhint: stages run in the order of the file"
    )]
    NotEarlier { user: Box<str>, stage: Box<str> },
    /// A reference to a tensor that the stage does not give.
    #[error("{user} takes `{tensor}` of stage `{stage}`, which gives {outputs}")]
    UnknownTensor { user: Box<str>, stage: Box<str>, tensor: Box<str>, outputs: Box<str> },
    /// A tensor that is used, but whose size is not fixed or not reasonable.
    #[error(
        "stage `{stage}` gives `{tensor}` of {kind}, whose size is not fixed\nhint: export the model with fixed dimensions"
    )]
    OpenOutput { stage: Box<str>, tensor: Box<str>, kind: Box<str> },
    /// Both sides are there and differ.
    #[error(
        "stage `{stage}` expects `{input}` of {expected}, but stage `{from}` gives `{tensor}` of {given}\nhint: export both stages for one size, with one element type where they meet"
    )]
    Mismatch {
        stage: Box<str>,
        input: Box<str>,
        expected: Box<str>,
        from: Box<str>,
        tensor: Box<str>,
        given: Box<str>,
    },
    /// The memory of a stage has a tensor that the file does not have.
    #[error(
        "stage `{stage}` remembers the {side} `{tensor}` (`nunet.state`), but the {side}s of its file are {there}\nhint: export the model again; `nunet.state` names the file's own tensors"
    )]
    StateMissing { stage: Box<str>, side: &'static str, tensor: Box<str>, there: Box<str> },
    /// The memory of a stage has a tensor that is another in the file.
    #[error(
        "stage `{stage}` remembers the {side} `{tensor}` (`nunet.state`) of {expected}, but its file has it of {given}\nhint: a memory is float32 of one fixed shape, the same in input, output and `nunet.state`"
    )]
    StateKind { stage: Box<str>, side: &'static str, tensor: Box<str>, expected: Box<str>, given: Box<str> },
    /// An input of a stage's memory is given something else as well.
    #[error(
        "stage `{stage}` takes `{tensor}` from its own memory (`nunet.state`), but is given `{source_name}` for it too\nhint: leave `{tensor}` out of the stage's `inputs`, or out of `nunet.state`"
    )]
    StateBound { stage: Box<str>, tensor: Box<str>, source_name: Box<str> },
    /// The depth map is part of a memory.
    #[error(
        "output `depth` is `{reference}`, which `nunet.state` keeps for the next frame, but depth leaves with its frame\nhint: give the memory an output of its own"
    )]
    StateIsDepth { reference: Box<str> },
    /// A result of the graph is not what the contract says.
    #[error(
        "output `{role}` is `{reference}` of {given}, but for a picture of {width}x{height} it must be {expected}"
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
