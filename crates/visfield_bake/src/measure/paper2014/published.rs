//! What the paper prints: B. Keinert, H. Schäfer, J. Korndörfer, U. Ganse, M. Stamminger, *Enhanced Sphere Tracing*, STAG 2014, §4,
//! on a `GeForce GTX Titan`, 1280 × 720 pixels, at most 80 steps.

/// Milliseconds of a frame without a technique and with it.
#[derive(Clone, Copy, Debug)]
pub struct PublishedTimes {
    /// What is drawn.
    pub name: &'static str,
    /// Without.
    pub without: f64,
    /// With.
    pub with: f64,
}

impl PublishedTimes {
    /// How many times as fast.
    ///
    /// ```
    /// use visfield_bake::measure::paper2014::published::CITY;
    /// assert!((CITY.speedup() - 1.21).abs() < 0.01);
    /// ```
    pub fn speedup(&self) -> f64 {
        self.without / self.with
    }
}

/// Rays cast into the city, by over-relaxation.
pub const CITY: PublishedTimes = PublishedTimes { name: "city, over-relaxation", without: 20.409, with: 16.829 };
/// Rays cast into the jewel, by over-relaxation.
pub const JEWEL: PublishedTimes = PublishedTimes { name: "jewel, over-relaxation", without: 3.472, with: 2.978 };
/// The jewel with two reflections, eight refractions and three steps of discontinuity reduction.
pub const JEWEL_LIT: PublishedTimes = PublishedTimes { name: "jewel, lit", without: 22.470, with: 21.11 };
/// Paths of ten bounces, with ω = 1.4.
pub const PATHS: PublishedTimes =
    PublishedTimes { name: "path tracer, \u{3c9} = 1.4", without: 118.302, with: 101.934 };
/// A dodecahedron of glass, by the optimization for convex objects.
pub const DODECAHEDRON: PublishedTimes = PublishedTimes { name: "dodecahedron, convex", without: 3.03, with: 2.73 };

/// The ω that was best in the paper's scenes.
pub const RELAXATION: f32 = 1.2;
/// Most steps of a ray in its measurements.
pub const MAX_STEPS: u32 = 80;
/// Width and height of its pictures in pixels.
pub const PICTURE: (u32, u32) = (1280, 720);
/// Steps of discontinuity reduction that it calls sufficient.
pub const SMOOTHING: u32 = 3;
