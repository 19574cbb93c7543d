//! What the paper prints: A. Gaitatzes, A. Andreadis, G. Papaioannou, Y. Chrysanthou, *Fast Approximate Visibility on the GPU using
//! pre-computed 4D Visibility Fields*, WSCG 2010, Figures 3 and 5 to 8, on a `GeForce 8800 GTS`.

/// A table of Figure 3 or 7: `positions` maps of `directions`².
#[derive(Clone, Copy, Debug)]
pub struct PublishedTable {
    /// Number of maps.
    pub positions: u32,
    /// Side of each map.
    pub directions: u32,
    /// Milliseconds for a frame.
    pub milliseconds: f64,
    /// Root of the mean square error against the reference picture, in steps of 255 levels.
    pub rms_255: f64,
}

/// A model of Figure 5.
#[derive(Clone, Copy, Debug)]
pub struct PublishedModel {
    /// Name of the model.
    pub name: &'static str,
    /// Its triangles.
    pub triangles: u32,
    /// Milliseconds for a frame of 121 rays per pixel.
    pub milliseconds: f64,
    /// Rays per second.
    pub rays_per_second: f64,
}

const fn table(positions: u32, directions: u32, milliseconds: f64, rms_255: f64) -> PublishedTable {
    PublishedTable { positions, directions, milliseconds, rms_255 }
}

const fn model(name: &'static str, triangles: u32, milliseconds: f64, mega_rays_per_second: f64) -> PublishedModel {
    PublishedModel { name, triangles, milliseconds, rays_per_second: mega_rays_per_second * 1e6 }
}

/// Ambient occlusion of a bunny's surroundings, 256 rays for each of about 200,000 pixels.
pub const FIGURE3: [PublishedTable; 6] = [
    table(1090, 32, 81.2, 0.595_78),
    table(1090, 64, 82.7, 0.588_86),
    table(1090, 128, 82.9, 0.586_06),
    table(4226, 32, 83.2, 0.453_92),
    table(4226, 64, 83.3, 0.424_04),
    table(16642, 32, 84.2, 0.420_54),
];

/// Ambient occlusion of a model by itself, 16642 maps of 64².
pub const FIGURE5: [PublishedModel; 4] = [
    model("Igea", 67_170, 202.0, 119.80),
    model("Santa", 75_777, 183.0, 132.24),
    model("Elephant", 157_160, 400.0, 60.5),
    model("Super Shape", 261_120, 330.0, 73.33),
];

/// Milliseconds of Figure 6: three models in three passes, 4226 maps of 64².
pub const FIGURE6_MILLISECONDS: f64 = 400.0;

/// Soft shadows by 20 rays of each of 3 lights, against 256.
pub const FIGURE7: [PublishedTable; 5] = [
    table(4226, 32, 348.0, 5.95),
    table(4226, 64, 348.5, 4.82),
    table(4226, 128, 348.7, 4.44),
    table(16642, 32, 348.5, 5.94),
    table(16642, 64, 348.6, 4.80),
];

/// Milliseconds of a shadow ray in Figure 8, by a field and by a bounding volume hierarchy.
pub const FIGURE8_MILLISECONDS_PER_RAY: (f64, f64) = (1.9323e-4, 5.682e-2);

/// The table of a figure with these numbers, if the paper has it.
///
/// ```
/// use visfield_bake::measure::paper2010::published::{FIGURE7, published};
/// assert_eq!(published(&FIGURE7, (4226, 64)).unwrap().rms_255, 4.82);
/// ```
pub fn published(figure: &[PublishedTable], maps: (u32, u32)) -> Option<&PublishedTable> {
    figure.iter().find(|table| (table.positions, table.directions) == maps)
}
