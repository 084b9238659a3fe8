//! Tokens of a pbrt file: words, quoted texts and brackets, each with its line.

use std::borrow::Cow;
use std::path::Path;

use crate::base::{Error, Place, Result};

/// A token.
#[derive(Debug, Clone, PartialEq)]
pub enum Token<'a> {
    /// A directive, a number, `true` or `false`.
    Word(&'a str),
    /// A quoted text without its quotes.
    Text(Cow<'a, str>),
    /// `[`
    Open,
    /// `]`
    Close,
}

/// The tokens of a text in order.
pub struct Tokens<'a> {
    path: &'a Path,
    text: &'a str,
    /// Byte at which the next token is looked for.
    at: usize,
    /// Line of the token that was read last, from 1.
    line: u32,
    /// A token that was looked at, and its line.
    ahead: Option<(Token<'a>, u32)>,
}

impl<'a> Tokens<'a> {
    /// The tokens of `text`, which is the content of `path`.
    pub fn new(path: &'a Path, text: &'a str) -> Self {
        Self { path, text, at: 0, line: 1, ahead: None }
    }

    /// Place of the token that was read last.
    pub fn place(&self) -> Place {
        Place::line(self.path, self.line)
    }

    /// An error at the token that was read last.
    pub fn malformed(&self, message: impl Into<String>) -> Error {
        Error::malformed(self.place(), message)
    }

    /// The next token; none at the end of the file.
    ///
    /// # Errors
    /// [`Error::Malformed`] where a quoted text has no end.
    pub fn next(&mut self) -> Result<Option<Token<'a>>> {
        let (token, line) = match self.ahead.take() {
            Some(ahead) => ahead,
            None => match self.scan(self.line)? {
                Some(found) => found,
                None => return Ok(None),
            },
        };
        self.line = line;
        Ok(Some(token))
    }

    /// The token after the one that was read last; it stays the next one.
    ///
    /// # Errors
    /// As [`Tokens::next`].
    pub fn peek(&mut self) -> Result<Option<&Token<'a>>> {
        if self.ahead.is_none() {
            self.ahead = self.scan(self.line)?;
        }
        Ok(self.ahead.as_ref().map(|(token, _)| token))
    }

    /// The next token, which must be a quoted text.
    ///
    /// # Errors
    /// [`Error::Malformed`] if it is not.
    pub fn text(&mut self, what: &str) -> Result<String> {
        match self.next()? {
            Some(Token::Text(text)) => Ok(text.into_owned()),
            Some(Token::Word(word)) => Err(self.malformed(format!("expected {what} in quotes, found {word}"))),
            _ => Err(self.malformed(format!("expected {what} in quotes"))),
        }
    }

    /// The next `N` numbers, which may be in brackets.
    ///
    /// # Errors
    /// [`Error::Malformed`] if there are not as many.
    pub fn numbers<const N: usize>(&mut self) -> Result<[f64; N]> {
        let bracket = self.peek()? == Some(&Token::Open);
        if bracket {
            self.next()?;
        }
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            *number = match self.next()? {
                Some(Token::Word(word)) => self.number(word)?,
                _ => return Err(self.malformed(format!("expected {N} numbers"))),
            };
        }
        if bracket && self.next()? != Some(Token::Close) {
            return Err(self.malformed(format!("expected ] after {N} numbers")));
        }
        Ok(numbers)
    }

    /// The number that a word stands for.
    ///
    /// # Errors
    /// [`Error::Malformed`] if it is none, or not finite in single precision.
    pub fn number(&self, word: &str) -> Result<f64> {
        match word.parse::<f64>() {
            Ok(value) if (value as f32).is_finite() => Ok(value),
            Ok(_) => Err(self.malformed(format!("{word} is not a finite number"))),
            Err(_) => Err(self.malformed(format!("expected a number, found {}", shortened(word)))),
        }
    }

    /// Finds the next token and its line, counting lines from `line` where the search begins.
    fn scan(&mut self, mut line: u32) -> Result<Option<(Token<'a>, u32)>> {
        let bytes = self.text.as_bytes();
        loop {
            match bytes.get(self.at) {
                None => return Ok(None),
                Some(b'\n') => line = line.saturating_add(1),
                Some(byte) if byte.is_ascii_whitespace() => {}
                Some(b'#') => {
                    let rest = &bytes[self.at..];
                    self.at += rest.iter().position(|&byte| byte == b'\n').unwrap_or(rest.len());
                    continue;
                }
                Some(_) => break,
            }
            self.at += 1;
        }
        let start = self.at;
        let token = match bytes[start] {
            b'[' => Token::Open,
            b']' => Token::Close,
            b'"' => return self.quoted(line).map(|text| Some((Token::Text(text), line))),
            _ => {
                let ends = |byte: &u8| byte.is_ascii_whitespace() || b"[]\"#".contains(byte);
                let rest = &bytes[start..];
                self.at += rest.iter().position(ends).unwrap_or(rest.len());
                return Ok(Some((Token::Word(&self.text[start..self.at]), line)));
            }
        };
        self.at += 1;
        Ok(Some((token, line)))
    }

    /// The text that begins with the quote at `self.at`.
    fn quoted(&mut self, line: u32) -> Result<Cow<'a, str>> {
        let unended = || Error::malformed(Place::line(self.path, line), "a quoted text without its end");
        let inside = &self.text[self.at + 1..];
        let (mut escaped, mut plain) = (false, true);
        for (at, byte) in inside.bytes().enumerate() {
            match byte {
                _ if escaped => escaped = false,
                b'\\' => (escaped, plain) = (true, false),
                b'"' => {
                    self.at += at + 2;
                    let text = &inside[..at];
                    return Ok(if plain { Cow::Borrowed(text) } else { Cow::Owned(unescaped(text)) });
                }
                b'\n' => return Err(unended()),
                _ => {}
            }
        }
        Err(unended())
    }
}

