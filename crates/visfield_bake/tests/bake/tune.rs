//! The tuner, as a library and as `visfield bake` with limits. Small limits of bytes keep the tables small and the tests fast.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use visfield::field::measured::{Measured, MeasuredScene, Purpose};
use visfield::{Encoding, Representation, TableFormat, VisibilityField, file};
use visfield_bake::measure::{AmbientQuestion, MeasureScene, ShadowQuestion, measure_ambient_of, measure_shadow_of};
use visfield_bake::tune::{TuneError, TuneQuestion, TuneReceivers, TuneStep, Tuned, tune};
use visfield_bake::{BakeSettings, BoundsKind, Mesh, read_meshes};

use crate::support::asset;

fn mesh(name: &str) -> Mesh {
    read_meshes(&asset(name, "glb")).unwrap().remove(0)
}

/// Ambient occlusion alone, in at most 300 kB.
const SMALL: TuneQuestion = TuneQuestion {
    max_rms: None,
    max_bytes: Some(300_000),
    ambient: true,
    shadows: false,
    receivers: TuneReceivers::All,
    max_distance: f32::INFINITY,
    tables: true,
    distances: true,
};

/// The same without distances.
const SMALL_TABLE: TuneQuestion = TuneQuestion { distances: false, ..SMALL };

fn tuned(mesh: &Mesh, question: &TuneQuestion) -> Tuned {
    tune(mesh, question, |_| ()).unwrap()
}

fn worst(field: &VisibilityField) -> f32 {
    field.header().measured.iter().map(|measured| measured.rms_255).fold(0.0, f32::max)
}

#[test]
fn only_what_is_required_is_stored() {
    let mesh = mesh("torus_knot");
    let encoding = |question: TuneQuestion| tuned(&mesh, &question).settings.table.unwrap().encoding;
    assert_eq!(encoding(TuneQuestion { receivers: TuneReceivers::Others, ..SMALL_TABLE }), Encoding::Bit);
    assert_eq!(encoding(TuneQuestion { receivers: TuneReceivers::Far, ..SMALL_TABLE }), Encoding::Bit);
    assert_eq!(encoding(SMALL_TABLE), Encoding::U8, "its own surface needs distances");
    let near = TuneQuestion { receivers: TuneReceivers::Others, max_distance: 0.5, ..SMALL_TABLE };
    assert_eq!(encoding(near), Encoding::U8, "a reach needs distances");
}

#[test]
fn distances_are_chosen_where_they_win() {
    let mesh = mesh("torus_knot");
    let with = tuned(&mesh, &SMALL);
    assert!(with.settings.distance.is_some() && with.field.distance_field().is_some(), "{}", with.settings);
    assert!(worst(&with.field) < 0.7 * worst(&tuned(&mesh, &SMALL_TABLE).field), "{}", worst(&with.field));
    let alone = TuneQuestion { tables: false, ..SMALL };
    let alone = tuned(&mesh, &alone);
    assert!(alone.settings.table.is_none() && alone.field.table().is_none());
    assert!(worst(&with.field) <= worst(&alone.field), "{} and {}", worst(&with.field), worst(&alone.field));
    // Nothing that is asked far away starts inside the bounds.
    let far = tuned(&mesh, &TuneQuestion { receivers: TuneReceivers::Far, ..SMALL });
    assert!(far.settings.table.is_none() || far.settings.distance.is_none(), "{}", far.settings);
}

#[test]
fn a_table_and_distances_together_are_measured_as_their_field_is() {
    // There is room for a small table beside distances, and not for finer distances.
    let mesh = mesh("supershape");
    let both = tuned(&mesh, &SMALL);
    assert!(both.settings.table.is_some() && both.settings.distance.is_some(), "{}", both.settings);
    assert!(both.field.bytes() <= 300_000);
    let again = visfield_bake::bake(&mesh, &both.settings, |_| ()).unwrap();
    assert_eq!(again.distance_field(), both.field.distance_field());
    assert_eq!(again.header().bounds, both.field.header().bounds);
    for measured in &both.field.header().measured {
        let (rms, mean) = measured_again(&mesh, &both.field, measured);
        assert_eq!((rms as f32, mean as f32), (measured.rms_255, measured.mean_abs), "{measured:?}");
    }
}

