//! glTF: materials, textures, vertex colours, extensions.

use fanal::scene::Scene;
use fanal::scene::file::{Filter, LightFile, MaterialFile, MediumFile, PrincipledFile, TextureFile, Wrap, identity3};
use fanal::scene::readers::LoadedScene;
use glam::Vec3;
use serde_json::{Value, json};

use crate::gltf::{loaded, mesh, refused, warns};
use crate::support::gltf::{Document, png};
use crate::support::scenes;

/// A square of one material.
fn square(material: Value) -> Document {
    let mut document = Document::new();
    let material = document.add("materials", material);
    document.square(Some(material));
    document
}

/// The square's material, after a picture of it was rendered.
fn material(loaded: &LoadedScene) -> MaterialFile {
    let scene = Scene::build(loaded, [3, 2]).unwrap();
    let picture = scenes::picture(&scene, &scenes::settings(scenes::GUIDES[0], 1, 1));
    assert!(picture.pixels.iter().all(|pixel| pixel.is_finite()));
    loaded.file.materials[&loaded.file.shapes[0].material].clone()
}

fn of(document: &Document) -> MaterialFile {
    material(&loaded(document))
}

fn principled(material: &MaterialFile) -> PrincipledFile {
    let MaterialFile::Principled(file) = material.innermost() else { panic!("{material:?}") };
    file.clone()
}

fn rgb(value: [f32; 3]) -> TextureFile {
    TextureFile::rgb(value)
}

/// The pixels of a texture's picture times its scale.
fn pixels(loaded: &LoadedScene, texture: &TextureFile) -> Vec<Vec3> {
    let TextureFile::Bitmap { file, raw, scale, .. } = texture else { panic!("{texture:?}") };
    let image = loaded.images[&fanal::scene::readers::image_key(file, *raw)].to_image();
    image.pixels.iter().map(|pixel| *pixel * *scale).collect()
}

fn close(found: &[Vec3], expected: &[[f32; 3]]) {
    assert_eq!(found.len(), expected.len());
    for (a, b) in found.iter().zip(expected) {
        assert!(a.abs_diff_eq(Vec3::from_array(*b), 4e-3), "{found:?}, expected {expected:?}");
    }
}

#[test]
fn factors_and_defaults() {
    let file = principled(&of(&square(json!({}))));
    assert_eq!((&file.base_color, &file.roughness, &file.metallic), (&rgb([1.0; 3]), &rgb([1.0; 3]), &rgb([1.0; 3])));
    let mut bare = Document::new();
    bare.square(None);
    assert_eq!(principled(&of(&bare)), file);
    let given = of(&square(json!({ "pbrMetallicRoughness": {
        "baseColorFactor": [0.1, 0.2, 0.3, 0.4], "roughnessFactor": 0.5, "metallicFactor": 0.0
    } })));
    assert!(matches!(given, MaterialFile::TwoSided { .. }), "opaque whatever its alpha, and seen from both sides");
    let file = principled(&given);
    assert_eq!((file.base_color, file.roughness, file.metallic), (rgb([0.1, 0.2, 0.3]), rgb([0.5; 3]), rgb([0.0; 3])));
    assert_eq!((file.eta, file.spec_trans, file.clearcoat, file.sheen), (1.5, 0.0, 0.0, 0.0));
}

