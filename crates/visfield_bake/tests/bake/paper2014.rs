//! The claims of the 2014 paper on sphere tracing: measured, written, read, and on a page.

use std::fs;
use std::process::Command;
use std::sync::{LazyLock, Mutex};

use visfield::distance::DistanceGridFormat;
use visfield_bake::Mesh;
use visfield_bake::measure::MeasurementDocument;
use visfield_bake::measure::paper2014::{Paper2014, Paper2014Question, RayKind, paper2014};
use visfield_bake::report::{ReportEntry, report};

use crate::cap_shapes::ball;

const NAME: &str = "<i>ball</i>";

static PAPER: LazyLock<Paper2014> = LazyLock::new(|| {
    let question = Paper2014Question {
        format: DistanceGridFormat { voxels: 24, ..DistanceGridFormat::DEFAULT },
        step: 48,
        grazing: 100,
        ambient: (4, 8),
        relaxations: vec![1.0, 1.2, 1.4],
        limits: vec![16, 64],
        ..Paper2014Question::new(true)
    };
    let mesh = Mesh { name: NAME.to_owned(), ..ball() };
    let furthest = Mutex::new(0.0_f64);
    let measured = paper2014(&mesh, &question, |share, _| {
        let mut furthest = furthest.lock().unwrap();
        assert!((*furthest..=1.0).contains(&share));
        *furthest = share;
    });
    assert!((furthest.into_inner().unwrap() - 1.0).abs() < 1e-9, "progress comes to its end");
    measured.unwrap()
});

#[test]
fn every_technique_is_measured_against_none() {
    let paper = &*PAPER;
    let rows = |scene: &str, kind: RayKind| {
        let rows = paper.relaxation.iter().filter(move |row| row.scene == scene && row.kind == kind);
        rows.collect::<Vec<_>>()
    };
    for (scene, kinds) in [
        ("city", &[RayKind::Camera, RayKind::Grazing][..]),
        ("jewel", &[RayKind::Camera, RayKind::Grazing, RayKind::Refraction]),
        ("grid", &[RayKind::Camera, RayKind::Grazing, RayKind::Ambient]),
    ] {
        for &kind in kinds {
            let set = rows(scene, kind);
            // ω = 1 is alike by both rules.
            assert_eq!(set.len(), 5, "{scene}, {kind}");
            assert!(set.iter().all(|row| row.rays > 10 && row.evaluations > 1.0 && row.seconds > 0.0), "{set:?}");
            assert!(set[4].evaluations < set[0].evaluations, "over-relaxation pays: {scene}, {kind}");
            assert!(set[4].evaluations < set[3].evaluations * 1.02, "ours is no worse: {scene}, {kind}");
            assert_eq!(set[0].flipped + set[0].moved, 0);
            // Few, but for rays that start so near an edge of the jewel that they are outside.
            assert!(set.iter().all(|row| row.flipped <= 2 + row.rays / 100), "{set:?}");
        }
    }
    assert_eq!(paper.selection.len(), 3 * 2 * 3);
    assert_eq!(paper.escape.len(), 3 * 6);
    assert_eq!(paper.smoothing.len(), 3 * 5);
    assert_eq!((paper.convex.len(), paper.together.len()), (4, 6 + 8 + 8 + 6));
    let dynamic = paper.escape.iter().filter(|row| row.epsilon.is_none());
    assert!(dynamic.clone().count() == 3 && dynamic.clone().all(|row| row.stuck == 0), "at every scale");
    // How much smoothing leaves depends on how rays step.
    for scene in ["city", "jewel", "grid"] {
        let rows: Vec<_> = paper.smoothing.iter().filter(|row| row.scene == scene).collect();
        let difference = |steps| rows.iter().find(|row| row.smoothing == steps).map(|row| row.mean_step).unwrap();
        assert!(difference(3) < 0.5 * difference(0), "{scene}: {} {}", difference(3), difference(0));
    }
    for findings in [paper.escape_findings(), paper.convex_findings()] {
        assert!(!findings.is_empty());
        for finding in findings {
            assert!(finding.agrees, "{}", finding.text);
        }
    }
}

