//! Names in Mitsuba's scenes that are given a value from outside.

use fanal::base::Error;
use fanal::scene::readers::{Definition, How, LoadedScene, load, load_by};
use tempfile::TempDir;

const SCENE: &str = "<scene version='3.0.0'><default name='depth' value='5'/><default name='size' value='16'/><default name='size_of' value='1'/>
    <integrator type='path'><integer name='max_depth' value='$depth'/></integrator><include filename='$what.xml'/>
    <sensor type='perspective'><film type='hdrfilm'><integer name='width' value='$size'/><integer name='height' value='8'/></film></sensor></scene>";

fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    put("scene.xml", SCENE);
    put(
        "ball.xml",
        "<scene version='3.0.0'><shape type='sphere'><float name='radius' value='$radius'/></shape></scene>",
    );
    folder
}

fn read(folder: &TempDir, words: &[&str]) -> Result<LoadedScene, Error> {
    let definitions: Vec<Definition> = words.iter().map(|word| word.parse().unwrap()).collect();
    load_by(&folder.path().join("scene.xml"), &How { definitions: &definitions, ..How::default() })
}

/// They go before the scene's own defaults, reach included files, and may be what the scene has no default for. The last one holds.
#[test]
fn values_from_outside() {
    let folder = folder();
    let loaded = read(&folder, &["depth=9", "what=ball", "radius=2", "depth=7"]).unwrap();
    assert_eq!((loaded.file.render.max_depth, loaded.file.film.width, loaded.file.shapes.len()), (7, 16, 1));
    // A default that nothing uses is known all the same.
    let loaded = read(&folder, &["what=ball", "radius=2", "size_of=x", "size=24"]).unwrap();
    assert_eq!((loaded.file.render.max_depth, loaded.file.film.width), (5, 24));
}

/// An unknown name is an error with those that there are; a value is checked like any other.
#[test]
fn wrong_definitions_are_errors() {
    let folder = folder();
    let fails = |words: &[&str], part: &str| {
        let error = read(&folder, words).unwrap_err();
        assert!(matches!(error, Error::Malformed { .. } | Error::Limit { .. }), "{error:?}");
        let text = error.to_string();
        assert!(text.contains(part) && text.contains(".xml"), "{text} lacks {part}");
    };
    fails(
        &["what=ball", "radius=2", "deph=3"],
        "\"depth\" seems to be meant; there is depth, radius, size, size_of, what",
    );
    fails(&["what=ball"], "-D radius=VALUE");
    fails(&["what=ball", "radius=x"], "\"x\"");
    fails(&["what=ball", "radius=2", "depth=-3"], "max_depth is -3");
    let long = format!("radius={}", "1".repeat(1 << 20));
    assert!(read(&folder, &["what=ball", &long]).is_err());
    let plain = folder.path().join("plain.xml");
    std::fs::write(&plain, "<scene version='3.0.0'><shape type='sphere'/></scene>").unwrap();
    assert!(load(&plain).is_ok());
    let definitions = ["spp=1".parse().unwrap()];
    let how = How { definitions: &definitions, ..How::default() };
    let error = load_by(&plain, &how).unwrap_err().to_string();
    assert!(error.contains("has no names to define"), "{error}");
    let other = folder.path().join("scene.pbrt");
    std::fs::write(&other, "WorldBegin").unwrap();
    assert!(matches!(load_by(&other, &how), Err(Error::Options(_))));
}
