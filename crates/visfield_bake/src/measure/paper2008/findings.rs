//! In words, from the numbers: where the shape of the paper's results agrees with ours, and where it does not.

use visfield::field::directions::DirectionMap;

use super::published::{FIGURE7_RMS_255, FIGURE8, PublishedCell, figure6};
use super::{Paper2008, TableSize};

/// One statement of the paper, checked.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// Whether ours agrees.
    pub agrees: bool,
    /// What the paper says, what was measured, and a likely reason if they differ.
    pub text: String,
}

impl Finding {
    /// `why` is only said where they differ. Nothing here measures reasons, so it is called likely.
    pub(in crate::measure) fn new(agrees: bool, text: String, why: &str) -> Self {
        let text = if agrees || why.is_empty() { text } else { format!("{text} Likely reason: {why}") };
        Self { agrees, text }
    }
}

/// Bakes and look-ups count as constant, or as in proportion, within this factor: caches, and rays that meet nothing, move
/// them by as much.
const SAME: f64 = 2.0;

/// The largest share of a series by which it may change and still be said to stay.
const BARELY: f64 = 0.15;

/// Difference of mean occlusion that counts as brighter, in steps of 255 levels.
const BRIGHTER: f64 = 0.1;

impl Paper2008 {
    /// Figure 5: which layout of directions is the best.
    pub fn figure5_findings(&self) -> Vec<Finding> {
        let rms = |map| self.figure5.iter().find(|row| row.map == map).map(|row| row.measured.error.rms_255);
        let (Some(uniform), Some(concentric)) = (rms(DirectionMap::Uniform), rms(DirectionMap::Concentric)) else {
            return Vec::new();
        };
        let best = self.figure5.iter().min_by(|a, b| a.measured.error.rms_255.total_cmp(&b.measured.error.rms_255));
        let best = best.map_or(DirectionMap::Concentric, |row| row.map);
        vec![
            Finding::new(
                concentric < uniform * (1.0 - BARELY),
                format!(
                    "The paper: the concentric map gives a much better picture than uniform directions. Here its RMS is \
                     {concentric:.2}, that of uniform ones {uniform:.2} ({:+.0} %).",
                    (concentric / uniform - 1.0) * 100.0
                ),
                &format!(
                    "here all layouts answer the same rays, and the shift to the nearest position costs more than any of them. \
                     The paper changes the rays too: 256 uniform ones, exact and weighted by their cosine, already differ by \
                     {:.2} from the reference.",
                    self.uniform_rays_rms_255
                ),
            ),
            Finding::new(
                best == DirectionMap::Concentric,
                format!(
                    "The paper: the concentric map is the best solution. Here the least error is that of {best:?}."
                ),
                "the layouts differ by less than the shift to the nearest position costs.",
            ),
        ]
    }

    /// Figure 6: what more positions and more directions cost and gain.
    pub fn figure6_findings(&self) -> Vec<Finding> {
        let (Some(first), Some(last)) = (self.figure6.first(), self.figure6.last()) else { return Vec::new() };
        vec![bakes_grow(first, last), queries_stay(first, last), self.positions_help(), self.directions_help()]
    }

    /// The RMS from the first to the last of a series, for each of the other axis' values.
    fn series(&self, fixed: impl Fn(&TableSize) -> u32) -> Vec<Vec<&TableSize>> {
        let mut values: Vec<u32> = self.figure6.iter().map(&fixed).collect();
        values.sort_unstable();
        values.dedup();
        values.iter().map(|&value| self.figure6.iter().filter(|row| fixed(row) == value).collect()).collect()
    }

    fn positions_help(&self) -> Finding {
        let columns = self.series(|row| row.directions);
        let falls = |column: &Vec<&TableSize>| {
            column.windows(2).all(|pair| pair[1].hemisphere.picture_rms_255 < pair[0].hemisphere.picture_rms_255)
        };
        Finding::new(
            columns.iter().all(falls),
            format!(
                "The paper: the error drops quickly with more positions. RMS of the picture from the fewest to the most: {}.",
                columns
                    .iter()
                    .map(|column| ends(column, |row| format!("{}\u{b2}", row.directions)))
                    .collect::<Vec<_>>()
                    .join("; ")
            ),
            "",
        )
    }

