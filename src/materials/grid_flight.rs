//! Flights through media that vary in space whose density is known in closed form: complete paths need it (Reibold 2018), and so do distances by
//! the light that is expected (Herholz et al. 2019). Between the centres of eight cells the density is trilinear, so along a ray it is a
//! polynomial of the third degree there, of which Simpson's rule is the exact integral: the optical depth is summed cell by cell ("regular
//! tracking"). That takes longer than to ask here and there, as delta tracking does.

use glam::{DVec4, Vec3};

use super::grid_medium::{Flown, GridMedium};
use super::medium::{Flight, PARTS, Part, channel, depth_of, lost, quotient, shares};
use super::walk::{Crossed, Walk};
use crate::base::random::Random;
use crate::geometry::Ray;
use crate::math::lanes::functions::{exp, ln};

/// How far outside of the unit cube of a grid rounding may take a point.
const ROUNDED: f32 = 1e-5;
/// Most steps that look for a depth within a cell; Newton's take five or six.
const MOST_STEPS: usize = 40;

/// A ray on its way through a grid.
#[derive(Clone)]
struct Course<'a> {
    medium: &'a GridMedium,
    ray: &'a Ray,
    walk: Walk,
    /// Where it is, and where its cell ends.
    at: f32,
    to: f32,
    /// Density here.
    here: Vec3,
    /// Integral of the density up to here.
    thickness: Vec3,
}

impl<'a> Course<'a> {
    /// At the point where the ray enters the grid, of its part up to `limit`.
    fn new(medium: &'a GridMedium, ray: &'a Ray, limit: f32) -> Self {
        let sides = Vec3::from_array(medium.density.size().map(|side| side as f32));
        // In cells between centres, of which there is half a one at either end.
        let origin = medium.to_grid.transform_point3(ray.origin) * sides + 0.5;
        let direction = medium.to_grid.transform_vector3(ray.direction) * sides;
        let cells = medium.density.size().map(|side| side + 1);
        let walk = Walk::new(cells, origin, direction, [Vec3::splat(0.5), sides + 0.5], limit);
        let [at, _] = walk.rest();
        Self { medium, ray, walk, at, to: at, here: medium.density(ray.at(at)), thickness: Vec3::ZERO }
    }

    /// Where the ray leaves the grid, or its limit.
    fn end(&self) -> f32 {
        self.walk.rest()[1].max(self.to)
    }

    fn density(&self, at: f32) -> Vec3 {
        self.medium.density(self.ray.at(at))
    }

    /// Goes on to a distance within the cell, where the density is `there`.
    fn go_to(&mut self, at: f32, there: Vec3, part: Vec3) {
        self.thickness += part;
        (self.at, self.here) = (at, there);
    }

    /// Integral of the density up to a distance within the cell, from here on, and the density there and half way.
    fn part(&self, to: f32) -> (Vec3, Vec3, Vec3) {
        let (middle, there) = (self.density(0.5 * (self.at + to)), self.density(to));
        ((to - self.at) / 6.0 * (self.here + 4.0 * middle + there), there, middle)
    }

    /// Goes on to the first distance at which the thickness weighted by `weights` is `target`, or to the end if it never is.
    fn until(&mut self, weights: Vec3, target: f32) -> Option<f32> {
        loop {
            if self.at >= self.to {
                let Crossed { from, to, .. } = self.walk.next()?;
                (self.at, self.to) = (from, to);
                continue;
            }
            let (part, there, middle) = self.part(self.to);
            let (needed, all) = (target - weights.dot(self.thickness), weights.dot(part));
            if all > 0.0 && all >= needed {
                let length = self.to - self.at;
                let quarter = self.density(self.at + 0.25 * length);
                let values = [self.here, quarter, middle, there].map(|density| f64::from(weights.dot(density)));
                let at = (self.at + length * within(values, f64::from(needed / length))).clamp(self.at, self.to);
                let (part, there, _) = self.part(at);
                self.go_to(at, there, part);
                return Some(at);
            }
            self.go_to(self.to, there, part);
        }
    }
}