/// Colours are sRGB, data are not; factors multiply, and channels are taken apart.
#[test]
fn textures_and_factors() {
    let mut document = square(json!({}));
    let texture = document.texture(&png(2, &[[188, 0, 255, 255], [0, 128, 255, 255]]));
    document.json["materials"][0] = json!({ "pbrMetallicRoughness": {
        "baseColorTexture": { "index": texture }, "metallicRoughnessTexture": { "index": texture },
        "roughnessFactor": 0.5
    } });
    let found = loaded(&document);
    let file = principled(&material(&found));
    close(&pixels(&found, &file.base_color), &[[0.5029, 0.0, 1.0], [0.0, 0.2159, 1.0]]);
    close(&pixels(&found, &file.roughness), &[[0.0; 3], [0.251; 3]]);
    close(&pixels(&found, &file.metallic), &[[1.0; 3], [1.0; 3]]);
    document.json["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = json!([1.0, 0.5, 0.25, 1.0]);
    let found = loaded(&document);
    close(&pixels(&found, &principled(&material(&found)).base_color), &[[0.5029, 0.0, 0.25], [0.0, 0.108, 0.25]]);
    // The picture's top left is where both texture coordinates are 0.
    assert_eq!(mesh(&found, 0).uvs[3].to_array(), [0.0, 0.0]);
}

#[test]
fn samplers_and_transforms() {
    let mut document = square(json!({}));
    let texture = document.texture(&png(1, &[[9, 9, 9, 255]]));
    let sampler = document.add("samplers", json!({ "wrapS": 33071, "wrapT": 33648, "magFilter": 9728 }));
    document.json["textures"][texture]["sampler"] = json!(sampler);
    let transform = json!({ "offset": [0.5, 0.25], "rotation": std::f32::consts::FRAC_PI_2, "scale": [2.0, 3.0] });
    let info = json!({ "index": texture, "extensions": { "KHR_texture_transform": transform } });
    document.json["materials"][0] = json!({ "pbrMetallicRoughness": { "baseColorTexture": info } });
    document.json["extensionsRequired"] = json!(["KHR_texture_transform"]);
    let found = loaded(&document);
    assert!(warns(&found, "wrapS is used in both directions"));
    let TextureFile::Bitmap { to_uv, wrap, filter, .. } = principled(&material(&found)).base_color else { panic!() };
    assert_eq!((wrap, filter), (Wrap::Clamp, Filter::Nearest));
    // A quarter turn counter-clockwise as seen on the picture takes u to −v.
    let expected = [0.0, 3.0, 0.5, -2.0, 0.0, 0.25, 0.0, 0.0, 1.0];
    assert!(to_uv.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{to_uv:?}");
}

/// The first texture decides on the coordinates; others are replaced by their means.
#[test]
fn other_texture_coordinates() {
    let mut document = square(json!({}));
    let texture = document.texture(&png(2, &[[0, 0, 0, 255], [255, 255, 255, 255]]));
    let second = document.floats(2, &[5., 5., 6., 5., 6., 6., 5., 6.]);
    document.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_1"] = json!(second);
    let at = |set: u32| json!({ "index": texture, "texCoord": set });
    document.json["materials"][0] = json!({
        "pbrMetallicRoughness": { "baseColorTexture": at(1), "metallicRoughnessTexture": at(0) }, "normalTexture": at(0)
    });
    let found = loaded(&document);
    assert!(warns(&found, "roughness cannot vary") && warns(&found, "normalTexture has other"), "{:?}", found.warnings);
    let given = material(&found);
    assert_eq!(principled(&given).roughness, rgb([0.5; 3]));
    assert!(!given.is_bumped() && mesh(&found, 0).uvs[0].to_array() == [5.0, 5.0]);
    document.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = at(7);
    assert!(warns(&loaded(&document), "lacks the texture coordinates"));
}

#[test]
fn holes() {
    let mut document = square(json!({}));
    let texture = document.texture(&png(2, &[[9, 9, 9, 51], [9, 9, 9, 204]]));
    let opacity = |material: MaterialFile| match material {
        MaterialFile::Mask { opacity, .. } => Some(opacity),
        _ => None,
    };
    let mut with = |mode: &str, alpha: f32, textured: bool| {
        let mut base = json!({ "baseColorFactor": [1.0, 1.0, 1.0, alpha] });
        if textured {
            base["baseColorTexture"] = json!({ "index": texture });
        }
        document.json["materials"][0] = json!({ "alphaMode": mode, "alphaCutoff": 0.25, "pbrMetallicRoughness": base });
        let found = loaded(&document);
        let opacity = opacity(material(&found));
        (opacity.clone(), opacity.filter(|o| matches!(o, TextureFile::Bitmap { .. })).map(|o| pixels(&found, &o)))
    };
    assert_eq!(with("OPAQUE", 0.3, true).0, None);
    close(&with("BLEND", 0.5, true).1.unwrap(), &[[0.1; 3], [0.4; 3]]);
    close(&with("MASK", 1.0, true).1.unwrap(), &[[0.0; 3], [1.0; 3]]);
    // The factor counts before the cut.
    close(&with("MASK", 0.3, true).1.unwrap_or_default(), &[[0.0; 3], [0.0; 3]]);
    assert_eq!(with("BLEND", 0.5, false).0, Some(rgb([0.5; 3])));
    assert_eq!((with("MASK", 0.5, false).0, with("MASK", 0.2, false).0), (None, Some(rgb([0.0; 3]))));
    let whole = document.texture(&png(1, &[[9, 9, 9, 255]]));
    document.json["materials"][0] = json!({
        "alphaMode": "BLEND", "pbrMetallicRoughness": { "baseColorTexture": { "index": whole } }
    });
    assert_eq!(opacity(of(&document)), None, "it has no hole");
}

/// Triangles that show pictures mirrored have normal maps whose green is upside down; so has the mesh where its node mirrors it.
#[test]
fn normal_maps() {
    let mut document = square(json!({}));
    let texture = document.texture(&png(1, &[[255, 191, 255, 255]]));
    document.json["materials"][0] = json!({ "normalTexture": { "index": texture, "scale": 1.0 } });
    document.add_node(json!({ "mesh": 0, "scale": [-1.0, 1.0, 1.0] }));
    let found = loaded(&document);
    let map = |loaded: &LoadedScene, shape: usize| {
        let mut inner = &loaded.file.materials[&loaded.file.shapes[shape].material];
        while !matches!(inner, MaterialFile::NormalMap { .. }) {
            inner = inner.inside().expect("a normal map");
        }
        let MaterialFile::NormalMap { texture, .. } = inner else { unreachable!("it is one") };
        pixels(loaded, texture)[0] * 2.0 - 1.0
    };
    material(&found);
    assert!(map(&found, 0).abs_diff_eq(Vec3::new(1.0, 0.498, 1.0), 1e-3), "{}", map(&found, 0));
    let turned = map(&found, 1);
    assert!((turned.y / turned.x + 0.498).abs() < 1e-3 && (turned.z / turned.x - 1.0).abs() < 1e-3, "{turned}");
    let uvs = document.floats(2, &[1., 1., 0., 1., 0., 0., 1., 0.]);
    document.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = json!(uvs);
    document.json["materials"][0]["normalTexture"]["scale"] = json!(0.5);
    let found = loaded(&document);
    let [mirrored, twice] = [map(&found, 0), map(&found, 1)];
    assert!(mirrored.y < 0.0 && twice.y > 0.0 && (mirrored.x / mirrored.z - 0.5).abs() < 1e-3, "{mirrored} {twice}");
    // Pictures that their texture turns around.
    document.json["materials"][0]["normalTexture"]["extensions"] =
        json!({ "KHR_texture_transform": { "scale": [-1.0, -1.0] } });
    let around = map(&loaded(&document), 0);
    assert!((around + mirrored * Vec3::new(1.0, 1.0, -1.0)).length() < 1e-3, "{around} {mirrored}");
    // After a quarter turn up on the picture is along u, and right on it is down on the surface, or up if mirrored.
    document.json["materials"][0]["normalTexture"]["extensions"] = json!({ "KHR_texture_transform": {
        "rotation": std::f32::consts::FRAC_PI_2, "scale": [2.0, 3.0]
    } });
    let found = loaded(&document);
    for (shape, y) in [(0, 0.5), (1, -0.5)] {
        let turned = map(&found, shape);
        assert!((turned / turned.z).abs_diff_eq(Vec3::new(0.249, y, 1.0), 1e-3), "{turned}");
    }
    // A picture drawn out without end has no directions, and one scaled alone is taken as it is.
    for (transform, scale) in [(json!({ "scale": [0.0, 1.0] }), 0.5), (json!({ "scale": [3.0, 7.0] }), 1.0)] {
        document.json["materials"][0]["normalTexture"]["scale"] = json!(scale);
        document.json["materials"][0]["normalTexture"]["extensions"] = json!({ "KHR_texture_transform": transform });
        let straight = map(&loaded(&document), 1);
        assert!((straight / straight.z).abs_diff_eq(Vec3::new(scale, 0.498 * scale, 1.0), 1e-3), "{straight}");
    }
}

/// A texture's light is that of the triangles that it lights.
#[test]
fn emission() {
    let mut document = square(json!({ "emissiveFactor": [0.5, 0.25, 0.0], "doubleSided": true,
        "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": 8.0 } } }));
    let found = loaded(&document);
    assert_eq!((found.file.shapes[0].emission, found.file.lights.len()), (Some([4.0, 2.0, 0.0]), 0));
    assert!(warns(&found, "shines from both sides") && mesh(&found, 0).triangles.len() == 4, "two sheets");
    let texture = document.texture(&png(1, &[[255, 255, 255, 255], [0, 0, 0, 255]]));
    let sampler = document.add("samplers", json!({ "magFilter": 9728, "wrapS": 33071, "wrapT": 33071 }));
    document.json["textures"][texture]["sampler"] = json!(sampler);
    document.json["materials"][0]["emissiveTexture"] = json!({ "index": texture });
    // One triangle lies in the picture's white upper half, the other in the black one.
    let positions = document.floats(3, &[0., 0., 0., 1., 0., 0., 0., 1., 0., 3., 0., 0., 4., 0., 0., 3., 1., 0.]);
    let uvs = document.floats(2, &[0., 0.4, 1., 0.4, 0., 0.1, 0., 0.9, 1., 0.9, 0., 0.6]);
    document.json["meshes"][0]["primitives"][0] =
        json!({ "attributes": { "POSITION": positions, "TEXCOORD_0": uvs }, "material": 0 });
    let found = loaded(&document);
    material(&found);
    let lit: Vec<_> = found.file.shapes.iter().map(|shape| shape.emission).collect();
    assert_eq!(lit, [Some([4.0, 2.0, 0.0]), None]);
    assert_eq!([0, 1].map(|shape| mesh(&found, shape).triangles.len()), [2, 1], "what shines has two sheets");
    assert_eq!(found.file.shapes[0].emission_texture, None, "what shines does so evenly");
    document.json["materials"][0]["emissiveTexture"]["extensions"] =
        json!({ "KHR_texture_transform": { "offset": [0.0, 0.25] } });
    let shape = &loaded(&document).file.shapes[0];
    assert_eq!(shape.emission, Some([4.0, 2.0, 0.0]));
    assert!(matches!(shape.emission_texture, Some(TextureFile::Bitmap { .. })), "{shape:?}");
}

