//! Materials of v4, and those of v3 by near relations.

use fanal::scene::file::{Distribution, MaterialFile, SceneFile, TextureFile};

use super::{close, folder, load_text, quiet, warned, world};

/// The material of the only shape.
fn only(file: &SceneFile) -> &MaterialFile {
    &file.materials[&file.shapes[0].material]
}

fn rgb(value: f32) -> TextureFile {
    TextureFile::rgb([value; 3])
}

/// The material, without its two sides, of a sphere after `text`, which gives no warning.
fn plain(text: &str) -> MaterialFile {
    match only(&quiet(&format!("{text} Shape \"sphere\""))).clone() {
        MaterialFile::TwoSided { material } => *material,
        other => other,
    }
}

/// As [`plain`], with a warning that has `words` in it.
fn related(text: &str, words: &str) -> MaterialFile {
    match only(&warned(&format!("{text} Shape \"sphere\""), words)).clone() {
        MaterialFile::TwoSided { material } => *material,
        other => other,
    }
}

#[test]
fn surfaces_of_v4() {
    let ggx = Distribution::Ggx;
    assert_eq!(plain(""), MaterialFile::Diffuse { reflectance: rgb(0.5) });
    let clamped = plain("Material \"diffuse\" \"rgb reflectance\" [ .1 .2 3 ]");
    assert_eq!(clamped, MaterialFile::Diffuse { reflectance: TextureFile::rgb([0.1, 0.2, 1.0]) });
    assert_eq!(plain("Material \"dielectric\""), MaterialFile::Dielectric { int_ior: 1.5, ext_ior: 1.0 });
    let rough = plain("Material \"dielectric\" \"spectrum eta\" \"glass-LASF9\" \"float roughness\" .25");
    assert_eq!(rough, MaterialFile::RoughDielectric { alpha: 0.5, distribution: ggx, int_ior: 1.85, ext_ior: 1.0 });
    assert_eq!(
        plain("Material \"thindielectric\" \"float eta\" 1.3"),
        MaterialFile::ThinDielectric { int_ior: 1.3, ext_ior: 1.0 }
    );
    assert_eq!(plain("Material \"interface\""), MaterialFile::Null {});
    let MaterialFile::Plastic { alpha, int_ior, diffuse_reflectance, nonlinear: true, .. } =
        plain("Material \"coateddiffuse\" \"rgb reflectance\" [ .2 .2 .2 ] \"float roughness\" .09 \"float eta\" 1.4")
    else {
        panic!("a coat is plastic")
    };
    assert!((alpha - 0.3).abs() < 1e-6 && int_ior == 1.4 && diffuse_reflectance == rgb(0.2));
    let smooth = plain("Material \"coateddiffuse\" \"float roughness\" .000001 \"bool remaproughness\" false");
    assert!(matches!(smooth, MaterialFile::Plastic { alpha: 0.0, .. }), "{smooth:?}");
}

#[test]
fn metals() {
    let MaterialFile::Conductor { eta, .. } = plain("Material \"conductor\"") else { panic!("smooth copper") };
    assert!(close(eta, [0.201005, 0.92375, 1.102215]));
    let MaterialFile::RoughConductor { alpha: 0.5, k, .. } = plain(
        "Material \"conductor\" \"spectrum eta\" \"metal-CuZn-eta\" \"spectrum k\" \"metal-CuZn-k\" \"float roughness\" .25",
    ) else {
        panic!("rough brass")
    };
    assert_eq!(k, [3.695, 2.765, 1.829]);
    let MaterialFile::Conductor { eta, k, .. } = plain("Material \"conductor\" \"rgb reflectance\" [ .5 .8 1 ]") else {
        panic!("a metal of a colour")
    };
    // The reflectance at normal incidence is k²/(k² + 4).
    let reflected = k.map(|k| k * k / (k * k + 4.0));
    assert!(eta == [1.0; 3] && close(reflected, [0.5, 0.8, 0.9999]), "{reflected:?}");
    let given = plain("Material \"conductor\" \"spectrum eta\" [ 300 2 800 2 ] \"spectrum k\" [ 300 3 800 3 ]");
    let MaterialFile::Conductor { eta, k, .. } = given else { panic!("{given:?}") };
    assert!(eta.iter().all(|n| (n - 2.0).abs() < 0.02) && k.iter().all(|k| (k - 3.0).abs() < 0.02), "{eta:?} {k:?}");
    // The spectra that v3's scenes bring along are known where they are missing.
    let file = plain(
        "Material \"metal\" \"spectrum eta\" \"spds/Au.eta.spd\" \"spectrum k\" \"spds/Au.k.spd\" \"float roughness\" 0",
    );
    assert!(matches!(file, MaterialFile::Conductor { eta: [0.143036, ..], .. }), "{file:?}");
    let coated = related("Material \"coatedconductor\"", "mirror");
    let MaterialFile::Blend { weight, materials } = coated else { panic!("{coated:?}") };
    assert!(close(
        [weight.clone()].map(|w| if let TextureFile::Rgb { value } = w { value } else { [0.0; 3] })[0],
        [0.04; 3]
    ));
    assert!(materials.iter().all(|part| matches!(part, MaterialFile::Conductor { .. })));
}

