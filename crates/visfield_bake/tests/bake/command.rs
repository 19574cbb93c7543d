//! The command `visfield` as a shell sees it.

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use serde_json::json;
use visfield::distance::{DistanceGridFormat, DistancePrecision};
use visfield::field::cap_grid::{CapPrecision, Falloff, HarmonicOrder};
use visfield::{CapGridFormat, Representation, file};

use super::support::{glb, triangle_bytes, triangle_json};

fn visfield(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_visfield")).args(arguments).current_dir(folder).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

/// The one line that a failing command writes.
fn error(folder: &Path, arguments: &[&str]) -> String {
    let output = visfield(folder, arguments);
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{arguments:?}: {message}");
    assert!(message.starts_with("error: ") && message.trim_end().lines().count() == 1, "{message}");
    assert!(output.stdout.is_empty());
    message
}

const TETRAHEDRON: &str = "v 1 1 1\nv -1 -1 1\nv -1 1 -1\nv 1 -1 -1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";

#[test]
fn bake_then_inspect() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("shape.obj"), TETRAHEDRON).unwrap();
    let baked = visfield(folder, &["bake", "shape.obj"]);
    assert!(baked.status.success(), "{}", text(&baked.stderr));
    assert_eq!(text(&baked.stderr), "", "no progress bar in a pipe");
    let report = text(&baked.stdout);
    for part in [
        "Mesh0/Primitive0: 4 triangles",
        "65² × 32² = 4.33 MB",
        "M rays/s",
        "\n  cap grid 16³ in rgba8 = 16.38 kB, mean error 0.00",
        " around it, 0.",
        " inside its box\n  distances 64 voxels u8 = 262.14 kB, ",
        " s, at the surface at most 0.",
        " voxels too far\n",
        "shape.vfield: 1 field",
    ] {
        assert!(report.contains(part), "{part:?} in {report}");
    }
    let fields = file::read(&folder.join("shape.vfield")).unwrap();
    let table = fields[0].table().unwrap();
    assert_eq!((fields.len(), table.representation()), (1, Representation::TwoPoint { entries: 65, exits: 32 }));
    let grid = fields[0].cap_grid().unwrap().header();
    assert_eq!(grid.format, CapGridFormat::default());
    let distance = fields[0].distance_field().unwrap().grid().unwrap().header();
    assert_eq!((distance.format, distance.points), (DistanceGridFormat::DEFAULT, [64; 3]));
    assert!(grid.error.is_some_and(|error| error.outside > 0.0 && error.outside < 0.01), "{:?}", grid.error);

    let message = error(folder, &["report", "shape.vfield"]);
    let named = "shape.vfield: this is not JSON: ";
    assert!(message.contains(named) && message.contains("name files that `visfield measure … --json FILE` wrote"));

    let inspected = text(&visfield(folder, &["inspect", "shape.vfield"]).stdout);
    for part in [
        "format version 4",
        // All parts.
        "4.60 MB in memory",
        "Mesh0/Primitive0",
        "65² entries × 32² exits",
        "u8",
        "4,326,400 bytes",
        "radius 1.73",
        "16³ points, harmonics of order 1, rgba8, 16,384 bytes",
        "falloff          none",
        "inside its box: serves receivers inside it",
        "distances        64 × 64 × 64 points, 8 bits each, 262,144 bytes",
        // The box is 2 wide, with a voxel on either side.
        "voxel            0.0327",
        "range            -3.00 to 12.00 voxels",
        "excess           at the surface at most 0.",
        "rays             composite: the table for those from outside the bounds, distances for those from inside",
    ] {
        assert!(inspected.contains(part), "{part:?} in {inspected}");
    }
}