    fn directions_help(&self) -> Finding {
        let rows = self.series(|row| row.positions);
        let fall = |row: &[&TableSize]| {
            let [first, last] = [row[0], row[row.len() - 1]].map(|cell| cell.hemisphere.picture_rms_255);
            1.0 - last / first
        };
        let last = rows.last().map_or(0.0, |row| fall(row));
        let list =
            rows.iter().map(|row| ends(row, |row| format!("{} maps", row.positions))).collect::<Vec<_>>().join("; ");
        Finding::new(
            last < BARELY,
            format!(
                "The paper: more directions hardly lower the error. RMS of the picture from the fewest to the most: {list}."
            ),
            &format!(
                "where positions are many, the shift to the nearest one is small, and the width of a direction cell is what is \
                 left. Over receivers, without the picture's interpolation, the error of the most maps goes from {}.",
                rows.last().map_or(String::new(), |row| ends_of(row, |cell| cell.hemisphere.error.rms_255))
            ),
        )
    }

    /// Figure 7: what one bit loses.
    pub fn figure7_findings(&self) -> Vec<Finding> {
        let (bit, byte) = (&self.figure7.bit, &self.figure7.byte);
        let darker = (bit.error.bias_signed - byte.error.bias_signed) * 255.0;
        let paper = figure6(self.figure7.positions, self.figure7.directions);
        let paper = paper.map_or(String::new(), |cell| format!(" after {:.2} with bytes", cell.rms_255));
        vec![
            Finding::new(
                bit.picture_rms_255 > byte.picture_rms_255 * SAME,
                format!(
                    "The paper: one bit gives comparable pictures with a larger RMS, {FIGURE7_RMS_255:.2}{paper}. Here {:.2} \
                     after {:.2}.",
                    bit.picture_rms_255, byte.picture_rms_255
                ),
                "rays without end ask whether anything is hit, which a bit knows as well as a byte; only receivers inside of \
                 the bounding sphere need distances. The paper's visibility depends on the distance of a hit, and there a bit \
                 knows only the mean.",
            ),
            Finding::new(
                darker < -BRIGHTER,
                format!(
                    "The paper: bits are slightly brighter. Here their mean occlusion is {darker:+.3} of 255 levels from that of \
                     bytes; {} receivers differ, {} lie in the sphere.",
                    self.figure7.receivers_that_differ, self.figure7.receivers_inside
                ),
                if self.figure7.receivers_that_differ == 0 {
                    "bits and bytes answer alike but for receivers in the sphere, and of those none differs."
                } else if darker > BRIGHTER {
                    "outside of the sphere bits and bytes are alike; for receivers inside, the mean distance that a bit knows \
                     hides less than it occludes."
                } else {
                    "outside of the sphere bits and bytes are alike, and the few receivers inside err both ways."
                },
            ),
        ]
    }

    /// Figure 8: how costs depend on models.
    pub fn figure8_findings(&self) -> Vec<Finding> {
        let (Some(small), Some(large)) = (self.figure8.first(), self.figure8.last()) else { return Vec::new() };
        let mut findings = Vec::new();
        if self.figure8.len() > 1 {
            let exact = large.exact_seconds / small.exact_seconds;
            let asked = large.hemisphere.ao_seconds / small.hemisphere.ao_seconds;
            let more = f64::from(large.triangles) / f64::from(small.triangles);
            let paper = [&FIGURE8[0], &FIGURE8[2]];
            findings.push(Finding::new(
                asked < SAME && asked > 1.0 / SAME,
                format!(
                    "The paper: the time with maps hardly grows with the model. Here {more:.0}\u{d7} the triangles take \
                     {asked:.2}\u{d7} the time (paper: {:.2}\u{d7} for {:.1}\u{d7}).",
                    paper[1].ao_seconds / paper[0].ao_seconds,
                    f64::from(paper[1].triangles) / f64::from(paper[0].triangles)
                ),
                "it follows how many rays meet the bounding sphere, which depends on how the mesh stands on the floor; and these times \
                 need a machine on which nothing else runs.",
            ));
            findings.push(Finding::new(
                exact > more / SAME,
                format!(
                    "The paper: ray casting grows with the triangles, {:.1}\u{d7} for {:.1}\u{d7}. Here exact rays take \
                     {exact:.2}\u{d7} for {more:.0}\u{d7}.",
                    paper[1].exact_seconds / paper[0].exact_seconds,
                    f64::from(paper[1].triangles) / f64::from(paper[0].triangles)
                ),
                "a bounding volume hierarchy grows with the logarithm of the triangles; the paper's ray caster did not.",
            ));
        }
        findings.push(speedups(self));
        findings.extend(several_objects(self));
        findings
    }
}

fn bakes_grow(first: &TableSize, last: &TableSize) -> Finding {
    let rays = |row: &TableSize| f64::from(row.positions) * f64::from(row.directions).powi(2);
    let grown = last.hemisphere.bake_seconds / first.hemisphere.bake_seconds;
    let ratio = grown / (rays(last) / rays(first));
    Finding::new(
        (1.0 / SAME..SAME).contains(&ratio),
        format!(
            "The paper: pre-processing is a function of the sampling resolution. Here {:.0}\u{d7} the rays take \
             {grown:.0}\u{d7} the time{}.",
            rays(last) / rays(first),
            papers_growth(first, last, 0, |cell| cell.bake_seconds)
        ),
        if ratio < 1.0 {
            "the smallest table takes no longer than preparing the triangles, whatever its size."
        } else {
            "the largest table is written to slower memory, or something else ran on the machine meanwhile."
        },
    )
}

