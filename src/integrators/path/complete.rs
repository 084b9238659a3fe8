//! The complete paths that traced ones consist of: each light that a path ran into, and each light that was sampled on its way, ends one.

use glam::Vec3;
use smallvec::SmallVec;

use super::vertices::Flown;
use super::{Details, Emission, NO_VERTEX, PathScratch, PathTracer, Step as Traced, Vertex};
use crate::base::random::Random;
use crate::guiding::paths::path::{CompletePath, End, Event, MOST_VERTICES, Step};
use crate::materials::phase::HenyeyGreenstein;
use crate::scene::Scene;

/// A complete path and what it brings to its sample.
#[derive(Debug, Clone)]
pub struct Contribution {
    /// The path; none where it leads from the camera straight to a light, or is too long.
    pub path: Option<CompletePath>,
    /// Its part of the sample's radiance, W·m⁻²·sr⁻¹.
    pub value: Vec3,
    /// Density p_u with which BSDFs, guides or light sampling make the path, given its place in the picture. Roulette at its last point before the
    /// light does not count, as in the balance of both.
    pub unguided: f64,
}

/// Probabilities with which guided paths go on by a kernel, by material.
#[derive(Debug, Clone)]
pub struct KernelShares(Vec<f32>);

/// Roughness at which BSDFs and above which kernels choose all directions.
const NARROW: f32 = 0.02;
const WIDE: f32 = 0.2;

impl KernelShares {
    /// Those of a scene: the smoother a material, the more of its directions does the BSDF choose (Reibold 2018, §3.3).
    pub fn new(scene: &Scene) -> Self {
        Self(scene.materials().iter().map(|material| share(material.roughness())).collect())
    }

    /// The probability at a surface of this shape.
    pub fn at(&self, scene: &Scene, shape: u32) -> f32 {
        self.0[scene.material_of(shape)]
    }

    /// The probability in a medium.
    pub fn in_medium(phase: HenyeyGreenstein) -> f32 {
        share(phase.roughness())
    }
}

fn share(roughness: f32) -> f32 {
    ((roughness - NARROW) / (WIDE - NARROW)).clamp(0.0, 1.0)
}

/// The point that stands for the sky in a direction: on a sphere around the scene.
pub(in crate::integrators) fn sky_point(scene: &Scene, from: Vec3, direction: Vec3) -> Vec3 {
    let (centre, radius) = (scene.bounds.center, 4.0 * scene.bounds.radius);
    let to = from - centre;
    let along = to.dot(direction);
    let inside = (along * along - to.length_squared() + radius * radius).max(0.0);
    let distance = inside.sqrt() - along;
    // Beside the sphere and behind it any point in that direction does.
    from + direction * if distance > 0.0 { distance } else { radius }
}

/// A path so far.
struct Begun {
    points: SmallVec<[Vec3; 6]>,
    steps: SmallVec<[Step; 6]>,
    /// Density of its steps but the last, roulette included.
    before: f64,
    /// The same with the roulette of the last step, but not its density; and that.
    survival: f64,
    last: f64,
    /// Density of the distance to its last point in a medium, or probability of getting to a surface through media; 1 where there are none. It
    /// is multiplied with the next step only: whether light from a surface gets through is no part of the balance of both ways to it.
    flight: f64,
}

