//! Arguments that say what a field stores, shared by the subcommands that bake.

use clap::error::ErrorKind;
use clap::parser::ValueSource;
use clap::{Arg, ArgAction, ArgMatches, Args, Command, FromArgMatches, Id, ValueEnum};
use visfield::field::MAX_SIDE;
use visfield::field::cap_grid::{CapPrecision, Falloff, HarmonicOrder, MAX_POINTS, MIN_POINTS};
use visfield::field::directions::DirectionMap;
use visfield::{CapGridFormat, Encoding, Representation, TableFormat};
use visfield_bake::{BakeSettings, BoundsKind};

/// What a field stores. Checked on parsing: options of a part that is not asked for are usage errors, not ignored.
#[derive(Debug)]
pub(super) struct FieldArguments(FieldOptions);

#[derive(Debug, Args)]
#[command(next_help_heading = "What the field stores")]
struct FieldOptions {
    /// What the field holds, as a list: one table at most, and a cap grid or none
    #[arg(long, value_name = "PARTS", value_enum, value_delimiter = ',', default_value = "two-point,cap-grid")]
    representation: Vec<RepresentationName>,
    #[command(flatten)]
    table: TableArguments,
    #[command(flatten)]
    cap_grid: CapGridArguments,
    /// What surrounds the mesh: an ellipsoid fits long and flat meshes better
    #[arg(long, value_enum, default_value_t)]
    bounds: BoundsName,
}

#[derive(Debug, Args)]
struct TableArguments {
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
    /// Tables: how each ray's answer is stored: bits say whether it hits, the others where
    #[arg(long, value_enum, default_value_t)]
    encoding: EncodingName,
}

#[derive(Debug, Args)]
struct CapGridArguments {
    /// Cap grid: points along each axis, 4 to 64
    #[arg(long, value_name = "COUNT", default_value_t = CapGridFormat::DEFAULT.points, value_parser = points())]
    points: u32,
    /// Cap grid: harmonic order; 3 for soft shadows of large lights, 4 × the bytes
    #[arg(long, value_enum, default_value_t)]
    order: OrderName,
    /// Cap grid: how much a surface at a distance counts: none, exponential=TAU for e^(−TAU·distance), or linear=DISTANCE for
    /// a fade that ends there. In mesh units; DISTANCE and 1/TAU well below the mesh's own radius are coarse
    #[arg(long, value_name = "FALLOFF", default_value = "none", value_parser = falloff)]
    falloff: Falloff,
    /// Cap grid: how its numbers are stored
    #[arg(long, value_enum, default_value_t)]
    precision: PrecisionName,
}

/// The side of a table's grid.
pub(super) fn side() -> clap::builder::RangedI64ValueParser<u32> {
    clap::value_parser!(u32).range(1..=i64::from(MAX_SIDE))
}

/// Points of a cap grid along an axis.
pub(super) fn points() -> clap::builder::RangedI64ValueParser<u32> {
    clap::value_parser!(u32).range(i64::from(MIN_POINTS)..=i64::from(MAX_POINTS))
}

