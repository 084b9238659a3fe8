//! Sixteen points in lanes have the bits of sixteen points one by one: materials of every variant, in random directions and in those
//! where something happens.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{Affine2, Vec2, Vec3};

use super::fresnel::Metal;
use super::microfacet::{Grain, Microfacets, Shape};
use super::principled::Parameters;
use super::principled_thin::{self, PrincipledThin};
use super::texture::Wrap;
use super::*;
use crate::base::processor::{Avx2, Avx512};
use crate::base::random::Random;
use crate::math::lanes::{Gather, Kernel, LANES, Real, Wide, lanes_of};
use crate::picture::Image;
use crate::sampling::warp;

/// A texture of values between two.
fn texture(random: &mut Random, low: f32, high: f32) -> Texture {
    let mut color = || Vec3::new(random.range(low, high), random.range(low, high), random.range(low, high));
    let pixels: Vec<Vec3> = (0..4).map(|_| color()).collect();
    let [color0, color1] = [pixels[0], pixels[1]];
    match random.below(3) {
        0 => Texture::Constant(color0),
        1 => Texture::Checkerboard { color0, color1, to_uv: Affine2::IDENTITY },
        _ => {
            let image = Arc::new(Image { width: 2, height: 2, pixels }).into();
            Texture::Bitmap { image, to_uv: Affine2::IDENTITY, scale: 1.0, wrap: Wrap::Repeat, nearest: false }
        }
    }
}

/// Roughnesses of all magnitudes.
fn alpha(random: &mut Random) -> f32 {
    10f32.powf(random.range(-3.5, 0.0))
}

fn facets(random: &mut Random, shape: Shape) -> Microfacets {
    Microfacets::even(shape, alpha(random))
}

fn metal(random: &mut Random) -> Metal {
    let mut any = |low: f32, high: f32| Vec3::from_array([0; 3].map(|_| random.range(low, high)));
    Metal { eta: any(0.1, 3.0), k: any(0.0, 6.0), reflectance: texture(random, 0.0, 1.0) }
}

fn principled(random: &mut Random, spec_trans: f32) -> Kind {
    let mut some = |most: f32| if random.below(3) == 0 { 0.0 } else { random.range(0.0, most) };
    let [spec_tint, sheen, sheen_tint, clearcoat, clearcoat_gloss, flatness] = [0; 6].map(|_| some(1.0));
    let eta = random.range(1.0, 2.0);
    let metallic = if random.below(2) == 0 { Texture::Constant(Vec3::ZERO) } else { texture(random, 0.0, 1.0) };
    Kind::Principled(Box::new(Principled::new(Parameters {
        base_color: texture(random, 0.0, 1.0),
        roughness: texture(random, 0.0, 1.0),
        metallic,
        eta,
        spec_tint,
        sheen,
        sheen_tint,
        clearcoat,
        clearcoat_gloss,
        flatness,
        spec_trans,
    })))
}

fn principled_thin(random: &mut Random) -> Kind {
    let mut some = |most: f32| if random.below(3) == 0 { 0.0 } else { random.range(0.0, most) };
    let [spec_tint, sheen, sheen_tint, flatness] = [0; 4].map(|_| some(1.0));
    let eta = random.range(1.0, 2.0);
    let [base_color, roughness, spec_trans, diff_trans] = [0; 4].map(|_| texture(random, 0.0, 1.0));
    let parameters = principled_thin::Parameters {
        base_color,
        roughness,
        spec_trans,
        diff_trans,
        eta,
        spec_tint,
        sheen,
        sheen_tint,
        flatness,
    };
    Kind::PrincipledThin(Box::new(PrincipledThin::new(parameters)))
}

