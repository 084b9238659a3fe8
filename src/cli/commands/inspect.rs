//! `fanal inspect`.

use super::{in_pool, load_scene};
use crate::base::{Error, Result};
use crate::cli::args::InspectArgs;
use crate::cli::print::line;
use crate::film::check_size;
use crate::guiding::sample::field::{Evidence, GuideField};
use crate::guiding::sample::file;
use crate::picture::{check_writable, write};
use crate::render::GuideStatistics;
use crate::report::inspect::{self, Maps};
use crate::scene::Scene;
use crate::scene::readers::How;

/// Prints a summary of a guide file, and draws the picture that is asked for.
///
/// # Errors
/// Errors of reading the file and the scene and of writing the picture; [`Error::Options`] for a point without a voxel.
pub fn run(args: &InspectArgs) -> Result<()> {
    args.output.as_deref().map_or(Ok(()), check_writable)?;
    if let (Some(output), None, None) = (&args.output, args.at, &args.scene) {
        return Err(Error::Options(format!("{}: say what to draw, by --at or --scene", output.display())));
    }
    in_pool(&args.common, || {
        let (field, evidence) = file::load(&args.guide)?;
        let mut told = summary(&field, &evidence).to_vec();
        let image = if let Some(path) = &args.scene {
            let how = How { definitions: &args.definitions, missing: args.missing, ..How::default() };
            let loaded = load_scene(path, &how, &args.common)?;
            let size = args.size.unwrap_or([loaded.file.film.width, loaded.file.film.height]);
            check_size(size[0], size[1])?;
            Some(inspect::gains(&Scene::build(&loaded, size)?, &field, &evidence))
        } else if let Some(point) = args.at {
            let maps = inspect::at(&field, &evidence, point)
                .ok_or_else(|| Error::Options(format!("no path came near {point}, so nothing is known there")))?;
            told.extend(legend(&maps, &field, &evidence));
            Some(maps.image)
        } else {
            None
        };
        if let (Some(output), Some(image)) = (&args.output, image) {
            write(output, &image, &[])?;
        }
        told.iter().try_for_each(|text| line(text))
    })
}

fn summary(field: &GuideField, evidence: &Evidence) -> [String; 2] {
    let GuideStatistics { voxels, trees, nodes, bytes, .. } = GuideStatistics::of(field);
    let size = format!("{voxels} voxels, {trees} with a guide; {nodes} nodes or lobes; {bytes} bytes while rendering");
    let mut gains: Vec<f32> = evidence.gain.iter().copied().filter(|g| g.is_finite()).collect();
    gains.sort_by(f32::total_cmp);
    let gain = match gains[..] {
        [] => "how much guiding helps was not measured".into(),
        [least, ..] => {
            let (median, most) = (gains[gains.len() / 2], gains[gains.len() - 1]);
            format!("second moments against BSDF samples alone: {least:.3} to {most:.3}, median {median:.3}")
        }
    };
    [size, gain]
}

/// Legend of the maps: the scale of colours, then a line for each row.
fn legend(maps: &Maps, field: &GuideField, evidence: &Evidence) -> Vec<String> {
    let colours =
        format!("brightest: {:.3} times the uniform density; five powers of ten to the darkest", maps.largest);
    let row = |(row, &voxel): (usize, &u32)| {
        let facing = field.cache().facing(voxel).unwrap_or("all ways");
        let gain = evidence.gain.get(voxel as usize).copied().unwrap_or(f32::NAN);
        let fraction = 100.0 * field.voxels()[voxel as usize].bsdf_fraction;
        format!(
            "row {row}: voxel {voxel}, facing {facing}, {fraction:.0} % BSDF samples, second moment {gain:.3} of theirs"
        )
    };
    std::iter::once(colours).chain(maps.voxels.iter().enumerate().map(row)).collect()
}
