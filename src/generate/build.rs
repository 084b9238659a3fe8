//! Builds a scene file piece by piece, and keeps track of its solids.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{Mat3, Mat4, Quat, Vec3};

use crate::picture::Image;
use crate::scene::file::{
    CameraFile, FilmFile, FilterFile, GeometryFile, IDENTITY, LightFile, MaterialFile, Matrix, MediumFile, MeshFile,
    RenderFile, SceneFile, ShapeFile, TextureFile,
};

use super::solids::{Solid, Solids};

/// Pictures of a scene by the names of their files.
pub type Pictures = BTreeMap<String, Arc<Image>>;

/// A scene under construction. +y is up until [`Builder::transform`].
#[derive(Debug, Clone)]
pub struct Builder {
    scene: SceneFile,
    solids: Solids,
    pictures: Pictures,
}

impl Builder {
    /// An empty scene with a picture of `size` (columns, rows).
    pub fn new(name: impl Into<String>, size: [u32; 2]) -> Self {
        let film = FilmFile { width: size[0], height: size[1], filter: FilterFile::default() };
        let scene = SceneFile::empty(name.into(), CameraFile::pinhole(IDENTITY, 45.0), film);
        Self { scene, solids: Solids::default(), pictures: Pictures::new() }
    }

    /// Sets the rendering defaults.
    pub fn render(&mut self, max_depth: u32, spp: u32) {
        self.scene.render = RenderFile { max_depth, spp, ..RenderFile::default() };
    }

    /// Adds a material and gives back its name; a name that is taken gets a number.
    pub fn add_material(&mut self, name: &str, material: MaterialFile) -> String {
        let name = free_name(name, |n| self.scene.materials.contains_key(n));
        self.scene.materials.insert(name.clone(), material);
        name
    }

    /// Keeps a picture and gives back the name of its file; a name that is taken gets a number.
    pub fn add_picture(&mut self, name: &str, image: Image) -> String {
        let file = free_name(name, |n| self.pictures.contains_key(&format!("{n}.exr"))) + ".exr";
        self.pictures.insert(file.clone(), Arc::new(image));
        file
    }

    /// Fills a box from its lowest to its highest corner, in which the camera is, with a medium that is the same everywhere.
    pub fn fill(&mut self, [low, high]: [Vec3; 2], sigma_t: [f32; 3], albedo: [f32; 3], g: f32) {
        let border = self.add_material("border", MaterialFile::Null {});
        self.scene.media.insert("haze".into(), MediumFile::Homogeneous { sigma_t, albedo, g });
        self.scene.camera.medium = Some("haze".into());
        self.scene.meshes.entry("cube".into()).or_insert(MeshFile::Cube {});
        let to_world = Mat4::from_scale_rotation_translation((high - low) * 0.5, Quat::IDENTITY, (low + high) * 0.5);
        self.push("border", mesh("cube"), to_world, &border, None);
        if let Some(shape) = self.scene.shapes.last_mut() {
            shape.interior = Some("haze".into());
        }
    }

    /// Adds a light that is not a surface.
    pub fn add_light(&mut self, light: LightFile) {
        self.scene.lights.push(light);
    }

    /// Adds a box with half extents `half`, turned by `turn` about its centre.
    pub fn add_box(&mut self, name: &str, center: Vec3, half: Vec3, turn: Quat, material: &str) {
        self.scene.meshes.entry("cube".into()).or_insert(MeshFile::Cube {});
        let to_world = Mat4::from_scale_rotation_translation(half, turn, center);
        self.push(name, mesh("cube"), to_world, material, None);
        self.solids.add(Solid::Box { center, half, turn });
    }

    /// Adds an upright box from its lowest to its highest corner.
    pub fn add_block(&mut self, name: &str, low: Vec3, high: Vec3, material: &str) {
        self.add_box(name, (low + high) * 0.5, (high - low) * 0.5, Quat::IDENTITY, material);
    }

    /// Adds a sphere; a material that is glass gets it as a solid ball.
    pub fn add_sphere(&mut self, name: &str, center: Vec3, radius: f32, material: &str, emission: Option<[f32; 3]>) {
        let geometry = GeometryFile::Sphere { center: center.to_array(), radius };
        self.push(name, geometry, Mat4::IDENTITY, material, emission);
        self.solids.add(Solid::Ball { center, radius });
    }

