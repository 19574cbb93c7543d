//! What one object hides, as seen from one point: a few spherical harmonics, and the spherical cap that they imply.

use glam::{Mat3, Vec3, Vec4};

use super::harmonics::{self, MAX_COEFFICIENTS, disc_mean};

/// The harmonic of band 0: 1/√4π.
pub const Y0: f32 = 0.282_094_8;
/// The factor of the harmonics of band 1, whose values are this times x, y and z: √(3/4π).
pub const Y1: f32 = 0.488_602_5;
/// Solid angle in steradians below which nothing is there.
const SMALLEST_SOLID_ANGLE: f32 = 1.0e-6;
/// Occlusion up to which an object does not count; from there to twice as much it fades in, so that nothing pops. An eighth of
/// a step of an 8-bit picture: among many objects, a whole step each is missed.
pub const CUTOFF: f32 = 1.0 / 2040.0;
/// Height above a surface, in bounding radii, up to which the contact term reaches.
pub const CONTACT_REACH: f32 = 0.06;

/// A spherical cap of directions, evenly occluded.
///
/// ```
/// use glam::{Vec3, Vec4, vec4};
/// use visfield::field::cap_grid::cap::Cap;
/// // An eighth of all directions, around +y.
/// let eighth = Cap { axis: Vec3::Y, cosine: 0.75, opacity: 1.0 };
/// let again = Cap::new(eighth.harmonics());
/// assert!((again.cosine - 0.75).abs() < 1e-5 && (again.opacity - 1.0).abs() < 1e-5);
/// assert_eq!(Cap::new(Vec4::ZERO).opacity, 0.0);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cap {
    /// Unit vector to its middle.
    pub axis: Vec3,
    /// Cosine of its half-angle, −1 to 1.
    pub cosine: f32,
    /// Which share of it is occluded, 0 to 1.
    pub opacity: f32,
}

impl Cap {
    /// The cap that has the given harmonics of bands 0 and 1: (O₀₀, O₁ along x, y, z). Where they are of no cap, the one of
    /// the same solid angle.
    #[inline(always)]
    pub fn new(harmonics: Vec4) -> Self {
        let (o0, o1) = (harmonics.x, Vec3::new(harmonics.y, harmonics.z, harmonics.w));
        let length = o1.dot(o1).sqrt();
        let solid_angle = o0 * (1.0 / Y0);
        let full_turn = std::f32::consts::TAU;
        let present = solid_angle > SMALLEST_SOLID_ANGLE;
        let solid_angle = if present { solid_angle.min(2.0 * full_turn) } else { SMALLEST_SOLID_ANGLE };
        // The mean of the cosine to the axis over a cap of half-angle α is (1 + cos α)/2.
        let mean_cosine = (length * (1.0 / Y1) / solid_angle).min(1.0);
        let cosine = 2.0 * mean_cosine - 1.0;
        let area = full_turn * (1.0 - cosine);
        let fits = area > solid_angle;
        Self {
            axis: o1 * (1.0 / length.max(f32::MIN_POSITIVE)),
            cosine: if fits { cosine } else { 1.0 - solid_angle / full_turn },
            opacity: if present { if fits { solid_angle / area } else { 1.0 } } else { 0.0 },
        }
    }

    /// The harmonics of bands 0 and 1 that it has.
    pub fn harmonics(&self) -> Vec4 {
        let solid_angle = self.opacity * std::f32::consts::TAU * (1.0 - self.cosine);
        let o1 = self.axis * (Y1 * solid_angle * 0.5 * (1.0 + self.cosine));
        Vec4::new(Y0 * solid_angle, o1.x, o1.y, o1.z)
    }