#[test]
fn only_the_parts_that_are_asked_for_are_baked() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("shape.obj"), TETRAHEDRON).unwrap();
    let small = ["bake", "shape.obj", "--representation"];
    let baked = |more: &[&str]| {
        let output = visfield(folder, &[&small, more].concat());
        assert!(output.status.success(), "{more:?}: {}", text(&output.stderr));
        (text(&output.stdout), file::read(&folder.join("shape.vfield")).unwrap().remove(0))
    };
    let (report, field) = baked(&["two-point", "--entries", "9", "--exits", "8"]);
    assert!(field.table().is_some() && field.cap_grid().is_none() && !report.contains("cap grid"), "{report}");
    assert!(field.distance_field().is_none() && !report.contains("distances"), "{report}");

    let caps = ["--points", "8", "--order", "3", "--precision", "rgba16f", "--falloff", "exponential=0.5"];
    let (report, field) = baked(&[&["cap-grid"], &caps[..]].concat());
    assert!(field.table().is_none() && !report.contains("triangles, table"), "{report}");
    let format = CapGridFormat {
        points: 8,
        order: HarmonicOrder::Three,
        precision: CapPrecision::F16,
        falloff: Falloff::Exponential { tau: 0.5 },
    };
    assert_eq!(field.cap_grid().unwrap().header().format, format);
    let inspected = text(&visfield(folder, &["inspect", "shape.vfield"]).stdout);
    for part in ["16.38 kB in memory", "harmonics of order 3", "rgba16f", "e^(−0.5·distance), distance in mesh units"]
    {
        assert!(inspected.contains(part), "{part:?} in {inspected}");
    }
    assert!(!inspected.contains("chords") && !inspected.contains("distances"), "{inspected}");

    let (report, field) = baked(&["distance", "--voxels", "16", "--distance-bits", "16"]);
    assert!(field.table().is_none() && field.cap_grid().is_none() && !report.contains("rays/s"), "{report}");
    assert!(report.starts_with("Mesh0/Primitive0: 4 triangles\n  distances 16 voxels u16 = 8.19 kB, "), "{report}");
    assert!(report.contains("note: without a table, distances answer all rays"), "{report}");
    let format = field.distance_field().unwrap().grid().unwrap().header().format;
    assert_eq!(format, DistanceGridFormat { voxels: 16, precision: DistancePrecision::U16 });
    let inspected = text(&visfield(folder, &["inspect", "shape.vfield"]).stdout);
    assert!(inspected.contains("16 × 16 × 16 points, 16 bits each") && !inspected.contains("composite"), "{inspected}");
    let (report, field) = baked(&["cap-grid,distance", "--points", "4", "--voxels", "8"]);
    assert!(field.table().is_none() && field.cap_grid().is_some() && field.distance_field().is_some(), "{report}");

    // Twice the flag, or a list.
    let (_, field) = baked(&["cap-grid", "--points", "4", "--representation", "hemisphere", "--positions", "50"]);
    assert!(matches!(field.table().unwrap().representation(), Representation::Hemisphere { positions: 50, .. }));
    assert_eq!(field.cap_grid().unwrap().header().format.points, 4);

    // A budget is the table's, and the cap grid stands beside it.
    let (report, field) = baked(&["two-point,cap-grid", "--max-bytes", "20kB", "--points", "4", "--receivers", "far"]);
    assert!(
        report.contains("chosen in") && report.contains("\n  cap grid 4³ in rgba8 = 256 B, mean error"),
        "{report}"
    );
    assert!(field.table().unwrap().format().bytes() <= 20_000 && !field.header().measured.is_empty());
    assert_eq!(field.cap_grid().unwrap().header().format.points, 4);
}

#[test]
fn a_grid_that_fails_inside_its_box_is_marked() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("shape.obj"), TETRAHEDRON).unwrap();
    let report =
        text(&visfield(folder, &["bake", "shape.obj", "--representation", "cap-grid", "--points", "4"]).stdout);
    assert!(
        report.contains(
            "note: the cap grid is wrong inside its box; receivers there are answered by distances or by a table"
        ),
        "{report}"
    );
    let inspected = text(&visfield(folder, &["inspect", "shape.vfield"]).stdout);
    assert!(inspected.contains("inside its box: not for receivers inside it"), "{inspected}");
}