/// A field's error in a scene, by the tools that anybody can measure with, not by the tuner's own: RMS × 255, and mean.
fn measured_again(mesh: &Mesh, field: &VisibilityField, measured: &Measured) -> (f64, f64) {
    let scene = match measured.scene {
        MeasuredScene::Corner => MeasureScene::Corner,
        MeasuredScene::OwnSurface => MeasureScene::OwnSurface,
        other => panic!("{other} was not asked for"),
    };
    match measured.purpose {
        Purpose::Ao { max_distance: None } => {
            let ask = AmbientQuestion { scene, rays: measured.rays, speed: false, ..AmbientQuestion::default() };
            let found = measure_ambient_of(mesh, field, &ask).unwrap();
            (found.rms_255, found.mean_abs)
        }
        Purpose::Shadows { angular_radius } => {
            let rays = measured.rays;
            let ask = ShadowQuestion { scene, angular_radius, rays, speed: false, ..ShadowQuestion::default() };
            let found = measure_shadow_of(mesh, field, &ask).unwrap();
            assert!(found.partly_lit > 100, "{} receivers in a penumbra", found.partly_lit);
            (found.rms_255, found.mean_abs)
        }
        other => panic!("{other} was not asked for"),
    }
}

#[test]
fn limits_are_met_when_measured_again() {
    let mesh = mesh("supershape");
    let shadows = TuneQuestion { ambient: false, shadows: true, receivers: TuneReceivers::Others, ..SMALL };
    for (question, count) in [(SMALL, 2), (shadows, 1)] {
        let most_accurate = tuned(&mesh, &question);
        assert!(most_accurate.field.bytes() <= 300_000);
        let max_rms = worst(&most_accurate.field) * 1.1;
        let cheapest = tuned(&mesh, &TuneQuestion { max_rms: Some(max_rms), ..question });
        assert!(cheapest.field.bytes() <= most_accurate.field.bytes());

        let measured = &cheapest.field.header().measured;
        assert_eq!(measured.len(), count);
        for measured in measured {
            let (rms, mean) = measured_again(&mesh, &cheapest.field, measured);
            assert_eq!((rms as f32, mean as f32), (measured.rms_255, measured.mean_abs), "{measured:?}");
            assert!(rms > 0.0 && rms as f32 <= max_rms, "{measured:?}");
        }
    }
}

#[test]
fn nothing_cheaper_is_good_enough() {
    let mesh = mesh("chair");
    let question =
        TuneQuestion { max_rms: Some(2.4), receivers: TuneReceivers::Others, max_bytes: None, ..SMALL_TABLE };
    let chosen = tuned(&mesh, &question);
    assert!(worst(&chosen.field) <= 2.4);
    let bytes = chosen.field.bytes();
    let mut tried = 0;
    for (entries, exits) in [(17, 16), (33, 16), (25, 24), (49, 24), (33, 32)] {
        for encoding in [Encoding::Bit, Encoding::U8] {
            for bounds in [BoundsKind::Sphere, BoundsKind::Ellipsoid] {
                let representation = Representation::TwoPoint { entries, exits };
                let settings = BakeSettings::of_table(TableFormat { representation, encoding }, bounds);
                let field = visfield_bake::bake(&mesh, &settings, |_| ()).unwrap();
                if field.bytes() < bytes {
                    let rms = measured_again(&mesh, &field, &chosen.field.header().measured[0]).0;
                    assert!(rms > 2.4, "{settings} would have been enough: {rms}");
                    tried += 1;
                }
            }
        }
    }
    assert!((2..10).contains(&tried), "{tried} tables are cheaper than {}", chosen.settings);
}