    /// Adds a parallelogram about `center` with half edges `u` and `v`, which must be at right angles; it faces u×v.
    pub fn add_quad(
        &mut self,
        name: &str,
        center: Vec3,
        [u, v]: [Vec3; 2],
        material: &str,
        emission: Option<[f32; 3]>,
    ) {
        self.scene.meshes.entry("square".into()).or_insert(MeshFile::Rectangle {});
        let normal = u.cross(v).normalize_or(Vec3::Z);
        let frame = Mat3::from_cols(u, v, normal);
        self.push(name, mesh("square"), Mat4::from_translation(center) * Mat4::from_mat3(frame), material, emission);
        let turn = Quat::from_mat3(&Mat3::from_cols(u.normalize_or(Vec3::X), v.normalize_or(Vec3::Y), normal));
        self.solids.add(Solid::Box { center, half: Vec3::new(u.length(), v.length(), 0.0), turn });
    }

    /// Adds a mesh of its own; `ball` is a ball (centre, radius) around it in mesh coordinates.
    pub fn add_mesh(&mut self, name: &str, file: MeshFile, to_world: Mat4, ball: (Vec3, f32), material: &str) {
        let key = self.define_mesh(name, file);
        self.add_instance(name, &key, to_world, ball, material);
    }

    /// Keeps a mesh for [`Builder::add_instance`] and gives back its name; a name that is taken gets a number.
    pub fn define_mesh(&mut self, name: &str, file: MeshFile) -> String {
        let key = free_name(name, |n| self.scene.meshes.contains_key(n));
        self.scene.meshes.insert(key.clone(), file);
        key
    }

    /// Adds a shape with the mesh `key`, scaled alike along all axes; `ball` is as in [`Builder::add_mesh`].
    pub fn add_instance(&mut self, name: &str, key: &str, to_world: Mat4, ball: (Vec3, f32), material: &str) {
        self.push(name, mesh(key), to_world, material, None);
        let scale = to_world.x_axis.truncate().length();
        self.solids.add(Solid::Ball { center: to_world.transform_point3(ball.0), radius: ball.1 * scale });
    }

    /// Adds a mesh of its own, with all that it has in the box from `low` to `high` in its coordinates; `to_world` may scale its axes.
    pub fn add_boxed(&mut self, name: &str, file: MeshFile, to_world: Mat4, bounds: [Vec3; 2], material: &str) {
        let key = self.define_mesh(name, file);
        self.add_boxed_instance(name, &key, to_world, bounds, material);
    }

    /// As [`Builder::add_boxed`], of a mesh that is kept already.
    pub fn add_boxed_instance(&mut self, name: &str, key: &str, to_world: Mat4, bounds: [Vec3; 2], material: &str) {
        self.push(name, mesh(key), to_world, material, None);
        let [low, high] = bounds;
        let (scale, turn, _) = to_world.to_scale_rotation_translation();
        let center = to_world.transform_point3(0.5 * (low + high));
        self.solids.add(Solid::Box { center, half: 0.5 * (high - low) * scale, turn });
    }

    fn push(&mut self, name: &str, geometry: GeometryFile, to_world: Mat4, material: &str, emission: Option<[f32; 3]>) {
        self.scene.shapes.push(ShapeFile {
            name: name.into(),
            geometry,
            to_world: matrix(to_world),
            flip_normals: false,
            material: material.into(),
            interior: None,
            exterior: None,
            emission,
            emission_texture: None,
            unseen: false,
        });
    }

    /// Puts a pinhole camera at `origin` that looks at `target` with a horizontal field of view in degrees.
    pub fn look_at(&mut self, origin: Vec3, target: Vec3, up: Vec3, fov: f32) {
        let forward = (target - origin).normalize_or(Vec3::Z);
        let left = up.cross(forward).try_normalize().unwrap_or_else(|| forward.any_orthonormal_vector());
        let frame = Mat3::from_cols(left, forward.cross(left), forward);
        self.scene.camera.to_world = matrix(Mat4::from_translation(origin) * Mat4::from_mat3(frame));
        self.scene.camera.fov = fov;
    }

    /// Everything solid so far, as placed before [`Builder::transform`].
    pub fn solids(&self) -> &Solids {
        &self.solids
    }

