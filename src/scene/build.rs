//! Building the immutable scene from a loaded scene file.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{Affine3A, Mat3, Mat4, Vec2, Vec3};
use rayon::prelude::*;

use super::dress::Wardrobe;
use super::effects::Needs;
use super::file::{
    CameraFile, Distribution, GeometryFile, LightFile, MaterialFile, Matrix, MediumFile, PrincipledFile,
    PrincipledThinFile, ProfileFile, ShapeFile, TextureFile,
};
use super::media::{Border, Filling};
use super::names::Names;
use super::readers::{LoadedScene, PlacedGrid, grid_key};
use super::{Scene, sheet};
use crate::base::{Error, Place, Result};
use crate::camera::Camera;
use crate::geometry::accel::SELDOM_SHARED;
use crate::geometry::mesh::Mesh;
use crate::geometry::{Accel, Shape};
use crate::lights::area::{AreaLight, MOST_PIECES};
use crate::lights::distant::{Constant, Directional};
use crate::lights::envmap::Envmap;
use crate::lights::point::{Point, Spot};
use crate::lights::projector::{Lens, Profile, Projector};
use crate::lights::sky::{Atmosphere, Sky};
use crate::lights::sun::Sun;
use crate::lights::{BoundingSphere, Light, LightSet};
use crate::materials::blend::Blend;
use crate::materials::bump::{Bump, Map};
use crate::materials::conductor::Conductor;
use crate::materials::dielectric::{Dielectric, ThinDielectric};
use crate::materials::diffuse::Diffuse;
use crate::materials::fresnel::Metal;
use crate::materials::grid_medium::{GridMedium, Varying};
use crate::materials::medium::{Medium, MediumId};
use crate::materials::microfacet::{Grain, Microfacets, SMOOTH, Shape as FacetShape};
use crate::materials::phase::HenyeyGreenstein;
use crate::materials::plastic::Plastic;
use crate::materials::principled::{Parameters, Principled};
use crate::materials::principled_thin::{self, PrincipledThin};
use crate::materials::rough_conductor::RoughConductor;
use crate::materials::rough_dielectric::{LEAST_STEP, RoughDielectric};
use crate::materials::rough_diffuse::RoughDiffuse;
use crate::materials::texture::Texture;
use crate::materials::translucent::Translucent;
use crate::materials::{Kind, Material, Tint};
use crate::picture::Texels;

/// Bytes of meshes that stay in the caches by themselves.
const CACHED: usize = 1 << 18;
/// Most triangles of shapes that shine: each of these has its own, of 60 bytes each.
const MOST_EMITTING: u64 = 1 << 26;

impl Scene {
    /// Builds the scene for a picture of `size` (columns, rows) by its default camera.
    ///
    /// # Errors
    /// [`Error::Malformed`] where a name does not resolve; the readers have checked all values. [`Error::Limit`] where
    /// shapes that shine have too many triangles.
    pub fn build(loaded: &LoadedScene, size: [u32; 2]) -> Result<Self> {
        Self::build_with(loaded, size, &[])
    }

    /// Builds the scene for a picture of `size` by each of its cameras, in the order of [`SceneFile::views`](super::file::SceneFile::views).
    ///
    /// # Errors
    /// As [`Scene::build`]; [`Error::Options`] where cameras are in different media.
    pub fn build_views(loaded: &LoadedScene, size: [u32; 2]) -> Result<Self> {
        let further: Vec<&CameraFile> = loaded.file.cameras.values().collect();
        if let Some((name, _)) = loaded.file.views().find(|(_, camera)| camera.medium != loaded.file.camera.medium) {
            let first = &loaded.file.camera_name;
            return Err(Error::Options(format!(
                "the cameras {first:?} and {name:?} are in different media, and so are the lights by what they say: render them one by \
                 one, with --camera {name:?}"
            )));
        }
        Self::build_with(loaded, size, &further)
    }

