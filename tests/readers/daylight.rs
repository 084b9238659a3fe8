//! Sun and sky: the model's radiance, what a map of it loses, and what scenes of both Mitsuba's versions say.

use std::path::Path;

use fanal::base::Error;
use fanal::lights::Light;
use fanal::lights::envmap::Envmap;
use fanal::lights::sky::{Atmosphere, Sky};
use fanal::picture::read_image;
use fanal::scene::Scene;
use fanal::scene::file::LightFile;
use fanal::scene::readers::{LoadedScene, load, save};
use glam::{DVec3, Vec3};
use tempfile::TempDir;

/// Solid angle of the models' sun, sr.
fn solid_angle() -> f64 {
    4.0 * std::f64::consts::PI * (0.5358f64 / 4.0).to_radians().sin().powi(2)
}

fn load_emitter(version: &str, kind: &str, body: &str) -> Result<LoadedScene, Error> {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("tested.xml");
    let text = format!(
        "<scene version=\"{version}\"><sensor type=\"perspective\"/><shape type=\"sphere\"/>\n\
        <emitter type=\"{kind}\">{body}</emitter></scene>"
    );
    std::fs::write(&path, text).unwrap();
    load(&path)
}

fn lights(version: &str, kind: &str, body: &str) -> Vec<LightFile> {
    load_emitter(version, kind, body).unwrap_or_else(|error| panic!("{body}: {error}")).file.lights
}

fn near(a: impl Into<Vec3>, b: impl Into<Vec3>, error: f32) {
    let (a, b) = (a.into(), b.into());
    assert!((a - b).abs().max_element() <= error * b.abs().max_element(), "{a} {b}");
}

const CLEAR: Atmosphere = Atmosphere {
    sun: Vec3::new(0.597_614, -0.358_569, 0.717_137),
    up: Vec3::Z,
    turbidity: 3.0,
    albedo: Vec3::splat(0.3),
    stretch: 1.0,
    extend: false,
};

fn hazy() -> Atmosphere {
    let sun = Vec3::new(-0.9, 0.2, 0.15).normalize();
    Atmosphere { sun, turbidity: 7.5, albedo: Vec3::new(0.1, 0.5, 0.9), ..CLEAR }
}

/// Radiance that `sunsky` of Mitsuba 3.7.1 has (`scalar_rgb`) towards the zenith, aside, just above the horizon and beside the sun.
#[test]
fn the_sky_is_that_of_mitsuba() {
    let directions = [[0.0, 0.0, 1.0], [0.3, 0.5, 0.4], [-0.6, 0.2, 0.02], [0.52, -0.3, 0.62]];
    let clear = [
        [0.0242035, 0.0421151, 0.0852317],
        [0.0365034, 0.0662039, 0.1252783],
        [0.1653626, 0.2206809, 0.2554458],
        [0.1795998, 0.2039069, 0.2311632],
    ];
    let haze = [
        [0.0134731, 0.0210393, 0.0324927],
        [0.0301012, 0.0431742, 0.0544607],
        [1.2555755, 0.7696153, 0.2855595],
        [0.0233797, 0.0351871, 0.0474719],
    ];
    for (air, expected) in [(CLEAR, clear), (hazy(), haze)] {
        let sky = Sky::new(&air).expect("within the model");
        for (direction, radiance) in directions.into_iter().zip(expected) {
            near(sky.radiance(DVec3::from_array(direction).normalize()), radiance, 1e-4);
        }
    }
    assert!(Sky::new(&Atmosphere { turbidity: 11.0, ..CLEAR }).is_none());
}

