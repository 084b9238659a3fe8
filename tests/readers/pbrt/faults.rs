//! Hostile and broken documents: typed errors with file and line.

use std::io::Write;

use fanal::base::Error;
use fanal::scene::readers::load;

use super::{folder, load_text, warned};
use crate::support::files::{PBRT, refused};

#[test]
fn every_prefix_gives_a_scene_or_a_typed_error() {
    let folder = folder();
    load_text(folder.path(), PBRT).unwrap();
    for end in (0..PBRT.len()).step_by(7).filter(|&end| PBRT.is_char_boundary(end)) {
        if let Err(error) = load_text(folder.path(), &PBRT[..end]) {
            refused(Err(error), "a prefix");
        }
    }
}

#[test]
fn errors_name_file_and_line() {
    let folder = folder();
    for (text, words) in [
        ("Shap \"sphere\"", "Shape seems to be meant"),
        ("Polygon", "supported: Accelerator"),
        ("3 4", "the directive 3"),
        ("\"sphere\"", "expected a directive"),
        ("]", "expected a directive"),
        ("Shape sphere", "in quotes"),
        ("Shape \"torus\"", "supported: sphere"),
        ("Shape \"sphere\" \"radius\" 1", "type and name"),
        ("Shape \"sphere\" \"length radius\" 1", "supported: float"),
        ("Shape \"sphere\" \"float radius\" [ 1 2 ]", "one number"),
        ("Shape \"sphere\" \"float radius\" \"1\"", "numbers"),
        ("Shape \"sphere\" \"float radius\" [ 1 true ]", "different kinds"),
        ("Shape \"sphere\" \"float radius\" 1e99", "not a finite number"),
        ("Shape \"sphere\" \"float radius\"", "expected a parameter's value"),
        ("Shape \"sphere\" \"float radius\" [ 1", "expected a parameter's value"),
        ("Shape \"trianglemesh\" \"point3 P\" [ 0 0 0 1 ]", "multiple of 3"),
        ("Shape \"trianglemesh\" \"point3 P\" [ 0 0 0 ] \"integer indices\" [ 0 0 ]", "multiple of 3"),
        ("Shape \"trianglemesh\" \"point3 P\" [ 0 0 0 ] \"integer indices\" [ 0 0 7 ]", "only 1"),
        ("Shape \"trianglemesh\" \"point3 P\" [ 0 0 0 ] \"integer indices\" [ 0 0 -1 ]", "-1"),
        ("Shape \"trianglemesh\" \"point3 P\" [ 0 0 0 ] \"integer indices\" [ 0 0 5e9 ]", "5000000000"),
        ("Shape \"trianglemesh\" \"point3 P\" [ 0 0 0 1 0 0 0 1 0 ] \"normal N\" [ 0 0 1 ]", "normals"),
        ("Shape \"bilinearmesh\" \"point3 P\" [ 0 0 0 ] \"integer indices\" [ 0 1 2 3 ]", "only 1"),
        ("LightSource \"sun\"", "supported: point"),
        ("LightSource \"point\" \"blackbody I\" -3", "-3 K"),
        ("LightSource \"point\" \"spectrum I\" [ 500 1 400 1 ]", "wavelengths"),
        ("LightSource \"point\" \"spectrum I\" [ 1000 1 1100 1 ]", "black"),
        ("LightSource \"spot\" \"point3 from\" [ 0 0 1 ]", "no direction"),
        ("LightSource \"point\" \"rgb I\" [ -1 0 0 ]", "-1"),
        ("AreaLightSource \"neon\"", "supported: diffuse"),
        ("ColorSpace \"adobe\"", "rec2020"),
        ("Include \"tested.pbrt\"", "includes itself"),
        ("Include \"../a.pbrt\"", "climbs out"),
        ("Include \"/etc/passwd\"", "absolute"),
        ("Texture \"t\" \"vector\" \"constant\"", "supported: float"),
        ("Material \"dielectric\" \"float roughness\" -1", "roughness is -1"),
    ] {
        let error = refused(load_text(folder.path(), &format!("WorldBegin\n{text}")), text).to_string();
        assert!(error.contains(words) && error.contains("tested.pbrt:2"), "{text}: {error}");
    }
    for (text, words) in [
        ("", "no WorldBegin"),
        ("Film \"rgb\" \"integer xresolution\" -1 WorldBegin", "xresolution is -1"),
        ("Film \"rgb\" \"integer xresolution\" 100000 WorldBegin", "16384"),
    ] {
        let error = refused(load_text(folder.path(), text), text).to_string();
        assert!(error.contains(words) && error.contains("tested.pbrt"), "{text}: {error}");
    }
}

