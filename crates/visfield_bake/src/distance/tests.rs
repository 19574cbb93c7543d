//! Distances, signs and fits on closed forms, odd soups and real meshes.

use std::cell::Cell;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::time::Instant;

use glam::{DMat3, dvec3};

use super::closest::Triangle;
use super::fit::Lowered;
use super::winding::solid_angle;
use super::*;

const EVEN: FitBounds = FitBounds { sheet: 0.05, solid: 0.05 };

/// Triangles in mesh space.
type Soup = Vec<[DVec3; 3]>;

/// A real mesh, or `None` where it is not at hand. Never skips on the project's own checks.
fn shared_mesh(name: &str) -> Option<Soup> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/meshes").join(name);
    if path.exists() {
        return Some(crate::read_meshes(&path).unwrap()[0].solid_triangles().unwrap());
    }
    assert!(std::env::var_os("CI").is_none(), "{} is missing", path.display());
    println!("skipped: {} is missing", path.display());
    None
}

/// A grid around triangles, with `points` along the longest axis and so many voxels between them and the grid's faces.
fn around(triangles: &[[DVec3; 3]], points: u32, margin: f64) -> GridPoints {
    let corners = triangles.as_flattened();
    let low = corners.iter().fold(DVec3::INFINITY, |low, p| low.min(*p));
    let high = corners.iter().fold(DVec3::NEG_INFINITY, |high, p| high.max(*p));
    let voxel = (high - low).max_element() / (f64::from(points - 1) - 2.0 * margin);
    let counts = (high - low).to_array().map(|side| (side / voxel + 2.0 * margin).ceil() as u32 + 1);
    GridPoints { low: low - margin * voxel, voxel, points: counts }
}

/// The places of a grid's points, x fastest.
fn places(grid: &GridPoints) -> Vec<DVec3> {
    let [width, height, depth] = grid.points;
    let all = (0..depth).flat_map(|z| (0..height).flat_map(move |y| (0..width).map(move |x| [x, y, z])));
    all.map(|place| grid.low + DVec3::from(place.map(f64::from)) * grid.voxel).collect()
}

/// Numbers in [−1, 1) (`SplitMix64`, Steele et al., *Fast Splittable Pseudorandom Number Generators*, 2014).
struct Random(u64);

impl Random {
    fn signed(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    fn in_cube(&mut self) -> DVec3 {
        dvec3(self.signed(), self.signed(), self.signed())
    }

    fn on_triangle(&mut self, [a, b, c]: [DVec3; 3]) -> DVec3 {
        let (u, v) = (self.signed() * 0.5 + 0.5, self.signed() * 0.5 + 0.5);
        let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
        a + (b - a) * u + (c - a) * v
    }
}

/// An axis-aligned box, anticlockwise from outside. Its last two triangles are the side of highest z.
fn cuboid(low: DVec3, high: DVec3) -> Soup {
    let corner = |i: usize| {
        let pick = |axis: usize| if i >> axis & 1 == 1 { high[axis] } else { low[axis] };
        dvec3(pick(0), pick(1), pick(2))
    };
    let sides = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    sides.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).map(|t| t.map(corner)).collect()
}

fn cuboid_distance(point: DVec3, low: DVec3, high: DVec3) -> f64 {
    let beyond = (low - point).max(point - high);
    beyond.max(DVec3::ZERO).length() + beyond.max_element().min(0.0)
}

