//! Camera, film, sampler, integrator, and what sets them.

use fanal::base::Error;
use fanal::scene::file::{FilterFile, LightFile, SceneFile};
use fanal::scene::readers::LoadedScene;

use super::{close, folder, load_text, warned};

/// What is loaded of a scene with this frame and an empty world.
fn framed(frame: &str) -> Result<LoadedScene, Error> {
    let folder = folder();
    load_text(folder.path(), &format!("{frame}\nWorldBegin\nLightSource \"point\"\n"))
}

fn frame(text: &str) -> SceneFile {
    framed(text).unwrap_or_else(|error| panic!("{text}: {error}")).file
}

/// The field of view is that of the shorter side, ours that of the width.
#[test]
fn fields_of_view() {
    let half = |degrees: f64| (degrees.to_radians() / 2.0).tan();
    for (film, camera, tangent) in [
        ([200, 100], "\"float fov\" 60", 2.0 * half(60.0)),
        ([100, 200], "\"float fov\" 60", half(60.0)),
        ([100, 100], "", 1.0),
        ([200, 100], "\"float fov\" 60 \"float screenwindow\" [ -2 1 -.5 1 ]", 1.5 * half(60.0)),
        ([200, 100], "\"float frameaspectratio\" 2", 2.0),
        ([200, 100], "\"float halffov\" 45", 2.0),
    ] {
        let [width, height] = film;
        let film = format!("Film \"rgb\" \"integer xresolution\" {width} \"integer yresolution\" {height}");
        let camera = format!("Camera \"perspective\" {camera}");
        // The film may come before the camera or after it.
        for text in [format!("{film}\n{camera}"), format!("{camera}\n{film}")] {
            let file = frame(&text);
            let found = half(f64::from(file.camera.fov));
            assert!((found - tangent).abs() < 1e-5 * tangent, "{text}: {found} {tangent}");
        }
    }
    let shifted = frame("Camera \"perspective\" \"float screenwindow\" [ -1 3 0 2.25 ]");
    assert_eq!(shifted.camera.principal_point_offset, [0.25, -0.5]);
    let lens = frame("Camera \"perspective\" \"float lensradius\" .1 \"float focaldistance\" 3").camera;
    assert_eq!((lens.aperture_radius, lens.focus_distance), (0.1, Some(3.0)));
    let flat = frame("Scale .5 .5 .5 Camera \"orthographic\" \"float screenwindow\" [ -1 3 0 2.25 ]").camera;
    assert_eq!((flat.orthographic_width, flat.principal_point_offset), (Some(4.0), [0.25, -0.5]));
    assert_eq!(flat.to_world[5], 2.0, "the window is as large as the camera's transform makes it");
    // Of a film with a window only that is rendered, by a camera that sees no more.
    let film = "Film \"rgb\" \"integer xresolution\" 200 \"integer yresolution\" 100";
    for window in ["\"float cropwindow\" [ .5 1 0 .5 ]", "\"integer pixelbounds\" [ 100 200 0 50 ]"] {
        let part = frame(&format!("{film} {window} Camera \"perspective\" \"float fov\" 60"));
        assert_eq!([part.film.width, part.film.height], [100, 50]);
        assert!((half(f64::from(part.camera.fov)) - half(60.0)).abs() < 1e-5);
        assert_eq!(part.camera.principal_point_offset, [0.5, -0.5]);
    }
    // The ends in any order; parts of the sides come before pixels.
    let turned = "\"float cropwindow\" [ 1 .5 .5 0 ] \"integer pixelbounds\" [ 0 10 0 10 ]";
    let part = frame(&format!("{film} {turned} Camera \"perspective\""));
    assert_eq!([part.film.width, part.film.height], [100, 50]);
    assert!(framed(&format!("{film} \"float cropwindow\" [ 1 2 0 1 ]")).unwrap_err().to_string().contains("inside"));
    for (camera, words) in [
        ("\"spherical\"", "supported: perspective, orthographic"),
        ("\"orthographic\" \"float screenwindow\" [ 0 0 0 1 ]", "area"),
        ("\"perspective\" \"float fov\" 180", "field of view"),
        ("\"perspective\" \"float screenwindow\" [ 1 0 0 1 ]", "area"),
        ("\"perspective\" \"float screenwindow\" [ 1 0 ]", "four numbers"),
    ] {
        let error = framed(&format!("Camera {camera}")).unwrap_err().to_string();
        assert!(error.contains(words) && error.contains("tested.pbrt:1"), "{error}");
    }
    assert!(framed("Scale 0 1 1 Camera \"perspective\"").unwrap_err().to_string().contains("flattens"));
}

