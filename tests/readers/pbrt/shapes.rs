//! Shapes, transforms, objects.

use std::io::Write;

use fanal::scene::file::{GeometryFile, MeshFile, SceneFile};
use fanal::scene::readers::{LoadedScene, Missing, load_lacking};
use glam::{Mat4, Vec3};

use super::{folder, load_text, picture, quiet, warned, world};
use crate::support::files;

const QUAD: &str =
    "Shape \"trianglemesh\" \"point3 P\" [ 0 0 0  1 0 0  1 1 0  0 1 0 ] \"integer indices\" [ 0 1 2  0 2 3 ]";

fn matrix(file: &SceneFile, shape: usize) -> Mat4 {
    Mat4::from_cols_array(&file.shapes[shape].to_world).transpose()
}

fn mesh(loaded: &LoadedScene, shape: usize) -> &fanal::geometry::mesh::Mesh {
    let GeometryFile::Mesh { mesh } = &loaded.file.shapes[shape].geometry else { panic!("a mesh is expected") };
    &loaded.meshes[mesh]
}

#[test]
fn every_transform() {
    for (text, expected) in [
        ("Identity", Mat4::IDENTITY),
        ("Translate 1 2 3", Mat4::from_translation(Vec3::new(1., 2., 3.))),
        ("Scale [ 1 -2 3 ]", Mat4::from_scale(Vec3::new(1., -2., 3.))),
        ("Rotate 30 0 2 0", Mat4::from_rotation_y(30f32.to_radians())),
        (
            "Translate 1 2 3 Scale 2 2 2",
            Mat4::from_translation(Vec3::new(1., 2., 3.)) * Mat4::from_scale(Vec3::splat(2.)),
        ),
        (
            "Transform [ 1 0 0 0  0 2 0 0  0 0 3 0  4 5 6 1 ]",
            Mat4::from_translation(Vec3::new(4., 5., 6.)) * Mat4::from_scale(Vec3::new(1., 2., 3.)),
        ),
        (
            "Translate 1 0 0 ConcatTransform [ 2 0 0 0  0 2 0 0  0 0 2 0  0 0 0 1 ]",
            Mat4::from_translation(Vec3::X) * Mat4::from_scale(Vec3::splat(2.)),
        ),
        ("Translate 1 0 0 TransformBegin Scale 9 9 9 TransformEnd", Mat4::from_translation(Vec3::X)),
        ("AttributeBegin Scale 9 9 9 AttributeEnd", Mat4::IDENTITY),
        // World to the camera: what is 3 before it comes to (0, 0, 3).
        ("LookAt 0 0 -3  0 0 0  0 1 0", Mat4::from_translation(Vec3::Z * 3.)),
    ] {
        let file = quiet(&format!("{text} {QUAD}"));
        assert!(matrix(&file, 0).abs_diff_eq(expected, 1e-6), "{text}: {}", matrix(&file, 0));
    }
    for (text, words) in [
        ("Rotate 30 0 0 0", "axis"),
        ("LookAt 0 0 0  0 0 0  0 1 0", "direction"),
        ("LookAt 0 0 0  0 1 0  0 1 0", "direction"),
        ("Transform [ 1 0 0 1  0 1 0 0  0 0 1 0  0 0 0 1 ]", "affine"),
        ("Translate 1 2 \"x\"", "3 numbers"),
        ("Translate 1 2 x", "expected a number"),
        ("AttributeEnd", "AttributeBegin"),
        ("AttributeBegin TransformEnd", "TransformEnd"),
        ("ActiveTransform Never", "StartTime"),
    ] {
        let folder = folder();
        let error = load_text(folder.path(), &format!("WorldBegin\n{text} {QUAD}")).expect_err(text).to_string();
        assert!(error.contains(words) && error.contains("tested.pbrt:2"), "{text}: {error}");
    }
}