fn queries_stay(first: &TableSize, last: &TableSize) -> Finding {
    let ours = last.hemisphere.ao_seconds / first.hemisphere.ao_seconds;
    let two_point = last.two_point.ao_seconds / first.two_point.ao_seconds;
    Finding::new(
        (1.0 / SAME..SAME).contains(&ours),
        format!(
            "The paper: the time for ambient occlusion hardly depends on the table. Here it is {ours:.2}\u{d7} from {} to \
             {}{}, two-point tables {two_point:.2}\u{d7}.",
            first.hemisphere.size,
            last.hemisphere.size,
            papers_growth(first, last, 2, |cell| cell.ao_seconds)
        ),
        if ours < 1.0 {
            "something else ran on the machine while the smaller table was asked: nothing makes a larger one faster."
        } else {
            "a larger table leaves one processor cache after the other, and beside the little arithmetic that is left, that \
             shows."
        },
    )
}

/// How much more the paper's last cell takes than its first, in brackets, if it has both.
fn papers_growth(first: &TableSize, last: &TableSize, digits: usize, value: fn(&PublishedCell) -> f64) -> String {
    match [first, last].map(|row| figure6(row.positions, row.directions)) {
        [Some(first), Some(last)] => format!(" (paper: {:.digits$}\u{d7})", value(last) / value(first)),
        _ => String::new(),
    }
}

fn ends(series: &[&TableSize], name: impl Fn(&TableSize) -> String) -> String {
    let (first, last) = (series[0], series[series.len() - 1]);
    let paper = match [first, last].map(|row| figure6(row.positions, row.directions)) {
        [Some(a), Some(b)] => format!(" (paper {:.2} to {:.2})", a.rms_255, b.rms_255),
        _ => String::new(),
    };
    format!("{} {}{paper}", name(first), ends_of(series, |row| row.hemisphere.picture_rms_255))
}

fn ends_of(series: &[&TableSize], error: impl Fn(&TableSize) -> f64) -> String {
    format!("{:.2} to {:.2}", error(series[0]), error(series[series.len() - 1]))
}

fn speedups(paper2008: &Paper2008) -> Finding {
    let range = |ratios: Vec<f64>| {
        let (least, most) =
            (ratios.iter().copied().fold(f64::INFINITY, f64::min), ratios.iter().copied().fold(0.0, f64::max));
        (least, most)
    };
    let models = &paper2008.figure8;
    let papers = range(FIGURE8[..3].iter().map(|m| m.exact_seconds / m.ao_seconds).collect());
    let same = range(models.iter().map(|m| m.exact_seconds / m.hemisphere.ao_seconds).collect());
    let ours = range(models.iter().map(|m| m.exact_seconds / m.two_point.ao_seconds).collect());
    Finding::new(
        same.0 > 100.0,
        format!(
            "The paper: maps are {:.0} to {:.0} times faster than ray casting. Here its representation is {:.1} to {:.1} times \
             faster than exact rays, two-point tables {:.1} to {:.1} times.",
            papers.0, papers.1, same.0, same.1, ours.0, ours.1
        ),
        "rays through triangles became far faster than the paper's ray caster: a compressed wide hierarchy, and any hit ends a \
         ray.",
    )
}

fn several_objects(paper2008: &Paper2008) -> Option<Finding> {
    let several = paper2008.several.as_ref()?;
    let one =
        paper2008.figure8.iter().map(|model| model.hemisphere.ao_seconds).sum::<f64>() / paper2008.figure8.len() as f64;
    let rays = several.rays as f64 / paper2008.rays as f64;
    let time = several.hemisphere_seconds / one;
    let paper = (FIGURE8[3].rays as f64 / FIGURE8[1].rays as f64, FIGURE8[3].ao_seconds / FIGURE8[1].ao_seconds);
    let per_ray = (time / rays, paper.1 / paper.0);
    Some(Finding::new(
        per_ray.0 < SAME * per_ray.1,
        format!(
            "The paper: several objects cost as many times more as there are more rays, {:.1}\u{d7} the time for {:.1}\u{d7} the \
             rays. Here {time:.1}\u{d7} for {rays:.1}\u{d7}.",
            paper.1, paper.0
        ),
        "every ray asks three objects, its own one too, which the paper may leave out; and all rays of a receiver on an object \
         meet its sphere, while few of the corner's meet any.",
    ))
}
