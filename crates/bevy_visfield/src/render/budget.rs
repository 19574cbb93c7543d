//! How much GPU memory fields may take, and which of them make do with less where it is short.

use bevy::prelude::*;

/// How much GPU memory fields may take, a resource of the main world that can change at any time.
///
/// Where the fields of a scene ask for more, the ones that are needed least get a coarser table, then no more than their cap grid,
/// then nothing, and one warning says so. A field is needed as much as its largest instance looks from the nearest camera with
/// [`FieldOcclusion`](crate::FieldOcclusion): radius over distance. [`FieldResidency`](crate::FieldResidency) tells what came out.
///
/// ```
/// use bevy::prelude::*;
/// use bevy_visfield::FieldMemoryBudget;
/// fn small_gpu(mut budget: ResMut<FieldMemoryBudget>) {
///     budget.bytes = 64 << 20;
/// }
/// ```
#[derive(Resource, Reflect, Clone, Copy, Debug, PartialEq, Eq)]
#[reflect(Resource, Default, Clone, PartialEq)]
pub struct FieldMemoryBudget {
    /// Bytes that all fields on the GPU may take together, 256 MiB by default. What the adapter can bind at once, often 128 MiB
    /// to 2 GiB, bounds it further. While the buffer of fields grows or shrinks, the old one exists beside the new one.
    pub bytes: u64,
    /// Bytes of fields to upload in one frame, 32 MiB by default, so that no frame waits long for fields that arrive or change
    /// their level. At least one field goes each frame, however large.
    pub upload_bytes_per_frame: u64,
}

impl Default for FieldMemoryBudget {
    fn default() -> Self {
        Self { bytes: 256 << 20, upload_bytes_per_frame: 32 << 20 }
    }
}

/// How much of a field is on the GPU, from nothing to all of it.
///
/// ```
/// use bevy_visfield::FieldLevel;
/// assert!(FieldLevel::Coarse < FieldLevel::Full);
/// ```
#[derive(Reflect, Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[reflect(Default, Clone, PartialEq, Hash)]
pub enum FieldLevel {
    /// Nothing: its instances do not occlude.
    #[default]
    Absent,
    /// All but the table: ambient occlusion by a cap grid, and shadows if there is a distance grid (or, of large lights, with
    /// `--order 3`).
    WithoutTable,
    /// A table of half as many cells along each side, a sixteenth of the memory, and all else.
    Coarse,
    /// All that was baked.
    Full,
}

impl FieldLevel {
    /// All levels, from nothing to everything.
    pub const ALL: [Self; 4] = [Self::Absent, Self::WithoutTable, Self::Coarse, Self::Full];
}

/// Bytes that each level of a field takes on the GPU; `None` for levels that it does not have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct LevelBytes {
    pub(super) without_table: Option<u64>,
    pub(super) coarse: Option<u64>,
    pub(super) full: Option<u64>,
}

impl LevelBytes {
    pub(super) fn of(&self, level: FieldLevel) -> Option<u64> {
        match level {
            FieldLevel::Absent => Some(0),
            FieldLevel::WithoutTable => self.without_table,
            FieldLevel::Coarse => self.coarse,
            FieldLevel::Full => self.full,
        }
    }

    /// The highest level that there is.
    pub(super) fn best(&self) -> FieldLevel {
        FieldLevel::ALL.into_iter().rfind(|level| self.of(*level).is_some()).unwrap_or_default()
    }

    /// Bytes of the highest level.
    pub(super) fn asked(&self) -> u64 {
        self.of(self.best()).unwrap_or(0)
    }
}

/// A level for each field, so that all together take at most `budget` bytes. `fields` come with the most needed one first.
///
/// The least needed ones lose first, and all lose little before one loses more.
pub(super) fn levels_within(budget: u64, fields: &[LevelBytes]) -> Vec<FieldLevel> {
    let mut levels: Vec<FieldLevel> = fields.iter().map(LevelBytes::best).collect();
    let mut total: u64 = fields.iter().map(LevelBytes::asked).sum();
    for floor in [FieldLevel::Coarse, FieldLevel::WithoutTable, FieldLevel::Absent] {
        for (field, level) in fields.iter().zip(&mut levels).rev() {
            if total <= budget {
                break;
            }
            if let (true, Some(less), Some(now)) = (*level > floor, field.of(floor), field.of(*level)) {
                (*level, total) = (floor, total - now + less);
            }
        }
    }
    // One large field may have freed more than was missing, after small ones had to go.
    for (field, level) in fields.iter().zip(&mut levels) {
        let now = field.of(*level).unwrap_or(0);
        let mut better = FieldLevel::ALL.into_iter().rev().take_while(|better| better > level);
        let fits = |better: FieldLevel| field.of(better).filter(|more| total - now + more <= budget).zip(Some(better));
        if let Some((more, better)) = better.find_map(fits) {
            (*level, total) = (better, total - now + more);
        }
    }
    levels
}