/// The unit sphere: an octahedron's sides, split n² times.
fn sphere(n: u32) -> Soup {
    let mut soup = Soup::new();
    for octant in 0..8 {
        let sign = |bit: u32| if octant >> bit & 1 == 0 { 1.0 } else { -1.0 };
        let signs = dvec3(sign(0), sign(1), sign(2));
        let at = |i: u32, j: u32| (signs * dvec3(f64::from(i), f64::from(j), f64::from(n - i - j))).normalize();
        let mut push = |[a, b, c]: [DVec3; 3]| {
            soup.push(if signs.to_array().iter().product::<f64>() > 0.0 { [a, b, c] } else { [a, c, b] });
        };
        for i in 0..n {
            for j in 0..n - i {
                push([at(i, j), at(i + 1, j), at(i, j + 1)]);
                if i + j + 2 <= n {
                    push([at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
                }
            }
        }
    }
    soup
}

fn flipped(soup: &[[DVec3; 3]]) -> Soup {
    soup.iter().map(|&[a, b, c]| [a, c, b]).collect()
}

/// The closest point of a triangle, by its Voronoi regions (Ericson, *Real-Time Collision Detection*, 2005, §5.1.5).
fn ericson(point: DVec3, [a, b, c]: [DVec3; 3]) -> DVec3 {
    let (ab, ac) = (b - a, c - a);
    let (d1, d2) = (ab.dot(point - a), ac.dot(point - a));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let (d3, d4) = (ab.dot(point - b), ac.dot(point - b));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return a + ab * (d1 / (d1 - d3));
    }
    let (d5, d6) = (ab.dot(point - c), ac.dot(point - c));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return a + ac * (d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        return b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)));
    }
    a + (ab * vb + ac * vc) / (va + vb + vc)
}

fn brute_force(point: DVec3, soup: &[[DVec3; 3]]) -> f64 {
    soup.iter().map(|t| ericson(point, *t).distance(point)).fold(f64::INFINITY, f64::min)
}

/// Fails unless all values are within `tolerance` voxels of a closed form in mesh units.
fn assert_distances(what: &str, grid: &GridPoints, values: &[f32], tolerance: f64, exact: impl Fn(DVec3) -> f64) {
    let places = places(grid);
    assert_eq!(values.len(), places.len());
    for (value, place) in values.iter().zip(places) {
        let exact = exact(place) / grid.voxel;
        assert!((f64::from(*value) - exact).abs() < tolerance, "{what}, {place}: {value}, exactly {exact}");
    }
}

fn distances_of(soup: &[[DVec3; 3]], grid: &GridPoints) -> Vec<f32> {
    signed_distances(soup, grid, |_| ())
}

#[test]
fn a_box_is_exact_at_any_scale_and_place() {
    for (scale, shift) in [(1.0, 0.0), (1e-4, 0.0), (1e4, 0.0), (1.0, 1e6), (1e-4, -1e3), (1e-12, 0.0), (1e12, 1e14)] {
        let (low, high) = (DVec3::splat(shift) - dvec3(1.0, 0.5, 0.7) * scale, dvec3(0.9, 0.6, 0.8) * scale + shift);
        let soup = cuboid(low, high);
        let grid = around(&soup, 21, 2.3);
        let exact = |p| cuboid_distance(p, low, high);
        let values = distances_of(&soup, &grid);
        assert_distances(&format!("scale {scale}, shift {shift}"), &grid, &values, 1e-4, exact);
        assert!(values.iter().any(|d| *d < -2.0) && values.iter().any(|d| *d > 2.0));
        assert_eq!(distances_of(&flipped(&soup), &grid), values, "inside out");
        let twice: Soup = soup.iter().chain(&soup).copied().collect();
        assert_distances("every triangle twice", &grid, &distances_of(&twice, &grid), 1e-4, exact);
    }
}

#[test]
fn a_box_whose_faces_are_grid_planes_is_exact() {
    let (low, high) = (DVec3::ZERO, dvec3(4.0, 6.0, 8.0));
    let grid = GridPoints { low: DVec3::splat(-2.0), voxel: 1.0, points: [9, 11, 13] };
    let values = distances_of(&cuboid(low, high), &grid);
    assert_distances("on the grid", &grid, &values, 1e-6, |p| cuboid_distance(p, low, high));
}

#[test]
fn a_sphere_is_as_round_as_its_triangles() {
    let soup = sphere(32);
    // Half the longest edge, as seen from the centre.
    let longest =
        soup.iter().map(|[a, b, c]| a.distance(*b).max(b.distance(*c)).max(c.distance(*a))).fold(0.0, f64::max);
    let sag = 1.0 - (longest / 3.0_f64.sqrt()).asin().cos();
    let grid = around(&soup, 40, 3.0);
    for soup in [&soup, &flipped(&soup)] {
        assert_distances("sphere", &grid, &distances_of(soup, &grid), sag / grid.voxel + 1e-4, |p| p.length() - 1.0);
    }
}

