//! Least squares: grid values whose interpolation is right between the points too.

use std::array;

use glam::Vec3;
use rayon::prelude::*;
use visfield::field::cap_grid::harmonics::MAX_COEFFICIENTS;
use visfield::field::cap_grid::warp::{AxisWarp, storage_scale};
use visfield::field::cap_grid::{CapGridHeader, GridPoint};

use super::view::View;
use super::{FITTED_RAYS, Surroundings, in_cube, rotation};

/// Views per cell, spread over the grid.
const PER_CELL: usize = 6;
/// Views just off the surface, per cell of the whole grid.
const AT_SURFACE_PER_CELL: usize = 3;
/// How far off the surface they are, in cells.
const OFF_SURFACE: f32 = 1.5;
/// How strongly values are held where they started, in mean weights of a point.
const INERTIA: f32 = 0.1;
/// Steps of conjugate gradients.
const STEPS: usize = 25;

/// Number of views that a fit takes.
pub(super) fn views(points: u32) -> u64 {
    (u64::from(points) - 1).pow(3) * (PER_CELL + AT_SURFACE_PER_CELL) as u64
}

/// Turns the views of the grid's points into fitted values, scaled for storage.
pub(super) fn fit(
    header: &CapGridHeader,
    surroundings: &Surroundings,
    points: &mut [View],
    progress: &(impl Fn(u64) + Sync),
) {
    fill_inside(header.format.points as usize, points);
    for view in points.iter_mut() {
        view.scale(storage_scale(view.position));
    }
    let views = look_around(header, surroundings, progress);
    let warps = header.warps();
    let rows: Vec<Row> = views.iter().map(|view| Row::new(&warps, header.format.points, view.position)).collect();
    let fitted: Vec<Vec<f32>> = (0..header.format.order.coefficients())
        .into_par_iter()
        .map(|i| {
            let start: Vec<f32> = points.iter().map(|view| view.coefficients[i]).collect();
            let targets: Vec<f32> = views.iter().map(|view| view.coefficients[i]).collect();
            solve(&rows, &targets, start)
        })
        .collect();
    for (i, values) in fitted.iter().enumerate() {
        points.iter_mut().zip(values).for_each(|(view, value)| view.coefficients[i] = *value);
    }
}

/// Points just inside the mesh, where nobody looks, take the mean of their neighbours outside: what is interpolated across the
/// surface then starts from what is seen there. Points deeper inside stay fully occluded.
fn fill_inside(side: usize, points: &mut [View]) {
    let outside: Vec<Option<[f32; MAX_COEFFICIENTS]>> =
        points.iter().map(|view| (!view.inside).then_some(view.coefficients)).collect();
    let around = |i: usize| i.saturating_sub(1)..=(i + 1).min(side - 1);
    for (index, view) in points.iter_mut().enumerate().filter(|(_, view)| view.inside) {
        let (x, y, z) = (index % side, index / side % side, index / (side * side));
        let mut sum = [0.0; MAX_COEFFICIENTS];
        let mut count = 0.0;
        for neighbor in
            around(z).flat_map(|z| around(y).flat_map(move |y| around(x).map(move |x| (z * side + y) * side + x)))
        {
            if let Some(seen) = &outside[neighbor] {
                count += 1.0;
                sum.iter_mut().zip(seen).for_each(|(sum, x)| *sum += x);
            }
        }
        if count > 0.0 {
            view.coefficients = sum.map(|x| x / count);
        }
    }
}

/// What is seen from between the points, scaled for storage: evenly over the grid's cells, and just off the surface. None is
/// inside the mesh.
fn look_around(header: &CapGridHeader, surroundings: &Surroundings, progress: &(impl Fn(u64) + Sync)) -> Vec<View> {
    let cells = (header.format.points as usize - 1).pow(3);
    let warps = header.warps();
    let spread = (0..cells * PER_CELL).map(|index| {
        let u = in_cube(index) * 2.0 - 1.0;
        Vec3::from(array::from_fn(|axis| warps[axis].position(u[axis])))
    });
    let cell = warps.map(|warp| warp.slope).into_iter().fold(0.0, f32::max) * 2.0 / (header.format.points - 1) as f32;
    let near = surroundings.near_surface(cells * AT_SURFACE_PER_CELL, OFF_SURFACE * cell);
    let positions: Vec<Vec3> = spread.chain(near).collect();
    positions
        .par_iter()
        .enumerate()
        .filter_map(|(index, &position)| {
            let rays = surroundings.rays_from(position, FITTED_RAYS);
            progress(rays.into());
            let mut view = surroundings.view(position, rays, rotation(index));
            view.scale(storage_scale(position));
            (!view.inside).then_some(view)
        })
        .collect()
}

