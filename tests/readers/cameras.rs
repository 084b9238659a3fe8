//! Several cameras in one document, in every format that has them.

use fanal::base::Error;
use fanal::scene::Scene;
use fanal::scene::file::{DEFAULT_CAMERA, SceneFile};
use fanal::scene::readers::{load, save};
use fanal::scene::views::choose;
use serde_json::{Value, json};

use crate::gltf::{loaded, refused, warns};
use crate::support::files::{JSON, folder, load_xml};
use crate::support::gltf::Document;

fn names(file: &SceneFile) -> Vec<&str> {
    file.views().map(|(name, _)| name).collect()
}

/// Sensors by their ids, the first without one; each with the size of its own film, by which its field of view goes. Filter and samples
/// are the first one's, and other kinds of sensors are left out, with a warning at their line.
#[test]
fn mitsuba_sensors_are_cameras() {
    let film = |width: u32, filter: &str| {
        format!(
            "<film type='hdrfilm'><integer name='width' value='{width}'/><integer name='height' value='60'/>\
             <rfilter type='{filter}'/></film>"
        )
    };
    let scene = format!(
        "<scene version='3.0.0'>\n\
         <sensor type='perspective'>{}<sampler type='independent'><integer name='sample_count' value='8'/></sampler></sensor>\n\
         <sensor type='perspective' id='door'><float name='fov' value='40'/><string name='fov_axis' value='y'/>{}</sensor>\n\
         <sensor type='orthographic' id='plan'>{}</sensor>\n\
         <sensor type='radiancemeter' id='meter'/>\n\
         <sensor type='perspective'>{}<sampler type='independent'><integer name='sample_count' value='9'/></sampler></sensor>\n\
         <sensor type='perspective' id='default'>{}</sensor>\n\
         </scene>",
        film(80, "box"),
        film(120, "box"),
        film(80, "tent"),
        film(80, "box"),
        film(80, "box")
    );
    let loaded = load_xml(&folder(), &scene).unwrap();
    let file = &loaded.file;
    assert_eq!(names(file), [DEFAULT_CAMERA, "camera4", "default-2", "door", "plan"]);
    assert_eq!(([file.film.width, file.film.height], file.render.spp), ([80, 60], 8));
    let (door, plan) = (&file.cameras["door"], &file.cameras["plan"]);
    assert_eq!((door.size, plan.size, file.camera.size), (Some([120, 60]), None, None));
    let half = (f64::from(door.fov).to_radians() / 2.0).tan();
    assert!((half / (2.0 * 20f64.to_radians().tan()) - 1.0).abs() < 1e-6);
    assert_eq!(plan.orthographic_width, Some(2.0));
    let warned = |line: u32, words: &str| {
        loaded.warnings.iter().any(|w| w.contains(&format!("tested.xml:{line}: ")) && w.contains(words))
    };
    assert!(
        warned(4, "first sensor") && warned(6, "first sensor") && warned(5, "radiancemeter"),
        "{:?}",
        loaded.warnings
    );
    assert_eq!(loaded.warnings.len(), 3, "{:?}", loaded.warnings);
    let damaged =
        scene.replace("<float name='fov' value='40'/>", "<float name='principal_point_offset_x' value='1e39'/>");
    assert!(load_xml(&folder(), &damaged).unwrap_err().to_string().contains("tested.xml:3"));
}

/// Films with a crop show that part of what they show without it, and rays start at `near_clip`.
#[test]
fn crops_and_near_planes() {
    let scene = |more: &str| {
        format!(
            "<scene version='3.0.0'><sensor type='perspective'><float name='fov' value='50'/>{more}<film type='hdrfilm'>\
             <integer name='width' value='120'/><integer name='height' value='80'/>{{crop}}</film></sensor></scene>"
        )
    };
    let crop = |x: u32, width: u32| {
        format!(
            "<integer name='crop_offset_x' value='{x}'/><integer name='crop_offset_y' value='5'/>\
             <integer name='crop_width' value='{width}'/><integer name='crop_height' value='40'/>"
        )
    };
    let load = |near: &str, crop: &str| load_xml(&folder(), &scene(near).replace("{crop}", crop));
    let ray = |near: &str, crop: &str, film: [f32; 2]| {
        let loaded = load(near, crop).unwrap();
        assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
        let size = [loaded.file.film.width, loaded.file.film.height];
        (size, Scene::build(&loaded, size).unwrap().camera.ray(film, [0.5; 2]))
    };
    let (whole, part) = (ray("", "", [73.0, 25.0]), ray("", &crop(70, 30), [3.0, 20.0]));
    assert_eq!((whole.0, part.0), ([120, 80], [30, 40]));
    assert!(whole.1.direction.distance(part.1.direction) < 1e-6);
    let near = ray("<float name='near_clip' value='2'/>", "", [73.0, 25.0]).1;
    assert!((near.origin.z - 2.0).abs() < 1e-6 && near.direction == whole.1.direction, "{near:?}");
    let outside = load("", &crop(100, 30)).unwrap_err().to_string();
    assert!(outside.contains("tested.xml:1") && outside.contains("not inside"), "{outside}");
    assert!(load("<float name='near_clip' value='-1'/>", "").unwrap_err().to_string().contains("near_clip"));
}

