//! Distances, signs and fits on closed forms, odd soups and real meshes.

use std::path::PathBuf;
use std::time::Instant;

use glam::dvec3;

use super::*;
use crate::mesh::Mesh;

/// A real mesh, or `None` where it is not at hand. Never skips on the project's own checks.
fn shared_mesh(name: &str) -> Option<Mesh> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/meshes").join(name);
    if path.exists() {
        return crate::read_meshes(&path).unwrap().into_iter().next();
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

#[test]
fn timing() {
    for name in ["stanford-bunny.obj", "cow.obj"] {
        let Some(mesh) = shared_mesh(name) else { return };
        let triangles = mesh.solid_triangles().unwrap();
        let grid = GridPoints { points: [64; 3], ..around(&triangles, 64, 2.0) };
        let clock = Instant::now();
        let surface = Surface::new(&grid.in_voxels(&triangles));
        println!("{name}: {} triangles, BVH {:?}", triangles.len(), clock.elapsed());
        let clock = Instant::now();
        let mut distances = surface.lattice_distances(grid.points, |_| ());
        println!("distances {:?}", clock.elapsed());
        let clock = Instant::now();
        let windings = WindingNumbers::new(&surface);
        println!("dipoles {:?}", clock.elapsed());
        let clock = Instant::now();
        let asked = std::sync::atomic::AtomicU32::new(0);
        apply_signs(&mut distances, grid.points, |place| {
            asked.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
            windings.at(Vec3::from(place.map(|x| x as f32))).abs() >= 0.5
        });
        let inside = distances.iter().filter(|d| **d < 0.0).count();
        println!(
            "signs {:?}, asked {asked:?}, inside {inside} {:?}",
            clock.elapsed(),
            distances.iter().copied().fold(0.0, f32::min)
        );
        let clock = Instant::now();
        let lowered = fit_to_surface(&mut distances, &grid, &triangles, 0.05);
        println!("fit {:?}: {lowered:?}", clock.elapsed());
    }
    let _ = dvec3(0.0, 0.0, 0.0);
}
