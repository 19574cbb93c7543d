//! What measured fields are called in tables, files and reports.

use visfield::distance::{DistanceField, DistancePrecision};
use visfield::field::lookup::Aim;
use visfield::{CapGrid, VisibilityField};

/// The names of what is measured, and its size.
pub(super) struct Names {
    pub(super) representation: String,
    pub(super) size: String,
    pub(super) encoding: String,
    pub(super) bounds: String,
    pub(super) aim: String,
    pub(super) bytes: u64,
}

impl Names {
    /// Of what answers a field's rays: a table, distances, or both, which are then named in this order.
    pub(super) fn of_rays(field: &VisibilityField, aim: Aim) -> Self {
        let (mut representations, mut sizes, mut encodings, mut bytes) = (Vec::new(), Vec::new(), Vec::new(), 0);
        if let Some(table) = field.table() {
            representations.push(table.representation().name());
            sizes.push(table.representation().to_string());
            encodings.push(table.encoding().name());
            bytes += table.format().bytes();
        }
        if let Some(distance) = field.distance_field() {
            representations.push("distance");
            bytes += distance.bytes();
        }
        if let Some(grid) = field.distance_field().and_then(DistanceField::grid) {
            let format = grid.header().format;
            sizes.push(format!("{} voxels", format.voxels));
            encodings.push(precision_name(format.precision));
        }
        let in_bounds = field.table().is_some();
        Self {
            representation: representations.join(" + "),
            size: sizes.join(" + "),
            encoding: encodings.join(" + "),
            bounds: match field.header().bounds.sphere_radius() {
                _ if !in_bounds => "box",
                Some(_) => "sphere",
                None => "ellipsoid",
            }
            .to_owned(),
            aim: match aim {
                _ if !in_bounds => "traced",
                Aim::Plain => "plain",
                Aim::Point => "point",
            }
            .to_owned(),
            bytes,
        }
    }

    pub(super) fn of_cap_grid(grid: &CapGrid) -> Self {
        let format = grid.header().format;
        Self {
            representation: "cap-grid".to_owned(),
            size: format!("{}\u{b3}", format.points),
            encoding: format.precision.name().to_owned(),
            bounds: "box".to_owned(),
            aim: "none".to_owned(),
            bytes: format.bytes(),
        }
    }
}

/// How a distance grid's numbers are stored.
pub(super) fn precision_name(precision: DistancePrecision) -> &'static str {
    match precision {
        DistancePrecision::U8 => "u8",
        DistancePrecision::U16 => "u16",
    }
}
