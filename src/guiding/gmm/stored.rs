//! Mixtures as arrays of a file: frozen ones of guides, which [`file`](crate::guiding::sample::file) lists, and those that learn. For V
//! voxels the latter are
//!
//! | name | type | shape | |
//! |---|---|---|---|
//! | `gmm_offset` | u64 | [V + 1] | index of each voxel's first Gaussian |
//! | `gmm_components` | f64 | [.., 12] | parameters and statistics of each Gaussian |
//! | `gmm_voxel` | f64 | [V, 7] | statistics of each voxel |

use super::fit::LearnedMixture;
use super::gaussian::Gaussian;
use super::learn::GaussianMixtures;
use super::mixture::GaussianMixture;
use crate::base::Result;
use crate::base::tensors::{Arrays, Dtype, Tensor, Tensors, floats, offsets};
use crate::guiding::target::Target;

/// Names of the arrays of a kind of frozen mixtures.
fn names(kind: &str) -> [String; 2] {
    ["gaussian_offset", "gaussians"].map(|part| format!("{kind}_{part}"))
}

/// The arrays of mixtures, some of which may be missing.
pub(in crate::guiding) fn gaussian_arrays<'a>(kind: &str, all: &[Option<&GaussianMixture>]) -> [Tensor<'a>; 2] {
    let [offset, gaussians] = names(kind);
    let rows = all.iter().copied().flatten().flat_map(GaussianMixture::gaussians);
    let row = |&Gaussian { weight, mean: [x, y], deviation, slope, residual }: &Gaussian| {
        [weight, x, y, deviation, slope, residual]
    };
    [offsets(offset, all.iter().map(|of| of.map_or(0, GaussianMixture::len))), floats(gaussians, rows.map(row))]
}

/// Reads the `count` mixtures that [`gaussian_arrays`] wrote; none where the file has no array of them.
///
/// # Errors
/// [`Error::Malformed`](crate::base::Error::Malformed) naming the tensor.
pub(in crate::guiding) fn read_gaussians(
    file: &Tensors,
    kind: &str,
    count: usize,
) -> Result<Option<Vec<Option<GaussianMixture>>>> {
    let [offset, gaussians] = names(kind);
    if !file.has(&gaussians) {
        return Ok(None);
    }
    let offsets = file.offsets(&offset, count)?;
    let rows = file.read(&gaussians, Dtype::F32, Some(offsets[count]), 6, f32::from_le_bytes)?;
    let rows = rows.as_chunks::<6>().0;
    let gaussian = |&[weight, x, y, deviation, slope, residual]: &[f32; 6]| Gaussian {
        weight,
        mean: [x, y],
        deviation,
        slope,
        residual,
    };
    let mixture = |v: usize| {
        let own: Vec<Gaussian> = rows[offsets[v]..offsets[v + 1]].iter().map(gaussian).collect();
        if own.is_empty() {
            return Ok(None);
        }
        GaussianMixture::new(&own).map(Some).or_else(|e| file.fail(format!("{gaussians} of voxel {v}"), e))
    };
    (0..count).map(mixture).collect::<Result<_>>().map(Some)
}

impl GaussianMixtures {
    /// State of the mixtures, as arrays of a file.
    pub(in crate::guiding) fn arrays<'a>(&self) -> Vec<Tensor<'a>> {
        self.state(LearnedMixture::numbers)
    }

    /// Reads the mixtures of `count` voxels that [`GaussianMixtures::arrays`] wrote.
    ///
    /// # Errors
    /// [`Error::Malformed`](crate::base::Error::Malformed) naming the tensor.
    pub(in crate::guiding) fn from_arrays(target: Target, count: usize, file: &Tensors) -> Result<Self> {
        Self::of_state(target, count, file, LearnedMixture::from_numbers)
    }
}
