//! Measurements of many fields, their files, pictures, and the report on them.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};
use std::sync::{LazyLock, Mutex};

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use visfield::CapGridFormat;
use visfield::distance::DistanceGridFormat;
use visfield_bake::measure::distance::{DistanceMeasurement, DistanceQuestion, measure_distance};
use visfield_bake::measure::document::{DocumentError, MeasurementDocument};
use visfield_bake::measure::many::{Many, ManyQuestion, measure_many};
use visfield_bake::measure::paper2008::{Paper2008, Paper2008Question, paper2008};
use visfield_bake::measure::picture::{Pictures, corner_pictures};
use visfield_bake::measure::tradeoff::{Sweep, Tradeoff, tradeoff};
use visfield_bake::measure::{AmbientQuestion, MeasureScene, ShadowQuestion, measure_ambient, measure_shadow};
use visfield_bake::report::{ReportEntry, report};
use visfield_bake::{BakeSettings, Mesh};

const HOSTILE: &str = "<script>alert(\"1\")</script>";

fn tetrahedron(name: &str) -> Mesh {
    Mesh {
        name: name.to_owned(),
        positions: vec![[1.0, 1.0, 1.0], [-1.0, -1.0, 1.0], [-1.0, 1.0, -1.0], [1.0, -1.0, -1.0]],
        indices: vec![[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]],
    }
}

/// Runs a measurement, and checks that its progress comes to an end.
fn to_the_end<T>(measure: impl FnOnce(&(dyn Fn(f64, &str) + Sync)) -> T) -> T {
    let furthest = Mutex::new(0.0_f64);
    let measured = measure(&|share, _| {
        assert!((0.0..=1.0).contains(&share));
        let mut furthest = furthest.lock().unwrap();
        *furthest = furthest.max(share);
    });
    let furthest = furthest.into_inner().unwrap();
    assert!(furthest > 0.97, "progress stops at {furthest}");
    measured
}

static TRADEOFF: LazyLock<Tradeoff> =
    LazyLock::new(|| to_the_end(|progress| tradeoff(&tetrahedron(HOSTILE), &Sweep::quick(), progress).unwrap()));

static PAPER: LazyLock<Paper2008> = LazyLock::new(|| {
    let question = Paper2008Question {
        sampling: (82, 16),
        positions: vec![50, 290],
        directions: vec![8, 16],
        bits: (290, 16),
        models: (290, 16),
        rays: 64,
        own_side: 4,
    };
    let others = [tetrahedron("second"), tetrahedron("third")];
    to_the_end(|progress| paper2008(&tetrahedron(HOSTILE), &others, &question, progress).unwrap())
});

const SMALL_CAPS: CapGridFormat = CapGridFormat { points: 8, ..CapGridFormat::DEFAULT };

static MANY: LazyLock<Many> = LazyLock::new(|| {
    let question = ManyQuestion { instances: 2, cap_grid: SMALL_CAPS, side: 8 };
    to_the_end(|progress| measure_many(&[tetrahedron(HOSTILE)], &question, progress).unwrap())
});

static DISTANCE: LazyLock<DistanceMeasurement> = LazyLock::new(|| {
    let format = DistanceGridFormat { voxels: 16, ..DistanceGridFormat::DEFAULT };
    let question = DistanceQuestion { format, points: 2000 };
    to_the_end(|progress| measure_distance(&tetrahedron(HOSTILE), &question, progress).unwrap())
});

/// One of each kind, and a cap grid.
static DOCUMENTS: LazyLock<[MeasurementDocument; 7]> = LazyLock::new(|| {
    let mesh = tetrahedron(HOSTILE);
    let bake = BakeSettings::two_point(9, 8);
    // Few receivers, because each of them costs thousands of rays of truth.
    let scene = MeasureScene::OwnSurface;
    let ambient = AmbientQuestion { bake, scene, rays: 16, speed: false, ..AmbientQuestion::default() };
    let ambient = measure_ambient(&mesh, &ambient).unwrap();
    let caps = BakeSettings::of_cap_grid(SMALL_CAPS);
    let caps = AmbientQuestion { bake: caps, scene, rays: 16, speed: true, ..AmbientQuestion::default() };
    let caps = measure_ambient(&mesh, &caps).unwrap();
    let shadow = ShadowQuestion { bake, scene, rays: 4, speed: true, ..ShadowQuestion::default() };
    let shadow = measure_shadow(&mesh, &shadow).unwrap();
    let pictures = corner_pictures(&mesh, &[0.1; 3 * 33 * 33], &[0.2; 3 * 33 * 33]).unwrap();
    [
        MeasurementDocument::Ambient { pictures: Some(Box::new(pictures)), measurement: Box::new(ambient) },
        MeasurementDocument::Shadow { pictures: None, measurement: Box::new(shadow) },
        MeasurementDocument::Paper2008(Box::new(PAPER.clone())),
        MeasurementDocument::Tradeoff(Box::new(TRADEOFF.clone())),
        MeasurementDocument::Many(Box::new(MANY.clone())),
        MeasurementDocument::Ambient { pictures: None, measurement: Box::new(caps) },
        MeasurementDocument::Distance(Box::new(DISTANCE.clone())),
    ]
});

