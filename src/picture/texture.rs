//! Colours that vary over a surface.

use glam::{Affine2, Vec2, Vec3};

use super::Texels;

/// A colour as a function of texture coordinates.
#[derive(Debug, Clone)]
pub enum Texture {
    /// One colour everywhere.
    Constant(Vec3),
    /// A picture.
    Bitmap {
        /// The picture; it must not be empty.
        image: Texels,
        /// Texture coordinates to picture coordinates; there (0, 0) is the picture's top left and (1, 1) its bottom right.
        to_uv: Affine2,
        /// Factor on every value.
        scale: f32,
        /// Continuation beyond the picture's edges.
        wrap: Wrap,
        /// Whether the nearest pixel is taken instead of interpolating bilinearly between the four around.
        nearest: bool,
    },
    /// Two colours in squares of half a texture unit.
    Checkerboard {
        /// Colour where both coordinates are in the same half of their unit.
        color0: Vec3,
        /// The other colour.
        color1: Vec3,
        /// Texture coordinates to board coordinates.
        to_uv: Affine2,
    },
}

/// Luminance of linear sRGB (IEC 61966-2-1), the value of a colour where one number is asked for. Exact for greys.
pub fn luminance(color: Vec3) -> f32 {
    if color == Vec3::splat(color.x) { color.x } else { color.dot(Vec3::new(0.212671, 0.715160, 0.072169)) }
}

/// Continuation of a picture beyond its edges.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wrap {
    /// Repeats the picture.
    Repeat,
    /// Repeats the picture, every other time mirrored.
    Mirror,
    /// Repeats the pixels of its edge.
    Clamp,
}

impl Wrap {
    /// The column (or row), of `count`, to read for `index`.
    fn index(self, index: i64, count: usize) -> usize {
        // Nearly always: it saves a division.
        if (0..count as i64).contains(&index) {
            return index as usize;
        }
        let count = count as i64;
        let inside = match self {
            Self::Repeat => index.rem_euclid(count),
            Self::Clamp => index.clamp(0, count - 1),
            Self::Mirror => {
                let turn = index.rem_euclid(2 * count);
                turn.min(2 * count - 1 - turn)
            }
        };
        inside as usize
    }

    /// The columns (or rows), of `count`, to read for the whole number `corner` and the next.
    fn both(self, corner: f32, count: usize) -> [usize; 2] {
        let index = corner as i64;
        if index >= 0 && index < count as i64 - 1 {
            return [index as usize, index as usize + 1];
        }
        [self.index(index, count), self.index(index.saturating_add(1), count)]
    }
}

impl Texture {
    /// The colour at `uv`, which must be finite.
    #[inline(always)]
    pub fn eval(&self, uv: Vec2) -> Vec3 {
        if let Self::Constant(color) = self { *color } else { self.varying(uv) }
    }

    #[inline(never)]
    fn varying(&self, uv: Vec2) -> Vec3 {
        match self {
            Self::Constant(color) => *color,
            Self::Bitmap { image, to_uv, scale, wrap, nearest } => {
                let uv = to_uv.transform_point2(uv);
                let color = if *nearest { self::nearest(image, uv, *wrap) } else { bilinear(image, uv, *wrap) };
                color * *scale
            }
            Self::Checkerboard { color0, color1, to_uv } => {
                let uv = to_uv.transform_point2(uv);
                let upper = uv - floor(uv);
                if (upper.x > 0.5) == (upper.y > 0.5) { *color0 } else { *color1 }
            }
        }
    }

    /// Brings near what [`Texture::eval`] reads at `uv`: of a picture the two rows around it.
    #[inline]
    pub fn prefetch(&self, uv: Vec2) {
        let Self::Bitmap { image, to_uv, wrap, .. } = self else { return };
        let corner = floor(position(image, to_uv.transform_point2(uv), *wrap) - 0.5);
        let [width, height] = image.size();
        let column = wrap.index(corner.x as i64, width);
        for row in wrap.both(corner.y, height) {
            image.prefetch(row * width + column);
        }
    }

    /// Gradient of the luminance in texture coordinates: that of the bilinear filter. Zero for textures that have steps.
    pub fn slope(&self, uv: Vec2) -> Vec2 {
        let Self::Bitmap { image, to_uv, scale, wrap, nearest: false } = self else { return Vec2::ZERO };
        let ([upper, lower], weight) = around(image, to_uv.transform_point2(uv), *wrap);
        let [[p00, p10], [p01, p11]] = [upper, lower].map(|row| row.map(luminance));
        let u = (p10 - p00) + ((p11 - p01) - (p10 - p00)) * weight.y;
        let v = (p01 - p00) + ((p11 - p10) - (p01 - p00)) * weight.x;
        let per_picture = Vec2::new(u, v) * size(image);
        to_uv.matrix2.transpose() * per_picture * *scale
    }

