//! Denoising of finished pictures by Intel's Open Image Denoise, a shared library that is loaded at run time.
//!
//! The network gets the picture with its features, albedo and normal of what each pixel shows, which are taken to have no noise of
//! their own (`cleanAux`). Measured on four scenes, that is as good as denoising the features first, at a third of the time.

#[allow(unsafe_code, reason = "calls of a C library; every pointer is to a slice whose length is checked")]
mod oidn;

use std::ffi::OsStr;
use std::path::PathBuf;
use std::time::Instant;

use glam::Vec3;

use crate::base::{Error, Result};
use crate::picture::Image;
use oidn::Device;

/// Environment variable that names the library; it takes precedence over the usual places.
pub const LIBRARY_VARIABLE: &str = "OIDN_DYLIB_PATH";
/// Names of the library where the system looks for libraries.
const NAMES: &[&str] = if cfg!(target_os = "windows") {
    &["OpenImageDenoise.dll"]
} else if cfg!(target_os = "macos") {
    &["libOpenImageDenoise.2.dylib", "libOpenImageDenoise.dylib"]
} else {
    &["libOpenImageDenoise.so.2", "libOpenImageDenoise.so"]
};
/// Pixels that the picture is continued by on every side, mirrored: the network takes what lies outside for black, which would show
/// at the border.
const MARGIN: usize = 8;

/// What each pixel shows, averaged over its samples: features that hardly have noise.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Features {
    /// Reflectance in [0, 1]; 0 where nothing is seen.
    pub albedo: Vec<Vec3>,
    /// Shading normal in the world on the side that is seen, of length 1 at most; 0 where nothing is seen.
    pub normal: Vec<Vec3>,
}

/// Takes the noise out of pictures.
pub struct Denoiser {
    device: Device,
}

fn fail(message: String) -> Error {
    Error::Backend { backend: "oidn", message }
}

fn missing(problem: &str) -> Error {
    if cfg!(target_env = "musl") {
        return fail(
            "this build of the program runs on every Linux, but can load no libraries: denoise with that of the Python package or of \
             `cargo install`, or leave --denoise out"
                .into(),
        );
    }
    fail(format!(
        "{problem}. Install the shared libraries of Open Image Denoise 2 (they are also in the Python package `pyoidn`, folder oidn/lib) \
         and set {LIBRARY_VARIABLE} to the path of {}, or leave --denoise out",
        NAMES[0]
    ))
}

impl Denoiser {
    /// Loads the library that [`LIBRARY_VARIABLE`] names, or else one beside the program, or else the system's. Uses as many threads
    /// as the pool that this is called in.
    ///
    /// # Errors
    /// [`Error::Backend`] that says how to get the library where it is missing, of another version, or fails.
    pub fn new() -> Result<Self> {
        match std::env::var_os(LIBRARY_VARIABLE).filter(|path| !path.is_empty()) {
            Some(path) => Self::load(&path),
            None => Self::found(),
        }
    }

    /// As [`Denoiser::new`] with the library at a path, or of a name that the system looks up.
    ///
    /// # Errors
    /// As [`Denoiser::new`].
    pub fn load(library: &OsStr) -> Result<Self> {
        let named = |problem: String| {
            let path = library.display().to_string();
            // The system's own words often begin with it.
            missing(&if problem.contains(&path) { problem } else { format!("{path}: {problem}") })
        };
        let device = Device::load(library, rayon::current_num_threads()).map_err(named)?;
        match device.version() / 10_000 {
            2 => Ok(Self { device }),
            other => Err(named(format!("this is version {other} of Open Image Denoise, version 2 is needed"))),
        }
    }

    /// The first library of the usual names that loads.
    fn found() -> Result<Self> {
        let beside = std::env::current_exe().ok().and_then(|program| Some(program.parent()?.join(NAMES[0])));
        let names = beside.filter(|path| path.is_file()).into_iter().chain(NAMES.iter().map(PathBuf::from));
        let mut loaded = names.map(|name| Self::load(name.as_os_str()));
        loaded.find_map(Result::ok).ok_or_else(|| missing("no library of Open Image Denoise was found"))
    }

    /// Name and version of the library, for example `oidn 2.3.3`.
    pub fn name(&self) -> String {
        let version = self.device.version();
        format!("oidn {}.{}.{}", version / 10_000, version / 100 % 100, version % 100)
    }