/// The map's mean error over all directions is below 5e-4 of the mean radiance, that of the irradiance on flat ground below 2e-4 of
/// it, by a grid of 400 × 1600 directions; nothing shines from below the horizon, and the horizon itself keeps its light. A map whose
/// rows ended beside the horizon would lose or add half a row of its light, 2e-3.
#[test]
fn the_map_keeps_the_skys_light() {
    let low = Vec3::new(1.0, 0.3, 0.02).normalize();
    for air in [CLEAR, hazy(), Atmosphere { sun: low, up: Vec3::Z, ..CLEAR }, Atmosphere { up: Vec3::X, ..CLEAR }] {
        let sky = Sky::new(&air).expect("within the model");
        let map: Envmap = sky.envmap(2.0);
        let (up, (side, across)) = (air.up.as_dvec3(), air.up.as_dvec3().any_orthonormal_pair());
        let (rows, columns) = (400, 1600);
        let (mut off, mut sum, mut lit, mut irradiance) = (0.0, 0.0, DVec3::ZERO, DVec3::ZERO);
        for i in 0..rows * columns {
            let cos = (f64::from(i / columns) + 0.5) / f64::from(rows);
            let (sin, phi) =
                ((1.0 - cos * cos).sqrt(), f64::from(i % columns) / f64::from(columns) * std::f64::consts::TAU);
            let direction = up * cos + (side * phi.cos() + across * phi.sin()) * sin;
            let (exact, found) =
                (2.0 * sky.radiance(direction).as_dvec3(), map.radiance(direction.as_vec3()).as_dvec3());
            off += (exact - found).abs().element_sum();
            sum += exact.element_sum();
            irradiance += exact * cos;
            lit += found * cos;
        }
        assert!(off / sum < 5e-4, "{air:?}: {}", off / sum);
        let change = (lit / irradiance - 1.0).abs().max_element();
        assert!(change < 2e-4, "{air:?}: irradiance {change}");
        for phi in [0.1f64, 2.0, 4.5] {
            let at = |cos: f64| up * cos + (side * phi.cos() + across * phi.sin()) * (1.0 - cos * cos).sqrt();
            assert_eq!(map.radiance(at(-1e-5).as_vec3()), Vec3::ZERO);
            near(map.radiance(at(1e-5).as_vec3()), 2.0 * sky.radiance(at(1e-9)), 2e-2);
        }
    }
}

/// `stretch` 2 draws the horizon down to the nadir; `extend` lets its light fade out below.
#[test]
fn skies_below_the_horizon() {
    let at = |angle: f64| {
        DVec3::new(0.6 * angle.to_radians().sin(), 0.8 * angle.to_radians().sin(), angle.to_radians().cos())
    };
    let sky = |air: Atmosphere| Sky::new(&air).expect("within the model");
    let (plain, stretched) = (sky(CLEAR), sky(Atmosphere { stretch: 1.5, ..CLEAR }));
    let extended = sky(Atmosphere { extend: true, ..CLEAR });
    for angle in [0.0, 30.0, 60.0, 89.0] {
        near(stretched.radiance(at(1.5 * angle)), plain.radiance(at(angle)), 1e-5);
        near(extended.radiance(at(angle)), plain.radiance(at(angle)), 1e-5);
    }
    assert_eq!((plain.radiance(at(91.0)), stretched.radiance(at(136.0))), (Vec3::ZERO, Vec3::ZERO));
    // Half way down the smooth step is at its middle.
    near(extended.radiance(at(135.0)), 0.5 * plain.radiance(at(89.994)), 1e-2);
    near(stretched.envmap(1.0).radiance(at(134.0).as_vec3()), stretched.radiance(at(134.0)), 2e-2);
    near(extended.envmap(1.0).radiance(at(120.0).as_vec3()), extended.radiance(at(120.0)), 2e-2);
}

