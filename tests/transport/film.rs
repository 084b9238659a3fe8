//! What pixels show: the light around them by the filter, the window that is asked for, the layers beside the picture.

use crate::support::{files, scenes};

use std::f64::consts::PI;

use std::sync::atomic::AtomicBool;

use fanal::base::progress::Silent;
use fanal::generate::build::{Builder, diffuse};
use fanal::picture::{Channel, Window};
use fanal::render::{Aov, GuideMode, Outcome, RenderSettings, StopRule, aov, render};
use fanal::scene::Scene;
use fanal::scene::file::FilterFile;
use glam::Vec3;
use scenes::{GUIDES, built, committed, floor, picture, reconstructor, settings};

/// Where the lit part of [`edge`] ends, in columns.
const EDGE: f64 = 4.32;

/// A wall across the view that shines with radiance 1 to the left of [`EDGE`], in 8 columns and 64 rows.
fn edge() -> Scene {
    let mut b = Builder::new("edge", [8, 64]);
    let wall = b.add_material("wall", diffuse([0.0; 3]));
    let right = (EDGE - 4.0) / 4.0;
    b.add_quad("lamp", Vec3::X * (right as f32 - 50.0), [Vec3::X * 50.0, Vec3::Y * 50.0], &wall, Some([1.0; 3]));
    b.look_at(Vec3::Z * 4.0, Vec3::ZERO, Vec3::Y, 2.0 * 0.25f32.atan().to_degrees());
    built(b.finish())
}

/// The filters as defined, up to a factor, within their radius.
fn profile(file: FilterFile, x: f64) -> f64 {
    let t = x.abs() / f64::from(file.radius());
    match file {
        FilterFile::Box { .. } => 1.0,
        FilterFile::Tent { .. } => 1.0 - t,
        FilterFile::Gaussian { .. } => (-0.5 * (x / 0.5).powi(2)).exp() - (-8f64).exp(),
        FilterFile::BlackmanHarris { .. } => {
            let terms = [0.35875, 0.48829, 0.14128, 0.01168];
            terms.iter().enumerate().map(|(k, a)| a * (PI * t * k as f64).cos()).sum()
        }
    }
}

/// A column's value is the part of its filter that is lit. 512 samples per pixel and 64 rows make 32,768 yes or no: |z| above 5.5
/// in any of 32 columns has probability 1e-6.
#[test]
fn an_edge_is_blurred_by_the_filter() {
    let scene = edge();
    let spp = 512;
    for file in [FilterFile::default(), FilterFile::TENT, FilterFile::GAUSSIAN, FilterFile::BLACKMAN_HARRIS] {
        let settings = RenderSettings { filter: file, ..RenderSettings::new(GuideMode::None, StopRule::Spp(spp)) };
        let image = picture(&scene, &settings);
        let radius = f64::from(file.radius());
        let steps = 20_000;
        let at = |i: i32| radius * (2.0 * (f64::from(i) + 0.5) / f64::from(steps) - 1.0);
        let total: f64 = (0..steps).map(|i| profile(file, at(i))).sum();
        for column in 0..8 {
            let centre = column as f64 + 0.5;
            let lit: f64 =
                (0..steps).map(at).filter(|x| centre + x < EDGE).map(|x| profile(file, x)).sum::<f64>() / total;
            let n = f64::from(spp) * 64.0;
            let mean = (0..64).map(|row| f64::from(image.pixels[row * 8 + column].x)).sum::<f64>() / 64.0;
            // The sum above is exact to 1e-4.
            let limit = 5.5 * (lit * (1.0 - lit) / n).sqrt() + 1e-4;
            assert!((mean - lit).abs() < limit, "{file:?}, column {column}: {mean} instead of {lit}");
        }
    }
}

fn rendered(scene: &Scene, settings: &RenderSettings) -> Outcome {
    let reconstructor = reconstructor(settings.guide);
    render(scene, settings, reconstructor.as_ref(), &Silent, &AtomicBool::new(false)).expect("the settings are sound")
}

fn all_channels(scene: &Scene, settings: &RenderSettings) -> Vec<Channel> {
    let settings = RenderSettings { keeps_spread: true, ..settings.clone() };
    aov::channels(scene, &settings, &rendered(scene, &settings), &Aov::ALL).expect("the filter is sound")
}

/// The values of the channels with these names, pixel by pixel.
fn values<const N: usize>(channels: &[Channel], names: [&str; N]) -> Vec<[f32; N]> {
    let of = |name| &channels.iter().find(|c| c.name == name).unwrap_or_else(|| panic!("{name} is missing")).values;
    let columns = names.map(of);
    (0..columns[0].len()).map(|i| columns.map(|column| column[i])).collect()
}

