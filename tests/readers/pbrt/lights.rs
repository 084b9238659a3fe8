//! Lights and their colours.

use fanal::scene::file::{LightFile, MediumFile};
use fanal::scene::readers::{Missing, load_lacking};
use glam::Vec3;

use super::{close, folder, load_text, picture, quiet, warned, world};

fn luminance([r, g, b]: [f32; 3]) -> f32 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// The colour of the only light.
fn color(light: &LightFile) -> [f32; 3] {
    match light {
        LightFile::Point { intensity: color, .. }
        | LightFile::Spot { intensity: color, .. }
        | LightFile::Directional { irradiance: color, .. }
        | LightFile::Constant { radiance: color } => *color,
        other => panic!("{other:?}"),
    }
}

#[test]
fn points_spots_and_distant_light() {
    let file =
        quiet("Translate 1 0 0 LightSource \"point\" \"rgb I\" [ 1 2 3 ] \"float scale\" 2 \"point3 from\" [ 0 1 0 ]");
    let expected = LightFile::Point { position: [1., 1., 0.], intensity: [2., 4., 6.] };
    assert_eq!(file.lights, [expected]);
    let file = warned("LightSource \"spot\" \"point3 from\" [ 0 0 1 ] \"point3 to\" [ 0 0 -1 ]", "linearly");
    let LightFile::Spot { to_world, cutoff_angle, beam_width, .. } = &file.lights[0] else {
        panic!("{:?}", file.lights)
    };
    assert_eq!(([*cutoff_angle, *beam_width], to_world[10], to_world[11]), ([30.0, 25.0], -1.0, 1.0));
    let file = quiet("Rotate 90 0 1 0 LightSource \"distant\" \"rgb L\" [ 3 2 1 ]");
    let LightFile::Directional { direction, irradiance } = file.lights[0] else { panic!("{:?}", file.lights) };
    assert!(close(direction, [1.0, 0.0, 0.0]) && irradiance == [3., 2., 1.], "{direction:?}");
    let file = warned("LightSource \"goniometric\" \"string filename\" \"sky.exr\" \"rgb I\" [ 2 2 2 ]", "same mean");
    assert!(close(color(&file.lights[0]), [7.0, 3.0, 1.0]), "{:?}", file.lights);
}

/// v4's spectra only say the hue of a light; RGB keeps its luminance.
#[test]
fn hues() {
    for text in [
        "\"blackbody I\" 3000",
        "\"spectrum I\" [ 400 1 500 5 700 9 ]",
        "\"spectrum I\" \"stdillum-A\"",
        "\"spectrum I\" \"sun.spd\"",
    ] {
        let folder = folder();
        std::fs::write(folder.path().join("sun.spd"), "# a spectrum\n400 100\n700 900\n").unwrap();
        let loaded =
            load_text(folder.path(), &format!("WorldBegin LightSource \"point\" {text} \"float scale\" 10")).unwrap();
        let found = color(&loaded.file.lights[0]);
        assert!(
            (luminance(found) - 10.0).abs() < 0.05 && found[0] > found[1] && found[1] > found[2],
            "{text}: {found:?}"
        );
    }
    let white = color(&quiet("LightSource \"point\" \"spectrum I\" \"stdillum-D65\"").lights[0]);
    assert_eq!(white, [1.0; 3]);
    let wide = color(&quiet("ColorSpace \"rec2020\" LightSource \"point\" \"rgb I\" [ 1 1 1 ]").lights[0]);
    assert!(close(wide, [1.0; 3]), "{wide:?}");
    // What is said before the world holds in it.
    let folder = folder();
    let text = "ColorSpace \"rec2020\" Film \"rgb\" WorldBegin LightSource \"point\" \"rgb I\" [ .2 1 .2 ]";
    let before = color(&load_text(folder.path(), text).unwrap().file.lights[0]);
    let green = color(&quiet("ColorSpace \"rec2020\" LightSource \"point\" \"rgb I\" [ .2 1 .2 ]").lights[0]);
    assert!(green[1] > 1.0 && green[0] < 0.2 && green == before, "{green:?} {before:?}");
}

