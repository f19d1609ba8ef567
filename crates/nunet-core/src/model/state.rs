//! `nunet.state`: the state tensors of a recurrent network.

use std::collections::BTreeMap;

use super::ModelError;

/// The metadata's key.
const KEY: &str = "nunet.state";
/// The most state tensors of one file. An LSTM has two per layer, and few networks have more than one layer.
const MAX_TENSORS: usize = 16;
/// The most bytes of one file's state, which is allocated twice: 64 channels of 1280x720 take 236 MB.
const MAX_BYTES: u64 = 256 << 20;
/// Bytes of a `float32`.
const ELEMENT_BYTES: u64 = 4;

/// One state tensor, `float32`: zeros before the first frame, then what the previous frame left.
#[derive(Debug, Clone, PartialEq, Eq, serde::Deserialize, serde::Serialize)]
// Not to be ignored: an unknown field could define another initial state than zeros.
#[serde(deny_unknown_fields)]
pub struct StateTensor {
    /// The input that reads it.
    pub input: String,
    /// The output that writes it for the next frame.
    pub output: String,
    /// The shape of both, all dimensions fixed.
    pub shape: Vec<i64>,
}

impl StateTensor {
    /// Parses `nunet.state` in a file's metadata; empty for a network without state.
    ///
    /// The wiring checks later whether the file has these tensors.
    ///
    /// # Errors
    /// A value that is not the documented list, duplicate names, open dimensions, more state than allowed.
    pub fn list(metadata: &BTreeMap<String, String>) -> Result<Vec<Self>, ModelError> {
        let Some(text) = metadata.get(KEY) else { return Ok(Vec::new()) };
        let tensors: Vec<Self> =
            serde_json::from_str(text).map_err(|error| ModelError::invalid(KEY, text, error))?;
        check(&tensors).map_err(|reason| ModelError::invalid(KEY, text, reason))?;
        Ok(tensors)
    }

    /// Its size in bytes; `None` for a dimension that is not positive, and if the product overflows.
    fn bytes(&self) -> Option<u64> {
        let size = |dim: i64| u64::try_from(dim).ok().filter(|&dim| dim > 0);
        self.shape.iter().try_fold(ELEMENT_BYTES, |bytes, &dim| bytes.checked_mul(size(dim)?))
    }
}

fn check(tensors: &[StateTensor]) -> Result<(), String> {
    if tensors.is_empty() {
        return Err("the list is empty".to_owned());
    }
    if tensors.len() > MAX_TENSORS {
        let count = tensors.len();
        return Err(format!("{count} tensors are listed, at most {MAX_TENSORS} are supported"));
    }
    let mut total: u64 = 0;
    for (index, tensor) in tensors.iter().enumerate() {
        let StateTensor { input, output, shape } = tensor;
        let earlier = &tensors[..index];
        if earlier.iter().any(|other| other.input == *input) {
            return Err(format!("the input `{input}` is listed twice"));
        }
        if earlier.iter().any(|other| other.output == *output) {
            return Err(format!("the output `{output}` is listed twice"));
        }
        let bytes = tensor.bytes().ok_or_else(|| {
            format!("`{input}` has the shape `{shape:?}`, expected fixed positive dimensions")
        })?;
        total = total.saturating_add(bytes);
    }
    if total > MAX_BYTES {
        return Err(format!("the state has {total} bytes, at most {MAX_BYTES} are supported"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const LSTM: &str = r#"[{"input": "hidden_in", "output": "hidden_out", "shape": [1, 4, 3, 4]},
        {"input": "cell_in", "output": "cell_out", "shape": [1, 4, 3, 4]}]"#;

    fn list(text: &str) -> Result<Vec<StateTensor>, ModelError> {
        StateTensor::list(&BTreeMap::from([(KEY.to_owned(), text.to_owned())]))
    }

    fn one(shape: &str) -> String {
        format!(r#"[{{"input": "a", "output": "b", "shape": {shape}}}]"#)
    }

    #[test]
    fn the_documented_list_is_read_and_a_missing_key_is_no_state() {
        let tensors = list(LSTM).unwrap();
        assert_eq!(tensors.len(), 2);
        assert_eq!((tensors[0].input.as_str(), tensors[1].output.as_str()), ("hidden_in", "cell_out"));
        assert_eq!(tensors[0].shape, [1, 4, 3, 4]);
        assert_eq!(StateTensor::list(&BTreeMap::new()), Ok(Vec::new()));
    }

    /// The reason for which a list is refused.
    fn reason(text: &str) -> String {
        match list(text) {
            Err(ModelError::Invalid { key: KEY, reason, .. }) => reason,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn other_lists_than_the_documented_one_are_refused() {
        for (text, says) in [
            ("[{", "EOF while parsing"),
            (r#"{"input": "a"}"#, "invalid type: map, expected a sequence"),
            (r#"[{"input": "a", "output": "b"}]"#, "missing field `shape`"),
            (r#"[{"input": "a", "output": "b", "shape": [1], "start": "ones"}]"#, "unknown field `start`"),
            ("[]", "the list is empty"),
        ] {
            assert!(reason(text).contains(says), "{}", reason(text));
        }
    }

    #[test]
    fn duplicate_names_are_refused() {
        let input = reason(&LSTM.replace("cell_in", "hidden_in"));
        assert_eq!(input, "the input `hidden_in` is listed twice");
        let output = reason(&LSTM.replace("cell_out", "hidden_out"));
        assert_eq!(output, "the output `hidden_out` is listed twice");
    }

    #[test]
    fn dimensions_are_fixed_and_positive() {
        for shape in ["[1, -1]", "[0]", "[9223372036854775807, 9223372036854775807]"] {
            let expected = format!("`a` has the shape `{shape}`, expected fixed positive dimensions");
            assert_eq!(reason(&one(shape)), expected);
        }
        assert!(list(&one("[]")).is_ok(), "a scalar is a tensor");
    }

    #[test]
    fn state_is_bounded_in_number_and_bytes() {
        assert!(list(&one("[1, 64, 1024, 1024]")).is_ok(), "exactly the limit");
        let large = reason(&one("[1, 64, 1024, 1025]"));
        assert_eq!(large, "the state has 268697600 bytes, at most 268435456 are supported");
        let many: Vec<String> = (0..=MAX_TENSORS)
            .map(|i| format!(r#"{{"input": "a{i}", "output": "b{i}", "shape": [1]}}"#))
            .collect();
        let many = reason(&format!("[{}]", many.join(",")));
        assert_eq!(many, "17 tensors are listed, at most 16 are supported");
    }
}