#[test]
fn odd_soups_agree_with_every_triangle_in_turn() {
    let mut random = Random(1);
    let mut soup = Soup::new();
    for i in 0..300 {
        let a = random.in_cube();
        let (along, across) = (random.in_cube(), random.in_cube());
        soup.push(match i % 6 {
            0 => [a, a + along * 0.2, a + across * 0.2],
            1 => [a, a + along, a + along * 0.3 + across * 1e-6],
            2 => [a, a + along, a + along * 0.4],
            3 => [a; 3],
            4 => [a, a, a + along * 0.3],
            _ => soup[i - 5],
        });
    }
    let grid = GridPoints { low: DVec3::splat(-1.5), voxel: 0.21, points: [15, 9, 17] };
    let unsigned: Vec<f32> = distances_of(&soup, &grid).into_iter().map(f32::abs).collect();
    // Lines make Ericson's regions divide by zero; their edges do not.
    let exact = |p: DVec3| {
        let edge = |a: DVec3, b: DVec3| {
            // A point is a line of no length.
            let along = ((p - a).dot(b - a) / (b - a).length_squared().max(1e-300)).clamp(0.0, 1.0);
            p.distance(a + (b - a) * along)
        };
        let of_edges = |&[a, b, c]: &[DVec3; 3]| edge(a, b).min(edge(b, c)).min(edge(c, a));
        let edges = soup.iter().map(of_edges).fold(f64::INFINITY, f64::min);
        let solid: Soup = soup.iter().step_by(6).copied().collect();
        edges.min(brute_force(p, &solid))
    };
    assert_distances("soup", &grid, &unsigned, 1e-4, exact);
    let surface = Surface::new(&grid.in_voxels(&soup));
    for _ in 0..200 {
        let place = random.in_cube() * 3.0;
        let found = f64::from(surface.distance(((place - grid.low) / grid.voxel).as_vec3())) * grid.voxel;
        assert!((found - exact(place)).abs() < 1e-5, "{place}: {found}");
    }
}

#[test]
fn needles_are_exact() {
    let turn = DMat3::from_rotation_x(0.3) * DMat3::from_rotation_y(1.1);
    let mut random = Random(7);
    for width in [1e-2, 1e-4, 1e-6, 0.0] {
        let needle = [DVec3::ZERO, dvec3(60.0, 0.0, 0.0), dvec3(25.0, width, 0.0)];
        for i in 0..1000 {
            let flat = if i % 2 == 0 {
                dvec3(30.0 + random.signed() * 40.0, random.signed() * 3.0, random.signed() * 3.0)
            } else {
                random.on_triangle(needle) + dvec3(0.0, 0.0, random.signed())
            };
            let along = flat.x.clamp(0.0, 60.0);
            let exact = flat.distance(dvec3(along, 0.0, 0.0));
            let mut turned = needle.map(|p| turn * p);
            turned.rotate_left(i % 3);
            let found = Triangle::new(turned).squared_distance(turn * flat).sqrt();
            assert!((found - exact).abs() < width + 1e-6, "width {width}, {flat}: {found}, exactly {exact}");
        }
    }
}

#[test]
fn what_has_no_inside_is_positive_all_around() {
    let corner = |x: f64, y: f64| dvec3(x, y, 0.3 * x + 0.1 * y);
    let triangle = vec![[corner(0.0, 0.0), corner(1.0, 0.1), corner(0.2, 0.9)]];
    let plate = vec![
        [corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0)],
        [corner(0.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)],
    ];
    let needle = vec![[dvec3(0.0, 0.0, 0.0), dvec3(1.0, 0.4, 0.2), dvec3(0.5, 0.2001, 0.1)]];
    for soup in [triangle, plate, needle] {
        let grid = around(&soup, 24, 2.5);
        assert_distances("open", &grid, &distances_of(&soup, &grid), 1e-4, |p| brute_force(p, &soup));
    }
}