#[test]
fn power_and_illuminance() {
    let pi = std::f32::consts::PI;
    for (text, expected) in [
        ("\"point\" \"float power\" 10", 10.0 / (4.0 * pi)),
        ("\"distant\" \"float illuminance\" 5", 5.0),
        ("\"infinite\" \"float illuminance\" 5", 5.0 / pi),
        ("\"spot\" \"float power\" 10 \"float conedeltaangle\" 0 \"float coneangle\" 60", 10.0 / pi),
    ] {
        let found = color(&world(&format!("LightSource {text}")).file.lights[0]);
        assert!(close(found, [expected; 3]), "{text}: {found:?} {expected}");
    }
    let quad = "Shape \"bilinearmesh\" \"point3 P\" [ 0 0 0 1 0 0 0 1 0 1 1 0 ]";
    for (text, expected) in [
        (format!("AreaLightSource \"diffuse\" \"float power\" 10 Scale 2 1 1 {quad}"), 5.0 / pi),
        (
            "AreaLightSource \"diffuse\" \"float power\" 10 Shape \"sphere\" \"float radius\" 2".to_owned(),
            10.0 / (16.0 * pi * pi),
        ),
        (format!("AreaLightSource \"diffuse\" \"rgb L\" [ 3 3 3 ] \"float scale\" 2 {quad}"), 6.0),
    ] {
        let found = quiet(&text).shapes[0].emission.unwrap();
        assert!(close(found, [expected; 3]), "{text}: {found:?} {expected}");
    }
    let both = warned(
        &format!("AreaLightSource \"diffuse\" \"bool twosided\" true \"float power\" 10 {quad}"),
        "back to back",
    );
    assert!(close(both.shapes[0].emission.unwrap(), [5.0 / pi; 3]), "{:?}", both.shapes);
}

/// A light on both sides is seen from both.
#[test]
fn two_sided_lights() {
    for shape in
        ["Shape \"bilinearmesh\" \"point3 P\" [ -1 -1 0 1 -1 0 -1 1 0 1 1 0 ]", "Shape \"disk\"", "Shape \"sphere\""]
    {
        for side in [3.0, -3.0, 0.5] {
            let folder = folder();
            let frame = "Film \"rgb\" \"integer xresolution\" 1 \"integer yresolution\" 1";
            let camera = format!("LookAt 0 0 {side}  0 0 0  0 1 0 Camera \"perspective\" \"float fov\" 5");
            let text =
                format!("{frame} {camera} WorldBegin AreaLightSource \"diffuse\" \"bool twosided\" true {shape}");
            let seen = picture(&load_text(folder.path(), &text).unwrap(), 1).pixels[0].x;
            // Inside of the sphere there is light that its walls reflect, too.
            assert!(seen >= 0.999, "{shape} from {side}: {seen}");
        }
    }
}

/// Radiance from a direction, as a camera that looks there sees it.
fn seen(light: &str, direction: Vec3, write: impl Fn(&std::path::Path)) -> Vec3 {
    let folder = folder();
    write(folder.path());
    let up = if direction.y.abs() > 0.9 { "0 0 1" } else { "0 1 0" };
    let frame = "Film \"rgb\" \"integer xresolution\" 1 \"integer yresolution\" 1 PixelFilter \"box\"";
    let camera = format!(
        "LookAt 0 0 0  {} {} {}  {up} Camera \"perspective\" \"float fov\" .1",
        direction.x, direction.y, direction.z
    );
    let loaded = load_text(folder.path(), &format!("{frame} {camera} WorldBegin {light}")).unwrap();
    picture(&loaded, 4).pixels[0]
}

const DIRECTIONS: [Vec3; 8] = [
    Vec3::X,
    Vec3::NEG_X,
    Vec3::Y,
    Vec3::NEG_Y,
    Vec3::new(0.6, 0.0, 0.8),
    Vec3::new(0.0, 0.6, -0.8),
    Vec3::new(-0.48, 0.64, 0.6),
    Vec3::new(0.48, -0.6, -0.64),
];

/// v3's pictures: columns along atan2(y, x), rows from +z.
#[test]
fn latitudes_and_longitudes() {
    let write = |folder: &std::path::Path| {
        let sky = |x: usize, y: usize| {
            let (phi, theta) =
                (std::f32::consts::TAU * (x as f32 + 0.5) / 128.0, std::f32::consts::PI * (y as f32 + 0.5) / 64.0);
            (2.0 + theta.sin() * phi.cos(), 2.0 + theta.sin() * phi.sin(), 2.0 + theta.cos())
        };
        exr::prelude::write_rgb_file(folder.join("long.exr"), 128, 64, sky).unwrap();
    };
    for direction in DIRECTIONS {
        let found = seen("LightSource \"infinite\" \"string mapname\" \"long.exr\"", direction, write);
        assert!(found.distance(direction + 2.0) < 0.06, "{direction} {found}");
        let turned =
            seen("Rotate 90 0 1 0 LightSource \"infinite\" \"string filename\" \"long.exr\"", direction, write);
        let own = Vec3::new(-direction.z, direction.y, direction.x);
        assert!(turned.distance(own + 2.0) < 0.06, "{direction} {turned}");
    }
}

