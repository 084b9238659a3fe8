//! `fanal merge`.

use std::path::Path;

use super::render::networks;
use super::{dataset, in_pool};
use crate::base::streamed::Streamed;
use crate::base::{Error, Result, named};
use crate::cli::args::{Backend, MergeArgs};
use crate::cli::resolve::display;
use crate::cli::{print, progress};
use crate::generate::dataset::check;
use crate::generate::parts::{self, Merging};
use crate::guiding::sample::file;
use crate::picture::{Picture, check_folder, check_writable, is_png, write_or_rescue};
use crate::render::guide_part::merge_guides;
use crate::render::merge::{Merged, merge, merge_first};

/// Ends the names of sums of parts: not that of parts, which are often given as all files that end so.
const SUM: &str = "sum";

/// Puts the parts of a picture, of a guide or of a data set together.
///
/// # Errors
/// Errors of reading the parts and of writing the whole; [`Error::Options`] where it is not clear what is wanted.
pub fn run(args: &MergeArgs) -> Result<()> {
    match (&args.inputs[..], &args.output) {
        ([folder], None) if folder.is_dir() => data(folder, args),
        (_, None) => Err(Error::Options("give -o FILE for the picture; without it, the folder of one data set".into())),
        (inputs, Some(_)) if inputs.iter().any(|input| input.is_dir()) => Err(Error::Options(
            "a data set is put together in its folder: leave -o out, and give the folder alone".into(),
        )),
        ([first, ..], Some(output)) if Streamed::open(first)?.has(file::PART_HEAD) => guide(output, args),
        (_, Some(output)) if output.extension().is_some_and(|extension| extension == SUM) => first(output, args),
        (_, Some(output)) => picture(output, args),
    }
}

/// Merges the first parts to a part in their place.
fn first(output: &Path, args: &MergeArgs) -> Result<()> {
    check_folder(output)?;
    check_no_guide(args)?;
    check_no_picture(args, "a part is merged of all first ones")?;
    in_pool(&args.common, || merge_first(&args.inputs, output, &*progress::progress(args.common.quiet)))
}

/// Refuses what is for pictures alone; `why` all parts must be there.
fn check_no_picture(args: &MergeArgs, why: &str) -> Result<()> {
    let given = [("--exposure", args.exposure.is_some()), ("--view", args.view.is_some())];
    match given.into_iter().find(|(_, given)| *given) {
        Some((name, _)) => Err(Error::Options(format!("{name} is for pictures; leave it out"))),
        None if args.allow_missing => Err(Error::Options(format!("--allow-missing is for pictures: {why}"))),
        None => Ok(()),
    }
}

/// Refuses what is for guides alone.
fn check_no_guide(args: &MergeArgs) -> Result<()> {
    let given = [("--model", args.model.is_some()), ("--backend", args.backend != Backend::Embedded)];
    let found = given.into_iter().find(|(_, given)| *given);
    found.map_or(Ok(()), |(name, _)| Err(Error::Options(format!("{name} is for guides; leave it out"))))
}

fn guide(output: &Path, args: &MergeArgs) -> Result<()> {
    check_folder(output)?;
    check_no_picture(args, "a guide of some parts is another guide")?;
    in_pool(&args.common, || {
        let (field, evidence) = merge_guides(&args.inputs, |reconstruction, mode| {
            reconstruction.reconstructor(|| Ok(Box::new(networks(args.model.as_deref(), args.backend, mode)?)))
        })?;
        file::save(output, &field, &evidence)
    })
}

fn picture(output: &Path, args: &MergeArgs) -> Result<()> {
    check_writable(output)?;
    check_no_guide(args)?;
    let display = display(args.exposure, args.view, is_png(output))?;
    in_pool(&args.common, || {
        let Merged { image, layers, attributes, placed, missing } =
            merge(&args.inputs, args.allow_missing, &*progress::progress(args.common.quiet))?;
        let told = (!missing.is_empty()).then(|| format!("parts are missing: {}", named(&missing)));
        print::warnings(&told.into_iter().collect::<Vec<_>>(), args.common.quiet);
        let picture = Picture { image: &image, channels: &layers, window: placed, attributes: &attributes };
        write_or_rescue(output, &picture, display)
    })
}

fn data(folder: &Path, args: &MergeArgs) -> Result<()> {
    check_no_guide(args)?;
    let found = match parts::merge(folder)? {
        Merging::Done(count) => format!("{count} parts are put together"),
        Merging::DoneBefore => "the data are whole".to_owned(),
        Merging::NoParts => "there are no parts, and an index already".to_owned(),
    };
    print::line(&format!("{}: {found}", folder.display()))?;
    if args.check { dataset::told(&in_pool(&args.common, || check(folder))?) } else { Ok(()) }
}