/// JSON may change the last digit of a number.
fn rounded(value: serde_json::Value) -> serde_json::Value {
    use serde_json::Value;
    match value {
        Value::Number(number) => format!("{:.12e}", number.as_f64().unwrap()).into(),
        Value::Array(values) => values.into_iter().map(rounded).collect(),
        Value::Object(fields) => fields.into_iter().map(|(name, value)| (name, rounded(value))).collect(),
        other => other,
    }
}

#[test]
fn a_document_reads_as_it_was_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("measured.json");
    for (document, kind) in
        DOCUMENTS.iter().zip(["ambient", "shadow", "paper2008", "tradeoff", "many", "ambient", "distance"])
    {
        document.write(&path).unwrap();
        let read = MeasurementDocument::read(&path).unwrap();
        assert_eq!(rounded(serde_json::to_value(&read).unwrap()), rounded(serde_json::to_value(document).unwrap()));
        let value: serde_json::Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
        assert_eq!((&value["kind"], &value["visfield"]), (&kind.into(), &env!("CARGO_PKG_VERSION").into()));
        assert_eq!(value["mesh"], HOSTILE, "{kind}: the measurement's own fields are at the top");
    }
    let names: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(names, ["measured.json"], "nothing else is left behind");
    let nowhere = folder.path().join("no/such/folder.json");
    let error = DOCUMENTS[0].write(&nowhere).unwrap_err();
    assert!(matches!(&error, DocumentError::Write(_)) && error.to_string().contains("folder.json"), "{error}");
}

#[test]
fn a_report_has_every_kind_and_escapes_names() {
    let entry =
        |document: &MeasurementDocument| ReportEntry { file: "<b>.json".to_owned(), document: document.clone() };
    let page = report(&DOCUMENTS.iter().map(entry).collect::<Vec<_>>());
    for heading in [
        "Compared",
        "Ambient occlusion",
        "Soft shadow",
        "Figure 5",
        "Figure 8",
        "What accuracy costs",
        "Several objects",
        "Distances",
    ] {
        assert!(page.contains(heading), "{heading}");
    }
    let compared = page.split("<h2>").find(|section| section.starts_with("Compared")).unwrap();
    let scene = MeasureScene::OwnSurface;
    for part in [
        "ambient",
        "shadow, 0.0500 rad",
        &scene.to_string(),
        "8\u{b2}, u8, sphere",
        "<td>point</td>",
        "cap-grid 8\u{b3}, rgba8, box",
    ] {
        assert!(compared.contains(part), "rows cannot be told apart: {part}\n{compared}");
    }
    assert!(!page.contains("<script") && !page.contains("<b>.json"), "names are escaped");
    assert!(page.contains("&lt;script&gt;alert(&quot;1&quot;)"));
    assert!(
        page.contains("ambient occlusion by cap grids") && page.contains("cap-grid, no rays"),
        "series of their own"
    );
    let costs = "a receiver and object</td><td>";
    assert!(page.contains(costs) && page.contains("64 rays through a 65\u{b2} \u{d7} 32\u{b2} table"), "{costs}");
    for rule in &MANY.rules {
        assert!(page.contains(&rule.rule), "{}", rule.rule);
    }
    // Ambient: 3. Figure 5: 3 + 2 + 2 + 2. Figure 7: 3. Several objects: 3.
    assert_eq!(page.matches("src=\"data:image/png;base64,").count(), 18);
    assert_eq!(page.matches("<svg").count(), 7);
    // Without the pictures, in which any letters can follow each other.
    let text: String =
        page.split("base64,").map(|part| part.split_once("\" alt").map_or(part, |(_, rest)| rest)).collect();
    assert!(!text.contains("NaN") && !text.contains("inf"), "only numbers that were measured");
    let outside = page.replace("http://www.w3.org/2000/svg", "");
    assert!(["http:", "https:", "<link", "@import"].iter().all(|part| !outside.contains(part)), "self-contained");
}

