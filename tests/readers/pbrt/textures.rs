//! Textures.

use fanal::materials::texture::luminance;
use fanal::scene::file::{Filter, MaterialFile, TextureFile, Wrap};
use fanal::scene::readers::LoadedScene;
use glam::Vec3;

use super::{close, folder, load_text, quiet, warned, world};

/// The reflectance that is the texture "t".
fn reflectance(loaded: &LoadedScene) -> TextureFile {
    match loaded.file.materials[&loaded.file.shapes[0].material].innermost() {
        MaterialFile::Diffuse { reflectance } => reflectance.clone(),
        other => panic!("{other:?}"),
    }
}

const USED: &str = "Material \"diffuse\" \"texture reflectance\" \"t\" Shape \"sphere\"";

fn texture(text: &str) -> TextureFile {
    quiet(&format!("{text} {USED}"));
    reflectance(&world(&format!("{text} {USED}")))
}

/// A texture that is a picture made of `grey.png`, and its pixels beside those of the original.
fn made(text: &str) -> Vec<(Vec3, Vec3)> {
    let loaded = world(&format!(
        "Texture \"p\" \"spectrum\" \"imagemap\" \"string filename\" \"grey.png\"\n{text} {USED}\n\
        Material \"diffuse\" \"texture reflectance\" \"p\" Shape \"sphere\""
    ));
    let TextureFile::Bitmap { file, scale: 1.0, raw: false, .. } = reflectance(&loaded) else {
        panic!("{:?}", reflectance(&loaded))
    };
    let [old, new] = ["grey.png", &file].map(|file| loaded.images[file].to_image());
    old.pixels.iter().copied().zip(new.pixels.iter().copied()).collect()
}

#[test]
fn pictures() {
    let plain = TextureFile::Bitmap {
        file: "grey.png".into(),
        to_uv: [1., 0., 0., 0., -1., 1., 0., 0., 1.],
        raw: false,
        scale: 1.0,
        wrap: Wrap::Repeat,
        filter: Filter::Bilinear,
    };
    let map = |text: &str| format!("Texture \"t\" \"spectrum\" \"imagemap\" \"string filename\" \"grey.png\" {text}");
    assert_eq!(texture(&map("")), plain, "v runs upwards");
    let TextureFile::Bitmap { to_uv, raw: true, scale: 0.5, wrap: Wrap::Clamp, filter: Filter::Nearest, .. } = texture(
        &map(
            "\"float uscale\" 2 \"float vscale\" 3 \"float udelta\" .25 \"float vdelta\" .5 \"string encoding\" \"linear\"\n\
         \"float scale\" .5 \"string wrap\" \"clamp\" \"string filter\" \"point\"",
        ),
    ) else {
        panic!("options are read")
    };
    assert_eq!(to_uv, [2., 0., 0.25, 0., -3., 0.5, 0., 0., 1.]);
    let inverted =
        made("Texture \"t\" \"spectrum\" \"imagemap\" \"string filename\" \"grey.png\" \"bool invert\" true");
    assert!(inverted.iter().all(|(old, new)| new.distance(Vec3::ONE - *old) < 1e-6));
    let TextureFile::Bitmap { raw: true, file, .. } = texture(&map("\"string encoding\" \"gamma 1\"")) else {
        panic!("numbers as they are")
    };
    assert_eq!(file, "grey.png");
    // As sRGB is about a gamma of 2.2, where it is not dark.
    let decoded = made(
        "Texture \"t\" \"spectrum\" \"imagemap\" \"string filename\" \"grey.png\" \"string encoding\" \"gamma 2.2\"",
    );
    assert!(decoded.iter().all(|(old, new)| (*new - *old).abs().max_element() < 0.012), "{decoded:?}");
    for (text, words) in [
        ("\"string wrap\" \"black\"", "black"),
        ("\"string encoding\" \"gamma two\"", "gamma two"),
        ("\"string mapping\" \"spherical\"", "spherical"),
        ("\"float uscal\" 2", "\"uscale\" seems to be meant"),
    ] {
        warned(&format!("{} {USED}", map(text)), words);
    }
    let folder = folder();
    for (text, words) in
        [("\"imagemap\"", "filename"), ("\"velvet\"", "checkerboard"), ("\"imagemap\" \"string filename\" 3", "text")]
    {
        let error = load_text(folder.path(), &format!("WorldBegin Texture \"t\" \"float\" {text}"))
            .expect_err(text)
            .to_string();
        assert!(error.contains(words), "{error}");
    }
}

