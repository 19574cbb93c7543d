//! A window, or an image, that several cameras share.

use bevy::camera::Viewport;
use bevy::prelude::*;

/// The place of a camera in a grid of equal panes. [`fit_panes`] makes it a viewport.
///
/// ```
/// use bevy::math::uvec2;
/// use visfield_workspace::panes::Pane;
/// let right = Pane { cell: uvec2(1, 0), grid: uvec2(2, 1) };
/// let (origin, size) = right.rectangle(uvec2(640, 360));
/// assert_eq!((origin, size), (uvec2(321, 0), uvec2(319, 360)));
/// ```
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pane {
    /// Column and row, from the top left.
    pub cell: UVec2,
    /// Columns and rows of the grid.
    pub grid: UVec2,
}

impl Pane {
    /// First pixel and size of the pane. Between panes a line of two pixels stays free.
    pub fn rectangle(self, target: UVec2) -> (UVec2, UVec2) {
        let first = |cell: UVec2| target * cell / self.grid;
        let begin = first(self.cell) + self.cell.min(UVec2::ONE);
        let inner = (self.grid - self.cell - 1).min(UVec2::ONE);
        let end = first(self.cell + 1).saturating_sub(inner);
        (begin.min(target.saturating_sub(UVec2::ONE)), end.saturating_sub(begin).max(UVec2::ONE))
    }
}

/// Gives cameras the viewports of their panes, and follows the size of what they render to.
pub fn fit_panes(mut cameras: Query<(&Pane, &mut Camera)>) {
    for (pane, mut camera) in &mut cameras {
        let Some(target) = camera.physical_target_size() else { continue };
        let (physical_position, physical_size) = pane.rectangle(target);
        let fits = |viewport: &Viewport| {
            (viewport.physical_position, viewport.physical_size) == (physical_position, physical_size)
        };
        if !camera.viewport.as_ref().is_some_and(fits) {
            camera.viewport = Some(Viewport { physical_position, physical_size, ..default() });
        }
    }
}

/// A line of text at the lower edge of a camera's pane.
///
/// ```
/// # use bevy::prelude::*;
/// fn name_pane(commands: &mut Commands, camera: Entity) {
///     commands.spawn(visfield_workspace::panes::label(camera, "reference"));
/// }
/// ```
pub fn label(camera: Entity, text: impl Into<String>) -> impl Bundle {
    text_at(camera, text, Node { position_type: PositionType::Absolute, left: px(6), bottom: px(6), ..default() })
}

/// Text at the upper edge of a camera's pane.
///
/// ```
/// # use bevy::prelude::*;
/// fn explain(commands: &mut Commands, camera: Entity) {
///     commands.spawn(visfield_workspace::panes::help(camera, "Esc quit"));
/// }
/// ```
pub fn help(camera: Entity, text: impl Into<String>) -> impl Bundle {
    text_at(camera, text, Node { position_type: PositionType::Absolute, left: px(6), top: px(6), ..default() })
}

fn text_at(camera: Entity, text: impl Into<String>, place: Node) -> impl Bundle {
    let padded = Node { padding: UiRect::axes(px(6), px(2)), max_width: percent(96), ..place };
    (
        Text::new(text),
        TextFont::from_font_size(13.0),
        TextColor(Color::WHITE),
        // Readable over any picture.
        BackgroundColor(Color::BLACK.with_alpha(0.55)),
        padded,
        UiTargetCamera(camera),
    )
}
