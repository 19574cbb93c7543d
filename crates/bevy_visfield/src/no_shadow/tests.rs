//! Each reason, without a GPU: what the render world would tell is told by hand.

use bevy::asset::AssetPlugin;

use super::*;
use crate::VisibilityFieldPlugin;
use crate::render::FieldOnGpu;
use visfield::field::cap_grid::{self, CapGridHeader};
use visfield::field::directions::DirectionMap;
use visfield::{CapGridFormat, Encoding, FieldParts, Representation};

/// All of them.
const REASONS: [NoShadow; 18] = [
    NoShadow::NoEntity,
    NoShadow::NoField,
    NoShadow::NotOccluder,
    NoShadow::Hidden,
    NoShadow::NotLoading,
    NoShadow::Loading,
    NoShadow::LoadFailed,
    NoShadow::BadTransform,
    NoShadow::NoTable,
    NoShadow::Hemisphere,
    NoShadow::NoLight,
    NoShadow::NoCamera,
    NoShadow::CameraUnfit,
    NoShadow::OtherLayers,
    NoShadow::Inert,
    NoShadow::Uploading,
    NoShadow::TableOverBudget,
    NoShadow::OverBudget,
];

/// A world in which one object casts shadows.
struct Scene {
    app: App,
    occluder: Entity,
    light: Entity,
    camera: Entity,
}

impl Scene {
    fn new() -> Self {
        let mut app = App::new();
        app.add_plugins((MinimalPlugins, AssetPlugin::default())).init_asset::<Shader>().init_asset::<Mesh>();
        app.add_plugins(VisibilityFieldPlugin);
        app.finish();
        app.world().resource::<RenderFeedback>().activate();
        let world = app.world_mut();
        let occluder = world.spawn((InheritedVisibility::VISIBLE, VisibilityField3d::default())).id();
        let light = world.spawn((DirectionalLight::default(), FieldShadows::default())).id();
        world.entity_mut(light).insert(InheritedVisibility::VISIBLE);
        let camera = world.spawn((Camera3d::default(), Msaa::Off, FieldOcclusion::default())).id();
        let mut scene = Self { app, occluder, light, camera };
        scene.set_field(visfield::field::example_field());
        scene
    }

    /// Gives the occluder a field that is on the GPU as far as possible.
    fn set_field(&mut self, field: visfield::VisibilityField) {
        let world = self.app.world_mut();
        let handle = world.resource_mut::<Assets<VisibilityField>>().add(VisibilityField(field));
        world.entity_mut(self.occluder).insert(VisibilityField3d(handle));
        self.tell(FieldLevel::Full, FieldLevel::Full);
    }

    /// Tells what the render world would.
    fn tell(&mut self, level: FieldLevel, target: FieldLevel) {
        let id = self.entity(self.occluder).get::<VisibilityField3d>().unwrap().id();
        self.app.world().resource::<RenderFeedback>().tell([(id, FieldOnGpu { level, target })].into());
    }

    fn entity(&mut self, entity: Entity) -> EntityWorldMut<'_> {
        self.app.world_mut().entity_mut(entity)
    }

    fn why(&mut self) -> Option<NoShadow> {
        why_no_shadow(self.app.world_mut(), self.occluder)
    }
}

fn with_caps(order: HarmonicOrder, table: bool) -> visfield::VisibilityField {
    let field = visfield::field::example_field();
    let numbers = vec![0.0; order.coefficients()];
    let format = CapGridFormat { order, points: 5, ..CapGridFormat::DEFAULT };
    let grid =
        cap_grid::ball(CapGridHeader { format, low: numbers.clone(), range: numbers, ..CapGridHeader::default() });
    let parts =
        FieldParts { table: field.table().filter(|_| table).cloned(), cap_grid: Some(grid), ..FieldParts::default() };
    visfield::VisibilityField::new(field.header().clone(), parts).unwrap()
}

#[test]
fn codes_are_unique_and_lead_the_text() {
    for (number, reason) in (1..).zip(REASONS) {
        assert_eq!(reason.code(), format!("VF{number:03}"));
        let text = reason.to_string();
        assert!(text.starts_with(&format!("{}: ", reason.code())) && text.len() > 40, "{text}");
    }
}

#[test]
fn what_casts_has_no_reason() {
    assert_eq!(Scene::new().why(), None);
}

#[test]
fn entities_without_a_working_field() {
    let mut scene = Scene::new();
    let occluder = scene.occluder;
    scene.entity(occluder).insert(NotFieldOccluder);
    assert_eq!(scene.why(), Some(NoShadow::NotOccluder));
    scene.entity(occluder).remove::<NotFieldOccluder>().insert(InheritedVisibility::HIDDEN);
    assert_eq!(scene.why(), Some(NoShadow::Hidden));
    scene.entity(occluder).insert(InheritedVisibility::VISIBLE);
    for scale in [Vec3::new(1.0, 0.0, 1.0), Vec3::NAN, Vec3::INFINITY] {
        scene.entity(occluder).insert(GlobalTransform::from(Transform::from_scale(scale)));
        assert_eq!(scene.why(), Some(NoShadow::BadTransform), "{scale}");
    }
    let far = Transform::from_xyz(1e9, 0.0, 0.0).with_scale(Vec3::new(-1e-3, 2e-3, 1e-3));
    scene.entity(occluder).insert(GlobalTransform::from(far));
    assert_eq!(scene.why(), None);
    scene.entity(occluder).remove::<VisibilityField3d>();
    assert_eq!(scene.why(), Some(NoShadow::NoField));
    scene.entity(occluder).despawn();
    assert_eq!(scene.why(), Some(NoShadow::NoEntity));
}