#[test]
fn relations() {
    let sheet = "Material \"diffusetransmission\" \"rgb transmittance\" [ .2 .4 .8 ] \"float scale\" .5";
    let [reflectance, transmittance] = [[0.125; 3], [0.1, 0.2, 0.4]].map(TextureFile::rgb);
    assert_eq!(plain(sheet), MaterialFile::Translucent { reflectance, transmittance });
    let skin = related("Material \"subsurface\" \"string name\" \"Skin1\"", "diffuse base");
    let MaterialFile::Plastic { diffuse_reflectance: TextureFile::Rgb { value: [r, g, b] }, .. } = skin else {
        panic!("{skin:?}")
    };
    assert!(r > g && g > b && r < 1.0 && b > 0.05, "{r} {g} {b}");
    let hair = related("Material \"hair\" \"float eumelanin\" .3", "coat");
    let MaterialFile::Plastic { diffuse_reflectance: TextureFile::Rgb { value: [r, g, b] }, .. } = hair else {
        panic!("{hair:?}")
    };
    assert!(r > g && g > b);
    related("Material \"measured\" \"string filename\" \"a.bsdf\"", "plastic");
    related("Material \"coateddiffuse\" \"float uroughness\" .1 \"float vroughness\" .2", "anisotropic");
    related("Material \"dielectric\" \"float oughness\" .1", "\"roughness\" seems to be meant");
}

#[test]
fn surfaces_of_v3() {
    assert_eq!(plain("Material \"matte\" \"color Kd\" [ .2 .2 .2 ]"), MaterialFile::Diffuse { reflectance: rgb(0.2) });
    let rough = plain("Material \"matte\" \"float sigma\" 30");
    assert!(matches!(rough, MaterialFile::RoughDiffuse { qualitative: true, .. }), "{rough:?}");
    assert_eq!(
        plain("Material \"mirror\""),
        MaterialFile::Conductor { eta: [0.0; 3], k: [1.0; 3], specular_reflectance: rgb(0.9) }
    );
    assert_eq!(
        plain("Material \"glass\" \"float index\" 1.6"),
        MaterialFile::Dielectric { int_ior: 1.6, ext_ior: 1.0 }
    );
    assert!(matches!(plain("Material \"glass\" \"rgb Kt\" [ 0 1 0 ]"), MaterialFile::Tinted { .. }));
    assert!(matches!(related("Material \"plastic\"", "\"plastic\""), MaterialFile::Plastic { .. }));
    let MaterialFile::Plastic { int_ior, .. } = related("Material \"substrate\" \"rgb Ks\" [ .04 .04 .04 ]", "coat")
    else {
        panic!("plastic")
    };
    assert!((int_ior - 1.5).abs() < 1e-5, "{int_ior}");
    assert!(matches!(related("Material \"uber\"", "strongest"), MaterialFile::Plastic { .. }));
    assert!(matches!(related("Material \"uber\" \"rgb Kt\" [ 1 1 1 ]", "strongest"), MaterialFile::Tinted { .. }));
    assert!(matches!(
        related("Material \"uber\" \"rgb opacity\" [ .5 .5 .5 ]", "strongest"),
        MaterialFile::Mask { .. }
    ));
    let sheet = related("Material \"translucent\" \"rgb Kd\" [ .5 .5 .5 ] \"rgb transmit\" [ 1 1 1 ]", "without gloss");
    assert_eq!(sheet, MaterialFile::Translucent { reflectance: rgb(0.25), transmittance: rgb(0.5) });
    let MaterialFile::Principled(disney) =
        related("Material \"disney\" \"float metallic\" .3 \"float sheen\" .2", "disney")
    else {
        panic!("principled")
    };
    assert_eq!((disney.metallic, disney.sheen), (rgb(0.3), 0.2));
    // The roughness of v3 is remapped in another way.
    let folder = folder();
    let text = "Film \"image\" WorldBegin Material \"metal\" \"float roughness\" .1 Shape \"sphere\" WorldEnd";
    let file = load_text(folder.path(), text).unwrap().file;
    let MaterialFile::TwoSided { material } = only(&file) else { panic!("two sides") };
    let MaterialFile::RoughConductor { alpha, .. } = **material else { panic!("{material:?}") };
    assert!((alpha - 0.46176).abs() < 1e-3, "{alpha}");
}

