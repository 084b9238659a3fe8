//! Parameter lists such as `"float radius" 2 "rgb L" [1 1 1]`, and their values by name.

use std::cell::{Cell, RefCell};
use std::collections::BTreeSet;

use glam::DVec3;

use crate::base::{Error, Place, Result};
use crate::scene::readers::slips::meant;

use super::spaces::ColorSpace;
use super::tokens::{Token, Tokens};

/// The types that a parameter can have.
const KINDS: [&str; 20] = [
    "float",
    "integer",
    "bool",
    "string",
    "texture",
    "point",
    "point2",
    "point3",
    "vector",
    "vector2",
    "vector3",
    "normal",
    "normal3",
    "rgb",
    "color",
    "xyz",
    "blackbody",
    "spectrum",
    "point4",
    "vector4",
];

/// The values of a parameter.
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// Numbers.
    Numbers(Vec<f64>),
    /// Quoted texts.
    Texts(Vec<String>),
    /// `true` and `false`.
    Truths(Vec<bool>),
}

/// A parameter.
#[derive(Debug, Clone)]
pub struct Parameter {
    /// Its type.
    pub kind: String,
    /// Its name.
    pub name: String,
    /// File and line.
    pub place: Place,
    /// Its values.
    pub values: Values,
    used: Cell<bool>,
}

impl Parameter {
    /// An error at this parameter.
    pub fn malformed(&self, message: impl Into<String>) -> Error {
        Error::malformed(self.place.clone(), message)
    }

    /// An error about the values, which `expected` describes.
    pub fn expected(&self, expected: &str) -> Error {
        self.malformed(format!("\"{} {}\": expected {expected}", self.kind, self.name))
    }

    /// The values, which must be numbers.
    pub fn numbers(&self) -> Result<&[f64]> {
        match &self.values {
            Values::Numbers(numbers) => Ok(numbers),
            _ => Err(self.expected("numbers")),
        }
    }

    /// The only value, which must be a text.
    pub fn text(&self) -> Result<&str> {
        match &self.values {
            Values::Texts(texts) if texts.len() == 1 => Ok(&texts[0]),
            _ => Err(self.expected("one text in quotes")),
        }
    }

    fn number(&self) -> Result<f64> {
        match self.numbers()? {
            [number] => Ok(*number),
            _ => Err(self.expected("one number")),
        }
    }

    /// The only value, which must be true or false.
    pub fn truth(&self) -> Result<bool> {
        match &self.values {
            Values::Truths(truths) if truths.len() == 1 => Ok(truths[0]),
            Values::Texts(texts) if *texts == ["true"] => Ok(true),
            Values::Texts(texts) if *texts == ["false"] => Ok(false),
            _ => Err(self.expected("true or false")),
        }
    }
}

/// The parameters of one directive.
#[derive(Debug, Clone)]
pub struct Parameters {
    /// Description of their owner in messages, such as `the shape "sphere"`.
    pub owner: String,
    /// File and line of the directive.
    pub place: Place,
    /// The space of their colours.
    pub space: ColorSpace,
    list: Vec<Parameter>,
    /// Names that were asked for.
    asked: RefCell<BTreeSet<&'static str>>,
}

impl Parameters {
    /// Reads the parameters that follow.
    ///
    /// # Errors
    /// [`Error::Malformed`], [`Error::Unsupported`] for types that do not exist.
    pub fn read(tokens: &mut Tokens, owner: String, space: ColorSpace) -> Result<Self> {
        let (place, mut list) = (tokens.place(), Vec::new());
        while let Some(Token::Text(_)) = tokens.peek()? {
            list.push(parameter(tokens)?);
        }
        Ok(Self { owner, place, space, list, asked: RefCell::default() })
    }

    /// The parameters themselves.
    pub fn into_list(self) -> Vec<Parameter> {
        self.list
    }

    /// Adds parameters that follow elsewhere.
    pub fn extend(&mut self, more: Vec<Parameter>) {
        self.list.extend(more);
    }

    /// Adds `defaults`, which count where a parameter of the same name is not given.
    pub fn add_defaults(&mut self, defaults: &[Parameter]) {
        let is_missing = |default: &&Parameter| self.list.iter().all(|own| own.name != default.name);
        let missing: Vec<Parameter> = defaults.iter().filter(is_missing).cloned().collect();
        // Whether the directive has a use for a default is not its own affair.
        missing.iter().for_each(|default| default.used.set(true));
        self.list.extend(missing);
    }

    /// An error at the directive.
    pub fn malformed(&self, message: impl Into<String>) -> Error {
        Error::malformed(self.place.clone(), message)
    }

    /// The parameter of this name.
    pub fn find(&self, name: &'static str) -> Option<&Parameter> {
        self.asked.borrow_mut().insert(name);
        // Of several the last one counts, as in later versions of a directive's text.
        let found = self.list.iter().rfind(|parameter| parameter.name == name)?;
        found.used.set(true);
        Some(found)
    }

    /// Whether a parameter is given, without using it.
    pub fn has(&self, name: &'static str) -> bool {
        self.list.iter().any(|parameter| parameter.name == name)
    }

