//! A chair of ten boxes: flat faces, sharp edges, thin parts, and much that lies in shadow.

use glam::{DVec3, dvec3};

use crate::surface::Surface;

/// Two opposite corners of each box, before centring: 1.6 tall, 0.8 wide and deep. The back is at −Z.
const BOXES: [[DVec3; 2]; 10] = [
    // Seat
    [dvec3(-0.40, 0.75, -0.40), dvec3(0.40, 0.83, 0.40)],
    // Legs
    [dvec3(-0.38, 0.00, -0.38), dvec3(-0.30, 0.75, -0.30)],
    [dvec3(0.30, 0.00, -0.38), dvec3(0.38, 0.75, -0.30)],
    [dvec3(-0.38, 0.00, 0.30), dvec3(-0.30, 0.75, 0.38)],
    [dvec3(0.30, 0.00, 0.30), dvec3(0.38, 0.75, 0.38)],
    // Posts of the back
    [dvec3(-0.38, 0.83, -0.38), dvec3(-0.30, 1.60, -0.30)],
    [dvec3(0.30, 0.83, -0.38), dvec3(0.38, 1.60, -0.30)],
    // Slats between them
    [dvec3(-0.30, 0.98, -0.36), dvec3(0.30, 1.10, -0.32)],
    [dvec3(-0.30, 1.20, -0.36), dvec3(0.30, 1.32, -0.32)],
    [dvec3(-0.30, 1.42, -0.36), dvec3(0.30, 1.54, -0.32)],
];
const CENTER: DVec3 = dvec3(0.0, 0.8, 0.0);

pub(crate) fn chair() -> Surface {
    let mut surface = Surface::default();
    for [low, high] in BOXES {
        add_box(&mut surface, low - CENTER, high - CENTER);
    }
    surface
}

fn add_box(surface: &mut Surface, low: DVec3, high: DVec3) {
    let (middle, half) = ((low + high) * 0.5, (high - low) * 0.5);
    for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
        for normal in [axis, -axis] {
            // Two tangents with u × v = normal.
            let u = dvec3(axis.z, axis.x, axis.y);
            let v = normal.cross(u);
            let first = surface.positions.len();
            for (a, b) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
                surface.positions.push(middle + half * (normal + u * a + v * b));
                surface.normals.push(normal);
            }
            surface.add_quad([first, first + 1, first + 2, first + 3]);
        }
    }
}
