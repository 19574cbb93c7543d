//! `visfield inspect`: what a `.vfield` file holds.

use std::fmt::Write;
use std::fs;
use std::path::PathBuf;

use clap::Args;
use indicatif::{DecimalBytes, HumanCount};
use visfield::distance::{DistanceField, DistanceGridHeader};
use visfield::field::cap_grid::{CapGridError, Falloff, HarmonicOrder};
use visfield::field::lookup::ChordGrid;
use visfield::field::measured::{Measured, MeasuredScene, Purpose};
use visfield::{BoundingEllipsoid, CapGrid, ChordTable, Encoding, Representation, VisibilityField, file};

use super::CommandError;

/// Show what a .vfield file holds: sizes, bounds in mesh units, how many chords of the table meet the mesh, what the cap grid
/// and the distances store, and what was measured when they were baked or tuned.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  visfield inspect assets/meshes/chair.vfield")]
pub(super) struct Arguments {
    /// The .vfield file
    field: PathBuf,
}

impl Arguments {
    pub(super) fn run(&self) -> Result<String, CommandError> {
        let fields = file::read(&self.field).map_err(CommandError::Inspect)?;
        let size = fs::metadata(&self.field).map_or(0, |metadata| metadata.len());
        let in_memory: u64 = fields.iter().map(VisibilityField::bytes).sum();
        let mut report = String::new();
        _ = writeln!(
            report,
            "{}: format version {}, {} field{}, {} compressed, {} in memory",
            self.field.display(),
            file::VERSION,
            fields.len(),
            if fields.len() == 1 { "" } else { "s" },
            DecimalBytes(size),
            DecimalBytes(in_memory),
        );
        for field in &fields {
            report_field(&mut report, field);
        }
        Ok(report)
    }
}

fn report_field(report: &mut String, field: &VisibilityField) {
    let header = field.header();
    _ = writeln!(report, "\n{}", header.name);
    _ = writeln!(report, "  bounds           {} in mesh units", bounds(&header.bounds));
    _ = writeln!(report, "  triangles        {}", HumanCount(header.triangles.into()));
    if let Some(table) = field.table() {
        report_table(report, table);
    }
    if let Some(grid) = field.cap_grid() {
        report_cap_grid(report, grid);
    }
    if let Some(distance) = field.distance_field() {
        report_distance(report, distance);
    }
    if field.table().is_some() && field.distance_field().is_some() {
        let answers = "composite: the table for those from outside the bounds, distances for those from inside";
        _ = writeln!(report, "  rays             {answers}");
    }
    for (i, measured) in header.measured.iter().enumerate() {
        let label = if i == 0 { "measured" } else { "" };
        _ = writeln!(report, "  {label:<15}  {}", measured_line(measured));
    }
}

fn report_table(report: &mut String, table: &ChordTable) {
    let representation = match table.representation() {
        Representation::TwoPoint { entries, exits } => {
            format!("two-point, {entries}\u{b2} entries \u{d7} {exits}\u{b2} exits")
        }
        Representation::Hemisphere { positions, directions, map } => {
            format!("hemisphere, {positions} positions \u{d7} {directions}\u{b2} directions, {map:?} map")
        }
        other => format!("{other:?}"),
    };
    let encoding = match table.encoding() {
        Encoding::Bit => "bit, whether a chord hits anything; distances are means".to_owned(),
        Encoding::U8 => "u8, first hit as a fraction of the chord in steps of 1/254".to_owned(),
        Encoding::U16 => "u16, first hit as a fraction of the chord in steps of 1/65534".to_owned(),
        Encoding::F32 => "f32, first hit as a fraction of the chord".to_owned(),
        other => format!("{other:?}"),
    };
    let (codes, chords) = (table.codes(), table.grid().starts() * table.grid().chords_per_start());
    let hits = (0..chords).filter(|&index| codes.fraction(index).is_some()).count();
    let share = 100.0 * hits as f64 / f64::from(chords);
    _ = writeln!(report, "  representation   {representation}");
    _ = writeln!(report, "  encoding         {encoding}");
    _ = writeln!(report, "  table            {} bytes", HumanCount(table.format().bytes()));
    _ = writeln!(report, "  chords that hit  {share:.1} %");
}