#[test]
fn findings_follow_the_numbers() {
    let mut paper = PAPER.clone();
    let all_agree = |findings: Vec<visfield_bake::measure::paper2008::Finding>| findings.iter().all(|f| f.agrees);
    for row in paper.escape.iter_mut().filter(|row| row.epsilon.is_none()) {
        row.stuck = row.rays / 20;
    }
    assert!(!all_agree(paper.escape_findings()));
    for row in &mut paper.smoothing {
        row.mean_step = 0.5;
    }
    assert!(!all_agree(paper.smoothing_findings()));
    for row in &mut paper.convex {
        row.back_evaluations = row.inside_evaluations + 1.0;
    }
    assert!(!all_agree(paper.convex_findings()));
    for row in &mut paper.selection {
        row.pixels_off = row.pixels_off.map(|_| if row.choice == "nearest" { 9.0 } else { 1.0 });
    }
    assert!(!all_agree(paper.selection_findings()));
    for row in &mut paper.together {
        row.evaluations = 7.0;
    }
    assert!(!all_agree(paper.together_findings()));
    assert!(!paper.table().contains("NaN"));
}

#[test]
fn it_is_written_read_and_reported() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("measured.json");
    let document = MeasurementDocument::Paper2014(Box::new(PAPER.clone()));
    document.write(&path).unwrap();
    let value: serde_json::Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    assert_eq!((&value["kind"], &value["mesh"]), (&"paper2014".into(), &NAME.into()));
    let MeasurementDocument::Paper2014(read) = MeasurementDocument::read(&path).unwrap() else { panic!() };
    assert_eq!(read.table(), PAPER.table());
    assert_eq!(read.pictures, PAPER.pictures);

    let page = report(&[ReportEntry { file: "measured.json".to_owned(), document }]);
    for part in ["The claims of the 2014 paper", "\u{a7}3.4: discontinuity reduction", "paper: city", "&lt;i&gt;ball"] {
        assert!(page.contains(part), "{part}");
    }
    assert!(!page.contains(NAME));
    assert_eq!(page.matches("src=\"data:image/png;base64,").count(), 6);
}

#[test]
fn it_is_the_same_every_time() {
    let mesh = ball();
    let question = Paper2014Question {
        format: DistanceGridFormat { voxels: 8, ..DistanceGridFormat::DEFAULT },
        step: 160,
        grazing: 10,
        ambient: (2, 4),
        relaxations: vec![1.0, 1.4],
        limits: vec![16],
        scales: vec![1.0],
        smoothing: vec![0, 3],
    };
    let measured = || {
        let mut paper = paper2014(&mesh, &question, |_, _| ()).unwrap();
        paper.relaxation.iter_mut().for_each(|row| row.seconds = 1.0);
        paper.convex.iter_mut().for_each(|row| (row.inside_seconds, row.back_seconds) = (1.0, 1.0));
        paper.together.iter_mut().for_each(|row| row.seconds = 1.0);
        paper
    };
    let [first, second] = [measured(), measured()];
    assert_eq!(first.table(), second.table());
    assert_eq!(first.pictures, second.pictures);
}

#[test]
fn the_command_prints_it() {
    let folder = tempfile::tempdir().unwrap();
    let text = "v 1 1 1\nv -1 -1 1\nv -1 1 -1\nv 1 -1 -1\nf 1 2 3\nf 1 4 2\nf 1 3 4\nf 2 4 3\n";
    fs::write(folder.path().join("shape.obj"), text).unwrap();
    let arguments = ["measure", "paper2014", "--quick", "--mesh", "shape.obj", "--json", "paper.json"];
    let output =
        Command::new(env!("CARGO_BIN_EXE_visfield")).args(arguments).current_dir(folder.path()).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    for part in ["\u{a7}3.1: over-relaxation", "To be reached: 15 %", "dodecahedron", "[agrees]"] {
        assert!(text.contains(part), "{part}\n{text}");
    }
    assert!(folder.path().join("paper.json").exists());
}
