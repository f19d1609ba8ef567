//! Flags, and flags together with the file of `--config`.

mod reference;

use std::ffi::OsString;
use std::path::PathBuf;

use clap::CommandFactory as _;
use clap::error::ErrorKind;

use super::{Cli, SubcommandArgs};
use crate::config::{CameraConfig, Config, LogOptions, Publish};
use crate::source::Rate;

/// Compares with the file in `tests/snapshots/` that has the test's name.
macro_rules! snapshot {
    ($text:expr) => {
        insta::with_settings!({
            prepend_module_to_snapshot => false,
            omit_expression => true,
            snapshot_path => concat!(env!("CARGO_MANIFEST_DIR"), "/tests/snapshots"),
        }, { insta::assert_snapshot!($text) })
    };
}

/// The messages of refused command lines or files, one below the other.
fn below_each_other(errors: impl IntoIterator<Item = String>) -> String {
    errors.into_iter().map(|error| error.trim_end().to_owned()).collect::<Vec<_>>().join("\n\n")
}

fn parse_flags(line: &str) -> Cli {
    Cli::parse_line(line.split(' ').map(OsString::from)).unwrap()
}

#[test]
fn the_command_line_definition_is_consistent() {
    Cli::command().debug_assert();
}

/// The headings of the flags of a subcommand, in the order of its help.
fn headings(subcommand: &str) -> Vec<String> {
    let mut command = Cli::command();
    command.build();
    let mut headings = Vec::new();
    let arguments = command.find_subcommand(subcommand).unwrap().get_arguments();
    for argument in arguments.filter(|argument| !argument.is_positional()) {
        let heading = argument.get_help_heading().unwrap_or("Options").to_owned();
        if !headings.contains(&heading) {
            headings.push(heading);
        }
    }
    headings
}

#[test]
fn help_groups_the_flags_in_reading_order_and_those_of_all_subcommands_are_the_last() {
    let of_run = ["Configuration", "Model", "Source", "Camera", "Depth", "Obstacles", "Results"];
    assert_eq!(headings("run")[..of_run.len()], of_run);
    let others = ["ROS 2 and live view", "Statistics", "Global options"];
    assert_eq!(headings("run")[of_run.len()..], others);
    for (subcommand, expected) in [
        ("infer", &["Results", "Model", "Camera", "Depth", "Obstacles"][..]),
        ("feed", &["Source", "Camera"]),
        ("replay", &["Model", "Source", "Camera", "Depth", "Results"]),
        ("eval", &["Dataset", "Comparison", "Model", "Camera", "Depth", "Obstacles", "Results"]),
        ("calibrate", &["Reference", "Source", "Camera", "Model", "Results"]),
        ("tune", &["Options"]),
    ] {
        assert_eq!(headings(subcommand), [expected, &["Global options"]].concat(), "{subcommand}");
    }
}

#[test]
fn arguments_without_a_flag_are_in_their_own_section() {
    let mut command = Cli::command();
    command.build();
    for subcommand in command.get_subcommands().filter(|subcommand| subcommand.get_name() != "help") {
        for argument in subcommand.get_positionals() {
            assert_eq!(argument.get_help_heading(), None, "{}: {argument}", subcommand.get_name());
        }
    }
}

#[test]
fn warnings_are_only_given_for_a_valid_configuration() {
    let SubcommandArgs::Config(run) = parse_flags("nunetd config --model missing.onnx").subcommand else {
        panic!("`config` was asked for");
    };
    let mut is_warned = false;
    let printed = crate::subcommands::config::config(&run.config().unwrap(), "", || is_warned = true);
    assert!(printed.is_err() && !is_warned);
}

#[test]
fn the_default_subcommand_is_run_before_and_after_logging_flags() {
    for line in
        ["nunetd", "nunetd -q", "nunetd --model a.onnx -v", "nunetd -vv --log-format json --model a.onnx"]
    {
        assert!(matches!(parse_flags(line).subcommand, SubcommandArgs::Run(_)), "{line}");
    }
}

#[test]
fn logging_flags_are_allowed_before_and_after_a_subcommand() {
    for line in
        ["nunetd -q inspect m.onnx", "nunetd inspect m.onnx -q", "nunetd --log-format=json -q inspect m"]
    {
        let cli = parse_flags(line);
        assert!(cli.logging.quiet && matches!(cli.subcommand, SubcommandArgs::Inspect(_)), "{line}");
    }
}

