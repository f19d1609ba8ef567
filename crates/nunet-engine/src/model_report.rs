//! The description of a model file as text, and as the JSON of `nunetd inspect --json`.

use nunet_core::graph::{SerialGraph, StageInfo, TensorSpec};
use nunet_core::model::{ModelDescription, SelfTestReport, StateTensor};
use nunet_types::{counted, printable, shortest};
use serde_json::{Value, json};

/// A model that was loaded and self-tested.
pub struct ModelReport<'a> {
    /// The file, as it is shown.
    pub file: String,
    /// SHA-256, hexadecimal.
    pub hash: String,
    /// The network.
    pub graph: &'a SerialGraph,
    /// The result of its self-test.
    pub selftest: &'a SelfTestReport,
}

impl ModelReport<'_> {
    fn description(&self) -> &ModelDescription {
        self.graph.description()
    }

    /// The sum over all components; `None` if the file states none.
    fn parameters(&self) -> Option<u64> {
        let components = &self.description().components;
        (!components.is_empty()).then(|| components.iter().map(|component| component.parameters).sum())
    }

    /// The sum over all components; `None` if the file states none.
    fn gflop(&self) -> Option<f64> {
        let components = &self.description().components;
        (!components.is_empty()).then(|| components.iter().map(|component| component.gflop).sum())
    }

    /// `None` for a foreign network, whose file does not state it.
    fn trained(&self) -> Option<bool> {
        let about = self.description();
        (!about.is_foreign()).then_some(about.trained)
    }

    /// The nearest and the farthest depth that it can measure, meters; `None` if there is no such limit.
    fn limits_m(&self) -> [Option<f64>; 2] {
        let about = self.description();
        let is_limit = |meters: &f32| about.encoding.is_metric() && *meters < f32::MAX;
        [about.range.min_m(), about.range.max_m()].map(|meters| Some(meters).filter(is_limit).map(shortest))
    }

    /// The description as JSON.
    #[must_use]
    pub fn json(&self) -> Value {
        let about = self.description();
        let [min_m, max_m] = self.limits_m();
        let checked = self.selftest.checked;
        json!({
            "contract": nunet_types::CONTRACT_VERSION,
            "file": self.file,
            "hash": self.hash,
            "trained": self.trained(),
            "architecture": about.architecture,
            "components": about.components,
            "stages": self.graph.stages().iter().map(stage_json).collect::<Vec<_>>(),
            "input": self.input_json(),
            "outputs": self.outputs().map(tensor_json).collect::<Vec<_>>(),
            "parameters": self.parameters(),
            "gflop": self.gflop(),
            "depth": {
                "encoding": about.encoding.name(),
                "min_m": min_m,
                "max_m": max_m,
            },
            "classes": about.classes,
            "camera": about.camera,
            "inner_size": about.inner_size,
            "training": about.training,
            "accuracy": about.accuracy,
            "license": about.license,
            "targets": about.targets,
            "provider": self.graph.provider().name(),
            "selftest": {
                "passed": checked.then_some(true),
                "worst": checked.then_some(shortest(self.selftest.worst_depth)),
                "tolerance": checked.then_some(shortest(self.selftest.tolerance)),
                "label_cells": checked.then_some(self.selftest.label_cells),
            },
        })
    }

    fn input_json(&self) -> Value {
        let image = self.graph.stages().first().and_then(|stage| stage.inputs.first());
        let layout = self.graph.float_input().map_or("nhwc", |format| format.layout.name());
        image.map_or(Value::Null, |tensor| {
            let mut json = tensor_json(tensor);
            json["layout"] = layout.into();
            json
        })
    }

    /// The tensors that leave the graph.
    fn outputs(&self) -> impl Iterator<Item = &TensorSpec> {
        let all = self.graph.stages().iter().flat_map(|stage| &stage.outputs);
        let foreign = self.description().is_foreign();
        all.filter(move |tensor| foreign || ["depth", "labels", "confidence"].contains(&tensor.name.as_str()))
    }

    /// The description as text, with a line feed at its end. Names in the model cannot add a line.
    #[must_use]
    pub fn text(&self) -> String {
        text_of(&self.lines())
    }

    fn lines(&self) -> Vec<String> {
        let about = self.description();
        let trained = match self.trained() {
            Some(true) => ", trained",
            Some(false) => ", UNTRAINED: its depth is meaningless",
            None => "",
        };
        let mut lines = vec![
            self.file.clone(),
            format!("  sha256       {}", self.hash),
            format!("  architecture {}{trained}", about.architecture),
            format!("  image        {}", self.graph.size()),
            format!("  depth        {}{}", about.encoding, self.limits_text()),
        ];
        if let (Some(parameters), Some(gflop)) = (self.parameters(), self.gflop()) {
            let millions = parameters as f64 / 1e6;
            lines.push(format!("  size         {millions:.1} M weights, {gflop:.1} GFLOP"));
        }
        for component in &about.components {
            let connected = if component.connected { ", connected to the image" } else { "" };
            let (name, task, backbone) = (&component.name, &component.task, &component.backbone);
            lines.push(format!("  component    {name}: {task} on {backbone}{connected}"));
        }
        for stage in self.graph.stages() {
            lines.push(format!("  stage        {}", stage_text(stage)));
            if !stage.state.is_empty() {
                lines.push(format!("  state        {}", state_text(&stage.state)));
            }
        }
        if !about.classes.is_empty() {
            lines.push(format!("  classes      {}", about.classes.join(", ")));
        }
        lines.push(format!("  accuracy     {}", accuracy_text(&about.accuracy)));
        lines.push(format!("  license      {}", about.license.as_deref().unwrap_or("not stated")));
        lines.push(format!("  self-test    {}", self.selftest));
        lines
    }

    fn limits_text(&self) -> String {
        match self.limits_m() {
            _ if !self.description().encoding.is_metric() => ", without a unit".to_owned(),
            [Some(min_m), Some(max_m)] => format!(", {min_m} to {max_m} m"),
            [min_m, _] => format!(", from {} m", min_m.unwrap_or_default()),
        }
    }
}

