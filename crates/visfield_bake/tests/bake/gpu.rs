//! Measurements on a GPU: that every kernel answers what it should, on whichever adapter there is.

use visfield_bake::measure::MeasurementDocument;
use visfield_bake::measure::gpu::{GpuError, GpuQuestion, measure_gpu};
use visfield_bake::read_meshes;
use visfield_bake::report::{ReportEntry, report};

use super::support::asset;

/// What was measured. Without an adapter the test is skipped by hand and fails under CI.
pub(crate) fn on_adapter<T>(measured: Result<T, GpuError>) -> Option<T> {
    if matches!(measured, Err(GpuError::NoAdapter)) {
        assert!(std::env::var_os("CI").is_none(), "CI needs a GPU or a software adapter (mesa-vulkan-drivers)");
        eprintln!("skipped: {}", GpuError::NoAdapter);
        return None;
    }
    Some(measured.unwrap_or_else(|error| panic!("{error}")))
}

#[test]
fn shaders_answer_as_the_processor_does() {
    let mesh = &read_meshes(&asset("torus_knot", "glb")).unwrap()[0];
    let question = GpuQuestion { small: (17, 16), large: (33, 32), rays: Some(30_000) };
    let Some(found) = on_adapter(measure_gpu(mesh, &question, |_, _| ())) else { return };
    println!("{}", found.table());
    assert!((25_000..35_000).contains(&found.rays), "{} rays", found.rays);
    assert!(found.bvh_parity >= 0.9999, "{} of the traced rays", found.bvh_parity);
    for (field, bound) in [(&found.small, 10.0), (&found.large, 4.0)] {
        assert!(field.index_parity >= 0.9999, "{}: {} of the indices", field.size, field.index_parity);
        assert!(field.answer_parity >= 0.9999, "{}: {} of the answers", field.size, field.answer_parity);
        assert!(field.rms_255 > 0.0 && field.rms_255 < bound, "{}: RMS {}", field.size, field.rms_255);
        let rates = [
            field.lookups_per_second,
            field.gather_limit_lookups_per_second,
            field.arithmetic_limit_lookups_per_second,
            field.field_rays_per_second,
        ];
        assert!(rates.iter().all(|rate| rate.is_finite() && *rate > 1e4), "{rates:?}");
        // Nothing is optimised away, and nothing else hides in the way.
        assert!(field.share_of_limit() < 1.5, "{}: {} of the limit", field.size, field.share_of_limit());
    }
    assert!(found.large.rms_255 < found.small.rms_255, "finer tables are better");

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("gpu.json");
    MeasurementDocument::Gpu(Box::new(found)).write(&path).unwrap();
    let value: serde_json::Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    for key in ["adapter", "field_bytes", "lookups_per_second", "speedup_bvh", "index_parity", "mean_abs", "rms_255"] {
        assert!(!value[key].is_null(), "{key}");
    }
    assert!(value["large"]["field_bytes"].as_u64() > value["field_bytes"].as_u64());
    let document = MeasurementDocument::read(&path).unwrap();
    let page = report(&[ReportEntry { file: "gpu.json".to_owned(), document }]);
    assert!(page.contains("On a GPU") && page.contains("arithmetic limit"));
}
