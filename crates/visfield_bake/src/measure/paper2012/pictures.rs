//! The scenes as a camera sees them, grey by how much of the sky or of the light each pixel sees.

use glam::{DVec3, Vec3};
use image::{GrayImage, Luma};
use rayon::prelude::*;
use visfield::estimate::Receiver;

use super::scenes::Scene;
use crate::measure::picture::{EXAGGERATION, Pictures, png};

/// Width of the pictures in pixels.
const WIDTH: u32 = 400;
/// Height of the pictures in pixels.
const HEIGHT: u32 = 300;
/// Where the camera is, and where it looks, in radii of the first object.
const EYE: DVec3 = DVec3::new(-3.7, 2.7, 3.2);
const TARGET: DVec3 = DVec3::new(-0.3, 0.6, -0.3);
/// Half the picture's width at distance 1.
const HALF_WIDTH: f64 = 0.42;

/// What each pixel shows.
pub(super) struct View {
    /// On the ground first.
    pub(super) receivers: Vec<Receiver>,
    pub(super) grounded: usize,
    /// Of each receiver.
    pixels: Vec<u32>,
}

impl View {
    pub(super) fn new(scene: &Scene) -> Self {
        let forward = (TARGET - EYE).normalize();
        let right = forward.cross(DVec3::Y).normalize();
        let up = right.cross(forward);
        let half_height = HALF_WIDTH * f64::from(HEIGHT) / f64::from(WIDTH);
        let receiver = |pixel: u32| {
            let along = |i: u32, count: u32| (f64::from(i) + 0.5) / f64::from(count) * 2.0 - 1.0;
            let direction = forward + right * (HALF_WIDTH * along(pixel % WIDTH, WIDTH))
                - up * (half_height * along(pixel / WIDTH, HEIGHT));
            let hit = scene.exact.triangles().closest_hit_normal(EYE.as_vec3(), direction.as_vec3(), f32::INFINITY);
            hit.map(|(t, normal)| {
                let normal = normal.normalize();
                let normal = if normal.dot(direction.as_vec3()) > 0.0 { -normal } else { normal };
                (pixel, Receiver { position: EYE + direction * f64::from(t), normal })
            })
        };
        let mut seen: Vec<_> = (0..WIDTH * HEIGHT).into_par_iter().filter_map(receiver).collect();
        let on_ground = |receiver: &Receiver| receiver.position.y < 1.0e-4 && receiver.normal == Vec3::Y;
        seen.sort_by_key(|(_, receiver)| !on_ground(receiver));
        let grounded = seen.iter().filter(|(_, receiver)| on_ground(receiver)).count();
        let (pixels, receivers) = seen.into_iter().unzip();
        Self { receivers, grounded, pixels }
    }

    /// Exact, found, and how they differ.
    pub(super) fn pictures(&self, exact: &[f32], found: &[f32]) -> Pictures {
        let draw = |background: f32, shade: &dyn Fn(usize) -> f32| {
            let level = |shade: f32| Luma([(shade.clamp(0.0, 1.0) * 255.0).round() as u8]);
            let mut picture = GrayImage::from_pixel(WIDTH, HEIGHT, level(background));
            for (index, pixel) in self.pixels.iter().enumerate() {
                picture.put_pixel(pixel % WIDTH, pixel / WIDTH, level(shade(index)));
            }
            png(&picture)
        };
        Pictures {
            width: WIDTH,
            height: HEIGHT,
            exact: draw(1.0, &|i| 1.0 - exact[i]),
            field: draw(1.0, &|i| 1.0 - found[i]),
            difference: draw(0.0, &|i| (exact[i] - found[i]).abs() * EXAGGERATION),
        }
    }
}
