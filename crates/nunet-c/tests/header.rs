//! Writes `include/nunet.h`, and fails when the file is another: the functions by cbindgen from this crate's
//! source, structs, enumerations and their checks from the contract's tables.
//!
//! `INSTA_UPDATE=always cargo test -p nunet-c --test header` writes it again.

use std::path::Path;

use cbindgen::{Builder, Config, EnumConfig, ExportConfig, FunctionConfig, Language, RenameRule, Style};
use nunet_ipc::contract::{
    ATTITUDE, ATTITUDE_SAMPLE, ENUM_DOCS, ENUMS, HEADER, OBSTACLE_POINT, OBSTACLE_SECTOR, OBSTACLES, POINT,
    STATS, StructLayout,
};
use nunet_ipc::{
    CONTRACT_VERSION, Field, MAX_ATTITUDE_SAMPLES, MAX_COEFFICIENTS, MAX_OBSTACLE_POINTS, MAX_SECTORS,
    MAX_STAGES, NO_LABEL, STAGE_NAME_BYTES, Topic,
};

const ABOUT: &str = include_str!("header_about.h");

/// Names in Rust, and the same in C.
const NAMES: [(&str, &str); 22] = [
    ("StatusCode", "nunet_status_t"),
    ("ReaderHandle", "nunet_reader_t"),
    ("FrameHandle", "nunet_frame_t"),
    ("Set", "nunet_set_t"),
    ("PublisherHandle", "nunet_publisher_t"),
    ("LoanHandle", "nunet_loan_t"),
    ("AttitudeHandle", "nunet_attitude_publisher_t"),
    ("FrameHeader", "nunet_header_t"),
    ("StatsRecord", "nunet_stats_t"),
    ("CloudPoint", "nunet_point_t"),
    ("ObstacleRecord", "nunet_obstacles_t"),
    ("ObstacleSector", "nunet_obstacle_sector_t"),
    ("ObstaclePoint", "nunet_obstacle_point_t"),
    ("AttitudeRecord", "nunet_attitude_t"),
    ("AttitudeSample", "nunet_attitude_sample_t"),
    ("SectorState", "nunet_sector_state_t"),
    ("Topic", "nunet_topic_t"),
    ("Encoding", "nunet_encoding_t"),
    ("ScaleSource", "nunet_scale_source_t"),
    ("Clock", "nunet_clock_t"),
    ("DistortionModel", "nunet_distortion_model_t"),
    ("Quality", "nunet_quality_t"),
];

#[test]
fn the_header_matches_the_source() {
    let crate_folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let path = crate_folder.join("include/nunet.h");
    let expected = written(&crate_folder.join("src/lib.rs"));
    if std::env::var("INSTA_UPDATE").is_ok_and(|value| value == "always") {
        std::fs::write(&path, &expected).unwrap();
    }
    let found = std::fs::read_to_string(&path).unwrap_or_default();
    let differs = found.lines().zip(expected.lines()).position(|(a, b)| a != b);
    assert!(
        found == expected,
        "include/nunet.h differs from the source at line {:?}\n\
         hint: INSTA_UPDATE=always cargo test -p nunet-c --test header",
        differs.map(|index| index + 1)
    );
}

fn written(root: &Path) -> String {
    let config = Config {
        language: Language::C,
        cpp_compat: true,
        style: Style::Type,
        header: Some(ABOUT.trim_end().to_owned()),
        include_guard: Some("NUNET_H".to_owned()),
        no_includes: true,
        sys_includes: ["stdbool.h", "stddef.h", "stdint.h"].map(str::to_owned).into(),
        after_includes: Some(tables()),
        usize_is_size_t: true,
        line_length: 110,
        export: ExportConfig {
            rename: NAMES.map(|(rust, c)| (rust.to_owned(), c.to_owned())).into(),
            exclude: ["FOREVER_MS".to_owned()].into(),
            ..ExportConfig::default()
        },
        function: FunctionConfig { sort_by: None, ..FunctionConfig::default() },
        enumeration: EnumConfig {
            rename_variants: RenameRule::QualifiedScreamingSnakeCase,
            ..EnumConfig::default()
        },
        ..Config::default()
    };
    let mut text = Vec::new();
    let bindings = Builder::new().with_src(root).with_config(config).generate();
    bindings.expect("cbindgen understands this crate").write(&mut text);
    String::from_utf8(text).expect("cbindgen writes UTF-8").replace("NUNET_STATUS_T_", "NUNET_")
}