/// What was set between TransformBegin and TransformEnd ends with them in v4; in v3 only transforms do.
#[test]
fn blocks_of_transforms() {
    let text = "WorldBegin TransformBegin Material \"mirror\" TransformEnd Shape \"sphere\" WorldEnd";
    let folder = folder();
    let of = |film: &str| {
        let file = load_text(folder.path(), &format!("{film} {text}")).unwrap().file;
        only(&file).innermost().clone()
    };
    assert!(matches!(of("Film \"rgb\""), MaterialFile::Diffuse { .. }));
    assert!(matches!(of("Film \"image\""), MaterialFile::Conductor { .. }));
}

/// A relief is the same from both sides: its map is outside of what makes the material two-sided.
#[test]
fn reliefs_have_two_sides() {
    let file = quiet("Material \"diffuse\" \"string normalmap\" \"grey.png\" Shape \"sphere\"");
    let MaterialFile::NormalMap { material, .. } = only(&file) else { panic!("{:?}", only(&file)) };
    assert!(matches!(**material, MaterialFile::TwoSided { .. }), "{material:?}");
}

#[test]
fn names() {
    // A name may be used before it is made; one that is made again is another material.
    let file = quiet(
        "NamedMaterial \"a\" Shape \"sphere\" MakeNamedMaterial \"a\" \"string type\" \"diffuse\" \"rgb reflectance\" [ 1 1 1 ]\n\
         NamedMaterial \"a\" Shape \"sphere\" MakeNamedMaterial \"a\" \"string type\" \"dielectric\" NamedMaterial \"a\" Shape \"sphere\"",
    );
    assert_eq!(file.shapes[0].material, file.shapes[1].material);
    assert!(matches!(file.materials[&file.shapes[2].material], MaterialFile::Dielectric { .. }));
    let twice = "Attribute \"material\" \"float roughness\" .81";
    let file = quiet(&format!(
        "{twice} Attribute \"material\" \"float roughness\" .25 Material \"dielectric\" Shape \"sphere\""
    ));
    assert!(matches!(only(&file), MaterialFile::RoughDielectric { alpha: 0.5, .. }));
    for (text, words) in [
        ("NamedMaterial \"x\" Shape \"sphere\"", "no material \"x\""),
        ("MakeNamedMaterial \"x\" \"float eta\" 1", "string type"),
        ("Material \"clay\"", "coateddiffuse"),
        ("Material \"dielectric\" \"spectrum eta\" \"glass-BK8\"", "glass-BK7"),
        ("Material \"mix\" \"string materials\" [ \"a\" \"b\" ]", "no material \"a\""),
        ("Material \"diffuse\" \"texture reflectance\" \"x\"", "no texture \"x\""),
    ] {
        let folder = folder();
        let error = load_text(folder.path(), &format!("WorldBegin\n{text}")).expect_err(text).to_string();
        assert!(error.contains(words) && error.contains("tested.pbrt:2"), "{error}");
    }
}