/// One sun in the frames of both versions, by its direction and by date and place: Tokyo, 2010-07-10, 15:00, where Mitsuba 3.7.1 has the
/// sun 43.92074° from the zenith at an azimuth of 265.75233°, in its mirrored frame.
#[test]
fn frames_of_both_versions() {
    let (zenith, azimuth) = (43.920_74_f32.to_radians(), 265.752_33_f32.to_radians());
    let ((sin, cos), (east, north)) = (zenith.sin_cos(), azimuth.sin_cos());
    let old = Vec3::new(sin * east, cos, -sin * north);
    let new = Vec3::new(-sin * north, -sin * east, cos);
    let turn = "<transform name='to_world'><rotate x='1' angle='90'/></transform>";
    let turned = |v: Vec3| Vec3::new(v.x, -v.z, v.y);
    for (version, body, sun, up) in [
        ("0.6.0", "", old, Vec3::Y),
        ("3.0.0", "", new, Vec3::Z),
        ("0.6.0", turn, turned(old), Vec3::Z),
        ("3.0.0", turn, turned(new), Vec3::NEG_Y),
    ] {
        let lights = lights(version, "sunsky", body);
        let [LightFile::Sky { sun: towards, up: upwards, .. }, LightFile::Sun { direction, .. }] = lights.as_slice()
        else {
            panic!("{lights:?}");
        };
        near(*towards, sun, 1e-5);
        near(*upwards, up, 1e-6);
        near(*direction, -sun, 1e-5);
        // Given as a direction in the world, whatever the frame.
        let given = format!("{body}<vector name='sun_direction' x='{}' y='{}' z='{}'/>", sun.x, sun.y, sun.z);
        let [again, ..] =
            self::lights(version, "sunsky", &given).try_into().unwrap_or([lights[0].clone(), lights[1].clone()]);
        assert!(matches!((&again, &lights[0]), (LightFile::Sky { .. }, LightFile::Sky { .. })));
        let LightFile::Sky { sun: again, .. } = again else { panic!() };
        near(again, sun, 1e-5);
    }
}

fn irradiance(light: &LightFile) -> Vec3 {
    match light {
        LightFile::Sun { irradiance, .. } | LightFile::Directional { irradiance, .. } => Vec3::from_array(*irradiance),
        other => panic!("{other:?}"),
    }
}

/// However large the disk is made, radiance times solid angle stays; scales, the sun left out, the sky left out. 0.6 has another sun:
/// at 45° and turbidity 3, 19125, 15726 and 12705 W·m⁻²·sr⁻¹·nm⁻¹ (Preetham et al. 1999), 3.7 the one of 2013.
#[test]
fn suns_keep_their_power() {
    let high = "<vector name='sun_direction' x='1' y='1' z='0'/>";
    let upright = "<vector name='sun_direction' x='1' y='0' z='1'/>";
    let old = Vec3::new(19125.0, 15726.0, 12705.0) * solid_angle() as f32;
    for (scale, wide) in [("0", false), ("0.1", false), ("1", true), ("18.8131", true)] {
        let body = format!("{high}<float name='sunRadiusScale' value='{scale}'/><float name='sunScale' value='10'/>");
        let all = lights("0.6.0", "sunsky", &body);
        let half = (0.5 * 0.5358 * scale.parse::<f32>().unwrap()).to_radians();
        let mean_cosine = if wide { 0.5 * (1.0 + half.cos()) } else { 1.0 };
        assert!(matches!(all[0], LightFile::Sky { scale: 1.0, .. }));
        assert_eq!(matches!(all[1], LightFile::Sun { .. }), wide);
        near(irradiance(&all[1]), old * 10.0 * mean_cosine, 2e-3);
    }
    let plain = irradiance(&lights("3.0.0", "sunsky", upright)[1]);
    let wide = lights("3.0.0", "sunsky", &format!("{upright}<float name='sun_aperture' value='20'/>"));
    near(irradiance(&wide[1]), plain * 0.5 * (1.0 + 10f32.to_radians().cos()), 1e-4);
    assert!(matches!(wide[1], LightFile::Sun { angle: 20.0, .. }));
    let kinds = |version: &str, kind: &str, body: &str| -> Vec<&str> {
        let name = |light: &LightFile| match light {
            LightFile::Sky { .. } => "sky",
            LightFile::Sun { .. } => "sun",
            _ => "other",
        };
        lights(version, kind, body).iter().map(name).collect()
    };
    assert_eq!(kinds("0.6.0", "sky", high), ["sky"]);
    assert_eq!(kinds("0.6.0", "sun", high), ["sun"]);
    assert_eq!(kinds("3.0.0", "sunsky", "<float name='sun_scale' value='0'/>"), ["sky"]);
    assert_eq!(kinds("3.0.0", "sunsky", "<float name='sky_scale' value='0'/>"), ["sun"]);
    assert!(matches!(lights("0.6.0", "sky", "<float name='scale' value='3'/>")[0], LightFile::Sky { scale: 3.0, .. }));
    // A sun drawn down with its sky stands lower, as bright as before.
    let stretched = lights("0.6.0", "sunsky", &format!("{high}<float name='stretch' value='1.5'/>"));
    let LightFile::Sun { direction, .. } = stretched[1] else { panic!("{stretched:?}") };
    near(direction, [-(67.5f32.to_radians().sin()), -(67.5f32.to_radians().cos()), 0.0], 1e-5);
    near(irradiance(&stretched[1]), old, 2e-3);
}