    /// The luminance at `uv`.
    pub fn value(&self, uv: Vec2) -> f32 {
        luminance(self.eval(uv))
    }

    /// The mean colour over a period.
    pub fn mean(&self) -> Vec3 {
        match self {
            Self::Constant(color) => *color,
            Self::Bitmap { image, scale, .. } => image.mean() * *scale,
            Self::Checkerboard { color0, color1, .. } => (*color0 + *color1) / 2.0,
        }
    }
}

/// The largest whole numbers that are not larger. The processors that all have in common have no instruction for it.
fn floor(v: Vec2) -> Vec2 {
    /// The last bit of numbers of this magnitude is worth 1.
    const WHOLE: f32 = 1.5 * (1 << 23) as f32;
    let nearest = (v + WHOLE) - WHOLE;
    let below = Vec2::select(nearest.cmpgt(v), nearest - 1.0, nearest);
    if v.abs().max_element() < (1 << 22) as f32 { below } else { v.floor() }
}

fn size(image: &Texels) -> Vec2 {
    let [width, height] = image.size();
    Vec2::new(width as f32, height as f32)
}

/// Position of `uv` in pixels. Wrapping before scaling keeps precision far from the origin.
fn position(image: &Texels, uv: Vec2, wrap: Wrap) -> Vec2 {
    let near = match wrap {
        Wrap::Repeat => uv - floor(uv),
        Wrap::Mirror => uv - 2.0 * floor(uv / 2.0),
        Wrap::Clamp => uv.clamp(Vec2::NEG_ONE, Vec2::splat(2.0)),
    };
    near * size(image)
}

fn nearest(image: &Texels, uv: Vec2, wrap: Wrap) -> Vec3 {
    let corner = floor(position(image, uv, wrap));
    let [width, height] = image.size();
    let [pixel] = image.pixels([wrap.index(corner.y as i64, height) * width + wrap.index(corner.x as i64, width)]);
    pixel
}

fn bilinear(image: &Texels, uv: Vec2, wrap: Wrap) -> Vec3 {
    let ([[p00, p10], [p01, p11]], weight) = around(image, uv, wrap);
    p00.lerp(p10, weight.x).lerp(p01.lerp(p11, weight.x), weight.y)
}