#[test]
fn what_a_game_cannot_do_with_a_field_is_noted() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("shape.obj"), TETRAHEDRON).unwrap();
    let baked = |arguments: &[&str]| text(&visfield(folder, &[&["bake", "shape.obj"], arguments].concat()).stdout);
    assert!(!baked(&["--entries", "9", "--exits", "8"]).contains("note"));
    let bits = ["--entries", "9", "--exits", "8", "--encoding", "bit"];
    assert!(!baked(&bits).contains("note"), "distances stand beside them");
    let alone = ["--representation", "two-point"];
    assert!(baked(&[&bits[..], &alone].concat()).contains("note: bits know no distances"));
    // Its bounding radius is 1.73, in either shape.
    for (falloff, coarse) in
        [("linear=0.8", true), ("linear=0.9", false), ("exponential=1.2", true), ("exponential=1.1", false)]
    {
        for bounds in ["sphere", "ellipsoid"] {
            let caps = ["--representation", "cap-grid", "--points", "8", "--bounds", bounds, "--falloff", falloff];
            let report = baked(&caps);
            assert_eq!(report.contains("is coarse on a mesh of radius 1.73"), coarse, "{falloff}: {report}");
        }
    }
    let papers = ["--representation", "hemisphere", "--positions", "50", "--directions", "8", "--map", "polar"];
    assert!(baked(&papers).contains("games render two-point fields only"));
    let inspected = text(&visfield(folder, &["inspect", "shape.vfield"]).stdout);
    assert!(inspected.contains("hemisphere, 50 positions × 8² directions, Polar map"), "{inspected}");
}

#[test]
fn a_measurement_tells_all_and_becomes_a_page() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("shape.obj"), TETRAHEDRON).unwrap();
    let flags = ["--entries", "17", "--exits", "16", "--rays", "16", "--bounds", "ellipsoid", "--json", "ao.json"];
    let measured = visfield(folder, &[&["measure", "ao", "--mesh", "shape.obj"], &flags[..]].concat());
    assert!(measured.status.success(), "{}", text(&measured.stderr));
    assert!(text(&measured.stdout).contains("RMS × 255"));

    let json: serde_json::Value = serde_json::from_slice(&fs::read(folder.join("ao.json")).unwrap()).unwrap();
    for (name, value) in [
        ("mesh", json!("shape.obj")),
        ("triangles", json!(4)),
        ("representation", json!("two-point")),
        ("encoding", json!("u8")),
        ("bounds", json!("ellipsoid")),
        ("field_bytes", json!(17 * 17 * 16 * 16)),
        ("rays", json!(3 * 33 * 33 * 16)),
    ] {
        assert_eq!(json[name], value, "{name}");
    }
    let number = |name: &str| json[name].as_f64().unwrap_or_else(|| panic!("{name} in {json}"));
    for name in [
        "bake_seconds",
        "bake_rays_per_second",
        "rays_meeting_bounds",
        "occluded_fraction",
        "field_seconds",
        "bvh_seconds",
        "speedup",
        "speedup_meeting_bounds",
        "gather_limit_lookups_per_second",
        "lookups_per_second",
        "rms_255",
        "mean_abs",
        "max_abs",
        "mean_abs_truth",
    ] {
        assert!(number(name) > 0.0, "{name}");
    }
    assert!(number("bias_signed").abs() <= number("mean_abs") && number("mean_abs") <= number("max_abs"));
    assert!((number("speedup") - number("bvh_seconds") / number("field_seconds")).abs() < 1e-6);

    assert!(visfield(folder, &["report", "ao.json", "-o", "page.html"]).status.success());
    let page = fs::read_to_string(folder.join("page.html")).unwrap();
    assert!(page.contains("shape.obj") && page.contains("data:image/png;base64,"));
    let message = error(folder, &["measure", "ao", "--mesh", "shape.obj", "--json", "no/such/folder.json"]);
    assert!(message.contains("no/such/folder.json") && message.contains("folder does not exist"), "{message}");
    assert!(error(folder, &["measure", "ao", "--mesh", "shape.obj", "--json", "shape.obj"]).contains("overwritten"));
    assert!(error(folder, &["report", "ao.json", "-o", "ao.json"]).contains("overwritten"));
}