/// v4's squares: (0.5, 0.5) is +z, corners are −z, the middle of the right edge's triangle is +x.
#[test]
fn equal_area_squares() {
    let write = |folder: &std::path::Path| {
        let sky = |x: usize, y: usize| {
            let (u, v) = (2.0 * (x as f32 + 0.5) / 64.0 - 1.0, 2.0 * (y as f32 + 0.5) / 64.0 - 1.0);
            let distance = 1.0 - u.abs() - v.abs();
            let r = 1.0 - distance.abs();
            let phi = ((v.abs() - u.abs()) / r.max(1e-9) + 1.0) * std::f32::consts::FRAC_PI_4;
            let out = r * (2.0 - r * r).sqrt();
            let z = (1.0 - r * r).copysign(distance);
            (2.0 + (out * phi.cos()).copysign(u), 2.0 + (out * phi.sin()).copysign(v), 2.0 + z)
        };
        exr::prelude::write_rgb_file(folder.join("square.exr"), 64, 64, sky).unwrap();
    };
    for direction in DIRECTIONS {
        let found = seen("LightSource \"infinite\" \"string filename\" \"square.exr\"", direction, write);
        assert!(found.distance(direction + 2.0) < 0.06, "{direction} {found}");
        let text = "Scale -1 1 1 LightSource \"infinite\" \"string filename\" \"square.exr\" \"float scale\" 3";
        let mirrored = seen(text, direction, write) / 3.0;
        assert!(mirrored.distance(direction * Vec3::new(-1.0, 1.0, 1.0) + 2.0) < 0.06, "{direction} {mirrored}");
    }
    let text = "LightSource \"infinite\" \"string filename\" \"square.exr\" \"float illuminance\" 7";
    // (2 + cos θ)·cos θ over the hemisphere is 2π + 2π/3 in blue; others 2π.
    let found = seen(text, Vec3::X, write);
    let own = 2.0 * std::f32::consts::PI * luminance([1.0, 1.0, 4.0 / 3.0]);
    assert!((found.x - 3.0 * 7.0 / own).abs() < 0.05, "{found} {own}");
}

#[test]
fn several_environments_become_one() {
    let file = quiet(
        "LightSource \"infinite\" \"rgb L\" [ 1 2 3 ] LightSource \"point\" LightSource \"infinite\" \"rgb L\" [ 1 1 1 ]",
    );
    assert_eq!(file.lights.len(), 2);
    assert_eq!(file.lights[0], LightFile::Constant { radiance: [2., 3., 4.] });
    let body = "LightSource \"infinite\" \"rgb L\" [ 1 2 3 ]\nLightSource \"infinite\" \"string filename\" \"sky.exr\"\n\
        LightSource \"infinite\" \"string filename\" \"sky.exr\" LightSource \"point\"";
    let loaded = world(body);
    assert_eq!(loaded.file.lights.len(), 2);
    let LightFile::Envmap { file, scale: 1.0, .. } = &loaded.file.lights[0] else { panic!("{:?}", loaded.file.lights) };
    assert_eq!(loaded.images[file].to_image().pixels[9], Vec3::new(1.0 + 1.0, 1.0 + 2.0, 0.5 + 3.0));
    assert!(loaded.warnings.iter().any(|warning| warning.contains("only the first")), "{:?}", loaded.warnings);
}

#[test]
fn missing_pictures() {
    let folder = folder();
    let text = "WorldBegin\nLightSource \"infinite\" \"string filename\" \"lost.exr\" \"float scale\" 2";
    let error = load_text(folder.path(), text).unwrap_err().to_string();
    assert!(error.contains("lost.exr") && error.contains("tested.pbrt:2"), "{error}");
    let loaded = load_lacking(&folder.path().join("tested.pbrt"), &[], Missing::Skip).unwrap();
    assert_eq!(loaded.file.lights, [LightFile::Constant { radiance: [1.0; 3] }]);
}

