//! Errors as a user sees them: one paragraph on stderr, and an exit code.

use std::io::Write;

use clap::error::ErrorKind;

use super::interrupt::EXIT_EARLY;
use crate::base::Error;

/// Prints a parser's message, or the help where no command was given. Help that was asked for and the version go to stdout and are no failure.
pub fn usage(error: &clap::Error) -> u8 {
    if !error.use_stderr() {
        // Help that nobody reads any more is no failure either.
        let _ = error.print();
        return 0;
    }
    if error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        // With stderr closed there is nobody left to tell.
        let _ = error.print();
    } else {
        paragraph(&usage_message(&error.to_string()));
    }
    2
}

/// The parser's message up to its usage lines, on one line.
pub fn usage_message(text: &str) -> String {
    let told = text.split("\n\nUsage:").next().unwrap_or(text).split("\n\nFor more information").next().unwrap_or(text);
    let told = told.strip_prefix("error: ").unwrap_or(told);
    let words: Vec<&str> = told.split_whitespace().collect();
    format!("{} (see --help)", words.join(" "))
}

/// Prints an error with its contexts, outermost first. The exit code is 1, or that of an early end where it tells of one.
pub fn report(error: &anyhow::Error) -> u8 {
    let mut message = String::new();
    for cause in error.chain() {
        if !message.is_empty() {
            message.push_str(": ");
        }
        message.push_str(&cause.to_string());
        // The library's errors already tell what caused them.
        if cause.is::<Error>() {
            break;
        }
    }
    paragraph(&message);
    match error.downcast_ref() {
        Some(Error::Interrupted(_)) => EXIT_EARLY,
        _ => 1,
    }
}

fn paragraph(message: &str) {
    // With stderr closed there is nobody left to tell.
    let _ = writeln!(std::io::stderr(), "fanal: {}", message.replace('\n', " "));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parser_messages_become_one_line() {
        let text = "error: the following were not provided:\n  --output <FILE>\n\nUsage: fanal render\n\nFor more information, try";
        assert_eq!(usage_message(text), "the following were not provided: --output <FILE> (see --help)");
    }
}
