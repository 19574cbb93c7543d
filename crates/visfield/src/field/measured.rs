//! What a field was measured to get wrong on its own mesh.
//!
//! The bake tool chooses a table by measuring it, and writes down in the field's header what it found, so that whoever gets
//! the file sees what it is good for. Nothing here changes how the field answers.

use std::fmt;

use serde::{Deserialize, Serialize};

/// One measurement of a field against exact rays: the same rays through the field and through the mesh's triangles.
///
/// ```
/// use visfield::field::measured::{Measured, MeasuredScene, Purpose};
/// let measured = Measured {
///     purpose: Purpose::Ao { max_distance: None },
///     scene: MeasuredScene::Corner,
///     rays: 256,
///     rms_255: 0.77,
///     mean_abs: 0.0041,
/// };
/// let json = serde_json::to_string(&measured)?;
/// assert_eq!(json, r#"{"purpose":"ao","scene":"corner","rays":256,"rms_255":0.77,"mean_abs":0.0041}"#);
/// # Ok::<(), serde_json::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// What the field was used for.
    #[serde(flatten)]
    pub purpose: Purpose,
    /// Where the receivers were.
    pub scene: MeasuredScene,
    /// Rays per receiver.
    pub rays: u32,
    /// Root of the mean square error of occlusion × 255, so 0…255: of ambient occlusion over all receivers, of shadows over
    /// those in the penumbra, partly lit by the field or by the triangles. Where nothing lies in a
    /// penumbra, the mean absolute error × 255.
    pub rms_255: f32,
    /// Mean absolute error of occlusion, 0…1, over the receivers that the field or the triangles find occluded.
    pub mean_abs: f32,
}

impl Measured {
    pub(super) fn is_finite(&self) -> bool {
        let purpose = match self.purpose {
            Purpose::Ao { max_distance } => max_distance.unwrap_or(0.0),
            Purpose::Shadows { angular_radius } => angular_radius,
        };
        [purpose, self.rms_255, self.mean_abs].iter().all(|number| number.is_finite())
    }
}

/// What a field is used for.
///
/// ```
/// use visfield::field::measured::Purpose;
/// assert_eq!(Purpose::Ao { max_distance: Some(2.0) }.to_string(), "ao");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "purpose", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Purpose {
    /// Ambient occlusion.
    Ao {
        /// Hits beyond this distance did not count, in the mesh's own units; `None` if all did.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        max_distance: Option<f32>,
    },
    /// The soft shadow of a directional light.
    Shadows {
        /// Half of the angle that the light covers in the sky, in radians.
        angular_radius: f32,
    },
}

impl fmt::Display for Purpose {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(match self {
            Self::Ao { .. } => "ao",
            Self::Shadows { .. } => "shadows",
        })
    }
}

/// Where receivers were when a field was measured.
///
/// ```
/// assert_eq!(visfield::field::measured::MeasuredScene::OwnSurface.to_string(), "self");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum MeasuredScene {
    /// On a floor that the mesh stands on and on two walls close behind it: within the field's bounds and outside.
    Corner,
    /// In the same corner, only outside the bounds.
    CornerFar,
    /// On the mesh itself.
    #[serde(rename = "self")]
    OwnSurface,
}

impl fmt::Display for MeasuredScene {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(match self {
            Self::Corner => "corner",
            Self::CornerFar => "corner-far",
            Self::OwnSurface => "self",
        })
    }
}
