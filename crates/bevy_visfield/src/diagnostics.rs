//! Counts and times of field occlusion among Bevy's diagnostics.

use bevy::diagnostic::{DEFAULT_MAX_HISTORY_LENGTH, Diagnostic, DiagnosticPath, Diagnostics, RegisterDiagnostic};
use bevy::prelude::*;
use bevy::render::{ExtractSchedule, RenderApp};

use crate::render::{FieldOcclusionSystems, FrameCounts, LatestCounts, count_frame};

/// Adds counts and CPU times of field occlusion to Bevy's diagnostics, of all cameras together, each a frame behind.
///
/// The GPU time of each group of passes is recorded by Bevy's `RenderDiagnosticsPlugin`, if the app has it and the GPU has timestamps:
/// [`GPU_PASSES`](Self::GPU_PASSES).
///
/// ```
/// use bevy::{diagnostic::DiagnosticsStore, prelude::*};
/// use bevy_visfield::FieldOcclusionDiagnosticsPlugin;
/// fn watch(app: &mut App) {
///     app.add_plugins(FieldOcclusionDiagnosticsPlugin::default()).add_systems(Update, |store: Res<DiagnosticsStore>| {
///         let placed = store.get_measurement(&FieldOcclusionDiagnosticsPlugin::INSTANCES);
///         debug!("{:?} instances", placed.map(|measurement| measurement.value));
///     });
/// }
/// ```
#[derive(Clone, Copy, Debug)]
pub struct FieldOcclusionDiagnosticsPlugin {
    /// How many values of each are kept.
    pub max_history_length: usize,
}

impl Default for FieldOcclusionDiagnosticsPlugin {
    fn default() -> Self {
        Self { max_history_length: DEFAULT_MAX_HISTORY_LENGTH }
    }
}

impl FieldOcclusionDiagnosticsPlugin {
    /// Instances whose field is on the GPU, on screen or not; one that several cameras see counts for each.
    pub const INSTANCES: DiagnosticPath = DiagnosticPath::const_new("field_occlusion/instances");
    /// Lights with a mask.
    pub const LIGHTS: DiagnosticPath = DiagnosticPath::const_new("field_occlusion/lights");
    /// Entries of the lists of tiles, and of those of blocks of tiles that they are made of. The GPU tells some frames late.
    pub const TILE_ENTRIES: DiagnosticPath = DiagnosticPath::const_new("field_occlusion/tile_entries");
    /// Rays times listed instances: the table look-ups that the frame would need if every entry mattered to ambient light and to each
    /// light, and no ray ended early. There are fewer; only the GPU could count them, and that would slow it down.
    pub const LOOKUPS_AT_MOST: DiagnosticPath = DiagnosticPath::const_new("field_occlusion/lookups_at_most");
    /// Bytes of all fields on the GPU.
    pub const FIELD_BYTES: DiagnosticPath = DiagnosticPath::const_new("field_occlusion/field_bytes");
    /// Bytes of the buffers and textures beyond the fields.
    pub const FRAME_BYTES: DiagnosticPath = DiagnosticPath::const_new("field_occlusion/frame_bytes");
    /// CPU time to copy the occluders to the render world, in milliseconds.
    pub const EXTRACT: DiagnosticPath = DiagnosticPath::const_new("field_occlusion/extract/elapsed_cpu");
    /// CPU time to place the occluders for all cameras, in milliseconds.
    pub const PREPARE: DiagnosticPath = DiagnosticPath::const_new("field_occlusion/prepare/elapsed_cpu");
    /// The GPU time of the groups of passes, in milliseconds: lists of tiles, rays, their filter, their accumulation, and the
    /// resolve, which asks cap grids. What a frame does not need has no value in it.
    pub const GPU_PASSES: [DiagnosticPath; 5] = [
        DiagnosticPath::const_new("render/field_occlusion_tiles/elapsed_gpu"),
        DiagnosticPath::const_new("render/field_occlusion_trace/elapsed_gpu"),
        DiagnosticPath::const_new("render/field_occlusion_denoise/elapsed_gpu"),
        DiagnosticPath::const_new("render/field_occlusion_accumulate/elapsed_gpu"),
        DiagnosticPath::const_new("render/field_occlusion_resolve/elapsed_gpu"),
    ];
}