/// A text with what its backslashes stand for.
fn unescaped(text: &str) -> String {
    let (mut out, mut escaped) = (String::with_capacity(text.len()), false);
    for c in text.chars() {
        match c {
            '\\' if !escaped => {
                escaped = true;
                continue;
            }
            'n' if escaped => out.push('\n'),
            't' if escaped => out.push('\t'),
            'r' if escaped => out.push('\r'),
            other => out.push(other),
        }
        escaped = false;
    }
    out
}

/// The beginning of a word for a message.
fn shortened(word: &str) -> String {
    const MOST: usize = 40;
    if word.chars().count() <= MOST { word.to_owned() } else { word.chars().take(MOST).chain(['…']).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(text: &str) -> Result<Vec<(Token<'_>, u32)>> {
        let mut tokens = Tokens::new(Path::new("a.pbrt"), text);
        let mut found = Vec::new();
        while let Some(token) = tokens.next()? {
            found.push((token, tokens.line));
        }
        Ok(found)
    }

    #[test]
    fn tokens_and_their_lines() {
        let text = "Shape\"a b\" # no \"token\"\n[1 -2.5e3]#\n\n \"q\\\"\\n\\\\\" .5";
        let texts = [("a b", 1), ("q\"\n\\", 4)].map(|(text, line)| (Token::Text(Cow::Borrowed(text)), line));
        let [first, second] = texts;
        let word = |word, line| (Token::Word(word), line);
        let expected = vec![
            word("Shape", 1),
            first,
            (Token::Open, 2),
            word("1", 2),
            word("-2.5e3", 2),
            (Token::Close, 2),
            second,
            word(".5", 4),
        ];
        assert_eq!(all(text).unwrap(), expected);
        assert_eq!(all("").unwrap(), []);
    }

    #[test]
    fn texts_must_end() {
        for (text, line) in [("\"a", 1), ("\n\"a\n\"", 2), ("\"a\\\"", 1)] {
            let error = all(text).unwrap_err();
            assert_eq!(error.to_string(), format!("a.pbrt:{line}: a quoted text without its end"));
        }
    }

    #[test]
    fn numbers_are_finite() {
        let tokens = Tokens::new(Path::new("a.pbrt"), "");
        for (word, value) in [("1", 1.0), (".5", 0.5), ("-2.e1", -20.0), ("+3", 3.0)] {
            assert_eq!(tokens.number(word).unwrap(), value);
        }
        for word in ["nan", "inf", "1e39", "1,5", "x"] {
            assert!(matches!(tokens.number(word), Err(Error::Malformed { .. })), "{word}");
        }
    }
}
