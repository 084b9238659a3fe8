//! `fanal plan`.

use super::{in_pool, load_scene};
use crate::base::Result;
use crate::cli::args::PlanArgs;
use crate::cli::print;
use crate::scene::overrides::decide;
use crate::scene::plan::plan;

/// Prints the plan of a scene: the effects that are on or off, and why, and its cameras, the default one first.
///
/// # Errors
/// Errors of reading the scene.
pub fn run(args: &PlanArgs) -> Result<()> {
    let file = in_pool(&args.common, || load_scene(&args.scene, &args.how(), &args.common))?.file;
    let mut plan = plan(&file);
    decide(&mut plan, &args.effects);
    if args.json {
        return print::json(&plan);
    }
    plan.effects.iter().try_for_each(|effect| {
        let state = if effect.on { "on " } else { "off" };
        print::line(&format!("{state}  {:<20}  {}", effect.name.name(), effect.cause))
    })?;
    file.views().try_for_each(|(name, camera)| {
        let [width, height] = camera.size.unwrap_or([file.film.width, file.film.height]);
        let sees = match camera.orthographic_width {
            Some(width) => format!("orthographic, {width} wide"),
            None => format!("perspective, {}° wide", camera.fov),
        };
        print::line(&format!("cam  {:<20}  {sees}, {width}x{height}", name.escape_debug().to_string()))
    })
}
