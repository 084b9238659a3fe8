//! What pbrt allows, and scenes do, in ways that are easily taken for faults: names before what they name, parameters behind included
//! files, v3's indulgence.

use fanal::scene::file::{FilterFile, MaterialFile, TextureFile};

use super::{close, folder, load_text, quiet, warned, world};

const V3: &str = "Film \"image\" \"integer xresolution\" 8 \"integer yresolution\" 8 WorldBegin\n";

/// A scene of v3 with `body` in its world.
fn old(body: &str) -> fanal::scene::readers::LoadedScene {
    let folder = folder();
    load_text(folder.path(), &format!("{V3}{body}")).unwrap_or_else(|error| panic!("{body}: {error}"))
}

fn told(loaded: &fanal::scene::readers::LoadedScene, words: &str) -> bool {
    loaded.warnings.iter().any(|warning| warning.contains(words) && warning.contains("tested.pbrt:"))
}

/// v4 makes textures when all is read; pictures that are made of others are made once.
#[test]
fn textures_may_come_later() {
    let file = quiet(
        "Material \"diffuse\" \"texture reflectance\" \"t\" Shape \"sphere\"\n\
        AttributeBegin Texture \"t\" \"spectrum\" \"constant\" \"rgb value\" [.25 .5 .75] AttributeEnd",
    );
    let MaterialFile::Diffuse { reflectance } = file.materials.values().next().unwrap().innermost() else { panic!() };
    assert_eq!(*reflectance, TextureFile::rgb([0.25, 0.5, 0.75]));
    let loaded = world(
        "Material \"diffuse\" \"texture reflectance\" \"t\" Shape \"sphere\"\n\
        Texture \"t\" \"spectrum\" \"imagemap\" \"string filename\" \"grey.png\" \"bool invert\" true",
    );
    assert_eq!(loaded.images.len(), 1);
    let folder = folder();
    let nowhere = "WorldBegin Material \"diffuse\" \"texture reflectance\" \"t\" Shape \"sphere\"";
    let error = load_text(folder.path(), nowhere).unwrap_err().to_string();
    assert!(error.contains("there is no texture \"t\""), "{error}");
}

/// Colours of reflectance pictures end at 1 in v4, however they are scaled; those of v3 do not.
#[test]
fn scaled_reflectances_end_at_one() {
    let body = "Texture \"t\" \"spectrum\" \"imagemap\" \"string filename\" \"grey.png\" \"float scale\" 4\n";
    let of = |loaded: fanal::scene::readers::LoadedScene| {
        let material = loaded.file.materials[&loaded.file.shapes[0].material].innermost().clone();
        let MaterialFile::Diffuse { reflectance: TextureFile::Bitmap { file, scale, .. } } = material else {
            panic!("{material:?}")
        };
        let image = loaded.images[&file].to_image();
        image.pixels.iter().map(|pixel| (*pixel * scale).max_element()).fold(0.0, f32::max)
    };
    let new = of(world(&format!("{body}Material \"diffuse\" \"texture reflectance\" \"t\" Shape \"sphere\"")));
    let old = of(old(&format!("{body}Material \"matte\" \"texture Kd\" \"t\" Shape \"sphere\" WorldEnd")));
    assert!(new == 1.0 && old > 1.0, "{new} {old}");
}

#[test]
fn parameters_behind_an_include() {
    let folder = folder();
    std::fs::write(folder.path().join("lamp.pbrt"), "Shape \"disk\"\nLightSource \"point\" \"rgb I\" [9 9 9]\n")
        .unwrap();
    let loaded =
        load_text(folder.path(), "WorldBegin Include \"lamp.pbrt\" \"float scale\" 2 Shape \"sphere\"").unwrap();
    let fanal::scene::file::LightFile::Point { intensity, .. } = loaded.file.lights[0] else { panic!("a point") };
    assert!(close(intensity, [18.0; 3]), "{intensity:?}");
    std::fs::write(folder.path().join("end.pbrt"), "Shape \"sphere\" Identity").unwrap();
    let error = load_text(folder.path(), "WorldBegin Include \"end.pbrt\" \"float radius\" 2").unwrap_err().to_string();
    assert!(error.contains("last directive takes none"), "{error}");
}

