//! Ctrl-C as a wish: the work looks at a flag, stops early and still writes what it has.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::base::{Error, Result};

/// A flag that the first Ctrl-C sets; a second one ends the process at once.
///
/// # Errors
/// [`Error::Options`] where the system takes no handler.
pub fn flag() -> Result<Arc<AtomicBool>> {
    let flag = Arc::new(AtomicBool::new(false));
    let shared = Arc::clone(&flag);
    let on_signal = move || {
        if shared.swap(true, Ordering::Relaxed) {
            // 130 is what shells report for a process that Ctrl-C ended.
            std::process::exit(130);
        }
    };
    ctrlc::set_handler(on_signal).map_err(|e| Error::Options(format!("Ctrl-C cannot be handled: {e}")))?;
    Ok(flag)
}
