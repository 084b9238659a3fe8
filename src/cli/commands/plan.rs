//! `fanal plan`.

use super::{in_pool, load_scene};
use crate::base::Result;
use crate::cli::args::PlanArgs;
use crate::cli::print;
use crate::scene::overrides::decide;
use crate::scene::plan::plan;

/// Prints what a scene calls for.
///
/// # Errors
/// What reading the scene says.
pub fn run(args: &PlanArgs) -> Result<()> {
    let mut plan =
        plan(&in_pool(&args.common, || load_scene(&args.scene, &args.effects, args.missing, &args.common))?.file);
    decide(&mut plan, &args.effects);
    if args.json {
        return print::json(&plan);
    }
    plan.effects.iter().try_for_each(|effect| {
        let state = if effect.on { "on " } else { "off" };
        print::line(&format!("{state}  {:<20}  {}", effect.name.name(), effect.cause))
    })
}