fn falloff(text: &str) -> Result<Falloff, String> {
    let number = |text: &str, what: &str| match text.parse::<f32>() {
        Ok(number) if number.is_finite() && number > 0.0 => Ok(number),
        Ok(_) => Err(format!("the {what} has to be finite and above 0")),
        Err(_) => Err(format!("the {what} {text:?} is not a number")),
    };
    match text.split_once('=') {
        None if text == "none" => Ok(Falloff::None),
        Some(("exponential", tau)) => Ok(Falloff::Exponential { tau: number(tau, "rate per mesh unit")? }),
        Some(("linear", distance)) => Ok(Falloff::Linear { distance: number(distance, "distance")? }),
        _ => Err("it has to be none, exponential=TAU or linear=DISTANCE".to_owned()),
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum RepresentationName {
    /// A table for rays: both ends of a ray on octahedral grids
    TwoPoint,
    /// The 2008 paper's table of positions and directions, for comparisons: games cannot render it
    Hemisphere,
    /// A small grid that answers ambient occlusion without rays
    CapGrid,
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

#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum OrderName {
    #[default]
    #[value(name = "1")]
    One,
    #[value(name = "3")]
    Three,
}

#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum PrecisionName {
    /// A byte each
    #[default]
    Rgba8,
    /// 16-bit floating point
    Rgba16f,
}

/// Changes `--representation` for what measures one part at a time.
pub(super) fn one_representation(arg: Arg) -> Arg {
    let one = arg.value_name("PART").value_delimiter(None).action(ArgAction::Set);
    one.default_value("two-point").help("What is measured, with its defaults if no more is said")
}

impl FieldArguments {
    pub(super) fn settings(&self) -> BakeSettings {
        let FieldOptions { representation, table, cap_grid, bounds } = &self.0;
        let bounds = match bounds {
            BoundsName::Sphere => BoundsKind::Sphere,
            BoundsName::Ellipsoid => BoundsKind::Ellipsoid,
        };
        BakeSettings {
            bounds,
            table: representation.iter().find_map(|&name| table.format(name)),
            cap_grid: representation.contains(&RepresentationName::CapGrid).then(|| cap_grid.format()),
            distance: None,
        }
    }
}

impl TableArguments {
    /// The format of a table; `None` for what is no table.
    fn format(&self, name: RepresentationName) -> Option<TableFormat> {
        let representation = match name {
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
            RepresentationName::CapGrid => return None,
        };
        let encoding = match self.encoding {
            EncodingName::Bit => Encoding::Bit,
            EncodingName::U8 => Encoding::U8,
            EncodingName::U16 => Encoding::U16,
            EncodingName::F32 => Encoding::F32,
        };
        Some(TableFormat { representation, encoding })
    }
}

impl CapGridArguments {
    fn format(&self) -> CapGridFormat {
        CapGridFormat {
            points: self.points,
            order: match self.order {
                OrderName::One => HarmonicOrder::One,
                OrderName::Three => HarmonicOrder::Three,
            },
            precision: match self.precision {
                PrecisionName::Rgba8 => CapPrecision::U8,
                PrecisionName::Rgba16f => CapPrecision::F16,
            },
            falloff: self.falloff,
        }
    }
}

/// Refuses combinations of which a part would be ignored.
fn check(matches: &ArgMatches) -> Result<(), clap::Error> {
    let names: Vec<RepresentationName> = matches.get_many("representation").into_iter().flatten().copied().collect();
    let two_point = names.contains(&RepresentationName::TwoPoint);
    let hemisphere = names.contains(&RepresentationName::Hemisphere);
    let conflict = |message: String| Err(clap::Error::raw(ErrorKind::ArgumentConflict, message));
    // clap counts only what stands on the command line as present in a group; absent groups are no group of the command.
    let given = |group: &str| {
        let mut ids = matches.try_get_many::<Id>(group).ok().flatten().into_iter().flatten();
        ids.next().map(|id| format!("--{}", id.as_str().replace('_', "-")))
    };
    let mut parts = names.iter().enumerate();
    if let Some((_, twice)) = parts.find(|&(index, name)| names[..index].contains(name)) {
        let name = twice.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned());
        return conflict(format!("--representation names {name} twice: a field holds one; name it once"));
    }
    if two_point && hemisphere {
        return conflict("a field holds one table: choose two-point or hemisphere for --representation".to_owned());
    }
    if let Some(option) = given("TableArguments").filter(|_| !two_point && !hemisphere) {
        return conflict(format!("{option} is for tables: add two-point to --representation, or leave it out"));
    }
    let on_command_line = |id: &&str| matches.value_source(id) == Some(ValueSource::CommandLine);
    for (ids, name, asked) in [
        (&["entries", "exits"][..], "two-point", two_point),
        (&["positions", "directions", "map"], "hemisphere", hemisphere),
    ] {
        if let Some(option) = ids.iter().copied().find(on_command_line).filter(|_| !asked) {
            return conflict(format!(
                "--{option} is for {name} tables: choose {name} for --representation, or leave it out"
            ));
        }
    }
    if let Some(option) = given("CapGridArguments").filter(|_| !names.contains(&RepresentationName::CapGrid)) {
        return conflict(format!("{option} is for cap grids: add cap-grid to --representation, or leave it out"));
    }
    if let Some(option) = given("limits").filter(|_| !two_point) {
        return conflict(format!(
            "{option} chooses a two-point table: add two-point to --representation, or leave it out"
        ));
    }
    Ok(())
}

impl FromArgMatches for FieldArguments {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        check(matches)?;
        FieldOptions::from_arg_matches(matches).map(Self)
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        check(matches)?;
        self.0.update_from_arg_matches(matches)
    }
}

impl Args for FieldArguments {
    fn augment_args(command: Command) -> Command {
        FieldOptions::augment_args(command)
    }

    fn augment_args_for_update(command: Command) -> Command {
        FieldOptions::augment_args_for_update(command)
    }
}
