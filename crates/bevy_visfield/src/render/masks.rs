//! Where light masks lie in the occlusion texture, and how Bevy's lighting finds them there: the twin of `masks.wgsl`.
//!
//! The texture holds *pages* as large as the camera's target, stacked from the top, and below them a *header*. Counting
//! channels through the pages, four in each, channel 0 is ambient visibility, which Bevy's shader reads as it is, and
//! channel `k + 1` the visibility of the light with mask `k`.
//!
//! The header's texels are counted from the first of the texture's last row: along that row, then along the row above it.
//!
//! | texel | of | red | green, blue, alpha |
//! | --- | --- | --- | --- |
//! | 0 | the marker | 1 | number of pages, rows of the header, 1 |
//! | 1 + `i` | directional light `i` | channel of its mask, or 0 | 0 |
//! | 11 … 18 | rect lights with masks, in any order | channel of its mask, or 0 | what it is, as 11-bit numbers |
//! | 19 + `i` | point or spot light `i` | channel of its mask, or 0 | 0 |
//!
//! Textures of cameras with Bevy's own ambient occlusion have no green channel, and so read as having no pages.

use bevy::math::{UVec2, Vec3};
use bevy::pbr::{ExtractedRectLight, MAX_DIRECTIONAL_LIGHTS, MAX_RECT_LIGHTS};
use half::f16;

/// The texel of the first directional light: after the marker.
const DIRECTIONAL_LIGHTS: u32 = 1;
/// The texel of the first rect light.
const RECT_LIGHTS: u32 = DIRECTIONAL_LIGHTS + MAX_DIRECTIONAL_LIGHTS as u32;
/// The texel of the point or spot light that Bevy's shader knows as 0.
const CLUSTERED_LIGHTS: u32 = RECT_LIGHTS + MAX_RECT_LIGHTS as u32;

/// Masks that a texture can hold: the channels of three pages beside ambient visibility.
pub(super) const MAX_MASKS: usize = 11;
/// Most rows of a header: half floats count no further without gaps.
const MAX_HEADER_ROWS: u32 = 2048;

/// A light, by what Bevy's lighting knows of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ShaderLight {
    /// Its index among the directional lights of the view.
    Directional(u32),
    /// A point or spot light: its index among the clustered lights.
    Clustered(u32),
    /// Bevy takes rect lights in the order of its archetypes, which differs from query to query: no index names them. They
    /// go by a key of all that the shader knows of them instead; lights with equal keys are equal, and so are their masks.
    Rect(RectKey),
}

impl ShaderLight {
    /// The texels of the header that are needed to find it, the marker included.
    fn header_texels(self) -> u64 {
        match self {
            Self::Directional(_) | Self::Rect(_) => u64::from(CLUSTERED_LIGHTS),
            Self::Clustered(index) => u64::from(CLUSTERED_LIGHTS) + u64::from(index) + 1,
        }
    }
}

/// What tells rect lights apart: 32 bits in numbers that half floats hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct RectKey([u16; 3]);

impl RectKey {
    pub(super) fn new(light: &ExtractedRectLight) -> Self {
        let sizes = Vec3::new(light.width, light.height, light.range);
        // As `prepare_lights` writes them.
        let [right, up] = [light.transform.right().into(), light.transform.up().into()];
        let mixed = [light.transform.translation(), right, up, sizes].into_iter().fold(2_166_136_261, mix_key);
        Self([mixed, mixed >> 11, mixed >> 22].map(|bits| (bits & 2047) as u16))
    }
}

/// The twin of `visfield_mix_key`: FNV-1a, with a shift that carries the high bits down.
fn mix_key(key: u32, values: Vec3) -> u32 {
    values.to_array().into_iter().fold(key, |mixed, value| {
        let bits = if value.abs() < f32::MIN_POSITIVE { 0 } else { value.to_bits() };
        let mixed = (mixed ^ bits).wrapping_mul(16_777_619);
        mixed ^ (mixed >> 15)
    })
}

/// The layout of one camera's occlusion texture.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct MaskTable {
    /// The size of a page: that of the camera's target.
    page_size: UVec2,
    pages: u32,
    header_rows: u32,
    lights: Vec<ShaderLight>,
}

