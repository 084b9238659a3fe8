//! `--variant` of `fanal compare`: a method with a name and options of its own.

use clap::parser::ValueSource;
use clap::{Args, Command, FromArgMatches};

use super::RenderArgs;

/// A method as the command line describes it.
#[derive(Debug, Clone)]
pub struct VariantArgs {
    /// Its name: of letters, digits, `.`, `_`, `+` and `-`.
    pub name: String,
    /// The options of `fanal render` that it was given; depth, filter, budget and seed are those of the comparison.
    pub render: Box<RenderArgs>,
}

/// Options that a variant may have: how light is found, and which is believed. What the picture shows, and its budget, are the comparison's.
const OPTIONS: [&str; 17] = [
    "guide",
    "guide_memory",
    "roulette",
    "light_sampling",
    "guided_distances",
    "adaptive",
    "complete_paths",
    "fireflies",
    "kappa",
    "samples",
    "target",
    "direct",
    "fraction",
    "filter",
    "simple_iterations",
    "past",
    "reconstruct",
];
/// Longest name, as it is part of the names of files.
const LONGEST: usize = 40;

/// An option as it is written on the command line.
fn written(option: &str) -> String {
    format!("--{}", option.replace('_', "-"))
}

/// A variant from `name: options`, as in `no-past: --guide variance --past 0`.
pub(super) fn variant(text: &str) -> Result<VariantArgs, String> {
    let (name, options) =
        text.split_once(':').ok_or("expected NAME: OPTIONS, as in 'no-past: --guide variance --past 0'")?;
    let name = name.trim();
    let plain = |c: char| c.is_ascii_alphanumeric() || "._+-".contains(c);
    if name.is_empty() || name.len() > LONGEST || name.starts_with(['.', '-']) || !name.chars().all(plain) {
        return Err(format!("'{name}' is no name: use up to {LONGEST} letters, digits, '.', '_', '+' and '-'"));
    }
    // Of the words that `render` has to have, the samples keep a scene that asks for none from being refused.
    let words = ["scene", "-o", "picture.exr", "--spp", "1"].into_iter().chain(options.split_whitespace());
    let command = RenderArgs::augment_args(Command::new("--variant").no_binary_name(true).disable_help_flag(true));
    let known: Vec<String> = command.get_arguments().map(|argument| argument.get_id().to_string()).collect();
    let matches = command.try_get_matches_from(words).map_err(|error| {
        let text = error.render().to_string();
        text.lines().next().unwrap_or_default().trim_start_matches("error: ").to_owned()
    })?;
    let given = |id: &&String| matches.value_source(id.as_str()) == Some(ValueSource::CommandLine);
    let common = ["scene", "output", "spp"];
    if let Some(other) = known.iter().filter(given).find(|id| ![&OPTIONS[..], &common].concat().contains(&id.as_str()))
    {
        let allowed = OPTIONS.map(written).join(", ");
        return Err(format!("{} is the same for all methods of a comparison; a variant has {allowed}", written(other)));
    }
    let render = RenderArgs::from_arg_matches(&matches).map_err(|error| error.to_string())?;
    Ok(VariantArgs { name: name.to_owned(), render: Box::new(render) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrators::Roulette;
    use crate::render::GuideMode;

    #[test]
    fn a_variant_has_the_options_that_find_light() {
        let given = variant("Mueller-2017: --guide ppg --roulette off --past 0.25").expect("a variant");
        assert_eq!((given.name.as_str(), given.render.of.guide), ("Mueller-2017", GuideMode::Ppg));
        assert_eq!((given.render.of.roulette, given.render.learning.past), (Some(Roulette::Off), Some(0.25)));
        assert!(variant("plain:").is_ok_and(|plain| plain.render.of.guide == GuideMode::Neural));
    }

    #[test]
    fn what_belongs_to_the_comparison_is_refused() {
        for options in OPTIONS {
            assert!(RenderArgs::augment_args(Command::new("all")).get_arguments().any(|a| a.get_id() == options));
        }
        let refused = |text: &str, why: &str| {
            let error = variant(text).expect_err(text);
            assert!(error.contains(why), "{text}: {error}");
        };
        refused("a: --time 4", "--time");
        refused("a: --spp 4", "--spp");
        refused("a: --max-depth 4", "--max-depth is the same for all");
        refused("a: --seed 4", "--seed is the same for all");
        refused("a: --guide nothing", "nothing");
        refused("a: --gide none", "--gide");
        refused("--guide none", "NAME: OPTIONS");
        for name in ["", " ", "a/b", "..", "-a", "a,b", &"n".repeat(41)] {
            refused(&format!("{name}: --past 0"), "is no name");
        }
    }
}