#[test]
fn wide_openings_stay_open_and_holes_are_closed() {
    let (low, high) = (dvec3(-1.0, -1.0, -1.0), dvec3(1.0, 1.0, 1.0));
    let mut soup = cuboid(low, high);
    let grid = around(&soup, 32, 3.3);
    soup.truncate(10);
    let values = distances_of(&soup, &grid);
    assert_distances("one side is missing", &grid, &values, 1e-4, |p| brute_force(p, &soup));
    // The missing side is back, but for a hole in its middle.
    let around_hole = |hole: f64| {
        let rims = [1.0, hole].map(|r| [[-r, -r], [r, -r], [r, r], [-r, r]].map(|[x, y]| dvec3(x, y, 1.0)));
        let sides = [(0, 1), (1, 2), (2, 3), (3, 0)];
        let frame = sides.iter().flat_map(|&(i, j)| {
            let [outer, inner] = rims;
            [[outer[i], outer[j], inner[j]], [outer[i], inner[j], inner[i]]]
        });
        soup.iter().copied().chain(frame).collect::<Soup>()
    };
    for (hole, closed) in [(0.05, true), (0.2, true), (0.8, false)] {
        let soup = around_hole(hole);
        for soup in [&soup, &flipped(&soup)] {
            let values = distances_of(soup, &grid);
            let is_within = |p: DVec3| p.abs().max_element() < 1.0;
            let wrong =
                values.iter().zip(places(&grid)).filter(|(d, p)| (**d < 0.0) != (closed && is_within(*p))).count();
            // Of about 20,000: where exactly a hole is closed may be a voxel off.
            assert!(wrong < 30, "hole {hole}: {wrong} of {}", values.len());
        }
    }
}

#[test]
fn overlapping_and_nested_boxes() {
    let cube = |center: DVec3, half: f64| cuboid(center - half, center + half);
    let holds = |p: DVec3, center: DVec3, half: f64| (p - center).abs().max_element() < half;
    let shifted = dvec3(0.55, 0.6, 0.7);
    let [one, other, inner] = [cube(DVec3::ZERO, 1.0), cube(shifted, 1.0), cube(DVec3::ZERO, 0.57)];
    let both: Soup = one.iter().chain(&other).copied().collect();
    let shell: Soup = one.iter().chain(&flipped(&inner)).copied().collect();
    let solid: Soup = one.iter().chain(&inner).copied().collect();
    let in_both = |p| holds(p, DVec3::ZERO, 1.0) || holds(p, shifted, 1.0);
    let in_shell = |p| holds(p, DVec3::ZERO, 1.0) && !holds(p, DVec3::ZERO, 0.57);
    let in_solid = |p| holds(p, DVec3::ZERO, 1.0);
    let cases: [(Soup, &dyn Fn(DVec3) -> bool); 3] = [(both, &in_both), (shell, &in_shell), (solid, &in_solid)];
    for (soup, is_inside) in cases {
        let grid = around(&soup, 30, 2.1);
        for soup in [&soup, &flipped(&soup)] {
            let signed = |p| brute_force(p, soup) * if is_inside(p) { -1.0 } else { 1.0 };
            assert_distances("two boxes", &grid, &distances_of(soup, &grid), 1e-4, signed);
        }
    }
}

#[test]
fn nothing_is_infinitely_far_and_small_grids_work() {
    let grid = GridPoints { low: DVec3::ZERO, voxel: 1.0, points: [2, 3, 1] };
    assert_eq!(distances_of(&[], &grid), vec![f32::INFINITY; 6]);
    let soup = cuboid(DVec3::splat(-1.0), DVec3::splat(1.0));
    for points in [[0; 3], [1; 3], [1, 2, 1], [3, 0, 2]] {
        let grid = GridPoints { points, low: DVec3::splat(0.25), voxel: 0.5 };
        let mut values = distances_of(&soup, &grid);
        assert_eq!(values.len(), grid.count());
        assert!(values.first().is_none_or(|d| *d == -1.5), "{points:?}: {values:?}");
        let before = values.clone();
        assert_eq!(fit_to_surface(&mut values, &grid, &soup, EVEN), Lowered::default());
        assert_eq!(values, before);
    }
}