#[test]
fn an_unknown_subcommand_lists_the_known_ones() {
    let error = Cli::parse_line(["nunetd", "inferr", "x.jpg"].map(OsString::from)).unwrap_err().to_string();
    assert!(!error.contains("check-model"), "{error}");
    snapshot!(error);
}

#[test]
fn a_source_in_place_of_a_subcommand_is_answered_with_its_flag() {
    for source in ["/dev/video0", "drive.mcap", "shm:front"] {
        let error = Cli::parse_line(["nunetd", source].map(OsString::from)).unwrap_err().to_string();
        assert!(error.contains(&format!(" --source {source}\n")), "{error}");
    }
}

#[test]
fn a_file_too_many_is_answered_with_a_tip_about_globs() {
    let error = |file: &str| {
        let line = ["nunetd", "--source", "a.jpg", file].map(OsString::from);
        let error = Cli::parse_line(line).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::UnknownArgument, "{error}");
        error.to_string()
    };
    let example = "'images/*.jpg'";
    assert!(error("Cargo.toml").contains(example), "{}", error("Cargo.toml"));
    assert!(!error("none.jpg").contains(example), "{}", error("none.jpg"));
}

#[test]
fn the_usage_says_that_a_subcommand_is_optional() {
    assert!(Cli::command().render_usage().to_string().ends_with(" [COMMAND]"));
}

#[test]
fn an_error_of_a_number_or_address_names_what_is_expected() {
    let errors = [
        "nunetd --frames 0",
        "nunetd --cloud-stride 0",
        "nunetd --threads 0",
        "nunetd bench --runs 0",
        "nunetd watch front --frames 0",
        "nunetd --readers 0",
        "nunetd eval data --depth-offset nan",
        "nunetd eval data --depth-offset=-1e300",
        "nunetd calibrate --truth data --depth-offset inf",
        "nunetd eval data --depth-cap 1e300",
        "nunetd eval data --depth-scale 1e-300",
        "nunetd calibrate --truth data --depth-cap 1e-300",
        "nunetd --metrics 9477",
        "nunetd --view localhost:8080",
    ]
    .map(|line| {
        let error = Cli::parse_line(line.split(' ').map(OsString::from)).unwrap_err();
        assert_eq!(error.exit_code(), 2, "{line}");
        error.to_string()
    });
    snapshot!(below_each_other(errors));
    let address = "nunetd --metrics [::1]:9477".split(' ').map(OsString::from);
    assert!(Cli::parse_line(address).is_ok());
}

#[test]
fn help_and_version_are_those_of_the_program() {
    for line in ["nunetd --help", "nunetd -V", "nunetd help bench", "nunetd run -h", "nunetd tune --help"] {
        let error = Cli::parse_line(line.split(' ').map(OsString::from)).unwrap_err();
        assert!(!error.use_stderr(), "{line}");
    }
}

fn parse(config: &str, rest: &str) -> Result<SubcommandArgs, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("nunetd.toml");
    std::fs::write(&path, config).unwrap();
    let line = format!("nunetd {rest} --config {}", path.display());
    let cli = Cli::parse_line(line.split_whitespace().map(OsString::from));
    cli.map(|cli| cli.subcommand).map_err(|error| error.to_string().replace(path.to_str().unwrap(), "[FILE]"))
}

fn run(config: &str, rest: &str) -> Config {
    match parse(config, rest) {
        Ok(SubcommandArgs::Run(run)) => run.config().unwrap(),
        other => panic!("{other:?}"),
    }
}

