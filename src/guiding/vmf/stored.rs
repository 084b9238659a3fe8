//! Mixtures as arrays of a file: frozen ones of guides, which [`file`](crate::guiding::sample::file) lists, and those that learn. For V
//! voxels the latter are
//!
//! | name | type | shape | |
//! |---|---|---|---|
//! | `vmf_offset` | u64 | [V + 1] | index of each voxel's first lobe |
//! | `vmf_components` | f64 | [.., 18] | parameters and statistics of each lobe |
//! | `vmf_voxel` | f64 | [V, 8] | pivot and statistics of each voxel |

use glam::Vec3;

use super::fit::LearnedMixture;
use super::learn::VmfMixtures;
use super::lobe::Lobe;
use super::mixture::VmfMixture;
use crate::base::Result;
use crate::base::tensors::{Arrays, Dtype, Tensor, Tensors, floats, offsets};
use crate::guiding::target::Target;

/// Names of the arrays of a kind of frozen mixtures.
fn names(kind: &str) -> [String; 3] {
    ["lobe_offset", "lobes", "pivot"].map(|part| format!("{kind}_{part}"))
}

/// The arrays of mixtures, some of which may be missing.
pub(in crate::guiding) fn mixture_arrays<'a>(kind: &str, all: &[Option<&VmfMixture>]) -> [Tensor<'a>; 3] {
    let [offset, lobes, pivot] = names(kind);
    let rows = all.iter().copied().flatten().flat_map(VmfMixture::lobes);
    let row = |Lobe { mean, kappa, weight, nearness }: Lobe| [mean.x, mean.y, mean.z, kappa, weight, nearness];
    let place = |of: &VmfMixture| of.pivot().extend(f32::from(u8::from(of.is_of_radiance()))).to_array();
    [
        offsets(offset, all.iter().map(|of| of.map_or(0, VmfMixture::len))),
        floats(lobes, rows.map(row)),
        floats(pivot, all.iter().map(|of| of.map_or([0.0; 4], place))),
    ]
}

/// Reads the `count` mixtures that [`mixture_arrays`] wrote; none where the file has no array of them.
///
/// # Errors
/// [`Error::Malformed`](crate::base::Error::Malformed) naming the tensor.
pub(in crate::guiding) fn read_mixtures(
    file: &Tensors,
    kind: &str,
    count: usize,
) -> Result<Option<Vec<Option<VmfMixture>>>> {
    let [offset, lobes, pivot] = names(kind);
    if !file.has(&lobes) {
        return Ok(None);
    }
    let offsets = file.offsets(&offset, count)?;
    let rows = file.read(&lobes, Dtype::F32, Some(offsets[count]), 6, f32::from_le_bytes)?;
    let places = file.read(&pivot, Dtype::F32, Some(count), 4, f32::from_le_bytes)?;
    let (rows, places) = (rows.as_chunks::<6>().0, places.as_chunks::<4>().0);
    let lobe =
        |&[x, y, z, kappa, weight, nearness]: &[f32; 6]| Lobe { mean: Vec3::new(x, y, z), kappa, weight, nearness };
    let mixture = |v: usize| {
        let own: Vec<Lobe> = rows[offsets[v]..offsets[v + 1]].iter().map(lobe).collect();
        if own.is_empty() {
            return Ok(None);
        }
        let [x, y, z, of_radiance] = places[v];
        VmfMixture::new(&own, Vec3::new(x, y, z), of_radiance != 0.0)
            .map(Some)
            .or_else(|e| file.fail(format!("{lobes} of voxel {v}"), e))
    };
    (0..count).map(mixture).collect::<Result<_>>().map(Some)
}

impl VmfMixtures {
    /// State of the mixtures, as arrays of a file.
    pub(in crate::guiding) fn arrays<'a>(&self) -> Vec<Tensor<'a>> {
        self.state(LearnedMixture::numbers)
    }

    /// Reads the mixtures of `count` voxels that [`VmfMixtures::arrays`] wrote.
    ///
    /// # Errors
    /// [`Error::Malformed`](crate::base::Error::Malformed) naming the tensor.
    pub(in crate::guiding) fn from_arrays(target: Target, count: usize, file: &Tensors) -> Result<Self> {
        Self::of_state(target, count, file, LearnedMixture::from_numbers)
    }
}