/// A model with a lit display is lit by surroundings as one without; a lamp lights its scene itself.
#[test]
fn what_hardly_shines_has_surroundings() {
    for (strength, white) in [(0.0, true), (0.01, true), (1.0, false)] {
        let found = loaded(&square(json!({ "emissiveFactor": [strength, strength, strength] })));
        let lights = &found.file.lights;
        assert_eq!(matches!(lights[..], [LightFile::Constant { radiance: [1.0, 1.0, 1.0] }]), white, "{strength}");
        assert_eq!(lights.is_empty(), !white, "{lights:?}");
    }
}

#[test]
fn colours_of_vertices() {
    let mut document = square(json!({ "pbrMetallicRoughness": { "baseColorFactor": [0.5, 0.5, 0.5, 1.0] } }));
    let paint = |document: &mut Document, colors: &[f32]| {
        let colors = document.floats(3, colors);
        document.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = json!(colors);
    };
    paint(&mut document, &[0.5; 12]);
    assert_eq!(principled(&of(&document)).base_color, rgb([0.25; 3]));
    // Their alpha is left out, which only counts where the material is not opaque.
    let faded = document.floats(4, &[0.5; 16]);
    document.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = json!(faded);
    assert!(!warns(&loaded(&document), "alpha of COLOR_0"));
    document.json["materials"][0]["alphaMode"] = json!("BLEND");
    assert!(warns(&loaded(&document), "alpha of COLOR_0"));
    document.json["materials"][0]["alphaMode"] = json!("OPAQUE");
    // Without textures the colours are a texture: linear between the corners.
    let corners = [[1., 0., 0.], [0., 1., 0.], [0., 0., 1.], [1., 1., 1.]];
    paint(&mut document, corners.as_flattened());
    let found = loaded(&document);
    let file = principled(&material(&found));
    let texture = fanal::materials::texture::Texture::new(&file.base_color, &found.images).unwrap();
    let painted = mesh(&found, 0);
    for (triangle, of) in painted.triangles.iter().zip([[0, 1, 2], [0, 2, 3]]) {
        for weights in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.2, 0.3, 0.5]] {
            let uv = (0..3).map(|i| painted.uvs[triangle[i] as usize] * weights[i]).sum();
            let expected: Vec3 = (0..3).map(|i| Vec3::from_array(corners[of[i]]) * weights[i] * 0.5).sum();
            assert!(texture.eval(uv).abs_diff_eq(expected, 1e-5), "{weights:?}: {} {expected}", texture.eval(uv));
        }
    }
    // Beside textures their mean.
    let texture = document.texture(&png(1, &[[255, 255, 255, 255]]));
    document.json["materials"][0] = json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": texture } } });
    let found = loaded(&document);
    assert!(warns(&found, "mean of the vertices' colours"));
    close(&pixels(&found, &principled(&material(&found)).base_color), &[[0.5; 3]]);
}

