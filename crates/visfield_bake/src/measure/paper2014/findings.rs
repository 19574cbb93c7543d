//! In words, from the numbers: where the shape of the paper's results agrees with ours, and where it does not; and whether
//! over-relaxation saves as much as it is to.

use super::published::{CITY, DODECAHEDRON, JEWEL, JEWEL_LIT, PublishedTimes, RELAXATION, SMOOTHING};
use super::selection::CHOICES;
use super::{Paper2014, RayKind, Relaxation, Selection, Smoothing};
use crate::measure::paper2008::Finding;

/// What over-relaxation is to save of a grazing ray's evaluations, and with which ω.
const SAVED: (f64, std::ops::RangeInclusive<f32>) = (0.15, 1.19..=1.61);
/// Share of rays that may hit otherwise and still be called none: they pass at just the threshold.
const FEW: f64 = 2.0e-3;
/// Share of rays that may go wrong where the paper calls a method robust.
const ROBUST: f64 = 0.01;
/// Share of rays at which a constant ε has failed.
const FAILS: f64 = 0.1;
/// What may be left of differences that are drastically reduced.
const DRASTICALLY: f64 = 0.25;

impl Paper2014 {
    /// §3.1: what over-relaxation saves, and whether it hits the same.
    pub fn relaxation_findings(&self) -> Vec<Finding> {
        let grazing = self.sets().filter(|set| set[0].kind == RayKind::Grazing);
        let mut findings: Vec<Finding> = grazing.filter_map(saved).collect();
        findings.extend(self.sets().map(same_hits));
        for (scene, paper) in [("city", CITY), ("jewel", JEWEL)] {
            let camera = self.sets().find(|set| set[0].scene == scene && set[0].kind == RayKind::Camera);
            findings.extend(camera.and_then(|set| speeds_up(set, &paper)));
        }
        findings.push(self.best_relaxation());
        findings.push(self.adaptive());
        findings
    }

    fn best_relaxation(&self) -> Finding {
        let camera = self.sets().filter(|set| set[0].kind == RayKind::Camera);
        let best: Vec<(&str, f32)> = camera
            .filter_map(|set| least(set, false, |_| true).map(|row| (row.scene.as_str(), row.relaxation)))
            .collect();
        let list = best.iter().map(|(scene, best)| format!("{scene} {best:.1}")).collect::<Vec<_>>().join(", ");
        Finding::new(
            best.iter().all(|(_, best)| (best - RELAXATION).abs() < 0.15),
            format!("The paper: \u{3c9} of about 1.2 is best. Here, by its rule and for camera rays: {list}."),
            "how early distances shrink steeply, which ends over-relaxation for good, depends on the scene.",
        )
    }

    fn adaptive(&self) -> Finding {
        let change = |a: &Relaxation, b: &Relaxation| a.evaluations / b.evaluations - 1.0;
        let pairs = self.sets().flat_map(|set| {
            let paper = set.iter().filter(|row| !row.adaptive);
            let ours = |row: &&Relaxation| set.iter().find(|o| o.adaptive && o.relaxation == row.relaxation);
            paper.filter_map(move |row| ours(&row).map(|ours| change(ours, row)))
        });
        let (least, most) = pairs.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
        Finding::new(
            most < 0.01,
            format!(
                "The paper leaves to future work when to relax again. Ours, which relaxes where the spheres are expected to meet, \
                 takes {:+.1} % to {:+.1} % of evaluations more than the paper's rule with the same \u{3c9}.",
                100.0 * least,
                100.0 * most
            ),
            "where steep slopes come once, at the end, to expect them saves nothing.",
        )
    }

