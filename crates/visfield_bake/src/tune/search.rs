//! Tries candidates: bakes their parts, and asks each of them once.

use visfield::field::measured::Measured;
use visfield::{Encoding, FieldParts, VisibilityField};

use super::candidate::{Candidate, Table, distance_format};
use super::probe::Probe;
use super::{TuneError, TuneStep, Tuned, worst};
use crate::bake::{BakeError, BakeSettings, bake, table_of};
use crate::mesh::Mesh;

/// Chords and points of the largest field that is baked only to see what its family is worth.
const SAMPLE_RAYS: u64 = 1_200_000;

/// A candidate that was tried, and its RMS.
struct Trial {
    candidate: Candidate,
    rms: f32,
}

/// A table or distances, and the occlusion that each probe's receivers find with it.
struct Part<K> {
    of: K,
    found: Vec<Vec<f32>>,
}

pub(super) struct Search<'a, W> {
    mesh: &'a Mesh,
    probes: Vec<Probe>,
    trials: Vec<Trial>,
    /// Fields with a table of bytes, from which bits are made too: tracing them is what takes the time. All of them together, which few
    /// questions need, take a quarter of a gigabyte.
    traced: Vec<(Table, VisibilityField)>,
    /// Fields with distances.
    distances: Vec<(u32, VisibilityField)>,
    found_by_tables: Vec<Part<Table>>,
    found_by_distances: Vec<Part<u32>>,
    watch: W,
}

impl<'a, W: Fn(TuneStep) + Sync> Search<'a, W> {
    pub(super) fn new(mesh: &'a Mesh, probes: Vec<Probe>, watch: W) -> Self {
        Self {
            mesh,
            probes,
            trials: Vec::new(),
            traced: Vec::new(),
            distances: Vec::new(),
            found_by_tables: Vec::new(),
            found_by_distances: Vec::new(),
            watch,
        }
    }

    /// The most accurate of some candidates if it meets the limit.
    pub(super) fn good_enough(&mut self, candidates: &[Candidate], max_rms: f32) -> Result<Option<Tuned>, TuneError> {
        let mut good = Vec::new();
        for candidate in candidates {
            if !self.is_hopeless(candidate, max_rms) {
                let rms = self.rms(candidate)?;
                good.extend((rms <= max_rms).then_some((candidate, rms)));
            }
        }
        good.sort_by(|a, b| a.1.total_cmp(&b.1));
        for (candidate, _) in good {
            let tuned = self.tuned(candidate)?;
            // What was put together may differ from the field by the rounding of a ray.
            if tuned.worst().rms_255 <= max_rms {
                return Ok(Some(tuned));
            }
        }
        Ok(None)
    }

    /// The most accurate of all candidates, as far as it can be told without trying all.
    pub(super) fn most_accurate(&mut self, candidates: &[Candidate]) -> Result<Tuned, TuneError> {
        // First something cheap of every family, so that families without prospects show.
        let mut families = Vec::new();
        for candidate in candidates.iter().rev().filter(|candidate| candidate.settings().rays() <= SAMPLE_RAYS) {
            if !families.contains(&candidate.family()) {
                families.push(candidate.family());
                self.rms(candidate)?;
            }
        }
        let is_finest =
            |candidate: &&Candidate| !candidates.iter().any(|other| other != *candidate && other.refines(candidate));
        let mut finest: Vec<Candidate> = candidates.iter().filter(is_finest).copied().collect();
        let prospects = |candidate: &Candidate| {
            let own = self.trials.iter().filter(|trial| trial.candidate.family() == candidate.family());
            own.map(|trial| trial.rms).fold(f32::INFINITY, f32::min)
        };
        finest.sort_by(|a, b| prospects(a).total_cmp(&prospects(b)));
        for candidate in &finest {
            let least = self.trials.iter().map(|trial| trial.rms).fold(f32::INFINITY, f32::min);
            if !self.is_hopeless(candidate, least) {
                self.rms(candidate)?;
            }
        }
        let of_these = self.trials.iter().filter(|trial| candidates.contains(&trial.candidate));
        let best = of_these.min_by(|a, b| a.rms.total_cmp(&b.rms)).expect("the first candidate is never hopeless");
        let best = best.candidate;
        self.tuned(&best)
    }

    /// Whether a candidate must miss the limit: its distances alone miss it where they are asked, or a coarser field of its
    /// family was too bad.
    fn is_hopeless(&self, candidate: &Candidate, max_rms: f32) -> bool {
        if self.floor(candidate).is_some_and(|floor| floor > max_rms) {
            return true;
        }
        let misses = |trial: &Trial| {
            candidate.refines(&trial.candidate) && trial.rms * candidate.least_hope(&trial.candidate) > max_rms
        };
        self.trials.iter().any(misses)
    }

    /// The RMS of a table and distances together if the table made no errors, as far as it is known already.
    fn floor(&self, candidate: &Candidate) -> Option<f32> {
        let distances = self.found_by_distances.iter().find(|part| Some(part.of) == candidate.voxels)?;
        let bounds = candidate.table?.bounds;
        let (_, field) = self.traced.iter().find(|(traced, _)| traced.bounds == bounds)?;
        let exact: Vec<Vec<f32>> = self.probes.iter().map(|probe| probe.exact().to_vec()).collect();
        Some(self.worst_rms(&self.found_by_both(field, &exact, &distances.found)))
    }

