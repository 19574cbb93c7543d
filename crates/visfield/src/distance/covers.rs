//! Antialiasing of a surface by one ray per pixel: covers (Hart 1996; the 2012 thesis, chapter 5).
//!
//! A cover is the surface moved by the radius of the pixel, outwards or inwards. A ray that comes to the inner one is covered all
//! over and hits; where it only comes to the outer one it brushes the surface, and the part of its pixel that is covered follows
//! from how near it came. One march finds both if it traces the inner cover.
//!
//! Drawn in Bevy, shapes have a shader of their own with the same names; its pixels are cones that may be stretched.

use std::f32::consts::PI;

use glam::Vec3;

/// Most surfaces that a pixel shows one behind the other, of which the last may cover it all: as many as the thesis keeps.
pub const MAX_SAMPLES: usize = 4;

/// By how many radii of the pixel a ray has to leave the nearest point before it can brush another.
pub const BRUSH_RISE: f32 = 0.5;

/// What half a pixel is wide at t = 1, for a picture of `width` × `height` pixels that spans an angle of `field_of_view` radians
/// along its longer side (eq. 5.2 without its t, whose p(t) is the whole pixel).
///
/// ```
/// let radius = visfield::distance::covers::pixel_radius(1.570_796_4, 512, 256);
/// assert!((radius - 1.0 / 512.0).abs() < 1e-6);
/// ```
pub fn pixel_radius(field_of_view: f32, width: u32, height: u32) -> f32 {
    (0.5 * field_of_view).tan() / width.max(height).max(1) as f32
}

/// The part of a disc that a half-plane covers whose edge has this signed distance from the disc's centre, in radii (eq. 5.4):
/// 1 from −1 down, 0 from 1 on.
///
/// ```
/// use visfield::distance::covers::disc_coverage;
/// assert_eq!((disc_coverage(-2.0), disc_coverage(0.0), disc_coverage(1.0)), (1.0, 0.5, 0.0));
/// ```
pub fn disc_coverage(height: f32) -> f32 {
    let x = height.clamp(-1.0, 1.0);
    0.5 - (x * (1.0 - x * x).sqrt() + x.asin()) / PI
}

/// Where a ray came nearest to a surface, or met it.
///
/// ```
/// use visfield::distance::covers::Brush;
/// assert_eq!(Brush { t: 2.0, height: 0.0 }.coverage(), 0.5);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Brush {
    /// How far along the ray.
    pub t: f32,
    /// The signed distance from the surface there, in radii of the pixel: −1 where it covers all of it.
    pub height: f32,
}

impl Brush {
    /// The part of the pixel that is covered: α.
    pub fn coverage(&self) -> f32 {
        disc_coverage(self.height)
    }
}

/// The surfaces that a pixel shows, the nearest first.
///
/// ```
/// use glam::Vec3;
/// use visfield::distance::covers::trace_covers;
/// // A ray that just grazes a ball, before a wall.
/// let scene = |p: Vec3| (p.length() - 1.0).min(3.0 - p.x);
/// let covers = trace_covers(scene, Vec3::new(-3.0, 1.0, 0.0), Vec3::X, (0.0, 100.0), 0.01, 200);
/// let [ball, wall] = covers.samples() else { panic!() };
/// assert!((ball.t - 3.0).abs() < 0.1 && (ball.coverage() - 0.5).abs() < 0.05);
/// assert!((wall.t - 6.0).abs() < 0.1 && wall.coverage() == 1.0);
/// // White before red.
/// let color = covers.composite(|brush| if brush.t < 4.0 { Vec3::ONE } else { Vec3::X }, Vec3::ZERO);
/// assert!((color - Vec3::new(1.0, 0.5, 0.5)).abs().max_element() < 0.05);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Covers {
    samples: [Brush; MAX_SAMPLES],
    count: usize,
}

impl Covers {
    /// What was brushed, and last what was hit, if anything was.
    pub fn samples(&self) -> &[Brush] {
        &self.samples[..self.count]
    }

    /// The color of the pixel: the colors of the surfaces, each as far as nothing before it covers the pixel, and behind them
    /// the background. From front to back, by the *under* operator: the thesis goes from back to front by *over* (eq. 5.5), for
    /// which all have to be kept, and calls this future work; the sum is the same.
    pub fn composite(&self, color: impl Fn(&Brush) -> Vec3, background: Vec3) -> Vec3 {
        let (mut sum, mut left) = (Vec3::ZERO, 1.0);
        for sample in self.samples() {
            let coverage = sample.coverage();
            sum += color(sample) * (left * coverage);
            left *= 1.0 - coverage;
        }
        sum + background * left
    }

    fn add(&mut self, brush: Brush) {
        // The last place is kept for what is hit.
        if self.count < MAX_SAMPLES - 1 {
            self.samples[self.count] = brush;
            self.count += 1;
        }
    }
}