/// The front is where the winding says in the object's own space; normals count more, and ReverseOrientation turns both around.
#[test]
fn fronts() {
    let light = "Material \"diffuse\" \"rgb reflectance\" [ 0 0 0 ] AreaLightSource \"diffuse\"";
    let normals = "\"normal N\" [ 0 0 -1  0 0 -1  0 0 -1  0 0 -1 ]";
    let centred = "Translate -.5 -.5 0";
    for (before, after, front) in [
        ("", "", 1.0),
        ("ReverseOrientation", "", -1.0),
        ("Scale 1 1 -1", "", -1.0),
        ("Scale -1 1 1", "", 1.0),
        ("Scale -1 1 1 ReverseOrientation", "", -1.0),
        ("", normals, -1.0),
        ("ReverseOrientation", normals, 1.0),
        ("Scale 1 1 -1", normals, 1.0),
    ] {
        for side in [1.0, -1.0] {
            let folder = folder();
            let frame = "Film \"rgb\" \"integer xresolution\" 1 \"integer yresolution\" 1";
            let camera = format!("LookAt 0 0 {}  0 0 0  0 1 0 Camera \"perspective\" \"float fov\" 5", 3.0 * side);
            let text = format!("{frame} {camera} WorldBegin {light} {before} {centred} {QUAD} {after}");
            let seen = picture(&load_text(folder.path(), &text).unwrap(), 4).pixels[0].x;
            assert_eq!(seen > 0.5, side == front, "{before} {after}, from {side}: {seen}");
        }
    }
}

#[test]
fn spheres_whole_and_in_part() {
    let file = quiet("Translate 1 2 3 Scale 2 2 2 Shape \"sphere\" \"float radius\" .5");
    assert_eq!(file.shapes[0].geometry, GeometryFile::Sphere { center: [0.0; 3], radius: 0.5 });
    assert_eq!(matrix(&file, 0).transform_point3(Vec3::Z), Vec3::new(1., 2., 1.), "its lowest point is where v begins");
    for text in
        ["Scale 1 2 1 Shape \"sphere\"", "Shape \"sphere\" \"float zmin\" 0", "Shape \"sphere\" \"float phimax\" 90"]
    {
        let loaded = world(text);
        let mesh = mesh(&loaded, 0);
        assert_eq!((loaded.skipped_triangles, mesh.normals.len()), (0, mesh.positions.len()), "{text}");
        assert!(mesh.positions.iter().all(|p| (p.length() - 1.0).abs() < 1e-5), "{text}");
        outward(mesh, |p| p);
    }
}

/// Checks that triangles and normals of `mesh` face the way of `front`.
fn outward(mesh: &fanal::geometry::mesh::Mesh, front: impl Fn(Vec3) -> Vec3) {
    assert!(!mesh.triangles.is_empty());
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|i| mesh.positions[i as usize]);
        let (normal, front) = ((b - a).cross(c - a).normalize(), front((a + b + c) / 3.0).normalize());
        assert!(normal.dot(front) > 0.99, "{normal} {front}");
        assert!(triangle.iter().all(|&i| mesh.normals[i as usize].dot(front) > 0.98));
    }
}

#[test]
fn round_shapes() {
    let area = |loaded: &LoadedScene| {
        let mesh = mesh(loaded, 0);
        let corner = |i: u32| mesh.positions[i as usize];
        mesh.triangles.iter().map(|t| t.map(corner)).map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0).sum::<f32>()
    };
    let pi = std::f32::consts::PI;
    let flat = |_: Vec3| Vec3::Z;
    for (text, expected) in [
        ("\"float radius\" 2", 4.0 * pi),
        ("\"float innerradius\" .5", 0.75 * pi),
        ("\"float phimax\" 180 \"float height\" 1", 0.5 * pi),
    ] {
        let loaded = world(&format!("Shape \"disk\" {text}"));
        assert!((area(&loaded) / expected - 1.0).abs() < 1e-3, "{text}: {}", area(&loaded));
        outward(mesh(&loaded, 0), flat);
    }
    let around = |p: Vec3| p.with_z(0.0);
    let loaded = world("Shape \"cylinder\" \"float radius\" .5 \"float zmin\" 0 \"float zmax\" 2");
    assert!((area(&loaded) / (2.0 * pi) - 1.0).abs() < 1e-3);
    outward(mesh(&loaded, 0), around);
    outward(mesh(&world("Shape \"cone\" \"float height\" .001"), 0), |_| Vec3::Z);
    outward(mesh(&world("Shape \"hyperboloid\" \"point3 p1\" [ 1 0 0 ] \"point3 p2\" [ 1 0 1 ]"), 0), around);
    let loaded = world("Shape \"paraboloid\"");
    assert!(mesh(&loaded, 0).positions.iter().all(|p| (p.truncate().length_squared() - p.z).abs() < 1e-5));
    quiet("Shape \"disk\" Shape \"cylinder\" Shape \"cone\" Shape \"paraboloid\" Shape \"sphere\"");
}

