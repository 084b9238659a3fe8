//! `fanal render --replay`: one sample explained vertex by vertex.

use glam::Vec3;

use super::render::{loaded_guide, scene_crc, settled};
use super::{in_pool, load_scene};
use crate::base::{Error, Result};
use crate::cli::args::RenderArgs;
use crate::cli::resolve::resolve;
use crate::cli::{interrupt, print, progress, views};
use crate::integrators::path::{ExplainedVertex, Explanation};
use crate::render::{Control, GuideMode, Sample, replay};
use crate::scene::Scene;
use crate::scene::readers::LoadedScene;

/// Traces the sample and prints its path.
///
/// # Errors
/// Errors of reading and rendering; [`Error::Options`] for a guide that is learned while rendering.
pub fn run(args: &RenderArgs, sample: Sample) -> Result<()> {
    if args.of.guide != GuideMode::None && args.load_guide.is_none() {
        return Err(Error::Options(
            "--replay does not learn: give --guide none, or --load-guide with the guide that the render loaded".into(),
        ));
    }
    in_pool(&args.common, || {
        let mut loaded = load_scene(&args.of.scene, &args.of.how(), &args.common)?;
        views::select(&args.of, &mut loaded)?;
        let request = resolve(args, &loaded.file)?;
        print::warnings(request.unused().as_slice(), args.common.quiet);
        loaded.file.render.max_depth = request.settings.transport.max_depth;
        let (_, settings) = settled(&request, &loaded);
        let field = loaded_guide(&request, &settings, &scene_crc(&loaded))?.map(|(field, _)| field);
        let scene = Scene::build(&loaded, request.size)?;
        let (stop, progress) = (interrupt::flag()?, progress::progress(args.common.quiet));
        let found = replay(&scene, &settings, field, sample, &Control::new(&*progress, &stop))?;
        progress.finish();
        describe(&found, &scene, &loaded, sample).iter().try_for_each(|line| print::line(line))
    })
}

fn vector(v: Vec3) -> String {
    format!("({:.6e}, {:.6e}, {:.6e})", v.x, v.y, v.z)
}

/// Describes the path, in a few lines for each vertex.
fn describe(found: &Explanation, scene: &Scene, loaded: &LoadedScene, sample: Sample) -> Vec<String> {
    let [x, y] = sample.pixel;
    let from = sample.pass_from.map_or("on its own".into(), |from| format!("of the pass that begins at {from}"));
    let mut lines = vec![
        format!("pixel {x},{y}, sample {} {from}", sample.number),
        format!("camera: from {} towards {}", vector(found.ray.origin), vector(found.ray.direction)),
    ];
    for (number, vertex) in (1..).zip(&found.vertices) {
        lines.extend(described(number, vertex, scene, loaded));
    }
    if found.background_glow != Vec3::ZERO {
        lines.push(format!("media on the way there shine with {}", vector(found.background_glow)));
    }
    if found.background.weight != 0.0 || !found.background.radiance.is_finite() {
        let (radiance, weight) = (vector(found.background.radiance), found.background.weight);
        lines.push(format!("background: radiance {radiance}, weight {weight:.6}"));
        lines.push(format!("  contribution {}", vector(found.background_contribution)));
    }
    lines.push(format!("radiance: {}", vector(found.radiance)));
    lines.push(found.cause.map_or("the sample is finite".into(), |cause| format!("not finite: {}", cause.name())));
    lines
}

fn described(number: usize, vertex: &ExplainedVertex, scene: &Scene, loaded: &LoadedScene) -> Vec<String> {
    let material = |shape: u32| loaded.file.materials.keys().nth(scene.material_of(shape)).map_or("", String::as_str);
    let place = vertex.shape.map_or("in a medium".into(), |shape| {
        format!("shape {shape}, material \"{}\", normal {}", material(shape), vector(vertex.normal))
    });
    let mut lines = vec![format!("vertex {number}: at {}, {place}", vector(vertex.point))];
    let mut say = |text: String| lines.push(format!("  {text}"));
    say(format!("distance {:.6e}, throughput {}", vertex.distance, vector(vertex.throughput)));
    if vertex.passed != Vec3::ONE {
        say(format!("medium on the way lets through {}", vector(vertex.passed)));
    }
    if vertex.glow != Vec3::ZERO {
        say(format!("and shines with {}", vector(vertex.glow)));
    }
    if vertex.met.radiance != Vec3::ZERO {
        say(format!("emission {}, weight {:.6}", vector(vertex.met.radiance), vertex.met.weight));
    }
    if vertex.direct != Vec3::ZERO {
        say(format!("light sampling {}", vector(vertex.direct)));
    }
    match &vertex.onward {
        None => say("ends here".into()),
        Some(onward) => {
            let lobe = if onward.delta { "delta lobe" } else { "pdf" };
            say(format!("towards {}, {lobe} {:.6e}", vector(onward.direction), onward.pdf));
            say(format!("BSDF {}, its part of the pdf {:.4}", vector(onward.value), onward.bsdf_share));
            say(format!("weight {}, survival {:.4}", vector(onward.weight), onward.survival));
        }
    }
    say(format!("contribution {}", vector(vertex.contribution)));
    if let Some(cause) = vertex.cause {
        say(format!("NOT FINITE: {}", cause.name()));
    }
    lines
}
