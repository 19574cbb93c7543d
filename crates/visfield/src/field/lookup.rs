//! Which table entry stands for a ray, and where along the ray its fractions lie.

use glam::Vec3;

use super::chord::Chord;
use super::octahedral::{octahedral_cell, octahedral_direction};

/// The sides of a two-point table's grids: `entries`² × `exits`² cells.
///
/// ```
/// use visfield::field::lookup::{TableShape, table_index};
/// let shape = TableShape { entries: 65, exits: 32 };
/// assert_eq!(table_index(shape, 2, 5), 2 * 32 * 32 + 5);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TableShape {
    /// Side of the grid of chord entries.
    pub entries: u32,
    /// Side of the grid of chord exits.
    pub exits: u32,
}

/// One table entry, and the line it is read along: a hit at fraction `s` lies `s · length − before` past the aim point.
///
/// Lengths are in field space (bounding radii).
///
/// ```
/// use glam::vec3;
/// use visfield::field::{chord::chord, lookup::{TableShape, forward_lookup}};
/// let direction = vec3(1.0, 0.0, 0.0);
/// let c = chord(vec3(-3.0, 0.0, 0.0), direction).unwrap();
/// let lookup = forward_lookup(TableShape { entries: 65, exits: 32 }, direction, &c);
/// assert!((lookup.before - 1.0).abs() < 0.05 && (lookup.length - 2.0).abs() < 0.05);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lookup {
    /// Position in the table.
    pub index: u32,
    /// Distance from the start of the stored chord to the aim point.
    pub before: f32,
    /// Length of the stored chord.
    pub length: f32,
}

/// Aims at `aim`, a point of the true ray, from the centre of the cell that contains `start`.
///
/// The snapped start is not on the true ray, so keeping the true exit would shift the whole chord sideways. The papers
/// keep the *direction* instead, a parallel shift; shooting through a point of the ray leaves no error there at all (DESIGN
/// §4, *aimed lookup*). `end` is the true far end of the chord: it serves grazing rays, whose aimed chord would leave the
/// sphere at once.
#[inline]
pub fn aimed_lookup(shape: TableShape, start: Vec3, end: Vec3, aim: Vec3) -> Lookup {
    let entry = octahedral_cell(start, shape.entries);
    let center = octahedral_direction(entry, shape.entries);
    let to_aim = aim - center;
    let inward = -center.dot(to_aim);
    let squared = to_aim.dot(to_aim);
    if inward > GRAZING * squared.sqrt() {
        let stretch = 2.0 * inward / squared;
        let exit = octahedral_cell(center + to_aim * stretch, shape.exits);
        let before = squared.sqrt();
        Lookup { index: table_index(shape, entry, exit), before, length: stretch * before }
    } else {
        let exit = octahedral_cell(end, shape.exits);
        let (before, length) = ((aim - start).length(), (end - start).length());
        Lookup { index: table_index(shape, entry, exit), before, length }
    }
}

/// Sine of the angle to the sphere's surface below which an aimed chord counts as grazing.
const GRAZING: f32 = 1.0e-3;

/// The lookup for the first hit of a ray that starts outside the sphere: aimed at the chord's middle.
#[inline]
pub fn forward_lookup(shape: TableShape, direction: Vec3, chord: &Chord) -> Lookup {
    let half = direction * chord.t_half;
    aimed_lookup(shape, chord.middle - half, chord.middle + half, chord.middle)
}

/// The lookup for the last hit of a ray that starts inside the sphere: the reversed ray, aimed at the origin.
#[inline]
pub fn reversed_lookup(shape: TableShape, origin: Vec3, direction: Vec3, chord: &Chord) -> Lookup {
    let half = direction * chord.t_half;
    aimed_lookup(shape, chord.middle + half, chord.middle - half, origin)
}

/// Position of a chord in the table.
#[inline]
pub fn table_index(shape: TableShape, entry: u32, exit: u32) -> u32 {
    entry * (shape.exits * shape.exits) + exit
}

/// The point at a fraction of the chord that a table position stands for, from cell centre to cell centre.
#[inline]
pub fn point_on_chord(shape: TableShape, index: u32, fraction: f32) -> Vec3 {
    let exit_cells = shape.exits * shape.exits;
    let start = octahedral_direction(index / exit_cells, shape.entries);
    let end = octahedral_direction(index % exit_cells, shape.exits);
    start + (end - start) * fraction
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::chord::chord;
    use glam::vec3;

    const SHAPE: TableShape = TableShape { entries: 65, exits: 32 };

    #[test]
    fn the_aimed_chord_passes_through_the_aim_point() {
        let (origin, direction) = (vec3(-2.0, 0.3, 0.1), vec3(1.0, 0.05, -0.2));
        let c = chord(origin, direction).unwrap();
        let lookup = forward_lookup(SHAPE, direction, &c);
        let start = octahedral_direction(lookup.index / (32 * 32), 65);
        let along = (c.middle - start).normalize();
        assert!((start + along * lookup.before).distance(c.middle) < 1e-6);
        assert!(((start + along * lookup.length).length() - 1.0).abs() < 1e-5);
    }

    #[test]
    fn grazing_rays_stay_in_the_table() {
        for i in 0..1000 {
            let height = 0.99 + 0.01 * (i as f32 / 1000.0);
            let direction = vec3(1.0, 0.0, 0.0);
            if let Some(c) = chord(vec3(-2.0, height, 0.0), direction) {
                let lookup = forward_lookup(SHAPE, direction, &c);
                assert!(lookup.index < 65 * 65 * 32 * 32);
                assert!(lookup.before.is_finite() && lookup.length.is_finite());
            }
        }
    }
}