#[test]
fn meshes_in_the_document_and_beside_it() {
    let loaded = world(&format!("{QUAD} \"point2 uv\" [ 0 0 1 0 1 1 0 1 ]"));
    assert!(mesh(&loaded, 0).normals.is_empty(), "flat without normals");
    assert_eq!(mesh(&loaded, 0).uvs.len(), 4);
    let single = world("Shape \"trianglemesh\" \"point P\" [ 0 0 0 1 0 0 0 1 0 ] \"float st\" [ 0 0 1 0 0 1 ]");
    assert_eq!((mesh(&single, 0).triangles.len(), mesh(&single, 0).uvs.len()), (1, 3));
    let patch = world("Shape \"bilinearmesh\" \"point3 P\" [ 0 0 0 1 0 0 0 1 0 1 1 0 ]");
    assert_eq!((mesh(&patch, 0).triangles.len(), mesh(&patch, 0).uvs[3].to_array()), (2, [1.0, 1.0]));
    warned("Shape \"bilinearmesh\" \"point3 P\" [ 0 0 0 1 0 0 0 1 0 1 1 1 ]", "not flat");
    let cage = "\"point3 P\" [ 0 0 0 1 0 0 0 1 0 0 0 1 ] \"integer indices\" [ 0 2 1 0 1 3 0 3 2 1 2 3 ]";
    warned(&format!("Shape \"loopsubdiv\" \"integer levels\" 3 {cage}"), "control mesh");
    let smooth = world(&format!("Shape \"loopsubdiv\" {cage}"));
    assert_eq!(mesh(&smooth, 0).normals.len(), 4);
    for left_out in ["heightfield", "nurbs"] {
        let loaded = world(&format!("Shape \"{left_out}\" \"point3 P\" [ 0 0 0 ] ").repeat(3));
        assert!(loaded.file.shapes.is_empty());
        assert!(loaded.warnings[1].ends_with("is left out, and 2 more like it"), "{:?}", loaded.warnings);
        assert_eq!(loaded.warnings.len(), 2);
    }
    for name in ["triangle.ply", "packed.ply.gz"] {
        let folder = folder();
        let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        packed.write_all(&files::ply()).unwrap();
        std::fs::write(folder.path().join("packed.ply.gz"), packed.finish().unwrap()).unwrap();
        let text = format!(
            "WorldBegin Shape \"plymesh\" \"string filename\" \"{name}\" Shape \"plymesh\" \"string filename\" \"{name}\""
        );
        let loaded = load_text(folder.path(), &text).unwrap();
        assert_eq!((loaded.meshes.len(), mesh(&loaded, 1).triangles.len(), mesh(&loaded, 1).normals.len()), (1, 1, 0));
        let MeshFile::Ply { as_given: true, .. } = loaded.file.meshes[name] else { panic!("{:?}", loaded.file.meshes) };
    }
}

/// Curves that are alike are one mesh; every basis and degree is the same curve where its points say the same.
#[test]
fn curves_are_tubes() {
    let curve =
        |points: &str, more: &str| format!("Shape \"curve\" \"point3 P\" [ {points} ] \"float width\" .2 {more} ");
    let bounds = |loaded: &LoadedScene, shape: usize| {
        let positions = &mesh(loaded, shape).positions;
        [Vec3::min, Vec3::max].map(|extreme| positions.iter().copied().reduce(extreme).expect("points"))
    };
    let tubes = |text: &str| {
        let loaded = world(text);
        assert!(loaded.warnings.iter().any(|warning| warning.contains("tubes")), "{:?}", loaded.warnings);
        loaded
    };
    let straight = "0 0 0 1 0 0 2 0 0 3 0 0";
    for (points, more, [first, last]) in [
        (straight, "", [0.0, 3.0]),
        ("0 0 0 1 0 0 2 0 0 3 0 0 4 0 0 5 0 0 6 0 0", "\"string type\" \"cylinder\"", [0.0, 6.0]),
        ("0 0 0 1 0 0 2 0 0", "\"integer degree\" 2", [0.0, 2.0]),
        (straight, "\"string basis\" \"bspline\"", [1.0, 2.0]),
        ("0 0 0 1 0 0 2 0 0", "\"string basis\" \"bspline\" \"integer degree\" 2", [0.5, 1.5]),
    ] {
        let loaded = tubes(&curve(points, more));
        let [low, high] = bounds(&loaded, 0);
        assert!((low.x - first).abs() < 1e-5 && (high.x - last).abs() < 1e-5, "{more}: {low} {high}");
        assert!((0.09..0.11).contains(&high.y), "{high}");
    }
    // A cone, whose width changes along it.
    let [low, high] = bounds(&tubes(&curve(straight, "\"float width0\" 0 \"float width1\" 1")), 0);
    assert!(high.y > 0.45 && low.x.abs() < 0.05, "{low} {high}");
    let one = curve(straight, "");
    let text = format!(
        "{one}{one} Material \"conductor\" {one} AttributeBegin Translate 0 0 5 {one}{one} AttributeEnd \
         ObjectBegin \"hair\" {one}{one} ObjectEnd ObjectInstance \"hair\" ObjectInstance \"hair\""
    );
    let loaded = tubes(&text);
    assert_eq!((loaded.file.shapes.len(), loaded.meshes.len()), (5, 4));
    let mut sizes: Vec<usize> = loaded.meshes.values().map(|mesh| mesh.triangles.len()).collect();
    sizes.sort_unstable();
    assert_eq!(sizes, [1, 2, 2, 2].map(|curves| curves * sizes[0]));
    let along = mesh(&tubes(&one), 0).uvs.iter().map(|uv| uv.x).fold(0.0, f32::max);
    assert_eq!(along, 1.0, "u goes along each curve");
    for (points, more) in [("0 0 0 1 0 0", ""), (straight, "\"integer degree\" 4"), (straight, "\"float width\" -1")] {
        let text = format!(
            "WorldBegin {}",
            curve(points, more)
                .replace("\"float width\" .2", if more.contains("width") { "" } else { "\"float width\" .2" })
        );
        let error = load_text(folder().path(), &text).expect_err(more).to_string();
        assert!(error.contains("tested.pbrt:1") && error.contains("curve"), "{error}");
    }
}