#[test]
fn progress_adds_up_and_threads_do_not_matter() {
    let soup = sphere(6);
    let grid = around(&soup, 23, 1.5);
    let done = AtomicU64::new(0);
    let mut values = signed_distances(&soup, &grid, |n| {
        done.fetch_add(n, Ordering::Relaxed);
    });
    assert_eq!(done.into_inner(), grid.count() as u64);
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let mut alone = one_thread.install(|| distances_of(&soup, &grid));
    assert_eq!(alone, values);
    one_thread.install(|| fit_to_surface(&mut alone, &grid, &soup, EVEN));
    fit_to_surface(&mut values, &grid, &soup, EVEN);
    assert_eq!(alone, values);
}

#[test]
fn winding_numbers_agree_with_the_sum_of_solid_angles() {
    let ball = sphere(24);
    let bowl: Soup = ball.iter().filter(|t| t.iter().all(|p| p.z < 1e-9)).copied().collect();
    let mut random = Random(3);
    for (soup, tolerance) in [(ball, 0.03), (bowl, 0.03)] {
        let in_voxels: Vec<_> = soup.iter().map(|t| t.map(DVec3::as_vec3)).collect();
        let surface = Surface::new(&in_voxels);
        let windings = WindingNumbers::new(&surface);
        for _ in 0..1000 {
            let point = (random.in_cube() * 2.0).as_vec3();
            let angles: f64 = in_voxels.iter().map(|t| solid_angle(t.map(|p| (p - point).as_dvec3()))).sum();
            let (found, exact) = (windings.at(point), angles / (4.0 * std::f64::consts::PI));
            assert!((found - exact).abs() < tolerance, "{point}: {found}, exactly {exact}");
        }
    }
}

#[test]
fn signs_of_the_bunny_enclose_its_volume() {
    // The bunny's base has holes, the others are closed.
    for (name, share) in [("stanford-bunny.obj", 0.01), ("cow.obj", 0.03), ("igea.glb", 0.01), ("spot.obj", 0.02)] {
        let Some(soup) = shared_mesh(name) else { return };
        let grid = GridPoints { points: [64; 3], ..around(&soup, 64, 2.0) };
        let inside = distances_of(&soup, &grid).iter().filter(|d| **d < 0.0).count();
        // On the ground, from where the holes add nothing.
        let center = grid.low + grid.voxel * dvec3(32.0, 2.0, 32.0);
        let volume: f64 = soup.iter().map(|[a, b, c]| (a - center).dot((b - center).cross(c - center)) / 6.0).sum();
        let counted = inside as f64 * grid.voxel.powi(3);
        println!("{name}: {counted} of {volume}");
        assert!((counted / volume.abs() - 1.0).abs() < share, "{name}: {counted}, exactly {volume}");
    }
}

mod fitting;

#[test]
fn time_of_64_points_a_side() {
    let clock = Cell::new(Instant::now());
    for name in ["stanford-bunny.obj", "cow.obj"] {
        let Some(soup) = shared_mesh(name) else { return };
        let grid = GridPoints { points: [64; 3], ..around(&soup, 64, 2.0) };
        let lap = || clock.replace(Instant::now()).elapsed();
        lap();
        let surface = Surface::new(&grid.in_voxels(&soup));
        let tree = lap();
        let mut distances = surface.lattice_distances(grid.points, |_| ());
        let searched = lap();
        let windings = WindingNumbers::new(&surface);
        let asked = AtomicU32::new(0);
        apply_signs(&mut distances, grid.points, |place| {
            asked.fetch_add(1, Ordering::Relaxed);
            windings.at(Vec3::from(place.map(|x| x as f32))).abs() >= 0.5
        });
        let signed = lap();
        let lowered = fit_to_surface(&mut distances, &grid, &soup, EVEN);
        println!("{name}, {} triangles: BVH {tree:.3?}, distances {:.3?}", soup.len(), searched);
        println!("  signs {:.3?}, {} winding numbers", signed, asked.into_inner());
        println!("  fit {:.3?}, {lowered:?}", lap());
        assert!(distances.iter().all(|d| d.is_finite()));
    }
}
