//! The list of checks, as text and as JSON.

use nunet_types::{CAUSE_MARK, printable};
use serde::Serialize;
use serde_json::json;

use crate::exit::message_and_hints;

/// The result of a check: a detail, or a problem.
pub(super) type Finding = Result<String, Problem>;

/// A problem and its fix.
#[derive(Debug)]
pub(super) struct Problem {
    pub(super) detail: String,
    pub(super) hint: Option<String>,
}

impl Problem {
    pub(super) fn new(detail: impl Into<String>, hint: impl Into<String>) -> Self {
        Self { detail: detail.into(), hint: Some(hint.into()) }
    }

    /// The problem for an error.
    pub(super) fn of(error: impl Into<anyhow::Error>) -> Self {
        let (message, hints) = message_and_hints(&error.into());
        // A check has one line.
        let detail = printable::with_later_lines_as_list(&message.replace(CAUSE_MARK, ": "));
        Self { detail, hint: (!hints.is_empty()).then(|| hints.join("; ")) }
    }
}

/// One check.
#[derive(Debug, Serialize)]
struct Check {
    /// Unique.
    name: String,
    ok: bool,
    detail: String,
    hint: Option<String>,
}

/// All checks, in the order in which they ran.
#[derive(Debug, Default)]
pub(super) struct Checks(Vec<Check>);

impl Checks {
    pub(super) fn add(&mut self, name: impl Into<String>, finding: Finding) {
        let name = name.into();
        self.0.push(match finding {
            Ok(detail) => Check { name, ok: true, detail, hint: None },
            Err(Problem { detail, hint }) => Check { name, ok: false, detail, hint },
        });
    }

    pub(super) fn problems(&self) -> usize {
        self.0.iter().filter(|check| !check.ok).count()
    }

    pub(super) fn json(&self) -> String {
        let json = json!({
            "contract": nunet_types::CONTRACT_VERSION,
            "ok": self.problems() == 0,
            "checks": self.0,
        });
        format!("{json:#}")
    }

    /// One line for each name, detail and hint, whatever stands in them.
    pub(super) fn text(&self) -> String {
        let line = |check: &Check| {
            let mark = if check.ok { "ok     " } else { "PROBLEM" };
            let hint = check.hint.as_deref().map(printable::one_line);
            let hint = hint.map(|hint| format!("\n          hint: {hint}")).unwrap_or_default();
            let [name, detail] = [&check.name, &check.detail].map(|text| printable::one_line(text));
            format!("{mark}  {name}: {detail}{hint}\n")
        };
        self.0.iter().map(line).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_cannot_add_a_check() {
        let mut checks = Checks::default();
        checks.add("camera a\nok", Ok("`b`\nok".to_owned()));
        checks.add("cache", Err(Problem::new("cannot write to `c`\nok  `", "remove `c`\nok  `")));
        let text = checks.text();
        assert_eq!(text.lines().count(), 3, "{text}");
        assert!(text.contains("  camera a\\nok: `b`\\nok\n"), "{text}");
    }

    #[test]
    fn the_lines_of_an_error_become_a_list() {
        let error = anyhow::anyhow!("no library; searched\n    `a b`: /lib\n    system: /usr/lib");
        assert_eq!(Problem::of(error).detail, "no library; searched `a b`: /lib, system: /usr/lib");
        assert_eq!(Problem::of(anyhow::anyhow!("no model")).detail, "no model");
    }
}
