//! What the fit does to thin parts, and to smooth ones.

use super::super::fit::{Cell, Sampling};
use super::*;

const BOUND: f32 = 0.05;

/// The largest interpolated value at random points of the surface, of which there are `per_triangle` each.
fn highest(values: &[f32], grid: &GridPoints, soup: &[[DVec3; 3]], per_triangle: usize) -> f32 {
    let mut random = Random(11);
    let mut highest = f32::NEG_INFINITY;
    for triangle in soup {
        for _ in 0..per_triangle {
            let place = (random.on_triangle(*triangle) - grid.low) / grid.voxel;
            let cell = Cell::around(grid.points, place.as_vec3()).expect("the grid holds the mesh");
            highest = highest.max(cell.value(values));
        }
    }
    highest
}

#[test]
fn no_surface_is_missed() {
    let plate = cuboid(dvec3(-1.0, -1.0, 0.01), dvec3(1.0, 1.0, 0.02));
    let triangle = vec![[dvec3(0.0, 0.0, 0.013), dvec3(1.0, 0.1, 0.2), dvec3(0.2, 0.9, 0.3)]];
    let needle = vec![[dvec3(0.0, 0.0, 0.0), dvec3(1.0, 0.4, 0.2), dvec3(0.5, 0.2001, 0.1)]];
    let open: Soup = cuboid(DVec3::splat(-1.0), DVec3::splat(1.0))[..10].to_vec();
    for (what, soup) in [("plate", plate), ("triangle", triangle), ("needle", needle), ("open box", open)] {
        let grid = around(&soup, 24, 2.4);
        let exact = distances_of(&soup, &grid);
        let mut values = exact.clone();
        let lowered = fit_to_surface(&mut values, &grid, &soup, EVEN);
        assert!(highest(&exact, &grid, &soup, 2000) > 0.3, "{what} needs no fit");
        // Between samples, a little more.
        let after = highest(&values, &grid, &soup, 2000);
        println!("{what}: {after}, {lowered:?}");
        assert!(after < 0.1, "{what}: {after}");
        assert!(values.iter().zip(&exact).all(|(value, exact)| value <= exact), "{what}: a value was raised");
        let changed = values.iter().zip(&exact).filter(|(value, exact)| value != exact);
        assert_eq!(lowered.points, changed.clone().count() as u64);
        assert!(changed.clone().all(|(_, exact)| exact.abs() < 1.8), "{what}: far from the surface");
        let again = fit_to_surface(&mut values, &grid, &soup, FitBounds { sheet: BOUND + 1e-5, solid: BOUND + 1e-5 });
        assert_eq!((again.above, again.samples), (0, lowered.samples), "{what}: a sample is still above");
    }
}

#[test]
fn real_meshes_change_little() {
    for (name, mean, max) in [("stanford-bunny.obj", 0.04, 0.7), ("igea.glb", 0.04, 0.5), ("cow.obj", 0.08, 0.8)] {
        let Some(soup) = shared_mesh(name) else { return };
        let grid = around(&soup, 64, 2.0);
        let mut values = distances_of(&soup, &grid);
        let before = highest(&values, &grid, &soup, 2);
        let near = values.iter().filter(|d| d.abs() < 1.0).count() as u64;
        let lowered = fit_to_surface(&mut values, &grid, &soup, EVEN);
        let after = highest(&values, &grid, &soup, 2);
        println!("{name}: {before} to {after}, {near} points near the surface, {lowered:?}");
        assert!(lowered.mean < mean && lowered.max < max && lowered.points < near, "{name}: {lowered:?}");
        assert!(before > 0.3 && after < 0.07, "{name}: {before} to {after}");
    }
}

#[test]
fn a_smooth_surface_is_hardly_changed() {
    let soup = sphere(32);
    let grid = around(&soup, 40, 3.0);
    let mut values = distances_of(&soup, &grid);
    let lowered = fit_to_surface(&mut values, &grid, &soup, EVEN);
    assert_eq!(lowered.above, 0, "{lowered:?}");
    assert_eq!(distances_of(&soup, &grid), values);
}

#[test]
fn no_point_of_a_triangle_is_far_from_a_sample() {
    let mut random = Random(5);
    for i in 0..300 {
        let size = [0.2, 1.0, 5.0, 20.0][i % 4];
        let flat = [1.0, 0.2, 0.01][i % 3];
        let a = random.in_cube();
        let along = random.in_cube();
        let triangle = [a, a + along * size, a + (along * random.signed() + random.in_cube() * flat) * size];
        let rounded = triangle.map(DVec3::as_vec3);
        let mut samples = Vec::new();
        Sampling::new(&[rounded]).for_each(&rounded, |sample| samples.push(sample.as_dvec3()));
        let on_it = |sample: &DVec3| Triangle::new(triangle).squared_distance(*sample) < 1e-9;
        assert!(samples.iter().all(on_it));
        for _ in 0..50 {
            let point = random.on_triangle(triangle);
            let nearest = samples.iter().map(|sample| sample.distance(point)).fold(f64::INFINITY, f64::min);
            assert!(nearest < 0.2, "{triangle:?}: {nearest}");
        }
    }
}

#[test]
fn huge_triangles_have_no_more_samples_than_others() {
    let huge = [Vec3::ZERO, Vec3::new(1e6, 0.0, 0.0), Vec3::new(0.0, 1e6, 1e3)];
    let mut count = 0_u64;
    Sampling::new(&[huge]).for_each(&huge, |_| count += 1);
    assert!((8_000_000..24_000_000).contains(&count), "{count}");
}
