//! Batches against the same rays one by one.

use visfield::field::batch::LANES;
use visfield::field::lookup::Aim;
use visfield::field::query::QueryOptions;
use visfield::{ChordTable, Ray, VisibilityField};

use crate::BATCHES;
use crate::fields::fields;
use crate::random::Random;
use crate::rays::{any_options, any_ray, endless_ray_from_outside};

/// Lengths around multiples of a block, and in between.
const LENGTHS: [usize; 10] =
    [0, 1, 3, LANES - 1, LANES, LANES + 1, LANES + 37, 2 * LANES, 2 * LANES + 1, 3 * LANES + 13];

/// A batch answers bit for bit what its rays are answered one by one, whatever kinds of rays it mixes and however many.
#[test]
fn a_batch_answers_as_its_rays_do() {
    let mut random = Random::new(2);
    for (field, aim) in fields().iter().flat_map(|field| [(field, Aim::Plain), (field, Aim::Point)]) {
        for _ in 0..BATCHES {
            let generate = random.pick(&[any_ray, any_ray, endless_ray_from_outside]);
            let count = random.pick(&LENGTHS);
            let rays: Vec<Ray> = (0..count).map(|_| generate(&mut random)).collect();
            compare(field, &rays, &any_options(&mut random, aim));
        }
    }
}

fn compare(field: &VisibilityField, rays: &[Ray], options: &QueryOptions) {
    let (mut hits, mut distances) = (vec![f32::NAN; rays.len()], vec![f32::NAN; rays.len()]);
    field.hit_batch(rays, options, &mut hits);
    field.distance_batch(rays, options, &mut distances);
    // A stale answer of either kind would show.
    let (mut occluded, mut stale) = (vec![true; rays.len()], vec![false; rays.len()]);
    field.occluded_batch(rays, options, &mut occluded);
    field.occluded_batch(rays, options, &mut stale);
    assert_eq!(occluded, stale);
    for (lane, ray) in rays.iter().enumerate() {
        let context = || {
            format!("lane {lane} of {}: {ray:?}, {options:?}, {:?}", rays.len(), field.table().map(ChordTable::format))
        };
        let hit = field.hit(ray, options).unwrap_or(f32::INFINITY);
        assert_eq!(hits[lane].to_bits(), hit.to_bits(), "hit {} or {hit}, {}", hits[lane], context());
        let distance = field.distance(ray, options);
        let found = distances[lane];
        assert_eq!(found.to_bits(), distance.to_bits(), "distance {found} or {distance}, {}", context());
        assert_eq!(occluded[lane], field.occluded(ray, options), "occluded, {}", context());
    }
}
