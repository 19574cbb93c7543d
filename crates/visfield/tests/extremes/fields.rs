//! A field of every representation and encoding.

use visfield::field::ball;
use visfield::field::directions::DirectionMap;
use visfield::{ChordTable, Encoding, Representation, TableFormat, VisibilityField};

/// Both grids, the papers' one with every map of directions, and the smallest table there is.
fn representations() -> Vec<Representation> {
    let hemispheres =
        DirectionMap::ALL.into_iter().map(|map| Representation::Hemisphere { positions: 290, directions: 8, map });
    [(33, 17), (1, 1)]
        .into_iter()
        .map(|(entries, exits)| Representation::TwoPoint { entries, exits })
        .chain(hemispheres)
        .collect()
}

/// For every representation and encoding a small ball, one that nearly fills the unit sphere, and a field that knows no
/// surface but answers every chord anew, so that neighbouring cells have nothing in common.
pub(crate) fn fields() -> Vec<VisibilityField> {
    representations()
        .into_iter()
        .flat_map(|representation| Encoding::ALL.map(|encoding| (representation, encoding)))
        .flat_map(|(representation, encoding)| {
            [
                ball(0.5, representation, encoding),
                ball(0.9999, representation, encoding),
                scattered(representation, encoding),
            ]
        })
        .collect()
}

/// A field whose every chord has an answer of its own.
pub(crate) fn scattered(representation: Representation, encoding: Encoding) -> VisibilityField {
    let format = TableFormat { representation, encoding };
    let answer = |start: glam::Vec3, end: glam::Vec3| {
        let noise = (start.dot(glam::vec3(12.9, 78.2, 37.7)) + end.dot(glam::vec3(39.3, 11.1, 83.1))).sin() * 43758.5;
        // A third of the chords meets nothing, and a sixth begins or ends with a hit.
        (noise.fract().abs() < 0.67).then_some((noise.fract().abs() * 1.8 - 0.1).clamp(0.0, 1.0))
    };
    let table = ChordTable::sample(format, |blocks| blocks.into_iter().for_each(|mut block| block.fill(answer)))
        .expect("a ball of this format is valid too");
    ball(0.5, representation, encoding).with_table(table)
}
