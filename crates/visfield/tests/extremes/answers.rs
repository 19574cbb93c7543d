//! Single rays with any numbers.

use visfield::field::lookup::Aim;
use visfield::field::query::QueryOptions;
use visfield::{ChordTable, Ray, VisibilityField};

use crate::SINGLE_RAYS;
use crate::fields::fields;
use crate::random::Random;
use crate::rays::{any_options, any_ray};

/// Whatever the ray, the field and the options: no panic, no NaN; a hit lies on the ray and before its end; and all queries
/// agree on whether there is one.
#[test]
fn any_ray_has_a_sane_answer() {
    let mut random = Random::new(1);
    let mut hits = 0;
    let fields = fields();
    for (field, aim) in fields.iter().flat_map(|field| [(field, Aim::Plain), (field, Aim::Point)]) {
        for _ in 0..SINGLE_RAYS {
            let (ray, options) = (any_ray(&mut random), any_options(&mut random, aim));
            hits += usize::from(check(field, &ray, &options));
        }
    }
    let share = hits as f64 / (fields.len() * 2 * SINGLE_RAYS) as f64;
    println!("{:.1} % of {} rays hit", 100.0 * share, fields.len() * 2 * SINGLE_RAYS);
    assert!((0.1..0.9).contains(&share), "hits and misses are both tested");
}

/// Whether the ray hits, after checking everything about it.
fn check(field: &VisibilityField, ray: &Ray, options: &QueryOptions) -> bool {
    let (hit, distance) = (field.hit(ray, options), field.distance(ray, options));
    let context =
        || format!("{ray:?}, {options:?}, {:?}: {hit:?}, distance {distance}", field.table().map(ChordTable::format));
    // Negated comparisons, so that NaN fails.
    assert!(hit.is_none_or(|t| t >= 0.0 && t < ray.t_max), "{}", context());
    assert_eq!(hit.is_some(), field.occluded(ray, options), "{}", context());
    assert!(distance >= 0.0, "{}", context());
    assert_eq!(hit.is_some(), distance < f32::INFINITY, "{}", context());
    let last = field.last_hit(ray, options.aim);
    assert!(last.is_none_or(f32::is_finite), "{}, last {last:?}", context());
    hit.is_some()
}
