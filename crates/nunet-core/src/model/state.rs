//! `nunet.state`: the tensors that a network with a memory hands from each frame to the next.

use std::collections::BTreeMap;

use super::ModelError;

/// The metadata's key.
const KEY: &str = "nunet.state";
/// The most tensors of one file: an LSTM has two for each of its layers, and few networks have more than one layer.
const MAX_TENSORS: usize = 16;
/// The most bytes of one file's memory, which is held twice: 64 channels of a picture of 1280x720 take 236 MB.
const MAX_BYTES: u64 = 256 << 20;
/// Bytes of a `float32`.
const ELEMENT_BYTES: u64 = 4;

/// One tensor of a network's memory, `float32`: zeros before the first frame, then what the frame before left.
#[derive(Debug, Clone, PartialEq, Eq, serde::Deserialize, serde::Serialize)]
// An unknown field could say that the memory begins otherwise than with zeros: not to be ignored.
#[serde(deny_unknown_fields)]
pub struct StateTensor {
    /// The input of the file that takes it.
    pub input: String,
    /// The output of the file that gives it to the next frame.
    pub output: String,
    /// The shape of both, all dimensions fixed.
    pub shape: Vec<i64>,
}

impl StateTensor {
    /// Reads `nunet.state` from a file's metadata; no tensors where the network has no memory.
    ///
    /// Whether the file has these tensors is for the wiring to prove.
    ///
    /// # Errors
    /// A value that is not the documented list, names that come twice, open dimensions, more memory than is allowed.
    pub fn list(metadata: &BTreeMap<String, String>) -> Result<Vec<Self>, ModelError> {
        let Some(text) = metadata.get(KEY) else { return Ok(Vec::new()) };
        let tensors: Vec<Self> =
            serde_json::from_str(text).map_err(|error| ModelError::invalid(KEY, text, error))?;
        check(&tensors).map_err(|reason| ModelError::invalid(KEY, text, reason))?;
        Ok(tensors)
    }

    /// How many bytes it takes; `None` for a dimension that is not positive, and where the product overflows.
    fn bytes(&self) -> Option<u64> {
        let size = |dim: i64| u64::try_from(dim).ok().filter(|&dim| dim > 0);
        self.shape.iter().try_fold(ELEMENT_BYTES, |bytes, &dim| bytes.checked_mul(size(dim)?))
    }
}

fn check(tensors: &[StateTensor]) -> Result<(), String> {
    if tensors.is_empty() {
        return Err("no tensor is listed\nhint: a network without a memory leaves the key out".to_owned());
    }
    if tensors.len() > MAX_TENSORS {
        let count = tensors.len();
        return Err(format!("`{count}` tensors are listed, but a file has at most `{MAX_TENSORS}`"));
    }
    let mut total: u64 = 0;
    for (index, tensor) in tensors.iter().enumerate() {
        let StateTensor { input, output, shape } = tensor;
        let earlier = &tensors[..index];
        if earlier.iter().any(|other| other.input == *input) {
            return Err(format!(
                "the input `{input}` is listed twice\nhint: each tensor has an input of its own"
            ));
        }
        if earlier.iter().any(|other| other.output == *output) {
            return Err(format!(
                "the output `{output}` is listed twice\nhint: each tensor has an output of its own"
            ));
        }
        let bytes = tensor.bytes().ok_or_else(|| {
            format!("`{input}` has the shape `{shape:?}`\nhint: dimensions are fixed, positive and of reasonable size")
        })?;
        total = total.saturating_add(bytes);
    }
    if total > MAX_BYTES {
        return Err(format!("`{total}` bytes of memory in all, but a file has at most `{MAX_BYTES}`"));
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
    fn the_documented_list_is_read_and_its_absence_is_no_memory() {
        let tensors = list(LSTM).unwrap();
        assert_eq!(tensors.len(), 2);
        assert_eq!((tensors[0].input.as_str(), tensors[1].output.as_str()), ("hidden_in", "cell_out"));
        assert_eq!(tensors[0].shape, [1, 4, 3, 4]);
        assert_eq!(StateTensor::list(&BTreeMap::new()), Ok(Vec::new()));
    }

    #[test]
    fn what_is_not_the_documented_list_is_named_with_the_key() {
        for (text, says) in [
            ("[{", "EOF while parsing"),
            (r#"{"input": "a"}"#, "invalid type: map, expected a sequence"),
            (r#"[{"input": "a", "output": "b"}]"#, "missing field `shape`"),
            (r#"[{"input": "a", "output": "b", "shape": [1], "start": "ones"}]"#, "unknown field `start`"),
            ("[]", "no tensor is listed\nhint: a network without a memory leaves the key out"),
        ] {
            let message = list(text).unwrap_err().to_string();
            assert!(message.starts_with("its metadata has `nunet.state` `"), "{message}");
            assert!(message.contains(says), "{message}");
        }
    }

    #[test]
    fn no_name_comes_twice() {
        for (from, to, says) in [
            ("cell_in", "hidden_in", "the input `hidden_in` is listed twice\nhint: "),
            ("cell_out", "hidden_out", "the output `hidden_out` is listed twice\nhint: "),
        ] {
            let message = list(&LSTM.replace(from, to)).unwrap_err().to_string();
            assert!(message.contains(says), "{message}");
        }
    }

    #[test]
    fn dimensions_are_fixed_and_positive() {
        for shape in ["[1, -1]", "[0]", "[9223372036854775807, 9223372036854775807]"] {
            let message = list(&one(shape)).unwrap_err().to_string();
            assert!(message.contains(&format!("`a` has the shape `{shape}`\nhint: ")), "{message}");
        }
        assert!(list(&one("[]")).is_ok(), "a scalar is a tensor");
    }

    #[test]
    fn memory_is_bounded_in_number_and_bytes() {
        assert!(list(&one("[1, 64, 1024, 1024]")).is_ok(), "exactly the limit");
        let message = list(&one("[1, 64, 1024, 1025]")).unwrap_err().to_string();
        assert!(message.contains("`268697600` bytes of memory in all, but"), "{message}");
        let crowd: Vec<String> = (0..=MAX_TENSORS)
            .map(|i| format!(r#"{{"input": "a{i}", "output": "b{i}", "shape": [1]}}"#))
            .collect();
        let message = list(&format!("[{}]", crowd.join(","))).unwrap_err().to_string();
        assert!(message.contains("`17` tensors are listed, but a file has at most `16`"), "{message}");
    }
}