#[test]
fn mixtures() {
    let two = "MakeNamedMaterial \"a\" \"string type\" \"diffuse\" MakeNamedMaterial \"b\" \"string type\" \"dielectric\"\n\
        MakeNamedMaterial \"n\" \"string type\" \"interface\"";
    let mixed = |text: &str| plain(&format!("{two} Material \"mix\" {text}"));
    let MaterialFile::Blend { weight, materials } = mixed("\"string materials\" [ \"a\" \"b\" ] \"float amount\" .25")
    else {
        panic!("a blend")
    };
    assert_eq!(weight, rgb(0.25));
    assert!(materials[0].is_two_sided() && matches!(materials[1], MaterialFile::Dielectric { .. }));
    let MaterialFile::Blend { materials, .. } =
        mixed("\"string namedmaterial1\" \"a\" \"string namedmaterial2\" \"b\" \"float amount\" .25")
    else {
        panic!("a blend")
    };
    assert!(materials[1].is_two_sided(), "v3 has the amount of the first");
    let holes = MaterialFile::Mask { opacity: rgb(0.75), material: Box::new(two_sided(0.5)) };
    assert_eq!(mixed("\"string materials\" [ \"a\" \"n\" ] \"float amount\" .25"), holes);
    assert_eq!(mixed("\"string materials\" [ \"n\" \"a\" ] \"float amount\" .75"), holes);
    // Materials may be made after they are mixed, but not of themselves.
    let file = quiet(&format!(
        "MakeNamedMaterial \"m\" \"string type\" \"mix\" \"string materials\" [ \"a\" \"b\" ] {two} NamedMaterial \"m\" Shape \"sphere\""
    ));
    assert!(matches!(only(&file), MaterialFile::Blend { .. }));
    let folder = folder();
    let circle = "WorldBegin MakeNamedMaterial \"m\" \"string type\" \"mix\" \"string materials\" [ \"m\" \"m\" ]";
    assert!(load_text(folder.path(), circle).unwrap_err().to_string().contains("more than 8 deep"));
}

fn two_sided(value: f32) -> MaterialFile {
    MaterialFile::TwoSided { material: Box::new(MaterialFile::Diffuse { reflectance: rgb(value) }) }
}

#[test]
fn holes_and_bumps() {
    let mask = |file: &SceneFile| match only(file) {
        MaterialFile::Mask { opacity, .. } => opacity.clone(),
        other => panic!("{other:?}"),
    };
    assert_eq!(mask(&quiet("Shape \"sphere\" \"float alpha\" .25")), rgb(0.25));
    assert!(matches!(only(&quiet("Shape \"sphere\" \"float alpha\" 1")), MaterialFile::TwoSided { .. }));
    let textured = "Texture \"t\" \"float\" \"imagemap\" \"string filename\" \"grey.png\"";
    assert!(matches!(
        mask(&quiet(&format!("{textured} Shape \"sphere\" \"texture alpha\" \"t\""))),
        TextureFile::Bitmap { .. }
    ));
    // Of a lamp they leave nothing to be seen but its light, or they are left out.
    let lamp = |alpha: f32| {
        format!("AreaLightSource \"diffuse\" \"rgb L\" [ 1 2 3 ] Shape \"sphere\" \"float alpha\" {alpha}")
    };
    let lamps = [(quiet(&lamp(0.0)), true), (warned(&lamp(0.5), "has no holes"), false), (quiet(&lamp(1.0)), false)];
    for (file, unseen) in &lamps {
        assert_eq!((file.shapes[0].unseen, file.shapes[0].emission), (*unseen, Some([1., 2., 3.])));
    }
    assert_eq!(only(&lamps[0].0), only(&lamps[2].0));
    assert!(!quiet("Shape \"sphere\" \"float alpha\" 0").shapes[0].unseen);
    // Shapes with the same holes share their material.
    let file = quiet("Shape \"sphere\" \"float alpha\" .25 Shape \"disk\" \"float alpha\" .25");
    assert_eq!(file.shapes[0].material, file.shapes[1].material);
    warned("Material \"uber\" \"rgb opacity\" [ .5 .5 .5 ] Shape \"sphere\" \"float alpha\" .25", "holes in holes");
    let MaterialFile::BumpMap { scale: 1.0, .. } =
        plain(&format!("{textured} Material \"diffuse\" \"texture displacement\" \"t\""))
    else {
        panic!("a bump")
    };
    let MaterialFile::NormalMap { texture, .. } = plain("Material \"dielectric\" \"string normalmap\" \"grey.png\"")
    else {
        panic!("a normal map")
    };
    assert!(matches!(texture, TextureFile::Bitmap { raw: true, to_uv: [1., 0., 0., 0., -1., 1., 0., 0., 1.], .. }));
    let loaded = world(&format!("{textured} Material \"diffuse\" \"texture displacement\" \"t\" Shape \"sphere\""));
    assert!(loaded.images.contains_key("grey.png"));
}
