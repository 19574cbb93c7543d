//! Rays of every kind, and options to ask with.

use glam::Vec3;
use visfield::Ray;
use visfield::field::lookup::Aim;
use visfield::field::query::{Bias, QueryOptions};

use crate::random::Random;

/// Numbers at the edges of what single precision holds.
pub(crate) const HOSTILE: [f32; 12] = [
    0.0,
    -0.0,
    f32::NAN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    1.0e-40,
    1.0e38,
    f32::MAX,
    f32::MIN,
    f32::MIN_POSITIVE,
    -1.0e-45,
    1.0,
];

/// A ray of a kind drawn at random; in one of five, some of its numbers are [`HOSTILE`].
pub(crate) fn any_ray(random: &mut Random) -> Ray {
    let mut ray = proper_ray(random);
    if random.chance(0.2) {
        for _ in 0..=random.below(3) {
            let number = random.pick(&HOSTILE);
            match random.below(7) {
                axis @ 0..3 => ray.origin[axis] = number,
                6 => ray.t_max = number,
                axis => ray.direction[axis - 3] = number,
            }
        }
    }
    ray
}

/// A ray from outside that has no end: blocks of nothing else take a way of their own through a batch.
pub(crate) fn endless_ray_from_outside(random: &mut Random) -> Ray {
    let origin = random.direction() * random.between(1.01, 5.0);
    let direction = random.in_ball() * 1.2 - origin;
    Ray::new(origin.as_vec3(), direction.as_vec3())
}

/// A ray of finite numbers: through the ball, the centre or a tangent point of the unit sphere, from outside, inside, the
/// sphere itself or 10⁶ radii away, with a direction of any length.
fn proper_ray(random: &mut Random) -> Ray {
    let origin = match random.below(6) {
        0 => random.in_ball(),
        1 => random.direction(),
        2 => random.direction() * random.between(1.0, 1.0001),
        3 => random.direction() * random.power_of_ten(0.0, 6.0),
        4 => (random.direction() * 2.0).round(),
        _ => random.direction() * random.between(1.0, 4.0),
    };
    let direction = match random.below(5) {
        0 => -origin,
        1 => tangent_point(random, origin) - origin,
        2 => random.direction(),
        _ => random.in_ball() - origin,
    };
    let length = match random.below(8) {
        0 => 1.0e-40,
        1 => 1.0e38,
        2 => random.power_of_ten(-44.0, 38.0),
        3 => random.power_of_ten(-12.0, 12.0),
        _ => random.power_of_ten(-1.0, 1.0),
    };
    let t_max = match random.below(4) {
        0 => random.power_of_ten(-3.0, 1.0) / length,
        1 => (origin.length() + random.between(-1.0, 1.0)) / length,
        _ => f64::INFINITY,
    };
    let direction = direction.normalize_or(glam::DVec3::X) * length;
    Ray { origin: origin.as_vec3(), direction: direction.as_vec3(), t_max: t_max as f32 }
}

/// A point of the unit sphere whose tangent plane contains `origin`; any point of it for an origin inside.
fn tangent_point(random: &mut Random, origin: glam::DVec3) -> glam::DVec3 {
    let distance = origin.length().max(1.0);
    let along = origin.normalize_or(glam::DVec3::Z);
    let across = along.cross(random.direction()).normalize_or(along.any_orthonormal_vector());
    let cosine = 1.0 / distance;
    along * cosine + across * (1.0 - cosine * cosine).sqrt()
}

/// Options with `aim`: with and without a normal, with usual and with hostile biases.
pub(crate) fn any_options(random: &mut Random, aim: Aim) -> QueryOptions {
    let unit = random.direction().as_vec3();
    let normal = match random.below(6) {
        0 => Vec3::NAN,
        1 => unit.with_x(random.pick(&HOSTILE)),
        2 | 3 => unit,
        _ => Vec3::ZERO,
    };
    let bias = match random.below(8) {
        0 => Bias { height: random.pick(&HOSTILE), along: random.pick(&HOSTILE) },
        1 => Bias { height: -1.0, along: -1.0 },
        2 | 3 => Bias::NONE,
        _ => Bias::default(),
    };
    QueryOptions { aim, normal, bias }
}
