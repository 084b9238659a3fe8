//! `fanal error`.

use super::in_pool;
use crate::base::Result;
use crate::cli::args::ErrorArgs;
use crate::cli::print;
use crate::film::measure;
use crate::scene::readers::read_image;

/// Reads two pictures and prints how far they are apart.
///
/// # Errors
/// What [`read_image`] and [`measure`] say.
pub fn run(args: &ErrorArgs) -> Result<()> {
    let (picture, reference) =
        in_pool(&args.common, || Ok((read_image(&args.picture, false)?, read_image(&args.reference, false)?)))?;
    let measures = measure(&picture, &reference)?;
    if args.json {
        return print::json(&measures);
    }
    let rows = [
        ("relMSE", measures.relmse),
        ("relMSE, trimmed", measures.relmse_trimmed),
        ("relMSE, LDR", measures.relmse_ldr),
        ("MSE", measures.mse),
        ("MAPE", measures.mape),
        ("mean ratio", measures.mean_ratio),
    ];
    rows.iter().try_for_each(|(name, value)| print::line(&format!("{name:<16}  {value:.6}")))
}
