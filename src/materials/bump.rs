//! Bump and normal maps: shading normals from a texture.
//!
//! A bump map displaces the surface along its normal (Blinn 1978); a normal map holds normals in the tangent frame. The formulas
//! are those of Mitsuba 3's `bumpmap` and `normalmap`: normals that face away from the viewer are turned about the unperturbed
//! one, and light is shadowed by the microfacets that the perturbation stands for (Estevez, Lecocq and Stein 2019).

use glam::{Vec2, Vec3};

use super::texture::Texture;
use crate::math::Frame;
use crate::math::lanes::{Mask, Real, V3};

/// A bump or normal map of a material.
#[derive(Debug, Clone)]
pub struct Bump {
    /// The map.
    pub map: Map,
    /// Whether the back of a two-sided material is shaded as a front with the same map, not as the back of the bumps.
    pub mirrored: bool,
}

/// The texture of a bump.
#[derive(Debug, Clone)]
pub enum Map {
    /// Height above the surface in scene units: the luminance of a texture times a factor.
    Height(Texture, f32),
    /// Normals n as (n + 1)/2: x along ∂p/∂u, z along the surface's own.
    Normals(Texture),
}

/// Local geometry of a surface point, from which a bump is computed.
#[derive(Debug, Clone, Copy)]
pub struct Tangents {
    /// Unit geometric normal.
    pub geometric: Vec3,
    /// Unit shading normal.
    pub normal: Vec3,
    /// ∂p/∂u and ∂p/∂v.
    pub partials: [Vec3; 2],
    /// Texture coordinates.
    pub uv: Vec2,
    /// Unit direction to the viewer.
    pub out: Vec3,
}

impl Bump {
    /// The perturbed unit shading normal; none where the map is flat.
    pub fn normal(&self, at: &Tangents) -> Option<Vec3> {
        let normal = at.normal;
        let s = (at.partials[0] - normal * normal.dot(at.partials[0])).try_normalize()?;
        let frame = Frame { s, t: normal.cross(s), n: normal };
        let mut local = match &self.map {
            Map::Normals(texture) => {
                let n = texture.eval(at.uv) * 2.0 - Vec3::ONE;
                if n.x == 0.0 && n.y == 0.0 {
                    return None;
                }
                n.try_normalize()?
            }
            Map::Height(texture, scale) => {
                let gradient = texture.slope(at.uv) * *scale;
                if gradient == Vec2::ZERO {
                    return None;
                }
                let [du, dv] = at.partials;
                let du = du + normal * (gradient.x - normal.dot(du));
                let dv = dv + normal * (gradient.y - normal.dot(dv));
                let n = du.cross(dv).try_normalize()?;
                frame.to_local(if n.dot(at.geometric) < 0.0 { -n } else { n })
            }
        };
        let out = frame.to_local(at.out);
        let mut turn = self.mirrored && out.z < 0.0;
        // A normal that faces away from the viewer is turned; a mirrored one is seen from its other side.
        let seen = if turn { Vec3::new(-local.x, -local.y, local.z) } else { local };
        turn ^= seen.dot(out) * out.z < 0.0;
        if turn {
            local = Vec3::new(-local.x, -local.y, local.z);
        }
        frame.to_world(local).try_normalize()
    }
}

/// Shadowing by bumps at a point whose shading normal was turned from one unit vector to another: the part of the light that bumps
/// do not hide and that comes from the same side of the smooth surface.
#[derive(Debug, Clone, Copy)]
pub struct Shadowing<R> {
    smooth: V3<R>,
    alpha2: R,
}

impl<R: Real> Shadowing<R> {
    /// Shadowing of the turn from `smooth` to `bumped`: α² = tan²/8 of the angle, at most 1 (Estevez et al. 2019, eq. 2).
    #[inline(always)]
    pub fn new(smooth: V3<R>, bumped: V3<R>) -> Self {
        let one = smooth.x.all(1.0);
        let cos2 = smooth.dot(bumped).squared().min(one);
        let alpha2 = ((one - cos2) * 0.125 / cos2).min(one);
        Self { smooth, alpha2: cos2.above(0.0).choose(alpha2, one) }
    }