#[test]
fn a_cap_grid_is_measured_against_very_many_rays() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("shape.obj"), TETRAHEDRON).unwrap();
    let ask = ["measure", "ao", "--mesh", "shape.obj", "--representation"];
    let measured = |more: &[&str]| {
        let output = visfield(folder, &[&ask, more, &["--json", "ao.json"]].concat());
        assert!(output.status.success(), "{}", text(&output.stderr));
        let json: serde_json::Value = serde_json::from_slice(&fs::read(folder.join("ao.json")).unwrap()).unwrap();
        (text(&output.stdout), json)
    };
    let (report, caps) = measured(&["cap-grid", "--points", "8", "--precision", "rgba16f", "--rays", "16"]);
    for (name, value) in [
        ("representation", json!("cap-grid")),
        ("size", json!("8³")),
        ("encoding", json!("rgba16f")),
        ("bounds", json!("box")),
        ("aim", json!("none")),
        ("field_bytes", json!(8 * 8 * 8 * 8)),
        ("receivers", json!(3 * 33 * 33)),
        ("rays", json!(3 * 33 * 33 * 16)),
    ] {
        assert_eq!(caps[name], value, "{name}");
    }
    let number = |name: &str| caps[name].as_f64().unwrap_or_else(|| panic!("{name} in {caps}"));
    assert_eq!(number("mean_abs"), number("mean_abs_truth"), "there are no rays to compare with");
    assert!(number("mean_abs") < 0.02 && number("mean_abs") < number("exact_mean_abs_truth"), "16 rays are noisier");
    let each = number("nanoseconds_per_receiver_and_object");
    assert!((each * 1e-9 * number("receivers") / number("field_seconds") - 1.0).abs() < 1e-6);
    assert!((number("lookups_per_second") * each * 1e-9 - 1.0).abs() < 1e-6);
    let table = number("table_nanoseconds_per_receiver");
    let ratio = format!("64 rays through a 65² × 32² table cost {:.1}× as much", table / each);
    assert!(report.contains(&ratio) && report.contains("against the truth"), "{ratio} in {report}");

    let (report, rays) = measured(&["two-point", "--entries", "9", "--exits", "8", "--rays", "16"]);
    assert_eq!(rays["encoding"], "u8");
    let keys = |json: &serde_json::Value| -> Vec<String> { json.as_object().unwrap().keys().cloned().collect() };
    let mut more = keys(&caps);
    more.retain(|key| !keys(&rays).contains(key));
    assert_eq!(more, ["nanoseconds_per_receiver_and_object", "table_nanoseconds_per_receiver"], "else the same keys");
    assert!(report.contains("against the truth") && rays["mean_abs_truth"].as_f64() > rays["mean_abs"].as_f64());

    // The truth fades as the grid does; without it nearly all would count as an error.
    let (_, fading) = measured(&["cap-grid", "--points", "8", "--falloff", "exponential=3"]);
    assert!(fading["mean_abs"].as_f64().unwrap() < 0.03, "{}", fading["mean_abs"]);
    assert!(fading["occluded_fraction"].as_f64().unwrap() < 0.5 * number("occluded_fraction"));

    let message = error(folder, &["measure", "shadow", "--mesh", "shape.obj", "--representation", "cap-grid"]);
    assert!(message.contains("shape.obj: nothing in it answers rays"), "{message}");
}

#[test]
fn distances_are_measured_alone_and_beside_a_table() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("shape.obj"), TETRAHEDRON).unwrap();
    let measured = |what: &str, more: &[&str]| {
        let output = visfield(folder, &[&["measure", what, "--mesh", "shape.obj", "--json", "m.json"], more].concat());
        assert!(output.status.success(), "{}", text(&output.stderr));
        let json: serde_json::Value = serde_json::from_slice(&fs::read(folder.join("m.json")).unwrap()).unwrap();
        (text(&output.stdout), json)
    };
    let few = ["--rays", "16", "--scene", "self"];
    for what in ["ao", "shadow"] {
        let alone = ["--representation", "distance", "--voxels", "16"];
        let (_, json) = measured(what, &[&few[..], &alone].concat());
        for (name, value) in [
            ("representation", json!("distance")),
            ("size", json!("16 voxels")),
            ("encoding", json!("u8")),
            ("bounds", json!("box")),
            ("aim", json!("traced")),
            ("field_bytes", json!(4096)),
        ] {
            assert_eq!(json[name], value, "{what}: {name}");
        }
        assert!(
            json["speedup"].as_f64().unwrap() > 0.0 && json["gather_limit_lookups_per_second"].as_f64().unwrap() > 0.0
        );
        let both = ["--representation", "two-point,distance", "--entries", "9", "--exits", "8", "--encoding", "bit"];
        let (report, json) = measured(what, &[&few[..], &both, &["--voxels", "16"]].concat());
        assert!(report.contains("two-point + distance 9² × 8² + 16 voxels, bit + u8, sphere"), "{report}");
        assert_eq!(json["aim"], "point");
        // On the mesh itself, distances answer everything.
        let (_, table) = measured(what, &[&few[..], &both[2..6], &["--encoding", "bit"]].concat());
        assert!(what == "shadow" || json["rms_255"].as_f64().unwrap() < 0.1 * table["rms_255"].as_f64().unwrap());
    }

    let (report, json) = measured("distance", &["--voxels", "24", "--points", "3000"]);
    for (name, value) in [
        ("kind", json!("distance")),
        ("mesh", json!("shape.obj")),
        ("grid", json!([24, 24, 24])),
        ("encoding", json!("u8")),
        ("field_bytes", json!(24 * 24 * 24)),
    ] {
        assert_eq!(json[name], value, "{name}");
    }
    let points = |kind: &str| json[kind]["points"].as_u64().unwrap();
    assert_eq!((points("all") + json["clamped"].as_u64().unwrap(), points("surface")), (3000, 3000));
    assert!(report.contains("24 × 24 × 24 distances in u8") && report.contains("within a voxel"), "{report}");
    assert!(visfield(folder, &["report", "m.json", "-o", "page.html"]).status.success());
    let page = fs::read_to_string(folder.join("page.html")).unwrap();
    assert!(page.contains("Distances: shape.obj") && page.contains("beyond the excess"));
}

