//! `nunetd contract --json`: the shared-memory contract, printed from the code.

use anyhow::ensure;
use nunet_core::model::METADATA_KEYS;
use nunet_ipc::contract::{self, StructLayout};
use serde_json::{Map, Value, json};

use crate::Outcome;
use crate::exit::BadArguments;
use nunet_sink::stdout::print;

/// Prints the contract as one JSON object. JSON must be requested, because a text may be the default later.
pub(crate) fn contract(json: bool) -> anyhow::Result<Outcome> {
    ensure!(json, BadArguments::new("the contract is printed as JSON only").with_hint("pass --json"));
    print(format_args!("{:#}", contract_json()))?;
    Ok(Outcome::Done)
}

fn contract_json() -> Value {
    let enums: Map<_, _> = contract::ENUMS
        .iter()
        .map(|(name, words)| {
            let numbers: Map<_, _> =
                words.iter().map(|(word, number)| ((*word).to_owned(), json!(number))).collect();
            ((*name).to_owned(), Value::Object(numbers))
        })
        .collect();
    json!({
        "contract": contract::CONTRACT_VERSION,
        "attribute": { "key": contract::CONTRACT_ATTRIBUTE, "value": contract::CONTRACT_VERSION.to_string() },
        "header": layout_json(&contract::HEADER),
        "block": layout_json(&contract::BLOCK),
        "stats": layout_json(&contract::STATS),
        "point": layout_json(&contract::POINT),
        "obstacles": layout_json(&contract::OBSTACLES),
        "obstacle_sector": layout_json(&contract::OBSTACLE_SECTOR),
        "obstacle_point": layout_json(&contract::OBSTACLE_POINT),
        "attitude": layout_json(&contract::ATTITUDE),
        "attitude_sample": layout_json(&contract::ATTITUDE_SAMPLE),
        "enums": enums,
        "services": contract::SERVICES,
        "metadata_keys": METADATA_KEYS,
    })
}

fn layout_json(layout: &StructLayout) -> Value {
    let fields: Vec<_> = layout
        .fields
        .iter()
        .map(|field| json!({ "name": field.name, "offset": field.offset, "type": field.kind, "count": field.count }))
        .collect();
    json!({ "type": layout.type_name, "bytes": layout.bytes, "alignment": layout.alignment, "fields": fields })
}
