//! A camera that shows everything, for scenes without any.

use glam::{DMat4, DVec3};

use crate::scene::file::GeometryFile;
use crate::scene::readers::gltf::framing;
use crate::scene::readers::mesh;

use super::Reader;

impl Reader<'_> {
    /// Places a camera from which all shapes are seen whose meshes can be read.
    pub(super) fn frame_everything(&mut self) {
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let mut meet = |point: DVec3| (low, high) = (low.min(point), high.max(point));
        for shape in &self.file.shapes {
            let to_world = DMat4::from_cols_array(&shape.to_world.map(f64::from)).transpose();
            match &shape.geometry {
                GeometryFile::Sphere { center, radius } => {
                    let [center, radius] = [DVec3::from_array(center.map(f64::from)), DVec3::splat(f64::from(*radius))];
                    let scale = to_world.x_axis.truncate().length();
                    let center = to_world.transform_point3(center);
                    meet(center - radius * scale);
                    meet(center + radius * scale);
                }
                GeometryFile::Mesh { mesh } => {
                    let Some(file) = self.file.meshes.get(mesh) else { continue };
                    // What is wrong with a mesh is told when it is loaded for good.
                    let Ok(loaded) = mesh::load(file, None, &self.folder, &self.places.at(mesh)) else { continue };
                    loaded.mesh.positions.iter().for_each(|p| meet(to_world.transform_point3(p.as_dvec3())));
                }
            }
        }
        if low.is_finite() && high.is_finite() {
            let (camera, film) = framing([low, high]);
            (self.file.camera, self.file.film) = (camera, film);
        }
    }
}
