//! One field at all its levels: the baked one, and what is made of it when the GPU's memory is short.

use bevy::math::{Affine3A, Vec3A};
use bevy::prelude::*;
use bevy::tasks::{AsyncComputeTaskPool, Task, futures::check_ready};
use visfield::field::lookup::Grid;
use visfield::gpu::FieldPool;
use visfield::gpu::layout::CapGridData;
use visfield::{ChordTable, FieldParts, VisibilityField};

use super::budget::{FieldLevel, LevelBytes};

/// The parts are shared with the asset; only a coarser table takes memory of its own, once it was needed.
pub(super) struct Levels {
    full: VisibilityField,
    coarse: Coarse,
    without_table: Option<VisibilityField>,
    bytes: LevelBytes,
    /// Centre and radius of a sphere around the mesh, in its own space.
    sphere: (Vec3, f32),
}

enum Coarse {
    NotMade,
    Making(Task<Option<VisibilityField>>),
    Made(Box<VisibilityField>),
}

impl Levels {
    pub(super) fn new(full: VisibilityField) -> Self {
        let rest = full.table().map(|_| FieldParts { table: None, ..full.parts().clone() });
        let without_table = rest.and_then(|rest| VisibilityField::new(full.header().clone(), rest).ok());
        let rest_bytes = without_table.as_ref().map(FieldPool::bytes_of);
        let readable = !full.table().is_some_and(|table| matches!(table.grid(), Grid::Hemisphere(_)));
        if !readable {
            let rest = if without_table.is_some() { "occludes without its table" } else { "does not occlude" };
            error!(
                "visibility field `{}` {rest}: the GPU passes read two-point tables only; bake this one without \
                 `--representation hemisphere`",
                full.header().name
            );
        }
        // Not made yet, so an upper bound: the pool's places are whole headers, and so are the parts in them.
        let coarse = full.table().and_then(ChordTable::coarser_format);
        let coarse_bytes =
            coarse.map(|format| format.bytes() + rest_bytes.unwrap_or(0) + 3 * size_of::<CapGridData>() as u64);
        let bytes = LevelBytes {
            without_table: rest_bytes,
            coarse: coarse_bytes,
            full: readable.then(|| FieldPool::bytes_of(&full)),
        };
        let bounds = full.header().bounds;
        let radius = bounds.axes.iter().map(|axis| Vec3::from(*axis).length()).fold(0.0, f32::max);
        Self { sphere: (bounds.center.into(), radius), full, coarse: Coarse::NotMade, without_table, bytes }
    }

    /// The field as it was baked.
    pub(super) fn field(&self) -> &VisibilityField {
        &self.full
    }

    pub(super) fn bytes(&self) -> LevelBytes {
        self.bytes
    }

    /// Whether there is nothing to wait for. The first time that the coarser table is asked for, it begins to be made, in the
    /// background.
    pub(super) fn ready(&mut self, level: FieldLevel) -> bool {
        if level == FieldLevel::Coarse {
            match &mut self.coarse {
                Coarse::NotMade => {
                    let full = self.full.clone();
                    self.coarse = Coarse::Making(AsyncComputeTaskPool::get().spawn(async move {
                        let table = full.table().and_then(ChordTable::coarser)?;
                        Some(full.with_table(table))
                    }));
                }
                Coarse::Making(task) => match check_ready(task) {
                    Some(Some(made)) => self.coarse = Coarse::Made(Box::new(made)),
                    Some(None) => self.give_up(level),
                    None => {}
                },
                Coarse::Made(_) => {}
            }
        }
        self.get(level).is_some()
    }

    /// What to upload; nothing for [`FieldLevel::Absent`], and for what is not made.
    pub(super) fn get(&self, level: FieldLevel) -> Option<&VisibilityField> {
        match level {
            FieldLevel::Absent => None,
            FieldLevel::WithoutTable => self.without_table.as_ref(),
            FieldLevel::Coarse => match &self.coarse {
                Coarse::Made(field) => Some(field),
                Coarse::NotMade | Coarse::Making(_) => None,
            },
            FieldLevel::Full => self.bytes.full.is_some().then_some(&self.full),
        }
    }

    /// Counts a level as one that the field does not have.
    pub(super) fn give_up(&mut self, level: FieldLevel) {
        match level {
            FieldLevel::Absent => {}
            FieldLevel::WithoutTable => self.bytes.without_table = None,
            FieldLevel::Coarse => (self.bytes.coarse, self.coarse) = (None, Coarse::NotMade),
            FieldLevel::Full => self.bytes.full = None,
        }
    }

    /// Centre and radius of a sphere around an instance, roughly: to tell near from far.
    pub(super) fn sphere_in_world(&self, world_from_mesh: &Affine3A) -> (Vec3, f32) {
        let linear = world_from_mesh.matrix3;
        let stretch = [linear.x_axis, linear.y_axis, linear.z_axis].map(Vec3A::length);
        let (center, radius) = self.sphere;
        (world_from_mesh.transform_point3(center), radius * stretch.into_iter().fold(0.0, f32::max))
    }
}