/// Each text as one line.
fn text_of(lines: &[String]) -> String {
    lines.iter().map(|line| printable::one_line(line).into_owned() + "\n").collect()
}

/// The usual metrics, if the recipe wrote them; anything else unchanged.
fn accuracy_text(accuracy: &Value) -> String {
    let metric =
        |group: &Value, name: &str| group.get(name)?.as_f64().map(|value| format!("{name} {value:.3}"));
    let line = |accuracy: &Value| {
        let metrics = accuracy.get("metrics")?;
        let depth = ["rmse", "abs_rel", "delta1"].iter().filter_map(|name| metric(metrics, name));
        let labels = accuracy.get("labels").and_then(|labels| metric(labels, "miou"));
        Some(depth.chain(labels).collect::<Vec<_>>().join(", ")).filter(|line| !line.is_empty())
    };
    let Some(found) = line(accuracy) else {
        let is_empty = accuracy.as_object().map_or(accuracy.is_null(), serde_json::Map::is_empty);
        return if is_empty { "not stated".to_owned() } else { accuracy.to_string() };
    };
    let trivial = accuracy.get("baseline").and_then(line).map(|line| format!("; the mean image: {line}"));
    format!("{found}{}", trivial.unwrap_or_default())
}

fn stage_text(stage: &StageInfo) -> String {
    let list = |tensors: &[TensorSpec]| {
        tensors
            .iter()
            .map(|tensor| format!("{} {}", tensor.name, tensor.kind()))
            .collect::<Vec<_>>()
            .join(", ")
    };
    let every = counted(stage.every, "frame");
    let every = if stage.every > 1 { format!(", every {every}") } else { String::new() };
    format!("{}: {} -> {}{every}", stage.name, list(&stage.inputs), list(&stage.outputs))
}

fn state_text(state: &[StateTensor]) -> String {
    let tensor =
        |tensor: &StateTensor| format!("{} -> {} float32 {:?}", tensor.output, tensor.input, tensor.shape);
    format!("{}, from frame to frame", state.iter().map(tensor).collect::<Vec<_>>().join(", "))
}

fn stage_json(stage: &StageInfo) -> Value {
    json!({
        "name": stage.name,
        "model": stage.model,
        "every": stage.every,
        "inputs": stage.inputs.iter().map(tensor_json).collect::<Vec<_>>(),
        "outputs": stage.outputs.iter().map(tensor_json).collect::<Vec<_>>(),
        "memory": stage.state,
    })
}

fn tensor_json(tensor: &TensorSpec) -> Value {
    json!({ "tensor": tensor.name, "dtype": tensor.element.name(), "shape": tensor.shape })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_cannot_add_a_line() {
        let lines =
            ["  classes      floor, a\n  license      MIT".to_owned(), "  self-test    passed".to_owned()];
        assert_eq!(text_of(&lines), "  classes      floor, a\\n  license      MIT\n  self-test    passed\n");
    }

    #[test]
    fn accuracy_is_shown_beside_that_of_the_mean_image() {
        let accuracy = json!({
            "metrics": { "rmse": 0.6688, "abs_rel": 0.1722, "delta1": 0.741, "sq_rel": 1.0 },
            "labels": { "miou": 0.4764 },
            "baseline": { "metrics": { "rmse": 1.2233 } },
        });
        let expected = "rmse 0.669, abs_rel 0.172, delta1 0.741, miou 0.476; the mean image: rmse 1.223";
        assert_eq!(accuracy_text(&accuracy), expected);
        assert_eq!(accuracy_text(&json!({ "own": 1 })), "{\"own\":1}");
        assert_eq!(accuracy_text(&Value::Null), "not stated");
        assert_eq!(accuracy_text(&json!({})), "not stated");
    }
}