    /// Seconds that a pixel takes on this machine, measured with a small picture, which takes some hundredths of a second.
    ///
    /// # Errors
    /// As [`Denoiser::denoise`].
    pub fn seconds_per_pixel(&self) -> Result<f64> {
        const SIDE: usize = 64;
        let grey = vec![Vec3::splat(0.5); SIDE * SIDE];
        let image = Image { width: SIDE, height: SIDE, pixels: grey.clone() };
        let features = Features { albedo: grey.clone(), normal: grey };
        // The first time it makes ready, which is not to be counted as if it grew with the pixels.
        self.denoise(&image, &features)?;
        let begun = Instant::now();
        self.denoise(&image, &features)?;
        Ok(begun.elapsed().as_secs_f64() / ((SIDE + 2 * MARGIN) as f64).powi(2))
    }

    /// A picture of linear radiance without its noise. What is not finite, in the picture and its features, counts as 0.
    ///
    /// # Errors
    /// [`Error::Options`] where picture and features differ in size, [`Error::Backend`] where the library fails.
    pub fn denoise(&self, image: &Image, features: &Features) -> Result<Image> {
        let (size, pixels) = ([image.width, image.height], image.pixels.len());
        let fits = pixels == features.albedo.len() && pixels == features.normal.len();
        if pixels == 0 || image.width.checked_mul(image.height) != Some(pixels) || !fits {
            return Err(Error::Options("a picture is denoised with features of its own size".into()));
        }
        let finite = |v: Vec3| Vec3::select(v.is_finite_mask(), v, Vec3::ZERO);
        let color = continued(&image.pixels, size, |pixel| finite(pixel).max(Vec3::ZERO));
        let albedo = continued(&features.albedo, size, |albedo| finite(albedo).clamp(Vec3::ZERO, Vec3::ONE));
        let normal = continued(&features.normal, size, finite);
        let mut output = vec![Vec3::ZERO; color.len()];
        let inputs = [(c"color", &*color), (c"albedo", &*albedo), (c"normal", &*normal)];
        let outer = size.map(|side| side + 2 * MARGIN);
        self.device.filter(outer, &inputs, &[c"hdr", c"cleanAux"], &mut output).map_err(fail)?;
        let rows = output.chunks_exact(outer[0]).skip(MARGIN).take(image.height);
        let pixels = rows.flat_map(|row| &row[MARGIN..MARGIN + image.width]).copied().collect();
        Ok(Image { pixels, ..*image })
    }
}

/// A picture with values changed by `f` and continued by [`MARGIN`] pixels on every side, mirrored there, and again where it is too
/// small for that.
fn continued(pixels: &[Vec3], [width, height]: [usize; 2], f: impl Fn(Vec3) -> Vec3) -> Vec<Vec3> {
    let inside = |side: usize| {
        (0..side + 2 * MARGIN).map(move |i| {
            // Counted from a mirror image that lies before all that is asked for.
            let place = (i + 2 * side * MARGIN - MARGIN) % (2 * side);
            place.min(2 * side - 1 - place)
        })
    };
    inside(height).flat_map(|y| inside(width).map(move |x| (x, y))).map(|(x, y)| f(pixels[y * width + x])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_continued_as_in_a_mirror() {
        let pixels: Vec<Vec3> = (0..6).map(|i| Vec3::new(i as f32, 0.0, 0.0)).collect();
        let outer = continued(&pixels, [3, 2], |pixel| pixel);
        let width = 3 + 2 * MARGIN;
        assert_eq!(outer.len(), width * (2 + 2 * MARGIN));
        let row = |y: usize| outer[(MARGIN + y) * width..][..width].iter().map(|v| v.x as u32).collect::<Vec<_>>();
        assert_eq!(row(0), [1, 0, 0, 1, 2, 2, 1, 0, 0, 1, 2, 2, 1, 0, 0, 1, 2, 2, 1]);
        assert_eq!(row(1), row(0).iter().map(|x| x + 3).collect::<Vec<_>>());
        assert_eq!(outer[..width], outer[(MARGIN + 4) * width..][..width], "two heights on, rows repeat");
    }

    #[test]
    fn what_is_no_library_is_an_error_that_says_how_to_get_one() {
        let folder = tempfile::tempdir().unwrap();
        let text = folder.path().join("libOpenImageDenoise.so.2");
        std::fs::write(&text, "no library").unwrap();
        for path in [text, folder.path().join("nothing"), folder.path().to_owned()] {
            let Err(Error::Backend { backend: "oidn", message }) = Denoiser::load(path.as_os_str()) else {
                panic!("{} was loaded", path.display())
            };
            for word in [LIBRARY_VARIABLE, "pyoidn", &path.display().to_string()] {
                assert!(message.contains(word), "{message}");
            }
        }
    }
}