#[test]
fn lobes_of_extensions() {
    let with = |extensions: Value| {
        loaded(&square(json!({
            "pbrMetallicRoughness": { "metallicFactor": 0.0 }, "extensions": extensions
        })))
    };
    let file = |extensions: Value| principled(&material(&with(extensions)));
    assert_eq!(file(json!({ "KHR_materials_ior": { "ior": 1.8 } })).eta, 1.8);
    // A quarter of the usual reflectance, 0.04.
    let eta = file(json!({ "KHR_materials_specular": { "specularFactor": 0.25 } })).eta;
    assert!((((eta - 1.0) / (eta + 1.0)).powi(2) - 0.01).abs() < 1e-6, "{eta}");
    assert!(warns(
        &with(json!({ "KHR_materials_specular": { "specularColorFactor": [1.0, 0.5, 0.0] } })),
        "specularColor"
    ));
    let coated = json!({ "KHR_materials_clearcoat": { "clearcoatFactor": 0.2, "clearcoatRoughnessFactor": 0.1 } });
    assert!(warns(&with(coated.clone()), "clear coat"));
    let coated = file(coated);
    assert!((coated.clearcoat - 0.8).abs() < 1e-6 && (coated.clearcoat_gloss - 0.09 / 0.099).abs() < 1e-5);
    assert_eq!(file(json!({ "KHR_materials_sheen": { "sheenColorFactor": [0.25, 0.5, 0.75] } })).sheen, 0.5);
    // α = 0.25 across the grain, 0.25 + 0.75 · 0.36 = 0.52 along it.
    let grain = json!({ "KHR_materials_anisotropy": { "anisotropyStrength": 0.6, "anisotropyRotation": 0.5 } });
    let brushed = of(&square(json!({ "pbrMetallicRoughness": { "roughnessFactor": 0.5 }, "extensions": grain })));
    let MaterialFile::TwoSided { material: inner } = &brushed else { panic!("two sides") };
    let MaterialFile::Anisotropic { aspect, rotation, .. } = **inner else { panic!("a grain") };
    assert!(
        (aspect - (0.52f32 / 0.25).sqrt()).abs() < 1e-5 && (rotation - 28.6479).abs() < 1e-3,
        "{aspect} {rotation}"
    );
    let TextureFile::Rgb { value: [root, ..] } = principled(&brushed).roughness else { panic!("one roughness") };
    assert!((root.powi(4) - 0.52 * 0.25).abs() < 1e-5, "{root}");
    let unlit = with(json!({ "KHR_materials_unlit": {} }));
    assert!(warns(&unlit, "unlit") && matches!(material(&unlit).innermost(), MaterialFile::Diffuse { .. }));
    assert_eq!(unlit.file.lights, [LightFile::Constant { radiance: [1.0; 3] }]);
    let old = json!({ "KHR_materials_pbrSpecularGlossiness": {
        "diffuseFactor": [0.5, 0.25, 0.0, 1.0], "specularFactor": [0.04, 0.04, 0.04], "glossinessFactor": 0.25
    } });
    assert!(warns(&with(old.clone()), "specular and glossy"));
    let old = file(old);
    assert_eq!((old.base_color, old.roughness, old.metallic), (rgb([0.5, 0.25, 0.0]), rgb([0.75; 3]), rgb([0.0; 3])));
    assert!((old.eta - 1.5).abs() < 1e-5);
    let metal = json!({ "KHR_materials_pbrSpecularGlossiness": { "diffuseFactor": [0.0, 0.0, 0.0, 1.0] } });
    assert_eq!(file(metal).metallic, rgb([1.0; 3]));
    let wrong = square(json!({ "extensions": { "KHR_materials_clearcoat": { "clearcoatFactor": "much" } } }));
    assert!(refused(&wrong, "no number").contains("KHR_materials_clearcoat"));
}