#[test]
fn what_cannot_be_met_is_said_with_what_could() {
    let mesh = mesh("torus_knot");
    let error = tune(&mesh, &TuneQuestion { max_rms: Some(0.001), ..SMALL }, |_| ()).unwrap_err();
    let TuneError::Missed { best, bytes, worst: least, .. } = &error else { panic!("{error}") };
    assert!(best.distance.is_some(), "{best}");
    assert!(*bytes <= 300_000);
    let message = error.to_string();
    let proposal: f32 = message.split("allow an RMS of ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    assert!((0.0..0.011).contains(&(proposal - least.rms_255)), "{message}");
    let relaxed = tuned(&mesh, &TuneQuestion { max_rms: Some(proposal), ..SMALL });
    assert!(worst(&relaxed.field) <= proposal, "the proposal would do");

    let refused = |question: TuneQuestion| tune(&mesh, &question, |_| ()).unwrap_err();
    assert_eq!(refused(TuneQuestion::default()), TuneError::NoLimit);
    assert_eq!(refused(TuneQuestion { ambient: false, ..SMALL }), TuneError::NoPurpose);
    assert_eq!(refused(TuneQuestion { tables: false, ..SMALL_TABLE }), TuneError::NoParts);
    for max_rms in [-1.0, 256.0, f32::NAN] {
        assert!(matches!(refused(TuneQuestion { max_rms: Some(max_rms), ..SMALL }), TuneError::Rms { .. }));
    }
    for max_distance in [-1.0, 0.0, f32::NAN] {
        assert!(matches!(refused(TuneQuestion { max_distance, ..SMALL }), TuneError::Distance { .. }));
    }
    let few = refused(TuneQuestion { max_bytes: Some(100), ..SMALL_TABLE });
    assert!(matches!(few, TuneError::TooFewBytes { max_bytes: 100, smallest: 9_537, .. }), "{few}");
    let few = refused(TuneQuestion { max_bytes: Some(100), tables: false, ..SMALL });
    assert!(matches!(few, TuneError::TooFewBytes { smallest: 1_000..24_000, .. }), "{few}");
    let nothing = Mesh { name: "nothing".to_owned(), ..Mesh::default() };
    assert!(matches!(tune(&nothing, &SMALL, |_| ()), Err(TuneError::Bake(_))));
}

#[test]
fn steps_add_up_and_units_do_not_matter() {
    let mesh = mesh("chair");
    let steps = std::sync::Mutex::new((Vec::new(), 0));
    let question =
        TuneQuestion { max_rms: Some(2.0), max_bytes: None, receivers: TuneReceivers::Others, ..SMALL_TABLE };
    let chosen = tune(&mesh, &question, |step| {
        let mut steps = steps.lock().unwrap();
        match step {
            TuneStep::Field(settings) => steps.0.push(settings),
            TuneStep::Rays(rays) => steps.1 += rays,
            other => panic!("{other:?}"),
        }
    })
    .unwrap();
    let (tables, rays) = steps.into_inner().unwrap();
    assert_eq!(tables.len(), chosen.measured_fields);
    let chords = |s: &BakeSettings| (s.table.unwrap().representation.to_string(), s.bounds == BoundsKind::Sphere);
    let mut traced = tables.clone();
    traced.sort_by_key(chords);
    traced.dedup_by_key(|s| chords(s));
    assert!(traced.len() < tables.len(), "bits and bytes share rays");
    assert_eq!(rays, traced.iter().map(BakeSettings::rays).sum::<u64>());
    assert!(tables.contains(&chosen.settings));

    // In 64ths of its units, which is exact; so is a reach.
    let scaled = Mesh { positions: mesh.positions.iter().map(|p| p.map(|x| x * 64.0)).collect(), ..mesh.clone() };
    let reach = TuneQuestion { max_distance: 0.25, receivers: TuneReceivers::Others, ..SMALL };
    let (a, b) = (tuned(&mesh, &reach), tuned(&scaled, &TuneQuestion { max_distance: 16.0, ..reach }));
    assert_eq!(a.settings, b.settings);
    assert!((worst(&a.field) - worst(&b.field)).abs() < 0.05, "{} and {}", worst(&a.field), worst(&b.field));
    assert_eq!(b.field.header().measured[0].purpose, Purpose::Ao { max_distance: Some(16.0) });
}

fn visfield(folder: &Path, arguments: &str) -> Output {
    let arguments = arguments.split(' ');
    Command::new(env!("CARGO_BIN_EXE_visfield")).args(arguments).current_dir(folder).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

#[test]
fn bake_with_limits_then_inspect() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::copy(asset("torus_knot", "glb"), folder.join("knot.glb")).unwrap();
    let output = visfield(
        folder,
        "bake knot.glb --max-rms 5 --max-bytes 0.3MB --for ao --receivers others --representation two-point",
    );
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert_eq!(text(&output.stderr), "", "no progress bar in a pipe");
    let report = text(&output.stdout);
    let field = file::read(&folder.join("knot.vfield")).unwrap().remove(0);
    let [measured] = field.header().measured[..] else { panic!("{:?}", field.header().measured) };
    assert_eq!((measured.scene, measured.purpose), (MeasuredScene::Corner, Purpose::Ao { max_distance: None }));
    assert!(measured.rms_255 > 0.0 && measured.rms_255 <= 5.0 && field.bytes() <= 300_000);
    let line = format!("ao, on floor and walls around it: RMS {:.2}/255, mean error ", measured.rms_255);
    for part in ["Mesh0/Primitive0: 6,144 triangles", " in bit, ", "measured", &line, "knot.vfield: 1 field"] {
        assert!(report.contains(part), "{part:?} in {report}");
    }
    let inspected = text(&visfield(folder, "inspect knot.vfield").stdout);
    assert!(inspected.contains(&line) && inspected.contains("  measured         ao"), "{inspected}");

    let output = visfield(folder, "bake knot.glb --max-bytes 0.3MB --representation distance,two-point");
    let report = text(&output.stdout);
    let field = file::read(&folder.join("knot.vfield")).unwrap().remove(0);
    assert!(field.distance_field().is_some() && field.cap_grid().is_none() && field.bytes() <= 300_000, "{report}");
    assert!(report.contains("fields measured") && report.contains("\n  distances "), "{report}");

    // Without limits nothing is measured, as ever.
    assert!(visfield(folder, "bake knot.glb --entries 9 --exits 8").status.success());
    assert!(!text(&visfield(folder, "inspect knot.vfield").stdout).contains("measured"));
}

#[test]
fn limits_that_cannot_be_met_write_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::copy(asset("chair", "glb"), folder.join("chair.glb")).unwrap();
    for (limits, parts) in [
        ("--max-rms 0.01 --max-bytes 80kB", &["of at most 80000 bytes", "u8", "allow an RMS of", "more bytes"][..]),
        ("--max-bytes 100", &["nothing that could be chosen has 100 bytes or fewer", "9537"]),
        ("--max-bytes 0", &["has 0 bytes or fewer"]),
    ] {
        let tables = "--representation two-point,cap-grid";
        let output = visfield(folder, &format!("bake chair.glb --for ao {tables} {limits}"));
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{message}");
        assert!(message.starts_with("error: chair.glb: Mesh0/Primitive0: "), "{message}");
        assert!(message.trim_end().lines().count() == 1 && message.ends_with("nothing is written\n"), "{message}");
        assert!(parts.iter().all(|part| message.contains(part)), "{parts:?} in {message}");
        assert!(output.stdout.is_empty());
    }
    assert_eq!(fs::read_dir(folder).unwrap().count(), 1, "only the mesh");
}