/// Models with every discrete option.
fn kinds(random: &mut Random) -> Vec<Kind> {
    let mut kinds = vec![Kind::Null, Kind::Diffuse(Diffuse { reflectance: texture(random, 0.0, 1.0) })];
    for (alpha, qualitative) in [(0.1, false), (0.6, false), (0.02, true), (1.0, true), (3.0, false)] {
        kinds.push(Kind::RoughDiffuse(Box::new(RoughDiffuse::new(texture(random, 0.0, 1.0), alpha, qualitative))));
    }
    kinds.push(Kind::Conductor(Conductor { metal: metal(random) }));
    kinds.push(Kind::Dielectric(Dielectric { eta: random.range(0.5, 2.0) }));
    kinds.push(Kind::ThinDielectric(ThinDielectric { eta: random.range(1.0, 2.0) }));
    let plastic = |random: &mut Random, facets| {
        let [base, coat] = [0; 2].map(|_| texture(random, 0.0, 1.0));
        Kind::Plastic(Plastic::new(base, coat, random.range(1.1, 2.0), random.below(2) == 0, facets))
    };
    kinds.push(plastic(random, None));
    for shape in [Shape::Beckmann, Shape::Ggx] {
        kinds.push(Kind::RoughConductor(RoughConductor { metal: metal(random), facets: facets(random, shape) }));
        let eta = random.range(0.5, 2.0);
        kinds.push(Kind::RoughDielectric(RoughDielectric { eta, facets: facets(random, shape) }));
        let coat = facets(random, shape);
        kinds.push(plastic(random, Some(coat)));
    }
    kinds.extend([0.0, random.next_f32(), 1.0].map(|spec_trans| principled(random, spec_trans)));
    kinds.push(principled_thin(random));
    let [reflectance, transmittance] = [0; 2].map(|_| texture(random, 0.0, 1.0));
    kinds.push(Kind::Translucent(Translucent { reflectance, transmittance }));
    let part = kinds[random.below(kinds.len() as u32) as usize].clone();
    let parts = [part, kinds[1].clone()].map(Material::from);
    kinds.push(Kind::Blend(Box::new(Blend { weight: texture(random, 0.0, 1.0), parts })));
    kinds
}

/// Materials of all variants, one-sided and two-sided.
fn materials(random: &mut Random) -> Vec<Material> {
    let mut materials = vec![];
    for _ in 0..3 {
        for kind in kinds(random) {
            let tint = Tint { reflectance: texture(random, 0.0, 2.0), transmittance: texture(random, 0.0, 2.0) };
            let material = Material { two_sided: random.below(2) == 0, ..kind.into() };
            materials.push(Material { tint: Some(Box::new(tint)), ..material.clone() });
            let mut varying = material.clone();
            varying.vary_roughness(texture(random, 0.0, 1.0));
            materials.push(varying);
            if material.can_have_grain() {
                let grain = Some(Grain::new(random.range(0.1, 4.0), random.range(-3.0, 3.0)));
                let tint = Some(Box::new(Tint {
                    reflectance: texture(random, 0.0, 2.0),
                    transmittance: texture(random, 0.0, 2.0),
                }));
                materials.push(Material { grain, tint, ..material.clone() });
                materials.push(Material { grain, ..material.clone() });
            }
            materials.push(material);
        }
    }
    materials
}

/// A direction anywhere, or grazing, along the surface, the normal, or against it.
fn direction(random: &mut Random) -> Vec3 {
    let any = warp::square_to_sphere(random.next_2d());
    match random.below(10) {
        0 => Vec3::Z,
        1 => Vec3::NEG_Z,
        2 => Vec3::new(any.x, any.y, 0.0).normalize(),
        3 => Vec3::new(any.x, any.y, any.z * 1e-4).normalize(),
        4 => Vec3::new(any.x * 1e-4, any.y * 1e-4, any.z).normalize(),
        _ => any,
    }
}

/// Numbers of one question.
#[derive(Debug, Clone, Copy)]
struct Question<R> {
    wo: V3<R>,
    wi: V3<R>,
    lobe: R,
    u: [R; 2],
}

lanes_of!(Question { wo, wi, lobe, u });

impl Question<f32> {
    /// Half of the directions are sampled by the material, some mirrored or opposite, so that narrow lobes are met.
    fn new(bsdf: &Bsdf<'_, f32>, random: &mut Random) -> Self {
        let wo = direction(random).into();
        let (lobe, u) = (random.next_f32(), random.next_2d());
        let drawn = bsdf.sample(wo, random.next_f32(), random.next_2d(), Transport::Radiance);
        let wi = match random.below(8) {
            0 => V3::new(-wo.x, -wo.y, wo.z),
            1 => -wo,
            2..5 if drawn.found => drawn.wi,
            _ => direction(random).into(),
        };
        Self { wo, wi, lobe, u }
    }
}

/// What is asked.
#[derive(Debug, Clone, Copy)]
enum Ask {
    Eval,
    Pdf,
    EvalAndPdf,
    Rest,
    Sample(Transport),
}

const ASKED: [Ask; 6] = [
    Ask::Eval,
    Ask::Pdf,
    Ask::EvalAndPdf,
    Ask::Rest,
    Ask::Sample(Transport::Radiance),
    Ask::Sample(Transport::Importance),
];

