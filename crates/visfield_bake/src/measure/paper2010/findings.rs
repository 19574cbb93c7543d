//! In words, from the numbers: where the shape of the paper's results agrees with ours, and where it does not.

use super::published::{FIGURE3, FIGURE5, FIGURE6_MILLISECONDS, FIGURE7, FIGURE8_MILLISECONDS_PER_RAY, published};
use super::{Paper2010, RaysTime, TableTime};
use crate::measure::paper2008::{Finding, Maps};

/// Times count as constant, or as in proportion, within this factor.
const SAME: f64 = 2.0;

/// The largest share of an error by which it may change and still be said to stay.
const BARELY: f64 = 0.15;

/// The paper's own-surface times, in those of other surfaces: "up to 4 times slower".
const OWN_SURFACE: f64 = 4.0;

fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, 0.0), |(least, most), value| (least.min(value), most.max(value)))
}

fn of(tables: &[TableTime], maps: Maps) -> Option<&TableTime> {
    tables.iter().find(|table| (table.positions, table.directions) == maps)
}

impl Paper2010 {
    /// Figure 3: what more maps and more directions cost and gain.
    pub fn figure3_findings(&self) -> Vec<Finding> {
        let mut findings = vec![times_stay(&self.figure3, (FIGURE3[0].milliseconds, FIGURE3[5].milliseconds))];
        let worse = |from: &TableTime| {
            let finer =
                self.figure3.iter().filter(|to| to.positions > from.positions && to.directions >= from.directions);
            finer.filter(|to| to.rms_255 >= from.rms_255).count()
        };
        findings.push(Finding::new(
            self.figure3.iter().all(|table| worse(table) == 0),
            format!("The paper: more maps lower the error. Here the RMS is {}.", errors(&self.figure3)),
            "",
        ));
        let equal = [(4226, 64), (16642, 32)];
        if let ([Some(a), Some(b)], [Some(c), Some(d)]) =
            (equal.map(|maps| of(&self.figure3, maps)), equal.map(|maps| published(&FIGURE3, maps)))
        {
            findings.push(Finding::new(
                (a.rms_255 / b.rms_255 - 1.0).abs() < BARELY,
                format!(
                    "The paper: 4226 maps of 64\u{b2} are as good as 16642 of 32\u{b2}, {:.2} and \
                     {:.2}. Here tables of these \
                     sizes have {:.2} and {:.2}.",
                    c.rms_255, d.rms_255, a.rms_255, b.rms_255
                ),
                "an aimed look-up forgives most of the shift to the nearest entry, and the width of the exits is what is \
                 left.",
            ));
        }
        findings
    }

    /// Figure 4: what more rays cost.
    pub fn figure4_findings(&self) -> Vec<Finding> {
        let growth = |table: &[RaysTime]| {
            let (first, last) = (&table[0], &table[table.len() - 1]);
            (last.seconds / first.seconds) / (f64::from(last.rays) / f64::from(first.rays))
        };
        let growths = self.figure4.chunk_by(|a, b| a.size == b.size).map(growth);
        let (least, most) = range(growths);
        vec![Finding::new(
            least > 1.0 / SAME && most < SAME,
            format!(
                "The paper's curves are straight: time grows with the rays, whatever the table. Here, \
                 from the fewest rays to the \
                 most, it grows {least:.2} to {most:.2} times as much as the rays do."
            ),
            "",
        )]
    }

    /// Figure 5: models that shade themselves.
    pub fn figure5_findings(&self) -> Vec<Finding> {
        let slower = range(self.figure5.iter().map(|model| model.seconds / model.corner_seconds));
        let (few, many) = (
            self.figure5.iter().min_by_key(|model| model.triangles),
            self.figure5.iter().max_by_key(|model| model.triangles),
        );
        let mut findings = vec![Finding::new(
            slower.0 > 1.0 && slower.1 < OWN_SURFACE * SAME,
            format!(
                "The paper: rays of the model itself take up to {OWN_SURFACE} times as long, because \
                 all of them meet its sphere. \
                 Here {:.1} to {:.1} times as long as rays of its corner.",
                slower.0, slower.1
            ),
            "a software adapter does the same work for rays that miss, so that there is nothing to save \
             in the corner.",
        )];
        if let (Some(few), Some(many)) = (few, many)
            && few.triangles < many.triangles
        {
            let ratio = few.rays_per_second / many.rays_per_second;
            findings.push(Finding::new(
                (1.0 / SAME..SAME).contains(&ratio),
                format!(
                    "The paper: time does not depend on the model's complexity; it has {:.0} to {:.0} M \
                     rays/s. Here {} with {} \
                     triangles has {:.1} M/s, {} with {} has {:.1} M/s.",
                    range(FIGURE5.iter().map(|model| model.rays_per_second)).0 * 1e-6,
                    range(FIGURE5.iter().map(|model| model.rays_per_second)).1 * 1e-6,
                    few.mesh,
                    few.triangles,
                    few.rays_per_second * 1e-6,
                    many.mesh,
                    many.triangles,
                    many.rays_per_second * 1e-6
                ),
                "something else ran on the machine: nothing in a look-up depends on it.",
            ));
        }
        findings
    }