/// What `nunetd config` prints.
fn effective(config: &str, rest: &str) -> String {
    match parse(config, &format!("config {rest}")) {
        Ok(SubcommandArgs::Config(run)) => run.effective(&run.config().unwrap()),
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_file_is_equivalent_to_flags() {
    let config = "model = 'a.onnx'\nsource = 'demo'\nrate = 15.5\nloop = true\nframe_id = 'eye'\n\
                  publish = ['depth', 'cloud']\nevery = ['segmentation=3']\nreaders = 2\n\
                  filter = ['holes', 'spatial=alpha:0.4,delta:0.1']\nthreads = 0x2\nmetrics = '[::1]:9477'";
    let config = run(config, "run");
    assert_eq!(config.model.path, PathBuf::from("a.onnx"));
    assert_eq!(config.model.every, [("segmentation".to_owned(), 3.try_into().unwrap())]);
    assert_eq!(config.engine.threads.map(usize::from), Some(2));
    assert_eq!(config.outputs.metrics.map(|address| address.port()), Some(9477));
    let [camera] = &config.cameras[..] else { panic!("{config:?}") };
    assert_eq!(camera.source.rate, Some(Rate::Hz(15.5)));
    assert!(camera.source.repeat);
    assert_eq!(camera.frame_id, "eye");
    assert_eq!(camera.publish, [Publish::Depth, Publish::Cloud]);
    assert_eq!(camera.processing.pipeline.filters.specs().count(), 2);
    assert_eq!(camera.readers, 2);
}

#[test]
fn a_file_may_begin_with_a_byte_order_mark() {
    assert_eq!(run("\u{feff}source = 'demo'\nmodel = 'a.onnx'", "run").model.path, PathBuf::from("a.onnx"));
    assert_names("\u{feff}source = 'demo'\nmodle = 'a.onnx'", &["`[FILE]`, line 2", "`modle`"]);
}

#[test]
fn flags_win() {
    let file = "source = 'demo'\nmodel = 'a.onnx'\npublish = ['depth', 'cloud']\nloop = true";
    let config = run(file, "--model b.onnx --publish labels");
    assert_eq!(config.model.path, PathBuf::from("b.onnx"));
    assert_eq!(config.cameras[0].publish, [Publish::Labels]);
    assert!(config.cameras[0].source.repeat);
    let config = run("source = 'demo'\nintrinsics = '500,500,320,240'", "run --calibration a.yaml");
    let geometry = &config.cameras[0].processing.geometry;
    assert_eq!((geometry.intrinsics, &geometry.calibration), (None, &Some("a.yaml".into())));
}

#[test]
fn the_file_takes_the_flags_of_all_subcommands() {
    let log = |file: &str, rest: &str| {
        let path = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(&path, file).unwrap();
        let line = format!("nunetd {rest} --config {}", path.path().display());
        Cli::parse_line(line.split_whitespace().map(OsString::from)).unwrap().logging.options()
    };
    let options = |verbose, quiet, json| LogOptions { verbose, quiet, json };
    assert_eq!(log("quiet = true\nlog-format = 'json'", "run"), options(0, true, true));
    assert_eq!(log("verbose = 2", "run"), options(2, false, false));
    assert_eq!(log("verbose = 0x2", "run"), options(2, false, false));
    assert_eq!(log("verbose = true", "run"), options(1, false, false));
    assert_eq!(log("verbose = 2", "-q run"), options(0, true, false));
}

#[test]
fn a_flag_may_require_a_key_of_the_file_and_a_key_a_flag() {
    let split = run(
        "source = 'demo'\nforce = true\naccess-mode = '0640'",
        "run --record a.mcap --access-group video",
    );
    assert!(split.cameras[0].record.as_ref().is_some_and(|record| record.force));
    assert_eq!(split.outputs.access.and_then(|access| access.mode), Some(0o640));
    let turned = run("source = 'demo'\nrecord = 'a.mcap'", "run --force");
    assert!(turned.cameras[0].record.as_ref().is_some_and(|record| record.force));
    let error = parse("rate = 5", "run --force").unwrap_err();
    assert!(error.contains("`--force`") && error.contains("`--record`"), "{error}");
    assert!(!error.contains("[FILE]") && error.contains("Usage: "), "{error}");
    assert_names("force = true", &["`[FILE]`", "`force`", "`record`"]);
    // The usage of the command line does not help with a mistake in the file.
    let error = parse("force = true", "run").unwrap_err();
    assert!(!error.contains("Usage: "), "{error}");
}

#[test]
fn shared_keys_apply_to_the_cameras_that_can_use_them() {
    let sections =
        "[[camera]]\nname = 'a'\nsource = 'demo'\nrecord = 'a.mcap'\n[[camera]]\nname = 'b'\nsource = 'demo'";
    let config = run(&format!("force = true\n{sections}"), "run");
    assert!(config.cameras[0].record.as_ref().is_some_and(|record| record.force));
    assert!(config.cameras[1].record.is_none());
    let off = run(&format!("loop = true\n{sections}\nloop = false"), "run");
    assert!(off.cameras[0].source.repeat && !off.cameras[1].source.repeat);
}

#[test]
fn a_flag_that_needs_another_one_is_refused_without_a_file_too() {
    for (line, flag, needed) in [
        ("nunetd run --force", "`--force`", "`--record`"),
        ("nunetd config --access-mode 0640", "`--access-mode`", "`--access-group`"),
        ("nunetd feed - --camera a --format rgb8", "`--format`", "`--size`"),
    ] {
        let error = Cli::parse_line(line.split(' ').map(OsString::from)).unwrap_err();
        assert_eq!(error.exit_code(), 2);
        let text = error.to_string();
        assert!(text.contains(flag) && text.contains(needed), "{error}");
    }
    let replay = "nunetd replay a.mcap b.mcap --force".split(' ').map(OsString::from);
    assert!(Cli::parse_line(replay).is_ok(), "its output is no option");
}

fn refused(config: &str) -> String {
    parse(config, "run").unwrap_err()
}

#[track_caller]
fn assert_names(config: &str, names: &[&str]) {
    let error = refused(config);
    assert!(names.iter().all(|name| error.contains(*name)), "{error}");
}

#[test]
fn an_unknown_key_is_an_error_with_the_nearest_name() {
    let files = [
        "modle = 'a.onnx'",
        "zzz = 1",
        "config = 'other.toml'",
        "loop = 'yes'",
        "verbose = -1",
        "verbose = 256",
        "model = true",
        "model = {a = 1}",
        "model =",
        "model = 'a'\nmodel = 'b'",
        "intrinsics = [500, 500, 320, 240]",
        "publish = []",
        "loop = true\nrate = -3",
        "intrinsics = '1,2,3,4'\ncalibration = 'a.yaml'",
    ];
    snapshot!(below_each_other(files.map(refused)));
}

#[test]
fn a_file_that_is_endless_or_one_long_line_is_refused_with_a_short_message() {
    let large = refused(&"#".repeat(100_000));
    let nested = refused(&format!("a = {}", "[".repeat(60_000)));
    assert!(nested.contains("`[FILE]`: ") && nested.len() < 2000, "{nested}");
    let line = ["nunetd", "--config", "/dev/zero"].map(OsString::from);
    let endless = Cli::parse_line(line).unwrap_err().to_string();
    snapshot!(below_each_other([large, endless]));
}

#[test]
fn a_mistake_in_the_file_is_printed_without_the_usage_of_the_command_line() {
    for (config, rest) in [
        ("modle = 'a.onnx'", ""),
        ("frames = 0", ""),
        ("record-lossless = true", ""),
        ("model =", ""),
        ("[[camera]]\nname = 'a'\nsource = 'demo'", " --source demo"),
    ] {
        let error = parse(config, rest).unwrap_err();
        assert!(error.starts_with("error: `") && error.ends_with('\n'), "{error:?}");
        assert!(!error.contains("Usage:") && !error.contains("--help"), "{error}");
    }
    let of_flag = parse("model = 'a.onnx'", " --record-lossless").unwrap_err();
    assert!(of_flag.contains("Usage:"), "{of_flag}");
}

#[test]
fn a_mistake_in_the_file_quotes_no_line_which_may_contain_a_secret() {
    for config in [
        "view-token = s3cret",
        "view_token = \"s3cret",
        "view-token = 's3cret' # s3cret\nview-token = 's3cret'",
        "view-token = \"\"\"\ns3cret\\q\"\"\"",
        "source = \"rtsp://admin:s3cret@10.0.0.4/front",
        "[[camera]]\nsource = 'rtsp://10.0.0.4/?password=s3cret",
        "camera = 'rtsp://admin:s3cret@10.0.0.4/'\n[[camera]]\nname = 'a'",
        "view-token = ['s3cret']",
        "view-tokn = 's3cret'",
        "[[camera]]\nview-token = 's3cret'",
    ] {
        let error = refused(config);
        assert!(error.starts_with("error: `[FILE]`") && !error.contains("s3cret"), "{config}: {error}");
    }
    assert_names("source = 'demo'\nview-token = s3cret", &["`[FILE]`", "not valid TOML at line 2, column "]);
}

/// The error of a command line whose flags contradict each other: its causes and its hints.
fn config_error(line: &str) -> (String, Vec<String>) {
    let SubcommandArgs::Run(run) = parse_flags(line).subcommand else { panic!("{line}") };
    let error = run.config().err().unwrap_or_else(|| panic!("{line} is accepted"));
    assert!(crate::exit::is_usage(&error), "{line}: {error:#}");
    crate::exit::message_and_hints(&error)
}

#[test]
fn two_servers_at_one_address_are_refused_before_anything_is_opened() {
    for (one, other) in [("--view", "--metrics"), ("--view", "--foxglove"), ("--metrics", "--foxglove")] {
        if other == "--foxglove" && cfg!(not(feature = "foxglove")) {
            continue;
        }
        let line = format!("nunetd {one} 127.0.0.1:8080 {other} 127.0.0.1:8080");
        let (error, hints) = config_error(&line);
        assert!(error.contains(one) && error.contains(other), "{error}");
        assert_eq!(hints.len(), 1, "{hints:?}");
        let free = line.replacen("8080", "0", 1);
        let SubcommandArgs::Run(run) = parse_flags(&free).subcommand else { panic!("{free}") };
        assert!(run.config().is_ok(), "{free}");
    }
}

#[test]
#[cfg(feature = "ros2-dds")]
fn topics_of_obstacles_without_a_mount_are_refused_before_anything_is_opened() {
    for topic in ["scan", "obstacles/points", "depth/points,scan"] {
        let line = format!("nunetd --ros2 dds --ros2-topics {topic}");
        let (error, hints) = config_error(&line);
        assert!(error.contains("a mount"), "{error}");
        assert!(hints.iter().any(|hint| hint.contains("--mount")), "{hints:?}");
        let SubcommandArgs::Run(run) = parse_flags(&format!("{line} --mount 0,0,1,0,0,0")).subcommand else {
            panic!("{line}")
        };
        assert!(run.config().is_ok(), "{line}");
    }
}

#[test]
fn a_file_cannot_control_the_terminal() {
    let error = parse("source = 'demo'\nrate = \"a\\u001b[31m\"", "run").unwrap_err();
    assert!(error.contains("`a\\u001b[31m`") && !error.contains('\u{1b}'), "{error}");
}

#[test]
fn a_file_cannot_add_a_line_to_its_error() {
    for config in ["rate = \"a\\nhint: b\"", "\"a\\nhint: b\" = 1", "loop = \"a\\nhint: b\""] {
        let error = parse(config, "run").unwrap_err();
        assert!(error.contains("a\\nhint: b") && !error.contains("\nhint: b"), "{error}");
    }
}

#[test]
fn a_missing_file_is_an_error() {
    let error = Cli::parse_line(["nunetd", "--config", "missing.toml"].map(OsString::from)).unwrap_err();
    let text = error.to_string();
    assert!(text.contains("`missing.toml`") && text.contains("os error 2"), "{text}");
}

#[test]
fn the_printed_configuration_can_be_read_again() {
    let first = effective("source = 'demo'\nrate = 5\nloop = true", "--frames 3");
    assert!(first.contains("rate = 5\nloop = true\n"), "{first}");
    assert!(first.contains("model = \"wnet_c.onnx\"  # default"), "{first}");
    assert!(first.contains("# record is not set"), "{first}");
    let second = effective(&first, "");
    let plain = |text: &str| text.replace("  # default", "");
    assert_eq!(plain(&first), plain(&second));
}

#[test]
fn defaults_that_depend_on_other_flags_are_shown_as_run_takes_them() {
    let shown = |rest: &str| {
        let line = format!("nunetd config --access-group video {rest}");
        match Cli::parse_line(line.split_whitespace().map(OsString::from)).unwrap().subcommand {
            SubcommandArgs::Config(run) => run.effective(&run.config().unwrap()),
            other => panic!("{other:?}"),
        }
    };
    let demo = shown("");
    for line in [
        "source = \"demo\"  # default\n",
        "camera = \"demo\"  # default\n",
        "frame-id = \"demo_optical_frame\"  # default\n",
        "rate = \"max\"  # default\n",
        "readers = 4  # default\n",
        "access-group = \"video\"\n",
        "access-mode = \"0640\"  # default\n",
        "# size is not set\n",
    ] {
        assert!(demo.contains(line), "{line}{demo}");
    }
    let video = shown("--source /dev/video7 --camera front");
    for line in ["frame-id = \"front_optical_frame\"", "rate = 30", "size = \"640x480\""] {
        assert!(video.contains(&format!("{line}  # default\n")), "{line}\n{video}");
    }
    assert!(shown("--source shm:front").contains("camera = \"camera\"  # default\n"));
    assert!(shown("--source shm:front").contains("# rate is not set\n"), "its publisher has the pace");
}

const TWO: &str = "model = 'a.onnx'\nframes = 7\nintrinsics = '500,500,320,240'\n\
                   [[camera]]\nname = 'front'\nsource = 'demo'\nframes = 3\n\
                   [[camera]]\nname = 'rear'\nsource = 'shm:rear'\ncalibration = 'rear.yaml'";

#[test]
fn each_section_is_a_camera_and_shared_keys_apply_to_all() {
    let config = run(TWO, "run");
    assert_eq!(config.model.path, PathBuf::from("a.onnx"));
    let names: Vec<_> = config.cameras.iter().map(|camera| camera.name.as_str()).collect();
    assert_eq!(names, ["front", "rear"]);
    assert!(config.cameras[1].source.name.properties().is_published);
    let frames = |camera: &CameraConfig| camera.source.frames.map(std::num::NonZero::get);
    let of_both = |config: &Config| config.cameras.iter().map(frames).collect::<Vec<_>>();
    assert_eq!(of_both(&config), [Some(3), Some(7)]);
    let geometry = |camera: &CameraConfig| {
        let geometry = &camera.processing.geometry;
        (geometry.intrinsics.is_some(), geometry.calibration.is_some())
    };
    let geometry: Vec<_> = config.cameras.iter().map(geometry).collect();
    assert_eq!(geometry, [(true, false), (false, true)]);
    let flags = run(TWO, "run --frames 9");
    assert_eq!(of_both(&flags), [Some(9), Some(9)], "flags win, for every camera");
}

#[test]
fn one_section_is_one_camera() {
    let config = run("[[camera]]\nname = 'front'\nsource = 'demo'", "run");
    assert_eq!(config.cameras.len(), 1);
    assert_eq!(config.cameras[0].name.as_str(), "front");
}

#[test]
fn a_wrong_key_of_a_section_is_an_error_with_the_camera_and_a_hint() {
    let section = |lines: &str| format!("[[camera]]\nname = 'front'\n[[camera]]\nname = 'rear'\n{lines}");
    let in_section =
        ["framse = 3", "nmae = 'x'", "model = 'b.onnx'", "camera = 'b'", "rate = -3", "loop = 3"];
    let mut errors = Vec::from(in_section.map(|line| refused(&section(line))));
    errors.push(refused(&format!("source = 'demo'\n{}", section(""))));
    errors.extend(
        [
            "camera = 'front'\n[[camera]]\nname = 'front'\nsource = 'demo'",
            "camera = []",
            "camera = ['a', 'b']",
            "[camera]\nname = 'a'",
        ]
        .map(refused),
    );
    let flags = ["run --source demo", "run --camera other"];
    errors.extend(flags.map(|line| parse(TWO, line).unwrap_err()));
    snapshot!(below_each_other(errors));
}

#[test]
fn several_cameras_are_printed_as_sections_that_can_be_read_again() {
    let text = effective(TWO, "--frames 4");
    assert_eq!(text.matches("[[camera]]\nsource = ").count(), 2, "{text}");
    assert_eq!(text.matches("frames = 4\n").count(), 2, "{text}");
    assert!(text.contains("name = \"rear\"\n") && !text.contains("\ncamera ="), "{text}");
    let plain = |text: &str| text.replace("  # default", "");
    assert_eq!(plain(&text), plain(&effective(&text, "")));
}