#[test]
fn films_filters_and_counts() {
    let filter = |text: &str| frame(text).film.filter;
    assert_eq!(filter(""), FilterFile::Gaussian { stddev: 0.5, radius: Some(1.5) });
    assert_eq!(filter("PixelFilter \"box\" \"float xradius\" 1 \"float yradius\" 1"), FilterFile::Box { radius: 1.0 });
    assert_eq!(filter("PixelFilter \"triangle\""), FilterFile::Tent { radius: 2.0 });
    let narrow = FilterFile::Gaussian { stddev: 0.25, radius: Some(1.0) };
    assert_eq!(filter("PixelFilter \"gaussian\" \"float sigma\" .25 \"float xradius\" 1 \"float yradius\" 1"), narrow);
    for kind in ["mitchell", "sinc"] {
        assert_eq!(filter(&format!("PixelFilter \"{kind}\" \"float xradius\" 3")), FilterFile::GAUSSIAN);
    }
    assert_eq!(filter("Film \"image\""), FilterFile::default(), "v3");
    assert_eq!(filter("PixelFilter \"triangle\" Film \"image\""), FilterFile::Tent { radius: 2.0 });
    let render = |text: &str| frame(text).render;
    assert_eq!((render("").max_depth, render("Sampler \"sobol\"").spp), (6, 16));
    assert_eq!(render("Integrator \"path\" \"integer maxdepth\" 0").max_depth, 1);
    assert_eq!(render("Sampler \"stratified\" \"integer xsamples\" 3 \"integer ysamples\" 5").spp, 15);
    for text in [
        "PixelFilter \"lanczos\"",
        "Sampler \"sobol\" \"integer pixelsamples\" 0",
        "Integrator \"path\" \"integer maxdepth\" -2",
    ] {
        framed(text).expect_err(text);
    }
    for (text, words) in [
        ("Film \"rgb\" \"string sensor\" \"canon_eos_5d\"", "canon_eos_5d"),
        ("Film \"rgb\" \"float whitebalance\" 5000", "white balance"),
        ("Integrator \"ambientocclusion\"", "ambientocclusion"),
        ("PixelFilter \"sinc\"", "Gaussian"),
        ("Option \"bool disablepixeljitter\" true", "Option"),
        ("ActiveTransform EndTime Translate 1 0 0 ActiveTransform All", "motion"),
        ("Camera \"realistic\" \"string lensfile\" \"wide.dat\"", "lens"),
        ("Accelerator \"bvh\" Film \"rgb\" \"integer xresolutoin\" 3", "\"xresolution\" seems to be meant"),
    ] {
        let warnings = framed(text).unwrap_or_else(|error| panic!("{text}: {error}")).warnings;
        assert!(warnings.iter().any(|warning| warning.contains(words)), "{text}: {warnings:?}");
    }
}

/// All light is multiplied by what exposure time and sensitivity make of radiance 1.
#[test]
fn exposure() {
    for (text, factor) in [
        ("", 1.0),
        ("Film \"rgb\" \"float iso\" 200", 2.0),
        ("Film \"rgb\" \"float iso\" 50 \"float exposuretime\" .5", 0.25),
        ("Camera \"perspective\" \"float shutteropen\" .25 \"float shutterclose\" .75", 0.5),
        ("Film \"image\" \"float scale\" 3 Camera \"perspective\" \"float shutterclose\" .5", 3.0),
    ] {
        let LightFile::Point { intensity, .. } = frame(text).lights[0].clone() else { panic!("{text}") };
        assert!(close(intensity, [factor; 3]), "{text}: {intensity:?}");
    }
}

/// The camera's own system, the world's and those of the document.
#[test]
fn coordinate_systems() {
    let folder = folder();
    let text = "Translate 0 0 -3 Camera \"perspective\" CoordinateSystem \"far\" WorldBegin\n\
        AttributeBegin CoordSysTransform \"camera\" LightSource \"point\" AttributeEnd\n\
        AttributeBegin CoordSysTransform \"far\" LightSource \"point\" AttributeEnd\n\
        Translate 1 2 3 CoordSysTransform \"world\" LightSource \"point\"";
    let lights = load_text(folder.path(), text).unwrap().file.lights;
    let positions = lights.iter().map(|light| match light {
        LightFile::Point { position, .. } => *position,
        other => panic!("{other:?}"),
    });
    assert_eq!(positions.collect::<Vec<_>>(), [[0., 0., 3.], [0., 0., -3.], [0., 0., 0.]]);
    warned("CoordSysTransform \"nowhere\" LightSource \"point\"", "\"nowhere\"");
}
