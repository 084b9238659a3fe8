//! Guide files: a guiding field on disk, with its [`Evidence`].
//!
//! A safetensors file (see [`crate::base::tensors`]) for C cells, N nodes of their kd-trees, V voxels, and the inner nodes of the
//! voxels' quadtrees:
//!
//! | name | type | shape | |
//! |---|---|---|---|
//! | `grid` | f32 | [5] | origin, side of a cell, 1 where cells are divided by facing |
//! | `cell_keys` | i32 | [C, 3] | position in the grid |
//! | `cell_facing` | u8 | [C] | +x, −x, +y, −y, +z, −z; 6 in media; 0 where cells are not divided by facing |
//! | `cell_roots` | u32 | [C] | the cell's kd-tree |
//! | `node_axis` | u8 | [N] | 3 for a leaf |
//! | `node_position` | f32 | [N] | |
//! | `node_child` | u32 | [N] | the first of two children, or the leaf's voxel |
//! | `bsdf_fraction`, `gain` | f32 | [V] | gain as in [`Evidence`] |
//! | `parallax` | f32 | [V, 4] | centre and curvature, as in [`Parallax`](crate::guiding::cache::parallax::Parallax) |
//! | `effort` | f32 | [V, 2] | probabilities of light sampling and of going on, as in [`AdjointRoulette`] |
//! | `guide_uniform`, `counted_uniform` | f32 | [V] | the uniform part; 0 where there is no tree |
//! | `guide_offset`, `counted_offset` | u64 | [V + 1] | index of each voxel's first node |
//! | `guide_shares`, `counted_shares` | u16 | [.., 4] | where children 1 to 3 begin, of 2¹⁶; a bit for each inner child |
//! | `pixel_values` | f32 | [P] | expected values of the pixels of the picture that it was learned for; missing where they are not known |
//! | `pixel_values_of` | u8 | | that picture as text, see [`PixelValues`] |
//! | `pixel_values_window` | u32 | [4] | columns to the left, rows above, columns, rows |
//! | `made_for` | u8 | | the settings that it was learned with, a line of text each; missing where learning was not all that was done |
//! | `guide_bins` | f32 | [V, 128] | instead of nodes the masses of histograms, zeros for none; missing where there are none |
//! | `guide_lobe_offset` | u64 | [V + 1] | instead of nodes the index of each voxel's first lobe; missing, like the next two, where there are none |
//! | `guide_lobes` | f32 | [.., 6] | mean direction, concentration, weight, inverse distance |
//! | `guide_pivot` | f32 | [V, 4] | where lobes are seen from; 1 where they are of radiance |
//! | `guide_gaussian_offset` | u64 | [V + 1] | instead of nodes the index of each voxel's first Gaussian; missing, like the next, where there are none |
//! | `guide_gaussians` | f32 | [.., 6] | weight, mean, standard deviation, slope, residual deviation |
//!
//! `guide` is the distribution that is sampled (Q_r), `counted` the accumulated one (Q_h).

use std::path::Path;

use super::field::{Evidence, GuideField, PixelValues, VoxelGuide};
use super::roulette::AdjointRoulette;
use crate::base::files::read_bytes;
use crate::base::tensors::{self, Arrays, Dtype, Tensor, Tensors, floats, vector};
use crate::base::{Error, Place, Result, Unfit};
use crate::guiding::cache::arrays::{cache_arrays, read_cache, read_parallax};
use crate::guiding::model::Directions;
use crate::picture::Window;

/// The version of guide files that this program reads.
pub const VERSION: u32 = 3;

/// The version of files in which parts of guides are kept until they are added up, and the name of the array that tells them from guides.
pub const PART_VERSION: u32 = 1;
/// See [`PART_VERSION`].
pub const PART_HEAD: &str = "learned";

/// Largest accepted guide file in bytes.
pub const GUIDE_LIMIT: u64 = 1 << 31;
/// More bytes than the header of any of these files has.
const HEADER_SPACE: u64 = 1 << 20;

/// Name of the array that tells what a guide was learned for.
const MADE_FOR: &str = "made_for";