fn visfield(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_visfield")).args(arguments).current_dir(folder).output().unwrap()
}

#[test]
fn the_command_reports_or_says_what_is_wrong_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    DOCUMENTS[0].write(&folder.join("good.json")).unwrap();
    let good = fs::read_to_string(folder.join("good.json")).unwrap();
    let version = format!("\"visfield\": \"{}\"", env!("CARGO_PKG_VERSION"));
    let changed = |from: &str, to: &str| {
        assert!(good.contains(from), "{from}");
        good.replacen(from, to, 1)
    };
    let newer = changed(&version, "\"visfield\": \"99.0.0\"").replacen("\"ambient\"", "\"clouds\"", 1);
    for (name, content, part) in [
        ("missing.json", None, "No such file"),
        ("empty.json", Some(String::new()), "not JSON"),
        ("text.json", Some("Dear reader".to_owned()), "not JSON"),
        ("cut.json", Some(good[..good.len() / 2].to_owned()), "not JSON"),
        ("list.json", Some("[1, 2]".to_owned()), "no measurement"),
        ("object.json", Some("{\"kind\": 3}".to_owned()), "no measurement"),
        ("clouds.json", Some(changed("\"ambient\"", "\"clouds\"")), "kind \"clouds\""),
        ("newer.json", Some(newer), "written by visfield 99.0.0"),
        ("damaged.json", Some(changed("\"triangles\": 4", "\"triangles\": \"four\"")), "damaged"),
        ("less.json", Some(changed("\"triangles\": 4,", "")), "missing field `triangles`"),
    ] {
        if let Some(content) = content {
            fs::write(folder.join(name), content).unwrap();
        }
        let output = visfield(folder, &["report", "good.json", name, "-o", "bad.html"]);
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{message}");
        assert!(message.starts_with(&format!("error: {name}: ")) && message.contains(part), "{message}");
        assert_eq!(message.trim_end().lines().count(), 1, "{message}");
    }
    assert!(!folder.join("bad.html").exists());
    let output = visfield(folder, &["report", "good.json", "-o", "no/such/folder.html"]);
    assert!(String::from_utf8(output.stderr).unwrap().contains("no/such/folder.html"));

    let output = visfield(folder, &["report", "good.json"]);
    assert_eq!(String::from_utf8(output.stdout).unwrap(), "report.html: 1 measurement\n");
    assert!(fs::read_to_string(folder.join("report.html")).unwrap().starts_with("<!DOCTYPE html>"));
}