    /// §3.2: what becomes of rays that run out of steps.
    pub fn selection_findings(&self) -> Vec<Finding> {
        let mut findings = Vec::new();
        for scene in self.selection.chunk_by(|a, b| a.scene == b.scene) {
            let limits = scene.chunk_by(|a, b| a.max_steps == b.max_steps).filter(|rows| rows[0].exhausted > 0);
            let limits: Vec<&[Selection]> = limits.filter(|rows| rows.len() == CHOICES.len()).collect();
            let Some([missed, last, nearest]) = limits.last() else { continue };
            let off = |row: &Selection| row.pixels_off.unwrap_or(0.0);
            findings.push(Finding::new(
                nearest.visible <= last.visible && limits.iter().all(|rows| off(&rows[2]) <= off(&rows[1])),
                format!(
                    "The paper: the nearest point makes a better silhouette than the last. {}, {} steps: {} of {} rays without an \
                     end are seen wrong after {}, {:.1} pixels from a surface after {:.1}.",
                    nearest.scene,
                    nearest.max_steps,
                    nearest.visible,
                    nearest.exhausted,
                    last.visible,
                    off(nearest),
                    off(last)
                ),
                "the nearest point is on an edge that is grazed, and the last is sometimes near what is behind.",
            ));
            findings.push(Finding::new(
                nearest.visible <= missed.visible,
                format!(
                    "Such a hit is better than none. {}, {} steps: {} are seen wrong after {} with none.",
                    nearest.scene, nearest.max_steps, nearest.visible, missed.visible
                ),
                "where nothing is behind what is grazed, most rays that run out of steps would have missed.",
            ));
        }
        findings
    }

    /// §3.3: which ε leaves surfaces, whatever the scale.
    pub fn escape_findings(&self) -> Vec<Finding> {
        let wrong = |stuck: u64, leaked: u64, rays: u64| (stuck + leaked) as f64 / rays.max(1) as f64;
        let worst = |epsilon: Option<f32>| {
            let rows = self.escape.iter().filter(|row| row.epsilon == epsilon);
            rows.map(|row| wrong(row.stuck, row.leaked, row.rays)).fold(0.0, f64::max)
        };
        let mut constants: Vec<f32> = self.escape.iter().filter_map(|row| row.epsilon).collect();
        constants.sort_by(f32::total_cmp);
        constants.dedup();
        let list = constants.iter().map(|&e| format!("{e:e}: {:.0} %", 100.0 * worst(Some(e)))).collect::<Vec<_>>();
        vec![
            Finding::new(
                worst(None) < ROBUST,
                format!(
                    "The paper: the dynamic \u{3b5} prevents self-intersections robustly. At most {:.2} % of rays end wrong, at any scale.",
                    100.0 * worst(None)
                ),
                "across an edge the offset along one facet's normal leaves another.",
            ),
            Finding::new(
                constants.iter().all(|&epsilon| worst(Some(epsilon)) > FAILS),
                format!(
                    "The paper: a global \u{3b5} is inappropriate. At its worst scale, each has wrong: {}.",
                    list.join(", ")
                ),
                "the scales are alike.",
            ),
        ]
    }

    /// §3.4: what a few steps even out.
    pub fn smoothing_findings(&self) -> Vec<Finding> {
        let of = |scene: &[Smoothing]| {
            let before = scene.first()?;
            let after = scene.iter().find(|row| row.smoothing == SMOOTHING)?;
            Some([
                Finding::new(
                    after.mean_step < DRASTICALLY * before.mean_step,
                    format!(
                        "The paper: three steps all but remove discontinuities. {}: the mean difference of neighbours falls from {:.4} \
                         to {:.4}, the largest from {:.2} to {:.2}.",
                        before.scene, before.mean_step, after.mean_step, before.largest_step, after.largest_step
                    ),
                    "seen at a slant, a surface is approached as slowly by these steps as by the others.",
                ),
                Finding::new(
                    after.mean >= before.mean,
                    format!(
                        "The paper: f(p) may be larger on average. {}: from {:.2} to {:.2} of what is permitted.",
                        before.scene, before.mean, after.mean
                    ),
                    "",
                ),
            ])
        };
        self.smoothing.chunk_by(|a, b| a.scene == b.scene).filter_map(of).flatten().collect()
    }

