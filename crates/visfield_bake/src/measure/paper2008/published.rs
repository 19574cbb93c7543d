//! What the paper prints: A. Gaitatzes, Y. Chrysanthou, G. Papaioannou, *Presampled Visibility for Ambient Occlusion*, WSCG
//! 2008, Figures 6, 7 and 8.

/// A cell of Figure 6: `maps` of `directions`² (concentric), on two Xeons of 3.0 GHz.
#[derive(Clone, Copy, Debug)]
pub struct PublishedCell {
    /// Number of maps: positions on the bounding sphere.
    pub positions: u32,
    /// Side of each map.
    pub directions: u32,
    /// Seconds of pre-processing.
    pub bake_seconds: f64,
    /// Seconds for ambient occlusion, 836,352 rays.
    pub ao_seconds: f64,
    /// Root of the mean square error against the reference picture, in steps of 255 levels.
    pub rms_255: f64,
}

/// A column of Figure 8: 4226 maps of 32², on a Pentium 4 of 3.4 GHz.
#[derive(Clone, Copy, Debug)]
pub struct PublishedModel {
    /// Name of the model.
    pub name: &'static str,
    /// Its triangles.
    pub triangles: u32,
    /// Rays that were cast.
    pub rays: u64,
    /// Seconds for them by ray casting.
    pub exact_seconds: f64,
    /// Seconds of pre-processing.
    pub bake_seconds: f64,
    /// Seconds for the rays by displacement maps.
    pub ao_seconds: f64,
}

const fn cell(positions: u32, directions: u32, bake_seconds: f64, ao_seconds: f64, rms_255: f64) -> PublishedCell {
    PublishedCell { positions, directions, bake_seconds, ao_seconds, rms_255 }
}

/// Figure 6, row by row.
pub const FIGURE6: [PublishedCell; 12] = [
    cell(290, 32, 3.96, 0.09462, 2.8207),
    cell(290, 64, 14.60, 0.09584, 2.4118),
    cell(290, 128, 54.42, 0.09809, 2.3153),
    cell(290, 256, 213.75, 0.10159, 2.2914),
    cell(1090, 32, 14.06, 0.09870, 1.0653),
    cell(1090, 64, 51.23, 0.10219, 1.0318),
    cell(1090, 128, 193.25, 0.10785, 1.0294),
    cell(1090, 256, 772.0, 0.11516, 1.02871),
    cell(4226, 32, 54.79, 0.10826, 0.6772),
    cell(4226, 64, 204.27, 0.11118, 0.6315),
    cell(4226, 128, 925.05, 0.11504, 0.6209),
    cell(4226, 256, 3039.72, 0.12190, 0.6185),
];

/// Figure 7's error: one bit per direction, 4226 maps of 64².
pub const FIGURE7_RMS_255: f64 = 4.4030;

/// Figure 8, column by column; the last one is several objects at once.
pub const FIGURE8: [PublishedModel; 4] = [
    PublishedModel {
        name: "Lemon Tree",
        triangles: 26_300,
        rays: 836_352,
        exact_seconds: 196.20,
        bake_seconds: 99.54,
        ao_seconds: 0.240,
    },
    PublishedModel {
        name: "Bunny",
        triangles: 39_000,
        rays: 836_352,
        exact_seconds: 331.10,
        bake_seconds: 54.79,
        ao_seconds: 0.228,
    },
    PublishedModel {
        name: "Igea",
        triangles: 67_200,
        rays: 836_352,
        exact_seconds: 616.35,
        bake_seconds: 243.76,
        ao_seconds: 0.204,
    },
    PublishedModel {
        name: "Multiple Objects",
        triangles: 142_300,
        rays: 26_444_800,
        exact_seconds: 4286.8,
        bake_seconds: 334.6,
        ao_seconds: 4.692,
    },
];

/// The cell of Figure 6 with these numbers, if the paper has it.
///
/// ```
/// use visfield_bake::measure::paper2008::published::figure6;
/// assert_eq!(figure6(4226, 32).unwrap().rms_255, 0.6772);
/// ```
pub fn figure6(positions: u32, directions: u32) -> Option<&'static PublishedCell> {
    FIGURE6.iter().find(|cell| (cell.positions, cell.directions) == (positions, directions))
}