    fn build_with(loaded: &LoadedScene, size: [u32; 2], further: &[&CameraFile]) -> Result<Self> {
        let file = &loaded.file;
        let value = emitting_triangles(&file.shapes, &loaded.meshes);
        if value > MOST_EMITTING {
            let place = Place::file(&loaded.directory);
            let what = "the number of triangles of shapes that shine".to_owned();
            return Err(Error::Limit { place, what, value, limit: MOST_EMITTING });
        }
        let names: BTreeMap<&str, u32> = file.materials.keys().map(String::as_str).zip(0..).collect();
        // Some tabulate for milliseconds. The first error in their order counts, whichever is found first.
        let materials: Vec<&MaterialFile> = file.materials.values().collect();
        let materials: Vec<Result<Material>> =
            materials.into_par_iter().map(|file| material(file, &loaded.images)).collect();
        let mut materials = materials.into_iter().collect::<Result<Vec<Material>>>()?;
        let (mut wardrobe, mut own_materials) = (Wardrobe::new(loaded), 0);
        let mut shapes = Vec::with_capacity(file.shapes.len());
        let mut shape_material = Vec::with_capacity(file.shapes.len());
        let mut shape_light = Vec::with_capacity(file.shapes.len());
        let mut shape_border = Vec::with_capacity(file.shapes.len());
        let mut lights = Vec::new();
        let media_names: BTreeMap<&str, MediumId> = file.media.keys().map(String::as_str).zip(0..).collect();
        let medium = |name: &Option<String>| -> Result<Option<MediumId>> {
            let Some(name) = name else { return Ok(None) };
            media_names.get(name.as_str()).copied().map(Some).ok_or_else(|| unresolved(loaded, "medium", name))
        };
        // Lights and shapes without a stated medium are in the camera's.
        let camera_medium = medium(&file.camera.medium)?;
        let mut light_medium = Vec::new();
        let mut uses: BTreeMap<Option<&str>, usize> = BTreeMap::new();
        for shape_file in &file.shapes {
            *uses.entry(mesh_name(shape_file)).or_default() += 1;
        }
        let mut copies = Copies::default();
        // Lamps with pictures share as many pieces as there may be triangles.
        let is_cut = |shape: &&ShapeFile| shape.shines() && shape.emission_texture.is_some();
        let cut = file.shapes.iter().filter(is_cut).count();
        let pieces = (MOST_EMITTING as usize / cut.max(1)).min(MOST_PIECES);
        for shape_file in &file.shapes {
            let dressed = wardrobe.dress(shape_file);
            let mesh = dressed.and_then(|dressed| dressed.mesh.clone());
            let shape = shape(shape_file, uses[&mesh_name(shape_file)], &mut copies, mesh, loaded)?;
            let shape = Shape { unseen: shape_file.unseen, ..shape };
            let name = shape_file.material.as_str();
            shape_material.push(match dressed {
                None => *names.get(name).ok_or_else(|| unresolved(loaded, "material", name))?,
                Some(dressed) => {
                    if dressed.number == own_materials {
                        materials.push(material(&dressed.material, &dressed.images)?);
                        own_materials += 1;
                    }
                    names.len() as u32 + dressed.number
                }
            });
            let border = Border { interior: medium(&shape_file.interior)?, exterior: medium(&shape_file.exterior)? };
            shape_border.push((border != Border::default()).then_some(border));
            let emission = shape_file.emission.filter(|_| shape_file.shines()).map(Vec3::from_array);
            shape_light.push(emission.map(|_| lights.len() as u32));
            if emission.is_some() {
                light_medium.push(if border == Border::default() { camera_medium } else { border.exterior });
            }
            let (factor, images) = match dressed {
                Some(dressed) => (&dressed.emission_texture, &dressed.images),
                None => (&shape_file.emission_texture, &loaded.images),
            };
            let factor = factor.as_ref().map(|factor| Texture::new(factor, images)).transpose()?;
            lights.extend(emission.map(|radiance| {
                Light::Area(match factor {
                    None => AreaLight::new(shape.clone(), radiance),
                    Some(factor) => AreaLight::textured_within(shape.clone(), radiance, factor, pieces),
                })
            }));
            shapes.push(shape);
        }
        let accel = Accel::new(&shapes);
        let camera = camera(&file.camera, size);
        let further: Vec<Camera> = further.iter().map(|file| self::camera(file, size)).collect();
        let bounds = bounding_sphere(accel.bounds(), camera.position());
        for light in &file.lights {
            lights.push(self::light(light, loaded)?);
            light_medium.push(camera_medium);
        }
        let seen = || shape_material.iter().zip(&shapes).filter(|(_, shape)| !shape.unseen);
        let used = || seen().map(|(&index, _)| &materials[index as usize]);
        let has_masks = used().any(|material| material.opacity.is_some() || matches!(material.kind, Kind::Null));
        let is_solid = |(index, light): (&u32, &Option<u32>)| {
            let material = &materials[*index as usize];
            !matches!(material.kind, Kind::Null) && (material.opacity.is_none() || light.is_some())
        };
        let shape_solid: Vec<bool> = shape_material.iter().zip(&shape_light).map(is_solid).collect();
        let stops = |(solid, border): (&bool, &Option<Border>)| *solid && border.is_none();
        let shape_stops = shape_solid.iter().zip(&shape_border).map(stops).collect();
        let meshes: usize = loaded.meshes.values().map(|mesh| mesh.bytes()).sum();
        let has_bumps = used().any(|material| material.bump.is_some());
        let needs = Needs {
            materials: loaded.needs.materials
                || has_masks
                || has_bumps
                || used().any(|material| material.tint.is_some() || !matches!(material.kind, Kind::Diffuse(_))),
            media: loaded.needs.media
                || !file.media.is_empty()
                || used().any(|material| matches!(material.kind, Kind::Null)),
        };
        let media = file.media.iter().map(|(name, medium)| filling(name, medium, loaded)).collect::<Result<_>>()?;
        let mut scene = Self {
            has_masks,
            has_tangents: has_bumps || used().any(Material::has_grain),
            is_large: meshes > CACHED,
            has_pictures: !loaded.images.is_empty() || !loaded.attributes.is_empty(),
            needs,
            glows: file.media.values().any(MediumFile::glows),
            has_grids: file.media.values().any(MediumFile::is_varying),
            media,
            shape_border,
            shape_stops,
            light_medium,
            camera_medium,
            hides_emitters: file.render.hide_emitters,
            name: file.name.clone(),
            names: Names::of(file),
            size: sheet::size(size, 1 + further.len()),
            camera,
            further,
            lights: LightSet::new(lights, &bounds),
            bounds,
            accel,
            shapes,
            shape_material,
            shape_light,
            shape_solid,
            variants: materials.iter().map(Material::variant).collect(),
            plains: materials.iter().map(Material::plain).collect(),
            materials,
        };
        scene.order_for_shadows(file.render.max_depth);
        Ok(scene)
    }
}