/// A scene whose sky is read from XML, saved as JSON and read again is the same.
#[test]
fn skies_in_json() {
    let loaded = load_emitter("0.6.0", "sunsky", "<boolean name='extend' value='true'/>").unwrap();
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("scene.json");
    save(&loaded.file, &path).unwrap();
    assert_eq!(load(&path).unwrap().file, loaded.file);
    let good = std::fs::read_to_string(&path).unwrap();
    let edited = |change: &dyn Fn(&mut serde_json::Value)| {
        let mut value: serde_json::Value = serde_json::from_str(&good).unwrap();
        change(&mut value["lights"]);
        std::fs::write(&path, value.to_string()).unwrap();
        load(&path).expect_err("refused").to_string()
    };
    type Change<'a> = &'a dyn Fn(&mut serde_json::Value);
    let changes: [(&str, Change); 6] = [
        ("lights[0].turbidity", &|lights| lights[0]["turbidity"] = 0.9.into()),
        ("lights[0].stretch", &|lights| lights[0]["stretch"] = 2.5.into()),
        ("lights[0].albedo", &|lights| lights[0]["albedo"] = vec![0.1, 1.1, 0.1].into()),
        ("below the horizon", &|lights| lights[0]["sun"] = vec![1.0, -0.1, 0.0].into()),
        ("lights[0].up", &|lights| lights[0]["up"] = vec![0.0, 0.0, 0.0].into()),
        ("lights[1].angle", &|lights| lights[1]["angle"] = 0.01.into()),
    ];
    for (place, change) in changes {
        let message = edited(change);
        assert!(message.contains(place), "{message}");
    }
}

/// What Mitsuba refuses is refused with its line, what it warns of is a warning.
#[test]
fn wrong_skies_are_refused() {
    for (version, kind, body, why) in [
        ("0.6.0", "sunsky", "<float name='turbidity' value='0.5'/>", "turbidity is 0.5"),
        ("3.0.0", "sunsky", "<float name='turbidity' value='10.5'/>", "expected a number from 1 to 10"),
        ("0.6.0", "sky", "<rgb name='albedo' value='0.1, 2, 0.1'/>", "albedo"),
        ("0.6.0", "sky", "<float name='stretch' value='3'/>", "stretch"),
        ("0.6.0", "sky", "<float name='hour' value='23'/>", "below the horizon"),
        ("3.0.0", "sunsky", "<integer name='month' value='13'/>", "month is 13"),
        ("3.0.0", "sunsky", "<integer name='year' value='9223372036854775807'/>", "year"),
        ("3.0.0", "sunsky", "<vector name='sun_direction' z='0'/>", "sun_direction is zero"),
        ("3.0.0", "sunsky", "<vector name='sun_direction' z='1'/><float name='hour' value='9'/>", "exclude"),
        ("0.6.0", "sunsky", "<vector name='sunDirection' y='1'/><float name='latitude' value='9'/>", "exclude"),
        ("0.6.0", "sunsky", "<float name='sunRadiusScale' value='400'/>", "the sun fills"),
        ("0.6.0", "sunsky", "<float name='sunScale' value='-1'/>", "irradiance"),
        ("3.0.0", "sunsky", "<float name='sky_scale' value='-1'/>", "scale"),
        ("3.0.0", "sunsky", "<transform name='to_world'><scale x='0'/></transform>", "flattens"),
    ] {
        let message = load_emitter(version, kind, body).expect_err(body).to_string();
        assert!(message.contains("tested.xml:2: ") && message.contains(why), "{body}: {message}");
    }
    for (version, body, why) in [
        ("3.0.0", "<float name='hour' value='23'/>", "below the horizon"),
        ("3.0.0", "<boolean name='complex_sun' value='true'/>", "complex_sun"),
        ("3.0.0", "<float name='stretch' value='2'/>", "\"stretch\" of the emitter \"sunsky\" is not used"),
        ("0.6.0", "<vector name='sunDirection' y='1'/><float name='hour' value='9'/>", "hour is left out"),
    ] {
        let loaded = load_emitter(version, "sunsky", body).unwrap_or_else(|error| panic!("{error}"));
        assert!(loaded.warnings.iter().any(|warning| warning.contains(why)), "{:?}", loaded.warnings);
    }
}

