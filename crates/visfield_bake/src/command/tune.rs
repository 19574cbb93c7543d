//! Arguments that say what a field has to be good for, in place of what it stores.

use bytesize::ByteSize;
use clap::{ArgGroup, Args, ValueEnum};
use visfield_bake::BakeSettings;
use visfield_bake::tune::{TuneQuestion, TuneReceivers, WORST_RMS};

#[derive(Debug, Args)]
#[command(
    next_help_heading = "Tuning: the cheapest table or distances, or both, that are good enough",
    group = ArgGroup::new("limits").args(["max_rms", "max_bytes"]).multiple(true).conflicts_with_all(["TableArguments", "DistanceArguments", "bounds"])
)]
pub(super) struct TuneArguments {
    /// Largest error of occlusion, as measured with this mesh: RMS in steps of 1/255, 0 to 255. Holds for the worst of what is
    /// required. Typical are 1 to 2 for ambient occlusion around the mesh and 4 on the mesh itself. Shadows count in their
    /// penumbra alone: 20 to 50 around the mesh, about 100 on it
    #[arg(long, value_name = "RMS", value_parser = rms, allow_negative_numbers = true)]
    max_rms: Option<f32>,
    /// Largest table and distances in memory together: a number of bytes, or with a unit, as 500kB, 1.2MB or 4MiB
    #[arg(long, value_name = "BYTES", allow_hyphen_values = true)]
    max_bytes: Option<ByteSize>,
    /// What the field is for: ao, shadows, or both as ao,shadows. What is left out costs nothing
    #[arg(
        long = "for",
        value_name = "PURPOSES",
        value_enum,
        value_delimiter = ',',
        default_value = "ao",
        requires = "limits"
    )]
    purposes: Vec<PurposeName>,
    /// Where occlusion and shadows of this mesh fall. What does not fall on the mesh itself needs far smaller tables, of bits;
    /// but bits alone know no distances, and such a mesh looks black where it receives occlusion in a game itself
    #[arg(long, value_enum, default_value_t, requires = "limits")]
    receivers: ReceiversName,
    /// Reach of ambient occlusion in the game, in the mesh's units [default: unlimited]
    #[arg(
        long,
        value_name = "DISTANCE",
        value_parser = distance,
        allow_negative_numbers = true,
        requires = "limits"
    )]
    max_distance: Option<f32>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum PurposeName {
    /// Ambient occlusion
    Ao,
    /// Soft shadows of directional lights
    Shadows,
}

#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum ReceiversName {
    /// Anywhere, the mesh itself included
    #[default]
    All,
    /// Anything but the mesh itself, however near
    Others,
    /// Only what is outside the mesh's bounding sphere and ellipsoid
    Far,
}

fn rms(text: &str) -> Result<f32, String> {
    let value: f32 = text.parse().map_err(|_| "this is not a number".to_owned())?;
    if (0.0..=WORST_RMS).contains(&value) { Ok(value) } else { Err(format!("it has to be 0 to {WORST_RMS}")) }
}

fn distance(text: &str) -> Result<f32, String> {
    let value: f32 = text.parse().map_err(|_| "this is not a number".to_owned())?;
    if value > 0.0 { Ok(value) } else { Err("it has to be above 0".to_owned()) }
}

impl TuneArguments {
    /// What is asked for, of those parts that the settings have; `None` without a limit.
    pub(super) fn question(&self, settings: &BakeSettings) -> Option<TuneQuestion> {
        (self.max_rms.is_some() || self.max_bytes.is_some()).then(|| TuneQuestion {
            max_rms: self.max_rms,
            max_bytes: self.max_bytes.map(|bytes| bytes.as_u64()),
            ambient: self.purposes.contains(&PurposeName::Ao),
            shadows: self.purposes.contains(&PurposeName::Shadows),
            receivers: match self.receivers {
                ReceiversName::All => TuneReceivers::All,
                ReceiversName::Others => TuneReceivers::Others,
                ReceiversName::Far => TuneReceivers::Far,
            },
            max_distance: self.max_distance.unwrap_or(f32::INFINITY),
            tables: settings.table.is_some(),
            distances: settings.distance.is_some(),
        })
    }
}
