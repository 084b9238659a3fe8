//! Lights with pictures of Mitsuba's and pbrt's scenes: each place is lit by the pixel that the formats' definitions say.

use std::f32::consts::PI;

use fanal::base::Error;
use fanal::lights::seen::LightView;
use fanal::scene::Scene;
use fanal::scene::file::{LightFile, ProfileFile, TextureFile};
use fanal::scene::readers::{LoadedScene, Missing, load, load_lacking};
use glam::{Vec2, Vec3};
use tempfile::TempDir;

const SIZE: [usize; 2] = [8, 4];

/// A picture whose pixels hold their column and row.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let pixel = |x, y| (1.0 + x as f32, 1.0 + y as f32, 0.5f32);
    exr::prelude::write_rgb_file(folder.path().join("grid.exr"), SIZE[0], SIZE[1], pixel).unwrap();
    folder
}

fn read(folder: &TempDir, name: &str, text: &str) -> LoadedScene {
    std::fs::write(folder.path().join(name), text).unwrap();
    load(&folder.path().join(name)).unwrap_or_else(|error| panic!("{error}"))
}

fn mitsuba(folder: &TempDir, body: &str) -> LoadedScene {
    read(folder, "scene.xml", &format!("<scene version='3.5.0'><sensor type='perspective'/>{body}</scene>"))
}

/// What arrives at points with these coordinates of the light, whose transform does nothing.
fn arriving(loaded: &LoadedScene, local: Vec3) -> Vec3 {
    let scene = Scene::build(loaded, [4, 4]).unwrap();
    let sample = scene.lights.lights[0].sample(local, [0.5; 2], &LightView::PLAIN);
    sample.map_or(Vec3::ZERO, |sample| sample.radiance)
}

/// The pixel at uv, (0, 0) at the top left; nothing beyond the edges.
fn pixel(uv: Vec2) -> Option<Vec3> {
    let place = uv * Vec2::new(SIZE[0] as f32, SIZE[1] as f32);
    let inside = uv.min_element() >= 0.0 && uv.max_element() <= 1.0;
    inside.then(|| Vec3::new(1.0 + place.x.floor(), 1.0 + place.y.floor(), 0.5))
}

/// Points all over what a light may light, and beyond; none near an edge between pixels of a picture `half` wide and high.
fn points(half: Vec2) -> Vec<Vec3> {
    let at = |i: usize| -1.3 + 2.6 * (i as f32 + 0.5) / 23.0;
    let near_edge =
        |x: f32, count: usize| ((0.5 + 0.5 * x) * count as f32 - ((0.5 + 0.5 * x) * count as f32).round()).abs() < 0.02;
    let grid = (0..23 * 23).map(|i| Vec2::new(at(i % 23), at(i / 23)));
    let clear = grid.filter(|place| !near_edge(place.x, SIZE[0]) && !near_edge(place.y, SIZE[1]));
    clear.map(|place| (place * half).extend(1.0) * 2.5).collect()
}

const GRID: &str = "<string name='filename' value='grid.exr'/><string name='filter_type' value='nearest'/>";

/// Mitsuba's `projector`: the way of its camera, so that x and y run against the picture's columns and rows; π times the picture over
/// z²·cos θ. The angle is for the axis that is said, of a picture twice as wide as high; without any, that of 50 mm.
#[test]
fn mitsuba_projects_as_its_camera_sees() {
    let folder = folder();
    let diagonal = (20f32.to_radians().tan() / 1.25f32.sqrt()).atan().to_degrees() * 2.0;
    let film = 2.0 * (36f32.hypot(24.0) / 100.0 / 1.25f32.sqrt()).atan().to_degrees();
    for (angle, degrees) in [
        ("<float name='fov' value='40'/>", 40.0),
        ("<float name='fov' value='40'/><string name='fov_axis' value='larger'/>", 40.0),
        (
            "<float name='fov' value='40'/><string name='fov_axis' value='y'/>",
            2.0 * (2.0 * 20f32.to_radians().tan()).atan().to_degrees(),
        ),
        ("<float name='fov' value='40'/><string name='fov_axis' value='diagonal'/>", diagonal),
        ("", film),
    ] {
        let loaded = mitsuba(
            &folder,
            &format!(
                "<emitter type='projector'><float name='scale' value='3'/>{angle}
            <texture type='bitmap' name='irradiance'>{GRID}</texture></emitter>"
            ),
        );
        let half = Vec2::new(1.0, 0.5) * (0.5 * degrees.to_radians()).tan();
        for point in points(half) {
            let uv = 0.5 - 0.5 * point.truncate() / (point.z * half);
            let cos = point.z / point.length();
            let expected = pixel(uv).unwrap_or_default() * (3.0 * PI / (point.z * point.z * cos));
            let found = arriving(&loaded, point);
            assert!(found.distance(expected) <= 1e-4 * expected.length(), "{angle} {point}: {found} {expected}");
        }
    }
}