/// The place s in [0, 1] up to which the integral of the polynomial of the third degree is `area` that has these values at 0, ¼, ½ and 1. It
/// is nowhere negative.
fn within([first, quarter, middle, last]: [f64; 4], area: f64) -> f32 {
    let (q, m, l) = (quarter - first, middle - first, last - first);
    let b = (64.0 * q - 24.0 * m + 2.0 * l) / 6.0;
    let c = 8.0 * m - l - 3.0 * b;
    let terms = DVec4::new(first, b, c, l - b - c);
    let value = |s: f64| terms.dot(DVec4::new(1.0, s, s * s, s * s * s));
    let integral = |s: f64| s * (terms / DVec4::new(1.0, 2.0, 3.0, 4.0)).dot(DVec4::new(1.0, s, s * s, s * s * s));
    let (mut low, mut high, mut s) = (0.0, 1.0, 0.5);
    for _ in 0..MOST_STEPS {
        let over = integral(s) - area;
        if over > 0.0 {
            high = s
        } else {
            low = s
        }
        // Newton's step where it stays between what is known, otherwise half way.
        let step = s - over / value(s);
        let next = if step > low && step < high { step } else { 0.5 * (low + high) };
        if (next - s).abs() < 1e-9 {
            break;
        }
        s = next;
    }
    s as f32
}

/// Transmittances relative to that of the channel that gets farthest among those that can be chosen.
fn relative(share: Vec3, depth: Vec3) -> Vec3 {
    let chosen = Vec3::select(share.cmpgt(Vec3::ZERO), depth, Vec3::INFINITY);
    (Vec3::splat(chosen.min_element()) - depth).map(exp)
}

impl GridMedium {
    /// As [`GridMedium::fly`], by an optical depth that is known: one channel, chosen in proportion to what the path carries in it, decides the
    /// distance, and the weight is by the density of all of them, as [`Medium::sample`](super::medium::Medium::sample) has it. Of a
    /// medium that scatters nothing nothing but its own light is drawn.
    pub fn fly_known(&self, ray: &Ray, limit: f32, carried: Vec3, random: &mut Random) -> Flown {
        let ([choice, u], share) = (random.next_2d(), shares(carried));
        if self.is_black && self.emission.is_none() {
            return self.passed(ray, carried, limit);
        }
        let mut course = Course::new(self, ray, limit);
        let flown = self.fly_on(&mut course, share, channel(share, choice), -ln(1.0 - u), limit);
        if self.is_black { Flown { glow: flown.glow, ..self.passed(ray, carried, limit) } } else { flown }
    }

    /// Goes on until the optical depth from here on is `depth` in a channel, or to the end.
    fn fly_on(&self, course: &mut Course, share: Vec3, channel: usize, depth: f32, limit: f32) -> Flown {
        let target = course.thickness[channel] + depth / self.extinction[channel];
        // Without extinction in the channel it is infinite, or not a number.
        let target = if target.is_nan() { f32::INFINITY } else { target };
        match course.until(Vec3::AXES[channel], target) {
            Some(distance) => self.collision(course.ray, share, distance.min(limit.next_down()), course.thickness),
            None => self.through(share, course.thickness),
        }
    }

    /// A collision at this distance as [`GridMedium::fly_known`] returns it.
    pub fn collision_at(&self, ray: &Ray, carried: Vec3, distance: f32) -> Flown {
        if self.is_black || !self.holds(ray.at(distance)) {
            let end = Flight::Collision { distance, weight: Vec3::ZERO };
            return Flown { end, glow: Vec3::ZERO, density: 0.0 };
        }
        self.collision(ray, shares(carried), distance, self.thickness(ray, distance))
    }

    /// Whether a point is within the grid; what was drawn within may seem to lie beyond by rounding.
    fn holds(&self, point: Vec3) -> bool {
        let place = self.to_grid.transform_point3(point);
        place.cmpge(Vec3::splat(-ROUNDED)).all() && place.cmple(Vec3::splat(1.0 + ROUNDED)).all()
    }