/// What cbindgen cannot see because macros write it: constants, enumerations, structs, and their layout's
/// checks.
fn tables() -> String {
    let layouts = [
        (HEADER, "header", "The header of a message, as stored in shared memory."),
        (
            STATS,
            "stats",
            "The daemon's stats: counts of frames, rates, and latencies in microseconds.\n`captured = published + superseded + failed + in_flight`, always.",
        ),
        (POINT, "point", "A point of a cloud, in the camera's optical frame: x right, y down, z forward."),
        (
            OBSTACLE_SECTOR,
            "obstacle_sector",
            "One direction of the robot, in the leveled base frame: x forward, y left, origin on the floor.",
        ),
        (
            OBSTACLE_POINT,
            "obstacle_point",
            "A point of an obstacle, in the leveled base frame: x forward, y left, z up, origin on the floor.",
        ),
        (OBSTACLES, "obstacles", "The obstacles of one frame, in the leveled base frame."),
        (
            ATTITUDE_SAMPLE,
            "attitude_sample",
            "The attitude of the robot's base at one time: x forward, y left, z up.",
        ),
        (ATTITUDE, "attitude", "The last samples of the attitude of the robot's base."),
    ];
    let structures = layouts.iter().map(|(layout, name, doc)| structure(layout, name, doc));
    let named = layouts.map(|(layout, name, _)| (layout, name));
    constants() + &enumerations() + &structures.collect::<String>() + &checks(&named)
}

fn constants() -> String {
    let mut out = String::from("\n");
    for (doc, name, value) in [
        (
            "Version of the library that this header belongs to.",
            "VERSION",
            format!("{:?}", env!("CARGO_PKG_VERSION")),
        ),
        ("Version of the shared-memory contract.", "CONTRACT_VERSION", CONTRACT_VERSION.to_string()),
        ("A timeout that never ends.", "FOREVER", "UINT32_MAX".to_owned()),
        ("Stages whose times fit into a header.", "MAX_STAGES", MAX_STAGES.to_string()),
        ("Coefficients that a distortion model may have.", "MAX_COEFFICIENTS", MAX_COEFFICIENTS.to_string()),
        ("Bytes of a stage's name.", "STAGE_NAME_BYTES", STAGE_NAME_BYTES.to_string()),
        ("The label of a point that has no class.", "NO_LABEL", NO_LABEL.to_string()),
        ("Sectors that an obstacle record has room for.", "MAX_SECTORS", MAX_SECTORS.to_string()),
        (
            "Points that an obstacle record has room for.",
            "MAX_OBSTACLE_POINTS",
            MAX_OBSTACLE_POINTS.to_string(),
        ),
        (
            "Samples that an attitude record has room for.",
            "MAX_ATTITUDE_SAMPLES",
            MAX_ATTITUDE_SAMPLES.to_string(),
        ),
    ] {
        out += &format!("/** {doc} */\n#define NUNET_{name} {value}\n\n");
    }
    out
}

fn enumerations() -> String {
    let mut out = String::new();
    for ((field, words), docs) in ENUMS.iter().zip(ENUM_DOCS).filter(|((field, _), _)| *field != "wake") {
        let name = field.trim_start_matches("capture_");
        let place = match *field {
            "sector_state" => "a sector's field `state`".to_owned(),
            field => format!("the header's field `{field}`"),
        };
        out += &format!("/** Values of {place}. */\ntypedef enum nunet_{name}_t {{\n");
        for ((word, number), doc) in words.iter().zip(*docs) {
            let constant = format!("{name}_{word}").to_uppercase();
            out += &format!("{}  NUNET_{constant} = {number},\n", comment(doc));
        }
        out += &format!("}} nunet_{name}_t;\n\n");
    }
    out.push_str("/** What a reader opens: a sum of these. */\ntypedef enum nunet_bit_t {\n");
    for topic in Topic::ALL {
        let (name, bit) = (topic.name().to_uppercase(), 1 << *topic as u32);
        out += &format!("  NUNET_BIT_{name} = {bit},\n");
    }
    out.push_str("} nunet_bit_t;\n\n");
    out
}

fn structure(layout: &StructLayout, name: &str, doc: &str) -> String {
    let mut out = format!(
        "/**\n * {}\n * `{}`, {} bytes.\n */\n",
        doc.replace('\n', "\n * "),
        layout.type_name,
        layout.bytes
    );
    out += &format!("typedef struct nunet_{name}_t {{\n");
    for field in layout.fields {
        out += &format!("{}  {};\n", comment(field.doc), declaration(field));
    }
    out += &format!("}} nunet_{name}_t;\n\n");
    out
}

