//! What is traced: a city and a jewel as the paper's, a dodecahedron, and the distance grid of a mesh; and the rays.

use glam::{DAffine3, Vec3, vec3};
use rayon::prelude::*;
use visfield::distance::query::{LEAST_STEP, RELAXATION, SLACK, SLACK_REACH};
use visfield::distance::sphere_trace::{SphereTracing, Traced, sphere_trace};
use visfield::distance::{DistanceGrid, DistanceGridFormat, GRID_THRESHOLD};
use visfield::estimate::Receiver;
use visfield::field::query::Bias;
use visfield::shape::{Shape, ShapeProgram};

use super::facets::Facets;
use super::published::PICTURE;
use crate::bake::BakeError;
use crate::distance::bake_distance_grid;
use crate::measure::scene::{MeasureScene, hemisphere_directions};
use crate::mesh::Mesh;

/// Rays that nothing limits but this, which none of these scenes needs.
pub(super) const CONVERGED: u32 = 4096;
/// The finer threshold of rays that tell what there is to hit.
pub(super) const FINER: f32 = 1.0 / 16.0;

/// What says how far it is to the surface.
pub(super) enum Solid {
    Shape(ShapeProgram),
    Grid(DistanceGrid),
}

impl Solid {
    #[inline(always)]
    pub(super) fn distance(&self, position: Vec3) -> f32 {
        match self {
            Self::Shape(program) => program.distance(position),
            Self::Grid(grid) => grid.distance(position),
        }
    }
}

/// A scene in the space of its distances.
pub(super) struct Subject {
    pub(super) name: &'static str,
    pub(super) solid: Solid,
    pub(super) view: View,
    /// Everything that rays can meet is in this ball.
    pub(super) center: Vec3,
    pub(super) radius: f32,
    /// How rays from the eye are traced when nothing is enhanced.
    pub(super) plain: SphereTracing,
    /// Rays graze what they pass at less than this.
    pub(super) graze: f32,
    /// Hits farther apart than this are in different places.
    pub(super) apart: f32,
}

/// A ray with a unit direction, and the part of it that is traced.
#[derive(Clone, Copy)]
pub(super) struct TestRay {
    pub(super) origin: Vec3,
    pub(super) direction: Vec3,
    pub(super) range: (f32, f32),
}

impl TestRay {
    pub(super) fn at(&self, t: f32) -> Vec3 {
        self.origin + self.direction * t
    }
}

impl Subject {
    #[inline(always)]
    pub(super) fn trace(&self, ray: &TestRay, settings: &SphereTracing) -> Traced {
        sphere_trace(|position| self.solid.distance(position), ray.origin, ray.direction, ray.range, settings)
    }

    pub(super) fn trace_all(&self, rays: &[TestRay], settings: &SphereTracing) -> Vec<Traced> {
        rays.par_iter().map(|ray| self.trace(ray, settings)).collect()
    }

    /// A ray from anywhere, as far as the scene goes.
    pub(super) fn ray(&self, origin: Vec3, direction: Vec3) -> TestRay {
        let (near, far) = ball_range(origin - self.center, direction, self.radius);
        TestRay { origin, direction, range: (near.max(0.0), far) }
    }

    /// The ray of a pixel.
    pub(super) fn pixel(&self, x: u32, y: u32) -> TestRay {
        self.ray(self.view.eye, self.view.direction(x, y))
    }

    /// The rays of every `step`-th pixel both ways, row by row.
    pub(super) fn camera(&self, step: u32) -> Vec<TestRay> {
        let (width, height) = PICTURE;
        let rows = (step / 2..height).step_by(step as usize);
        let pixels = rows.flat_map(|y| (step / 2..width).step_by(step as usize).map(move |x| (x, y)));
        pixels.map(|(x, y)| self.pixel(x, y)).collect()
    }

    /// About `count` of the rays of every `step`-th pixel that pass something by closely without meeting it.
    pub(super) fn grazing(&self, step: u32, count: usize) -> Vec<TestRay> {
        let passes = |ray: &TestRay| self.passes_closely(ray);
        let found: Vec<TestRay> = self.camera(step).into_par_iter().filter(passes).collect();
        let every = (found.len() / count.max(1)).max(1);
        found.into_iter().step_by(every).collect()
    }

