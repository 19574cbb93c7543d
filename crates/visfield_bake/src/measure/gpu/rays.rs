//! The rays that all kernels are asked: the same ones, for a field in its own space and for triangles as they are scaled.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use visfield::estimate::Receiver;
use visfield::{QueryOptions, Ray, VisibilityField};

use crate::exact::ExactScene;
use crate::measure::scene::hemisphere_directions;
use crate::measure::speed::{AskedField, RaySet, meets_bounds};
use crate::triangles::PreparedRay;

/// What stands for rays without end in shaders: WGSL has no portable infinity (`NO_HIT` of `field.wgsl`).
const NO_END: f32 = 3.0e38;

/// A ray as kernels read it, `ListedRay` in `rays.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(in crate::measure) struct RayWords {
    origin: [f32; 3],
    receiver: u32,
    direction: [f32; 3],
    t_max: f32,
}

/// Rays of receivers that meet a field's bounds.
pub(super) struct MeetingRays {
    pub(super) set: RaySet,
    /// Rays of each receiver, those included that do not meet the bounds.
    pub(super) rays_per_receiver: u32,
}

impl MeetingRays {
    /// Of `rays_per_receiver` rays of each receiver those that meet the bounds. Fields with the same bounds share them.
    pub(super) fn new(
        scene: &ExactScene,
        field: &VisibilityField,
        receivers: &[Receiver],
        rays_per_receiver: u32,
    ) -> Self {
        let asked = AskedField::new(field);
        let directions = |receiver: &Receiver, index: usize| {
            let origin = asked.origin(receiver);
            let meets = |direction: &Vec3| meets_bounds(&Ray::new(origin, asked.direction(*direction)));
            hemisphere_directions(receiver, index, rays_per_receiver).into_iter().filter(meets).collect()
        };
        let start = |receiver: &Receiver| scene.start(receiver);
        let set = RaySet::new(scene.triangles(), field, QueryOptions::default(), receivers, directions, start);
        Self { set, rays_per_receiver }
    }

    /// The number of rays.
    pub(super) fn count(&self) -> usize {
        self.set.field.len()
    }

    pub(super) fn field_words(&self) -> Vec<RayWords> {
        let mut words = Vec::with_capacity(self.count());
        for (receiver, (range, _)) in self.set.receivers.iter().enumerate() {
            words.extend(self.set.field[range.clone()].iter().map(|ray| RayWords {
                origin: ray.origin.to_array(),
                receiver: receiver as u32,
                direction: ray.direction.to_array(),
                t_max: ray.t_max.min(NO_END),
            }));
        }
        words
    }

    /// The normal of each receiver in field space.
    pub(super) fn normals(&self) -> Vec<[f32; 4]> {
        self.set.receivers.iter().map(|(_, options)| options.normal.extend(0.0).to_array()).collect()
    }

    /// Which share of each receiver's rays is occluded; those that do not meet the bounds are not.
    pub(super) fn shares(&self, occluded: &[bool]) -> Vec<f32> {
        let hits = |range: &std::ops::Range<usize>| occluded[range.clone()].iter().filter(|&&hit| hit).count();
        self.set.receivers.iter().map(|(range, _)| hits(range) as f32 / self.rays_per_receiver as f32).collect()
    }
}

/// Rays as they are traced through triangles.
pub(in crate::measure) fn triangle_words(set: &RaySet) -> Vec<RayWords> {
    let words = |ray: &PreparedRay| {
        let (origin, direction, t_max) = ray.words();
        RayWords { origin, receiver: 0, direction, t_max: t_max.min(NO_END) }
    };
    set.exact.iter().map(words).collect()
}