    /// §3.5: whether it is shorter from the bounds back.
    pub fn convex_findings(&self) -> Vec<Finding> {
        let plain = self.convex.iter().filter(|row| row.relaxation == 1.0);
        plain
            .map(|row| {
                Finding::new(
                    row.back_evaluations < row.inside_evaluations,
                    format!(
                        "The paper: far fewer steps from the bounds back. {}: {:.1} after {:.1} through the inside, {:.2}\u{d7} as fast; \
                         {} of {} rays end elsewhere, at edges.",
                        row.scene,
                        row.back_evaluations,
                        row.inside_evaluations,
                        row.inside_seconds / row.back_seconds,
                        row.differ,
                        row.rays
                    ),
                    "the bounds are far from the solid.",
                )
            })
            .collect()
    }

    /// §4: what whole pictures gain.
    pub fn together_findings(&self) -> Vec<Finding> {
        let ratio = |scene: &str, technique: &str| {
            let rows = self.pictured().find(|rows| rows[0].scene == scene)?;
            let on = rows.iter().find(|row| row.technique.starts_with(technique))?;
            Some((rows[0].evaluations / on.evaluations, rows[0].seconds / on.seconds, rows[0].wrong, on.wrong))
        };
        let claim = |scene: &str, technique: &str, paper: &PublishedTimes, why: &str| {
            let (evaluations, seconds, before, after) = ratio(scene, technique)?;
            Some(Finding::new(
                evaluations > 1.0 + 0.5 * (paper.speedup() - 1.0),
                format!(
                    "The paper: {} is {:.2}\u{d7} as fast. Here {scene}, {technique}: {evaluations:.2}\u{d7} fewer evaluations, \
                     {seconds:.2}\u{d7} as fast; {after} wrong pixels after {before}.",
                    paper.name,
                    paper.speedup()
                ),
                why,
            ))
        };
        let costs = "discontinuity reduction costs three evaluations wherever a ray ends, and the dynamic \u{3b5} such as stuck \
                     rays save.";
        [
            claim("city", "over-relaxation", &CITY, "these streets are shorter."),
            claim("dodecahedron", "convex", &DODECAHEDRON, "few rays are inside."),
            claim("jewel", "all", &JEWEL_LIT, costs),
        ]
        .into_iter()
        .flatten()
        .collect()
    }
}

/// The row of a rule with the fewest evaluations, among some values of ω.
fn least(set: &[Relaxation], adaptive: bool, some: impl Fn(f32) -> bool) -> Option<&Relaxation> {
    let rows = set.iter().filter(|row| row.adaptive == adaptive && row.relaxation > 1.0 && some(row.relaxation));
    rows.min_by(|a, b| a.evaluations.total_cmp(&b.evaluations))
}

fn saved(set: &[Relaxation]) -> Option<Finding> {
    let plain = &set[0];
    let best = |adaptive| least(set, adaptive, |relaxation| SAVED.1.contains(&relaxation));
    let (ours, paper) = (best(true)?, best(false)?);
    let share = |row: &Relaxation| 1.0 - row.evaluations / plain.evaluations;
    let others = (ours.flipped + ours.moved) as f64 / plain.rays.max(1) as f64;
    Some(Finding::new(
        share(ours) >= SAVED.0 && others < FEW && ours.missed <= plain.missed,
        format!(
            "To be reached: {:.0} % fewer evaluations of grazing rays with \u{3c9} of 1.2 to 1.6, and the same hits. {}: {:.1} % with \
             {:.1}, by the paper's rule {:.1} % with {:.1}; of {} rays {} flipped, {} moved, {} missed.",
            100.0 * SAVED.0,
            plain.scene,
            100.0 * share(ours),
            ours.relaxation,
            100.0 * share(paper),
            paper.relaxation,
            plain.rays,
            ours.flipped,
            ours.moved,
            ours.missed
        ),
        &format!(
            "these rays take {:.0} steps without it, and the fewer they are, the more it matters that the first one is relaxed before \
             anything is known of the slope: rays from outside start towards what they graze, and take that step back.",
            plain.evaluations
        ),
    ))
}