#[test]
fn constants_boards_products() {
    let value = |text: &str| match texture(text) {
        TextureFile::Rgb { value } => value,
        other => panic!("{other:?}"),
    };
    assert_eq!(value("Texture \"t\" \"spectrum\" \"constant\" \"rgb value\" [ .1 .2 .3 ]"), [0.1, 0.2, 0.3]);
    assert!(close(value("Texture \"t\" \"float\" \"scale\" \"float tex\" .5 \"float scale\" .5"), [0.25; 3]));
    assert!(close(
        value("Texture \"t\" \"spectrum\" \"scale\" \"rgb tex1\" [ 1 .5 0 ] \"rgb tex2\" [ .5 .5 .5 ]"),
        [0.5, 0.25, 0.0]
    ));
    assert!(close(
        value("Texture \"t\" \"spectrum\" \"mix\" \"rgb tex1\" [ 1 0 0 ] \"rgb tex2\" [ 0 1 0 ] \"float amount\" .25"),
        [0.75, 0.25, 0.0]
    ));
    let board =
        "Texture \"t\" \"spectrum\" \"checkerboard\" \"rgb tex1\" [ 1 0 0 ] \"rgb tex2\" [ 0 0 1 ] \"float uscale\" 4";
    let TextureFile::Checkerboard { color0, color1, to_uv } = texture(board) else { panic!("a board") };
    assert_eq!((color0, color1), ([1., 0., 0.], [0., 0., 1.]));
    assert_eq!(to_uv, [2., 0., 0., 0., 0.5, 0., 0., 0., 1.], "squares of one unit");
    let dimmed = format!(
        "{} Texture \"t\" \"spectrum\" \"scale\" \"texture tex\" \"b\" \"float scale\" .5",
        board.replace("\"t\"", "\"b\"")
    );
    assert!(matches!(texture(&dimmed), TextureFile::Checkerboard { color0: [0.5, 0., 0.], .. }));
    let amount = "Texture \"b\" \"float\" \"checkerboard\" Texture \"t\" \"spectrum\" \"mix\" \"rgb tex1\" [ .1 .1 .1 ] \"rgb tex2\" [ .9 .9 .9 ] \"texture amount\" \"b\"";
    let TextureFile::Checkerboard { color0, color1, .. } = texture(amount) else { panic!("a board") };
    assert!(close(color0, [0.9; 3]) && close(color1, [0.1; 3]));
}

#[test]
fn pictures_made_of_pictures() {
    let coloured = made("Texture \"t\" \"spectrum\" \"scale\" \"texture tex\" \"p\" \"rgb scale\" [ .5 1 0 ]");
    assert!(coloured.iter().all(|(old, new)| new.distance(*old * Vec3::new(0.5, 1.0, 0.0)) < 1e-6));
    let mixed =
        made("Texture \"t\" \"spectrum\" \"mix\" \"texture tex1\" \"p\" \"rgb tex2\" [ 1 0 0 ] \"float amount\" .25");
    assert!(mixed.iter().all(|(old, new)| new.distance(*old * 0.75 + Vec3::X * 0.25) < 1e-6));
    let ramp = made(
        "Texture \"t\" \"spectrum\" \"mix\" \"rgb tex1\" [ 1 0 0 ] \"rgb tex2\" [ 0 1 0 ] \"texture amount\" \"p\"",
    );
    assert!(ramp.iter().all(|(_, new)| (new.x + new.y - 1.0).abs() < 1e-5 && new.z == 0.0));
    warned(
        &format!(
            "Texture \"p\" \"float\" \"imagemap\" \"string filename\" \"grey.png\" Texture \"t\" \"float\" \"scale\" \"texture tex\" \"p\" \"texture scale\" \"p\" {USED}"
        ),
        "mean",
    );
}

#[test]
fn means_of_what_is_not_known() {
    for (class, words) in [
        ("fbm", "fbm"),
        ("wrinkled", "wrinkled"),
        ("windy", "windy"),
        ("marble", "marble"),
        ("ptex", "ptex"),
        ("dots", "dots"),
        ("bilerp", "bilerp"),
        ("directionmix", "directionmix"),
    ] {
        warned(&format!("Texture \"t\" \"spectrum\" \"{class}\" {USED}"), words);
    }
    let loaded = world(&format!(
        "Texture \"t\" \"float\" \"imagemap\" \"string filename\" \"grey.png\" Material \"dielectric\" \"texture uroughness\" \"t\" Shape \"sphere\" {USED}"
    ));
    assert!(loaded.warnings.iter().any(|warning| warning.contains("roughness cannot vary")), "{:?}", loaded.warnings);
}

