//! Media on grids by every reader that knows them.

use crate::pbrt::{load_text, world};
use crate::support::files::{load_xml, refused, xml_with};
use crate::support::scenes::{picture, settings};

use std::path::Path;

use fanal::base::Error;
use fanal::materials::grid::Values;
use fanal::picture::Image;
use fanal::scene::Scene;
use fanal::scene::file::{GridFile, MediumFile, SceneFile};
use fanal::scene::readers::{LoadedScene, Missing, Vol, grid_key, load, load_lacking, resolve, save};
use glam::{DVec3, Vec3};
use tempfile::TempDir;

fn put(folder: &TempDir, name: &str, vol: &Vol) {
    std::fs::write(folder.path().join(name), vol.encode()).unwrap();
}

/// A density of bytes and an albedo of three channels.
fn volumes(folder: &TempDir) {
    let values = Values::Bytes((0..60).map(|i| (i * 37 % 256) as u8).collect());
    put(
        folder,
        "density.vol",
        &Vol { size: [3, 4, 5], channels: 1, corners: [[-1.0, -0.5, 0.0], [1.0, 0.5, 2.0]], values },
    );
    let values = Values::Floats((0..24).map(|i| 0.4 + 0.02 * i as f32).collect());
    put(folder, "albedo.vol", &Vol { size: [2, 2, 2], channels: 3, corners: [[0.0; 3], [1.0; 3]], values });
}

const XML: &str = r#"
    <medium type="heterogeneous" id="cloud">
        <volume name="sigma_t" type="gridvolume"><string name="filename" value="density.vol"/>
            <boolean name="use_grid_bbox" value="true"/>
            <transform name="to_world"><matrix value="0 0 1 0.5 0 1 0 0 -1 0 0 0 0 0 0 1"/></transform></volume>
        <volume name="albedo" type="gridvolume"><string name="filename" value="albedo.vol"/>
            <transform name="to_world"><scale value="4"/><translate x="-2" y="-2" z="-2"/></transform></volume>
        <float name="scale" value="3"/><phase type="hg"><float name="g" value="0.3"/></phase>
    </medium>
    <shape type="cube"><bsdf type="null"/><ref name="interior" id="cloud"/><transform name="to_world"><scale value="3"/></transform></shape>
    <emitter type="constant"/>"#;

const JSON: &str = r#"{"type": "grid", "sigma_t": [3, 3, 3], "albedo": [1, 1, 1], "g": 0.3,
    "density": {"type": "vol", "file": "density.vol", "own_box": true, "to_world": [0,0,1,0.5, 0,1,0,0, -1,0,0,0, 0,0,0,1]},
    "albedo_grid": {"type": "vol", "file": "albedo.vol", "to_world": [4,0,0,-2, 0,4,0,-2, 0,0,4,-2, 0,0,0,1]}}"#;

fn shown(loaded: &LoadedScene) -> Image {
    let scene = Scene::build(loaded, [12, 8]).unwrap();
    picture(&scene, &settings(crate::support::scenes::GUIDES[0], 4, 1))
}

fn bits(image: &Image) -> Vec<[u32; 3]> {
    image.pixels.iter().map(|pixel| pixel.to_array().map(f32::to_bits)).collect()
}

fn xml() -> String {
    xml_with(XML).replace(
        "<sensor type=\"perspective\"/>",
        "<sensor type=\"perspective\"><transform name=\"to_world\"><translate z=\"-6\"/></transform></sensor>",
    )
}

/// A Mitsuba scene and the same in our format, written by hand and saved by the program: the same file, and the same picture to the
/// last bit; without the medium another.
#[test]
fn s09_grids_by_every_reader() {
    let folder = tempfile::tempdir().unwrap();
    volumes(&folder);
    let from_xml = load_xml(&folder, &xml()).unwrap();
    assert!(from_xml.warnings.is_empty(), "{:?}", from_xml.warnings);
    let by_hand: MediumFile = serde_json::from_str(JSON).unwrap();
    assert_eq!(from_xml.file.media["cloud"], by_hand);
    let path = folder.path().join("saved.json");
    save(&from_xml.file, &path).unwrap();
    let saved = load(&path).unwrap();
    assert_eq!(saved.file, from_xml.file);
    assert_eq!(saved.crc32(), from_xml.crc32());
    let image = shown(&saved);
    assert!(bits(&image) == bits(&shown(&from_xml)));
    // What the file holds counts, and is where it should be: the sky is dimmed.
    put(
        &folder,
        "density.vol",
        &Vol { size: [1; 3], channels: 1, corners: [[0.0; 3], [1.0; 3]], values: Values::Bytes(vec![0]) },
    );
    let empty = load(&path).unwrap();
    assert_ne!(empty.crc32(), saved.crc32());
    // So does where its header says that it is.
    put(
        &folder,
        "density.vol",
        &Vol { size: [1; 3], channels: 1, corners: [[0.0; 3], [2.0; 3]], values: Values::Bytes(vec![0]) },
    );
    assert_ne!(load(&path).unwrap().crc32(), empty.crc32());
    assert!(shown(&empty).pixels.iter().all(|pixel| *pixel == Vec3::ONE));
    assert!(image.pixels.iter().any(|pixel| pixel.max_element() < 0.99));
}