/// Real parameters against a map that Mitsuba 3.7 made of them (ground albedo 0.3, the sun of 2013, in pixels): radiance of the sky
/// away from the sun within 0.1 %, power of the sun within 1 %.
#[test]
fn shared_classroom() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/scenes/classroom");
    if !folder.is_dir() {
        return;
    }
    let direction = DVec3::new(-0.865804, 0.416766, -0.276929).normalize();
    let turn = "<transform name='to_world'><rotate x='1' angle='-90'/></transform>";
    let body = format!(
        "{turn}<vector name='sun_direction' x='{}' y='{}' z='{}'/><float name='sky_scale' value='6'/>\
        <float name='sun_scale' value='10'/><float name='sun_aperture' value='10.08'/>",
        direction.x, direction.y, direction.z
    );
    let loaded = load_emitter("3.0.0", "sunsky", &body).unwrap();
    let scene = Scene::build(&loaded, [1, 1]).unwrap();
    let [Light::Envmap(sky), sun @ Light::Sun(_)] = scene.lights.lights.as_slice() else { panic!("a sky and a sun") };
    let map = read_image(&folder.join("sunsky.exr"), false).unwrap();
    let (mut off, mut whole, mut power, mut own) = (0.0, 0.0, DVec3::ZERO, DVec3::ZERO);
    for (index, pixel) in map.pixels.iter().enumerate() {
        let theta = ((index / map.width) as f64 + 0.5) / map.height as f64 * std::f64::consts::PI;
        let phi = ((index % map.width) as f64 + 0.5) / map.width as f64 * std::f64::consts::TAU;
        let wi = DVec3::new(theta.sin() * phi.sin(), theta.cos(), -theta.sin() * phi.cos());
        let area = theta.sin() * 2.0 * std::f64::consts::PI.powi(2) / map.pixels.len() as f64;
        let (ours, theirs) = (sky.radiance(wi.as_vec3()).as_dvec3(), pixel.as_dvec3());
        if wi.dot(direction) > 8f64.to_radians().cos() {
            power += (theirs - ours) * area;
            own += sun.background(wi.as_vec3()).as_dvec3() * area;
        } else {
            off += (ours - theirs).abs().element_sum() * area;
            whole += theirs.element_sum() * area;
        }
    }
    println!("sky off by {:.2e}, power of the sun {own} of {power}", off / whole);
    assert!(off / whole < 1e-3, "{}", off / whole);
    assert!((own / power - 1.0).abs().max_element() < 0.01, "{own} {power}");
    // As its exporter left it: the older sun.
    let original = load(&folder.join("original.xml")).unwrap_or_else(|error| panic!("{error}"));
    println!("{:?}", original.file.lights);
    assert!(matches!(original.file.lights[..], [LightFile::Sky { scale: 6.0, .. }, LightFile::Sun { .. }]));
}