    /// Whether distances along a ray fall below what counts as grazing, and rise again.
    fn passes_closely(&self, ray: &TestRay) -> bool {
        let (mut t, mut before, mut falls) = (ray.range.0, f32::INFINITY, false);
        for _ in 0..CONVERGED {
            let distance = self.solid.distance(ray.at(t));
            if distance < self.plain.threshold.max(self.plain.pixel * t) || t > ray.range.1 {
                return false;
            }
            if falls && distance > before && before < self.graze {
                return true;
            }
            (falls, before) = (distance < before, distance);
            t += distance;
        }
        false
    }
}

/// Where a line with a unit direction enters a ball around the origin and leaves it; an empty range if it misses it.
fn ball_range(origin: Vec3, direction: Vec3, radius: f32) -> (f32, f32) {
    let middle = -origin.dot(direction);
    let beside = origin + direction * middle;
    let half = radius * radius - beside.length_squared();
    if half > 0.0 { (middle - half.sqrt(), middle + half.sqrt()) } else { (0.0, 0.0) }
}

/// A camera with the paper's pixels.
#[derive(Clone, Copy)]
pub(super) struct View {
    pub(super) eye: Vec3,
    forward: Vec3,
    /// As long as half the picture is wide, at distance 1.
    right: Vec3,
    up: Vec3,
}

impl View {
    fn new(eye: Vec3, target: Vec3, half_width: f32) -> Self {
        let forward = (target - eye).normalize();
        let right = forward.cross(Vec3::Y).normalize();
        let half_height = half_width * PICTURE.1 as f32 / PICTURE.0 as f32;
        Self { eye, forward, right: right * half_width, up: right.cross(forward) * half_height }
    }

    fn direction(&self, x: u32, y: u32) -> Vec3 {
        let along = |i: u32, count: u32| (i as f32 + 0.5) / count as f32 * 2.0 - 1.0;
        (self.forward + self.right * along(x, PICTURE.0) - self.up * along(y, PICTURE.1)).normalize()
    }

    /// Half a pixel at distance 1: what the paper ends rays at (2014, §3.2).
    fn half_pixel(&self) -> f32 {
        self.right.length() / PICTURE.0 as f32
    }
}

/// Sphere tracing without any enhancement but the end at half a pixel, for as many steps as it takes.
fn plain(threshold: f32, view: &View) -> SphereTracing {
    SphereTracing {
        relaxation: 1.0,
        adaptive: false,
        max_steps: CONVERGED,
        threshold,
        pixel: view.half_pixel(),
        ..SphereTracing::default()
    }
}

fn program(shape: &Shape) -> Solid {
    Solid::Shape(ShapeProgram::new(shape, 1.0).expect("the scenes of this module are valid shapes"))
}

/// Streets of boxes and towers on a ground without end, seen from just above them to the horizon: what the paper shows is larger, but
/// alike.
pub(super) fn city() -> Subject {
    const SIDE: u32 = 5;
    let mut parts = vec![Shape::HalfSpace];
    for block in 0..SIDE * SIDE {
        let (column, row) = ((block % SIDE) as f32 - 2.0, (block / SIDE) as f32 - 2.0);
        // Heights without a pattern that shows.
        let half_height = 0.3 + 0.11 * (block * 7 % 11) as f32;
        let body = match block % 5 {
            3 => Shape::Cylinder { half_height, radius: 0.6 },
            _ => Shape::Box { half_extents: [0.6, half_height, 0.6] },
        };
        let body = if block % 4 == 1 {
            body.smooth_union(Shape::Sphere { radius: 0.55 }.moved(Vec3::Y * half_height), 0.3)
        } else {
            body
        };
        parts.push(body.moved(vec3(column * 2.0, half_height, row * 2.0)));
    }
    let view = View::new(vec3(-8.0, 2.4, -6.5), vec3(0.0, 0.9, 0.0), 0.7);
    Subject {
        name: "city",
        solid: program(&Shape::Union(parts)),
        view,
        center: Vec3::ZERO,
        radius: 60.0,
        plain: plain(1.0e-3, &view),
        graze: 0.1,
        apart: 0.1,
    }
}

