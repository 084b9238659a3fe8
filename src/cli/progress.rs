//! Progress of this process.

use std::io::IsTerminal;
use std::sync::{Mutex, PoisonError};

use indicatif::{ProgressBar, ProgressStyle};

use super::lines::{Lines, percent};
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
pub struct Bar {
    bar: ProgressBar,
    said: Mutex<Said>,
}

/// What stands beside the bar.
#[derive(Debug, Default)]
struct Said {
    message: String,
    reached: String,
}

impl Default for Bar {
    fn default() -> Self {
        Self { bar: ProgressBar::new(0), said: Mutex::default() }
    }
}

impl Bar {
    fn say(&self, change: impl FnOnce(&mut Said)) {
        // Whatever a thread left there when it panicked can be shown.
        let mut said = self.said.lock().unwrap_or_else(PoisonError::into_inner);
        change(&mut said);
        let parts = [&said.message, &said.reached].into_iter().filter(|part| !part.is_empty());
        self.bar.set_message(parts.map(String::as_str).collect::<Vec<_>>().join(": "));
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
            self.bar.set_style(style.with_key("rate", rate));
        }
        self.bar.reset();
        self.bar.set_length(total);
        self.say(|said| *said = Said::default());
    }

    fn advance(&self, n: u64) {
        self.bar.inc(n);
    }

    fn message(&self, text: &str) {
        self.say(|said| text.clone_into(&mut said.message));
    }

    fn reached(&self, part: Option<f64>, what: &str) {
        let parts: Vec<String> = part.map(percent).into_iter().chain([what.to_owned()]).collect();
        self.say(|said| said.reached = parts.join(", "));
    }

    fn finish(&self) {
        self.bar.finish_and_clear();
    }
}