/// A grain turns the other way where triangles show pictures mirrored. Colours of vertices leave the texture coordinates
/// that it is measured by.
#[test]
fn grains_of_mirrored_triangles() {
    let grain = json!({ "KHR_materials_anisotropy": { "anisotropyStrength": 0.6, "anisotropyRotation": 0.5 } });
    let mut document = square(json!({ "pbrMetallicRoughness": { "roughnessFactor": 0.5 }, "extensions": grain }));
    document.add_node(json!({ "mesh": 0, "scale": [-1.0, 1.0, 1.0] }));
    let found = loaded(&document);
    let rotation = |shape: usize| {
        let name = &found.file.shapes[shape].material;
        let MaterialFile::TwoSided { material } = &found.file.materials[name] else { panic!("two sides") };
        let MaterialFile::Anisotropic { rotation, .. } = **material else { panic!("a grain") };
        rotation
    };
    assert!((rotation(0) - 28.6479).abs() < 1e-3 && rotation(1) == -rotation(0), "{} {}", rotation(0), rotation(1));
    let colors = document.floats(3, &[1., 0., 0., 0., 1., 0., 0., 0., 1., 1., 1., 1.]);
    document.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = json!(colors);
    let colored = loaded(&document);
    assert!(warns(&colored, "mean of the vertices' colours"), "{:?}", colored.warnings);
    assert_eq!(mesh(&colored, 0).uvs, mesh(&found, 0).uvs);
    assert_eq!(principled(&material(&colored)).base_color, rgb([0.5; 3]));
}