#[test]
fn a_sweep_marks_what_nothing_beats() {
    let Tradeoff { points, .. } = &*TRADEOFF;
    // Two-point tables are asked in two ways, in two encodings, two bounds; distances alone, and beside a table in two encodings.
    assert_eq!(points.len(), (2 * 2 + 1) * 2 * 2 + 1 + 1 + 2);
    let front = |point: &&visfield_bake::measure::tradeoff::TradeoffPoint| point.pareto;
    assert!((1..points.len()).contains(&points.iter().filter(front).count()));
    let (caps, tables): (Vec<_>, Vec<_>) = points.iter().partition(|point| point.representation == "cap-grid");
    let caps = caps[0];
    let best = tables.iter().min_by(|a, b| a.corner.rms_255.total_cmp(&b.corner.rms_255)).unwrap();
    assert!(best.pareto, "nothing can beat it, and a cap grid answers no rays");
    assert!(caps.pareto, "nothing is as small");
    assert_eq!((caps.size.as_str(), caps.encoding.as_str(), caps.field_bytes), ("8\u{b3}", "rgba8", 2048));
    assert_eq!((caps.rays_per_second, caps.mean_abs_truth), (None, caps.corner.mean_abs));
    assert!(caps.own_surface.is_some());
    for point in &tables {
        assert_eq!(point.own_surface.is_none(), point.encoding == "bit", "{point:?}");
        assert!(point.rays_per_second.unwrap() > 1e4 && point.mean_abs_truth != point.corner.mean_abs);
    }
    for point in points {
        assert!(point.corner.rms_255 > 0.0 && point.corner.rms_255 < 30.0, "{point:?}");
        assert!(point.field_seconds > 0.0 && (0.0..0.1).contains(&point.mean_abs_truth));
    }
    let text = TRADEOFF.table();
    let distances: Vec<_> = tables.iter().filter(|point| point.representation.contains("distance")).collect();
    let names: Vec<_> = distances.iter().map(|point| (point.family(), point.encoding.as_str())).collect();
    let both = "two-point + distance, aimed".to_owned();
    assert_eq!(names, [("distance, traced".to_owned(), "u8"), (both.clone(), "bit + u8"), (both, "u8 + u8")]);
    let own = |index: usize| distances[index].own_surface.unwrap().rms_255;
    assert!(own(0) == own(1) && own(1) == own(2), "on the mesh itself, the table is not asked");
    let bytes = |index: usize| distances[index].field_bytes;
    assert!(bytes(0) == 32 * 32 * 32 && bytes(2) == bytes(0) + 17 * 17 * 16 * 16 && bytes(1) < bytes(2));
    for part in [
        "two-point, aimed",
        "distance, traced",
        "hemisphere, plain",
        "cap-grid, no rays",
        "mean error",
        "Cap grids send none",
    ] {
        assert!(text.contains(part), "{part} in {text}");
    }
}

#[test]
fn the_papers_experiments_run_on_any_mesh() {
    let paper = &*PAPER;
    assert_eq!((paper.figure5.len(), paper.figure6.len(), paper.figure8.len()), (4, 4, 3));
    let rms = |index: usize| paper.figure6[index].hemisphere.error.rms_255;
    assert!(rms(3) < rms(0), "finer tables are better: {} after {}", rms(3), rms(0));
    for row in &paper.figure6 {
        let ratio = row.two_point.field_bytes as f64 / row.hemisphere.field_bytes as f64;
        assert!((0.95..1.05).contains(&ratio), "tables of the same size: {ratio}");
    }
    assert!(paper.figure7.bit.field_bytes * 6 < paper.figure7.byte.field_bytes);
    // Bits know as much as bytes, but for receivers inside the bounds.
    assert!(paper.figure7.receivers_that_differ <= paper.figure7.receivers_inside);
    let several = paper.several.as_ref().unwrap();
    assert_eq!((several.triangles, several.receivers), (12, 3267 + 4 + 4));
    assert!(several.hemisphere_rms_255 < 15.0 && several.two_point_rms_255 < 15.0, "{several:?}");
    let text = paper.table();
    for part in ["Figure 5", "Figure 6", "Figure 7", "Figure 8", "paper: Igea", "[agrees]"] {
        assert!(text.contains(part), "{part}\n{text}");
    }
}

#[test]
fn reasons_fit_what_was_measured() {
    let mut paper = PAPER.clone();
    let last = paper.figure6.len() - 1;
    // The tables of `--quick`.
    (paper.figure6[0].positions, paper.figure6[0].directions) = (290, 32);
    (paper.figure6[last].positions, paper.figure6[last].directions) = (4226, 64);
    let mut growth = |bake: f64, asked: f64| {
        let first = paper.figure6[0].hemisphere.clone();
        let last = &mut paper.figure6[last].hemisphere;
        (last.bake_seconds, last.ao_seconds) = (first.bake_seconds * bake, first.ao_seconds * asked);
        let findings = paper.figure6_findings();
        assert!(findings[0].text.contains("paper: 52\u{d7}") && findings[1].text.contains("paper: 1.18\u{d7}"));
        [0, 1].map(|index| (findings[index].agrees, findings[index].text.clone()))
    };
    let [bakes, queries] = growth(58.0, 1.0);
    assert!(bakes.0 && queries.0 && !(bakes.1 + &queries.1).contains("reason"));
    let [bakes, queries] = growth(2.0, 0.1);
    assert!(!bakes.0 && bakes.1.contains("preparing the triangles"), "{}", bakes.1);
    assert!(!queries.0 && !queries.1.contains("cache"), "{}", queries.1);
    let [bakes, queries] = growth(500.0, 9.0);
    assert!(!bakes.0 && !bakes.1.contains("preparing the triangles"), "{}", bakes.1);
    assert!(!queries.0 && queries.1.contains("cache"), "{}", queries.1);
}