fn camera(file: &CameraFile, size: [u32; 2]) -> Camera {
    let focus = file.focus_distance.unwrap_or(1.0);
    let to_world = affine(&file.to_world);
    let camera = match file.orthographic_width {
        Some(width) => Camera::orthographic(to_world, width, size),
        None => Camera::new(to_world, file.fov, size, file.aperture_radius, focus),
    };
    camera.shifted(file.principal_point_offset).clipped(file.near_clip)
}

fn unresolved(loaded: &LoadedScene, kind: &str, name: &str) -> Error {
    Error::malformed(Place::file(&loaded.directory), format!("there is no {kind} named \"{name}\""))
}

fn affine(matrix: &Matrix) -> Affine3A {
    Affine3A::from_mat4(Mat4::from_cols_array(matrix).transpose())
}

/// The sphere around the box of all shapes; around the camera where there are none.
fn bounding_sphere([low, high]: [Vec3; 2], camera: Vec3) -> BoundingSphere {
    if !(low.is_finite() && high.is_finite()) {
        return BoundingSphere { center: camera, radius: 1.0 };
    }
    BoundingSphere { center: 0.5 * (low + high), radius: (0.5 * (high - low).length()).max(f32::MIN_POSITIVE) }
}

/// The mesh that a shape uses; none for a sphere.
fn mesh_name(file: &ShapeFile) -> Option<&str> {
    match &file.geometry {
        GeometryFile::Mesh { mesh } => Some(mesh),
        GeometryFile::Sphere { .. } => None,
    }
}