#[test]
fn what_v3_lets_pass() {
    let loaded = old("Texture \"t\" \"spectrum\" \"imagemap\" \"string filename\" \"grey.png\" \"float gamma\" 2.2\n\
        Material \"matte\" \"texture Kd\" \"t\" Shape \"sphere\"\n\
        Material \"matte\" \"texture Kd\" \"none\" Shape \"sphere\"\n\
        NamedMaterial \"nowhere\" Shape \"sphere\"\nWorldEnd");
    assert!(told(&loaded, "there is no texture \"none\"") && told(&loaded, "there is no material \"nowhere\""));
    let kind = |shape: usize| loaded.file.materials[&loaded.file.shapes[shape].material].innermost().clone();
    assert!(matches!(kind(0), MaterialFile::Diffuse { reflectance: TextureFile::Bitmap { raw: false, .. } }));
    let grey = MaterialFile::Diffuse { reflectance: TextureFile::rgb([0.5; 3]) };
    assert_eq!([kind(1), kind(2)], [grey.clone(), grey]);
    // Lamps shine whatever they are made of.
    let lamp = "AreaLightSource \"diffuse\" \"rgb L\" [3 3 3] Material \"none\" Shape \"sphere\"";
    let loaded = old(&format!("{lamp} WorldEnd"));
    assert_eq!(loaded.file.shapes[0].emission, Some([3.0; 3]));
    assert!(told(&loaded, "read as a black one"));
    assert_eq!(warned(lamp, "its light is left out").shapes[0].emission, None, "in v4 they do not");
    // Facets that are said to be smooth are a little rough, but for glass.
    let alpha = |material: &str| {
        let loaded = old(&format!("Material {material} Shape \"sphere\" WorldEnd"));
        match loaded.file.materials[&loaded.file.shapes[0].material].innermost() {
            MaterialFile::RoughConductor { alpha, .. } => *alpha,
            MaterialFile::Dielectric { .. } => 0.0,
            MaterialFile::Tinted { material, .. } if matches!(**material, MaterialFile::Dielectric { .. }) => 0.0,
            other => panic!("{other:?}"),
        }
    };
    assert!((alpha("\"metal\" \"float roughness\" 0") - 0.0466).abs() < 1e-3);
    assert_eq!(alpha("\"glass\" \"float uroughness\" 0 \"float vroughness\" 0"), 0.0);
    // Spectra go on beyond their ends.
    let metal = "\"metal\" \"spectrum eta\" [500 2 600 2] \"spectrum k\" [500 3 600 3]";
    let loaded = old(&format!("Material {metal} Shape \"sphere\" WorldEnd"));
    let MaterialFile::RoughConductor { eta, k, .. } =
        loaded.file.materials[&loaded.file.shapes[0].material].innermost().clone()
    else {
        panic!("a metal")
    };
    assert!((0..3).all(|i| (eta[i] - 2.0).abs() < 0.03 && (k[i] - 3.0).abs() < 0.03), "{eta:?} {k:?}");
    // Holes are where there is no alpha at all.
    let loaded = old("Shape \"sphere\" \"float alpha\" 0.25 WorldEnd");
    assert!(!loaded.file.materials[&loaded.file.shapes[0].material].is_masked());
}

/// The film, which tells the version, may follow the filter whose defaults it decides.
#[test]
fn filters_before_the_film() {
    let filter = |text: &str| {
        let folder = folder();
        load_text(folder.path(), text).unwrap_or_else(|error| panic!("{error}")).file.film.filter
    };
    let gaussian = "PixelFilter \"gaussian\"\n";
    let film = "Film \"image\" \"integer xresolution\" 8 \"integer yresolution\" 8\n";
    let world = "WorldBegin Shape \"sphere\"";
    let v3 = FilterFile::Gaussian { stddev: 0.5, radius: Some(2.0) };
    assert_eq!(filter(&format!("{film}{gaussian}{world} WorldEnd")), v3);
    assert_eq!(filter(&format!("{gaussian}{film}{world} WorldEnd")), v3);
    let v4 = FilterFile::Gaussian { stddev: 0.5, radius: Some(1.5) };
    assert_eq!(filter(&format!("{gaussian}Film \"rgb\"\n{world}")), v4);
    assert_eq!(filter(&format!("PixelFilter \"box\" {world}")), FilterFile::Box { radius: 0.5 });
}
