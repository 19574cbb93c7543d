//! Pictures of the corner as the 2008 paper shows it: exact occlusion, a field's, and their difference.

use std::io::Cursor;

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use glam::DVec3;
use image::{GrayImage, ImageFormat, Luma};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::scene::Corner;
use crate::exact::ExactScene;
use crate::mesh::{Mesh, MeshError};

/// Width of the pictures in pixels.
pub const WIDTH: u32 = 480;
/// Height of the pictures in pixels.
pub const HEIGHT: u32 = 360;
/// By how much differences are exaggerated, as in the paper.
pub const EXAGGERATION: f32 = 5.0;

/// Sub-pixels a side.
const SUBPIXELS: u32 = 2;
/// Grey where there is nothing.
const BACKGROUND: f32 = 0.93;

/// Three pictures of the corner, PNG files in base64.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Pictures {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Visibility of floor and walls by exact rays.
    pub exact: String,
    /// Visibility of floor and walls by the field.
    pub field: String,
    /// The absolute difference, × [`EXAGGERATION`]: black where both agree.
    pub difference: String,
}

/// Draws a mesh in its corner: floor and walls shaded by visibility, the mesh by the angle at which it is seen.
///
/// `exact` and `found` are the occlusion of each receiver of [`MeasureScene::Corner`](super::MeasureScene::Corner), with as many
/// of them along each side as there are.
///
/// # Errors
/// [`MeshError`] if the mesh cannot be baked.
///
/// # Panics
/// If the values are not those of three squares of receivers, each alike.
pub fn corner_pictures(mesh: &Mesh, exact: &[f32], found: &[f32]) -> Result<Pictures, MeshError> {
    Ok(CornerView::new(mesh)?.pictures(exact, found))
}

/// The corner as the camera sees it: traced once, shaded many times.
pub(super) struct CornerView {
    corner: Corner,
    /// The point of every sub-pixel, row by row.
    points: Vec<Point>,
}

impl CornerView {
    pub(super) fn new(mesh: &Mesh) -> Result<Self, MeshError> {
        let corner = Corner::around(mesh)?;
        let scene = ExactScene::new(&[(mesh, glam::DAffine3::IDENTITY)], corner.origin)?;
        Ok(Self::of(corner, &scene, corner.origin))
    }

    /// Any corner, and a scene that is relative to `origin`.
    pub(super) fn of(corner: Corner, scene: &ExactScene, origin: DVec3) -> Self {
        let camera = Camera::new(corner);
        let (rows, columns) = (HEIGHT * SUBPIXELS, WIDTH * SUBPIXELS);
        let point =
            |i: u32| visible_point(scene, origin, corner, camera.eye, camera.direction(i % columns, i / columns));
        Self { corner, points: (0..rows * columns).into_par_iter().map(point).collect() }
    }

    pub(super) fn pictures(&self, exact: &[f32], found: &[f32]) -> Pictures {
        assert_eq!(exact.len(), found.len(), "one value per receiver, twice");
        let difference: Vec<f32> = exact.iter().zip(found).map(|(a, b)| (a - b).abs() * EXAGGERATION).collect();
        // The mesh is not measured; a hint of it says where it is.
        let shade_difference = |point: &Point| match *point {
            Point::Nothing => 0.0,
            Point::Mesh { facing } => facing * 0.2,
            Point::Square { .. } => interpolate(&self.corner, &difference, point),
        };
        Pictures {
            width: WIDTH,
            height: HEIGHT,
            exact: png(&self.visibility(exact)),
            field: png(&self.visibility(found)),
            difference: png(&self.draw(shade_difference)),
        }
    }

    /// Root of the mean square difference of the two pictures, over all pixels, in steps of their 255 levels: as the paper
    /// measures errors.
    pub(super) fn rms_255(&self, exact: &[f32], found: &[f32]) -> f64 {
        let [exact, found] = [exact, found].map(|occlusion| self.visibility(occlusion));
        let squares = exact.iter().zip(found.iter()).map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2));
        (squares.sum::<f64>() / exact.len() as f64).sqrt()
    }

    fn visibility(&self, occlusion: &[f32]) -> GrayImage {
        self.draw(|point| match *point {
            Point::Nothing => BACKGROUND,
            Point::Mesh { facing } => facing,
            Point::Square { .. } => 1.0 - interpolate(&self.corner, occlusion, point),
        })
    }

    /// Each pixel is the mean of its sub-pixels.
    fn draw(&self, shade: impl Fn(&Point) -> f32) -> GrayImage {
        let columns = (WIDTH * SUBPIXELS) as usize;
        let sides = SUBPIXELS as usize;
        GrayImage::from_fn(WIDTH, HEIGHT, |x, y| {
            let (x, y) = (x as usize * sides, y as usize * sides);
            let inside = (0..sides).flat_map(|dy| (0..sides).map(move |dx| (y + dy) * columns + x + dx));
            let mean = inside.map(|i| shade(&self.points[i]).clamp(0.0, 1.0)).sum::<f32>() / (sides * sides) as f32;
            Luma([(mean * 255.0).round() as u8])
        })
    }
}

