//! Coarser tables: made of finer ones alone, they answer nearly as if they had been baked.

use std::path::Path;

use glam::Vec3;
use visfield::estimate::sampling::sphere_samples;
use visfield::field::directions::DirectionMap;
use visfield::field::{ball, ball_field};
use visfield::{ChordTable, Encoding, QueryOptions, Ray, Representation, VisibilityField, file};

/// Receivers outside the bounds, and rays from each.
const RECEIVERS: u32 = 200;
const RAYS: u32 = 400;

/// Ambient occlusion of receivers that face the object, at distances of 1.05 to 2.5 radii.
fn ambient(field: &VisibilityField) -> Vec<f32> {
    let rays = sphere_samples(RAYS);
    let receiver = |(index, out): (usize, Vec3)| {
        let position = out * (1.05 + 1.45 * (index as f32 / RECEIVERS as f32));
        // A point of the sphere around the tip of the normal is a cosine-distributed direction.
        let direction = |ray: &Vec3| (*ray - out * 1.0001).normalize();
        let is_hit = |ray: &&Vec3| field.occluded(&Ray::new(position, direction(ray)), &QueryOptions::default());
        rays.iter().filter(is_hit).count() as f32 / RAYS as f32
    };
    sphere_samples(RECEIVERS).into_iter().enumerate().map(receiver).collect()
}

/// Mean difference, root of the mean squared difference, and mean of the first.
fn compare(a: &[f32], b: &[f32]) -> (f32, f32, f32) {
    let count = a.len() as f32;
    let squares: f32 = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum();
    let bias = b.iter().zip(a).map(|(b, a)| b - a).sum::<f32>() / count;
    (bias, (squares / count).sqrt(), a.iter().sum::<f32>() / count)
}

fn coarser(field: &VisibilityField) -> VisibilityField {
    let table = field.table().and_then(ChordTable::coarser).expect("a two-point table of ordinary size");
    field.clone().with_table(table)
}

#[test]
fn a_coarser_ball_occludes_as_one_that_was_sampled_coarsely() {
    let fine = ball_field(0.7, 65, 32);
    let (resampled, sampled) = (coarser(&fine), ball_field(0.7, 33, 16));
    assert_eq!(resampled.table().unwrap().format(), sampled.table().unwrap().format());
    assert!(resampled.bytes() * 15 < fine.bytes());
    let truth = ambient(&ball_field(0.7, 129, 96));
    let [fine, resampled, sampled] = [&fine, &resampled, &sampled].map(|field| compare(&truth, &ambient(field)));
    println!("bias, rms, mean: fine {fine:.4?}, resampled {resampled:.4?}, sampled {sampled:.4?}");
    assert!(resampled.2 > 0.1, "there is something to get wrong");
    assert!(resampled.0.abs() < 0.004 && resampled.1 < 0.015);
    assert!(resampled.1 < 1.5 * sampled.1 + 0.002, "as good as sampling it anew");
}

#[test]
fn hits_stay_where_they_are() {
    let fine = ball_field(0.7, 65, 32);
    let coarse = coarser(&fine);
    let options = QueryOptions::default();
    for out in sphere_samples(500) {
        let ray = Ray::new(out * 3.0, -out);
        let [fine, coarse] = [&fine, &coarse].map(|field| field.hit(&ray, &options).expect("the middle is solid"));
        assert!((fine - coarse).abs() < 0.03, "{fine} and {coarse} from {out}");
    }
}

#[test]
fn baked_assets_keep_their_occlusion() {
    for name in ["chair", "supershape", "torus_knot"] {
        let path =
            Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/meshes").join(name).with_extension("vfield");
        let field = file::read(&path).unwrap().remove(0);
        let coarse = coarser(&field);
        assert_eq!(coarse.cap_grid(), field.cap_grid());
        let (bias, rms, mean) = compare(&ambient(&field), &ambient(&coarse));
        println!("{name}: bias {bias:.4}, rms {rms:.4}, mean {mean:.4}; {} to {} bytes", field.bytes(), coarse.bytes());
        assert!(mean > 0.05 && bias.abs() < 0.01 && rms < 0.03, "{name}: {bias} {rms} of {mean}");
    }
}

#[test]
fn every_encoding_has_coarser_tables_and_what_cannot_be_halved_has_none() {
    let two_point = |entries, exits| Representation::TwoPoint { entries, exits };
    for encoding in Encoding::ALL {
        let coarse = coarser(&ball(0.7, two_point(33, 16), encoding));
        assert_eq!(coarse.table().unwrap().format().representation, two_point(17, 8));
        assert_eq!(coarse.table().unwrap().encoding(), encoding);
        let (bias, rms, _) = compare(&ambient(&ball_field(0.7, 33, 16)), &ambient(&coarse));
        assert!(bias.abs() < 0.02 && rms < 0.04, "{encoding:?}: {bias} {rms}");
    }
    let papers = Representation::Hemisphere { positions: 290, directions: 16, map: DirectionMap::Concentric };
    for none in [papers, two_point(6, 16), two_point(33, 6), two_point(1, 1)] {
        assert_eq!(ball(0.7, none, Encoding::U8).table().unwrap().coarser(), None, "{none}");
    }
}