/// Numbers of a PNG file with alpha are its alpha in v4, decoded as colours are; in v3, and where all of it is 1, they are its colours.
#[test]
fn numbers_are_alpha() {
    let folder = folder();
    let write = |name: &str, alpha: u8| {
        let mut encoder = png::Encoder::new(std::fs::File::create(folder.path().join(name)).unwrap(), 2, 1);
        encoder.set_color(png::ColorType::Rgba);
        encoder.write_header().unwrap().write_image_data(&[255, 255, 255, alpha, 255, 255, 255, 255]).unwrap();
    };
    write("leaf.png", 51);
    write("opaque.png", 255);
    let opacity = |film: &str, name: &str, encoding: &str| {
        let loaded = load_text(
            folder.path(),
            &format!(
                "Film \"{film}\" WorldBegin Texture \"a\" \"float\" \"imagemap\" \"string filename\" \"{name}\" {encoding}\n\
                 Shape \"sphere\" \"texture alpha\" \"a\""
            ),
        );
        let loaded = loaded.unwrap();
        let material = &loaded.file.materials[&loaded.file.shapes[0].material];
        let MaterialFile::Mask { opacity: TextureFile::Bitmap { file, .. }, .. } = material else {
            panic!("{material:?}")
        };
        loaded.images.get(file.as_str()).map(|texels| texels.to_image().pixels[0].x)
    };
    let near = |value: Option<f32>, expected: f32| value.is_some_and(|value| (value - expected).abs() < 1e-3);
    assert!(near(opacity("rgb", "leaf.png", "\"string encoding\" \"linear\""), 0.2));
    assert!(near(opacity("rgb", "leaf.png", ""), 0.0331));
    assert!(near(opacity("image", "leaf.png", ""), 1.0));
    assert!(near(opacity("rgb", "opaque.png", ""), 1.0));
}

/// Roughness that is a texture varies; what pbrt makes of it is made of every pixel.
#[test]
fn textures_of_roughness() {
    let board = "Texture \"b\" \"float\" \"checkerboard\" \"float tex1\" .04 \"float tex2\" .25 ";
    for (kind, remapped, [first, second]) in [
        ("conductor", "", [0.2, 0.5]),
        ("dielectric", "\"bool remaproughness\" false", [0.04, 0.25]),
        ("coateddiffuse", "", [0.2, 0.5]),
    ] {
        let file =
            quiet(&format!("{board} Material \"{kind}\" \"texture roughness\" \"b\" {remapped} Shape \"sphere\""));
        let material = file.materials[&file.shapes[0].material].clone();
        let material = if let MaterialFile::TwoSided { material } = material { *material } else { material };
        let MaterialFile::RoughnessMap { texture: TextureFile::Checkerboard { color0, color1, .. }, material } =
            material
        else {
            panic!("{material:?}")
        };
        assert!(close(color0, [first; 3]) && close(color1, [second; 3]), "{color0:?} {color1:?}");
        assert!(material.has_facets());
    }
    let text = "Texture \"t\" \"float\" \"imagemap\" \"string filename\" \"grey.png\" \"string encoding\" \"linear\"\n\
        Material \"conductor\" \"texture roughness\" \"t\" Shape \"sphere\"";
    let loaded = world(text);
    let MaterialFile::TwoSided { material } = &loaded.file.materials[&loaded.file.shapes[0].material] else { panic!() };
    let MaterialFile::RoughnessMap { texture: TextureFile::Bitmap { file, .. }, .. } = &**material else { panic!() };
    let pixels = &loaded.images[file].to_image().pixels;
    // The bytes of that picture rise by sevens.
    for (i, made) in pixels.iter().enumerate() {
        let given = [0, 1, 2].map(|channel| ((3 * i + channel) * 7 % 256) as f32 / 255.0);
        let expected = luminance(given.into()).sqrt();
        assert!(pixels.len() == 256 && (made.x - expected).abs() < 1e-3, "{made} {expected}");
    }
}
