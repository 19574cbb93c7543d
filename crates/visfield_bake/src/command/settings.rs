//! Arguments that say what a field stores, shared by the subcommands that bake.

use clap::{Args, ValueEnum};
use visfield::field::MAX_SIDE;
use visfield::field::directions::DirectionMap;
use visfield::{Encoding, Representation, TableFormat};
use visfield_bake::{BakeSettings, BoundsKind};

#[derive(Debug, Args)]
#[command(next_help_heading = "What the field stores")]
pub(super) struct FieldArguments {
    /// How visibility is stored. The paper's own representation is for comparisons: games cannot render it
    #[arg(long, value_enum, default_value_t)]
    representation: RepresentationName,
    /// Two-point: side of the square grid of points at which rays enter the bounds, 1 to 512 cells
    #[arg(long, value_name = "CELLS", default_value_t = 65, value_parser = side())]
    entries: u32,
    /// Two-point: side of the square grid of points at which rays leave the bounds, 1 to 512 cells
    #[arg(long, value_name = "CELLS", default_value_t = 32, value_parser = side())]
    exits: u32,
    /// Hemisphere: number of positions on the bounds: 290, 1090, 4226, 16642, or another (2n + 1)² + 1
    #[arg(long, value_name = "COUNT", default_value_t = 4226)]
    positions: u32,
    /// Hemisphere: side of the square map of directions at each position, 1 to 512 cells
    #[arg(long, value_name = "CELLS", default_value_t = 32, value_parser = side())]
    directions: u32,
    /// Hemisphere: how directions are laid out in their map
    #[arg(long, value_enum, default_value_t)]
    map: MapName,
    /// How each ray's answer is stored: bits say whether it hits, the others where
    #[arg(long, value_enum, default_value_t)]
    encoding: EncodingName,
    /// What surrounds the mesh: an ellipsoid fits long and flat meshes better
    #[arg(long, value_enum, default_value_t)]
    bounds: BoundsName,
}

fn side() -> clap::builder::RangedI64ValueParser<u32> {
    clap::value_parser!(u32).range(1..=i64::from(MAX_SIDE))
}

#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum RepresentationName {
    /// Both ends of a ray on octahedral grids
    #[default]
    TwoPoint,
    /// The paper's positions and directions
    Hemisphere,
}

#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum MapName {
    #[default]
    Concentric,
    Polar,
    Uniform,
    Rejection,
}

#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum EncodingName {
    Bit,
    #[default]
    U8,
    U16,
    F32,
}

#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum BoundsName {
    #[default]
    Sphere,
    Ellipsoid,
}

impl FieldArguments {
    pub(super) fn settings(&self) -> BakeSettings {
        let representation = match self.representation {
            RepresentationName::TwoPoint => Representation::TwoPoint { entries: self.entries, exits: self.exits },
            RepresentationName::Hemisphere => Representation::Hemisphere {
                positions: self.positions,
                directions: self.directions,
                map: match self.map {
                    MapName::Concentric => DirectionMap::Concentric,
                    MapName::Polar => DirectionMap::Polar,
                    MapName::Uniform => DirectionMap::Uniform,
                    MapName::Rejection => DirectionMap::Rejection,
                },
            },
        };
        let encoding = match self.encoding {
            EncodingName::Bit => Encoding::Bit,
            EncodingName::U8 => Encoding::U8,
            EncodingName::U16 => Encoding::U16,
            EncodingName::F32 => Encoding::F32,
        };
        let bounds = match self.bounds {
            BoundsName::Sphere => BoundsKind::Sphere,
            BoundsName::Ellipsoid => BoundsKind::Ellipsoid,
        };
        BakeSettings::of_table(TableFormat { representation, encoding }, bounds)
    }
}
