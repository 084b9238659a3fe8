//! Progress of this process.

use std::io::IsTerminal;

use indicatif::{ProgressBar, ProgressStyle};

use super::lines::Lines;
use crate::base::{Progress, Silent};

/// Progress display that fits this process: a bar on a terminal, lines elsewhere, nothing when `quiet`.
pub fn progress(quiet: bool) -> Box<dyn Progress> {
    match (quiet, std::io::stderr().is_terminal()) {
        (true, _) => Box::new(Silent),
        (false, true) => Box::new(Bar::default()),
        (false, false) => Box::new(Lines::begin()),
    }
}

/// A bar with rate and remaining time on stderr.
#[derive(Debug)]
pub struct Bar(ProgressBar);

impl Default for Bar {
    fn default() -> Self {
        Self(ProgressBar::new(0))
    }
}

impl Progress for Bar {
    fn start(&self, total: u64, unit: &str) {
        let template = if total == 0 {
            format!("{{spinner}} {{human_pos}} {unit}  {{rate}} {unit}/s  {{elapsed}}  {{msg}}")
        } else {
            format!("{{wide_bar}} {{percent}} %  {{rate}} {unit}/s  {{elapsed}} + {{eta}}  {{msg}}")
        };
        let rate = |state: &indicatif::ProgressState, out: &mut dyn std::fmt::Write| {
            // Writing to indicatif's own buffer cannot fail.
            let _ = write!(out, "{}", indicatif::HumanCount(state.per_sec() as u64));
        };
        // The templates above are fixed, so only a unit with braces in it could break one; then the default style stays.
        if let Ok(style) = ProgressStyle::with_template(&template) {
            self.0.set_style(style.with_key("rate", rate));
        }
        self.0.reset();
        self.0.set_length(total);
    }

    fn advance(&self, n: u64) {
        self.0.inc(n);
    }

    fn message(&self, text: &str) {
        self.0.set_message(text.to_owned());
    }

    fn finish(&self) {
        self.0.finish_and_clear();
    }
}
