//! The topics of a subscription.

use nunet_ipc::Topic;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyString;

use crate::argument::shown;
use crate::error::hinted;

/// The topics that can be subscribed to.
pub(super) const TOPICS: [Topic; 7] = [
    Topic::Rgb,
    Topic::Depth,
    Topic::Labels,
    Topic::Confidence,
    Topic::Cloud,
    Topic::Obstacles,
    Topic::Stats,
];

/// The topics that a user names: several, or one.
pub(super) fn topics_of(given: &Bound<'_, PyAny>) -> PyResult<Vec<Topic>> {
    let words: Vec<String> = if given.is_instance_of::<PyString>() {
        vec![given.extract()?]
    } else {
        given.try_iter().and_then(|each| each.map(|word| word?.extract()).collect()).map_err(|_| {
            hinted::<PyTypeError>(
                format!("`topics` is `{}`; expected names of topics", shown(given)),
                "pass a list, `topics=[\"depth\", \"cloud\"]`",
            )
        })?
    };
    let mut topics = Vec::with_capacity(words.len());
    for word in &words {
        let known = TOPICS.into_iter().find(|topic| topic.name() == word);
        let topic = known.ok_or_else(|| unknown_topic(word))?;
        if topics.contains(&topic) {
            return Err(hinted::<PyValueError>(format!("`topics` has `{topic}` twice"), "name it once"));
        }
        topics.push(topic);
    }
    if topics.is_empty() {
        return Err(hinted::<PyValueError>("`topics` is empty", "name one, `topics=[\"depth\"]`"));
    }
    Ok(topics)
}

fn unknown_topic(word: &str) -> PyErr {
    let choices: Vec<_> = TOPICS.iter().map(|topic| format!("`{topic}`")).collect();
    hinted::<PyValueError>(
        format!("`topics` has `{word}`, which is not a topic"),
        format!("pass any of {}", choices.join(", ")),
    )
}