/// A floor of albedo 1/2 in y = 0 whose edge is in the picture: half of what the camera sees is nothing.
#[test]
fn layers_are_those_of_the_first_surface() {
    let mut b = floor([16, 16], 0.5);
    let eye = Vec3::new(0.6, 0.8, 0.0);
    b.look_at(eye, Vec3::new(0.0, 0.0, 0.5), Vec3::Y, 20.0);
    let scene = built(b.finish());
    let channels = all_channels(&scene, &RenderSettings::new(GuideMode::None, StopRule::Spp(32)));
    let normals = values(&channels, ["normal.X", "normal.Y", "normal.Z"]);
    let places = values(&channels, ["position.X", "position.Y", "position.Z"]);
    let albedos = values(&channels, ["albedo.R", "albedo.G", "albedo.B"]);
    let depths = values(&channels, ["depth.Z"]);
    let [mut hit, mut missed] = [0, 0];
    for (i, &[depth]) in depths.iter().enumerate() {
        // The part of the samples that hit the floor.
        let cover = albedos[i][0] * 2.0;
        assert_eq!(albedos[i], [albedos[i][0]; 3]);
        assert_eq!((cover * 16.0).fract(), 0.0);
        assert!((normals[i][1] - cover).abs() < 1e-5 && normals[i][0] == 0.0 && normals[i][2] == 0.0);
        if cover == 0.0 {
            missed += 1;
            assert_eq!((depth, places[i]), (0.0, [0.0; 3]));
        } else {
            hit += 1;
            let place = Vec3::from(places[i]);
            assert!(place.y.abs() < 1e-6 && place.z < 0.5 + 1e-5, "{place}");
            // A mean of distances is at least the distance of the mean, and hardly more within a pixel.
            let distance = place.distance(eye);
            assert!(depth > distance - 1e-5 && depth < distance * 1.001, "{depth} {distance}");
        }
    }
    assert!(hit > 80 && missed > 80, "{hit} {missed}");
    assert!(values(&channels, ["samples.Y"]).iter().all(|&[n]| n == 32.0));
    assert!(values(&channels, ["guiding.Y"]).iter().all(|&[p]| p == 0.0));
}

/// Layers are the same for any number of threads, and the picture is the same without them.
#[test]
fn layers_change_nothing_and_threads_no_layer() {
    let scene = committed("door-ajar", [32, 24]);
    let settings = settings(GUIDES[5], 64, 1);
    let by = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a few threads can be had");
        pool.install(|| all_channels(&scene, &settings))
    };
    let channels = by(1);
    let bits = |channels: &[Channel]| -> Vec<u32> {
        channels.iter().flat_map(|channel| channel.values.iter().map(|v| v.to_bits())).collect()
    };
    assert!(bits(&channels) == bits(&by(3)));
    let guided = values(&channels, ["guiding.Y"]);
    assert!(guided.iter().all(|[p]| (0.0..1.0).contains(p)));
    assert!(guided.iter().filter(|[p]| *p > 0.1).count() > 100, "the guide is at work");
    let keeping = RenderSettings { keeps_spread: true, ..settings.clone() };
    assert!(rendered(&scene, &settings).spread.is_none());
    assert!(rendered(&scene, &settings).image == rendered(&scene, &keeping).image);
}

/// The mean variance that pictures of 64 seeds claim is that which they have among each other. Each of 3 × 768 values has a
/// relative error of 18 % or, by rare bright samples, of a few times that; 10 % of the sum is many times its error.
#[test]
fn the_variance_layer_is_the_variance_of_pictures() {
    let scene = committed("cornell", [32, 24]);
    let n = 64;
    let (mut claimed, mut sums, mut squares) = (0.0, vec![[0.0f64; 3]; 768], 0.0);
    for seed in 0..n {
        let mut settings = RenderSettings::new(GuideMode::None, StopRule::Spp(8));
        (settings.seed, settings.keeps_spread, settings.transport.max_depth) = (seed, true, 4);
        let outcome = rendered(&scene, &settings);
        let spread = outcome.spread.expect("it was asked for");
        for (i, (pixel, variance)) in outcome.image.pixels.iter().zip(&spread.variance).enumerate() {
            for c in 0..3 {
                claimed += f64::from(variance[c]) / n as f64;
                sums[i][c] += f64::from(pixel[c]);
                squares += f64::from(pixel[c]).powi(2);
            }
        }
    }
    let means: f64 = sums.iter().flatten().map(|sum| sum * sum / n as f64).sum();
    let measured = (squares - means) / (n - 1) as f64;
    assert!((claimed / measured - 1.0).abs() < 0.1, "{claimed} claimed, {measured} measured");
}

