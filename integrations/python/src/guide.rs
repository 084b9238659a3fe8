//! Guides: what was learned of where light comes from, to be asked at points.

use std::path::PathBuf;
use std::sync::Arc;

use fanal::base::Error;
use fanal::guiding::sample::field::{DirectionGuide, Evidence, GuideField};
use fanal::guiding::sample::file;
use glam::Vec3;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::errors::raised;
use crate::watch::{Interrupted, Watched, watched};

/// Rows of three numbers.
type Vectors<'py> = PyReadonlyArray2<'py, f32>;
/// Directions, and their densities.
type Drawn<'py> = (Bound<'py, PyArray2<f32>>, Bound<'py, PyArray1<f32>>);

/// A guiding field with its evidence.
#[pyclass(frozen, module = "fanal._fanal")]
pub struct Guide(Arc<(GuideField, Evidence)>);

impl Guide {
    /// The guide that a render leaves; none where nothing was guided.
    pub fn of(field: GuideField, evidence: Evidence) -> Option<Self> {
        (!field.voxels().is_empty()).then(|| Self(Arc::new((field, evidence))))
    }

    /// Distributions of directions at points of surfaces, each on the side that its normal points to.
    fn at(&self, points: &[Vec3], normals: &[Vec3]) -> impl Iterator<Item = Option<DirectionGuide<'_>>> {
        let field = &self.0.0;
        points.iter().zip(normals).map(move |(&point, &normal)| field.at(point, normal)?.at(point))
    }
}

/// Reads a guide file.
#[pyfunction]
pub fn load_guide(py: Python<'_>, path: PathBuf) -> PyResult<Guide> {
    let read = move |_: &Watched| file::load(&path);
    watched(py, &Arc::default(), None, Interrupted::IsLeft, read).map(|read| Guide(Arc::new(read)))
}

/// The rows of a contiguous array with three columns.
fn vectors(array: &Vectors) -> PyResult<Vec<Vec3>> {
    Ok(array.as_slice()?.as_chunks::<3>().0.iter().copied().map(Vec3::from_array).collect())
}

/// Checks that all arrays have as many rows.
fn equal(rows: &[usize]) -> PyResult<()> {
    if rows.iter().all(|n| *n == rows[0]) {
        return Ok(());
    }
    Err(raised(&Error::Options(format!("the arrays have different numbers of rows: {rows:?}"))))
}

#[pymethods]
impl Guide {
    #[getter]
    fn voxels(&self) -> usize {
        self.0.0.voxels().len()
    }

    #[getter]
    fn bytes(&self) -> usize {
        self.0.0.bytes()
    }

    /// Densities of directions at points; NaN where the guide has no distribution.
    fn pdf<'py>(
        &self,
        py: Python<'py>,
        points: Vectors<'py>,
        normals: Vectors<'py>,
        directions: Vectors<'py>,
    ) -> PyResult<Bound<'py, PyArray1<f32>>> {
        let [points, normals, directions] = [vectors(&points)?, vectors(&normals)?, vectors(&directions)?];
        equal(&[points.len(), normals.len(), directions.len()])?;
        let density =
            |(guide, &direction): (Option<DirectionGuide>, &Vec3)| guide.map_or(f32::NAN, |guide| guide.pdf(direction));
        let densities: Vec<f32> = py.detach(|| self.at(&points, &normals).zip(&directions).map(density).collect());
        Ok(PyArray1::from_vec(py, densities))
    }

    /// Directions that points of the unit square map to, and their densities; NaN where the guide has no distribution.
    fn sample<'py>(
        &self,
        py: Python<'py>,
        points: Vectors<'py>,
        normals: Vectors<'py>,
        u: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Drawn<'py>> {
        let (points, normals) = (vectors(&points)?, vectors(&normals)?);
        let u = u.as_slice()?.as_chunks::<2>().0.to_vec();
        equal(&[points.len(), normals.len(), u.len()])?;
        let draw = |(guide, &u): (Option<DirectionGuide>, &[f64; 2])| {
            guide.map_or((Vec3::NAN, f32::NAN), |guide| guide.sample(u))
        };
        let drawn: (Vec<Vec3>, Vec<f32>) = py.detach(|| self.at(&points, &normals).zip(&u).map(draw).unzip());
        let directions = PyArray1::from_slice(py, bytemuck::cast_slice(&drawn.0)).reshape([drawn.0.len(), 3])?;
        Ok((directions, PyArray1::from_vec(py, drawn.1)))
    }

    /// Probabilities with which the renderer samples the BSDF instead; 1 where the guide has no distribution.
    fn bsdf_fraction<'py>(
        &self,
        py: Python<'py>,
        points: Vectors<'py>,
        normals: Vectors<'py>,
    ) -> PyResult<Bound<'py, PyArray1<f32>>> {
        let (points, normals) = (vectors(&points)?, vectors(&normals)?);
        equal(&[points.len(), normals.len()])?;
        let fraction = |guide: Option<DirectionGuide>| guide.map_or(1.0, |guide| guide.bsdf_fraction);
        let fractions: Vec<f32> = py.detach(|| self.at(&points, &normals).map(fraction).collect());
        Ok(PyArray1::from_vec(py, fractions))
    }

    /// Writes a guide file.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| file::save(&path, &self.0.0, &self.0.1)).map_err(|error| raised(&error))
    }
}
