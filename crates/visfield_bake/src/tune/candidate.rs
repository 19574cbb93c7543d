//! What can be tried.

use glam::DVec3;
use visfield::distance::{DistanceGridFormat, DistancePrecision};
use visfield::{Encoding, Representation, TableFormat};

use super::{TuneQuestion, TuneReceivers};
use crate::bake::BakeSettings;
use crate::bounds::BoundsKind;
use crate::distance::header_around;

/// Sides of the grids of entries and exits that are tried, at ratios of 1:1 and 2:1. Odd sides of the entries put cell
/// centres on the axes. The largest is 68 MB in bytes, half of the buffer that WebGPU guarantees for all tables together.
const SIDES: [(u32, u32); 11] =
    [(17, 16), (33, 16), (25, 24), (49, 24), (33, 32), (41, 40), (65, 32), (49, 48), (65, 64), (97, 48), (129, 64)];
/// What the sides are combined with.
const FAMILIES: [(Encoding, BoundsKind); 4] = [
    (Encoding::Bit, BoundsKind::Sphere),
    (Encoding::Bit, BoundsKind::Ellipsoid),
    (Encoding::U8, BoundsKind::Sphere),
    (Encoding::U8, BoundsKind::Ellipsoid),
];
/// Points along the longest axis of the distances that are tried, of a byte each.
const VOXELS: [u32; 6] = [24, 32, 48, 64, 96, 128];

/// A field that can be tried: a table, distances, or both.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Candidate {
    pub(super) table: Option<Table>,
    /// Points along the longest axis of its distances.
    pub(super) voxels: Option<u32>,
    pub(super) bytes: u64,
}

/// A table, and the bounds that it needs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Table {
    pub(super) sides: (u32, u32),
    pub(super) encoding: Encoding,
    pub(super) bounds: BoundsKind,
}

/// All candidates, from small to large.
pub(super) fn candidates(triangles: &[[DVec3; 3]], question: &TuneQuestion) -> Vec<Candidate> {
    let tables: Vec<Table> = if question.tables {
        let of_size = |sides| FAMILIES.map(|(encoding, bounds)| Table { sides, encoding, bounds });
        SIDES.into_iter().flat_map(of_size).collect()
    } else {
        Vec::new()
    };
    let distances: Vec<(u32, u64)> = if question.distances {
        VOXELS.map(|voxels| (voxels, header_around(triangles, distance_format(voxels)).bytes())).to_vec()
    } else {
        Vec::new()
    };
    let mut all: Vec<Candidate> =
        tables.iter().map(|&table| Candidate { table: Some(table), voxels: None, bytes: table.bytes() }).collect();
    all.extend(distances.iter().map(|&(voxels, bytes)| Candidate { table: None, voxels: Some(voxels), bytes }));
    // From far away, distances beside a table are never asked.
    if question.receivers != TuneReceivers::Far {
        let beside = |&table: &Table| {
            let both = move |&(voxels, bytes): &(u32, u64)| Candidate {
                table: Some(table),
                voxels: Some(voxels),
                bytes: table.bytes() + bytes,
            };
            distances.iter().map(both)
        };
        all.extend(tables.iter().flat_map(beside));
    }
    all.sort_by_key(|candidate| candidate.bytes);
    all
}

/// Distances that are tried.
pub(super) fn distance_format(voxels: u32) -> DistanceGridFormat {
    DistanceGridFormat { voxels, precision: DistancePrecision::U8 }
}

impl Table {
    fn bytes(&self) -> u64 {
        let (entries, exits) = self.sides;
        self.encoding.table_bytes(u64::from(entries).pow(2), u64::from(exits).pow(2))
    }

    fn format(&self) -> TableFormat {
        let (entries, exits) = self.sides;
        TableFormat { representation: Representation::TwoPoint { entries, exits }, encoding: self.encoding }
    }

    pub(super) fn settings(&self) -> BakeSettings {
        BakeSettings::of_table(self.format(), self.bounds)
    }
}

impl Candidate {
    pub(super) fn settings(&self) -> BakeSettings {
        BakeSettings {
            bounds: self.table.map_or(BoundsKind::Sphere, |table| table.bounds),
            table: self.table.map(|table| table.format()),
            cap_grid: None,
            distance: self.voxels.map(distance_format),
        }
    }

    /// What candidates are alike in that differ in their sizes alone: encoding and bounds of the table, and whether there are distances.
    pub(super) fn family(&self) -> (Option<(Encoding, BoundsKind)>, bool) {
        (self.table.map(|table| (table.encoding, table.bounds)), self.voxels.is_some())
    }

    /// Whether this is of the other's family, and nowhere coarser.
    pub(super) fn refines(&self, other: &Self) -> bool {
        let sides = |of: &Self| of.table.map_or((0, 0), |table| table.sides);
        let ((entries, exits), coarser) = (sides(self), sides(other));
        self.family() == other.family()
            && entries >= coarser.0
            && exits >= coarser.1
            && self.voxels.unwrap_or(0) >= other.voxels.unwrap_or(0)
    }

    /// The least share of its error that can be hoped to be left of a field that this [refines](Self::refines). Errors of distances may
    /// fall at once, when a voxel becomes as small as what is thin: of finer ones anything may be hoped.
    pub(super) fn least_hope(&self, coarser: &Self) -> f32 {
        let chords = |of: &Self| of.table.map_or(1.0, |table| table.format().chords() as f32);
        if self.voxels == coarser.voxels { (chords(coarser) / chords(self)).sqrt() } else { 0.0 }
    }
}
