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
    Image {
        stage: String,
        tensor: String,
        kind: String,
        expected: String,
    },
    /// Two stages want pictures that differ.
    #[error(
        "stage `{stage}` takes a picture of {kind}, but stage `{first}` takes one of {first_kind}\nhint: export all \
         stages for one size of input"
    )]
    ImagesDiffer {
        first: String,
        first_kind: String,
        stage: String,
        kind: String,
    },
    /// The picture has sides beyond any camera's.
    #[error("a picture of {kind} is larger than any camera's")]
    TooLarge { kind: String },
    /// `every` of 0.
    #[error("stage `{stage}` has `every = 0`\nhint: 1 runs it for each frame, 2 for each second one")]
    EveryZero { stage: String },
    /// The stage that gives the depth does not run for each frame.
    #[error(
        "stage `{stage}` has `every = {every}`, but it gives the depth\nhint: depth is measured for each frame; skip \
         an earlier stage"
    )]
    DepthSkipped { stage: String, every: u32 },
    /// Two stages of one name.
    #[error("two stages are named `{stage}`")]
    DuplicateStage { stage: String },
    /// The manifest binds an input that the file does not have.
    #[error("stage `{stage}` has no input `{tensor}`; its inputs are {inputs}")]
    UnknownInput {
        stage: String,
        tensor: String,
        inputs: String,
    },
    /// The file has an input that the manifest does not bind.
    #[error(
        "stage `{stage}` is given nothing for its input `{tensor}` of {kind}\nhint: inputs = {{ {tensor} = \"image\" }} or a tensor of an earlier stage, \"stage.tensor\""
    )]
    Unbound {
        stage: String,
        tensor: String,
        kind: String,
    },
    /// A reference to a stage that is not there.
    #[error(
        "{user} takes `{reference}`, but no stage has that name; the stages are {stages}\nhint: `image`, or `stage.tensor`"
    )]
    UnknownStage {
        user: String,
        reference: String,
        stages: String,
    },
    /// A reference to the stage itself or a later one.
    #[error(
        "{user} takes a tensor of stage `{stage}`, which has not run by then\nhint: stages run in the order of the file"
    )]
    NotEarlier { user: String, stage: String },
    /// A reference to a tensor that the stage does not give.
    #[error("{user} takes `{tensor}` of stage `{stage}`, which gives {outputs}")]
    UnknownTensor {
        user: String,
        stage: String,
        tensor: String,
        outputs: String,
    },
    /// A tensor that is used, but whose size is not fixed or not reasonable.
    #[error(
        "stage `{stage}` gives `{tensor}` of {kind}, whose size is not fixed\nhint: export the model with fixed dimensions"
    )]
    OpenOutput {
        stage: String,
        tensor: String,
        kind: String,
    },
    /// Both sides are there and differ.
    #[error(
        "stage `{stage}` expects `{input}` of {expected}, but stage `{from}` gives `{tensor}` of {given}\nhint: export both stages for one size, with one element type where they meet"
    )]
    Mismatch {
        stage: String,
        input: String,
        expected: String,
        from: String,
        tensor: String,
        given: String,
    },
    /// A result of the graph is not what the contract says.
    #[error(
        "output `{role}` is `{reference}` of {given}, but for a picture of {width}x{height} it must be {expected}"
    )]
    Result {
        role: &'static str,
        reference: String,
        given: String,
        expected: String,
        width: u32,
        height: u32,
    },
}