impl Plugin for FieldOcclusionDiagnosticsPlugin {
    fn build(&self, app: &mut App) {
        let suffixed = [
            (Self::INSTANCES, " instances"),
            (Self::LIGHTS, " lights"),
            (Self::TILE_ENTRIES, " entries"),
            (Self::LOOKUPS_AT_MOST, " lookups"),
            (Self::FIELD_BYTES, " bytes"),
            (Self::FRAME_BYTES, " bytes"),
            (Self::EXTRACT, "ms"),
            (Self::PREPARE, "ms"),
        ];
        for (path, suffix) in suffixed {
            let diagnostic = Diagnostic::new(path).with_suffix(suffix);
            app.register_diagnostic(diagnostic.with_max_history_length(self.max_history_length));
        }
        app.init_resource::<LatestCounts>().add_systems(PreUpdate, add_measurements);
        if let Some(render_app) = app.get_sub_app_mut(RenderApp) {
            // Before the next frame's occluders and times replace those of the frame that is counted.
            render_app.add_systems(ExtractSchedule, count_frame.before(FieldOcclusionSystems::Extract));
        }
    }
}

fn add_measurements(mut diagnostics: Diagnostics, latest: Res<LatestCounts>) {
    use FieldOcclusionDiagnosticsPlugin as Plugin;
    let Some(counts) = latest.take() else { return };
    let FrameCounts { instances, lights, tile_entries, lookups_at_most, field_bytes, frame_bytes, times } = counts;
    let milliseconds = |time: std::time::Duration| time.as_secs_f64() * 1000.0;
    let values = [
        (Plugin::INSTANCES, instances as f64),
        (Plugin::LIGHTS, lights as f64),
        (Plugin::TILE_ENTRIES, tile_entries as f64),
        (Plugin::LOOKUPS_AT_MOST, lookups_at_most as f64),
        (Plugin::FIELD_BYTES, field_bytes as f64),
        (Plugin::FRAME_BYTES, frame_bytes as f64),
        (Plugin::EXTRACT, milliseconds(times.extract)),
        (Plugin::PREPARE, milliseconds(times.prepare)),
    ];
    for (path, value) in values {
        diagnostics.add_measurement(&path, || value);
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use bevy::diagnostic::{DiagnosticsPlugin, DiagnosticsStore};

    use super::*;
    use crate::render::CpuTimes;

    #[test]
    fn a_frame_is_measured_once() {
        let mut app = App::new();
        app.add_plugins((MinimalPlugins, DiagnosticsPlugin, FieldOcclusionDiagnosticsPlugin::default()));
        let times = CpuTimes { extract: Duration::from_micros(250), prepare: Duration::from_millis(2) };
        let counts = FrameCounts { instances: 7, tile_entries: 3, times, ..FrameCounts::default() };
        app.world().resource::<LatestCounts>().tell(counts);
        app.update();
        app.update();
        let store = app.world().resource::<DiagnosticsStore>();
        let values = |path| store.get(&path).map(|diagnostic| diagnostic.values().copied().collect::<Vec<_>>());
        assert_eq!(values(FieldOcclusionDiagnosticsPlugin::INSTANCES), Some(vec![7.0]));
        assert_eq!(values(FieldOcclusionDiagnosticsPlugin::TILE_ENTRIES), Some(vec![3.0]));
        assert_eq!(values(FieldOcclusionDiagnosticsPlugin::LIGHTS), Some(vec![0.0]));
        assert_eq!(values(FieldOcclusionDiagnosticsPlugin::EXTRACT), Some(vec![0.25]));
        assert_eq!(values(FieldOcclusionDiagnosticsPlugin::PREPARE), Some(vec![2.0]));
    }
}
