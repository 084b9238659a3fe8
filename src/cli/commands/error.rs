//! `fanal error`.

use super::in_pool;
use crate::base::Result;
use crate::cli::args::ErrorArgs;
use crate::cli::print;
use crate::film::measure_noisy;
use crate::picture::{matched, read_image, window_of};

/// Reads a picture and its reference and prints the errors; of a whole one and a window of it, the window is compared.
///
/// # Errors
/// Errors of [`read_image`], [`matched`] and [`measure_noisy`].
pub fn run(args: &ErrorArgs) -> Result<()> {
    let (picture, reference) =
        in_pool(&args.common, || Ok((read_image(&args.picture, false)?, read_image(&args.reference, false)?)))?;
    let (shown, known) = (window_of(&args.picture), window_of(&args.reference));
    let variance =
        args.reference_variance.as_ref().map(|file| matched(read_image(file, false)?, window_of(file), shown));
    let (picture, reference) = (matched(picture, shown, known)?, matched(reference, known, shown)?);
    let measures = measure_noisy(&picture, &reference, variance.transpose()?.as_ref())?;
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