/// Faces of a PLY file with normals are turned to their side, as in the document.
#[test]
fn normals_of_ply_files_turn_faces() {
    let folder = folder();
    let header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nproperty float nx\n\
        property float ny\nproperty float nz\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";
    std::fs::write(folder.path().join("a.ply"), format!("{header}0 0 0 0 0 -1\n1 0 0 0 0 -1\n0 1 0 0 0 -1\n3 0 1 2\n"))
        .unwrap();
    let loaded = load_text(folder.path(), "WorldBegin Shape \"plymesh\" \"string filename\" \"a.ply\"").unwrap();
    assert_eq!(mesh(&loaded, 0).triangles, [[0, 2, 1]]);
}

#[test]
fn objects() {
    let body = format!(
        "ObjectBegin \"pair\" Translate 0 0 1 {QUAD} Shape \"sphere\" ObjectEnd\n\
         AttributeBegin Scale 2 2 2 ObjectInstance \"pair\" AttributeEnd\n\
         AttributeBegin Scale 1 2 1 ReverseOrientation ObjectInstance \"pair\" AttributeEnd"
    );
    let file = quiet(&body);
    assert_eq!(file.shapes.len(), 4);
    assert_eq!(matrix(&file, 0).transform_point3(Vec3::ONE), Vec3::new(2., 2., 4.));
    assert!(matches!(file.shapes[1].geometry, GeometryFile::Sphere { .. }));
    assert!(matches!(file.shapes[3].geometry, GeometryFile::Mesh { .. }), "a sphere that is stretched");
    assert!(file.shapes.iter().all(|shape| !shape.flip_normals));
    assert_eq!(file.shapes[0].geometry, file.shapes[2].geometry, "instances share meshes");
    assert!(file.shapes.iter().all(|shape| shape.name == "pair"), "parts of an object have its name");
    for (text, words) in [
        ("ObjectInstance \"x\"", "no object"),
        ("ObjectBegin \"a\" ObjectBegin \"b\"", "inside the object"),
        ("ObjectBegin \"a\" ObjectInstance \"a\"", "inside the object"),
        ("ObjectEnd", "ObjectBegin"),
    ] {
        let folder = folder();
        let error = load_text(folder.path(), &format!("WorldBegin {text}")).expect_err(text).to_string();
        assert!(error.contains(words), "{error}");
    }
}

/// A mesh that is not there is missed with its place, or does without.
#[test]
fn missing_meshes() {
    let folder = folder();
    let text = "WorldBegin\nShape \"plymesh\" \"string filename\" \"lost.ply\"\nShape \"sphere\"";
    let error = load_text(folder.path(), text).unwrap_err().to_string();
    assert!(error.contains("lost.ply") && error.contains("tested.pbrt:2"), "{error}");
    let loaded = load_lacking(&folder.path().join("tested.pbrt"), &[], Missing::Skip).unwrap();
    assert_eq!((loaded.file.shapes.len(), loaded.missing), (1, vec!["lost.ply".to_owned()]));
}