/// Writes a field and its evidence atomically. Evidence may be empty.
///
/// # Errors
/// [`Error::Io`](crate::base::Error::Io) naming `path`; [`Error::Limit`](crate::base::Error::Limit) for more than [`GUIDE_LIMIT`].
pub fn save(path: &Path, field: &GuideField, evidence: &Evidence) -> Result<()> {
    write(path, VERSION, &arrays(field, evidence))
}

/// The same of what was learned with the settings `made_for`, for [`is_done`].
///
/// # Errors
/// As [`save`].
pub fn save_learned(path: &Path, field: &GuideField, evidence: &Evidence, made_for: &str) -> Result<()> {
    let mut all = arrays(field, evidence);
    all.push((MADE_FOR.into(), Dtype::U8, vec![made_for.len()], made_for.as_bytes().into()));
    write(path, VERSION, &all)
}

/// Whether the file at `path` is a whole guide that was learned with the settings `made_for`.
pub fn is_done(path: &Path, made_for: &str) -> bool {
    let whole = || -> Result<bool> {
        let bytes = read_bytes(path, GUIDE_LIMIT)?;
        let file = Tensors::open(path, &bytes, "guide file", VERSION)?;
        let same = file.has(MADE_FOR) && file.read(MADE_FOR, Dtype::U8, None, 1, |[b]| b)? == made_for.as_bytes();
        Ok(same && from_arrays(&file).is_ok())
    };
    whole().unwrap_or(false)
}

/// Writes a guide or a part of one atomically, unless it would be too large to be read again.
///
/// # Errors
/// As [`save`].
pub fn write(path: &Path, version: u32, arrays: &[Tensor]) -> Result<()> {
    let value = arrays.iter().map(|(.., bytes)| bytes.len() as u64).sum();
    if value > GUIDE_LIMIT - HEADER_SPACE {
        let what = "size in bytes of what was learned (less with --guide-memory)".into();
        return Err(Error::Limit { place: Place::file(path), what, value, limit: GUIDE_LIMIT - HEADER_SPACE });
    }
    tensors::write(path, version, arrays)
}

/// The arrays of a guide file.
pub fn arrays<'a>(field: &GuideField, evidence: &Evidence) -> Vec<Tensor<'a>> {
    let voxels = field.voxels();
    let guides: Vec<Option<&Directions>> = voxels.iter().map(|v| v.directions.as_ref()).collect();
    let counted: Vec<_> = (0..voxels.len()).map(|v| evidence.counted.get(v).and_then(Option::as_ref)).collect();
    let gains = (0..voxels.len()).map(|v| evidence.gain.get(v).copied().unwrap_or(f32::NAN));
    let mut all = cache_arrays(field.cache());
    all.extend(Directions::arrays("guide", &guides));
    all.extend(Directions::arrays("counted", &counted));
    all.extend([
        vector("bsdf_fraction", Dtype::F32, voxels.iter().map(|v| v.bsdf_fraction.to_le_bytes())),
        floats("effort", voxels.iter().map(|v| [v.roulette.light, v.roulette.onward])),
        vector("gain", Dtype::F32, gains.map(f32::to_le_bytes)),
        floats("parallax", voxels.iter().map(|v| v.parallax.to_array())),
    ]);
    all.extend(field.pixel_values().iter().flat_map(|values| pixel_value_arrays(values)));
    all
}

/// The arrays of what is known of a picture.
pub fn pixel_value_arrays<'a>(PixelValues { of, window, values }: &PixelValues) -> [Tensor<'a>; 3] {
    let Window { x, y, width, height } = *window;
    [
        vector("pixel_values", Dtype::F32, values.iter().map(|value| value.to_le_bytes())),
        vector("pixel_values_of", Dtype::U8, of.bytes().map(|byte| [byte])),
        vector("pixel_values_window", Dtype::U32, [x, y, width, height].into_iter().map(u32::to_le_bytes)),
    ]
}