#[test]
fn glass_is_thin_or_solid() {
    let with = |rough: f32, transmission: f32, volume: Value| {
        let mut document = square(json!({
            "pbrMetallicRoughness": {
                "metallicFactor": 0.0, "roughnessFactor": rough, "baseColorFactor": [0.25, 1.0, 1.0, 1.0]
            },
            "extensions": {
                "KHR_materials_transmission": { "transmissionFactor": transmission }, "KHR_materials_ior": { "ior": 1.4 }
            }
        }));
        if !volume.is_null() {
            document.json["materials"][0]["extensions"]["KHR_materials_volume"] = volume;
        }
        loaded(&document)
    };
    let pane = material(&with(0.0, 1.0, Value::Null));
    let expected = MaterialFile::Tinted {
        specular_reflectance: rgb([1.0; 3]),
        specular_transmittance: rgb([0.25, 1.0, 1.0]),
        material: Box::new(MaterialFile::ThinDielectric { int_ior: 1.4, ext_ior: 1.0 }),
    };
    assert_eq!(pane, expected);
    let MaterialFile::Blend { weight, materials } = material(&with(0.0, 0.5, Value::Null)) else { panic!("a blend") };
    assert_eq!((weight, &materials[1]), (rgb([0.5; 3]), &expected));
    let frosted = with(0.5, 1.0, Value::Null);
    let MaterialFile::PrincipledThin(file) = material(&frosted) else { panic!("{:?}", material(&frosted)) };
    assert_eq!((file.spec_trans, file.roughness, file.eta), (rgb([1.0; 3]), rgb([0.5; 3]), 1.4));
    let volume = json!({ "thicknessFactor": 1.0, "attenuationDistance": 2.0, "attenuationColor": [1.0, 0.5, 0.25] });
    let solid = with(0.0, 1.0, volume.clone());
    let expected = MaterialFile::Tinted {
        specular_reflectance: rgb([1.0; 3]),
        specular_transmittance: rgb([0.5, 1.0, 1.0]),
        material: Box::new(MaterialFile::Dielectric { int_ior: 1.4, ext_ior: 1.0 }),
    };
    assert_eq!(material(&solid), expected);
    let inside = solid.file.shapes[0].interior.as_ref().expect("a medium");
    let MediumFile::Homogeneous { sigma_t, albedo, .. } = solid.file.media[inside] else { panic!("it varies") };
    assert!((sigma_t[1] - 0.5f32.ln() / -2.0).abs() < 1e-6 && sigma_t[0] == 0.0 && albedo == [0.0; 3]);
    let rough = principled(&material(&with(0.3, 0.75, volume)));
    assert_eq!((rough.spec_trans, rough.eta), (0.75, 1.4));
}

