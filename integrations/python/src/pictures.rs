//! Pictures as arrays.

use std::path::PathBuf;

use fanal::base::Error;
use fanal::film::measure;
use fanal::picture::{self, Display, Image, Picture, write_picture};
use glam::Vec3;
use numpy::{PyArray1, PyArray3, PyArrayMethods, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::errors::raised;
use crate::words::json;

/// A picture as an array of rows, columns and channels.
pub fn array<'py>(py: Python<'py>, image: &Image) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let values: &[f32] = bytemuck::cast_slice(&image.pixels);
    PyArray1::from_slice(py, values).reshape([image.height, image.width, 3])
}

/// The picture that a contiguous array of rows, columns and three channels holds.
fn image(array: &PyReadonlyArray3<f32>) -> PyResult<Image> {
    let &[height, width, 3] = array.shape() else {
        return Err(raised(&Error::Options("a picture has three channels".into())));
    };
    let pixels = array.as_slice()?.as_chunks::<3>().0.iter().copied().map(Vec3::from_array).collect();
    Ok(Image { width, height, pixels })
}

/// Reads a picture as linear RGB, or raw values where it holds `data`.
#[pyfunction]
pub fn read_image(py: Python<'_>, path: PathBuf, data: bool) -> PyResult<Bound<'_, PyArray3<f32>>> {
    let image = py.detach(|| picture::read_image(&path, data)).map_err(|error| raised(&error))?;
    array(py, &image)
}

/// Writes a picture as its name tells.
#[pyfunction]
pub fn write_image(py: Python<'_>, path: PathBuf, pixels: PyReadonlyArray3<'_, f32>, exposure: f32) -> PyResult<()> {
    let image = image(&pixels)?;
    let attributes = [("software".to_owned(), format!("fanal {}", env!("CARGO_PKG_VERSION")))];
    let display = Display { exposure, ..Display::default() };
    let written = py.detach(|| write_picture(&path, &Picture::plain(&image, &attributes), display));
    written.map_err(|error| raised(&error))
}

/// Errors of a picture against a reference, as JSON.
#[pyfunction]
pub fn error(
    py: Python<'_>,
    picture: PyReadonlyArray3<'_, f32>,
    reference: PyReadonlyArray3<'_, f32>,
) -> PyResult<String> {
    let (picture, reference) = (image(&picture)?, image(&reference)?);
    json(&py.detach(|| measure(&picture, &reference)).map_err(|error| raised(&error))?)
}