/// A PNG in base64.
pub(super) fn png(picture: &GrayImage) -> String {
    let mut bytes = Cursor::new(Vec::new());
    picture.write_to(&mut bytes, ImageFormat::Png).expect("memory takes any picture");
    BASE64_STANDARD.encode(bytes.into_inner())
}

/// What a primary ray meets first.
#[derive(Clone, Copy)]
enum Point {
    Nothing,
    /// The mesh, and the cosine of the angle between its normal and the ray.
    Mesh {
        facing: f32,
    },
    /// The corner's floor or one of its walls: its number, and the place in it, 0 to 1.
    Square {
        square: usize,
        column: f32,
        row: f32,
    },
}

struct Camera {
    eye: DVec3,
    forward: DVec3,
    /// As long as half the picture is wide, at distance 1.
    right: DVec3,
    up: DVec3,
}

impl Camera {
    /// From the open side, a little from above. The squares' far ends, where little happens, are cut off.
    fn new(Corner { origin, side, height }: Corner) -> Self {
        let eye = origin + DVec3::new(2.45, 1.75, 2.45) * side;
        let target = origin + DVec3::new(0.37, 0.27 * height, 0.37) * side;
        let forward = (target - eye).normalize();
        let right = forward.cross(DVec3::Y).normalize();
        let half_width = 0.27;
        let half_height = half_width * f64::from(HEIGHT) / f64::from(WIDTH);
        Self { eye, forward, right: right * half_width, up: right.cross(forward) * half_height }
    }

    fn direction(&self, column: u32, row: u32) -> DVec3 {
        let along = |i: u32, count: u32| (f64::from(i) + 0.5) / f64::from(count * SUBPIXELS) * 2.0 - 1.0;
        self.forward + self.right * along(column, WIDTH) - self.up * along(row, HEIGHT)
    }
}

fn visible_point(scene: &ExactScene, origin: DVec3, corner: Corner, eye: DVec3, direction: DVec3) -> Point {
    let square = nearest_square(corner, eye, direction);
    let end = square.map_or(f64::INFINITY, |(t, _)| t);
    let hit = scene.triangles().closest_hit_normal((eye - origin).as_vec3(), direction.as_vec3(), end as f32);
    match (hit, square) {
        (Some((_, normal)), _) => Point::Mesh { facing: normal.dot(direction.as_vec3().normalize()).abs() },
        (None, Some((_, point))) => point,
        (None, None) => Point::Nothing,
    }
}

/// The nearest of floor, wall in −z and wall in −x, in the order of the receivers.
fn nearest_square(Corner { origin, side, height }: Corner, eye: DVec3, direction: DVec3) -> Option<(f64, Point)> {
    // For each square: its normal, the axis of its columns, the axis of its rows.
    [(1, 0, 2), (2, 0, 1), (0, 2, 1)]
        .into_iter()
        .enumerate()
        .filter_map(|(square, (normal, across, along))| {
            let t = (origin[normal] - eye[normal]) / direction[normal];
            let place = (eye + direction * t - origin) / DVec3::new(side, side * height, side);
            let inside = |x: f64| (0.0..=1.0).contains(&x);
            let point = Point::Square { square, column: place[across] as f32, row: place[along] as f32 };
            (t > 0.0 && inside(place[across]) && inside(place[along])).then_some((t, point))
        })
        .min_by(|a, b| a.0.total_cmp(&b.0))
}

/// How many receivers each side of the floor has.
fn receivers_per_side(corner: &Corner, values: &[f32]) -> usize {
    let side = (values.len() as f64 / (1.0 + 2.0 * corner.height)).sqrt().round() as usize;
    let expected = (side + 2 * corner.wall_rows(side)) * side;
    assert!(side >= 2 && expected == values.len(), "{} values are not those of a corner", values.len());
    side
}

/// Between the four receivers around a point of the floor or of a wall.
fn interpolate(corner: &Corner, values: &[f32], point: &Point) -> f32 {
    let Point::Square { square, column, row } = *point else { return 0.0 };
    let columns = receivers_per_side(corner, values);
    let wall_rows = corner.wall_rows(columns);
    let (rows, first) = if square == 0 { (columns, 0) } else { (wall_rows, columns + (square - 1) * wall_rows) };
    let (column, row) = (column * (columns - 1) as f32, row * (rows - 1) as f32);
    let (left, top) = ((column as usize).min(columns - 2), (row as usize).min(rows - 2));
    let (x, y) = (column - left as f32, row - top as f32);
    let value = |dx: usize, dy: usize| values[(first + top + dy) * columns + left + dx];
    let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
    mix(mix(value(0, 0), value(1, 0), x), mix(value(0, 1), value(1, 1), x), y)
}
