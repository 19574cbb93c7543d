//! A ball over a floor, to look at from the side.

use bevy::core_pipeline::prepass::DeferredPrepass;
use bevy::core_pipeline::tonemapping::DebandDither;
use bevy::light::GlobalAmbientLight;
use bevy::pbr::DefaultOpaqueRendererMethod;
use bevy::prelude::*;
use bevy::render::RenderApp;
use bevy_visfield::FieldResidency;
use bevy_visfield::prelude::*;
use image::RgbaImage;
use visfield::gpu::PoolStatistics;
use visfield_workspace::headless::HeadlessApp;

pub(crate) const SIZE: UVec2 = UVec2::new(160, 120);

/// How Bevy shades.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Shading {
    Forward,
    Deferred,
}

/// A ball over a floor, seen from the side, with the sky above; a sun to the right.
pub(crate) struct Stage {
    pub(crate) headless: HeadlessApp,
    pub(crate) ball: Entity,
    pub(crate) sun: Entity,
    pub(crate) camera: Entity,
}

impl Stage {
    pub(crate) fn new(shading: Shading) -> Self {
        Self::with_size(shading, SIZE)
    }

    pub(crate) fn with_size(shading: Shading, size: UVec2) -> Self {
        Self::with_field(shading, size, ball_field())
    }

    pub(crate) fn with_field(shading: Shading, size: UVec2, field: visfield::VisibilityField) -> Self {
        Self::with_app(shading, size, field, |size| HeadlessApp::new(size, |plugins| plugins))
    }

    /// The same in an app that `make` makes.
    pub(crate) fn with_app(
        shading: Shading,
        size: UVec2,
        field: visfield::VisibilityField,
        make: impl FnOnce(UVec2) -> HeadlessApp,
    ) -> Self {
        let mut headless = make(size);
        headless.app.add_plugins(VisibilityFieldPlugin);
        let target = headless.target();
        let world = headless.app.world_mut();
        world.insert_resource(ClearColor(Color::srgb(0.2, 0.4, 0.8)));
        world.insert_resource(GlobalAmbientLight { brightness: 2000.0, ..default() });
        if shading == Shading::Deferred {
            world.insert_resource(DefaultOpaqueRendererMethod::deferred());
        }
        let mut add_mesh = |mesh: Mesh| world.resource_mut::<Assets<Mesh>>().add(mesh);
        let floor = add_mesh(Plane3d::new(Vec3::Y, Vec2::splat(6.0)).into());
        let ball_mesh = add_mesh(Sphere::new(1.0).into());
        let material = world.resource_mut::<Assets<StandardMaterial>>().add(StandardMaterial {
            base_color: Color::srgb(0.4, 0.4, 0.4),
            perceptual_roughness: 1.0,
            ..default()
        });
        // A ball whose field is in closed form: no bake, no file.
        let field = world.resource_mut::<Assets<VisibilityField>>().add(VisibilityField(field));
        world.spawn((Mesh3d(floor), MeshMaterial3d(material.clone())));
        let ball = world
            .spawn((
                Mesh3d(ball_mesh),
                MeshMaterial3d(material),
                Transform::from_xyz(-1.0, 1.2, 0.0),
                VisibilityField3d(field),
            ))
            .id();
        let sun = world
            .spawn((
                DirectionalLight { illuminance: 3000.0, ..default() },
                Transform::default().looking_to(Vec3::new(-0.8, -1.0, 0.0), Vec3::Y),
                FieldShadows { angular_radius: 0.05 },
            ))
            .id();
        let look = Transform::from_xyz(0.0, 3.0, 8.0).looking_at(Vec3::new(0.0, 0.8, 0.0), Vec3::Y);
        // Without dithering, pictures of the same thing are equal.
        let plain = (Camera3d::default(), Msaa::Off, DebandDither::Disabled);
        let camera = world.spawn((plain, look, FieldOcclusion::default(), target)).id();
        if shading == Shading::Deferred {
            world.entity_mut(camera).insert(DeferredPrepass);
        }
        headless.wait_until_ready();
        Self { headless, ball, sun, camera }
    }

    pub(crate) fn entity(&mut self, entity: Entity) -> EntityWorldMut<'_> {
        self.headless.app.world_mut().entity_mut(entity)
    }

    /// What has been uploaded so far.
    pub(crate) fn statistics(&self) -> PoolStatistics {
        self.headless.app.sub_app(RenderApp).world().resource::<FieldResidency>().statistics()
    }

    pub(crate) fn picture(&mut self) -> RgbaImage {
        // Pipelines for a changed view are compiled when it is first drawn.
        self.headless.wait_until_ready();
        self.headless.capture()
    }

    /// The pixel where a point of the world is seen.
    pub(crate) fn pixel_of(&mut self, point: Vec3) -> (u32, u32) {
        let world = self.headless.app.world();
        let camera = world.entity(self.camera);
        let (camera, transform) = (camera.get::<Camera>().unwrap(), camera.get::<GlobalTransform>().unwrap());
        let at = camera.world_to_viewport(transform, point).expect("the point is in view");
        (at.x as u32, at.y as u32)
    }
}

/// The field of a unit ball, as `Sphere::new(1.0)`: in field space its radius is a little under 1.
pub(crate) fn ball_field() -> visfield::VisibilityField {
    let inner = 0.98;
    let closed_form = visfield::field::ball_field(inner, 65, 32);
    let mut header = closed_form.header().clone();
    header.bounds = visfield::BoundingEllipsoid::sphere([0.0; 3], 1.0 / inner);
    visfield::VisibilityField::new(header, closed_form.parts().clone()).expect("only the scale changed")
}

/// The same with a cap grid beside the table, or alone.
pub(crate) fn ball_with_caps(table: bool) -> visfield::VisibilityField {
    let ball = ball_field();
    let parts = visfield::FieldParts {
        table: ball.table().filter(|_| table).cloned(),
        cap_grid: Some(visfield::field::cap_grid::example_ball()),
        ..visfield::FieldParts::default()
    };
    visfield::VisibilityField::new(ball.header().clone(), parts).expect("both parts are sound")
}

pub(crate) fn brightness(picture: &RgbaImage, (x, y): (u32, u32)) -> i32 {
    picture.get_pixel(x, y).0[..3].iter().map(|&channel| i32::from(channel)).sum::<i32>() / 3
}

/// The largest difference of any channel of any pixel, in steps of 1/255.
pub(crate) fn largest_difference(a: &RgbaImage, b: &RgbaImage) -> u8 {
    assert_eq!(a.dimensions(), b.dimensions());
    a.as_raw().iter().zip(b.as_raw()).map(|(a, b)| a.abs_diff(*b)).max().unwrap()
}

/// Below the ball, in its ambient occlusion but out of the sun's shadow; in the shadow; far from both; in the sky.
pub(crate) const BESIDE: Vec3 = Vec3::new(-0.7, 0.0, 1.1);
pub(crate) const SHADOW: Vec3 = Vec3::new(-1.96, 0.0, 0.0);
pub(crate) const OPEN: Vec3 = Vec3::new(3.2, 0.0, 2.0);
pub(crate) const SKY: (u32, u32) = (80, 3);