    /// Turns, scales and moves the whole scene, camera and lights included, so that the picture stays the same.
    pub fn transform(&mut self, scale: f32, turn: Quat, shift: Vec3) {
        let all = Mat4::from_scale_rotation_translation(Vec3::splat(scale), turn, shift);
        let rigid = |m: &Matrix| {
            let m = from_matrix(m);
            let frame = Mat3::from_quat(turn) * Mat3::from_mat4(m);
            matrix(Mat4::from_translation(all.transform_point3(m.w_axis.truncate())) * Mat4::from_mat3(frame))
        };
        let camera = &mut self.scene.camera;
        camera.to_world = rigid(&camera.to_world);
        camera.aperture_radius *= scale;
        camera.focus_distance = camera.focus_distance.map(|d| d * scale);
        for shape in &mut self.scene.shapes {
            shape.to_world = matrix(all * from_matrix(&shape.to_world));
        }
        for medium in self.scene.media.values_mut() {
            if let MediumFile::Homogeneous { sigma_t, .. } = medium {
                *sigma_t = sigma_t.map(|s| s / scale);
            }
        }
        for light in &mut self.scene.lights {
            match light {
                LightFile::Point { position, intensity } => {
                    *position = all.transform_point3(Vec3::from_array(*position)).to_array();
                    *intensity = intensity.map(|i| i * scale * scale);
                }
                LightFile::Spot { to_world, intensity, .. } | LightFile::Projector { to_world, intensity, .. } => {
                    *to_world = rigid(to_world);
                    *intensity = intensity.map(|i| i * scale * scale);
                }
                LightFile::Directional { direction, .. } | LightFile::Sun { direction, .. } => {
                    *direction = (turn * Vec3::from_array(*direction)).to_array()
                }
                LightFile::Sky { sun, up, .. } => {
                    [sun, up].into_iter().for_each(|v| *v = (turn * Vec3::from_array(*v)).to_array())
                }
                LightFile::Envmap { to_world, .. } => *to_world = rigid(to_world),
                LightFile::Constant { .. } => {}
            }
        }
    }

    /// The finished scene file, of a scene without pictures.
    pub fn finish(self) -> SceneFile {
        self.scene
    }

    /// The finished scene file and the pictures that it names.
    pub fn finish_with_pictures(self) -> (SceneFile, Pictures) {
        (self.scene, self.pictures)
    }
}

fn mesh(name: &str) -> GeometryFile {
    GeometryFile::Mesh { mesh: name.into() }
}

fn free_name(wanted: &str, taken: impl Fn(&str) -> bool) -> String {
    let numbered = (2..).map(|n| format!("{wanted}-{n}"));
    std::iter::once(wanted.to_owned()).chain(numbered).find(|name| !taken(name)).unwrap_or_else(|| wanted.to_owned())
}

/// A matrix as scene files hold it, row by row.
pub fn matrix(m: Mat4) -> Matrix {
    m.transpose().to_cols_array()
}

fn from_matrix(m: &Matrix) -> Mat4 {
    Mat4::from_cols_array(m).transpose()
}

/// A diffuse material that is the same on both sides.
pub fn diffuse(albedo: [f32; 3]) -> MaterialFile {
    MaterialFile::TwoSided { material: Box::new(MaterialFile::Diffuse { reflectance: TextureFile::rgb(albedo) }) }
}

/// Window glass in air.
pub fn glass(int_ior: f32) -> MaterialFile {
    MaterialFile::Dielectric { int_ior, ext_ior: 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A point keeps its place relative to the camera, up to the scale.
    #[test]
    fn transform_keeps_the_view() {
        let mut builder = Builder::new("test", [4, 4]);
        let material = builder.add_material("grey", diffuse([0.5; 3]));
        builder.add_box("box", Vec3::new(1.0, 2.0, 3.0), Vec3::ONE, Quat::from_rotation_y(0.3), &material);
        builder.look_at(Vec3::new(0.0, 1.0, -4.0), Vec3::ZERO, Vec3::Y, 50.0);
        let seen = |scene: &SceneFile| {
            from_matrix(&scene.camera.to_world).inverse()
                * from_matrix(&scene.shapes[0].to_world)
                * Vec3::ONE.extend(1.0)
        };
        let before = seen(&builder.scene);
        builder.transform(3.0, Quat::from_rotation_x(1.0), Vec3::splat(7.0));
        let after = seen(&builder.scene);
        assert!((after.truncate() - before.truncate() * 3.0).length() < 1e-4);
    }

    /// Mitsuba's convention: +z ahead, +y up, +x to the left.
    #[test]
    fn camera_frame() {
        let mut builder = Builder::new("test", [4, 4]);
        builder.look_at(Vec3::ZERO, -Vec3::Z, Vec3::Y, 50.0);
        let camera = from_matrix(&builder.scene.camera.to_world);
        assert!((camera.transform_vector3(Vec3::Z) + Vec3::Z).length() < 1e-6);
        assert!((camera.transform_vector3(Vec3::X) + Vec3::X).length() < 1e-6, "looking along -z, left is -x");
    }

    #[test]
    fn quad_faces_u_cross_v() {
        let mut builder = Builder::new("test", [4, 4]);
        builder.add_quad("quad", Vec3::ZERO, [Vec3::Z * 2.0, Vec3::X], "grey", None);
        let to_world = from_matrix(&builder.scene.shapes[0].to_world);
        assert!((to_world.transform_vector3(Vec3::Z) - Vec3::Y).length() < 1e-6);
    }
}
