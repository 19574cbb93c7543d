//! Counts, bytes and times reach Bevy's diagnostics.

use bevy::diagnostic::{Diagnostic, DiagnosticPath, DiagnosticsStore};
use bevy::render::RenderApp;
use bevy::render::diagnostic::RenderDiagnosticsPlugin;
use bevy::render::renderer::RenderDevice;
use bevy_visfield::FieldOcclusionDiagnosticsPlugin as Field;
use bevy_visfield::prelude::*;

use crate::adapter;
use crate::stage::{SIZE, Shading, Stage, ball_field};
use visfield_workspace::headless::HeadlessApp;

#[test]
fn a_frame_is_counted_and_timed() {
    if !adapter::available() {
        return;
    }
    let mut stage = Stage::with_app(Shading::Forward, SIZE, ball_field(), |size| {
        let mut headless = HeadlessApp::new(size, |plugins| plugins);
        headless.app.add_plugins((RenderDiagnosticsPlugin, Field::default()));
        headless
    });
    stage.picture();
    let value = |stage: &Stage, path: &DiagnosticPath| {
        let store = stage.headless.app.world().resource::<DiagnosticsStore>();
        store.get(path).and_then(Diagnostic::value)
    };
    // What the GPU tells comes some frames late.
    for _ in 0..20 {
        stage.headless.update();
    }
    assert_eq!(value(&stage, &Field::INSTANCES), Some(1.0));
    assert_eq!(value(&stage, &Field::LIGHTS), Some(1.0));
    let statistics = stage.statistics();
    assert_eq!(value(&stage, &Field::FIELD_BYTES), Some(statistics.resident_bytes as f64));
    // The ball is listed somewhere; no tile or block lists it twice.
    let tiles = f64::from((SIZE / 16 + 1).element_product());
    let entries = value(&stage, &Field::TILE_ENTRIES).unwrap_or(0.0);
    assert!(entries >= 1.0 && entries <= 2.0 * tiles, "{entries} entries in {tiles} tiles");
    assert!(value(&stage, &Field::LOOKUPS_AT_MOST) >= Some(entries));
    let output = f64::from(SIZE.element_product() * 8);
    assert!(value(&stage, &Field::FRAME_BYTES).is_some_and(|bytes| bytes > output && bytes < 20.0 * output));
    assert!(value(&stage, &Field::EXTRACT).is_some() && value(&stage, &Field::PREPARE).is_some());

    let device = stage.headless.app.sub_app(RenderApp).world().resource::<RenderDevice>();
    if device.features().contains(wgpu::Features::TIMESTAMP_QUERY | wgpu::Features::TIMESTAMP_QUERY_INSIDE_ENCODERS) {
        let [tiles, trace, denoise, accumulate, resolve] = Field::GPU_PASSES.each_ref().map(|path| value(&stage, path));
        assert!([tiles, trace, denoise, resolve].iter().all(|time| time.is_some_and(|time| time > 0.0)));
        assert_eq!(accumulate, None, "nothing is accumulated");
    }

    stage.entity(stage.camera).remove::<FieldOcclusion>();
    for _ in 0..3 {
        stage.headless.update();
    }
    assert_eq!(value(&stage, &Field::INSTANCES), Some(0.0), "no camera shows any");
}