/// The number of triangles of all shapes that shine, those of a mesh for each of its shapes.
fn emitting_triangles(shapes: &[ShapeFile], meshes: &BTreeMap<String, Arc<Mesh>>) -> u64 {
    let shining = shapes.iter().filter(|shape| shape.shines());
    shining.filter_map(|shape| meshes.get(mesh_name(shape)?)).map(|mesh| mesh.triangles.len() as u64).sum()
}

/// Most triangles of a mesh, in all the copies of it that shapes have in world coordinates.
const MOST_COPIED: usize = 1 << 16;
/// Most triangles of the copies of all meshes that several shapes use.
const MOST_COPIES: usize = 1 << 20;

/// Copies in world coordinates, which rays meet sooner than instances of a mesh, and which take more memory: triangles
/// of those so far whose mesh several shapes use.
#[derive(Default)]
struct Copies(usize);

impl Copies {
    /// Whether a shape gets a copy of its mesh, which `uses` shapes have.
    fn take(&mut self, triangles: usize, uses: usize) -> bool {
        if triangles <= SELDOM_SHARED {
            return true;
        }
        if uses.saturating_mul(triangles) > MOST_COPIED || uses > 1 && self.0 + triangles > MOST_COPIES {
            return false;
        }
        self.0 += if uses > 1 { triangles } else { 0 };
        true
    }
}

/// Builds the shape of `file`, whose mesh `uses` shapes have; in its place there may be one of its `own`.
fn shape(
    file: &ShapeFile,
    uses: usize,
    copies: &mut Copies,
    own: Option<Arc<Mesh>>,
    loaded: &LoadedScene,
) -> Result<Shape> {
    let to_world = affine(&file.to_world);
    match &file.geometry {
        GeometryFile::Mesh { mesh } => {
            let found =
                own.as_ref().or_else(|| loaded.meshes.get(mesh)).ok_or_else(|| unresolved(loaded, "mesh", mesh))?;
            let shape = Shape::mesh(found.clone(), to_world, file.flip_normals);
            // Points of lamps are sampled in the world. Were they instances, roundings on the way to their meshes could
            // bring shadow rays that end just before a lamp to it.
            let is_copy = uses > 1 && file.shines() || copies.take(found.triangles.len(), uses);
            Ok(if is_copy { shape.in_world() } else { shape })
        }
        GeometryFile::Sphere { center, radius } => {
            let scale = to_world.transform_vector3(Vec3::X).length();
            let center = to_world.transform_point3(Vec3::from_array(*center));
            let [x, y, z] = Mat3::from(to_world.matrix3).to_cols_array_2d().map(Vec3::from_array);
            let turn = Mat3::from_cols(x / scale, y / scale, z / scale);
            Ok(Shape::sphere(center, radius * scale, file.flip_normals).turned(turn))
        }
    }
}

/// Pictures by their keys.
type Images = BTreeMap<String, Texels>;

fn texture(file: &TextureFile, images: &Images) -> Result<Texture> {
    Texture::new(file, images)
}