impl PathTracer<'_> {
    /// Gives `take` the complete paths of which path `index` of those traced last, with records, consists. `film` is its place in the picture,
    /// `random` are the numbers that it began with, and `origin` is where its ray started.
    pub fn contributions(
        &self,
        index: usize,
        scratch: &PathScratch,
        (film, origin, random): ([f32; 2], Vec3, &Random),
        shares: &KernelShares,
        mut take: impl FnMut(Contribution),
    ) {
        let (path, vertices) = (&scratch.paths[index], &scratch.vertices);
        let background = vertices.background(path).emission;
        let mut order: SmallVec<[u32; 16]> = SmallVec::new();
        let mut at = path.last;
        while at != NO_VERTEX {
            order.push(at);
            at = vertices.all[at as usize].previous;
        }
        order.reverse();
        let mut begun = Begun {
            points: SmallVec::new(),
            steps: SmallVec::new(),
            before: 1.0,
            survival: 1.0,
            last: 1.0,
            flight: 1.0,
        };
        // What the path carries to a vertex before media on the way dim it, as they do what it meets there.
        let mut carried = Vec3::ONE;
        for (number, &vertex) in order.iter().enumerate() {
            let details = &vertices.details[vertex as usize];
            let (met, last) = (details.emission, number + 1 == order.len());
            let flown = vertices.flights.get(vertex as usize);
            begun.flight = flown.map_or(1.0, |flown| f64::from(flown.density));
            begun.points.push(details.point);
            let value = carried * met.weighted();
            if value != Vec3::ZERO {
                take(begun.ended(value, met, End::Surface, film, origin));
            }
            let share = self.share(shares, details, flown);
            self.direct(number, details, share, (&begun, film, origin, random), &mut take);
            let Vertex { weight, survival, .. } = vertices.all[vertex as usize];
            carried = details.throughput * weight / survival;
            match &details.step {
                Some(step) if !last || background.weight > 0.0 => begun.go_on(step, details, share),
                _ => {}
            }
        }
        let value = path.throughput * background.weighted();
        if value != Vec3::ZERO {
            begun.points.push(sky_point(
                self.scene,
                begun.points.last().copied().unwrap_or(origin),
                path.ray.direction,
            ));
            take(begun.ended(value, background, End::Sky, film, origin));
        }
    }

    fn share(&self, shares: &KernelShares, details: &Details, flown: Option<&Flown>) -> f32 {
        match flown.and_then(|flown| flown.phase) {
            Some(phase) => KernelShares::in_medium(phase),
            None => shares.at(self.scene, details.shape),
        }
    }

    /// The path that ends at the light that was sampled at vertex `number`.
    fn direct(
        &self,
        number: usize,
        details: &Details,
        by_kernel: f32,
        (begun, film, origin, random): (&Begun, [f32; 2], Vec3, &Random),
        take: &mut impl FnMut(Contribution),
    ) {
        let Some(light) = &details.direct.towards else { return };
        let value = details.throughput * details.direct.value;
        if value == Vec3::ZERO {
            return;
        }
        let ((ray, length), direction) = (light.ray, light.ray.0.direction);
        let end = match self.sampled_light(number, details.point, random) {
            Some(index) if light.onward == 0.0 && !self.scene.lights.lights[index].is_reachable() => {
                End::Light(index as u32)
            }
            _ if length.is_infinite() => End::Sky,
            _ => End::Surface,
        };
        let density = match end {
            // Both techniques choose the place on an unseen surface alike: its density is left out of both.
            End::Light(index) => {
                let at = details.point;
                self.scene.lights.probability(at, index as usize, self.lights.odds(at)) * details.tried
            }
            End::Surface | End::Sky => light.pdf + light.onward,
        };
        let unguided = begun.before * begun.survival * begun.last * begun.flight * f64::from(density);
        let event = event(details, direction, false);
        let step = Step { direction, pdf: light.onward, by_kernel, event };
        let (mut points, mut steps) = (begun.points.clone(), begun.steps.clone());
        steps.push(step);
        match end {
            End::Surface => points.push(ray.at(length)),
            End::Sky => points.push(sky_point(self.scene, details.point, direction)),
            End::Light(_) => {}
        }
        let path = CompletePath { film, origin, points, steps, end };
        take(Contribution { path: usable(path), value, unguided });
    }

    /// Index of the light that was chosen at vertex `number`.
    fn sampled_light(&self, number: usize, point: Vec3, random: &Random) -> Option<usize> {
        let mut random = random.clone();
        random.begin_vertex(number as u32 + 1);
        let lights = &self.scene.lights;
        Some(lights.choose(point, lights.choice(&random), self.lights.odds(point))?.0)
    }
}

/// What happens where a path goes on in a direction.
fn event(details: &Details, direction: Vec3, delta: bool) -> Event {
    // Media have no normals.
    let medium = details.normal == Vec3::ZERO;
    Event { transmits: details.normal.dot(direction) < 0.0, delta, medium }
}

/// The path if it is not too long.
fn usable(path: CompletePath) -> Option<CompletePath> {
    (path.points.len() <= MOST_VERTICES && path.is_finite()).then_some(path)
}

impl Begun {
    /// Takes the path on from its last point.
    fn go_on(&mut self, step: &Traced, details: &Details, by_kernel: f32) {
        self.before *= self.last * self.survival * self.flight;
        (self.last, self.survival) = (f64::from(step.pdf), f64::from(step.survival));
        self.steps.push(Step {
            direction: step.direction,
            pdf: step.pdf,
            by_kernel: if step.delta { 0.0 } else { by_kernel },
            event: event(details, step.direction, step.delta),
        });
    }

    /// The path that ended on the light that it `met`.
    fn ended(&self, value: Vec3, met: Emission, end: End, film: [f32; 2], origin: Vec3) -> Contribution {
        // The weight is p / (p + p_l).
        let unguided = self.before * self.last / f64::from(met.weight);
        if self.steps.is_empty() {
            return Contribution { path: None, value, unguided };
        }
        let (points, steps) = (self.points.clone(), self.steps.clone());
        Contribution { path: usable(CompletePath { film, origin, points, steps, end }), value, unguided }
    }
}
