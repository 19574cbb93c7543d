//! The 2012 thesis' scenes, coarsely: every estimator, the findings and the report.

use std::sync::LazyLock;

use visfield::distance::DistanceGridFormat;
use visfield_bake::measure::document::MeasurementDocument;
use visfield_bake::measure::paper2012::{EstimatorError, Paper2012, Paper2012Question, Place, names, paper2012};
use visfield_bake::report::{ReportEntry, report};
use visfield_bake::{Mesh, read_meshes};

use crate::support::asset;

static PAPER: LazyLock<Paper2012> = LazyLock::new(|| {
    let question = Paper2012Question {
        distance: DistanceGridFormat { voxels: 48, ..DistanceGridFormat::DEFAULT },
        rays: 256,
        side: 33,
        surface_side: 12,
        picture_rays: 4,
        ..Paper2012Question::default()
    };
    let read = |name: &str| Mesh { name: name.to_owned(), ..read_meshes(&asset(name, "glb")).unwrap().remove(0) };
    paper2012(&read("supershape"), &[read("torus_knot")], &question, |share, _| assert!((0.0..=1.0).contains(&share)))
        .unwrap()
});

fn of(rows: &'static [EstimatorError], scene: &str, estimator: &str, place: Place) -> &'static EstimatorError {
    let wanted =
        |row: &&EstimatorError| row.scene == scene && row.estimator.starts_with(estimator) && row.place == place;
    rows.iter().find(wanted).unwrap_or_else(|| panic!("{scene}, {estimator}"))
}

#[test]
fn rays_over_distances_are_right() {
    for (scene, most) in [("sphere", 0.02), ("box", 0.03), ("supershape", 0.04), ("supershape and box", 0.04)] {
        for (name, place) in
            [(names::RAYS, Place::Ground), (names::RAYS, Place::Objects), (names::GRID_RAYS, Place::Ground)]
        {
            let row = of(&PAPER.ambient, scene, name, place);
            assert!(row.affected > 80 && row.mean_abs < most, "{row:?}");
        }
        // From the ground below a box exact rays see its walls from inside, and ours are occluded at once.
        if !scene.contains("box") {
            let obscurance = of(&PAPER.ambient, scene, names::OBSCURANCE, Place::Ground);
            assert!(obscurance.mean_abs < most, "{obscurance:?}");
        }
    }
    // An open slope above a ground without end sees its share of it: exact on a ball.
    let slope = of(&PAPER.ambient, "sphere", names::SLOPE, Place::Objects);
    assert!(slope.mean_abs < 0.01, "{slope:?}");
}

#[test]
fn cheap_estimators_are_worse() {
    for scene in ["sphere", "box", "supershape", "torus_knot"] {
        for place in [Place::Ground, Place::Objects] {
            let [normal, rays] = [names::NORMAL, names::GRID_RAYS].map(|name| of(&PAPER.ambient, scene, name, place));
            assert!(normal.mean_abs > rays.mean_abs, "{normal:?} {rays:?}");
        }
        let [penumbra, cones] =
            [names::PENUMBRA, names::CONES].map(|name| of(&PAPER.shadows, scene, name, Place::Ground));
        assert!(penumbra.mean_abs > 2.0 * cones.mean_abs && cones.affected > 40, "{penumbra:?} {cones:?}");
    }
}

#[test]
fn cones_meet_what_is_aimed_at() {
    for scene in ["sphere", "box", "supershape", "torus_knot"] {
        let row = of(&PAPER.shadows, scene, names::CONES, Place::Ground);
        assert!(row.mean_abs < 0.025, "{row:?}");
    }
    // A penumbra factor makes the outer half of a penumbra and too much of it.
    let lights = format!("{}, the light's", names::PENUMBRA);
    assert!(of(&PAPER.shadows, "sphere", &lights, Place::Ground).bias_signed > 0.05);
    let hard = of(&PAPER.shadows, "sphere", names::HARD, Place::Ground);
    assert!(hard.mean_abs < 0.02, "{hard:?}");
}

#[test]
fn the_thesis_is_written_and_read() {
    let text = PAPER.table();
    println!("{text}");
    for part in ["along the normal (alg. 3.4), own settings", "supershape and box", "Section 3.4", "[agrees]"] {
        assert!(text.contains(part), "{part}");
    }
    assert!(!text.contains("NaN") && !text.contains("inf "));
    assert_eq!((PAPER.pictures.len(), PAPER.settings.len()), (10, 10));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("thesis.json");
    MeasurementDocument::Paper2012(Box::new(PAPER.clone())).write(&path).unwrap();
    let document = MeasurementDocument::read(&path).unwrap();
    let page = report(&[ReportEntry { file: "thesis.json".to_owned(), document }]);
    for part in ["The estimators of the 2012 thesis", names::BENT, "data:image/png;base64,"] {
        assert!(page.contains(part), "{part}");
    }
}