/// Where grids lie: in the unit cube, in their own box, in one from corner to corner, with centres on its sides (Mitsuba 0.6).
#[test]
fn grids_lie_where_documents_say() {
    let folder = tempfile::tempdir().unwrap();
    volumes(&folder);
    let corners = |text: &str| {
        let loaded = load_xml(&folder, text).unwrap();
        let to_world = loaded.grids[&grid_key("a", "density")].to_world;
        [DVec3::ZERO, DVec3::ONE].map(|corner| to_world.transform_point3(corner))
    };
    let with = |more: &str| {
        xml_with(&format!(
            "<medium type='heterogeneous' id='a'><volume name='sigma_t' type='gridvolume'><string name='filename' value='density.vol'/>\
             {more}</volume></medium><shape type='cube'><bsdf type='null'/><ref name='interior' id='a'/></shape>"
        ))
    };
    let near = |a: [DVec3; 2], b: [[f64; 3]; 2]| a.iter().zip(b).all(|(a, b)| a.distance(b.into()) < 1e-6);
    assert!(near(corners(&with("")), [[0.0; 3], [1.0; 3]]));
    let own = with("<boolean name='use_grid_bbox' value='true'/>");
    assert!(near(corners(&own), [[-1.0, -0.5, 0.0], [1.0, 0.5, 2.0]]));
    let old = with("").replace("3.0.0", "0.6.0");
    // Half of a third of the height beyond, and so on: there are 3 × 4 × 5 cells.
    assert!(near(corners(&old), [[-1.5, -0.5 - 1.0 / 6.0, -0.25], [1.5, 0.5 + 1.0 / 6.0, 2.25]]));
    let told = with("<string name='filter_type' value='nearest'/>");
    assert!(load_xml(&folder, &told).unwrap().warnings.iter().any(|warning| warning.contains("trilinear")));
}

/// What only varies in ways that no grid has is read as before: by its mean.
#[test]
fn other_volumes_are_means() {
    let folder = tempfile::tempdir().unwrap();
    volumes(&folder);
    let body = "<medium type='heterogeneous' id='a'><float name='sigma_t' value='2'/><volume name='albedo' type='gridvolume'>\
        <string name='filename' value='albedo.vol'/></volume></medium>\
        <shape type='cube'><bsdf type='null'/><ref name='interior' id='a'/></shape>";
    let loaded = load_xml(&folder, &xml_with(body)).unwrap();
    let MediumFile::Homogeneous { sigma_t, albedo, .. } = loaded.file.media["a"] else { panic!("it varies") };
    assert!(sigma_t == [2.0; 3] && (albedo[0] - 0.61).abs() < 1e-5, "{sigma_t:?} {albedo:?}");
    assert!(loaded.warnings.iter().any(|warning| warning.contains("the mean of its values")));
}

#[test]
fn grids_of_pbrt() {
    let cloud = |more: &str| {
        format!(
            "Scale 2 2 2 MakeNamedMedium \"a\" \"string type\" \"uniformgrid\" \"integer nx\" 2 \"integer ny\" 1 \"integer nz\" 3 \
             \"float density\" [ 1 2 3 4 5 6 ] \"point3 p0\" [ -1 0 0 ] \"point3 p1\" [ 1 1 3 ] \"float scale\" 2 {more} \
             AttributeBegin MediumInterface \"a\" \"\" Material \"interface\" Shape \"sphere\" AttributeEnd"
        )
    };
    let loaded = world(&cloud("\"rgb sigma_a\" [ 1 1 3 ] \"rgb sigma_s\" [ 3 1 1 ] \"float g\" .5"));
    let MediumFile::Grid(medium) = &loaded.file.media["a"] else { panic!("it is the same everywhere") };
    let density = GridFile::Inline {
        size: [2, 1, 3],
        values: vec![1., 2., 3., 4., 5., 6.],
        to_world: [4., 0., 0., -2., 0., 2., 0., 0., 0., 0., 6., 0., 0., 0., 0., 1.],
        fades: true,
    };
    assert_eq!((&medium.density, medium.sigma_t, medium.albedo), (&density, [8., 4., 8.], [0.75, 0.5, 0.25]));
    assert_eq!((medium.g, medium.emission, &medium.emission_grid), (0.5, [0.0; 3], &None));
    let grid = &loaded.grids[&grid_key("a", "density")];
    assert_eq!(grid.grid.at(Vec3::new(0.25, 0.5, 0.5)), Vec3::splat(3.0));
    let shining = world(&cloud("\"rgb Le\" [ 1 2 3 ] \"float Lescale\" [ 0 0 1 1 2 2 ]"));
    let MediumFile::Grid(medium) = &shining.file.media["a"] else { panic!("it is the same everywhere") };
    assert_eq!((medium.emission, medium.sigma_t), ([1., 2., 3.], [4.0; 3]));
    assert!(matches!(&medium.emission_grid, Some(GridFile::Inline { values, .. }) if values[4] == 2.0));
    let folder = tempfile::tempdir().unwrap();
    let few = cloud("").replace("[ 1 2 3 4 5 6 ]", "[ 1 2 ]");
    let error = refused(load_text(folder.path(), &format!("WorldBegin {few}")), "too few values").to_string();
    assert!(error.contains("2 values for 2 × 1 × 3 cells"), "{error}");
}