fn material(file: &MaterialFile, images: &Images) -> Result<Material> {
    let metal = |eta: &[f32; 3], k: &[f32; 3], reflectance: &TextureFile| -> Result<Metal> {
        Ok(Metal { eta: Vec3::from_array(*eta), k: Vec3::from_array(*k), reflectance: texture(reflectance, images)? })
    };
    let facets = |alpha: f32, distribution: &Distribution| Microfacets {
        shape: match distribution {
            Distribution::Beckmann => FacetShape::Beckmann,
            Distribution::Ggx => FacetShape::Ggx,
        },
        alpha,
        grain: None,
    };
    Ok(Material::from(match file {
        MaterialFile::TwoSided { material: inner } => {
            let mut inner = material(inner, images)?;
            inner.bump.iter_mut().for_each(|bump| bump.mirrored = true);
            return Ok(Material { two_sided: true, ..inner });
        }
        MaterialFile::Tinted { specular_reflectance, specular_transmittance, material: inner } => {
            let reflectance = texture(specular_reflectance, images)?;
            let tint = Tint { reflectance, transmittance: texture(specular_transmittance, images)? };
            return Ok(Material { tint: Some(Box::new(tint)), ..material(inner, images)? });
        }
        MaterialFile::Mask { opacity, material: inner } => {
            return Ok(Material { opacity: Some(texture(opacity, images)?), ..material(inner, images)? });
        }
        MaterialFile::Null {} => Kind::Null,
        MaterialFile::BumpMap { texture: map, scale, material: inner } => {
            let map = Map::Height(texture(map, images)?, *scale);
            return Ok(Material { bump: Some(Box::new(Bump { map, mirrored: false })), ..material(inner, images)? });
        }
        MaterialFile::NormalMap { texture: map, material: inner } => {
            let map = Map::Normals(texture(map, images)?);
            return Ok(Material { bump: Some(Box::new(Bump { map, mirrored: false })), ..material(inner, images)? });
        }
        MaterialFile::RoughnessMap { texture: map, material: inner } => {
            let mut inner = material(inner, images)?;
            inner.vary_roughness(texture(map, images)?);
            return Ok(inner);
        }
        MaterialFile::Anisotropic { aspect, rotation, material: inner } => {
            let mut inner = material(inner, images)?;
            inner.grain = inner.can_have_grain().then(|| Grain::new(*aspect, (rotation % 360.0).to_radians()));
            return Ok(inner);
        }
        MaterialFile::Principled(file) => Kind::Principled(Box::new(Principled::new(parameters(file, images)?))),
        MaterialFile::PrincipledThin(file) => {
            Kind::PrincipledThin(Box::new(PrincipledThin::new(thin_parameters(file, images)?)))
        }
        MaterialFile::Blend { weight, materials } => Kind::Blend(Box::new(Blend {
            weight: texture(weight, images)?,
            parts: [material(&materials[0], images)?, material(&materials[1], images)?],
        })),
        MaterialFile::Diffuse { reflectance } => Kind::Diffuse(Diffuse { reflectance: texture(reflectance, images)? }),
        MaterialFile::RoughDiffuse { reflectance, alpha, .. } if *alpha < SMOOTH => {
            Kind::Diffuse(Diffuse { reflectance: texture(reflectance, images)? })
        }
        MaterialFile::RoughDiffuse { reflectance, alpha, qualitative } => {
            Kind::RoughDiffuse(Box::new(RoughDiffuse::new(texture(reflectance, images)?, *alpha, *qualitative)))
        }
        MaterialFile::Translucent { reflectance, transmittance } => Kind::Translucent(Translucent {
            reflectance: texture(reflectance, images)?,
            transmittance: texture(transmittance, images)?,
        }),
        MaterialFile::Conductor { eta, k, specular_reflectance } => {
            Kind::Conductor(Conductor { metal: metal(eta, k, specular_reflectance)? })
        }
        MaterialFile::RoughConductor { alpha, eta, k, specular_reflectance, .. } if *alpha < SMOOTH => {
            Kind::Conductor(Conductor { metal: metal(eta, k, specular_reflectance)? })
        }
        MaterialFile::RoughConductor { alpha, distribution, eta, k, specular_reflectance } => {
            let facets = facets(*alpha, distribution);
            Kind::RoughConductor(RoughConductor { metal: metal(eta, k, specular_reflectance)?, facets })
        }
        MaterialFile::RoughDielectric { alpha, distribution, int_ior, ext_ior }
            if *alpha >= SMOOTH && (int_ior / ext_ior - 1.0).abs() >= LEAST_STEP =>
        {
            Kind::RoughDielectric(RoughDielectric { eta: int_ior / ext_ior, facets: facets(*alpha, distribution) })
        }
        MaterialFile::Dielectric { int_ior, ext_ior } | MaterialFile::RoughDielectric { int_ior, ext_ior, .. } => {
            Kind::Dielectric(Dielectric { eta: int_ior / ext_ior })
        }
        MaterialFile::ThinDielectric { int_ior, ext_ior } => {
            Kind::ThinDielectric(ThinDielectric { eta: int_ior / ext_ior })
        }
        MaterialFile::Plastic {
            alpha,
            distribution,
            int_ior,
            ext_ior,
            diffuse_reflectance,
            specular_reflectance,
            nonlinear,
        } => Kind::Plastic(Plastic::new(
            texture(diffuse_reflectance, images)?,
            texture(specular_reflectance, images)?,
            int_ior / ext_ior,
            *nonlinear,
            (*alpha >= SMOOTH).then(|| facets(*alpha, distribution)),
        )),
    }))
}

