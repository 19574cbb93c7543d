//! What a surface receives, as the prepass tells the frame's passes.

use bevy::asset::RenderAssetUsages;
use bevy::core_pipeline::prepass::DeferredPrepass;
use bevy::mesh::MeshTag;
use bevy::pbr::DefaultOpaqueRendererMethod;
use bevy::prelude::*;
use bevy::render::render_resource::{AsBindGroup, Extent3d, TextureDimension, TextureFormat};
use bevy_visfield::prelude::*;
use visfield_workspace::headless::HeadlessApp;
use visfield_workspace::probe::{self, ProbedCamera};

use crate::adapter;

const SIZE: UVec2 = UVec2::new(160, 48);

/// What the materials of the row of panels differ in.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Surface {
    Plain,
    NormalMapped,
    Unlit,
    /// Bevy discards pixels in the prepass.
    Masked,
    /// A material without a prepass shader of its own.
    Bare,
}

/// A material with Bevy's default shaders.
#[derive(Asset, AsBindGroup, TypePath, Clone)]
struct BareMaterial {}

impl Material for BareMaterial {}

fn material(world: &mut World, surface: Surface) -> StandardMaterial {
    let flat = Image::new_fill(
        Extent3d { width: 1, height: 1, depth_or_array_layers: 1 },
        TextureDimension::D2,
        &[128, 128, 255, 255],
        TextureFormat::Rgba8Unorm,
        RenderAssetUsages::default(),
    );
    let plain = StandardMaterial::default();
    match surface {
        Surface::Plain | Surface::Bare => plain,
        Surface::NormalMapped => {
            let flat = world.resource_mut::<Assets<Image>>().add(flat);
            StandardMaterial { normal_map_texture: Some(flat), ..plain }
        }
        Surface::Unlit => StandardMaterial { unlit: true, ..plain },
        Surface::Masked => StandardMaterial { alpha_mode: AlphaMode::Mask(0.5), ..plain },
    }
}

/// Four panels in a row, seen from the front, with all four values of the flags, and what the prepass wrote for each.
fn flags_of_a_row(surface: Surface, deferred: bool) -> [f32; 4] {
    let mut headless = HeadlessApp::new(SIZE, |plugins| plugins);
    headless.app.add_plugins((VisibilityFieldPlugin, MaterialPlugin::<BareMaterial>::default()));
    probe::install(&mut headless.app);
    let target = headless.target();
    let world = headless.app.world_mut();
    let mesh =
        Mesh::from(Rectangle::new(1.0, 1.0)).with_generated_tangents().expect("a rectangle has what tangents need");
    let mesh = world.resource_mut::<Assets<Mesh>>().add(mesh);
    let material = material(world, surface);
    let material = world.resource_mut::<Assets<StandardMaterial>>().add(material);
    let panels: [Entity; 4] = std::array::from_fn(|i| {
        let place = Transform::from_xyz(i as f32 - 1.5, 0.0, 0.0);
        world.spawn((Mesh3d(mesh.clone()), MeshMaterial3d(material.clone()), place)).id()
    });
    if surface == Surface::Bare {
        let bare = world.resource_mut::<Assets<BareMaterial>>().add(BareMaterial {});
        for panel in panels {
            let mut panel = world.entity_mut(panel);
            panel.remove::<MeshMaterial3d<StandardMaterial>>().insert(MeshMaterial3d(bare.clone()));
        }
    }
    world.entity_mut(panels[1]).insert((OwnSurfaceOcclusion::Off, MeshTag(5)));
    world.entity_mut(panels[2]).insert(NotFieldReceiver);
    world.entity_mut(panels[3]).insert((OwnSurfaceOcclusion::Off, NotFieldReceiver));
    let projection = OrthographicProjection {
        scaling_mode: bevy::camera::ScalingMode::Fixed { width: 4.0, height: 1.2 },
        ..OrthographicProjection::default_3d()
    };
    let camera = (Camera3d::default(), Msaa::Off, FieldOcclusion::default(), Projection::from(projection), target);
    let camera = world.spawn((camera, Transform::from_xyz(0.0, 0.0, 5.0), ProbedCamera)).id();
    if deferred {
        world.insert_resource(DefaultOpaqueRendererMethod::deferred());
        world.entity_mut(camera).insert(DeferredPrepass);
    }
    headless.wait_until_ready();
    // The column at a panel's middle.
    let at_panels = |headless: &mut HeadlessApp| -> [f32; 4] {
        let receivers = probe::read(headless).receivers;
        std::array::from_fn(|i| receivers[(SIZE.y / 2 * SIZE.x) as usize + 20 + i * 40])
    };
    let flagged = at_panels(&mut headless);

    // Taken back, they leave what Bevy's own prepass writes.
    for panel in panels {
        headless.app.world_mut().entity_mut(panel).remove::<(OwnSurfaceOcclusion, NotFieldReceiver)>();
    }
    assert_eq!(at_panels(&mut headless), [1.0; 4], "{surface:?}, deferred: {deferred}");
    flagged
}

#[test]
fn the_prepass_tells_what_surfaces_receive() {
    if !adapter::available() {
        return;
    }
    for deferred in [false, true] {
        for surface in [Surface::Plain, Surface::NormalMapped, Surface::Unlit, Surface::Masked, Surface::Bare] {
            let found = flags_of_a_row(surface, deferred);
            let expected = [3.0, 2.0, 1.0, 0.0].map(|flags| flags / 3.0);
            let error = std::iter::zip(found, expected).map(|(found, expected)| (found - expected).abs());
            assert!(error.fold(0.0, f32::max) < 1e-3, "{surface:?}, deferred: {deferred}: {found:?}");
        }
    }
}