/// A scene in our format with this density.
fn with_density(density: &str) -> Result<LoadedScene, Error> {
    let medium =
        format!(r#"{{"type": "grid", "sigma_t": [1, 1, 1], "albedo": [0.5, 0.5, 0.5], "density": {density}}}"#);
    let mut scene: SceneFile = serde_json::from_str(crate::support::files::JSON).unwrap();
    (scene.shapes, scene.lights, scene.materials, scene.meshes) = Default::default();
    scene.media.insert("a".into(), serde_json::from_str(&medium).unwrap());
    resolve(scene, Path::new(""), Path::new("scene.json"))
}

#[test]
fn f04_hostile_grids_are_refused() {
    let grid = |size: &str, values: &str, more: &str| {
        with_density(&format!(r#"{{"type": "inline", "size": {size}, "values": {values}{more}}}"#))
    };
    grid("[2, 1, 1]", "[1, 2]", "").unwrap();
    for (size, values, more, words) in [
        ("[2, 1, 1]", "[1]", "", "1 values"),
        ("[0, 1, 1]", "[]", "", "cells"),
        ("[4294967295, 4294967295, 4294967295]", "[1]", "", "edge"),
        ("[1, 1, 1]", "[1e39]", "", "finite"),
        ("[1, 1, 1]", "[1e31]", "", "extinction"),
        ("[1, 1, 1]", "[1]", r#", "to_world": [1,0,0,0, 0,0,0,0, 0,0,1,0, 0,0,0,1]"#, "inverse"),
    ] {
        let error = refused(grid(size, values, more), words).to_string();
        assert!(error.contains("media.a") && error.contains(words), "{words}: {error}");
    }
    let negative = grid("[3, 1, 1]", "[1, -2, -3]", "").unwrap();
    assert!(negative.warnings.iter().any(|warning| warning.contains("2 values")), "{:?}", negative.warnings);
    assert_eq!(negative.grids[&grid_key("a", "density")].grid.at(Vec3::ONE), Vec3::ZERO);
}

/// A volume that is not there is named, or 1 everywhere; one that is damaged is an error with its name.
#[test]
fn missing_and_damaged_volumes() {
    let folder = tempfile::tempdir().unwrap();
    volumes(&folder);
    std::fs::remove_file(folder.path().join("albedo.vol")).unwrap();
    let error = load_xml(&folder, &xml()).unwrap_err().to_string();
    assert!(error.contains("albedo.vol") && error.contains("tested.xml"), "{error}");
    let loaded = load_lacking(&folder.path().join("tested.xml"), &[], Missing::Skip).unwrap();
    assert_eq!(loaded.grids[&grid_key("cloud", "albedo_grid")].grid.at(Vec3::ZERO), Vec3::ONE);
    assert!(
        loaded.warnings.iter().any(|warning| warning.contains("the volume \"albedo.vol\"")),
        "{:?}",
        loaded.warnings
    );
    let good = std::fs::read(folder.path().join("density.vol")).unwrap();
    let damaged = |bytes: &[u8]| {
        volumes(&folder);
        std::fs::write(folder.path().join("density.vol"), bytes).unwrap();
        refused(load_xml(&folder, &xml()), "a damaged volume").to_string()
    };
    for bytes in [&good[..good.len() - 1], &good[..20], &[][..], &[&good[..20], &[2, 0, 0, 0], &good[24..]].concat()] {
        let error = damaged(bytes);
        assert!(error.contains("density.vol") || error.contains("cloud") || error.contains("tested.xml"), "{error}");
    }
}