/// The answer, with zeros behind it and for what is not found.
#[inline(always)]
fn answer<R: Real>(ask: Ask, bsdf: &Bsdf<'_, R>, question: &Question<R>) -> [R; 9] {
    let Question { wo, wi, lobe, u } = *question;
    let [zero, one] = [lobe.all(0.0), lobe.all(1.0)];
    match ask {
        Ask::Eval => {
            let value = bsdf.eval(wo, wi);
            [value.x, value.y, value.z, zero, zero, zero, zero, zero, zero]
        }
        Ask::Pdf => [zero, zero, zero, bsdf.pdf(wo, wi), zero, zero, zero, zero, zero],
        Ask::EvalAndPdf => {
            let (value, pdf) = bsdf.eval_and_pdf(wo, wi);
            [value.x, value.y, value.z, pdf, zero, zero, zero, zero, zero]
        }
        Ask::Rest => {
            let (deltas, eta, albedo) = (bsdf.delta_probability(wo), bsdf.eta(wo, wi), bsdf.albedo());
            [deltas, eta, albedo.x, albedo.y, albedo.z, zero, zero, zero, zero]
        }
        Ask::Sample(transport) => {
            let Drawn { wi, weight, pdf, delta, found } = bsdf.sample(wo, lobe, u, transport);
            let (wi, weight) = (wi.only(found), weight.only(found));
            let [found_number, delta_number] = [one.only(found), one.only(found & delta)];
            [wi.x, wi.y, wi.z, weight.x, weight.y, weight.z, pdf.only(found), delta_number, found_number]
        }
    }
}

#[derive(Clone, Copy)]
struct Sixteen<'a> {
    ask: Ask,
    points: [&'a Bsdf<'a, f32>; LANES],
    questions: [Question<f32>; LANES],
}

impl Kernel for Sixteen<'_> {
    type Output = [[f32; LANES]; 9];

    #[inline(always)]
    fn run<W: Wide>(self, wide: W) -> Self::Output {
        let question = Gather::gather(wide, std::array::from_fn(|lane| &self.questions[lane]));
        answer(self.ask, &Bsdf::gather(wide, self.points), &question).map(|answer| wide.store(answer))
    }
}

impl Sixteen<'_> {
    /// One by one.
    fn alone(&self) -> [[f32; 9]; LANES] {
        std::array::from_fn(|lane| answer(self.ask, self.points[lane], &self.questions[lane]))
    }

    fn assert_same(&self, found: &[[f32; LANES]; 9], expected: &[[f32; 9]; LANES]) {
        for (lane, expected) in expected.iter().enumerate() {
            for (i, expected) in expected.iter().enumerate() {
                let (found, question) = (found[i][lane], self.questions[lane]);
                let same = found.to_bits() == expected.to_bits() || found.is_nan() && expected.is_nan();
                let variant = self.points[lane].variant();
                assert!(same, "{variant:?}, {:?} {i}: {found} {expected}, for {question:?}", self.ask);
            }
        }
    }
}

#[test]
fn points_in_lanes_have_the_bits_of_points_alone() {
    let mut random = Random::new(29, 0, 0);
    let materials = materials(&mut random);
    let uv = |random: &mut Random| Vec2::from_array(random.next_2d());
    let points: Vec<Bsdf<'_, f32>> =
        materials.iter().flat_map(|material| [(); 8].map(|()| material.at(uv(&mut random)))).collect();
    let mut variants = BTreeMap::<usize, Vec<&Bsdf<'_, f32>>>::new();
    for point in &points {
        variants.entry(point.variant().index()).or_default().push(point);
    }
    // All that is told apart but for bounded qualitative facets, with and without a tint.
    println!("variants {:?}", variants.keys());
    assert!(variants.keys().all(|&index| index < Variant::COUNT) && variants.len() >= 2 * 25, "{}", variants.len());
    for points in variants.values() {
        for _ in 0..if cfg!(miri) { 1 } else { 400 } {
            let points = [(); LANES].map(|()| points[random.below(points.len() as u32) as usize]);
            let questions = points.map(|point| Question::new(point, &mut random));
            for ask in ASKED {
                let sixteen = Sixteen { ask, points, questions };
                let alone = sixteen.alone();
                #[cfg(target_arch = "x86_64")]
                {
                    Avx2::detect().into_iter().for_each(|avx2| sixteen.assert_same(&avx2.run(sixteen), &alone));
                    Avx512::detect().into_iter().for_each(|avx512| sixteen.assert_same(&avx512.run(sixteen), &alone));
                }
            }
            for (point, question) in points.iter().zip(&questions) {
                let [value, pdf, both] = [Ask::Eval, Ask::Pdf, Ask::EvalAndPdf].map(|ask| answer(ask, point, question));
                let apart = [value[0], value[1], value[2], pdf[3]].map(f32::to_bits);
                assert_eq!(apart, [both[0], both[1], both[2], both[3]].map(f32::to_bits), "{question:?}");
            }
        }
    }
}