/// The four pixels around a point, row by row, and its position between their centres.
fn around(image: &Texels, uv: Vec2, wrap: Wrap) -> ([[Vec3; 2]; 2], Vec2) {
    let position = position(image, uv, wrap) - 0.5;
    let corner = floor(position);
    let [width, height] = image.size();
    let ([left, right], [upper, lower]) = (wrap.both(corner.x, width), wrap.both(corner.y, height));
    let (upper, lower) = (upper * width, lower * width);
    let [p00, p10, p01, p11] = image.pixels([upper + left, upper + right, lower + left, lower + right]);
    ([[p00, p10], [p01, p11]], position - corner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;

    use crate::base::random::Random;
    use crate::picture::{ByteImage, Image};

    #[test]
    fn whole_numbers_are_those_below() {
        let mut random = Random::new(5, 0, 0);
        let edges =
            [0.0, -0.0, 0.5, -0.5, 1.0, -1.0, 4_194_303.5, -4_194_303.5, 4_194_304.0, 8_388_607.5, -1e30, f32::MAX];
        let any = (0..100_000).map(|i| random.range(-1.0, 1.0) * 2f32.powi(i % 40 - 10));
        for x in edges.into_iter().chain(any.collect::<Vec<_>>()) {
            assert_eq!(floor(Vec2::new(x, 0.25)), Vec2::new(x.floor(), 0.0), "{x}");
            assert_eq!(floor(Vec2::new(-0.25, x)), Vec2::new(-1.0, x.floor()), "{x}");
        }
        assert!(floor(Vec2::new(f32::NAN, 1.0)).x.is_nan());
    }

    fn picture() -> Texture {
        let pixels = [Vec3::X, Vec3::Y, Vec3::Z, Vec3::ONE, Vec3::ZERO, Vec3::splat(0.5)].to_vec();
        let image = Arc::new(Image { width: 3, height: 2, pixels });
        Texture::Bitmap {
            image: image.into(),
            to_uv: Affine2::IDENTITY,
            scale: 2.0,
            wrap: Wrap::Repeat,
            nearest: false,
        }
    }

    #[test]
    fn edges_and_filters() {
        let count = |wrap: Wrap| (-4..7).map(|i| wrap.index(i, 3)).collect::<Vec<_>>();
        assert_eq!(count(Wrap::Repeat), [2, 0, 1, 2, 0, 1, 2, 0, 1, 2, 0]);
        assert_eq!(count(Wrap::Mirror), [2, 2, 1, 0, 0, 1, 2, 2, 1, 0, 0]);
        assert_eq!(count(Wrap::Clamp), [0, 0, 0, 0, 0, 1, 2, 2, 2, 2, 2]);
        let Texture::Bitmap { image, to_uv, .. } = picture() else { unreachable!("a picture") };
        let other = |wrap, nearest| Texture::Bitmap { image: image.clone(), to_uv, scale: 1.0, wrap, nearest };
        assert_eq!(other(Wrap::Clamp, false).eval(Vec2::new(-7.0, 0.0)), Vec3::X);
        assert_eq!(other(Wrap::Clamp, false).eval(Vec2::splat(f32::MAX)), Vec3::splat(0.5));
        assert_eq!(other(Wrap::Repeat, true).eval(Vec2::new(0.66, 0.4)), Vec3::Y);
    }

    /// A byte picture and a float picture of its values give the same bits everywhere, with every filter and wrap mode.
    #[test]
    fn bytes_and_values_look_the_same() {
        let mut random = Random::new(4, 0, 0);
        for channels in [1, 3] {
            let samples = (0..7 * 5 * channels).map(|_| random.below(256) as u8).collect();
            let bytes = Texels::Bytes(Arc::new(ByteImage::new(7, 5, channels, samples, false).unwrap()));
            let to_uv = Affine2::from_scale_angle_translation(Vec2::new(1.3, 0.8), 0.3, Vec2::new(0.2, -7.0));
            for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp] {
                for nearest in [false, true] {
                    let with = |image: Texels| Texture::Bitmap { image, to_uv, scale: 0.7, wrap, nearest };
                    let [small, large] = [bytes.clone(), bytes.to_image().into()].map(with);
                    for _ in 0..500 {
                        let uv = Vec2::new(random.range(-3.0, 3.0), random.range(-3.0, 3.0));
                        assert_eq!((small.eval(uv), small.slope(uv)), (large.eval(uv), large.slope(uv)), "{uv}");
                    }
                    assert_eq!(small.mean(), large.mean());
                }
            }
        }
    }

    #[test]
    fn bitmap_centres_edges_and_repetition() {
        let texture = picture();
        let at = |u: f32, v: f32| texture.eval(Vec2::new(u, v));
        let near = |a: Vec3, b: Vec3| assert!(a.distance(b) < 1e-5, "{a} {b}");
        near(at(1.0 / 6.0, 0.25), 2.0 * Vec3::X);
        near(at(5.0 / 6.0, 0.75), Vec3::ONE);
        near(at(1.0 / 3.0, 0.25), Vec3::X + Vec3::Y);
        near(at(0.0, 0.25), Vec3::X + Vec3::Z);
        near(at(1.0 / 6.0, 0.0), Vec3::X + Vec3::ONE);
        near(at(-5.0 + 1.0 / 6.0, 7.25), 2.0 * Vec3::X);
    }

    /// The mean is the integral over a period: 2¹⁶ random points agree with it within five standard deviations.
    #[test]
    fn mean_is_the_integral() {
        let board = Texture::Checkerboard {
            color0: Vec3::X,
            color1: Vec3::new(0.2, 0.4, 0.6),
            to_uv: Affine2::from_scale(Vec2::new(3.0, 2.0)),
        };
        for texture in [picture(), board, Texture::Constant(Vec3::new(0.1, 0.2, 0.3))] {
            let mut random = Random::new(1, 2, 3);
            let n = 1 << 16;
            let mut sum = glam::DVec3::ZERO;
            (0..n).for_each(|_| sum += texture.eval(Vec2::from_array(random.next_2d())).as_dvec3());
            // Values lie in [0, 2], so one standard deviation is at most 1.
            let bound = 5.0 / f64::from(n).sqrt();
            assert!((sum / f64::from(n) - texture.mean().as_dvec3()).abs().max_element() < bound);
        }
    }

    #[test]
    fn checkerboard_halves() {
        let board = Texture::Checkerboard {
            color0: Vec3::ONE,
            color1: Vec3::ZERO,
            to_uv: Affine2::from_scale(Vec2::splat(2.0)),
        };
        for (u, v, color) in
            [(0.1, 0.1, Vec3::ONE), (0.4, 0.1, Vec3::ZERO), (0.4, 0.4, Vec3::ONE), (-0.1, 0.1, Vec3::ZERO)]
        {
            assert_eq!(board.eval(Vec2::new(u, v)), color);
        }
    }
}