#[test]
fn several_objects_are_measured_by_every_rule() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("a.obj"), TETRAHEDRON).unwrap();
    fs::write(folder.join("b.obj"), TETRAHEDRON).unwrap();
    let ask =
        ["measure", "many", "--meshes", "a.obj,b.obj", "--instances", "3", "--points", "8", "--json", "many.json"];
    let output = visfield(folder, &ask);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let json: serde_json::Value = serde_json::from_slice(&fs::read(folder.join("many.json")).unwrap()).unwrap();
    for (name, value) in [
        ("kind", json!("many")),
        ("mesh", json!("a.obj, b.obj")),
        ("instances", json!(3)),
        ("triangles", json!(12)),
        ("cap_grid", json!("8³ in rgba8")),
        ("field_bytes", json!(2048)),
        ("receivers", json!(48 * 48 + 2 * 12 * 48)),
    ] {
        assert_eq!(json[name], value, "{name}");
    }
    let rules = json["rules"].as_array().unwrap();
    let number = |rule: usize, name: &str| rules[rule][name].as_f64().unwrap_or_else(|| panic!("{name} in {json}"));
    let report = text(&output.stdout);
    for (index, rule) in [
        "cap grids, product",
        "cap grids, soft caps in 8 directions",
        "cap grids, soft caps in 16 directions",
        "product of exact occlusions",
        "64 rays through tables",
    ]
    .into_iter()
    .enumerate()
    {
        assert!(rules[index]["rule"] == rule && report.contains(rule), "{rule} in {report}");
        let [mean, max, rms] = ["mean_abs", "max_abs", "rms_255"].map(|name| number(index, name));
        assert!(mean > 0.0 && mean < 0.03 && mean <= max && rms > 0.0, "{rule}: {mean}, {max}, {rms}");
        assert!(number(index, "bias_signed").abs() <= mean);
        assert!(number(index, "nanoseconds_per_receiver_and_object") > 0.0);
    }
    // Very many rays for each object cost thousands of times as much, and 64 have their noise.
    let time = |rule: usize| number(rule, "nanoseconds_per_receiver_and_object");
    assert!(time(3) > 100.0 * time(0) && number(4, "mean_abs") > number(3, "mean_abs"));

    assert!(error(folder, &["measure", "many", "--meshes", "a.obj,c.obj"]).contains("c.obj: No such file"));
    let crowded = visfield(folder, &["measure", "many", "--meshes", "a.obj,b.obj,a.obj", "--instances", "2"]);
    let message = text(&crowded.stderr);
    assert!(crowded.status.code() == Some(2) && message.contains("3 meshes are more than the 2 objects"), "{message}");
    fs::write(folder.join("flat.obj"), "v 0 0 0\nf 1 1 1\n").unwrap();
    let message = error(folder, &["measure", "many", "--meshes", "a.obj,flat.obj"]);
    assert!(message.contains("flat.obj: flat.obj: all its triangles have zero area"), "{message}");
}

