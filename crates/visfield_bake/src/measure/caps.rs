//! Ambient occlusion by cap grids, which send no rays.

use glam::{DAffine3, DVec3};
use serde::{Deserialize, Serialize};
use visfield::VisibilityField;
use visfield::estimate::Receiver;
use visfield::estimate::caps::{CapAmbient, CapCombination, CapScene, CapSettings};
use visfield::scene::{Instance, Scene};

/// Rays per receiver of the table that a cap grid is raced against.
pub const TABLE_RAYS: u32 = 64;

/// What only cap grids tell of their speed.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct CapSpeed {
    /// Nanoseconds for one receiver and one object.
    pub nanoseconds_per_receiver_and_object: f64,
    /// Nanoseconds for [`TABLE_RAYS`] rays of one receiver, in batches, aimed, through a table of 65² × 32² bytes of the same
    /// mesh in the same run.
    pub table_nanoseconds_per_receiver: f64,
}

impl CapSpeed {
    /// How many times as much the table's rays cost.
    pub fn ratio(&self) -> f64 {
        self.table_nanoseconds_per_receiver / self.nanoseconds_per_receiver_and_object
    }
}

/// A field in the space of its mesh, with a single instance.
pub(super) struct OneObject {
    scene: Scene,
    center: DVec3,
}

impl OneObject {
    pub(super) fn new(field: &VisibilityField) -> Self {
        let center = DVec3::from(field.header().bounds.center.map(f64::from));
        let mut scene = Scene::default();
        let id = scene.add_field(field.clone());
        scene.instances.push(Instance::new(id, DAffine3::IDENTITY));
        Self { scene, center }
    }

    /// Asked near the mesh's own centre, so that neither where the mesh lies nor its units cost digits.
    pub(super) fn caps(&self) -> AskedCaps<'_> {
        // With one object there is nothing to combine, and all rules give the same.
        AskedCaps { caps: CapScene::new(&self.scene, self.center), combination: CapCombination::Product }
    }
}

/// Cap grids and the rule by which they add up.
pub(super) struct AskedCaps<'a> {
    pub(super) caps: CapScene<'a>,
    pub(super) combination: CapCombination,
}

impl AskedCaps<'_> {
    /// All answers in one batch.
    pub(super) fn ask(&self, receivers: &[Receiver], answers: &mut [CapAmbient]) {
        let settings = CapSettings { combination: self.combination, ..CapSettings::default() };
        self.caps.ambient_batch(receivers, &settings, answers);
    }

    /// Occlusion of each receiver.
    pub(super) fn found(&self, receivers: &[Receiver]) -> Vec<f32> {
        let mut answers = vec![CapAmbient::UNOCCLUDED; receivers.len()];
        self.ask(receivers, &mut answers);
        occlusions(&answers)
    }
}

/// What is asked of the answers here.
pub(super) fn occlusions(answers: &[CapAmbient]) -> Vec<f32> {
    answers.iter().map(|answer| answer.occlusion).collect()
}