    fn worst_rms(&self, found: &[Vec<f32>]) -> f32 {
        let measured: Vec<Measured> = self.probes.iter().zip(found).map(|(probe, found)| probe.judge(found)).collect();
        worst(&measured).rms_255
    }

    /// The RMS of a candidate, in the worst of what is required; measured once.
    fn rms(&mut self, candidate: &Candidate) -> Result<f32, TuneError> {
        if let Some(trial) = self.trials.iter().find(|trial| trial.candidate == *candidate) {
            return Ok(trial.rms);
        }
        (self.watch)(TuneStep::Field(candidate.settings()));
        let found = match (candidate.table, candidate.voxels) {
            (Some(table), Some(voxels)) => {
                let (by_table, by_distances) = (self.found_by_table(table)?, self.found_by_distances(voxels)?);
                let field = self.traced(table)?;
                let (outer, inner) = (&self.found_by_tables[by_table], &self.found_by_distances[by_distances]);
                self.found_by_both(&field, &outer.found, &inner.found)
            }
            (Some(table), None) => {
                let index = self.found_by_table(table)?;
                self.found_by_tables[index].found.clone()
            }
            (None, voxels) => {
                let index = self.found_by_distances(voxels.unwrap_or_default())?;
                self.found_by_distances[index].found.clone()
            }
        };
        let rms = self.worst_rms(&found);
        self.trials.push(Trial { candidate: *candidate, rms });
        Ok(rms)
    }

    /// For each receiver what the part says that its rays ask: the rays of a receiver all start at one place.
    fn found_by_both(&self, field: &VisibilityField, outer: &[Vec<f32>], inner: &[Vec<f32>]) -> Vec<Vec<f32>> {
        let of_probe = |((probe, outer), inner): ((&Probe, &Vec<f32>), &Vec<f32>)| {
            let found = probe.inside(field).into_iter().zip(outer.iter().zip(inner));
            found.map(|(inside, (outer, inner))| if inside { *inner } else { *outer }).collect()
        };
        self.probes.iter().zip(outer).zip(inner).map(of_probe).collect()
    }

    /// The index of what was found by a table.
    fn found_by_table(&mut self, table: Table) -> Result<usize, TuneError> {
        if let Some(index) = self.found_by_tables.iter().position(|part| part.of == table) {
            return Ok(index);
        }
        let field = self.with_table(table)?;
        let found = self.probes.iter().map(|probe| probe.found(&field)).collect();
        self.found_by_tables.push(Part { of: table, found });
        Ok(self.found_by_tables.len() - 1)
    }

    /// The index of what was found by distances.
    fn found_by_distances(&mut self, voxels: u32) -> Result<usize, TuneError> {
        if let Some(index) = self.found_by_distances.iter().position(|part| part.of == voxels) {
            return Ok(index);
        }
        let field = self.with_distances(voxels)?;
        let found = self.probes.iter().map(|probe| probe.found(&field)).collect();
        self.found_by_distances.push(Part { of: voxels, found });
        Ok(self.found_by_distances.len() - 1)
    }

    /// A field with these chords in bytes.
    fn traced(&mut self, table: Table) -> Result<VisibilityField, TuneError> {
        let bytes = Table { encoding: Encoding::U8, ..table };
        if let Some((_, field)) = self.traced.iter().find(|(traced, _)| *traced == bytes) {
            return Ok(field.clone());
        }
        let field = self.bake(&bytes.settings())?;
        self.traced.push((bytes, field.clone()));
        Ok(field)
    }

    fn with_table(&mut self, table: Table) -> Result<VisibilityField, TuneError> {
        let bytes = self.traced(table)?;
        Ok(match table.encoding {
            Encoding::U8 => bytes,
            other => {
                let table = table_of(&bytes)?.with_encoding(other).map_err(BakeError::Settings)?;
                bytes.with_table(table)
            }
        })
    }

    fn with_distances(&mut self, voxels: u32) -> Result<VisibilityField, TuneError> {
        if let Some((_, field)) = self.distances.iter().find(|(baked, _)| *baked == voxels) {
            return Ok(field.clone());
        }
        let field = self.bake(&BakeSettings::of_distance(distance_format(voxels)))?;
        self.distances.push((voxels, field.clone()));
        Ok(field)
    }

    fn bake(&self, settings: &BakeSettings) -> Result<VisibilityField, BakeError> {
        bake(self.mesh, settings, |rays| (self.watch)(TuneStep::Rays(rays)))
    }

    /// The field of a candidate, with what it was measured to get wrong.
    fn tuned(&mut self, candidate: &Candidate) -> Result<Tuned, TuneError> {
        let table = candidate.table.map(|table| self.with_table(table)).transpose()?;
        let distances = candidate.voxels.map(|voxels| self.with_distances(voxels)).transpose()?;
        let parts = FieldParts {
            distance: distances.as_ref().and_then(|field| field.distance_field().cloned()),
            ..table.as_ref().map(|field| field.parts().clone()).unwrap_or_default()
        };
        let header = table.or(distances).expect("a candidate has parts").header().clone();
        let field = VisibilityField::new(header, parts).map_err(BakeError::from)?;
        let measured = self.probes.iter().map(|probe| probe.judge(&probe.found(&field))).collect();
        Ok(Tuned {
            field: field.with_measured(measured).map_err(BakeError::from)?,
            settings: candidate.settings(),
            measured_fields: self.trials.len(),
        })
    }
}