/// A window's pixels, and layers, have the bits that they have in the whole picture; its rows are visited in another order, and it
/// begins and ends inside tiles. Wide filters look over its edge.
#[test]
fn a_window_is_a_part_of_the_whole_picture() {
    let scene = committed("glass-caustic", [40, 30]);
    let whole =
        RenderSettings { filter: FilterFile::GAUSSIAN, ..RenderSettings::new(GuideMode::None, StopRule::Spp(6)) };
    let window = Window { x: 9, y: 5, width: 23, height: 19 };
    let part = RenderSettings { crop: Some(window), ..whole.clone() };
    let [all, some] = [&whole, &part].map(|settings| picture(&scene, settings));
    assert_eq!((some.width, some.height), (23, 19));
    assert!(window.cut(&all).expect("it is inside") == some);
    assert!(some.pixels.iter().any(|p| p.element_sum() > 0.0));
    // How much variance a pixel has is told by its whole tile, and tiles begin at the window's corner.
    let kept = |channel: &&Channel| !channel.name.starts_with("variance");
    let [whole_layers, part_layers] = [&whole, &part].map(|settings| all_channels(&scene, settings));
    for (whole, part) in whole_layers.iter().zip(&part_layers).filter(|(whole, _)| kept(whole)) {
        let cut: Vec<f32> = (0..window.pixels())
            .map(|i| window.place(i).map(|n| n as usize))
            .map(|[column, row]| whole.values[row * 40 + column])
            .collect();
        assert!(cut == part.values, "{}", part.name);
    }
    for outside in [Window { x: 20, ..window }, Window { width: 0, ..window }] {
        let settings = RenderSettings { crop: Some(outside), ..whole.clone() };
        let reconstructor = reconstructor(GuideMode::None);
        let result = render(&scene, &settings, reconstructor.as_ref(), &Silent, &AtomicBool::new(false));
        assert!(result.is_err_and(|e| e.to_string().contains("40x30")));
    }
}

/// Guides learn from the window alone, for any number of threads alike.
#[test]
fn windows_are_guided() {
    let scene = committed("door-ajar", [64, 48]);
    let window = Window { x: 20, y: 10, width: 17, height: 13 };
    for guide in [GUIDES[5], GUIDES[6]] {
        let settings = RenderSettings { crop: Some(window), ..settings(guide, 48, 1) };
        let by = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a few threads can be had");
            pool.install(|| rendered(&scene, &settings))
        };
        let (one, three) = (by(1), by(3));
        assert!(one.image == three.image, "{guide:?}");
        assert_eq!((one.statistics.width, one.statistics.height), (17, 13));
        assert!(one.statistics.guide.trees > 0, "{guide:?}");
    }
}

/// A wall that a lamp in front of it lights, and a sky on one side of it, as an orthographic camera at this height sees them from above.
fn lamp_and_wall(height: f32, hides: bool) -> Scene {
    let text = format!(
        "<scene version='3.0.0'>
            <integrator type='path'><integer name='max_depth' value='3'/><boolean name='hide_emitters' value='{hides}'/></integrator>
            <sensor type='orthographic'>
                <transform name='to_world'><lookat origin='0, 0, {height}' target='0, 0, 0' up='0, 1, 0'/></transform>
                <film type='hdrfilm'><integer name='width' value='12'/><integer name='height' value='12'/><rfilter type='box'/></film>
            </sensor>
            <shape type='rectangle'><transform name='to_world'><translate x='-0.6666667'/></transform><bsdf type='diffuse'/></shape>
            <shape type='sphere'><point name='center' x='-0.2' y='0' z='1'/><float name='radius' value='0.3'/>
                <emitter type='area'><rgb name='radiance' value='7, 5, 3'/></emitter></shape>
            <emitter type='constant'><rgb name='radiance' value='0.5'/></emitter>
        </scene>"
    );
    let folder = files::folder();
    let loaded = files::load_xml(&folder, &text).expect("it is sound");
    assert!(!loaded.warnings.iter().any(|warning| warning.contains("hide")), "{:?}", loaded.warnings);
    Scene::build(&loaded, [12, 12]).expect("it builds")
}

/// With hidden lights a camera sees what one in front of them sees that has no sky, and at its own distance.
#[test]
fn hidden_lights_are_looked_through() {
    let settings = RenderSettings { adaptive: false, ..settings(GUIDES[0], 16, 5) };
    let [shown, hidden, nearer] = [(4.0, false), (4.0, true), (0.6, false)].map(|of| lamp_and_wall(of.0, of.1));
    let [shown_picture, hidden_picture, nearer_picture] =
        [&shown, &hidden, &nearer].map(|scene| rendered(scene, &settings).image);
    let depths = [&hidden, &nearer].map(|scene| values(&all_channels(scene, &settings), ["depth.Z"]));
    let (mut lamps, mut skies) = (0, 0);
    for (place, pixel) in hidden_picture.pixels.iter().enumerate() {
        let (before, near) = (shown_picture.pixels[place], nearer_picture.pixels[place]);
        let [[depth], [near_depth]] = [depths[0][place], depths[1][place]];
        if near_depth == 0.0 {
            skies += 1;
            assert_eq!((*pixel, near, depth), (Vec3::ZERO, Vec3::splat(0.5), 0.0), "{place}");
            continue;
        }
        // No radiance that the wall sends back is nearly that of the lamp.
        if before.x > 1.1 * pixel.x {
            lamps += 1;
        } else {
            assert_eq!(before, *pixel, "{place}");
        }
        assert!((depth - near_depth - 3.4).abs() < 1e-3, "{place}: {depth} and {near_depth}");
        assert!((*pixel - near).abs().max_element() <= 2e-3 * near.max_element(), "{place}: {pixel} and {near}");
    }
    assert!(lamps > 4 && skies > 20, "{lamps} pixels of the lamp, {skies} of the sky");
}