#[test]
fn nonsense_limits_are_usage_errors() {
    let folder = tempfile::tempdir().unwrap();
    for (arguments, part) in [
        ("--max-rms x", "not a number"),
        ("--max-rms -1", "0 to 255"),
        ("--max-rms 256", "0 to 255"),
        ("--max-rms NaN", "0 to 255"),
        ("--max-bytes 5parsecs", "--max-bytes"),
        ("--max-bytes -5MB", "--max-bytes"),
        ("--max-bytes MB", "--max-bytes"),
        ("--max-rms 1 --max-distance 0", "above 0"),
        ("--max-rms 1 --max-distance -2", "above 0"),
        ("--max-rms 1 --max-distance nan", "above 0"),
        ("--max-rms 1 --for light", "ao, shadows"),
        ("--max-rms 1 --for", "--for"),
        ("--max-rms 1 --receivers some", "all, others, far"),
        // Tuning chooses what these would choose.
        ("--max-rms 1 --entries 65", "cannot be used with"),
        ("--exits 32 --max-bytes 1MB", "cannot be used with"),
        ("--max-rms 1 --encoding bit", "cannot be used with"),
        ("--max-rms 1 --bounds sphere", "cannot be used with"),
        ("--max-rms 1 --representation hemisphere", "chooses among two-point tables and distances"),
        // And these mean nothing without it.
        ("--for ao", "required"),
        ("--receivers far", "required"),
        ("--max-distance 2", "required"),
    ] {
        let output = visfield(folder.path(), &format!("bake a.obj {arguments}"));
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments}: {message}");
        assert!(message.contains(part), "{arguments}: {part:?} in {message}");
    }
    let help = text(&visfield(folder.path(), "bake --help").stdout);
    let parts = ["--max-rms <RMS>", "0 to 255", "500kB, 1.2MB or 4MiB", "mesh's units", "tuned by itself", "--for ao"];
    assert!(parts.iter().all(|part| help.contains(part)), "{help}");
}
