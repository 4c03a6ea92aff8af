//! axe-core, which looks for what keeps people with disabilities from using a page. `script/test` fetches it, for it is not ours.

use crate::browser::Browser;
use serde_json::Value;
use std::path::Path;

/// axe-core, or nothing where it was not fetched.
pub struct Axe(Option<String>);

impl Axe {
    /// Reads what `script/test` has fetched.
    pub fn new() -> Self {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/axe-core/axe.min.js");
        let source = std::fs::read_to_string(&file).ok();
        if source.is_none() {
            eprintln!(
                "SKIPPED: the page's accessibility is not checked, as there is no {}: see script/test",
                file.display()
            );
        }
        Self(source)
    }

    /// Asserts that nothing is wrong with what is to be seen now.
    pub fn finds_nothing(&self, page: &mut Browser, place: &str) {
        let Some(source) = &self.0 else { return };
        if page.eval("typeof axe") == "undefined" {
            page.eval(&format!("{source}; 0"));
        }
        let found = page.eval(
            "axe.run({ resultTypes: ['violations'] }).then(({ violations, passes }) => ({
                rules: passes.length,
                violations: violations.map(({ id, help, nodes }) => ({
                    id, help, nodes: nodes.map(({ target, failureSummary }) => `${target}: ${failureSummary}`),
                })),
            }))",
        );
        let rules = found["rules"].as_u64().unwrap_or_default();
        assert!(rules > 10, "axe-core has looked at {place} by {rules} rules only");
        let violations = found["violations"].as_array().map(Vec::as_slice).unwrap_or_default();
        assert!(
            violations.is_empty(),
            "axe-core, {place}: {}",
            serde_json::to_string_pretty(violations).unwrap_or_default()
        );
        eprintln!("axe-core finds nothing in {place}, by {rules} rules");
    }

    /// Asserts that it finds something: a check that cannot fail shows nothing.
    pub fn finds(&self, page: &mut Browser, rule: &str) {
        if self.0.is_none() {
            return;
        }
        let found = page.eval("axe.run().then(({ violations }) => violations.map(({ id }) => id))");
        assert!(found.as_array().is_some_and(|ids| ids.contains(&Value::from(rule))), "{rule} is not found: {found}");
    }
}