#[test]
fn fields_that_did_not_arrive() {
    let mut scene = Scene::new();
    let occluder = scene.occluder;
    scene.entity(occluder).insert(VisibilityField3d::default());
    assert_eq!(scene.why(), Some(NoShadow::NotLoading));
    let loading = scene.app.world().resource::<AssetServer>().load("nowhere.vfield#ball");
    scene.entity(occluder).insert(VisibilityField3d(loading));
    assert_eq!(scene.why(), Some(NoShadow::Loading));
    let start = std::time::Instant::now();
    while scene.why() == Some(NoShadow::Loading) && start.elapsed().as_secs() < 20 {
        scene.app.update();
    }
    assert_eq!(scene.why(), Some(NoShadow::LoadFailed));
    scene.set_field(visfield::field::example_field());
    let id = scene.entity(occluder).get::<VisibilityField3d>().unwrap().id();
    scene.app.world_mut().resource_mut::<Assets<VisibilityField>>().remove(id);
    assert_eq!(scene.why(), Some(NoShadow::NotLoading));
}

#[test]
fn fields_without_a_table_that_the_passes_read() {
    let mut scene = Scene::new();
    let (light, camera) = (scene.light, scene.camera);
    let papers = Representation::Hemisphere { positions: 290, directions: 4, map: DirectionMap::Concentric };
    scene.set_field(visfield::field::ball(0.5, papers, Encoding::U8));
    assert_eq!(scene.why(), Some(NoShadow::Hemisphere));
    for order in [HarmonicOrder::One, HarmonicOrder::Three] {
        scene.set_field(with_caps(order, false));
        assert_eq!(scene.why(), Some(NoShadow::NoTable));
    }
    // The grid of order 3 hides large lights, where grids are asked.
    scene.entity(light).insert(FieldShadows::SKY);
    assert_eq!(scene.why(), None);
    scene.entity(camera).insert(FieldOcclusion { ambient_occlusion: false, ..default() });
    assert_eq!(scene.why(), Some(NoShadow::NoTable));
}

#[test]
fn lights_and_cameras() {
    let mut scene = Scene::new();
    let (occluder, light, camera) = (scene.occluder, scene.light, scene.camera);
    scene.entity(light).insert(InheritedVisibility::HIDDEN);
    assert_eq!(scene.why(), Some(NoShadow::NoLight));
    scene.entity(light).insert(InheritedVisibility::VISIBLE).remove::<FieldShadows>();
    assert_eq!(scene.why(), Some(NoShadow::NoLight));
    scene.entity(light).insert(FieldShadows::default());

    scene.entity(camera).insert(Msaa::Sample4);
    assert_eq!(scene.why(), Some(NoShadow::CameraUnfit));
    scene.entity(camera).insert(Msaa::Off).remove::<NormalPrepass>();
    assert_eq!(scene.why(), Some(NoShadow::CameraUnfit));
    scene.entity(camera).insert(NormalPrepass);
    scene.entity(occluder).insert(RenderLayers::layer(2));
    assert_eq!(scene.why(), Some(NoShadow::OtherLayers));
    scene.entity(camera).insert(RenderLayers::from_layers(&[1, 2]));
    assert_eq!(scene.why(), None);
    scene.entity(camera).get_mut::<Camera>().unwrap().is_active = false;
    assert_eq!(scene.why(), Some(NoShadow::NoCamera));
    scene.entity(camera).despawn();
    assert_eq!(scene.why(), Some(NoShadow::NoCamera));
}

#[test]
fn what_the_gpu_lacks() {
    use FieldLevel::{Absent, Coarse, Full, WithoutTable};
    let mut scene = Scene::new();
    for (level, target, expected) in [
        (Full, Full, None),
        (Coarse, Coarse, None),
        (Full, Absent, None),
        (WithoutTable, Full, Some(NoShadow::Uploading)),
        (Absent, Coarse, Some(NoShadow::Uploading)),
        (WithoutTable, WithoutTable, Some(NoShadow::TableOverBudget)),
        (Absent, WithoutTable, Some(NoShadow::TableOverBudget)),
        (Absent, Absent, Some(NoShadow::OverBudget)),
    ] {
        scene.tell(level, target);
        assert_eq!(scene.why(), expected, "{level:?} on the way to {target:?}");
    }
    scene.app.world().resource::<RenderFeedback>().tell(default());
    assert_eq!(scene.why(), Some(NoShadow::Uploading), "not extracted yet");

    // What is left of it hides large lights.
    scene.set_field(with_caps(HarmonicOrder::Three, true));
    scene.tell(WithoutTable, WithoutTable);
    assert_eq!(scene.why(), Some(NoShadow::TableOverBudget));
    let light = scene.light;
    scene.entity(light).insert(FieldShadows::SKY);
    assert_eq!(scene.why(), None);

    scene.app.insert_resource(RenderFeedback::default());
    assert_eq!(scene.why(), Some(NoShadow::Inert));
}