impl Surroundings {
    /// Points up to `distance` away from the surface, evenly over its area and on both sides.
    pub(super) fn near_surface(&self, count: usize, distance: f32) -> Vec<Vec3> {
        let mut total = 0.0;
        let area = |[a, b, c]: &[Vec3; 3]| f64::from((b - a).cross(c - a).length());
        let ends: Vec<f64> = self
            .triangles
            .iter()
            .map(|t| {
                total += area(t);
                total
            })
            .collect();
        let at = |index: usize| {
            let along = (index as f64 + 0.5) / count as f64 * total;
            let [a, b, c] = self.triangles[ends.partition_point(|end| *end < along).min(ends.len() - 1)];
            let Vec3 { x, y, z } = in_cube(index);
            let (u, v) = if x + y > 1.0 { (1.0 - x, 1.0 - y) } else { (x, y) };
            let normal = (b - a).cross(c - a).normalize_or_zero();
            a + (b - a) * u + (c - a) * v + normal * (distance * (2.0 * z - 1.0))
        };
        (0..count).map(at).collect()
    }
}

/// One view as the grid interpolates it: eight points and their weights.
struct Row {
    points: [u32; 8],
    weights: [f32; 8],
}

impl Row {
    fn new(warps: &[AxisWarp; 3], points: u32, position: Vec3) -> Self {
        let at = GridPoint::new(warps, points, position);
        let first = at.index(points);
        let ends = |corner: usize| array::from_fn::<usize, 3, _>(|axis| corner >> axis & 1);
        Self {
            points: array::from_fn(|corner| {
                let [x, y, z] = ends(corner).map(|end| end as u32);
                first + (z * points + y) * points + x
            }),
            weights: array::from_fn(|corner| {
                let share = |axis: usize| {
                    if ends(corner)[axis] == 1 { at.fraction[axis] } else { 1.0 - at.fraction[axis] }
                };
                share(0) * share(1) * share(2)
            }),
        }
    }

    fn interpolate(&self, values: &[f32]) -> f32 {
        self.points.iter().zip(self.weights).map(|(&point, weight)| values[point as usize] * weight).sum()
    }

    fn spread(&self, value: f32, values: &mut [f32]) {
        self.points.iter().zip(self.weights).for_each(|(&point, weight)| values[point as usize] += value * weight);
    }
}

/// The values nearest to `start` whose interpolation is nearest to `targets`: `(AᵀA + λ) x = Aᵀt + λ x₀`, by conjugate gradients.
fn solve(rows: &[Row], targets: &[f32], start: Vec<f32>) -> Vec<f32> {
    let squares: f32 = rows.iter().flat_map(|row| row.weights).map(|w| w * w).sum();
    let inertia = INERTIA * squares / start.len() as f32;
    let apply = |x: &[f32]| {
        let mut product: Vec<f32> = x.iter().map(|x| x * inertia).collect();
        for row in rows {
            row.spread(row.interpolate(x), &mut product);
        }
        product
    };
    let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(a * b)).sum::<f64>();
    // At the start, what remains is Aᵀ(t − A x₀).
    let mut x = start;
    let mut rest = vec![0.0; x.len()];
    rows.iter().zip(targets).for_each(|(row, target)| row.spread(target - row.interpolate(&x), &mut rest));
    let mut direction = rest.clone();
    let mut squared = dot(&rest, &rest);
    for _ in 0..STEPS {
        if squared <= f64::MIN_POSITIVE {
            break;
        }
        let changed = apply(&direction);
        let step = (squared / dot(&direction, &changed)) as f32;
        x.iter_mut().zip(&direction).for_each(|(x, d)| *x += step * d);
        rest.iter_mut().zip(&changed).for_each(|(r, c)| *r -= step * c);
        let next = dot(&rest, &rest);
        let keep = (next / squared) as f32;
        direction.iter_mut().zip(&rest).for_each(|(d, r)| *d = r + keep * *d);
        squared = next;
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_grid_can_hold_is_found() {
        let warps = [AxisWarp::new(1.0, 6); 3];
        let held: Vec<f32> = (0..216).map(|i| in_cube(i).x).collect();
        let rows: Vec<Row> = (0..4000).map(|i| Row::new(&warps, 6, (in_cube(i) * 2.0 - 1.0) * 5.0)).collect();
        let targets: Vec<f32> = rows.iter().map(|row| row.interpolate(&held)).collect();
        let mean_error = |values: &[f32]| {
            let error = |(row, target): (&Row, &f32)| (row.interpolate(values) - target).abs();
            rows.iter().zip(&targets).map(error).sum::<f32>() / rows.len() as f32
        };
        let nothing = vec![0.0; held.len()];
        assert!(mean_error(&nothing) > 0.4);
        // Inertia holds back what no row sees well.
        let found = solve(&rows, &targets, nothing);
        assert!(mean_error(&found) < 0.03, "{}", mean_error(&found));
        assert_eq!(solve(&rows, &targets, held.clone()), held, "nothing is to be gained");
    }
}