impl MaskTable {
    /// The layout for the lights that get masks 0, 1, …, in a texture with pages of this size (not 0) and no side above
    /// `max_side`. It has masks for as many of the first lights, at most [`MAX_MASKS`], as the texture has room for:
    /// compare [`masks`](Self::masks). `None` if there is no room even for ambient visibility and the marker.
    pub(super) fn new(lights: &[ShaderLight], page_size: UVec2, max_side: u32) -> Option<Self> {
        let layout = |masks: usize| {
            let lights = &lights[..masks];
            let texels = lights.iter().map(|light| light.header_texels()).max().unwrap_or(1);
            let header_rows = u32::try_from(texels.div_ceil(u64::from(page_size.x))).ok()?;
            let pages = (masks as u32 + 1).div_ceil(4);
            let height = page_size.y.checked_mul(pages)?.checked_add(header_rows)?;
            let fits = header_rows <= MAX_HEADER_ROWS && height <= max_side && page_size.x <= max_side;
            fits.then(|| Self { page_size, pages, header_rows, lights: lights.to_vec() })
        };
        (0..=lights.len().min(MAX_MASKS)).rev().find_map(layout)
    }

    /// The size of a page.
    pub(super) fn page_size(&self) -> UVec2 {
        self.page_size
    }

    /// How many of the lights have masks.
    pub(super) fn masks(&self) -> usize {
        self.lights.len()
    }

    /// The size of the texture.
    pub(super) fn texture_size(&self) -> UVec2 {
        UVec2::new(self.page_size.x, self.page_size.y * self.pages + self.header_rows)
    }

    /// First texel and size of the header.
    pub(super) fn header_rect(&self) -> (UVec2, UVec2) {
        let origin = UVec2::new(0, self.page_size.y * self.pages);
        (origin, UVec2::new(self.page_size.x, self.header_rows))
    }

    /// The header's texels, row by row from its top: what the texture must hold there.
    pub(super) fn header(&self) -> Vec<[f16; 4]> {
        let width = self.page_size.x as usize;
        let mut header = vec![[f16::ZERO; 4]; width * self.header_rows as usize];
        let mut set = |texel: u32, value: [u16; 4]| {
            let (row, column) = (texel as usize / width, texel as usize % width);
            header[(self.header_rows as usize - 1 - row) * width + column] =
                value.map(|number| f16::from_f32(number.into()));
        };
        set(0, [1, self.pages as u16, self.header_rows as u16, 1]);
        let mut rects = RECT_LIGHTS..CLUSTERED_LIGHTS;
        for (channel, light) in (1..).zip(&self.lights) {
            match *light {
                ShaderLight::Directional(index) => set(DIRECTIONAL_LIGHTS + index, [channel, 0, 0, 0]),
                ShaderLight::Clustered(index) => set(CLUSTERED_LIGHTS + index, [channel, 0, 0, 0]),
                ShaderLight::Rect(RectKey([a, b, c])) => {
                    // More of them than Bevy shows: the others are dark.
                    let Some(texel) = rects.next() else { continue };
                    set(texel, [channel, a, b, c]);
                }
            }
        }
        header
    }
}

#[cfg(test)]
#[path = "masks_on_gpu.rs"]
mod on_gpu;

#[cfg(test)]
mod tests {
    use super::*;
    use bevy::prelude::*;

    const LIGHTS: [ShaderLight; 4] = [
        ShaderLight::Directional(9),
        ShaderLight::Rect(RectKey([5, 6, 7])),
        ShaderLight::Clustered(0),
        ShaderLight::Clustered(40),
    ];

    /// What the shader reads: `visfield_header`.
    fn texel(table: &MaskTable, texel: u32) -> [f32; 4] {
        let size = table.texture_size();
        let (origin, _) = table.header_rect();
        let at = UVec2::new(texel % size.x, size.y - 1 - texel / size.x) - origin;
        table.header()[(at.y * size.x + at.x) as usize].map(f32::from)
    }

