use super::*;

/// Inputs of a stage and where they come from.
type Inputs<'a> = &'a [(&'a str, &'a str)];

/// A manifest of stages `(name, every, inputs)`.
fn manifest(stages: &[(&str, u32, Inputs<'_>)], depth: &str, labels: Option<&str>) -> Manifest {
    let stage = |&(name, every, inputs): &(&str, u32, Inputs<'_>)| ManifestStage {
        name: name.to_owned(),
        model: format!("{name}.onnx"),
        inputs: inputs.iter().map(|&(input, source)| (input.to_owned(), source.to_owned())).collect(),
        every,
    };
    Manifest {
        version: 1,
        stages: stages.iter().map(stage).collect(),
        outputs: crate::graph::manifest::ManifestOutputs {
            depth: depth.to_owned(),
            labels: labels.map(str::to_owned),
            confidence: None,
        },
    }
}

fn tensor(name: &str, element: ElementType, shape: &[i64]) -> TensorSpec {
    TensorSpec { name: name.to_owned(), element, shape: shape.to_vec() }
}

fn rgb() -> TensorSpec {
    tensor("rgb", ElementType::Uint8, &[1, 480, 640, 3])
}

fn depth() -> TensorSpec {
    tensor("depth", ElementType::Float32, &[1, 1, 480, 640])
}

fn logits(height: i64, width: i64) -> TensorSpec {
    tensor("logits", ElementType::Float32, &[1, 13, height, width])
}

fn labels() -> TensorSpec {
    tensor("labels", ElementType::Uint8, &[1, 480, 640])
}

fn signature(inputs: &[TensorSpec], outputs: &[TensorSpec]) -> Signature {
    Signature { inputs: inputs.to_vec(), outputs: outputs.to_vec() }
}

fn segmentation() -> Signature {
    signature(&[rgb()], &[logits(480, 640), labels()])
}

/// The connected depth stage; its second input is named `features`.
fn depth_stage() -> Signature {
    let features = TensorSpec { name: "features".to_owned(), ..logits(480, 640) };
    signature(&[rgb(), features], &[depth()])
}

fn wire(manifest: &Manifest, signatures: &[Signature]) -> Result<Wired, WiringError> {
    let states = vec![Vec::new(); signatures.len()];
    wire_parts(manifest, signatures.to_vec(), states, Contract::Nunet)
}

fn wire_parts(
    manifest: &Manifest,
    signatures: Vec<Signature>,
    states: Vec<Vec<StateTensor>>,
    contract: Contract,
) -> Result<Wired, WiringError> {
    Unwired { manifest, signatures, states, extra_inputs: &BTreeMap::new(), contract }.wire()
}

const SEES_IMAGE: Inputs<'static> = &[("rgb", "image")];
const CONNECTED: Inputs<'static> = &[("rgb", "image"), ("features", "segmentation.logits")];

/// The W-Net of the documentation with other inputs for its second stage.
fn wnet(inputs: Inputs<'_>, signatures: &[Signature]) -> Result<Wired, WiringError> {
    let stages = [("segmentation", 1, SEES_IMAGE), ("depth", 1, inputs)];
    wire(&manifest(&stages, "depth.depth", Some("segmentation.labels")), signatures)
}

#[test]
fn stages_that_fit_become_a_plan() {
    let plan = wnet(CONNECTED, &[segmentation(), depth_stage()]).unwrap();
    assert_eq!(plan.size, ImageSize::new(640, 480));
    let names: Vec<&str> = plan.tensors.iter().map(|tensor| tensor.name.as_str()).collect();
    assert_eq!(names, ["segmentation.logits", "segmentation.labels", "depth.depth"]);
    assert_eq!((plan.depth, plan.labels), (2, Some(1)));
    assert_eq!(plan.stages[0].outputs, 0..2);
    assert_eq!(plan.stages[1].inputs, [InputSource::Image, InputSource::Tensor(0)]);
}

#[test]
fn a_single_stage_is_a_graph() {
    let plan = wire(&manifest(&[("a", 1, SEES_IMAGE)], "a.depth", None), &[signature(&[rgb()], &[depth()])]);
    assert_eq!(plan.unwrap().labels, None);
}

#[test]
fn an_input_without_a_source_is_named() {
    let error = wnet(SEES_IMAGE, &[segmentation(), depth_stage()]).unwrap_err();
    let expected = WiringError::Unbound {
        stage: "depth".into(),
        tensor: "features".into(),
        kind: "float32 [1, 13, 480, 640]".into(),
        in_sidecar: false,
    };
    assert_eq!(error, expected);
}

#[test]
fn an_input_that_the_file_does_not_have_is_named_beside_those_it_has() {
    let inputs = &[("rgb", "image"), ("feature", "segmentation.logits")];
    let error = wnet(inputs, &[segmentation(), depth_stage()]).unwrap_err().to_string();
    assert_eq!(error, "stage `depth` has no input `feature`; its inputs are `rgb`, `features`");
}

#[test]
fn a_reference_to_an_unknown_tensor_lists_the_known_ones() {
    let unknown_stage = |reference: &str| WiringError::UnknownStage {
        user: "stage `depth`".into(),
        reference: reference.into(),
        stages: "`segmentation`, `depth`".into(),
    };
    let unknown_tensor = |tensor: &str| WiringError::UnknownTensor {
        user: "stage `depth`".into(),
        stage: "segmentation".into(),
        tensor: tensor.into(),
        outputs: "`logits`, `labels`".into(),
    };
    let itself = WiringError::NotEarlier { user: "stage `depth`".into(), stage: "depth".into() };
    for (source, expected) in [
        ("segment.logits", unknown_stage("segment.logits")),
        ("logits", unknown_stage("logits")),
        ("segmentation.logit", unknown_tensor("logit")),
        ("segmentation", unknown_tensor("")),
        ("depth.depth", itself),
    ] {
        let inputs = &[("rgb", "image"), ("features", source)];
        assert_eq!(wnet(inputs, &[segmentation(), depth_stage()]).unwrap_err(), expected);
    }
}

#[test]
fn a_later_stage_cannot_be_referenced() {
    let stages = [("depth", 1, CONNECTED), ("segmentation", 1, SEES_IMAGE)];
    let error = wire(&manifest(&stages, "depth.depth", None), &[depth_stage(), segmentation()]).unwrap_err();
    assert_eq!(error, WiringError::NotEarlier { user: "stage `depth`".into(), stage: "segmentation".into() });
}

/// Logits that the depth stage does not expect.
fn other_logits(given: &str) -> WiringError {
    WiringError::Mismatch {
        stage: "depth".into(),
        input: "features".into(),
        expected: "float32 [1, 13, 480, 640]".into(),
        from: "segmentation".into(),
        tensor: "logits".into(),
        given: given.into(),
    }
}

#[test]
fn shapes_that_differ_are_refused_naming_both_sides() {
    let small = signature(&[rgb()], &[logits(240, 320), labels()]);
    let error = wnet(CONNECTED, &[small, depth_stage()]).unwrap_err();
    assert_eq!(error, other_logits("float32 [1, 13, 240, 320]"));
}

#[test]
fn element_types_that_differ_are_refused_naming_both_sides() {
    let half = TensorSpec { element: ElementType::Float16, ..logits(480, 640) };
    let error = wnet(CONNECTED, &[signature(&[rgb()], &[half, labels()]), depth_stage()]).unwrap_err();
    assert_eq!(error, other_logits("float16 [1, 13, 480, 640]"));
}

#[test]
fn an_open_dimension_is_refused_only_if_it_is_used() {
    let open = tensor("logits", ElementType::Float32, &[-1, 13, 480, 640]);
    let error =
        wnet(CONNECTED, &[signature(&[rgb()], &[open, labels()]), depth_stage()]).unwrap_err().to_string();
    assert!(
        error.starts_with("output `logits` of stage `segmentation` is float32 [?, 13, 480, 640]"),
        "{error}"
    );

    let unused = tensor("debug", ElementType::Float32, &[-1]);
    let one = signature(&[rgb()], &[unused, depth()]);
    let plan = wire(&manifest(&[("a", 1, SEES_IMAGE)], "a.depth", None), &[one]).unwrap();
    assert_eq!(plan.tensors.len(), 1);
}

#[test]
fn stage_names_are_unique_and_every_is_not_zero() {
    let signatures = [segmentation(), segmentation()];
    let twice = [("a", 1, SEES_IMAGE), ("a", 1, SEES_IMAGE)];
    let error = wire(&manifest(&twice, "a.depth", None), &signatures).unwrap_err();
    assert_eq!(error, WiringError::DuplicateStage { stage: "a".into() });
    let error = wire(&manifest(&[("a", 0, SEES_IMAGE)], "a.depth", None), &signatures[..1]).unwrap_err();
    assert_eq!(error, WiringError::EveryZero { stage: "a".into() });
}

#[test]
fn a_stage_that_nothing_uses_is_refused() {
    let stages = [("segmentation", 1, SEES_IMAGE), ("depth", 1, SEES_IMAGE)];
    let alone = signature(&[rgb()], &[depth()]);
    let unused = wire(&manifest(&stages, "depth.depth", None), &[segmentation(), alone.clone()]);
    assert_eq!(unused, Err(WiringError::UnusedStage { stage: "segmentation".into() }));
    let labels = Some("segmentation.labels");
    assert!(wire(&manifest(&stages, "depth.depth", labels), &[segmentation(), alone]).is_ok());
}

#[test]
fn the_stage_of_the_depth_runs_for_each_frame() {
    let stages = [("segmentation", 4, SEES_IMAGE), ("depth", 2, CONNECTED)];
    let error = wire(&manifest(&stages, "depth.depth", None), &[segmentation(), depth_stage()]).unwrap_err();
    assert_eq!(error, WiringError::DepthSkipped { role: "depth", stage: "depth".into(), every: 2 });
}

#[test]
fn results_have_the_contracts_type_and_the_images_size() {
    let refused = |role: &'static str, given: &str, expected: &str| WiringError::Result {
        role,
        reference: format!("a.{role}").into(),
        given: given.into(),
        expected: expected.into(),
        width: 640,
        height: 480,
    };
    for (given, says) in [
        (tensor("depth", ElementType::Float64, &[1, 1, 480, 640]), "float64 [1, 1, 480, 640]"),
        (tensor("depth", ElementType::Float32, &[1, 1, 240, 320]), "float32 [1, 1, 240, 320]"),
        (tensor("depth", ElementType::Float32, &[1, 480, 640]), "float32 [1, 480, 640]"),
        (tensor("depth", ElementType::Float32, &[1, 1, 640, 480]), "float32 [1, 1, 640, 480]"),
    ] {
        let one = signature(&[rgb()], &[given]);
        let error = wire(&manifest(&[("a", 1, SEES_IMAGE)], "a.depth", None), &[one]).unwrap_err();
        assert_eq!(error, refused("depth", says, "float32 [1, 1, 480, 640]"));
    }
    let stages = [("a", 1, SEES_IMAGE)];
    let wide = tensor("labels", ElementType::Int64, &[1, 480, 640]);
    let one = signature(&[rgb()], &[depth(), wide]);
    let error = wire(&manifest(&stages, "a.depth", Some("a.labels")), &[one]).unwrap_err();
    assert_eq!(error, refused("labels", "int64 [1, 480, 640]", "uint8 [1, 480, 640]"));
}

#[test]
fn a_missing_result_is_refused_with_the_outputs_of_the_stage() {
    let error = wire(&manifest(&[("a", 1, SEES_IMAGE)], "a.depht", None), &[signature(&[rgb()], &[depth()])]);
    let expected = WiringError::UnknownTensor {
        user: "output `depth`".into(),
        stage: "a".into(),
        tensor: "depht".into(),
        outputs: "`depth`".into(),
    };
    assert_eq!(error.unwrap_err(), expected);
}

#[test]
fn images_are_bytes_in_rows_of_rgb() {
    for bad in [
        tensor("rgb", ElementType::Float32, &[1, 480, 640, 3]),
        tensor("rgb", ElementType::Uint8, &[1, 3, 480, 640]),
        tensor("rgb", ElementType::Uint8, &[480, 640, 3]),
        tensor("rgb", ElementType::Uint8, &[-1, 480, 640, 3]),
        tensor("rgb", ElementType::Uint8, &[1, 0, 640, 3]),
    ] {
        let kind = bad.kind();
        let one = signature(&[bad], &[depth()]);
        let error = wire(&manifest(&[("a", 1, SEES_IMAGE)], "a.depth", None), &[one]).unwrap_err();
        let expected = WiringError::Image {
            stage: "a".into(),
            tensor: "rgb".into(),
            kind: kind.into(),
            expected: "uint8 [1, H, W, 3]".into(),
        };
        assert_eq!(error, expected);
    }
}

#[test]
fn some_stage_takes_the_image() {
    let error = wire(&manifest(&[("a", 1, &[])], "a.depth", None), &[signature(&[], &[depth()])]);
    assert_eq!(error.unwrap_err(), WiringError::NoImage);
}

#[test]
fn a_tensors_name_may_have_dots() {
    let dotted = TensorSpec { name: "decoder.out.1".to_owned(), ..depth() };
    let stages = [("a", 1, SEES_IMAGE)];
    let plan = wire(&manifest(&stages, "a.decoder.out.1", None), &[signature(&[rgb()], &[dotted])]).unwrap();
    assert_eq!(plan.tensors[plan.depth].name, "a.decoder.out.1");
}

#[test]
fn a_tensor_that_is_too_large_is_refused_if_it_is_used() {
    let huge = tensor("logits", ElementType::Float32, &[1, i64::MAX, 480, 640]);
    let error = wnet(CONNECTED, &[signature(&[rgb()], &[huge, labels()]), depth_stage()]).unwrap_err();
    assert!(matches!(error, WiringError::OpenOutput { .. }), "{error}");
}

#[test]
fn a_foreign_network_may_leave_dimensions_open_that_its_sidecar_fixes() {
    let contract = Contract::Foreign {
        element: ElementType::Float32,
        image: [1, 3, 480, 640],
        size: ImageSize::new(640, 480),
    };
    let input = tensor("x", ElementType::Float32, &[-1, 3, -1, -1]);
    for shape in [&[1, 1, 480, 640][..], &[1, 480, 640], &[480, 640], &[1, 480, 640, 1]] {
        let one = signature(std::slice::from_ref(&input), &[tensor("y", ElementType::Float32, shape)]);
        let manifest = manifest(&[("network", 1, &[("x", "image")])], "network.y", None);
        let plan = wire_parts(&manifest, vec![one], vec![Vec::new()], contract).unwrap();
        assert_eq!(plan.image.shape, [1, 3, 480, 640]);
        assert_eq!(plan.tensors[0].bytes(), Some(480 * 640 * 4), "{shape:?}");
        assert_eq!(plan.depth_size, ImageSize::new(640, 480));
    }
    let half = signature(std::slice::from_ref(&input), &[tensor("y", ElementType::Float32, &[1, 240, 320])]);
    let manifest_of_y = manifest(&[("network", 1, &[("x", "image")])], "network.y", None);
    let plan = wire_parts(&manifest_of_y, vec![half], vec![Vec::new()], contract).unwrap();
    assert_eq!((plan.size, plan.depth_size), (ImageSize::new(640, 480), ImageSize::new(320, 240)));
    for shape in [&[2, 480, 640][..], &[480], &[-1, 480, 640]] {
        let bad = signature(std::slice::from_ref(&input), &[tensor("y", ElementType::Float32, shape)]);
        assert!(wire_parts(&manifest_of_y, vec![bad], vec![Vec::new()], contract).is_err(), "{shape:?}");
    }
    let other = tensor("x", ElementType::Float32, &[1, 3, 240, 320]);
    let one = signature(&[other], &[depth()]);
    let manifest = manifest(&[("network", 1, &[("x", "image")])], "network.depth", None);
    let error = wire_parts(&manifest, vec![one], vec![Vec::new()], contract);
    let expected = WiringError::Image {
        stage: "network".into(),
        tensor: "x".into(),
        kind: "float32 [1, 3, 240, 320]".into(),
        expected: "float32 [1, 3, 480, 640]".into(),
    };
    assert_eq!(error.unwrap_err(), expected);
}

fn state(input: &str, output: &str, shape: &[i64]) -> StateTensor {
    StateTensor { input: input.to_owned(), output: output.to_owned(), shape: shape.to_vec() }
}

const CELL: &[i64] = &[1, 4, 15, 20];

/// One stage whose file has `cell_in` and `cell_out` of these kinds beside image and depth.
fn with_state(
    cell_in: (ElementType, &[i64]),
    cell_out: (ElementType, &[i64]),
    inputs: Inputs<'_>,
    state: &[StateTensor],
) -> Result<Wired, WiringError> {
    let given = [rgb(), tensor("cell_in", cell_in.0, cell_in.1)];
    let taken = [depth(), tensor("cell_out", cell_out.0, cell_out.1)];
    let manifest = manifest(&[("network", 1, inputs)], "network.depth", None);
    wire_parts(&manifest, vec![signature(&given, &taken)], vec![state.to_vec()], Contract::Nunet)
}

const F32: ElementType = ElementType::Float32;

#[test]
fn a_stage_reads_its_own_state() {
    let plan =
        with_state((F32, CELL), (F32, CELL), SEES_IMAGE, &[state("cell_in", "cell_out", CELL)]).unwrap();
    assert_eq!(plan.stages[0].inputs, [InputSource::Image, InputSource::State(0)]);
    assert_eq!(plan.states, [WiredState { output: 1, every: 1 }]);
}

#[test]
fn a_state_tensor_that_the_file_does_not_have_is_refused_with_those_it_has() {
    for (wrong, side, tensor, there) in [
        (state("cel_in", "cell_out", CELL), "input", "cel_in", "`rgb`, `cell_in`"),
        (state("cell_in", "cel_out", CELL), "output", "cel_out", "`depth`, `cell_out`"),
    ] {
        let error = with_state((F32, CELL), (F32, CELL), SEES_IMAGE, &[wrong]).unwrap_err();
        let (stage, tensor, there) = ("network".into(), tensor.into(), there.into());
        assert_eq!(error, WiringError::StateMissing { stage, side, tensor, there });
    }
}

#[test]
fn a_state_is_float32_of_one_fixed_shape_on_both_sides() {
    let open: &[i64] = &[-1, 4, 15, 20];
    let half = ElementType::Float16;
    for (cell_in, cell_out, side, tensor, given) in [
        ((F32, open), (F32, CELL), "input", "cell_in", "float32 [?, 4, 15, 20]"),
        ((F32, CELL), (F32, &[1, 4, 20, 15][..]), "output", "cell_out", "float32 [1, 4, 20, 15]"),
        ((half, CELL), (F32, CELL), "input", "cell_in", "float16 [1, 4, 15, 20]"),
    ] {
        let error = with_state(cell_in, cell_out, SEES_IMAGE, &[state("cell_in", "cell_out", CELL)]);
        let (stage, tensor, given) = ("network".into(), tensor.into(), given.into());
        let expected = "float32 [1, 4, 15, 20]".into();
        assert_eq!(error.unwrap_err(), WiringError::StateKind { stage, side, tensor, expected, given });
    }
}

#[test]
fn a_state_has_no_other_source_and_is_not_the_depth() {
    let both: Inputs<'_> = &[("rgb", "image"), ("cell_in", "image")];
    let error = with_state((F32, CELL), (F32, CELL), both, &[state("cell_in", "cell_out", CELL)]);
    assert!(matches!(error, Err(WiringError::StateBound { .. })), "{error:?}");
    let shape: &[i64] = &[1, 1, 480, 640];
    let error = with_state((F32, shape), (F32, CELL), SEES_IMAGE, &[state("cell_in", "depth", shape)]);
    assert_eq!(error.unwrap_err(), WiringError::StateIsDepth { reference: "network.depth".into() });
}

#[test]
fn an_input_that_is_not_in_the_state_still_needs_a_source() {
    let error = with_state((F32, CELL), (F32, CELL), SEES_IMAGE, &[]).unwrap_err();
    assert!(matches!(error, WiringError::Unbound { .. }), "{error}");
}

/// Whatever a manifest says of existing files, the wiring accepts or refuses it.
#[test]
fn damaged_manifests_are_wired_or_refused_and_never_panic() {
    let whole = nunet_testkit::manifests::two_stages(true, 2);
    let mut wired = 0;
    nunet_testkit::hostile::feed_damaged("manifest", whole.as_bytes(), |bytes| {
        let Some(manifest) = str::from_utf8(bytes).ok().and_then(|text| Manifest::parse(text).ok()) else {
            return;
        };
        let mut signatures = vec![segmentation(), depth_stage()];
        signatures.resize(manifest.stages.len(), segmentation());
        wired += usize::from(wire(&manifest, &signatures).is_ok());
    });
    assert!(wired > 0, "the whole one fits");
}
