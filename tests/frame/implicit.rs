//! Surfaces without triangles against meshes of the same shape.

use bevy::camera::ScalingMode;
use bevy::core_pipeline::prepass::{DepthPrepass, NormalPrepass};
use bevy::core_pipeline::tonemapping::Tonemapping;
use bevy::prelude::*;
use bevy_visfield::prelude::*;
use image::RgbaImage;
use visfield::distance::{DistanceGridFormat, ball_grid};
use visfield::shape::Shape;

use crate::adapter;
use crate::stage::{SIZE, Shading, Stage};

/// How the camera looks.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Look {
    Plain,
    Deferred,
    Orthographic,
    /// So that the near plane cuts the ball's box.
    Close,
    /// Within the ball's box.
    Within,
    WithoutPrepass,
    Stretched,
    Mirrored,
    Block,
    Plate,
    /// A grid of the ball.
    Grid,
}

const LOOKS: [Look; 8] = [
    Look::Deferred,
    Look::Close,
    Look::Orthographic,
    Look::Within,
    Look::WithoutPrepass,
    Look::Mirrored,
    Look::Plate,
    Look::Grid,
];

/// What is looked at: a ball of radius 1, or another thing.
fn field(look: Look) -> visfield::VisibilityField {
    let shape = match look {
        Look::Block => Shape::Box { half_extents: [0.5, 0.7, 0.4] },
        Look::Plate => Shape::Box { half_extents: [0.8, 0.5, 0.01] },
        _ => Shape::Sphere { radius: 1.0 },
    };
    let field = visfield::VisibilityField::of_shape(shape).unwrap();
    if look != Look::Grid {
        return field;
    }
    let grid = ball_grid(1.0, DistanceGridFormat::DEFAULT);
    let parts = visfield::FieldParts { distance: Some(grid.into()), ..visfield::FieldParts::default() };
    visfield::VisibilityField::new(field.header().clone(), parts).unwrap()
}

/// The ball as a surface or as a mesh, `scale` times the size.
fn picture(look: Look, implicit: bool, scale: u32) -> RgbaImage {
    let shading = if look == Look::Deferred { Shading::Deferred } else { Shading::Forward };
    let mut stage = Stage::with_field(shading, SIZE * scale, field(look));
    let (ball, camera) = (stage.ball, stage.camera);
    let block = stage.headless.app.world_mut().resource_mut::<Assets<Mesh>>().add(Cuboid::new(0.5, 2.0, 1.0));
    let material = stage.entity(ball).get::<MeshMaterial3d<StandardMaterial>>().unwrap().clone();
    stage.headless.app.world_mut().spawn((Mesh3d(block), material, Transform::from_xyz(-0.1, 1.0, 0.4)));
    if implicit {
        let field = stage.entity(ball).get::<VisibilityField3d>().unwrap().0.clone();
        stage.entity(ball).remove::<Mesh3d>().insert(ImplicitSurface3d(field));
    } else {
        let fine: Mesh = match look {
            Look::Block => Cuboid::new(1.0, 1.4, 0.8).into(),
            Look::Plate => Cuboid::new(1.6, 1.0, 0.02).into(),
            _ => Sphere::new(1.0).mesh().uv(256, 128),
        };
        let mesh = stage.headless.app.world_mut().resource_mut::<Assets<Mesh>>().add(fine);
        stage.entity(ball).insert(Mesh3d(mesh));
    }
    let mut camera = stage.entity(camera);
    match look {
        Look::Plain | Look::Deferred | Look::Grid => {}
        Look::Orthographic => {
            let scaling_mode = ScalingMode::FixedVertical { viewport_height: 5.0 };
            camera.insert(Projection::Orthographic(OrthographicProjection {
                scaling_mode,
                // The far plane cuts the box.
                far: 8.9,
                ..OrthographicProjection::default_3d()
            }));
        }
        Look::Close => {
            camera.insert(Transform::from_xyz(-1.0, 1.25, 1.6).looking_at(Vec3::new(-0.6, 1.2, 0.0), Vec3::Y));
            camera.insert(Projection::Perspective(PerspectiveProjection { near: 0.59, ..default() }));
        }
        Look::Within => {
            camera.insert(Transform::from_xyz(-0.24, 1.95, 0.75).looking_at(Vec3::new(-1.0, 0.5, 0.4), Vec3::Y));
            camera.insert(Projection::Perspective(PerspectiveProjection { near: 0.01, ..default() }));
        }
        Look::WithoutPrepass => drop(camera.remove::<(FieldOcclusion, DepthPrepass, NormalPrepass)>()),
        Look::Stretched => stage.entity(ball).get_mut::<Transform>().unwrap().scale = Vec3::new(0.5, 1.2, 2.0),
        Look::Mirrored => {
            // Bevy culls the wrong faces of a mirrored mesh.
            let x = if implicit { -0.8 } else { 0.8 };
            stage.entity(ball).get_mut::<Transform>().unwrap().scale = Vec3::new(x, 0.8, 0.8);
        }
        Look::Block | Look::Plate => {
            let mut ball = stage.entity(ball);
            let mut transform = ball.get_mut::<Transform>().unwrap();
            transform.rotate_y(0.4);
            transform.rotate_z(0.2);
        }
    }
    stage.picture()
}