    /// No collision up to the limit as [`GridMedium::fly_known`] returns it; of a medium that scatters nothing without its light.
    pub fn passed(&self, ray: &Ray, carried: Vec3, limit: f32) -> Flown {
        let thickness = self.thickness(ray, limit);
        if self.is_black {
            let weight = (-self.extinction * thickness).map(exp);
            return Flown { end: Flight::Through { weight }, glow: Vec3::ZERO, density: 1.0 };
        }
        self.through(shares(carried), thickness)
    }

    /// Integral of the density along the first `length` of a ray, per channel.
    fn thickness(&self, ray: &Ray, length: f32) -> Vec3 {
        let mut course = Course::new(self, ray, length);
        course.until(Vec3::ONE, f32::INFINITY);
        course.thickness
    }

    /// A collision at a distance that was drawn by channels of these shares.
    fn collision(&self, ray: &Ray, share: Vec3, distance: f32, thickness: Vec3) -> Flown {
        let (point, depth) = (ray.at(distance), self.extinction * thickness);
        let (extinction, albedo) = (self.extinction * self.density(point).max(Vec3::ZERO), self.albedo.at(point));
        let relative = extinction * relative(share, depth);
        let all = (share * relative).element_sum();
        let glow = match &self.emission {
            Some(emission) => quotient((Vec3::ONE - albedo) * relative * emission.at(point), all),
            None => Vec3::ZERO,
        };
        let density = (share * extinction * (-depth).map(exp)).element_sum();
        Flown { end: Flight::Collision { distance, weight: quotient(albedo * relative, all) }, glow, density }
    }

    /// No collision.
    fn through(&self, share: Vec3, thickness: Vec3) -> Flown {
        let depth = self.extinction * thickness;
        let relative = relative(share, depth);
        let density = (share * (-depth).map(exp)).element_sum();
        let weight = quotient(relative, (share * relative).element_sum());
        Flown { end: Flight::Through { weight }, glow: Vec3::ZERO, density }
    }