/// Cameras by the names of their nodes, or else their own; orthographic ones too. Each keeps its picture's shape.
#[test]
fn gltf_cameras_are_cameras() {
    let mut document = Document::new();
    document.square(None);
    let lens = |aspect: f64, name: &str| json!({ "type": "perspective", "name": name, "perspective": { "yfov": 1.0, "znear": 0.1, "aspectRatio": aspect } });
    let wide = document.add("cameras", lens(2.0, "wide"));
    let tall = document.add("cameras", lens(0.5, "tall"));
    let flat = document.add(
        "cameras",
        json!({ "type": "orthographic", "orthographic": { "xmag": 3.0, "ymag": 1.5, "znear": 0.1, "zfar": 10.0 } }),
    );
    for (camera, name) in [(wide, None), (tall, Some("door")), (wide, Some("door")), (flat, None)] {
        let mut node = json!({ "camera": camera, "translation": [0.0, 0.0, 4.0] });
        name.into_iter().for_each(|name| node["name"] = json!(name));
        document.add_node(node);
    }
    let found = loaded(&document);
    assert_eq!(names(&found.file), ["wide", "camera4", "door", "door-2"]);
    assert!(!warns(&found, "camera"), "{:?}", found.warnings);
    assert_eq!([found.file.film.width, found.file.film.height], [1440, 720]);
    let cameras = &found.file.cameras;
    assert_eq!((cameras["door"].size, cameras["door-2"].size), (Some([360, 720]), None));
    assert_eq!((cameras["camera4"].orthographic_width, cameras["camera4"].size), (Some(6.0), None));
    assert_eq!(cameras["door-2"].fov, found.file.camera.fov);
    // The orthographic one looks along −z, +x to the right: a ray through the left edge of its picture.
    let mut file = found.clone();
    choose(&mut file.file, Some("camera4")).unwrap();
    let ray = Scene::build(&file, [1440, 720]).unwrap().camera.ray([0.0, 360.0], [0.5; 2]);
    assert!(
        ray.origin.distance(glam::Vec3::new(-3.0, 0.0, 4.0)) < 1e-5 && ray.direction.distance(glam::Vec3::NEG_Z) < 1e-6
    );
    for (key, value) in [("xmag", json!(0.0)), ("xmag", json!(-1.0)), ("ymag", json!(1e-9))] {
        let mut damaged = document.json.clone();
        damaged["cameras"][2]["orthographic"][key] = value;
        let damaged = Document { json: damaged, buffer: document.buffer.clone() };
        assert!(refused(&damaged, key).contains("cameras[2]"));
    }
}

fn with(change: impl FnOnce(&mut Value)) -> Value {
    let mut json: Value = serde_json::from_str(JSON).unwrap();
    change(&mut json);
    json
}

/// A document without further cameras is saved as it always was; one with some comes back as it is. Every camera is checked.
#[test]
fn our_own_cameras_are_read_saved_and_checked() {
    let plain: SceneFile = serde_json::from_str(JSON).unwrap();
    let text = serde_json::to_string(&plain).unwrap();
    assert!(!text.contains("camera_name") && !text.contains("cameras") && !text.contains("\"size\""), "{text}");
    let folder = folder();
    let path = folder.path().join("tested.json");
    let loaded = |json: &Value| {
        std::fs::write(&path, json.to_string()).unwrap();
        load(&path)
    };
    let camera = serde_json::from_str::<Value>(JSON).unwrap()["camera"].clone();
    let several = with(|json| {
        json["camera_name"] = json!("hall");
        json["cameras"] = json!({ "door": camera, "window": camera });
        json["cameras"]["door"]["size"] = json!([7, 5]);
    });
    let found = loaded(&several).unwrap();
    assert_eq!(names(&found.file), ["hall", "door", "window"]);
    let copy = folder.path().join("copy.json");
    save(&found.file, &copy).unwrap();
    assert_eq!(load(&copy).unwrap().file, found.file);
    type Damage = (&'static str, fn(&mut Value));
    let damaged: [Damage; 9] = [
        ("cameras.door.fov", |json| json["cameras"]["door"]["fov"] = json!(180.0)),
        ("cameras.door.medium", |json| json["cameras"]["door"]["medium"] = json!("fog")),
        ("cameras.door.size", |json| json["cameras"]["door"]["size"] = json!([0, 5])),
        ("cameras.window.to_world", |json| json["cameras"]["window"]["to_world"][3] = json!(1e20)),
        ("camera_name", |json| json["camera_name"] = json!("door")),
        ("camera.size", |json| json["camera"]["size"] = json!([4, 4])),
        ("cameras", |json| json["cameras"][""] = json["camera"].clone()),
        ("camera.near_clip", |json| json["camera"]["near_clip"] = json!(1e30)),
        ("cameras.door.aperture_radius", |json| json["cameras"]["door"]["aperture_radius"] = json!(1e30)),
    ];
    for (part, damage) in damaged {
        let mut json = several.clone();
        damage(&mut json);
        let error = loaded(&json).expect_err(part);
        assert!(matches!(error, Error::Malformed { .. }) && error.to_string().contains(part), "{part}: {error}");
    }
    // A number without end stands for infinity.
    let mut far = several.clone();
    far["cameras"]["door"]["focus_distance"] = json!(1e30);
    let found = loaded(&far).unwrap();
    assert_eq!(found.file.cameras["door"].focus_distance, Some(1e9));
    assert!(found.warnings.iter().any(|w| w.contains("cameras.door.focus_distance")), "{:?}", found.warnings);
    let mut huge = several;
    huge["cameras"]["door"]["size"] = json!([16384, 16384]);
    assert!(matches!(loaded(&huge).unwrap_err(), Error::Limit { .. }));
}
