//! What a guided bounce costs beside an unguided one.
//!
//!     cargo bench --bench guided [SCENE…] [--spp 16] [--turns 7]
//!
//! Paths of equal length (no roulette, six vertices at most, light sampling at each), in turns unguided and guided by a field that
//! is learned first; prints medians of the CPU time per ray. Paths that leave the scene or are absorbed end in both.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use clap::Parser;
use fanal::base::process::cpu_seconds;
use fanal::base::progress::Silent;
use fanal::guiding::sample::field::GuideField;
use fanal::integrators::Roulette;
use fanal::reconstruct::gaussian::Gaussian;
use fanal::render::{Control, GuideMode, RenderSettings, StopRule, learn, render_with_field};
use fanal::scene::Scene;
use fanal::scene::readers::load;

#[derive(Parser)]
struct Options {
    /// Scenes; without any, all of our own that have walls.
    scenes: Vec<PathBuf>,
    /// Samples per pixel of each measurement.
    #[arg(long, default_value_t = 16)]
    spp: u32,
    /// Measurements of each.
    #[arg(long, default_value_t = 7)]
    turns: usize,
    /// Given by cargo.
    #[arg(long, hide = true)]
    bench: bool,
}

fn main() {
    let options = Options::parse();
    let own = ["cornell", "door-ajar", "glass-caustic", "lamp-room"];
    let own = own.map(|name| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/scenes")).join(name));
    let scenes = if options.scenes.is_empty() { &own[..] } else { &options.scenes };
    println!("{:32} {:>14} {:>14} {:>8}", "scene", "unguided ns", "guided ns", "ratio");
    for scene in scenes {
        let loaded = match load(scene) {
            Ok(loaded) => loaded,
            Err(error) => {
                println!("{}: {error}", scene.display());
                continue;
            }
        };
        let built = Scene::build(&loaded, [loaded.file.film.width, loaded.file.film.height]).expect("names resolve");
        let mut settings = RenderSettings::new(GuideMode::Gaussian, StopRule::Spp(64));
        let stop = AtomicBool::new(false);
        let control = Control::new(&Silent, &stop);
        let field = learn(&built, &settings, &Gaussian::default(), &control).expect("the settings are sound");
        settings.transport.roulette = Roulette::Off;
        settings.transport.max_depth = 6;
        settings.stop = StopRule::Spp(options.spp);
        let nanoseconds = |field: GuideField| {
            let begun = cpu_seconds().unwrap_or(f64::NAN);
            let outcome = render_with_field(&built, &settings, field, &control).expect("the settings are sound");
            (cpu_seconds().unwrap_or(f64::NAN) - begun) * 1e9 / outcome.statistics.rays as f64
        };
        let mut times = [Vec::new(), Vec::new()];
        for _ in 0..options.turns {
            times[0].push(nanoseconds(GuideField::empty()));
            times[1].push(nanoseconds(field.clone()));
        }
        let [unguided, guided] = times.map(|mut times| {
            times.sort_by(f64::total_cmp);
            times[times.len() / 2]
        });
        let name = scene.display().to_string();
        let name: String = name.chars().skip(name.chars().count().saturating_sub(32)).collect();
        println!("{name:32} {unguided:14.1} {guided:14.1} {:8.3}", guided / unguided);
    }
}