#[test]
fn pictures_inside_and_of_other_kinds() {
    let mut document = square(json!({}));
    let jpeg = {
        let mut bytes = std::io::Cursor::new(vec![]);
        image::RgbImage::from_pixel(8, 8, image::Rgb([255, 255, 255]))
            .write_to(&mut bytes, image::ImageFormat::Jpeg)
            .unwrap();
        bytes.into_inner()
    };
    let jpeg = document.texture(&jpeg);
    let inside = "data:image/png;base64,".to_owned()
        + &{
            use base64::Engine;
            base64::engine::general_purpose::STANDARD.encode(png(1, &[[255, 0, 0, 255]]))
        };
    let inside = document.add("images", json!({ "uri": inside }));
    let inside = document.add("textures", json!({ "source": inside }));
    // One whose picture only an extension gives.
    let basis = document.add("textures", json!({ "extensions": { "KHR_texture_basisu": { "source": 0 } } }));
    // And one of a format that is read.
    let webp = document.texture(&{
        let mut bytes = std::io::Cursor::new(vec![]);
        let picture = image::RgbaImage::from_pixel(2, 2, image::Rgba([0, 0, 255, 128]));
        picture.write_to(&mut bytes, image::ImageFormat::WebP).unwrap();
        bytes.into_inner()
    });
    let source = document.json["textures"][webp]["source"].take();
    document.json["textures"][webp] = json!({ "extensions": { "EXT_texture_webp": { "source": source } } });
    let base = |texture: usize| json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": texture } } });
    document.json["materials"][0] = base(jpeg);
    let found = loaded(&document);
    assert!(pixels(&found, &principled(&material(&found)).base_color).iter().all(|p| p.min_element() > 0.97));
    document.json["materials"][0] = base(inside);
    let found = loaded(&document);
    close(&pixels(&found, &principled(&material(&found)).base_color), &[[1.0, 0.0, 0.0]]);
    document.json["materials"][0] = base(webp);
    document.json["extensionsUsed"] = json!(["EXT_texture_webp"]);
    document.json["extensionsRequired"] = json!(["EXT_texture_webp"]);
    let found = loaded(&document);
    assert!(!warns(&found, "webp"), "{:?}", found.warnings);
    close(&pixels(&found, &principled(&material(&found)).base_color), &[[0.0, 0.0, 1.0]; 4]);
    document.json["materials"][0]["alphaMode"] = json!("BLEND");
    let MaterialFile::Mask { opacity, .. } = material(&loaded(&document)) else { panic!("holes by its alpha") };
    close(&pixels(&loaded(&document), &opacity), &[[128.0 / 255.0; 3]; 4]);
    document.json.as_object_mut().unwrap().remove("extensionsRequired");
    document.json["materials"][0] = base(basis);
    document.json["extensionsUsed"] = json!(["KHR_texture_basisu"]);
    let found = loaded(&document);
    assert!(warns(&found, "format of an extension") && warns(&found, "KHR_texture_basisu is left out"));
    assert_eq!(principled(&material(&found)).base_color, rgb([1.0; 3]));
    document.json["extensionsRequired"] = json!(["KHR_texture_basisu", "KHR_draco_mesh_compression"]);
    let message = refused(&document, "not read");
    assert!(message.contains("KHR_draco_mesh_compression, KHR_texture_basisu is not supported"), "{message}");
    assert!(message.contains("KHR_texture_transform"), "{message}");
    let TextureFile::Bitmap { to_uv, .. } = principled(&material(&{
        document.json.as_object_mut().unwrap().remove("extensionsRequired");
        document.json["materials"][0] = base(inside);
        loaded(&document)
    }))
    .base_color
    else {
        panic!("a picture")
    };
    assert_eq!(to_uv, identity3());
}