/// A smaller picture of the average light.
fn downsampled(picture: &RgbaImage, scale: u32) -> RgbaImage {
    let linear = |byte: u8| (f32::from(byte) / 255.0).powf(2.2);
    RgbaImage::from_fn(picture.width() / scale, picture.height() / scale, |x, y| {
        let mut sums = [0.0; 3];
        for i in 0..scale * scale {
            let pixel = picture.get_pixel(x * scale + i % scale, y * scale + i / scale);
            for (sum, byte) in sums.iter_mut().zip(pixel.0) {
                *sum += linear(byte);
            }
        }
        let [r, g, b] = sums.map(|sum| ((sum / (scale * scale) as f32).powf(1.0 / 2.2) * 255.0).round() as u8);
        image::Rgba([r, g, b, 255])
    })
}

/// The largest difference of a channel at each pixel.
fn differences(a: &RgbaImage, b: &RgbaImage) -> Vec<u8> {
    a.pixels().zip(b.pixels()).map(|(a, b)| (0..3).map(|i| a.0[i].abs_diff(b.0[i])).max().unwrap()).collect()
}

fn count(differences: &[u8], least: u8) -> usize {
    differences.iter().filter(|difference| **difference >= least).count()
}

/// Outlines are smooth where a mesh's have steps, so that their pixels differ, and no others. The tallest is of some 200 pixels.
#[test]
fn surfaces_look_like_fine_meshes() {
    if !adapter::available() {
        return;
    }
    for look in LOOKS {
        let [surface, mesh] = [true, false].map(|implicit| picture(look, implicit, 1));
        let differences = differences(&surface, &mesh);
        let differing = [8, 40].map(|least| count(&differences, least));
        println!("{look:?}: {differing:?} pixels differ by 8 and 40 and more");
        assert!(differing[0] < 120, "{look:?}: {} pixels differ", differing[0]);
        assert!(differing[1] < 30, "{look:?}: {} pixels differ much", differing[1]);
    }
}

/// Against a mesh with sixteen samples per pixel.
#[test]
fn outlines_are_smooth() {
    if !adapter::available() {
        return;
    }
    for look in [Look::Plain, Look::Orthographic, Look::Stretched, Look::Block] {
        let smooth = downsampled(&picture(look, false, 4), 4);
        let [surface, mesh] = [true, false].map(|implicit| differences(&picture(look, implicit, 1), &smooth));
        // Some outlines are of floor and block, which are meshes in both pictures.
        let outline: Vec<(u8, u8)> =
            surface.into_iter().zip(mesh).filter(|(surface, mesh)| surface.abs_diff(*mesh) >= 4).collect();
        let error = |of: fn(&(u8, u8)) -> u8| {
            outline.iter().map(|pair| f64::from(of(pair)).powi(2)).sum::<f64>().sqrt() / (outline.len() as f64).sqrt()
        };
        let (surface, mesh) = (error(|pair| pair.0), error(|pair| pair.1));
        println!("{look:?}: RMS {surface:.1}/255 against {mesh:.1}/255, {} pixels", outline.len());
        assert!(outline.len() > 20, "{look:?}: the pictures are the same");
        assert!(surface < 0.4 * mesh, "{look:?}: RMS {surface} against {mesh}");
    }
}

/// A ball of glass before a block; without one, only what is behind it.
fn glass(shape: Option<Shape>, ior: f32) -> RgbaImage {
    let mut stage = Stage::with_field(Shading::Forward, SIZE, field(Look::Plain));
    let ball = stage.ball;
    stage.entity(ball).despawn();
    // Bevy undoes the mapping of what is seen through glass no more than roughly.
    let camera = stage.camera;
    stage.entity(camera).insert(Tonemapping::None);
    let world = stage.headless.app.world_mut();
    let block = world.resource_mut::<Assets<Mesh>>().add(Cuboid::new(0.5, 2.0, 1.0));
    let mut materials = world.resource_mut::<Assets<StandardMaterial>>();
    let red = materials.add(Color::srgb(0.8, 0.1, 0.1));
    let glass = materials.add(StandardMaterial {
        base_color: Color::WHITE,
        specular_transmission: 1.0,
        perceptual_roughness: 0.0,
        reflectance: 0.0,
        ior,
        ..default()
    });
    world.spawn((Mesh3d(block), MeshMaterial3d(red), Transform::from_xyz(-0.5, 1.0, -2.0)));
    if let Some(shape) = shape {
        let field = visfield::VisibilityField::of_shape(shape).unwrap();
        let field = world.resource_mut::<Assets<VisibilityField>>().add(VisibilityField(field));
        let at = Transform::from_xyz(0.0, 1.2, 0.0);
        world.spawn((ImplicitSurface3d(field), MeshMaterial3d(glass), NotFieldOccluder, at));
    }
    stage.picture()
}

#[test]
fn glass_bends_light() {
    if !adapter::available() {
        return;
    }
    let ball = Shape::Sphere { radius: 1.0 };
    let behind = glass(None, 1.5);
    let seen = |shape: Shape, ior| glass(Some(shape), ior);
    let like_air = differences(&behind, &seen(ball.clone(), 1.0));
    println!("{} pixels differ through air", count(&like_air, 8));
    assert!(count(&like_air, 8) < 40, "{} pixels differ through a ball of air", count(&like_air, 8));
    let convex = seen(ball.clone(), 1.5);
    let refracted = count(&differences(&behind, &convex), 8);
    assert!(refracted > 400, "{refracted} pixels differ through a ball of glass");
    // Not known to be convex, and traced from inside.
    let twice = Shape::Union(vec![ball.clone(), ball]);
    assert!(!twice.is_convex());
    let differing = count(&differences(&convex, &seen(twice, 1.5)), 8);
    println!("{differing} pixels differ from inside");
    assert!(differing < 40, "{differing} pixels differ from inside");
}