/// Without a picture a projector lights a square, and a scaled one is brighter in proportion, as in Mitsuba.
#[test]
fn mitsuba_projects_a_plain_colour() {
    let folder = folder();
    let body = "<emitter type='projector'><float name='fov' value='90'/><rgb name='irradiance' value='1 2 3'/>
        <transform name='to_world'><scale value='2'/></transform></emitter>";
    let loaded = mitsuba(&folder, body);
    let found = arriving(&loaded, Vec3::new(0.98, -0.98, 1.0));
    let expected = Vec3::new(1.0, 2.0, 3.0) * (2.0 * PI * (1.0f32 + 2.0 * 0.98 * 0.98).sqrt());
    assert!(found.distance(expected) < 1e-4 * expected.length(), "{found} {expected}");
    assert_eq!(arriving(&loaded, Vec3::new(1.02, 0.0, 1.0)), Vec3::ZERO);
}

/// Mitsuba's `spot` with a texture: u and v grow along x and y, and 1 is where the cutoff is; the fall-off is that of any spot.
#[test]
fn mitsuba_spots_have_a_texture() {
    let folder = folder();
    for version in ["3.5.0", "0.6.0"] {
        let text = format!("<scene version='{version}'><sensor type='perspective'/><emitter type='spot'><rgb name='intensity' value='2 2 2'/>
            <float name='cutoff_angle' value='40'/><float name='beam_width' value='10'/><texture type='bitmap' name='texture'>{GRID}</texture>
            </emitter></scene>");
        let text = if version < "1" {
            text.replace("cutoff_angle", "cutoffAngle")
                .replace("beam_width", "beamWidth")
                .replace("filter_type", "filterType")
        } else {
            text
        };
        let loaded = read(&folder, "scene.xml", &text);
        let half = Vec2::splat(40f32.to_radians().tan());
        for point in points(half) {
            let angle = point.truncate().length().atan2(point.z).to_degrees();
            let falloff = if angle <= 10.0 { 1.0 } else { ((40.0 - angle) / 30.0).max(0.0) };
            let uv = 0.5 + 0.5 * point.truncate() / (point.z * half);
            let expected = pixel(uv).unwrap_or_default() * (2.0 * falloff / point.length_squared());
            let found = arriving(&loaded, point);
            assert!(
                found.distance(expected) <= 1e-4 * expected.length() + 1e-6,
                "{version} {point}: {found} {expected}"
            );
        }
    }
    let wide = mitsuba(
        &folder,
        &format!(
            "<emitter type='spot'><float name='cutoff_angle' value='120'/><texture type='bitmap' name='texture'>{GRID}</texture></emitter>"
        ),
    );
    assert!(
        matches!(wide.file.lights[0], LightFile::Spot { intensity: [4.5, 2.5, 0.5], .. }),
        "{:?}",
        wide.file.lights
    );
    assert!(wide.warnings.iter().any(|warning| warning.contains("this wide")), "{:?}", wide.warnings);
}

/// pbrt's `projection`: the angle is that of the shorter side; x runs along the picture's columns, y against its rows in v4 and along
/// them in v3. The intensity is the picture's; a power is that of its luminance.
#[test]
fn pbrt_projects_too() {
    let folder = folder();
    let half = Vec2::new(2.0, 1.0) * 25f32.to_radians().tan();
    for (film, upright) in [("rgb", true), ("image", false)] {
        let text = format!(
            "Film \"{film}\" WorldBegin LightSource \"projection\" \"string filename\" \"grid.exr\" \"float fov\" 50 \"float scale\" 3"
        );
        let loaded = read(&folder, "scene.pbrt", &text);
        for point in points(half) {
            let place = 0.5 * point.truncate() / (point.z * half);
            let uv = 0.5 + if upright { place * Vec2::new(1.0, -1.0) } else { place };
            let found = arriving(&loaded, point) * point.length_squared() / 3.0;
            match pixel(uv) {
                None => assert_eq!(found, Vec3::ZERO),
                Some(expected) if upright => assert!(found.distance(expected) < 1e-3, "{point}: {found} {expected}"),
                // Bilinear in v3.
                Some(expected) => assert!((found - expected).abs().max_element() < 0.51, "{point}: {found} {expected}"),
            }
        }
    }
    let text =
        "WorldBegin LightSource \"projection\" \"string filename\" \"grid.exr\" \"float fov\" 50 \"float power\" 7";
    let scene = Scene::build(&read(&folder, "scene.pbrt", text), [4, 4]).unwrap();
    let power = scene.lights.lights[0].power(&scene.bounds).dot(Vec3::new(0.212671, 0.715160, 0.072169));
    assert!((power - 7.0).abs() < 0.07, "{power}");
}

/// What no picture can be projected by is refused where it is written, and a missing picture is grey.
#[test]
fn wrong_projectors_are_errors() {
    let folder = folder();
    let json = |light: &str| {
        let text = format!(
            r#"{{"version": 1, "camera": {{"to_world": [1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1], "fov": 40}}, "film": {{"width": 1, "height": 1}},
            "lights": [{{"type": "projector", "to_world": [1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1], "intensity": [1,1,1], {light}}}]}}"#
        );
        std::fs::write(folder.path().join("scene.json"), text).unwrap();
        load(&folder.path().join("scene.json"))
    };
    let white = r#""texture": {"type": "rgb", "value": [1,1,1]}"#;
    let good = json(&format!(r#""fov": 40, "profile": {{"type": "cone", "beam_width": 12}}, {white}"#)).unwrap();
    let [LightFile::Projector { aspect: 1.0, profile: ProfileFile::Cone { beam_width: 12.0 }, .. }] =
        good.file.lights[..]
    else {
        panic!("{:?}", good.file.lights)
    };
    for (light, part) in [
        (r#""fov": 180, "#, "between 0° and 180°"),
        (r#""fov": -1e38, "#, "fov"),
        (r#""fov": 40, "aspect": 0, "#, "aspect"),
        (r#""fov": 40, "profile": {"type": "cone", "beam_width": 21}, "#, "beam_width"),
        (r#""fov": 40, "profile": {"type": "round"}, "#, "round"),
        (r#""fov": 40, "profile": {"type": "plane", "beam_width": 3}, "#, "unknown field `beam_width`"),
    ] {
        let error = json(&format!("{light}{white}")).unwrap_err();
        assert!(matches!(error, Error::Malformed { .. }) && error.to_string().contains(part), "{error}");
    }
    let another = format!(
        r#""fov": 40, {white}}}, {{"type": "projector", "to_world": [1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1], "intensity": [1,1,1], "#
    );
    let many = json(&format!("{}\"fov\": 40, {white}", another.repeat(256))).unwrap_err();
    assert!(matches!(many, Error::Limit { value: 257, limit: 256, .. }), "{many}");
    let bare = json(r#""fov": 40, "texture": {"type": "attribute", "name": "vertex_color"}"#).unwrap_err().to_string();
    assert!(bare.contains("no mesh"), "{bare}");
    std::fs::write(
        folder.path().join("lost.xml"),
        "<scene version='3.5.0'><sensor type='perspective'/>\n<emitter type='projector'><texture type='bitmap' name='irradiance'>
        <string name='filename' value='lost.exr'/></texture></emitter></scene>",
    )
    .unwrap();
    let lost = load(&folder.path().join("lost.xml")).unwrap_err();
    assert!(matches!(lost, Error::Missing { .. }) && lost.to_string().contains("lost.xml:2"), "{lost}");
    let grey = load_lacking(&folder.path().join("lost.xml"), &[], Missing::Skip).unwrap();
    assert_eq!(grey.file.lights[0].texture(), Some(&TextureFile::rgb([0.5; 3])));
    for fov in ["0", "180", "1e300", "-4"] {
        std::fs::write(
            folder.path().join("a.pbrt"),
            format!("WorldBegin\nLightSource \"projection\" \"float fov\" {fov}"),
        )
        .unwrap();
        let error = load(&folder.path().join("a.pbrt")).unwrap_err().to_string();
        assert!(error.contains("a.pbrt:2"), "{error}");
    }
}