#[test]
fn all_sound_primitives_of_a_gltf_go_into_one_file() {
    let folder = tempfile::tempdir().unwrap();
    let mut json = triangle_json();
    let triangle = json["meshes"][0]["primitives"][0].clone();
    let mut points = triangle.clone();
    points["mode"] = json!(0);
    json["meshes"] = json!([{ "primitives": [triangle, points] }, { "primitives": [triangle] }]);
    fs::write(folder.path().join("three.glb"), glb(&json, &triangle_bytes())).unwrap();
    let arguments = ["bake", "three.glb", "-o", "out.vfield", "--entries", "9", "--exits", "8"];
    let baked = visfield(folder.path(), &arguments);
    assert!(baked.status.success());
    let warning = text(&baked.stderr);
    assert!(warning.starts_with("warning: three.glb: left out: Mesh0/Primitive1: it has no triangles"), "{warning}");
    let names: Vec<String> =
        file::read(&folder.path().join("out.vfield")).unwrap().iter().map(|f| f.header().name.clone()).collect();
    assert_eq!(names, ["Mesh0/Primitive0", "Mesh1/Primitive0"]);

    // Two triangles of zero area: a warning for each, then the error.
    let flat = [0; 44];
    json["meshes"] = json!([{ "primitives": [triangle, triangle] }]);
    fs::write(folder.path().join("flat.glb"), glb(&json, &flat)).unwrap();
    let refused = visfield(folder.path(), &["bake", "flat.glb"]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(text(&refused.stderr).ends_with("error: flat.glb: none of its 2 meshes can be baked, see the warnings\n"));
    assert!(!folder.path().join("flat.vfield").exists());
}

#[test]
fn every_failure_is_one_line_that_names_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let write = |name: &str, content: &[u8]| fs::write(folder.join(name), content).unwrap();
    write("good.obj", TETRAHEDRON.as_bytes());
    write("empty.obj", b"");
    write("text.glb", b"Dear reader");
    write("mesh.stl", b"solid");
    write("nan.obj", b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    write("flat.obj", b"v 0 0 0\nf 1 1 1\n");
    write("points.obj", b"v 0 0 0\n");
    write("range.obj", b"v 0 0 0\nf 1 1 7\n");
    write("cut.glb", &glb(&triangle_json(), &triangle_bytes())[..100]);
    for (mesh, part) in [
        ("missing.obj", "No such file"),
        ("empty.obj", "the file is empty"),
        ("text.glb", "not glTF"),
        ("mesh.stl", "only .glb, .gltf and .obj"),
        ("nan.obj", "not finite"),
        ("flat.obj", "zero area"),
        ("points.obj", "no triangles"),
        ("range.obj", "out of bounds"),
        ("cut.glb", "cut short"),
    ] {
        let message = error(folder, &["bake", mesh]);
        assert!(message.contains(mesh) && message.contains(part), "{message}");
    }
    for (output, part) in [("no/such/folder.vfield", "folder does not exist"), ("good.obj", "overwritten"), (".", "-o")]
    {
        let message = error(folder, &["bake", "good.obj", "-o", output]);
        assert!(message.contains(output) && message.contains(part), "{message}");
    }
    assert!(
        error(folder, &["bake", "good.obj", "--entries", "512", "--exits", "512"])
            .contains("choose fewer entries or exits")
    );
    assert_eq!(fs::read(folder.join("good.obj")).unwrap(), TETRAHEDRON.as_bytes());
    assert!(fs::read_dir(folder).unwrap().all(|e| e.unwrap().path().extension().unwrap() != "vfield"), "no half files");
}

#[test]
fn inspect_tells_damage_apart() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("good.obj"), TETRAHEDRON).unwrap();
    assert!(visfield(folder, &["bake", "good.obj", "--entries", "5", "--exits", "4"]).status.success());
    let good = fs::read(folder.join("good.vfield")).unwrap();
    let inspect_changed = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut bytes = good.clone();
        change(&mut bytes);
        fs::write(folder.join("bad.vfield"), bytes).unwrap();
        error(folder, &["inspect", "bad.vfield"])
    };
    for (message, part) in [
        (error(folder, &["inspect", "missing.vfield"]), "missing.vfield: No such file"),
        (error(folder, &["inspect", "good.obj"]), "good.obj: this is not a .vfield file"),
        (inspect_changed(&|bytes| bytes.clear()), "not a .vfield file"),
        (inspect_changed(&|bytes| bytes[8] = 99), "bad.vfield: format version 99"),
        (inspect_changed(&|bytes| *bytes.last_mut().unwrap() ^= 1), "bad.vfield: the checksum does not match"),
        (inspect_changed(&|bytes| bytes.truncate(100)), "bad.vfield: the file is cut short"),
    ] {
        assert!(message.contains(part), "{part:?} in {message}");
    }
}