/// Traces the inner cover along a ray with a unit direction, by steps of the distance and the pixel's radius (§5), and keeps what
/// the ray brushes on its way: where it came nearest, in pixels, whenever it came nearer than a pixel's radius (eq. 5.3). `pixel`
/// is the pixel's radius at t = 1, above 0.
///
/// The thesis steps by f + r from wherever it is, which it says may pass through surfaces: here a step is never shorter than a
/// quarter of the radius, and a surface that is thinner than the pixel covers it as far as its nearest distance says.
pub fn trace_covers(
    distance: impl Fn(Vec3) -> f32,
    origin: Vec3,
    direction: Vec3,
    (t_min, t_max): (f32, f32),
    pixel: f32,
    max_steps: u32,
) -> Covers {
    let mut covers = Covers::default();
    let mut t = t_min.max(f32::MIN_POSITIVE);
    let mut lowest = Brush { t, height: f32::MAX };
    // Away from what it has brushed.
    let mut rising = false;
    let mut previous = f32::MAX;
    for _ in 0..max_steps {
        if t >= t_max {
            break;
        }
        let radius = pixel * t;
        let from_surface = distance(origin + direction * t);
        let height = from_surface / radius;
        if height <= -1.0 {
            covers.samples[covers.count] = Brush { t, height: -1.0 };
            covers.count += 1;
            return covers;
        }
        if rising {
            if height < previous {
                rising = false;
                lowest = Brush { t, height };
            }
        } else if height < lowest.height {
            lowest = Brush { t, height };
        } else if lowest.height < 1.0 && height > (lowest.height + BRUSH_RISE).min(1.0) {
            covers.add(lowest);
            rising = true;
        }
        previous = height;
        t += (from_surface + radius).max(0.25 * radius);
    }
    if !rising && lowest.height < 1.0 {
        covers.add(lowest);
    }
    covers
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coverage_is_the_segment_of_a_disc() {
        for i in -10..=10 {
            let height = i as f32 / 10.0;
            let cells = (0..400 * 400).map(|i| ((i % 400) as f32 / 200.0 - 0.9975, (i / 400) as f32 / 200.0 - 0.9975));
            let inside: Vec<_> = cells.filter(|(x, y)| x * x + y * y < 1.0).collect();
            let counted = inside.iter().filter(|(x, _)| *x > height).count() as f32 / inside.len() as f32;
            assert!((disc_coverage(height) - counted).abs() < 0.005, "{height}: {counted}");
            let near = crate::distance::cone::disc_occlusion(height);
            assert!((disc_coverage(height) - near).abs() < 0.04, "{height}: {near}");
        }
    }

    #[test]
    fn balls_outlines_cover_as_much_as_many_rays_say() {
        // Pixels across the outlines of two balls, one before the other, and a wall; each counts for 1, 2 and 4.
        let balls = [(Vec3::new(5.0, 0.0, 0.0), 1.0), (Vec3::new(9.0, 1.2, 0.0), 1.0)];
        let from_ball = |p: Vec3, (center, radius): (Vec3, f32)| (p - center).length() - radius;
        let scene = |p: Vec3| from_ball(p, balls[0]).min(from_ball(p, balls[1])).min(14.0 - p.x);
        let nearest = |p: Vec3| match (from_ball(p, balls[0]), from_ball(p, balls[1]), 14.0 - p.x) {
            (a, b, c) if a <= b.min(c) => 1.0,
            (_, b, c) if b <= c => 2.0,
            _ => 4.0,
        };
        let pixel = 0.01;
        let (mut error, mut worst, count) = (0.0, 0.0_f32, 60);
        for i in 0..count {
            let direction = Vec3::new(1.0, i as f32 * 0.009 - 0.25, 0.002).normalize();
            let color = |brush: &Brush| Vec3::splat(nearest(direction * brush.t));
            let found =
                trace_covers(scene, Vec3::ZERO, direction, (0.0, 100.0), pixel, 400).composite(color, Vec3::ZERO).x;
            let disc = crate::estimate::sampling::DiscBasis::new(direction, pixel.atan());
            let samples = crate::estimate::sampling::disc_samples(400);
            let one = |ray: Vec3| {
                let hits = |(center, radius): (Vec3, f32)| (center - ray * center.dot(ray)).length() < radius;
                if hits(balls[0]) {
                    1.0
                } else if hits(balls[1]) {
                    2.0
                } else {
                    4.0
                }
            };
            let expected = samples.iter().map(|s| one(disc.direction(*s).normalize())).sum::<f32>() / 400.0;
            error += (found - expected).abs() / count as f32;
            worst = worst.max((found - expected).abs());
        }
        assert!(error < 0.03 && worst < 0.4, "{error}, at most {worst}");
    }

    #[test]
    fn no_more_is_kept_than_there_is_room_for() {
        // Twenty balls in a row, all of them grazed.
        let row =
            |p: Vec3| (0..20).map(|i| (p - Vec3::X * (3.0 * i as f32 + 3.0)).length() - 1.0).fold(f32::MAX, f32::min);
        let covers = trace_covers(row, Vec3::new(0.0, 1.0, 0.0), Vec3::X, (0.0, 100.0), 0.01, 4000);
        assert_eq!(covers.samples().len(), MAX_SAMPLES - 1);
        assert!(covers.samples().is_sorted_by_key(|brush| brush.t));
        for wrong in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert!(trace_covers(|_| wrong, Vec3::ZERO, Vec3::X, (0.0, 10.0), 0.01, 64).samples().len() <= 1);
        }
    }
}