/// How much a need must change before it counts: by this factor, so that objects at nearly the same distance do not take turns.
const NOTICEABLE: f32 = 1.25;

/// What a need counts as, if it counted as `held` so far.
pub(super) fn steady_need(held: f32, need: f32) -> f32 {
    // Fields without instances do not wait for anything.
    let unchanged = need > 0.0 && need < held * NOTICEABLE && need * NOTICEABLE > held;
    if unchanged { held } else { need }
}

#[cfg(test)]
mod tests {
    use super::FieldLevel::{Absent, Coarse, Full, WithoutTable};
    use super::*;

    /// A table with a cap grid beside it.
    const BOTH: LevelBytes = LevelBytes { without_table: Some(10), coarse: Some(70), full: Some(1000) };
    /// A cap grid alone, and a table alone.
    const CAPS: LevelBytes = LevelBytes { without_table: None, coarse: None, full: Some(10) };
    const TABLE: LevelBytes = LevelBytes { without_table: None, coarse: Some(60), full: Some(990) };

    #[test]
    fn the_least_needed_lose_first_and_all_lose_little_before_one_loses_more() {
        for (budget, expected) in [
            (3000, [Full, Full, Full]),
            (2999, [Full, Full, Coarse]),
            (2069, [Full, Coarse, Coarse]),
            (1139, [Coarse, Coarse, Coarse]),
            (209, [Coarse, Coarse, WithoutTable]),
            (149, [Coarse, WithoutTable, WithoutTable]),
            (89, [WithoutTable, WithoutTable, WithoutTable]),
            (29, [WithoutTable, WithoutTable, Absent]),
            (9, [Absent, Absent, Absent]),
        ] {
            assert_eq!(levels_within(budget, &[BOTH; 3]), expected, "{budget}");
        }
    }

    #[test]
    fn fields_lose_only_what_they_have() {
        assert_eq!(levels_within(80, &[CAPS, TABLE]), [Full, Coarse]);
        assert_eq!(levels_within(60, &[CAPS, TABLE]), [Full, Absent]);
        assert_eq!(levels_within(60, &[TABLE, CAPS]), [Coarse, Absent]);
        assert_eq!(levels_within(0, &[LevelBytes::default()]), [Absent]);
    }

    #[test]
    fn what_a_large_field_frees_goes_to_the_others() {
        let large = LevelBytes { without_table: None, coarse: Some(6000), full: Some(100_000) };
        assert_eq!(levels_within(9000, &[large, BOTH, BOTH]), [Coarse, Full, Full]);
        assert_eq!(levels_within(1100, &[large, BOTH, BOTH]), [Absent, Full, Coarse]);
    }

    #[test]
    fn no_budget_is_exceeded_and_none_left_unused() {
        let fields: Vec<LevelBytes> = (1..40_u64)
            .map(|i| {
                let full = i * 7919 % 997 + 20;
                LevelBytes {
                    without_table: (i % 3 > 0).then_some(4),
                    coarse: (i % 5 > 0).then_some(full / 16 + 4),
                    full: Some(full),
                }
            })
            .collect();
        for budget in (0..25_000).step_by(37) {
            let levels = levels_within(budget, &fields);
            let total: u64 = fields.iter().zip(&levels).map(|(field, level)| field.of(*level).unwrap()).sum();
            assert!(total <= budget, "{total} of {budget}");
            for (field, level) in fields.iter().zip(&levels) {
                let now = field.of(*level).unwrap();
                for better in FieldLevel::ALL.into_iter().filter(|better| better > level) {
                    assert!(
                        field.of(better).is_none_or(|more| total - now + more > budget),
                        "{budget}: room for {better:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn small_changes_of_need_do_not_count() {
        assert_eq!(steady_need(0.5, 0.6), 0.5);
        assert_eq!(steady_need(0.5, 0.41), 0.5);
        assert_eq!(steady_need(0.5, 0.63), 0.63);
        assert_eq!(steady_need(0.5, 0.39), 0.39);
        assert_eq!((steady_need(0.5, 0.0), steady_need(0.0, 1e-9)), (0.0, 1e-9));
    }
}