/// What is known of the picture that a guide was learned for; none where the file does not tell.
///
/// # Errors
/// [`Error::Malformed`](crate::base::Error::Malformed) naming the tensor.
pub fn read_pixel_values(file: &Tensors) -> Result<Option<PixelValues>> {
    if !file.has("pixel_values") {
        return Ok(None);
    }
    let values = file.read("pixel_values", Dtype::F32, None, 1, f32::from_le_bytes)?;
    let of = String::from_utf8(file.read("pixel_values_of", Dtype::U8, None, 1, |[byte]| byte)?)
        .or_else(|_| file.fail("pixel_values_of", "this is not text"))?;
    let sides = file.read("pixel_values_window", Dtype::U32, Some(4), 1, u32::from_le_bytes)?;
    let window = Window { x: sides[0], y: sides[1], width: sides[2], height: sides[3] };
    if window.pixels() != values.len() as u64 {
        return file.fail("pixel_values", format!("{} values of {} pixels", values.len(), window.pixels()));
    }
    if let Some(bad) = values.iter().find(|value| !(**value > 0.0 && value.is_finite())) {
        return file.fail("pixel_values", format!("{bad} is not above 0"));
    }
    Ok(Some(PixelValues { of, window, values }))
}

/// Reads a guide file.
///
/// # Errors
/// [`Error::Io`](crate::base::Error::Io); [`Error::Limit`](crate::base::Error::Limit) for a file above [`GUIDE_LIMIT`];
/// [`Error::Unsupported`](crate::base::Error::Unsupported) for another version;
/// [`Error::Parts`] for a part of a guide; [`Error::Malformed`](crate::base::Error::Malformed) naming the tensor for everything else that is
/// wrong with it.
pub fn load(path: &Path) -> Result<(GuideField, Evidence)> {
    let bytes = read_bytes(path, GUIDE_LIMIT)?;
    if Tensors::open(path, &bytes, "part of a guide", PART_VERSION).is_ok_and(|part| part.has(PART_HEAD)) {
        let message =
            format!("{}: this is a part of a guide; `fanal merge` makes a guide of all parts", path.display());
        return Err(Error::Parts { fault: Unfit::Unfinished, files: vec![path.to_owned()], message });
    }
    from_arrays(&Tensors::open(path, &bytes, "guide file", VERSION)?)
}