fn report_cap_grid(report: &mut String, grid: &CapGrid) {
    let format = grid.header().format;
    let order = match format.order {
        HarmonicOrder::One => "harmonics of order 1",
        HarmonicOrder::Three => "harmonics of order 3, for large lights too",
    };
    let falloff = match format.falloff {
        Falloff::None => "none: a surface counts at any distance".to_owned(),
        Falloff::Exponential { tau } => format!("exponential, e^(\u{2212}{tau}\u{b7}distance), distance in mesh units"),
        Falloff::Linear { distance } => format!("linear, to nothing at {distance} mesh units"),
    };
    let bytes = HumanCount(format.bytes());
    _ = writeln!(
        report,
        "  cap grid         {}\u{b3} points, {order}, {}, {bytes} bytes",
        format.points,
        format.precision.name()
    );
    _ = writeln!(report, "  falloff          {falloff}");
    if let Some(error) = cap_grid_error(grid) {
        let mark = if grid.serves_inside() { "serves receivers inside it" } else { "not for receivers inside it" };
        _ = writeln!(report, "  its errors       {error}: {mark}");
    }
}

fn report_distance(report: &mut String, distance: &DistanceField) {
    let Some(grid) = distance.grid() else { return };
    let header = grid.header();
    let [x, y, z] = header.points;
    let bits = 8 * header.format.precision.bytes();
    let bytes = HumanCount(header.bytes());
    _ = writeln!(report, "  distances        {x} \u{d7} {y} \u{d7} {z} points, {bits} bits each, {bytes} bytes");
    _ = writeln!(report, "  voxel            {} mesh units", header.voxel);
    _ = writeln!(report, "  range            {:.2} to {:.2} voxels", header.low, header.low + header.range);
    _ = writeln!(report, "  excess           {}", distance_excess(header));
}

/// How far a grid's distances may be wrong at the surface, in words.
pub(super) fn distance_excess(header: &DistanceGridHeader) -> String {
    format!("at the surface at most {:.3} voxels too far", header.excess)
}

/// What a cap grid was found to get wrong, in words, if it was measured.
pub(super) fn cap_grid_error(grid: &CapGrid) -> Option<String> {
    let CapGridError { outside, inside } = grid.header().error?;
    Some(format!("mean error {outside:.4} around it, {inside:.3} inside its box"))
}

/// One measurement in words.
pub(super) fn measured_line(measured: &Measured) -> String {
    let purpose = match measured.purpose {
        Purpose::Ao { max_distance: None } => "ao".to_owned(),
        Purpose::Ao { max_distance: Some(distance) } => format!("ao up to {distance} mesh units"),
        Purpose::Shadows { angular_radius } => format!("shadows, a light of {angular_radius} rad"),
        other => other.to_string(),
    };
    let scene = match measured.scene {
        MeasuredScene::Corner => "on floor and walls around it",
        MeasuredScene::CornerFar => "on floor and walls outside its bounds",
        MeasuredScene::OwnSurface => "on its own surface",
        other => return format!("{purpose}, {other}: RMS {:.2}/255", measured.rms_255),
    };
    format!(
        "{purpose}, {scene}: RMS {:.2}/255, mean error {:.4}, {} rays",
        measured.rms_255, measured.mean_abs, measured.rays
    )
}

fn bounds(bounds: &BoundingEllipsoid) -> String {
    let [x, y, z] = bounds.center;
    if let Some(radius) = bounds.sphere_radius() {
        return format!("sphere, centre ({x}, {y}, {z}), radius {radius}");
    }
    let axes = bounds.mesh_from_field().matrix3;
    let [a, b, c] = [0, 1, 2].map(|i| axes.row(i).length());
    format!("ellipsoid, centre ({x}, {y}, {z}), extent \u{b1}({a:.6}, {b:.6}, {c:.6})")
}