    /// Figure 6: several occluders.
    pub fn figure6_findings(&self) -> Vec<Finding> {
        let Some(several) = &self.figure6 else { return Vec::new() };
        let passes: f64 = several.single_seconds.iter().sum();
        vec![Finding::new(
            several.seconds < passes,
            format!(
                "The paper: {FIGURE6_MILLISECONDS:.0} ms, blamed on one pass for each model. Here one \
                 pass over all takes {:.2} \
                 times as long as a pass for each.",
                several.seconds / passes
            ),
            "each thread asks all occluders in any case; a pass by itself saves only the making of rays.",
        )]
    }

    /// Figure 7: soft shadows by sizes of tables.
    pub fn figure7_findings(&self) -> Vec<Finding> {
        let mut findings = vec![times_stay(&self.figure7, (FIGURE7[0].milliseconds, FIGURE7[4].milliseconds))];
        let change = |from: Maps, to: Maps| {
            let ours = of(&self.figure7, from).zip(of(&self.figure7, to));
            let papers = published(&FIGURE7, from).zip(published(&FIGURE7, to));
            ours.zip(papers)
        };
        if let Some(((a, b), (c, d))) = change((4226, 32), (4226, 64)) {
            findings.push(Finding::new(
                b.rms_255 < a.rms_255,
                format!(
                    "The paper: more directions lower the error of shadows, {:.2} to {:.2}. Here {:.2} to {:.2}.",
                    c.rms_255, d.rms_255, a.rms_255, b.rms_255
                ),
                "",
            ));
        }
        if let Some(((a, b), (c, d))) = change((4226, 32), (16642, 32)) {
            findings.push(Finding::new(
                (b.rms_255 / a.rms_255 - 1.0).abs() < BARELY,
                format!(
                    "The paper: more maps do not, {:.2} to {:.2}. Here {:.2} to {:.2}.",
                    c.rms_255, d.rms_255, a.rms_255, b.rms_255
                ),
                "",
            ));
        }
        findings
    }

    /// Figure 8: several lights.
    pub fn figure8_findings(&self) -> Vec<Finding> {
        let [one, three] = &self.figure8[..] else { return Vec::new() };
        let ratio = (three.seconds / one.seconds) / (three.shadow_rays as f64 / one.shadow_rays as f64);
        let faster = three.rays_per_second / three.bvh_rays_per_second;
        let (field, triangles) = FIGURE8_MILLISECONDS_PER_RAY;
        vec![
            Finding::new(
                (1.0 / SAME..SAME).contains(&ratio),
                format!(
                    "The paper: time follows the shadow rays. Here {} lights take {:.2} times as long \
                     as {}, for {:.2} times the rays.",
                    three.lights,
                    three.seconds / one.seconds,
                    one.lights,
                    three.shadow_rays as f64 / one.shadow_rays as f64
                ),
                "",
            ),
            Finding::new(
                faster > triangles / field / SAME,
                format!(
                    "The paper: a shadow ray takes {:.0} times as long through its bounding volume \
                     hierarchy. Here {faster:.1} times, \
                     through a compressed wide one.",
                    triangles / field
                ),
                "any-hit rays through a compressed wide hierarchy are far faster than the paper's, \
                 and most rays of this scene miss it early.",
            ),
        ]
    }
}

fn times_stay(tables: &[TableTime], papers: (f64, f64)) -> Finding {
    let (least, most) = range(tables.iter().map(|table| table.seconds));
    Finding::new(
        most / least < SAME,
        format!(
            "The paper: the time does not depend on the size of the table, {:.1} to {:.1} ms. Here the \
             slowest table takes {:.2} \
             times as long as the fastest.",
            papers.0,
            papers.1,
            most / least
        ),
        "a larger table leaves one cache after the other; and these times need a machine on which nothing else runs.",
    )
}

/// The error of each table.
fn errors(tables: &[TableTime]) -> String {
    let each = |table: &TableTime| format!("{:.2} with {}", table.rms_255, table.size);
    tables.iter().map(each).collect::<Vec<_>>().join(", ")
}