/// The field and the evidence that the arrays of a file hold.
///
/// # Errors
/// [`Error::Malformed`](crate::base::Error::Malformed) naming the tensor.
pub fn from_arrays(file: &Tensors) -> Result<(GuideField, Evidence)> {
    let cache = read_cache(file)?;
    let voxels = cache.len();
    let floats = |name: &str| file.read(name, Dtype::F32, Some(voxels), 1, f32::from_le_bytes);
    let fractions = floats("bsdf_fraction")?;
    if let Some(bad) = fractions.iter().find(|&&f| !(f > 0.0 && f <= 1.0)) {
        return file.fail("bsdf_fraction", format!("{bad} is not above 0 and at most 1"));
    }
    let guides = Directions::read(file, "guide", voxels)?;
    let counted = Directions::read(file, "counted", voxels)?;
    let efforts = file.read("effort", Dtype::F32, Some(voxels), 2, f32::from_le_bytes)?;
    if let Some(bad) = efforts.iter().find(|e| e.is_nan() || **e < 0.0) {
        return file.fail("effort", format!("{bad} is not 0 or above"));
    }
    let effort = efforts.as_chunks::<2>().0.iter().map(|&[light, onward]| AdjointRoulette { light, onward });
    let parallax = read_parallax(file, "parallax", voxels)?;
    let guide = |(((directions, bsdf_fraction), roulette), parallax)| VoxelGuide {
        directions,
        parallax,
        bsdf_fraction,
        roulette,
    };
    let guides = guides.into_iter().zip(fractions).zip(effort).zip(parallax).map(guide);
    let field = GuideField::new(cache, guides.collect()).with_pixel_values(read_pixel_values(file)?);
    Ok((field, Evidence { counted, gain: floats("gain")? }))
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::base::random::Random;
    use crate::guiding::cache::parallax::Parallax;
    use crate::guiding::cache::{CacheParts, SpatialCache};
    use crate::guiding::tree::distribution::Distribution;
    use crate::guiding::tree::sampler::{Node, SamplingTree};
    use crate::guiding::tree::topology::Topology;

    fn some_field() -> (GuideField, Evidence) {
        let mut random = Random::new(4, 0, 0);
        let mut cache = SpatialCache::new(Vec3::splat(-1.0), 0.5);
        for _ in 0..40 {
            let point = Vec3::new(random.next_f32(), random.next_f32(), random.next_f32());
            cache.find_or_insert(point, point - 0.5);
        }
        cache.split(|v| v % 3 == 0);
        cache.split(|v| v % 2 == 0);
        let shape = || Topology::from_split(&[true, false, true, false, false, false, false, false, false]).unwrap();
        let mut tree = |v: usize| {
            let weights: Vec<f64> = (0..7).map(|_| random.next_f64()).collect();
            (v % 4 != 1).then(|| SamplingTree::new(&Distribution::from_leaf_weights(shape(), &weights), 0.1, 9).into())
        };
        let counted: Vec<_> = (0..cache.len()).map(&mut tree).collect();
        let guides = (0..cache.len())
            .map(|v| VoxelGuide {
                directions: tree(v),
                parallax: Parallax { centre: Vec3::splat(v as f32), curvature: 0.5 },
                bsdf_fraction: 0.25,
                roulette: AdjointRoulette { light: 0.5 * v as f32, onward: f32::INFINITY },
            })
            .collect();
        let gain = (0..cache.len()).map(|v| 1.0 / (1.0 + v as f32)).collect();
        let window = Window { x: 3, y: 2, width: 2, height: 3 };
        let values = PixelValues { of: "a picture".into(), window, values: (1..7u8).map(f32::from).collect() };
        (GuideField::new(cache, guides).with_pixel_values(Some(values)), Evidence { counted, gain })
    }

    /// The field, saved in a folder of its own.
    fn saved() -> (tempfile::TempDir, std::path::PathBuf, GuideField, Evidence) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.guide");
        let (field, evidence) = some_field();
        save(&path, &field, &evidence).unwrap();
        (folder, path, field, evidence)
    }

    #[test]
    fn what_is_loaded_samples_like_what_was_saved() {
        let (_folder, path, field, evidence) = saved();
        let (loaded, found) = load(&path).unwrap();
        assert_eq!(found, evidence);
        assert_eq!((loaded.bytes(), loaded.nodes()), (field.bytes(), field.nodes()));
        let values = loaded.pixel_values().unwrap();
        assert_eq!(Some(values), field.pixel_values());
        let within = |x, y, width, height| values.within(Window { x, y, width, height });
        assert_eq!((within(4, 3, 1, 2), within(3, 2, 2, 1)), (Some(vec![4.0, 6.0]), Some(vec![1.0, 2.0])));
        assert_eq!(
            [within(2, 2, 1, 1), within(3, 2, 3, 1), within(3, 4, 1, 2), within(5, 2, u32::MAX, 1)],
            [None, None, None, None]
        );
        let mut random = Random::new(5, 0, 0);
        let mut guided = 0;
        for _ in 0..2000 {
            let mut next = || Vec3::new(random.next_f32(), random.next_f32(), random.next_f32());
            let (point, normal) = (next(), next() - 0.5);
            assert_eq!(loaded.at(point, normal), field.at(point, normal));
            guided += usize::from(field.at(point, normal).is_some_and(|guide| guide.directions.is_some()));
        }
        assert!(guided > 100);
        save(&path, &GuideField::empty(), &Evidence::default()).unwrap();
        assert!(load(&path).unwrap().0.voxels().is_empty());
    }

    #[test]
    fn damaged_files_are_refused() {
        let (_folder, path, ..) = saved();
        let good = std::fs::read(&path).unwrap();
        let try_bytes = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            load(&path).map(drop).map_err(|e| e.to_string())
        };
        for end in (0..good.len()).step_by(97) {
            assert!(try_bytes(&good[..end]).unwrap_err().contains("a.guide"));
        }
        let data = 8 + u64::from_le_bytes(good[..8].try_into().unwrap()) as usize;
        for at in (data..good.len()).step_by(7) {
            let mut bad = good.clone();
            bad[at] ^= 1 << (at % 8);
            assert!(try_bytes(&bad).is_err(), "byte {at}");
        }
    }

    /// What was learned is known again by its settings, as long as it is whole.
    #[test]
    fn guides_are_known_by_their_settings() {
        let (_folder, path, field, evidence) = saved();
        assert!(!is_done(&path, "settings") && !is_done(&path, ""), "it does not tell");
        save_learned(&path, &field, &evidence, "settings").unwrap();
        assert!(is_done(&path, "settings") && !is_done(&path, "others") && !is_done(&path.join("none"), "settings"));
        assert_eq!(load(&path).unwrap().1, evidence);
        let mut bytes = std::fs::read(&path).unwrap();
        *bytes.last_mut().unwrap() ^= 1;
        std::fs::write(&path, bytes).unwrap();
        assert!(!is_done(&path, "settings"));
    }

    #[test]
    fn what_cannot_be_read_again_is_not_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.guide");
        // Pages that are never touched take no memory.
        let zeros = vec![0u8; 1 << 29];
        let array = |name: &'static str| (name.into(), Dtype::U8, vec![zeros.len()], zeros.as_slice().into());
        let error = write(&path, VERSION, &["a", "b", "c", "d"].map(array)).unwrap_err();
        assert!(matches!(error, Error::Limit { .. }) && !path.exists(), "{error}");
    }

    /// Contents that a checksum does not protect from: written on purpose.
    #[test]
    fn hostile_trees_are_refused() {
        let node = Node::new;
        let flat = [16384, 32768, 49152];
        let refused = |nodes: Vec<Node>| SamplingTree::from_nodes(nodes, 0.1).is_err();
        assert!(!refused(vec![node(flat, 1, 1), node(flat, 0, 2)]));
        assert!(refused(vec![node(flat, 1, 0)]), "its own child");
        assert!(refused(vec![node(flat, 1, 1)]), "a child that is not there");
        assert!(refused(vec![node(flat, 0, 1), node(flat, 0, 1)]), "a node without a parent");
        assert!(refused(vec![node([3, 2, 1], 0, 1)]), "a negative share");
        assert!(refused((0..21).map(|i| node(flat, u16::from(i < 20), i + 1)).collect()), "too deep");
        assert!(SamplingTree::from_nodes(vec![], f32::NAN).is_err());

        let parts = |roots: Vec<u32>, nodes: Vec<(u8, f32, u32)>| CacheParts {
            origin: Vec3::ZERO,
            cell: 1.0,
            faces: true,
            keys: (0..roots.len()).map(|i| ([i as i32, 0, 0], 0)).collect(),
            roots,
            nodes,
        };
        let refused = |roots, nodes| SpatialCache::from_parts(&parts(roots, nodes)).is_err();
        let leaf = |voxel| (3, 0.0, voxel);
        assert!(!refused(vec![0], vec![(0, 0.5, 1), leaf(1), leaf(0)]));
        assert!(refused(vec![0], vec![(0, 0.5, 0), leaf(1), leaf(0)]), "a circle");
        assert!(refused(vec![0], vec![(0, 0.5, 7), leaf(1), leaf(0)]), "nodes that are not there");
        assert!(refused(vec![0, 0], vec![leaf(0)]), "a voxel of two cells");
        assert!(refused(vec![0], vec![(0, 0.5, 1), leaf(0), leaf(0)]), "a voxel twice");
        assert!(refused(vec![0], vec![leaf(5)]), "a voxel too many");
        assert!(refused(vec![0], vec![(0, f32::NAN, 1), leaf(1), leaf(0)]));
        assert!(refused(vec![0], vec![(0, 0.5, u32::MAX), leaf(1), leaf(0)]));
    }
}