fn filling(name: &str, file: &MediumFile, loaded: &LoadedScene) -> Result<Filling> {
    let file = match file {
        MediumFile::Homogeneous { sigma_t, albedo, g } => {
            return Ok(Filling::Even(Medium {
                extinction: Vec3::from_array(*sigma_t),
                albedo: Vec3::from_array(*albedo),
                phase: HenyeyGreenstein::new(*g),
            }));
        }
        MediumFile::Grid(file) => file,
    };
    let placed = |key: &str| {
        let placed = loaded.grids.get(&grid_key(name, key)).ok_or_else(|| unresolved(loaded, "grid", name));
        placed.map(|PlacedGrid { grid, to_world }| {
            let to_grid = to_world.inverse().as_mat4();
            (Affine3A::from_mat4(to_grid), grid.clone())
        })
    };
    let varying = |factor: [f32; 3], key: &str, given: bool| -> Result<Varying> {
        Ok(Varying { factor: Vec3::from_array(factor), grid: given.then(|| placed(key)).transpose()? })
    };
    let glows =
        (file.emission != [0.0; 3]).then(|| varying(file.emission, "emission_grid", file.emission_grid.is_some()));
    Ok(Filling::Grid(Box::new(GridMedium::new(
        placed("density")?,
        Vec3::from_array(file.sigma_t),
        varying(file.albedo, "albedo_grid", file.albedo_grid.is_some())?,
        glows.transpose()?,
        HenyeyGreenstein::new(file.g),
    ))))
}

/// The parameters of a principled material, with its textures.
fn parameters(file: &PrincipledFile, images: &Images) -> Result<Parameters> {
    Ok(Parameters {
        base_color: texture(&file.base_color, images)?,
        roughness: texture(&file.roughness, images)?,
        metallic: texture(&file.metallic, images)?,
        eta: file.eta,
        spec_tint: file.spec_tint,
        sheen: file.sheen,
        sheen_tint: file.sheen_tint,
        clearcoat: file.clearcoat,
        clearcoat_gloss: file.clearcoat_gloss,
        flatness: file.flatness,
        spec_trans: file.spec_trans,
    })
}

/// The parameters of a thin principled material, with its textures.
fn thin_parameters(file: &PrincipledThinFile, images: &Images) -> Result<principled_thin::Parameters> {
    Ok(principled_thin::Parameters {
        base_color: texture(&file.base_color, images)?,
        roughness: texture(&file.roughness, images)?,
        spec_trans: texture(&file.spec_trans, images)?,
        diff_trans: texture(&file.diff_trans, images)?,
        eta: file.eta,
        spec_tint: file.spec_tint,
        sheen: file.sheen,
        sheen_tint: file.sheen_tint,
        flatness: file.flatness,
    })
}

