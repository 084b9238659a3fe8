//! Signals that ask a command to end, as a flag: the work looks at it, stops early and still writes what it has.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag::{register, register_conditional_shutdown};

use crate::base::{Error, Result};

/// Exit code of work that a signal ended early (EX_TEMPFAIL of sysexits.h): what there is was kept, and the same command makes more.
pub const EXIT_EARLY: u8 = 75;

/// Whether a command did all of its work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[must_use]
pub enum Ended {
    /// It did all that it was asked to do.
    Whole,
    /// A signal ended it before.
    Early,
}

impl Ended {
    /// The exit code that tells of it.
    pub fn code(self) -> u8 {
        match self {
            Self::Whole => 0,
            Self::Early => EXIT_EARLY,
        }
    }
}

/// A flag that the first Ctrl-C, SIGTERM or SIGHUP sets; the next one ends the process at once.
///
/// # Errors
/// [`Error::Options`] where the system takes no handler.
pub fn flag() -> Result<Arc<AtomicBool>> {
    let flag = Arc::new(AtomicBool::new(false));
    for signal in signals() {
        // In this order: the first signal does not find the flag set. Shells report 128 + n for a process that signal n ended.
        register_conditional_shutdown(signal, 128 + signal, Arc::clone(&flag))
            .and_then(|_| register(signal, Arc::clone(&flag)))
            .map_err(|e| Error::Options(format!("signal {signal} cannot be handled: {e}")))?;
    }
    Ok(flag)
}

#[cfg(unix)]
fn signals() -> Vec<i32> {
    use crate::base::process::ignores;
    use signal_hook::consts::SIGHUP;
    // `nohup` makes its command ignore that its terminal goes away.
    let hangup = Some(SIGHUP).filter(|&signal| !ignores(signal));
    [SIGINT, SIGTERM].into_iter().chain(hangup).collect()
}

#[cfg(not(unix))]
fn signals() -> Vec<i32> {
    vec![SIGINT, SIGTERM]
}