#[test]
fn documents_of_several_files() {
    let folder = folder();
    let put = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).unwrap();
    std::fs::create_dir(folder.path().join("parts")).unwrap();
    put("parts/ball.pbrt", b"Translate 1 0 0 Shape \"sphere\" Shape \"plymesh\" \"string filename\" \"beside.ply\"");
    std::fs::copy(folder.path().join("triangle.ply"), folder.path().join("parts/beside.ply")).unwrap();
    let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    packed.write_all(b"Include \"parts/ball.pbrt\" Import \"parts/ball.pbrt\" Shape \"sphere\"").unwrap();
    let packed = packed.finish().unwrap();
    put("packed.pbrt.gz", &packed);
    let file = load_text(folder.path(), "WorldBegin Include \"packed.pbrt.gz\"").unwrap().file;
    // What is imported does not move what follows.
    assert_eq!(file.shapes.iter().map(|shape| shape.to_world[3]).collect::<Vec<_>>(), [1., 1., 2., 2., 1.]);
    assert!(file.meshes.contains_key("parts/beside.ply"), "{:?}", file.meshes);
    put("whole.pbrt.gz", &{
        let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        packed.write_all(b"WorldBegin Shape \"sphere\"").unwrap();
        packed.finish().unwrap()
    });
    assert_eq!(load(&folder.path().join("whole.pbrt.gz")).unwrap().file.shapes.len(), 1);
    put("cut.pbrt.gz", &packed[..packed.len() / 2]);
    assert!(refused(load(&folder.path().join("cut.pbrt.gz")), "a cut file").to_string().contains("gzip"));
    // A folder's scene.
    std::fs::rename(folder.path().join("tested.pbrt"), folder.path().join("scene.pbrt")).unwrap();
    assert_eq!(load(folder.path()).unwrap().file.shapes.len(), 5);
    warned("WorldEnd Shape \"sphere\"", "what follows WorldEnd");
}

#[test]
fn f04_circles_and_bombs() {
    let folder = folder();
    let put = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    put("a.pbrt", "Include \"b.pbrt\"");
    put("b.pbrt", "\nInclude \"a.pbrt\"");
    let error = refused(load_text(folder.path(), "WorldBegin Include \"a.pbrt\""), "a circle").to_string();
    assert!(error.contains("b.pbrt:2") && error.contains("includes itself"), "{error}");
    for i in 0..20 {
        put(&format!("deep{i}.pbrt"), &format!("Include \"deep{}.pbrt\"", i + 1));
    }
    put("deep20.pbrt", "");
    let error = refused(load_text(folder.path(), "WorldBegin Include \"deep0.pbrt\""), "too deep");
    assert!(matches!(error, Error::Limit { .. }), "{error}");
    for i in 0..8 {
        put(&format!("wide{i}.pbrt"), &format!("Include \"wide{}.pbrt\"\n", i + 1).repeat(10));
    }
    put("wide8.pbrt", "");
    let error = refused(load_text(folder.path(), "WorldBegin Include \"wide0.pbrt\""), "too many");
    assert!(matches!(error, Error::Limit { .. }), "{error}");
    let blocks = "AttributeBegin ".repeat(5000);
    let error = refused(load_text(folder.path(), &format!("WorldBegin {blocks}")), "too many blocks");
    assert!(matches!(error, Error::Limit { .. }), "{error}");
}