fn lens(to_world: &Matrix, fov: f32, aspect: f32, profile: &ProfileFile) -> Lens {
    let half_angle = 0.5 * fov.to_radians();
    let half = half_angle.tan();
    let profile = match profile {
        ProfileFile::Even {} => Profile::Even,
        ProfileFile::Plane {} => Profile::Plane,
        ProfileFile::Cone { beam_width } => Profile::Cone { cutoff: half_angle, beam: beam_width.to_radians() },
    };
    Lens { to_world: affine(to_world), half: Vec2::new(half, half / aspect), profile }
}

fn light(file: &LightFile, loaded: &LoadedScene) -> Result<Light> {
    Ok(match file {
        LightFile::Point { position, intensity } => {
            Light::Point(Point { position: Vec3::from_array(*position), intensity: Vec3::from_array(*intensity) })
        }
        LightFile::Spot { to_world, intensity, cutoff_angle, beam_width } => Light::Spot(Spot::new(
            affine(to_world),
            Vec3::from_array(*intensity),
            cutoff_angle.to_radians(),
            beam_width.to_radians(),
        )),
        LightFile::Projector { to_world, fov, aspect, intensity, texture, profile } => {
            let lens = lens(to_world, *fov, *aspect, profile);
            let picture = Texture::new(texture, &loaded.images)?;
            Light::Projector(Box::new(Projector::new(&lens, Vec3::from_array(*intensity), picture)))
        }
        LightFile::Directional { direction, irradiance } => {
            Light::Directional(Directional { direction: unit(direction), irradiance: Vec3::from_array(*irradiance) })
        }
        LightFile::Sun { direction, irradiance, angle } => {
            Light::Sun(Sun::new(unit(direction), Vec3::from_array(*irradiance), angle.to_radians()))
        }
        LightFile::Sky { sun, up, turbidity, albedo, scale, stretch, extend } => {
            let air = Atmosphere {
                sun: unit(sun),
                up: unit(up),
                turbidity: *turbidity,
                albedo: Vec3::from_array(*albedo),
                stretch: *stretch,
                extend: *extend,
            };
            let undefined = || Error::malformed(Place::file(&loaded.directory), "a sky beyond what its model says");
            Light::Envmap(Sky::new(&air).ok_or_else(undefined)?.envmap(*scale))
        }
        LightFile::Constant { radiance } => Light::Constant(Constant { radiance: Vec3::from_array(*radiance) }),
        LightFile::Envmap { file, scale, to_world } => {
            let image = loaded.images.get(file).ok_or_else(|| unresolved(loaded, "picture", file))?;
            let rotation = rotation(affine(to_world).matrix3.into());
            Light::Envmap(Envmap::new(image.clone(), *scale, rotation))
        }
    })
}

/// A direction of any length but none, normalised as it was checked: squares of long ones are beyond single precision.
fn unit(direction: &[f32; 3]) -> Vec3 {
    Vec3::from_array(*direction).as_dvec3().normalize().as_vec3()
}

