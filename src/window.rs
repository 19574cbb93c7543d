//! What the examples share in a window: the app itself, its end, the clock that pauses, and presets as a key.

use std::process::ExitCode;

use bevy::prelude::*;
use bevy_visfield::prelude::*;

use crate::headless::ASSETS;
use crate::moving_objects::{PERIOD, SceneClock};

/// An app with Bevy's default plugins, the project's assets, and a window of this title.
///
/// ```no_run
/// use visfield_workspace::window::{exit_code, window_app};
/// fn main() -> std::process::ExitCode {
///     exit_code(window_app("visfield: nothing yet").run())
/// }
/// ```
pub fn window_app(title: &str) -> App {
    let window = Window { title: title.to_owned(), ..default() };
    let mut app = App::new();
    app.add_plugins(
        DefaultPlugins
            .set(WindowPlugin { primary_window: Some(window), ..default() })
            .set(AssetPlugin { file_path: ASSETS.to_owned(), ..default() }),
    );
    app
}

/// How an app that has ended lets its program end.
pub fn exit_code(exit: AppExit) -> ExitCode {
    match exit {
        AppExit::Success => ExitCode::SUCCESS,
        AppExit::Error(code) => ExitCode::from(code.get()),
    }
}

/// Whether the scene stands still.
///
/// ```
/// assert!(!visfield_workspace::window::Paused::default().0);
/// ```
#[derive(Resource, Clone, Copy, Debug, Default)]
pub struct Paused(pub bool);

/// Moves the clock on, around one loop of the scene, unless it is paused.
pub fn tick(time: Res<Time>, paused: Res<Paused>, mut clock: ResMut<SceneClock>) {
    if !paused.0 {
        clock.0 = (clock.0 + time.delta_secs()) % PERIOD;
    }
}

/// The next preset; after the last one, and after numbers of one's own, the first.
///
/// ```
/// use bevy_visfield::FieldOcclusionQuality::{Low, Ultra};
/// assert_eq!(visfield_workspace::window::next_quality(Ultra), Low);
/// ```
pub fn next_quality(quality: FieldOcclusionQuality) -> FieldOcclusionQuality {
    use FieldOcclusionQuality::{High, Low, Medium, Ultra};
    match quality {
        Low => Medium,
        Medium => High,
        High => Ultra,
        _ => Low,
    }
}
