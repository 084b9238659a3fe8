//! Cascades as arrays of a file.
//!
//! Names of arrays have the cascade's name and a dot before them. For N planes, each of one level and a run of 64 pixels:
//!
//! | name | type | shape | |
//! |---|---|---|---|
//! | `runs` | u32 | [N] | number of the run, ascending |
//! | `levels` | u8 | [N] | number of the level, ascending within a run |
//! | `sums` | u32 | [64 N, 3] | quanta of the run's pixels |

use super::{Cascade, LEVELS, Plane, Quanta, RUN};
use crate::base::Result;
use crate::base::tensors::{Arrays, Dtype, Tensor, vector};

impl Cascade {
    /// The arrays of a cascade `name`.
    pub fn arrays<'a>(&self, name: &str) -> Vec<Tensor<'a>> {
        let planes = || (0u32..).zip(&self.runs).flat_map(|(run, planes)| planes.iter().map(move |plane| (run, plane)));
        let sums: Vec<u8> =
            planes().flat_map(|(_, plane)| plane.sums.as_flattened()).flat_map(|sum| sum.to_le_bytes()).collect();
        let rows = sums.len() / size_of::<Quanta>();
        vec![
            vector(format!("{name}.runs"), Dtype::U32, planes().map(|(run, _)| run.to_le_bytes())),
            vector(format!("{name}.levels"), Dtype::U8, planes().map(|(_, plane)| [plane.level])),
            (format!("{name}.sums").into(), Dtype::U32, vec![rows, 3], sums.into()),
        ]
    }

    /// The cascade of so many pixels that [`Cascade::arrays`] were made of.
    ///
    /// # Errors
    /// [`Error::Malformed`](crate::base::Error::Malformed) naming the tensor.
    pub fn read(file: &impl Arrays, name: &str, pixels: usize) -> Result<Self> {
        let [runs_name, levels_name] = ["runs", "levels"].map(|part| format!("{name}.{part}"));
        let (mut runs, mut levels, mut sums): (Vec<u32>, Vec<u8>, Vec<Quanta>) = Default::default();
        file.fill(&runs_name, Dtype::U32, None, 1, &mut runs)?;
        file.fill(&levels_name, Dtype::U8, Some(runs.len()), 1, &mut levels)?;
        file.fill(&format!("{name}.sums"), Dtype::U32, Some(runs.len() * RUN), 3, &mut sums)?;
        let mut cascade = Self::new(pixels);
        for ((run, level), sums) in runs.into_iter().zip(levels).zip(sums.as_chunks::<RUN>().0) {
            let Some(planes) = cascade.runs.get_mut(run as usize) else {
                return file.fail(runs_name, format!("run {run} of a picture of {pixels} pixels"));
            };
            if level >= LEVELS || planes.last().is_some_and(|last: &Plane| last.level >= level) {
                return file.fail(levels_name, format!("level {level} of run {run}"));
            }
            planes.push(Plane { level, sums: Box::new(*sums) });
        }
        Ok(cascade)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::tensors::{self, Tensors};
    use glam::Vec3;

    /// Writes a cascade of 100 pixels whose arrays are changed, and reads it as one of so many.
    fn read(change: impl Fn(&mut Vec<Tensor>), pixels: usize) -> (Cascade, Result<Cascade>) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cascade");
        let mut cascade = Cascade::new(100);
        (0..100).for_each(|i| cascade.add(i, Vec3::splat((i as f32 - 50.0).exp2())));
        let mut arrays = cascade.arrays("a");
        change(&mut arrays);
        tensors::write(&path, 1, &arrays).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let read = Cascade::read(&Tensors::open(&path, &bytes, "test", 1).unwrap(), "a", pixels);
        (cascade, read)
    }

    #[test]
    fn cascades_are_read_as_they_were_written() {
        let (cascade, back) = read(|_| {}, 100);
        assert_eq!(back.unwrap(), cascade);
        assert!(read(|_| {}, 60).1.is_err(), "a run beyond the last");
        assert!(read(|arrays| arrays[1].3.to_mut()[0] = LEVELS, 100).1.is_err());
        assert!(read(|arrays| arrays[1].3.to_mut()[1] = 0, 100).1.is_err(), "not ascending");
    }
}