/// The rotation of a transform, mirrored where that mirrors: its columns without their lengths. Where a shear has them at
/// other than right angles, y keeps its direction, and z the plane that it spans with y.
fn rotation(linear: Mat3) -> Mat3 {
    let [x, y, z] = linear.to_cols_array_2d().map(Vec3::from_array);
    let [x, y, z] = [x.normalize_or(Vec3::X), y.normalize_or(Vec3::Y), z.normalize_or(Vec3::Z)];
    if [x.dot(y), y.dot(z), z.dot(x)].into_iter().all(|cosine| cosine.abs() <= 1e-5) {
        return Mat3::from_cols(x, y, z);
    }
    let Some(forward) = (z - y * y.dot(z)).try_normalize() else { return Mat3::from_cols(x, y, z) };
    let side = y.cross(forward);
    Mat3::from_cols(if side.dot(x) < 0.0 { -side } else { side }, y, forward)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::scene::readers::resolve;

    /// Directions whose squares are beyond single precision point where they say.
    #[test]
    fn long_and_short_directions() {
        for length in [1e-30, 1e-3, 1.0, 1e20, 3e38] {
            assert!(unit(&[0.0, 0.6 * length, 0.8 * length]).distance(Vec3::new(0.0, 0.6, 0.8)) < 1e-6);
        }
    }

    /// A mesh is copied where that takes little memory, and all meshes together no more than they may.
    #[test]
    fn copies_are_bounded() {
        let mut copies = Copies::default();
        for (triangles, uses, is_copy) in [
            (SELDOM_SHARED, 1 << 22, true),
            (MOST_COPIED, 1, true),
            (MOST_COPIED + 1, 1, false),
            (MOST_COPIED / 2, 2, true),
            (MOST_COPIED / 2 + 1, 2, false),
            (SELDOM_SHARED + 1, usize::MAX, false),
        ] {
            assert_eq!(copies.take(triangles, uses), is_copy, "{triangles} {uses}");
        }
        assert_eq!(copies.0, MOST_COPIED / 2);
        let taken = (0..1000).filter(|_| copies.take(1 << 14, 4)).count();
        assert_eq!(taken, (MOST_COPIES - MOST_COPIED / 2) >> 14);
        assert!(copies.take(MOST_COPIED, 1) && !copies.take(MOST_COPIED, 2) && copies.take(SELDOM_SHARED, 2));
    }

    /// A mesh counts as often as its shapes shine; what is refused is refused before anything is made of it.
    #[test]
    fn shapes_that_shine_have_a_limit() {
        let file = r#"{"version": 1, "camera": {"to_world": [1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1], "fov": 40},
            "film": {"width": 4, "height": 4},
            "materials": {"black": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0,0,0]}}},
            "meshes": {"square": {"type": "rectangle"}},
            "shapes": [{"geometry": {"type": "mesh", "mesh": "square"}, "material": "black", "emission": [1,1,1]}]}"#;
        let mut loaded = resolve(serde_json::from_str(file).unwrap(), Path::new(""), Path::new("test")).unwrap();
        let large = Arc::new(Mesh { triangles: vec![[0; 3]; 1 << 20], ..Mesh::default() });
        loaded.meshes.values_mut().for_each(|mesh| *mesh = large.clone());
        let lamp = loaded.file.shapes[0].clone();
        loaded.file.shapes.extend(std::iter::repeat_n(lamp, 64));
        let refused = Scene::build(&loaded, [4, 4]);
        assert!(matches!(refused, Err(Error::Limit { value, limit: MOST_EMITTING, .. }) if value == 65 << 20));
        loaded.file.shapes[1].emission = Some([0.0; 3]);
        loaded.file.shapes[2].emission = None;
        assert_eq!(emitting_triangles(&loaded.file.shapes, &loaded.meshes), 63 << 20);
    }

    /// Sampling takes the transpose for the inverse, whatever a document says.
    #[test]
    fn environments_are_turned_not_sheared() {
        let turned = Mat3::from_rotation_y(0.7) * Mat3::from_rotation_x(-0.4);
        let kept = rotation(turned * Mat3::from_diagonal(Vec3::new(2.0, 4.0, 0.5)));
        assert!(kept.abs_diff_eq(turned, 1e-6), "{kept}");
        let shear = Mat3::from_cols(Vec3::new(1.0, 0.5, 0.0), Vec3::Y, Vec3::new(0.3, -0.8, 1.0));
        for mirrored in [1.0, -1.0] {
            let found = rotation(turned * shear * Mat3::from_diagonal(Vec3::new(mirrored, 1.0, 1.0)));
            assert!((found.transpose() * found).abs_diff_eq(Mat3::IDENTITY, 1e-6), "{found}");
            assert!(
                (found.determinant() - mirrored).abs() < 1e-6 && found.y_axis.distance(turned.y_axis) < 1e-6,
                "{found}"
            );
        }
    }
}