fn declaration(field: &Field) -> String {
    let (name, count) = (field.name, field.count);
    let kind = match field.kind {
        // Texts are `char`, so that printf takes them.
        "u8" if field.doc.contains("UTF-8") || name == "stage_names" => "char",
        "u8" => "uint8_t",
        "u32" => "uint32_t",
        "u64" => "uint64_t",
        "i64" => "int64_t",
        "f32" => "float",
        "f64" => "double",
        kind if kind == OBSTACLE_SECTOR.type_name => "nunet_obstacle_sector_t",
        kind if kind == OBSTACLE_POINT.type_name => "nunet_obstacle_point_t",
        kind if kind == ATTITUDE_SAMPLE.type_name => "nunet_attitude_sample_t",
        other => panic!("no name in C for `{other}`"),
    };
    match (name, count) {
        ("stage_names", _) => format!("{kind} {name}[NUNET_MAX_STAGES][NUNET_STAGE_NAME_BYTES]"),
        (_, 1) => format!("{kind} {name}"),
        (_, MAX_STAGES) => format!("{kind} {name}[NUNET_MAX_STAGES]"),
        (_, MAX_SECTORS) => format!("{kind} {name}[NUNET_MAX_SECTORS]"),
        (_, MAX_OBSTACLE_POINTS) => format!("{kind} {name}[NUNET_MAX_OBSTACLE_POINTS]"),
        (_, MAX_ATTITUDE_SAMPLES) => format!("{kind} {name}[NUNET_MAX_ATTITUDE_SAMPLES]"),
        (_, MAX_COEFFICIENTS) => format!("{kind} {name}[NUNET_MAX_COEFFICIENTS]"),
        _ => format!("{kind} {name}[{count}]"),
    }
}

/// A compiler that lays these structs out differently stops here.
fn checks(layouts: &[(StructLayout, &str)]) -> String {
    let mut out = String::from(
        "#if defined(__cplusplus)\n\
         #define NUNET_CHECK(name, holds) static_assert(holds, #name)\n\
         #elif defined(__STDC_VERSION__) && __STDC_VERSION__ >= 201112L\n\
         #define NUNET_CHECK(name, holds) _Static_assert(holds, #name)\n\
         #else\n\
         #define NUNET_CHECK(name, holds) typedef char nunet_check_##name[(holds) ? 1 : -1]\n\
         #endif\n",
    );
    for (layout, name) in layouts {
        let kind = format!("nunet_{name}_t");
        out += &format!("NUNET_CHECK({name}_size, sizeof({kind}) == {});\n", layout.bytes);
        for Field { name: field, offset, .. } in layout.fields {
            out += &format!("NUNET_CHECK({name}_{field}, offsetof({kind}, {field}) == {offset});\n");
        }
    }
    out.push_str("#undef NUNET_CHECK\n");
    out
}

/// A documentation comment of Rust's as one of C's, with C's names.
fn comment(doc: &str) -> String {
    let mut text = without_targets(doc).replace("FrameHeader::stage_micros", "stage_micros");
    text = text.replace("Point::NO_LABEL", "NUNET_NO_LABEL");
    text =
        text.replace("[`CONTRACT_VERSION`]", "`NUNET_CONTRACT_VERSION`").replace("[`Units`]", "A [`Units`]");
    text = text.replace("[`", "`").replace("`]", "`").replace("`Units`", "`nunet_units_t`");
    text = text.replace(" Public only so that `..Default::default()` works.", "");
    for (rust, c) in NAMES {
        text = text.replace(&format!("`{rust}`"), &format!("`{c}`"));
    }
    text = text.replace("An `nunet", "A `nunet").replace("`f32`", "`float`").replace("`u8`", "`uint8_t`");
    assert!(!text.contains("::"), "a name of Rust's in the header: {text}");
    let lines: Vec<&str> = text.trim_end().lines().map(str::trim).collect();
    format!("  /** {} */\n", lines.join("\n      "))
}

/// `[x](crate::y)` as `[x]`.
fn without_targets(doc: &str) -> String {
    let mut parts = doc.split("](crate::");
    let first = parts.next().unwrap_or_default().to_owned();
    parts.fold(first, |text, part| text + "]" + part.split_once(')').map_or(part, |(_, rest)| rest))
}