#[test]
fn usage_is_checked_and_explained() {
    let folder = tempfile::tempdir().unwrap();
    for arguments in
        [&[][..], &["bake"], &["nonsense"], &["bake", "a.obj", "--entries", "0"], &["bake", "a.obj", "--exits", "513"]]
    {
        let output = visfield(folder.path(), arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        let message = text(&output.stderr);
        assert!(message.contains("Usage") || message.contains("1..=512"), "{message}");
    }
    for (arguments, part) in [
        (&["--points", "3"][..], "4..=64"),
        (&["--points", "65"], "4..=64"),
        (&["--order", "2"], "[possible values: 1, 3]"),
        (&["--precision", "rgba32f"], "[possible values: rgba8, rgba16f]"),
        (&["--falloff", "none=1"], "it has to be none, exponential=TAU or linear=DISTANCE"),
        (&["--falloff", "linear=-1"], "the distance has to be finite and above 0"),
        (&["--falloff", "exponential=inf"], "the rate per mesh unit has to be finite and above 0"),
        (&["--falloff", "linear=far"], "the distance \"far\" is not a number"),
        (&["--representation", "two-point,hemisphere"], "a field holds one table"),
        (&["--representation", "two-point,two-point"], "--representation names two-point twice"),
        (&["--representation", "cap-grid", "--representation", "cap-grid"], "names cap-grid twice"),
        (&["--representation", "hemisphere", "--entries", "9"], "--entries is for two-point tables"),
        (&["--directions", "8"], "--directions is for hemisphere tables"),
        (&["--representation", "two-point", "--points", "8"], "--points is for cap grids"),
        (&["--representation", "cap-grid", "--entries", "8"], "--entries is for tables"),
        (&["--representation", "cap-grid", "--max-rms", "2"], "--max-rms chooses among two-point tables and distances"),
        (&["--representation", "hemisphere", "--max-bytes", "2MB"], "--max-bytes chooses among two-point tables"),
        (&["--representation", "hemisphere,distance", "--max-bytes", "2MB"], "--max-bytes chooses among"),
        (&["--voxels", "7"], "8..=256"),
        (&["--voxels", "257"], "8..=256"),
        (&["--distance-bits", "12"], "[possible values: 8, 16]"),
        (&["--representation", "two-point,cap-grid", "--voxels", "64"], "--voxels is for distances"),
        (&["--representation", "two-point", "--distance-bits", "16"], "--distance-bits is for distances"),
        (&["--representation", "distance", "--entries", "8"], "--entries is for tables"),
        (&["--representation", "distance", "--points", "8"], "--points is for cap grids"),
        (&["--representation", "distance,distance"], "--representation names distance twice"),
        (&["--voxels", "8", "--max-rms", "2"], "cannot be used with"),
        (&["--entries", "8", "--max-rms", "2"], "cannot be used with"),
    ] {
        let output = visfield(folder.path(), &[&["bake", "a.obj"], arguments].concat());
        let message = text(&output.stderr);
        assert!(output.status.code() == Some(2) && message.contains(part), "{arguments:?}: {message}");
    }
    let output =
        visfield(folder.path(), &["measure", "ao", "--mesh", "a.obj", "--representation", "two-point,cap-grid"]);
    assert_eq!(output.status.code(), Some(2), "one way to answer is measured at a time");
    assert!(text(&output.stderr).contains("rays and cap grids are measured one at a time"));
    let help = text(&visfield(folder.path(), &["bake", "--help"]).stdout);
    assert!(
        ["Examples:", "1 to 512", ".vfield", "[default: 65]", "8 to 256", "0.26 MB at most"]
            .iter()
            .all(|part| help.contains(part)),
        "{help}"
    );
    let version = text(&visfield(folder.path(), &["--version"]).stdout);
    assert_eq!(version.trim(), format!("visfield {}", env!("CARGO_PKG_VERSION")));
}

#[test]
fn a_closed_pipe_is_no_error() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("good.obj"), TETRAHEDRON).unwrap();
    let mut child = Command::new(env!("CARGO_BIN_EXE_visfield"))
        .args(["bake", "good.obj", "--entries", "5", "--exits", "4"])
        .current_dir(folder.path())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // As `head` does once it has seen enough.
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(folder.path().join("good.vfield").exists());
}