fn same_hits(set: &[Relaxation]) -> Finding {
    let plain = &set[0];
    let most = |count: fn(&Relaxation) -> u64| set[1..].iter().map(count).max().unwrap_or(0);
    let [flipped, moved] = [most(|row| row.flipped), most(|row| row.moved)];
    let missed = most(|row| row.missed).saturating_sub(plain.missed);
    let limit = FEW * plain.rays as f64;
    Finding::new(
        [flipped, moved, missed].iter().all(|&count| count as f64 <= limit),
        format!(
            "The paper: over-relaxation is safe. {}, {}: of {} rays at most {flipped} flipped, {moved} moved, {missed} more missed, \
             with any \u{3c9}.",
            plain.scene, plain.kind, plain.rays
        ),
        "rays that leave a surface disregard it for a while, and take no step shorter than a quarter of a voxel: where they meet it \
         again depends on where they step, with or without over-relaxation; whether they do is what counts.",
    )
}

fn speeds_up(set: &[Relaxation], paper: &PublishedTimes) -> Option<Finding> {
    let row = set.iter().find(|row| !row.adaptive && (row.relaxation - RELAXATION).abs() < 1.0e-3)?;
    let fewer = set[0].evaluations / row.evaluations;
    Some(Finding::new(
        fewer > 1.0 + 0.5 * (paper.speedup() - 1.0),
        format!(
            "The paper: {} makes rays {:.2}\u{d7} as fast. Here, with \u{3c9} = 1.2 and its rule: {fewer:.2}\u{d7} fewer evaluations, {:.2}\u{d7} \
             as fast.",
            paper.name,
            paper.speedup(),
            set[0].seconds / row.seconds
        ),
        "the scene is another one.",
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(relaxation: f32, adaptive: bool, evaluations: f64) -> Relaxation {
        Relaxation {
            scene: "city".to_owned(),
            kind: RayKind::Grazing,
            rays: 1000,
            relaxation,
            adaptive,
            evaluations,
            seconds: evaluations,
            flipped: 0,
            moved: 0,
            missed: 0,
        }
    }

    #[test]
    fn what_is_to_be_saved_is_saved_with_the_same_hits() {
        let set = [row(1.0, false, 20.0), row(1.4, false, 18.0), row(1.4, true, 16.0), row(1.8, true, 10.0)];
        let finding = saved(&set).unwrap();
        assert!(finding.agrees && finding.text.contains("20.0 % with 1.4"), "{}", finding.text);
        assert!(finding.text.contains("paper's rule 10.0 %"), "{}", finding.text);
        let mut less = set.clone();
        less[2].evaluations = 17.1;
        assert!(!saved(&less).unwrap().agrees && saved(&less).unwrap().text.contains("reason"));
        for count in [|row: &mut Relaxation| row.flipped = 3, |row: &mut Relaxation| row.moved = 3] {
            let mut other = set.clone();
            count(&mut other[2]);
            assert!(!saved(&other).unwrap().agrees);
            assert!(!same_hits(&other).agrees && same_hits(&set).agrees);
        }
        let mut through = set.clone();
        through[2].missed = 3;
        assert!(!saved(&through).unwrap().agrees && !same_hits(&through).agrees);
        // Those that are missed anyway do not count against it.
        through[0].missed = 3;
        assert!(saved(&through).unwrap().agrees && same_hits(&through).agrees);
        assert!(saved(&set[..2]).is_none());
    }

    #[test]
    fn speeds_are_compared_with_the_papers() {
        let set = |evaluations| [row(1.0, false, 20.0), row(1.2, false, evaluations)];
        assert!(speeds_up(&set(17.0), &CITY).unwrap().agrees);
        assert!(!speeds_up(&set(19.5), &CITY).unwrap().agrees);
        assert!(speeds_up(&set(17.0)[..1], &CITY).is_none());
    }
}