    /// Takes parameters as used that do not change the picture's radiance.
    pub fn ignore(&self, names: &[&'static str]) {
        names.iter().for_each(|name| {
            self.find(name);
        });
    }

    /// Takes all parameters as used: those of something that is left out.
    pub fn ignore_all(&self) {
        self.list.iter().for_each(|parameter| parameter.used.set(true));
    }

    /// A number.
    pub fn float(&self, name: &'static str) -> Result<Option<f64>> {
        self.find(name).map(Parameter::number).transpose()
    }

    /// A number, or `default`.
    pub fn float_or(&self, name: &'static str, default: f64) -> Result<f64> {
        Ok(self.float(name)?.unwrap_or(default))
    }

    /// A whole number.
    pub fn integer(&self, name: &'static str) -> Result<Option<i64>> {
        let Some(parameter) = self.find(name) else { return Ok(None) };
        let number = parameter.number()?;
        if number.fract() != 0.0 || number.abs() > 1e15 {
            return Err(parameter.expected("a whole number"));
        }
        Ok(Some(number as i64))
    }

    /// True or false.
    pub fn boolean(&self, name: &'static str) -> Result<Option<bool>> {
        self.find(name).map(Parameter::truth).transpose()
    }

    /// A text.
    pub fn string(&self, name: &'static str) -> Result<Option<&str>> {
        self.find(name).map(Parameter::text).transpose()
    }

    /// Several texts.
    pub fn strings(&self, name: &'static str) -> Result<Option<&[String]>> {
        let Some(parameter) = self.find(name) else { return Ok(None) };
        match &parameter.values {
            Values::Texts(texts) => Ok(Some(texts)),
            _ => Err(parameter.expected("texts in quotes")),
        }
    }

    /// Any count of numbers; none where the parameter is not given.
    pub fn numbers(&self, name: &'static str) -> Result<&[f64]> {
        self.find(name).map_or(Ok(&[]), Parameter::numbers)
    }

    /// Tuples of `N` numbers; none where the parameter is not given.
    pub fn tuples<const N: usize>(&self, name: &'static str) -> Result<Vec<[f32; N]>> {
        let Some(parameter) = self.find(name) else { return Ok(Vec::new()) };
        let (tuples, []) = parameter.numbers()?.as_chunks::<N>() else {
            return Err(parameter.expected(&format!("a multiple of {N} numbers")));
        };
        Ok(tuples.iter().map(|tuple| tuple.map(|number| number as f32)).collect())
    }

    /// A point or vector.
    pub fn vector(&self, name: &'static str) -> Result<Option<DVec3>> {
        let Some(parameter) = self.find(name) else { return Ok(None) };
        match parameter.numbers()? {
            [x, y, z] => Ok(Some(DVec3::new(*x, *y, *z))),
            _ => Err(parameter.expected("three numbers")),
        }
    }

    /// Place and text of a warning for each parameter that was not asked for.
    pub fn unused(&self) -> impl Iterator<Item = (&Place, String)> {
        let asked: Vec<&str> = self.asked.borrow().iter().copied().collect();
        self.list.iter().filter(|parameter| !parameter.used.get()).map(move |parameter| {
            let name = &parameter.name;
            let slip = meant(name, &asked).map(|near| format!("; \"{near}\" seems to be meant")).unwrap_or_default();
            (&parameter.place, format!("the parameter \"{name}\" of {} is not used{slip}", self.owner))
        })
    }
}

fn parameter(tokens: &mut Tokens) -> Result<Parameter> {
    let declaration = tokens.text("a parameter's type and name")?;
    let place = tokens.place();
    let mut words = declaration.split_whitespace();
    let (Some(kind), Some(name), None) = (words.next(), words.next(), words.next()) else {
        return Err(Error::malformed(place, format!("\"{declaration}\" is not a parameter's type and name")));
    };
    if !KINDS.contains(&kind) {
        let what = format!("a parameter of the type \"{kind}\"");
        return Err(Error::Unsupported { place, what, supported: KINDS[..18].join(", ") });
    }
    let (kind, name) = (kind.to_owned(), name.to_owned());
    Ok(Parameter { values: values(tokens)?, kind, name, place, used: Cell::new(false) })
}

fn values(tokens: &mut Tokens) -> Result<Values> {
    let mut all: Option<Values> = None;
    if tokens.peek()? != Some(&Token::Open) {
        add(&mut all, tokens)?;
    } else {
        tokens.next()?;
        while tokens.peek()? != Some(&Token::Close) {
            add(&mut all, tokens)?;
        }
        tokens.next()?;
    }
    Ok(all.unwrap_or(Values::Numbers(Vec::new())))
}

/// Adds the next value, which must be like those before.
fn add(all: &mut Option<Values>, tokens: &mut Tokens) -> Result<()> {
    let one = match tokens.next()? {
        Some(Token::Text(text)) => Values::Texts(vec![text.into_owned()]),
        Some(Token::Word("true")) => Values::Truths(vec![true]),
        Some(Token::Word("false")) => Values::Truths(vec![false]),
        Some(Token::Word(word)) => match (all.as_mut(), tokens.number(word)?) {
            (Some(Values::Numbers(numbers)), number) => {
                numbers.push(number);
                return Ok(());
            }
            (_, number) => Values::Numbers(vec![number]),
        },
        Some(Token::Open | Token::Close) | None => return Err(tokens.malformed("expected a parameter's value")),
    };
    match (all, one) {
        (all @ None, one) => *all = Some(one),
        (Some(Values::Texts(texts)), Values::Texts(more)) => texts.extend(more),
        (Some(Values::Truths(truths)), Values::Truths(more)) => truths.extend(more),
        _ => return Err(tokens.malformed("values of different kinds in one parameter")),
    }
    Ok(())
}