    /// Factor for light from the unit direction `wi`, whose cosine with the bumped normal is `cos`: GGX's shadowing, or 0 where the
    /// smooth surface has the light on its other side.
    #[inline(always)]
    pub fn factor(&self, wi: V3<R>, cos: R) -> R {
        let (smooth, one) = (self.smooth.dot(wi), cos.all(1.0));
        let cos2 = smooth.squared().between(1e-12, 1.0);
        let seen = (one + (one + self.alpha2 * (one - cos2) / cos2).sqrt()).inverse() * 2.0;
        (smooth * cos).above(0.0).choose(seen, cos.all(0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::materials::texture::Wrap;
    use crate::picture::Image;
    use glam::Affine2;
    use std::sync::Arc;

    fn picture(width: usize, pixel: impl Fn(usize) -> Vec3) -> Texture {
        let image = Arc::new(Image { width, height: 1, pixels: (0..width).map(pixel).collect() });
        Texture::Bitmap { image: image.into(), to_uv: Affine2::IDENTITY, scale: 1.0, wrap: Wrap::Clamp, nearest: false }
    }

    fn at(out: Vec3) -> Tangents {
        // A unit of u is two long, one of v three.
        let partials = [Vec3::X * 2.0, Vec3::Y * 3.0];
        Tangents { geometric: Vec3::Z, normal: Vec3::Z, partials, uv: Vec2::splat(0.5), out }
    }

    #[test]
    fn flat_maps_change_nothing() {
        let maps = [
            Map::Height(picture(4, |_| Vec3::splat(0.3)), 5.0),
            Map::Height(Texture::Constant(Vec3::ONE), 5.0),
            Map::Normals(picture(4, |_| Vec3::new(0.5, 0.5, 1.0))),
        ];
        for map in maps {
            assert_eq!(Bump { map, mirrored: false }.normal(&at(Vec3::Z)), None);
        }
    }

    /// A ramp of slope dh/du = 0.8 over two units of length tilts the plane by atan(0.4).
    #[test]
    fn a_ramp_is_a_tilted_plane() {
        let map = Map::Height(picture(8, |x| Vec3::splat((x as f32 + 0.5) / 8.0)), 0.8);
        let normal = Bump { map, mirrored: false }.normal(&at(Vec3::Z)).unwrap();
        assert!(normal.distance(Vec3::new(-0.4, 0.0, 1.0).normalize()) < 1e-6, "{normal}");
    }

    #[test]
    fn normals_face_the_viewer() {
        let tilted = Vec3::new(0.6, 0.0, 0.8);
        let map = Map::Normals(picture(2, |_| (tilted + Vec3::ONE) / 2.0));
        let bump = Bump { map: map.clone(), mirrored: false };
        let mirrored = Bump { map, mirrored: true };
        let near = |a: Option<Vec3>, b: Vec3| assert!(a.unwrap().distance(b) < 1e-6, "{a:?} {b}");
        let turned = Vec3::new(-0.6, 0.0, 0.8);
        near(bump.normal(&at(Vec3::Z)), tilted);
        near(bump.normal(&at(Vec3::new(-0.9, 0.0, 0.1).normalize())), turned);
        // From behind the bumps are seen from behind, or as new ones.
        near(bump.normal(&at(Vec3::NEG_Z)), tilted);
        near(mirrored.normal(&at(Vec3::NEG_Z)), turned);
    }

    /// π·f·cos of a white diffuse surface under `normalmap` in Mitsuba 3.9.1; the last one is seen from where the normal faces away.
    #[test]
    fn shadowed_as_in_mitsuba() {
        let unit = |x: f32, y: f32, z: f32| Vec3::new(x, y, z).normalize();
        let upright = unit(0.1, 0.2, 0.9);
        for (normal, out, wi, value) in [
            (unit(0.5, 0.1, 0.8), upright, unit(0.6, 0.1, 0.3), 0.814309),
            (unit(0.5, 0.1, 0.8), upright, unit(0.9, 0.05, 0.1), 0.381010),
            (unit(-0.5, 0.3, 0.6), upright, unit(-0.3, 0.2, 0.9), 0.920249),
            (unit(0.9, 0.0, 0.3), upright, unit(0.9, 0.05, 0.1), 0.193922),
            (unit(0.7, 0.1, 0.5), unit(-0.9, 0.1, 0.2), unit(-0.3, 0.2, 0.9), 0.754733),
        ] {
            let bump = Bump { map: Map::Normals(picture(2, |_| (normal + Vec3::ONE) / 2.0)), mirrored: false };
            let turned = bump.normal(&at(out)).unwrap();
            let cos = turned.dot(wi);
            let ours = cos * Shadowing::<f32>::new(Vec3::Z.into(), turned.into()).factor(wi.into(), cos);
            assert!((ours - value).abs() < 1e-5, "{normal} {wi}: {ours} {value}");
        }
    }

    #[test]
    fn light_does_not_leak() {
        let shadowing = Shadowing::<f32>::new(Vec3::Z.into(), Vec3::new(0.6, 0.0, 0.8).into());
        let factor = |wi: Vec3, cos: f32| shadowing.factor(wi.into(), cos);
        assert_eq!(factor(Vec3::NEG_Z, 0.5), 0.0);
        assert!((factor(Vec3::Z, 0.8) - 1.0).abs() < 1e-6);
        assert!(factor(Vec3::new(0.99, 0.0, 0.1).normalize(), 0.9) < 0.7);
    }
}