#[test]
fn media() {
    let body = "MakeNamedMedium \"fog\" \"string type\" \"homogeneous\" \"rgb sigma_a\" [ 1 1 1 ] \"rgb sigma_s\" [ 3 3 1 ] \"float scale\" 2 \"float g\" .5\n\
        AttributeBegin MediumInterface \"fog\" \"\" Material \"interface\" Shape \"sphere\" AttributeEnd\n\
        AttributeBegin MediumInterface \"fog\" \"fog\" Shape \"disk\" AttributeEnd";
    let file = quiet(body);
    let expected = MediumFile::Homogeneous { sigma_t: [8., 8., 4.], albedo: [0.75, 0.75, 0.5], g: 0.5 };
    assert_eq!(file.media["fog"], expected);
    assert_eq!((file.shapes[0].interior.as_deref(), file.shapes[0].exterior.as_deref()), (Some("fog"), None));
    assert_eq!(file.shapes[1].interior, None, "the same on both sides is no border");
    let milk = quiet("MakeNamedMedium \"a\" \"string type\" \"homogeneous\" \"string preset\" \"Ketchup\"");
    let MediumFile::Homogeneous { sigma_t, .. } = milk.media["a"] else { panic!("it varies") };
    assert!(close(sigma_t, [0.241, 1.04, 1.48]), "{sigma_t:?}");
    let cloud = "MakeNamedMedium \"c\" \"string type\" \"cloud\" \"float density\" 4 MediumInterface \"c\" \"\" Shape \"sphere\"";
    assert_eq!(warned(cloud, "cloud").shapes[0].interior, None);
    let shining = "Material \"interface\" AreaLightSource \"diffuse\" Shape \"sphere\"";
    assert_eq!(warned(shining, "does not shine").shapes[0].emission, None);
}

/// The picture of an area light: v counts from its bottom, and beyond its edges their pixels go on. Its mean counts for a power.
#[test]
fn lamps_with_pictures() {
    let folder = folder();
    exr::prelude::write_rgb_file(folder.path().join("four.exr"), 2, 2, |x, y| (1.0 + x as f32, 1.0 + y as f32, 3.0f32))
        .unwrap();
    let quad = "Shape \"bilinearmesh\" \"point3 P\" [ -1 -1 0 1 -1 0 -1 1 0 1 1 0 ] \"point2 uv\" [ 0 0 1 0 0 1 1 1 ]";
    let light = "AreaLightSource \"diffuse\" \"string filename\" \"four.exr\" \"float scale\" 2";
    let seen = |[x, y]: [f32; 2], light: &str| {
        let frame = "Film \"rgb\" \"integer xresolution\" 1 \"integer yresolution\" 1 PixelFilter \"box\"";
        let camera = format!("LookAt {x} {y} 3  {x} {y} 0  0 1 0 Camera \"perspective\" \"float fov\" .1");
        let text = format!("{frame} {camera} WorldBegin {light} {quad}");
        let loaded = load_text(folder.path(), &text).unwrap();
        assert!(!loaded.warnings.iter().any(|warning| warning.contains("picture")), "{:?}", loaded.warnings);
        picture(&loaded, 4).pixels[0]
    };
    for (place, expected) in [
        ([-0.5, 0.5], [1.0, 1.0, 3.0]),
        ([0.5, 0.5], [2.0, 1.0, 3.0]),
        ([-0.5, -0.5], [1.0, 2.0, 3.0]),
        ([0.95, -0.95], [2.0, 2.0, 3.0]),
        ([0.0, 0.0], [1.5, 1.5, 3.0]),
    ] {
        let found = seen(place, light);
        assert!(found.distance(2.0 * Vec3::from_array(expected)) < 0.01, "{place:?}: {found}");
    }
    let power = "AreaLightSource \"diffuse\" \"string filename\" \"four.exr\" \"float power\" 10";
    let found = seen([0.0, 0.0], power);
    assert!((luminance(found.to_array()) - 10.0 / (4.0 * std::f32::consts::PI)).abs() < 0.01, "{found}");
    // A black border has no light, and no picture of it.
    let border = format!("WorldBegin Material \"interface\" {light} {quad}");
    let loaded = load_text(folder.path(), &border).unwrap();
    assert_eq!((&loaded.file.shapes[0].emission, &loaded.file.shapes[0].emission_texture), (&None, &None));
}