    #[test]
    fn the_header_names_the_channel_of_every_light() {
        for width in [1, 7, 19, 60, 640] {
            let table = MaskTable::new(&LIGHTS, UVec2::new(width, 10), 8192).unwrap();
            assert_eq!((table.masks(), table.pages), (4, 2));
            let rows = 60_u32.div_ceil(width);
            assert_eq!(table.texture_size(), UVec2::new(width, 20 + rows));
            assert_eq!(table.header_rect(), (UVec2::new(0, 20), UVec2::new(width, rows)));
            assert_eq!(table.header().len() as u32, width * rows);
            assert_eq!(texel(&table, 0), [1.0, 2.0, rows as f32, 1.0]);
            assert_eq!(texel(&table, 1 + 9), [1.0, 0.0, 0.0, 0.0]);
            assert_eq!(texel(&table, 11), [2.0, 5.0, 6.0, 7.0]);
            assert_eq!(texel(&table, 19), [3.0, 0.0, 0.0, 0.0]);
            assert_eq!(texel(&table, 19 + 40), [4.0, 0.0, 0.0, 0.0]);
            assert_eq!(table.header().iter().filter(|texel| texel[0] > f16::ZERO).count(), 5, "no others");
        }
    }

    #[test]
    fn pages_follow_the_number_of_masks() {
        let pages = |masks: usize| {
            let lights: Vec<_> = (0..masks as u32).map(ShaderLight::Clustered).collect();
            let table = MaskTable::new(&lights, UVec2::new(64, 64), 8192).unwrap();
            (table.masks(), table.pages)
        };
        assert_eq!([0, 3, 4, 7, 8, 11, 40].map(pages), [(0, 1), (3, 1), (4, 2), (7, 2), (8, 3), (11, 3), (11, 3)]);
    }

    #[test]
    fn a_small_limit_leaves_masks_out() {
        let lights: Vec<_> = (0..11).map(ShaderLight::Clustered).collect();
        let masks = |max_side| MaskTable::new(&lights, UVec2::new(100, 60), max_side).map(|table| table.masks());
        assert_eq!([181, 180, 121, 120, 100].map(masks), [Some(11), Some(7), Some(7), Some(3), Some(3)]);
        assert_eq!(masks(99), None, "too narrow for the picture itself");
        assert_eq!(MaskTable::new(&lights, UVec2::new(60, 100), 100), None, "no row for the marker");
        assert_eq!(MaskTable::new(&lights, UVec2::new(60, 100), 101).unwrap().masks(), 3);
        let far = [ShaderLight::Clustered(3), ShaderLight::Clustered(u32::MAX)];
        assert_eq!(MaskTable::new(&far, UVec2::new(60, 100), 8192).unwrap().masks(), 1);
    }

    #[test]
    fn rect_lights_have_keys_of_their_own() {
        let light = |transform: Transform, width| ExtractedRectLight {
            color: LinearRgba::WHITE,
            intensity: 1.0,
            range: 20.0,
            width,
            height: 1.0,
            transform: transform.into(),
        };
        let at = Transform::from_xyz(1.0, 2.0, 3.0);
        let other_side = at.with_rotation(Quat::from_rotation_y(std::f32::consts::PI));
        let lights = [(at, 1.0), (at, 2.0), (other_side, 1.0), (Transform::from_xyz(1.0, 2.0, -3.0), 1.0)];
        let keys = lights.map(|(transform, width)| RectKey::new(&light(transform, width)));
        assert!((0..4).all(|a| (0..a).all(|b| keys[a] != keys[b])), "{keys:?}");
        assert_eq!(keys[0], RectKey::new(&light(at, 1.0)));
        assert_eq!(mix_key(1, Vec3::new(1e-40, -0.0, 1.0)), mix_key(1, Vec3::new(0.0, 0.0, 1.0)));
    }

    #[test]
    fn the_shader_has_the_same_numbers() {
        let shader = include_str!("masks.wgsl");
        for (name, value) in [
            ("VISFIELD_RECT_LIGHTS", RECT_LIGHTS),
            ("VISFIELD_MAX_RECT_LIGHTS", MAX_RECT_LIGHTS as u32),
            ("VISFIELD_CLUSTERED_LIGHTS", CLUSTERED_LIGHTS),
        ] {
            assert!(shader.contains(&format!("const {name}: u32 = {value}u;")), "{name}");
        }
    }
}
