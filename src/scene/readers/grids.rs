//! The grids of a scene's media.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use glam::{DMat4, DVec3, Vec3};

use crate::base::{Error, Place, Result};
use crate::materials::grid::{Edge, Grid, Values};
use crate::scene::file::{GridFile, GridMediumFile, Matrix, MediumFile, SceneFile};

use super::path;
use super::places::Places;
use super::vol::Vol;

/// Largest extinction times density: beyond, products with lengths would leave single precision.
const LARGEST_EXTINCTION: f32 = 1e30;

/// A grid and where it lies.
#[derive(Debug, Clone)]
pub struct PlacedGrid {
    /// The values.
    pub grid: Arc<Grid>,
    /// From its unit cube to the world.
    pub to_world: DMat4,
}

/// Grids by medium and key: "NAME.density".
pub type Grids = BTreeMap<String, PlacedGrid>;

/// The name of a medium's grid in [`Grids`].
pub fn grid_key(medium: &str, key: &str) -> String {
    format!("{medium}.{key}")
}

/// Loads the grids of all media, every file once.
///
/// # Errors
/// Those of [`Vol::read`]; [`Error::Malformed`], [`Error::Unsupported`] and [`Error::Limit`] at the medium's place.
pub(super) fn load(scene: &SceneFile, folder: &Path, places: &Places, warnings: &mut Vec<String>) -> Result<Grids> {
    let mut loader = Loader { folder, warnings, files: BTreeMap::new() };
    let mut grids = Grids::new();
    for (name, medium) in &scene.media {
        for (key, file) in medium.grids() {
            let place = places.at(&format!("media.{name}.{key}"));
            grids.insert(grid_key(name, key), loader.load(file, key == "albedo_grid", &place)?);
        }
        if let MediumFile::Grid(file) = medium {
            let density = &grids[&grid_key(name, "density")];
            check_extinction(file, density, &places.at(&format!("media.{name}.density")))?;
        }
    }
    Ok(grids)
}

/// Refuses an extinction beyond what can be calculated with.
fn check_extinction(file: &GridMediumFile, density: &PlacedGrid, place: &Place) -> Result<()> {
    let [_, most] = density.grid.range(Vec3::ZERO, Vec3::ONE);
    let most = most.max_element() * file.sigma_t.iter().fold(0.0, |most, sigma| sigma.max(most));
    if most <= LARGEST_EXTINCTION {
        return Ok(());
    }
    let of = if let GridFile::Vol { file, .. } = &file.density { format!(" of \"{file}\"") } else { String::new() };
    let message = format!("the extinction{of} reaches {most:e} per unit, the limit is {LARGEST_EXTINCTION:e}");
    Err(Error::malformed(place.clone(), message))
}

/// A file's grid and its box.
type Loaded = (Arc<Grid>, [[f32; 3]; 2]);

struct Loader<'a> {
    folder: &'a Path,
    warnings: &'a mut Vec<String>,
    /// Files that were read, by name and whether they are albedos.
    files: BTreeMap<(String, bool), Loaded>,
}

impl Loader<'_> {
    fn load(&mut self, file: &GridFile, is_albedo: bool, place: &Place) -> Result<PlacedGrid> {
        let to_world = matrix(file.to_world());
        match file {
            GridFile::Inline { size, values, fades, .. } => {
                let channels = channels(*size, values.len());
                let values = Values::Floats(values.clone());
                let edge = if *fades { Edge::Fades } else { Edge::Continues };
                let values = self.bounded(values, is_albedo, place);
                Ok(PlacedGrid { grid: grid(*size, channels, &values, edge, place)?, to_world })
            }
            GridFile::Vol { file, own_box, centred, .. } => {
                let known = (file.clone(), is_albedo);
                if !self.files.contains_key(&known) {
                    let path = path::resolve(self.folder, file, place)?;
                    let (vol, place) = (Vol::read(&path)?, Place::file(path));
                    let values = self.bounded(vol.values, is_albedo, &place);
                    let grid = grid(vol.size, vol.channels, &values, Edge::Continues, &place)?;
                    self.files.insert(known.clone(), (grid, vol.corners));
                }
                let (grid, corners) = &self.files[&known];
                let corners = if *own_box { *corners } else { [[0.0; 3], [1.0; 3]] };
                let inside = within(corners, grid.size(), *centred)
                    .ok_or_else(|| Error::malformed(place.clone(), format!("the box of \"{file}\" is empty")))?;
                Ok(PlacedGrid { grid: grid.clone(), to_world: to_world * inside })
            }
        }
    }

    /// Values that a medium can have: not negative, and albedos at most 1.
    fn bounded(&mut self, values: Values, is_albedo: bool, place: &Place) -> Values {
        let Values::Floats(mut values) = values else { return values };
        let most = if is_albedo { 1.0 } else { f32::MAX };
        let beyond = values.iter().filter(|value| !(0.0..=most).contains(*value)).count();
        if beyond > 0 {
            let range = if is_albedo { "from 0 to 1" } else { "of at least 0" };
            self.warnings
                .push(format!("{place}: {beyond} values of the grid are not {range}: the nearest that are are used"));
            values.iter_mut().for_each(|value| *value = value.clamp(0.0, most));
        }
        Values::Floats(values)
    }
}

/// Channels of `count` values of a grid of `size` cells: three where there are three for each, otherwise one.
fn channels(size: [u32; 3], count: usize) -> u32 {
    let cells = size.iter().map(|side| u128::from(*side)).product::<u128>();
    if cells.checked_mul(3) == Some(count as u128) { 3 } else { 1 }
}

fn grid(size: [u32; 3], channels: u32, values: &Values, edge: Edge, place: &Place) -> Result<Arc<Grid>> {
    if !matches!(channels, 1 | 3) {
        let (place, what) = (place.clone(), format!("a grid of {channels} channels"));
        return Err(Error::Unsupported { place, what, supported: "1, 3".into() });
    }
    let all = Grid::with_shell(size, channels).unwrap_or(u64::MAX);
    if all > Grid::MOST_VALUES {
        let (place, what) = (place.clone(), "values of a grid and its edge".to_owned());
        return Err(Error::Limit { place, what, value: all, limit: Grid::MOST_VALUES });
    }
    let [x, y, z] = size;
    let wrong = || Error::malformed(place.clone(), format!("{} values for {x} × {y} × {z} cells", values.len()));
    Grid::new(size, channels, values, edge).map(Arc::new).ok_or_else(wrong)
}

/// From the unit cube to the box that cells fill, or whose sides the centres of the outermost lie on; none for an empty box.
fn within([low, high]: [[f32; 3]; 2], size: [usize; 3], centred: bool) -> Option<DMat4> {
    let [mut low, mut high] = [low, high].map(|corner| DVec3::from_array(corner.map(f64::from)));
    let extent = high - low;
    if !(extent.is_finite() && extent.min_element() > 0.0) {
        return None;
    }
    if centred {
        // One cell has its centre wherever the box is.
        let half = DVec3::from_array(size.map(|side| if side > 1 { 0.5 / (side - 1) as f64 } else { 0.0 }));
        (low, high) = (low - extent * half, high + extent * half);
    }
    Some(DMat4::from_translation(low) * DMat4::from_scale(high - low))
}

fn matrix(matrix: &Matrix) -> DMat4 {
    DMat4::from_cols_array(&matrix.map(f64::from)).transpose()
}
