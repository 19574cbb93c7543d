//! Single precision against double: which cell of the table answers a ray.

use glam::DVec3;
use visfield::Ray;
use visfield::field::chord::chord;
use visfield::field::lookup::{Aim, TwoPointGrid, forward_lookup, reversed_lookup};

use crate::random::Random;
use crate::{BORDER_TIGHTNESS, BORDER_UNITS, FAR_EXEMPT, GRAZING_EXEMPT, NEAR_EXEMPT, PRECISION_RAYS, double};

const GRID: TwoPointGrid = TwoPointGrid { entries: 65, exits: 32 };

/// The table index in single precision, as the queries find it, and whether the ray counts as coming from outside.
fn single(ray: &Ray, aim: Aim) -> (Option<u32>, bool) {
    let Some(chord) = chord(ray.origin, ray.direction) else { return (None, true) };
    let outside = chord.t_entry() >= 0.0;
    let lookup = if outside {
        forward_lookup(&GRID, ray.direction, &chord, aim)
    } else {
        reversed_lookup(&GRID, ray.origin, ray.direction, &chord, aim)
    };
    (Some(lookup.index), outside)
}

/// What a class of rays showed.
struct Comparison {
    /// Share of the rays that are too near to a border to be compared.
    exempt: f64,
    /// Largest distance from a border, in units of error, at which the two chose different cells.
    worst: f64,
}

fn compare(seed: u64, aim: Aim, ray: impl Fn(&mut Random) -> Ray) -> Comparison {
    let mut random = Random::new(seed);
    let (mut exempt, mut worst) = (0, 0.0_f64);
    for _ in 0..PRECISION_RAYS {
        let ray = ray(&mut random);
        let (found, outside) = single(&ray, aim);
        let expected = double::lookup(GRID, &ray, aim, outside);
        exempt += usize::from(expected.margin <= BORDER_UNITS);
        if found != expected.index {
            worst = worst.max(expected.margin);
        }
    }
    Comparison { exempt: exempt as f64 / PRECISION_RAYS as f64, worst }
}

/// A ray from `origin` to `target`, with a direction of any ordinary length.
fn towards(random: &mut Random, origin: DVec3, target: DVec3) -> Ray {
    let direction = (target - origin).normalize_or(DVec3::X) * random.power_of_ten(-6.0, 6.0);
    Ray::new(origin.as_vec3(), direction.as_vec3())
}

/// From inside, from the sphere itself and from up to 10 radii away.
fn near_ray(random: &mut Random) -> Ray {
    let origin = match random.below(4) {
        0 => random.in_ball(),
        1 => random.direction(),
        _ => random.direction() * random.between(1.0, 10.0),
    };
    let target = random.in_ball();
    towards(random, origin, target)
}

fn far_ray(random: &mut Random) -> Ray {
    let (origin, target) = (random.direction() * random.power_of_ten(1.0, 3.0), random.in_ball());
    towards(random, origin, target)
}

/// A line that leaves the unit sphere soon after entering it.
fn grazing_ray(random: &mut Random) -> Ray {
    let half = random.power_of_ten(-3.0, -1.0);
    let middle = random.direction() * (1.0 - half * half).sqrt();
    let along = middle.cross(random.direction()).normalize_or(DVec3::X);
    let origin = middle - along * random.between(-0.5 * half, 10.0);
    towards(random, origin, middle)
}

/// Single precision reads the cell that double precision reads, unless the ray comes as near to a border as `BORDER_UNITS`
/// says; and few rays do.
#[test]
fn single_precision_finds_the_cell_that_double_precision_finds() {
    let mut worst = 0.0_f64;
    for aim in [Aim::Plain, Aim::Point] {
        let classes = [
            ("near", compare(3, aim, near_ray), NEAR_EXEMPT),
            ("far", compare(4, aim, far_ray), FAR_EXEMPT),
            ("grazing", compare(5, aim, grazing_ray), GRAZING_EXEMPT),
        ];
        for (name, Comparison { exempt, worst: margin }, most_exempt) in classes {
            println!("{aim:?}, {name}: cells differ up to {margin:.3} units from a border, {exempt:.5} exempt");
            assert!(margin <= BORDER_UNITS, "{aim:?}, {name}: a cell differs {margin} units from any border");
            assert!(exempt < most_exempt, "{aim:?}, {name}: {exempt} of the rays are near a border");
            worst = worst.max(margin);
        }
    }
    assert!(worst > BORDER_TIGHTNESS * BORDER_UNITS, "the bound is slack: {worst} units at most");
}
