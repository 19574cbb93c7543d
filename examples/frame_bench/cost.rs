//! What frames cost: medians over several of them.

use std::time::Duration;

use bevy::diagnostic::{Diagnostic, DiagnosticPath, DiagnosticsStore};
use bevy::prelude::*;
use bevy_visfield::FieldOcclusionDiagnosticsPlugin as Field;
use serde::Serialize;

use crate::timer::TimedApp;

/// The medians of some frames. Times are in milliseconds; what a frame does not have, or the GPU cannot time, is missing.
#[derive(Clone, Debug, Default, Serialize)]
pub(crate) struct FrameCost {
    /// What the frames show.
    pub(crate) name: String,
    /// Time on the GPU of all that Bevy submits.
    pub(crate) frame_gpu: Option<f64>,
    /// From the start of an update until the GPU is done.
    pub(crate) frame_wall: f64,
    /// The lists of what can matter to each tile: the culling.
    pub(crate) tiles: Option<f64>,
    pub(crate) trace: Option<f64>,
    pub(crate) denoise: Option<f64>,
    pub(crate) accumulate: Option<f64>,
    pub(crate) resolve: Option<f64>,
    /// The five above together.
    pub(crate) field_gpu: Option<f64>,
    /// Bevy's screen-space ambient occlusion.
    pub(crate) ssao: Option<f64>,
    /// CPU time to copy the occluders to the render world.
    pub(crate) extract_cpu: Option<f64>,
    /// CPU time to place them.
    pub(crate) prepare_cpu: Option<f64>,
    pub(crate) instances: Option<f64>,
    pub(crate) lights: Option<f64>,
    pub(crate) tile_entries: Option<f64>,
    pub(crate) lookups_at_most: Option<f64>,
    pub(crate) field_bytes: Option<f64>,
    pub(crate) frame_bytes: Option<f64>,
}

const SSAO: DiagnosticPath = DiagnosticPath::const_new("render/ssao/elapsed_gpu");

/// How many frames are looked at.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frames {
    /// Before any counts.
    pub(crate) warm_up: u32,
    pub(crate) measured: u32,
}

/// Renders frames, each moved on by `advance`, which hears its share of all.
pub(crate) fn measure(
    timed: &mut TimedApp,
    name: impl Into<String>,
    frames: Frames,
    mut advance: impl FnMut(&mut World, f32),
) -> FrameCost {
    timed.wait_until_ready();
    let mut run = |timed: &mut TimedApp, count: u32| {
        let times = (0..count).map(|frame| {
            advance(timed.headless.app.world_mut(), frame as f32 / count as f32);
            timed.frame()
        });
        times.collect::<Vec<_>>()
    };
    run(timed, frames.warm_up);
    let mut store = timed.headless.app.world_mut().resource_mut::<DiagnosticsStore>();
    store.iter_mut().for_each(Diagnostic::clear_history);
    let times = run(timed, frames.measured);
    // The diagnostics of a frame arrive with those after it.
    run(timed, 1);
    let store = timed.headless.app.world().resource::<DiagnosticsStore>();
    let of = |path: &DiagnosticPath| median(store.get(path)?.values().copied().collect());
    let milliseconds = |time: Duration| time.as_secs_f64() * 1000.0;
    let [tiles, trace, denoise, accumulate, resolve] = Field::GPU_PASSES.each_ref().map(of);
    let passes = [tiles, trace, denoise, accumulate, resolve];
    FrameCost {
        name: name.into(),
        frame_gpu: median(times.iter().filter_map(|time| time.gpu).map(milliseconds).collect()),
        frame_wall: median(times.iter().map(|time| milliseconds(time.wall)).collect()).unwrap_or(f64::NAN),
        tiles,
        trace,
        denoise,
        accumulate,
        resolve,
        field_gpu: passes.iter().any(Option::is_some).then(|| passes.into_iter().flatten().sum()),
        ssao: of(&SSAO),
        extract_cpu: of(&Field::EXTRACT),
        prepare_cpu: of(&Field::PREPARE),
        instances: of(&Field::INSTANCES),
        lights: of(&Field::LIGHTS),
        tile_entries: of(&Field::TILE_ENTRIES),
        lookups_at_most: of(&Field::LOOKUPS_AT_MOST),
        field_bytes: of(&Field::FIELD_BYTES),
        frame_bytes: of(&Field::FRAME_BYTES),
    }
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}