#[test]
fn no_rays_count_as_one() {
    let maps = (50, 8);
    let question = Paper2008Question {
        sampling: maps,
        positions: vec![50],
        directions: vec![8],
        bits: maps,
        models: maps,
        rays: 0,
        own_side: 1,
    };
    let others = [tetrahedron("second"), tetrahedron("third")];
    let paper = paper2008(&tetrahedron("first"), &others, &question, |_, _| ()).unwrap();
    let several = paper.several.as_ref().unwrap();
    assert_eq!((paper.rays, several.rays), (3267, several.receivers as u64));
    assert!(!paper.table().contains("NaN"), "{}", paper.table());
}

fn pixels(png: &str) -> image::GrayImage {
    image::load_from_memory(&BASE64_STANDARD.decode(png).unwrap()).unwrap().into_luma8()
}

#[test]
fn pictures_show_each_receiver_in_its_place() {
    let mesh = tetrahedron("");
    let draw = |occlusion: &dyn Fn(usize, usize, usize) -> f32| -> Pictures {
        let place = |i: usize| (i / (33 * 33), i / 33 % 33, i % 33);
        let exact: Vec<f32> =
            (0..3 * 33 * 33).map(place).map(|(square, row, column)| occlusion(square, row, column)).collect();
        corner_pictures(&mesh, &exact, &vec![0.0; 3 * 33 * 33]).unwrap()
    };
    // Below, right, left: floor, wall in −z, wall in −x.
    let places = [(240, 345), (420, 90), (60, 90)];
    for dark in 0..3 {
        let pictures = draw(&|square, _, _| f32::from(u8::from(square == dark)) * 0.1);
        let (exact, difference) = (pixels(&pictures.exact), pixels(&pictures.difference));
        for (square, (x, y)) in places.into_iter().enumerate() {
            let [exact, difference] = [&exact, &difference].map(|picture| picture.get_pixel(x, y).0[0]);
            // Five times the difference.
            let expected = if square == dark { (230, 128) } else { (255, 0) };
            assert_eq!((exact, difference), expected, "square {square} while {dark} is dark");
        }
    }
    // Along the floor: +x is to the right, +z to the left.
    let along_x = pixels(&draw(&|_, _, column| column as f32 / 64.0).exact);
    let along_z = pixels(&draw(&|_, row, _| row as f32 / 64.0).exact);
    let [left, right] = [(180, 320), (300, 320)];
    let at = |picture: &image::GrayImage, (x, y): (u32, u32)| picture.get_pixel(x, y).0[0];
    assert!(at(&along_x, left) > at(&along_x, right));
    assert!(at(&along_z, left) < at(&along_z, right));
}

#[test]
fn neither_units_nor_place_change_what_is_measured() {
    let corners = [[1.0, 1.0, 1.0], [-1.0, -1.0, 1.0], [-1.0, 1.0, -1.0], [1.0, -1.0, -1.0]];
    let measured = |scene, scale: f32, shift: f32| {
        let mesh = Mesh {
            name: "tetrahedron".to_owned(),
            positions: corners.map(|corner: [f32; 3]| corner.map(|x| (x + shift) * scale)).to_vec(),
            indices: vec![[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]],
        };
        let bake = BakeSettings::two_point(17, 16);
        let ask = AmbientQuestion { bake, scene, rays: 64, speed: false, ..AmbientQuestion::default() };
        measure_ambient(&mesh, &ask).unwrap()
    };
    for scene in [MeasureScene::Corner, MeasureScene::OwnSurface] {
        let here = measured(scene, 1.0, 0.0);
        for (scale, shift) in [(1e-15, 0.0), (1e15, 0.0), (1.0, 4096.0), (1e-6, -4096.0)] {
            let there = measured(scene, scale, shift);
            let apart = (there.rms_255 - here.rms_255).abs();
            assert!(
                apart < 0.1 + 0.05 * here.rms_255,
                "{scene}, {scale}, {shift}: {} and {}",
                there.rms_255,
                here.rms_255
            );
            assert!((there.occluded_fraction - here.occluded_fraction).abs() < 1e-3, "{scene}, {scale}, {shift}");
        }
    }
}