/// A solid of facets, `scale` times as large as its facets say.
pub(super) fn glass(name: &'static str, facets: &Facets, scale: f32) -> Subject {
    let view = View::new(vec3(0.9, 1.3, 3.0) * scale, vec3(0.0, -0.2, 0.0) * scale, 0.7);
    Subject {
        name,
        solid: program(&facets.shape()),
        view,
        center: Vec3::ZERO,
        radius: 1.3 * scale,
        plain: plain(1.0e-4 * scale, &view),
        graze: 0.03 * scale,
        apart: 0.02 * scale,
    }
}

/// The distance grid of a mesh, and the map to its voxels from the mesh.
pub(super) fn grid(mesh: &Mesh, format: DistanceGridFormat) -> Result<(Subject, DAffine3), BakeError> {
    let mesh_error = |source| BakeError::Mesh { name: mesh.name.clone(), source };
    let triangles = mesh.solid_triangles().map_err(mesh_error)?;
    let grid = bake_distance_grid(&triangles, format, |_| ())?;
    let grid_from_mesh = grid.header().grid_from_mesh();
    let center = grid.last() * 0.5;
    let radius = center.length();
    let view = View::new(center + vec3(0.5, 0.35, 1.0).normalize() * (2.2 * radius), center, 0.7);
    let subject = Subject {
        name: "grid",
        solid: Solid::Grid(grid),
        view,
        center,
        radius,
        plain: plain(GRID_THRESHOLD, &view),
        graze: 3.0,
        apart: 1.0,
    };
    Ok((subject, grid_from_mesh))
}

/// The rays by which a mesh shades itself, and how they are asked for: as fields ask their distances, but for over-relaxation.
pub(super) fn ambient(
    mesh: &Mesh,
    subject: &Subject,
    grid_from_mesh: DAffine3,
    (side, rays): (usize, u32),
) -> Result<(Vec<TestRay>, SphereTracing), BakeError> {
    let mesh_error = |source| BakeError::Mesh { name: mesh.name.clone(), source };
    let receivers = MeasureScene::OwnSurface.receivers_by(mesh, side).map_err(mesh_error)?;
    let bias = Bias::default();
    let slack = SLACK * bias.height;
    let from_receiver = |(index, receiver): (usize, &Receiver)| {
        let origin = grid_from_mesh.transform_point3(receiver.position).as_vec3();
        // Lifted out of the surface, as the grid has it.
        let origin = origin + receiver.normal * (-subject.solid.distance(origin)).clamp(0.0, slack);
        let directions = hemisphere_directions(receiver, index, rays);
        directions.into_iter().map(move |direction| subject.ray(origin, direction)).collect::<Vec<_>>()
    };
    let all = receivers.iter().enumerate().flat_map(from_receiver).collect();
    let settings = SphereTracing {
        pixel: 0.0,
        slack,
        slack_reach: SLACK_REACH * bias.along,
        least_step: LEAST_STEP,
        ..subject.plain
    };
    Ok((all, settings))
}

/// The ω with which fields ask their distances.
pub(super) const OWN_RELAXATION: f32 = RELAXATION;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grazing_rays_miss_what_they_pass() {
        let scene = glass("jewel", &Facets::jewel(1.0), 1.0);
        let grazing = scene.grazing(8, 100);
        assert!(grazing.len() > 50, "{}", grazing.len());
        for (ray, traced) in grazing.iter().zip(scene.trace_all(&grazing, &scene.plain)) {
            assert!(!traced.hit);
            let nearest = (0..4000).map(|i| scene.solid.distance(ray.at(ray.range.1 * i as f32 / 4000.0)));
            assert!(nearest.fold(f32::MAX, f32::min) < scene.graze);
        }
    }

    #[test]
    fn rays_go_through_the_ball_of_the_scene() {
        assert_eq!(ball_range(vec3(-3.0, 0.0, 0.0), Vec3::X, 1.0), (2.0, 4.0));
        assert_eq!(ball_range(vec3(-3.0, 2.0, 0.0), Vec3::X, 1.0), (0.0, 0.0));
        let scene = city();
        let hits = scene.trace_all(&scene.camera(40), &scene.plain).iter().filter(|traced| traced.hit).count();
        assert!((200..576).contains(&hits), "ground, houses and sky: {hits}");
    }
}