    /// How much of a round light it hides, 0 to 1: a disc of the sky around `axis`, a unit vector, with a half-angle in radians.
    /// The overlap of two caps with a smooth edge, as Oat & Sander have it (*Ambient Aperture Lighting*, 2007).
    pub fn light_occlusion(&self, axis: Vec3, half_angle: f32) -> f32 {
        let (own, between) = (self.cosine.clamp(-1.0, 1.0).acos(), self.axis.dot(axis).clamp(-1.0, 1.0).acos());
        let light_depth = (1.0 - half_angle.cos()).max(f32::MIN_POSITIVE);
        let largest = ((1.0 - self.cosine) / light_depth).min(1.0);
        // From the one within the other to both side by side.
        let (within, beside) = ((own - half_angle).abs(), own + half_angle);
        let t = ((beside - between) / (beside - within).max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
        self.opacity * largest * t * t * (3.0 - 2.0 * t)
    }

    /// The cap as it looks once directions have gone through a linear map, not necessarily of length: turned to where its axis
    /// goes, and with the tangent of its half-angle as much longer as directions about the axis are spread, in the mean of
    /// all ways around. Hemispheres stay hemispheres, and similarities change nothing but the axis.
    #[inline(always)]
    #[must_use]
    pub fn mapped(&self, linear: &Mat3) -> Self {
        let to = *linear * self.axis;
        let squared = to.dot(to).max(f32::MIN_POSITIVE);
        let length = squared.sqrt();
        // By how much a small solid angle around the axis grows.
        let spread = linear.determinant().abs() / (squared * length);
        let (cosine_squared, sine_squared) = (self.cosine * self.cosine, 1.0 - self.cosine * self.cosine);
        let cosine = self.cosine / (cosine_squared + spread * sine_squared).max(f32::MIN_POSITIVE).sqrt();
        Self { axis: to / length, cosine, opacity: self.opacity }
    }

    /// How far it occludes a soft direction: from 0 well outside to its opacity well inside. `softness` is the cosine of the
    /// angle over which the direction is spread.
    #[inline(always)]
    pub fn soft_occlusion(&self, direction: Vec3, softness: f32) -> f32 {
        let (cosine, sine) = (self.cosine, (1.0 - self.cosine * self.cosine).max(0.0).sqrt());
        let soft_sine = (1.0 - softness * softness).sqrt();
        // cos(α ± γ), or the end of the range where the angle leaves it.
        let outer = if cosine < -softness { -1.0 } else { cosine * softness - sine * soft_sine };
        let inner = if cosine > softness { 1.0 } else { cosine * softness + sine * soft_sine };
        let t = (self.axis.dot(direction) - outer) / (inner - outer);
        // NaN becomes 0 too.
        let t = if t > 0.0 { t.min(1.0) } else { 0.0 };
        self.opacity * t * t * (3.0 - 2.0 * t)
    }
}

/// The cosine-weighted share of the hemisphere around `normal` that an object with these harmonics hides, in [0, 1]: their
/// convolution with the clamped cosine (1, 2/3, 1/4 for the bands 0, 1, 2), where band 2 is that of the [`Cap`].
#[inline(always)]
pub fn cap_occlusion(harmonics: Vec4, cap: &Cap, normal: Vec3) -> f32 {
    let o1 = Vec3::new(harmonics.y, harmonics.z, harmonics.w);
    let facing = cap.axis.dot(normal);
    let sine_squared = 1.0 - cap.cosine * cap.cosine;
    // π sin²α cos α · 5/4π · P₂(x) · 1/4
    let second = cap.opacity * sine_squared * cap.cosine * (3.0 * facing * facing - 1.0) * (5.0 / 32.0);
    let occlusion = Y0 * harmonics.x + (2.0 / 3.0 * Y1) * o1.dot(normal) + second;
    // NaN becomes 0 too.
    if occlusion > 0.0 { occlusion.min(1.0) } else { 0.0 }
}

/// How much of a round light is hidden, in [0, 1], from the first 4, or all 16, harmonics of what is occluded: their mean over
/// the light's disc, and from the bands that they lack most of what the [`Cap`] has in them. Without those, mean errors at 15°
/// are half as large again.
///
/// # Panics
/// If there are fewer than four harmonics, or more than [`MAX_COEFFICIENTS`].
pub fn light_occlusion(occluded: &[f32], axis: Vec3, half_angle: f32) -> f32 {
    let cap = Cap::new(Vec4::from_slice(occluded));
    let mut of_cap = [0.0; MAX_COEFFICIENTS];
    harmonics::disc(&mut of_cap, cap.axis, cap.cosine);
    let mut known = [0.0; MAX_COEFFICIENTS];
    for (i, occluded) in occluded.iter().enumerate() {
        known[i] = occluded - CAP_SHARE * cap.opacity * of_cap[i];
    }
    let beyond = CAP_SHARE * cap.light_occlusion(axis, half_angle);
    let occlusion = disc_mean(&known, axis, half_angle) + beyond;
    // NaN becomes 0 too.
    if occlusion > 0.0 { occlusion.min(1.0) } else { 0.0 }
}

/// How much of the cap's higher bands is believed: the whole is worse for lights of 30° and more, which need them least.
const CAP_SHARE: f32 = 0.75;

/// An object's occlusion, faded out around the [`CUTOFF`].
#[inline(always)]
pub fn above_cutoff(occlusion: f32) -> f32 {
    occlusion * (occlusion * (1.0 / CUTOFF) - 1.0).clamp(0.0, 1.0)
}

/// Occlusion by the very surface that a receiver all but touches, which no grid of this size resolves: from `distance` to the
/// nearest surface, in `radius`es of the bounding sphere, and the cosine between the receiver's normal and the direction
/// away from that surface. The larger of this and the grid's occlusion counts. Needs a distance field.
#[inline(always)]
pub fn contact_occlusion(distance: f32, radius: f32, facing: f32) -> f32 {
    (1.0 - distance / (CONTACT_REACH * radius)).clamp(0.0, 1.0) * (1.0 - facing.clamp(-1.0, 1.0)) * 0.5
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ball_overhead_hides_its_share() {
        // A ball of angular radius α, wholly above the horizon at zenith angle θ, hides sin²α cos θ.
        for alpha in [0.05_f32, 0.3, 0.6] {
            for theta in [0.0_f32, 0.4, 0.9] {
                let axis = Vec3::new(theta.sin(), theta.cos(), 0.0);
                let ball = Cap { axis, cosine: alpha.cos(), opacity: 1.0 };
                let harmonics = ball.harmonics();
                let occlusion = cap_occlusion(harmonics, &Cap::new(harmonics), Vec3::Y);
                let exact = alpha.sin().powi(2) * theta.cos();
                // Bands above 2 are missing.
                assert!((occlusion - exact).abs() < 0.04, "α {alpha}, θ {theta}: {occlusion}, exactly {exact}");
            }
        }
    }

    #[test]
    fn nothing_and_everything() {
        let occlusion = |harmonics| cap_occlusion(harmonics, &Cap::new(harmonics), Vec3::Y);
        assert_eq!(occlusion(Vec4::ZERO), 0.0);
        let all = 4.0 * std::f32::consts::PI * Y0;
        assert!((occlusion(Vec4::new(all, 0.0, 0.0, 0.0)) - 1.0).abs() < 1e-5);
        for strange in [Vec4::splat(f32::NAN), Vec4::splat(f32::MAX), Vec4::splat(-1.0), Vec4::new(0.0, 1.0, 2.0, 3.0)]
        {
            let occlusion = occlusion(strange);
            assert!((0.0..=1.0).contains(&occlusion), "{strange}: {occlusion}");
        }
    }

    #[test]
    fn lights_are_hidden_as_far_as_they_are_covered() {
        let cap = Cap { axis: Vec3::Y, cosine: 30_f32.to_radians().cos(), opacity: 0.8 };
        let hidden = |from_axis: f32, half_angle: f32| {
            let (sin, cos) = from_axis.to_radians().sin_cos();
            cap.light_occlusion(Vec3::new(sin, cos, 0.0), half_angle.to_radians())
        };
        assert!((hidden(0.0, 10.0) - 0.8).abs() < 1e-6, "wholly");
        assert!((hidden(30.0, 10.0) - 0.4).abs() < 0.05, "its edge through the middle");
        assert!(hidden(41.0, 10.0) <= 0.0, "beside it");
        let share = (1.0 - cap.cosine) / (1.0 - 60_f32.to_radians().cos());
        assert!((hidden(0.0, 60.0) - 0.8 * share).abs() < 1e-5, "within the light");
        assert!((0.0..=0.81).contains(&hidden(20.0, 0.0)), "a point of light");
        for strange in [[f32::NAN; 16], [f32::MAX; 16], [-1.0; 16], [0.0; 16]] {
            for coefficients in [&strange[..4], &strange] {
                assert!((0.0..=1.0).contains(&light_occlusion(coefficients, Vec3::Y, 0.3)), "{strange:?}");
            }
        }
        let all = cap.harmonics().to_array();
        assert!((light_occlusion(&all, Vec3::Y, 0.2) - 0.7).abs() < 0.15);
        assert!(light_occlusion(&all, Vec3::NEG_Y, 0.2) < 0.05);
    }

    #[test]
    fn mapped_caps_cover_what_is_mapped() {
        let turn = Mat3::from_rotation_y(0.7) * Mat3::from_rotation_x(-0.4);
        let cap = Cap { axis: Vec3::new(0.6, 0.0, 0.8), cosine: 0.7, opacity: 0.5 };
        let turned = cap.mapped(&(turn * 3.0));
        assert!((turned.cosine - 0.7).abs() < 1e-6 && (turned.axis - turn * cap.axis).length() < 1e-6);
        let stretch = Mat3::from_diagonal(Vec3::new(1.0, 2.0, 3.0));
        for axis in [Vec3::X, Vec3::Y, Vec3::Z, cap.axis] {
            let small = Cap { axis, cosine: 0.995, opacity: 1.0 };
            let mapped = small.mapped(&stretch);
            // Directions of the world, asked where they come from.
            let directions = crate::estimate::sampling::sphere_samples(200_000);
            let from = stretch.inverse();
            let inside = directions.iter().filter(|d| (from * **d).normalize().dot(axis) > small.cosine).count();
            let share = inside as f32 / directions.len() as f32;
            let found = 0.5 * (1.0 - mapped.cosine);
            assert!((found / share - 1.0).abs() < 0.05, "{axis}: {found}, counted {share}");
            let half = Cap { cosine: 0.0, ..small }.mapped(&stretch);
            assert!(half.cosine.abs() < 1e-6 && Cap { cosine: -1.0, ..small }.mapped(&stretch).cosine < -0.999);
        }
    }

    #[test]
    fn soft_caps_end_where_they_should() {
        for cosine in [-1.0, -0.95, -0.5, 0.0, 0.5, 0.95, 1.0] {
            let cap = Cap { axis: Vec3::Z, cosine, opacity: 0.5 };
            let softness = 0.9;
            let along = |x: f32| cap.soft_occlusion(Vec3::new((1.0 - x * x).sqrt(), 0.0, x), softness);
            assert_eq!(along(1.0), 0.5, "the middle of the cap {cosine}");
            assert_eq!(along(-1.0), 0.0, "opposite to the cap {cosine}");
            assert_eq!(cap.soft_occlusion(Vec3::NAN, softness), 0.0);
            let mut previous = 0.0;
            for i in -50..=50 {
                let here = along(i as f32 / 50.0);
                assert!(here >= previous, "monotonic");
                previous = here;
            }
        }
    }

    #[test]
    fn contacts_are_near_and_faced() {
        assert_eq!(contact_occlusion(0.0, 1.0, -1.0), 1.0);
        assert_eq!(contact_occlusion(0.0, 1.0, 1.0), 0.0);
        assert_eq!(contact_occlusion(CONTACT_REACH, 1.0, -1.0), 0.0);
        assert!((contact_occlusion(CONTACT_REACH, 2.0, 0.0) - 0.25).abs() < 1e-6);
    }
}