    /// [`GridMedium::fly`] where it is known how much light is expected, as
    /// [`Medium::sample_expecting`](super::medium::Medium::sample_expecting) has it; its density is not told.
    pub fn fly_expecting(
        &self,
        ray: &Ray,
        limit: f32,
        carried: Vec3,
        random: &mut Random,
        expected: impl Fn(Option<f32>) -> Option<f32>,
    ) -> Flown {
        let share = shares(carried);
        let (mean, begun) = (share * self.extinction, Course::new(self, ray, limit));
        let mut ended = begun.clone();
        ended.until(mean, f32::INFINITY);
        let depth = mean.dot(ended.thickness);
        if self.is_black || !(depth > 0.0 && depth.is_finite()) {
            return self.fly(ray, limit, carried, random);
        }
        // Where each part begins: collisions are about as likely in each.
        let mut begins: [Course; PARTS] = std::array::from_fn(|_| begun.clone());
        for part in 1..PARTS {
            begins[part] = begins[part - 1].clone();
            begins[part].until(mean, depth_of(lost(depth) * part as f32 / PARTS as f32));
        }
        let through = |thickness: Vec3| (-self.extinction * thickness).map(exp);
        let known = |worth: Option<f32>| worth.filter(|worth| worth.is_finite()).map(|worth| worth.max(0.0));
        let (mut odds, mut worth) = ([0.0; PARTS + 1], [None; PARTS + 1]);
        // Of each part its depth, the probability of a collision by the channel that decides, and its end.
        let (mut depths, mut collides, mut ends) = ([Vec3::ZERO; PARTS], [Vec3::ZERO; PARTS], [ended.end(); PARTS]);
        for (part, begin) in begins.iter().enumerate() {
            let next = begins.get(part + 1);
            ends[part] = next.map_or(ended.end(), |next| next.at);
            depths[part] = self.extinction * (next.unwrap_or(&ended).thickness - begin.thickness).max(Vec3::ZERO);
            collides[part] = share * through(begin.thickness) * depths[part].map(lost);
            odds[part] = collides[part].element_sum();
            let middle = 0.5 * (begin.at + ends[part]);
            let albedo = (share * self.albedo.at(ray.at(middle))).element_sum();
            worth[part] = known(expected(Some(middle))).map(|worth| worth * albedo);
        }
        odds[PARTS] = (share * through(ended.thickness)).element_sum();
        worth[PARTS] = known(expected(None));
        let [choice, u] = random.next_2d();
        let Some(Part { number, within, rarer }) = Part::choose(&odds, &worth, u) else {
            return self.fly(ray, limit, carried, random);
        };
        let Some(begin) = begins.get_mut(number) else { return self.through(share, ended.thickness).times(rarer) };
        let channel = channel(collides[number] / odds[number], choice);
        let depth = depth_of(within * lost(depths[number][channel]));
        self.fly_on(begin, share, channel, depth, ends[number].min(limit)).times(rarer)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::{Affine3A, DVec3};

    use super::*;
    use crate::materials::grid::{Edge, Grid, Values};
    use crate::materials::grid_medium::Varying;
    use crate::materials::phase::HenyeyGreenstein;

    fn grid(size: [u32; 3], channels: u32, edge: Edge, random: &mut Random) -> Arc<Grid> {
        let count = size.iter().product::<u32>() * channels;
        // A third of the cells are empty.
        let values = Values::Floats((0..count).map(|_| (1.5 * random.next_f32() - 0.5).max(0.0)).collect());
        Arc::new(Grid::new(size, channels, &values, edge).unwrap())
    }

    /// Media of one and of three channels whose densities begin suddenly and fade in, with grids of their own for albedo and light; the last
    /// scatters nothing.
    fn media() -> [GridMedium; 4] {
        let mut random = Random::new(5, 0, 0);
        let to_grid = Affine3A::from_scale(Vec3::new(0.5, 0.25, 1.0));
        let varying = |factor: Vec3, random: &mut Random| Varying {
            factor,
            grid: Some((Affine3A::from_scale(Vec3::splat(0.4)), grid([3, 4, 2], 3, Edge::Continues, random))),
        };
        let phase = HenyeyGreenstein::new(0.0);
        let even = |albedo| Varying { factor: Vec3::splat(albedo), grid: None };
        let one = (to_grid, grid([5, 2, 3], 1, Edge::Continues, &mut random));
        let three = (to_grid, grid([4, 3, 1], 3, Edge::Fades, &mut random));
        let thin = (to_grid, grid([2, 2, 2], 1, Edge::Fades, &mut random));
        let (albedo, light) = (varying(Vec3::splat(0.9), &mut random), varying(Vec3::new(1.0, 2.0, 3.0), &mut random));
        [
            GridMedium::new(one, Vec3::new(1.0, 2.0, 0.3), even(0.8), None, phase),
            GridMedium::new(three.clone(), Vec3::new(3.0, 1.0, 2.0), albedo, Some(light.clone()), phase),
            GridMedium::new(thin, Vec3::new(0.0, 0.02, 0.05), even(1.0), None, phase),
            GridMedium::new(three, Vec3::new(1.0, 1.0, 2.0), even(0.0), Some(light), phase),
        ]
    }

    fn rays() -> impl Iterator<Item = (Ray, f32)> {
        let mut random = Random::new(6, 0, 0);
        (0..).map(move |number| {
            let mut point = || Vec3::new(random.range(-0.5, 2.5), random.range(-1.0, 5.0), random.range(-0.5, 1.5));
            let (origin, to) = (point(), point());
            let direction = if number % 10 == 0 { Vec3::Y } else { (to - origin).normalize() };
            (Ray { origin, direction }, if number % 2 == 0 { f32::INFINITY } else { origin.distance(to) })
        })
    }

    /// Those that meet something of a medium.
    fn through(medium: &GridMedium) -> impl Iterator<Item = (Ray, f32)> {
        rays().filter(|(ray, limit)| medium.thickness(ray, *limit).max_element() > 0.1)
    }

    /// What a ray of this length meets, at the middle of each of many parts: integrals up to there, by the length of the part.
    fn parts(medium: &GridMedium, ray: &Ray, length: f32) -> (f64, Vec<(f32, DVec3, DVec3)>) {
        const STEPS: usize = 4000;
        let (step, mut depth) = (f64::from(length) / STEPS as f64, DVec3::ZERO);
        let all = (0..STEPS).map(|i| {
            let at = ((i as f64 + 0.5) * step) as f32;
            let p = medium.to_grid.transform_point3(ray.at(at));
            let inside = p.cmpge(Vec3::ZERO).all() && p.cmple(Vec3::ONE).all();
            let extinction =
                if inside { medium.extinction * medium.density(ray.at(at)) } else { Vec3::ZERO }.as_dvec3();
            let middle = depth + extinction * (0.5 * step);
            depth += extinction * step;
            (at, extinction, (-middle).map(f64::exp))
        });
        (step, all.collect())
    }

    /// Optical depths are those of a sum of 4,000 parts, and the distance of any part of a depth has that depth.
    #[test]
    fn depths_and_distances_are_one_anothers_inverse() {
        let media = media();
        let mut met = 0;
        for (number, (ray, limit)) in rays().take(600).enumerate() {
            let medium = &media[number % 4];
            let thickness = medium.thickness(&ray, limit);
            let (step, parts) = parts(medium, &ray, limit.min(10.0));
            let depth = parts.iter().map(|(_, extinction, _)| *extinction).sum::<DVec3>() * step;
            let ours = (medium.extinction * thickness).as_dvec3();
            // At the edge of a grid that begins suddenly a part is counted or not.
            assert!((ours - depth).abs().max_element() < 1e-4 + 3.0 * step, "{number}: {ours} {depth}");
            for part in [0.01, 0.3, 0.5, 0.999] {
                let (weights, mut course) = (Vec3::new(1.0, 0.5, 0.2), Course::new(medium, &ray, limit));
                let target = part * weights.dot(thickness);
                if target > 1e-6 {
                    let found = course.until(weights, target);
                    let at = found.expect("the depth is reached");
                    let there = weights.dot(medium.thickness(&ray, at));
                    assert!((there - target).abs() < 1e-5 + 1e-4 * target, "{number}: {there} {target}");
                    assert!((course.thickness - medium.thickness(&ray, at)).abs().max_element() < 1e-5);
                    met += 1;
                }
            }
        }
        assert!(met > 500, "{met}");
    }

    /// Lights on a ray: unknown, even, in one place, at the end, unknown in front, and not finite.
    const EXPECTED: [fn(Option<f32>) -> Option<f32>; 6] = [
        |_| None,
        |_| Some(2.0),
        |at| Some(at.map_or(0.0, |at| if (0.8..1.4).contains(&at) { 1.0 } else { 1e-3 })),
        |at| if at.is_none() { Some(1e6) } else { Some(0.0) },
        |at| at.filter(|at| *at > 1.0),
        |at| if at.is_none() { Some(f32::NAN) } else { Some(f32::INFINITY) },
    ];

    /// The mean weight of getting through is the transmittance, that of a collision the scattered part, that of its distance the integral of
    /// both, and light is its integral, whether nothing is expected or this or that; 5σ of 40,000 flights per channel, case and quantity
    /// (672 of them: false alarm 4e-4 in all).
    #[test]
    fn flights_are_unbiased_in_every_channel() {
        for (case, medium) in media().iter().enumerate() {
            for (carried, (ray, limit)) in [Vec3::ONE, Vec3::new(1.0, 0.2, 0.05)].into_iter().zip(through(medium)) {
                let (step, parts) = parts(medium, &ray, limit.min(10.0));
                let mut truth = [DVec3::ZERO; 4];
                for (at, extinction, through) in &parts {
                    let albedo = medium.albedo.at(ray.at(*at)).as_dvec3();
                    let light = medium.emission.as_ref().map_or(DVec3::ZERO, |e| e.at(ray.at(*at)).as_dvec3());
                    let collided = extinction * through * step;
                    truth[0] += collided * albedo;
                    truth[1] += collided * albedo * f64::from(*at);
                    truth[3] += collided * (1.0 - albedo) * light;
                }
                truth[2] = (-(parts.iter().map(|p| p.1).sum::<DVec3>() * step)).map(f64::exp);
                for known in std::iter::once(None).chain(EXPECTED.into_iter().map(Some)) {
                    let (mut random, n) = (Random::new(7, case as u64, 0), 40_000);
                    let mut sums = [[DVec3::ZERO; 2]; 4];
                    for _ in 0..n {
                        let Flown { end, glow, .. } = match known {
                            None => medium.fly_known(&ray, limit, carried, &mut random),
                            Some(known) => medium.fly_expecting(&ray, limit, carried, &mut random, known),
                        };
                        let (factors, weight) = match end {
                            Flight::Collision { distance, weight } => {
                                assert!((0.0..=limit).contains(&distance), "{distance} of {limit}");
                                ([1.0, f64::from(distance), 0.0], weight.as_dvec3())
                            }
                            Flight::Through { weight } => ([0.0, 0.0, 1.0], weight.as_dvec3()),
                        };
                        let values = [weight * factors[0], weight * factors[1], weight * factors[2], glow.as_dvec3()];
                        for (sum, value) in sums.iter_mut().zip(values) {
                            sum[0] += value / f64::from(n);
                            sum[1] += value * value / f64::from(n);
                        }
                    }
                    for (what, (sum, truth)) in sums.iter().zip(truth).enumerate() {
                        for c in 0..3 {
                            let error = ((sum[1][c] - sum[0][c].powi(2)).max(0.0) / f64::from(n)).sqrt();
                            let off = (sum[0][c] - truth[c]).abs();
                            let bound = 5.0 * error + 1e-4 + 2.0 * step * truth[c];
                            assert!(off < bound, "case {case}, {what}, channel {c}: {} {}", sum[0][c], truth[c]);
                        }
                    }
                }
            }
        }
    }

    /// Ends of flights have the density that they are told to have: the probabilities of a collision in each tenth of a ray and of none, against
    /// 40,000 flights; 5σ of each of 8 · 11 (false alarm 5e-5 in all). What is said of an end is what was said when it was drawn.
    #[test]
    fn ends_have_their_densities() {
        for (case, medium) in media().iter().enumerate() {
            for (carried, (ray, limit)) in [Vec3::ONE, Vec3::new(1.0, 0.2, 0.05)].into_iter().zip(through(medium)) {
                let (length, n) = (limit.min(Course::new(medium, &ray, limit).end()), 40_000);
                let (mut random, mut counts) = (Random::new(8, case as u64, 0), [0u32; 11]);
                for _ in 0..n {
                    let flown = medium.fly_known(&ray, limit, carried, &mut random);
                    let (part, told) = match flown.end {
                        Flight::Collision { distance, .. } => {
                            let part = (distance / length * 10.0) as usize;
                            (part.min(9), medium.collision_at(&ray, carried, distance))
                        }
                        Flight::Through { .. } => (10, medium.passed(&ray, carried, limit)),
                    };
                    assert!((told.density - flown.density).abs() < 1e-4 * flown.density + 1e-6, "{told:?} {flown:?}");
                    counts[part] += 1;
                }
                let steps = 400;
                let at = |i: usize| length * (i as f32 + 0.5) / (10 * steps) as f32;
                let density = |i: usize| f64::from(medium.collision_at(&ray, carried, at(i)).density);
                for (part, count) in counts.into_iter().enumerate() {
                    let p = if part < 10 {
                        let sum: f64 = (part * steps..(part + 1) * steps).map(density).sum();
                        sum * f64::from(length) / (10 * steps) as f64
                    } else {
                        f64::from(medium.passed(&ray, carried, limit).density)
                    };
                    let error = (p * (1.0 - p) / f64::from(n)).sqrt();
                    let share = f64::from(count) / f64::from(n);
                    assert!((share - p).abs() < 5.0 * error + 1e-3, "case {case}, part {part}: {share} {p}");
                }
            }
        }
    }
}
