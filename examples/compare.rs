//! The scene of `moving_objects` four times: with Bevy's own screen-space ambient occlusion and shadow maps, with visibility
//! fields, with exact rays against the triangles, and the difference between fields and exact rays.
//!
//! Look at what the screen does not show: the floor under the chairs and the walls behind the knots stay light in Bevy's
//! pane, and dark in the others. Its sun has a hard edge everywhere; the others' widens. Its ambient occlusion has its default
//! quality, high, and is rendered into an image of its own, because its shaders know nothing of viewports.
//!
//! The pane of exact rays is shaded by Bevy too, from the same materials, with exact visibility in the place of what fields
//! find: it differs from the fields' pane in nothing else. The last pane is grey where both agree; brighter where fields let too
//! much light through, darker where too little, five times exaggerated, as a share of the light that would fall there without
//! any occluder. What remains are edges of penumbrae, contacts, and creases of the objects themselves.
//!
//! `cargo run --example compare` opens a window, where exact rays are sent in the background while the scene is paused;
//! `--headless` records frames with a reference each, and prints the mean absolute errors.
//!
//! | key | |
//! | --- | --- |
//! | Space | pause, which starts the reference; and on again |
//! | Q | quality of the fields: low, medium, high, ultra |
//! | Esc | quit |

use std::error::Error;
use std::process::ExitCode;
use std::sync::Arc;

use bevy::anti_alias::fxaa::Fxaa;
use bevy::asset::RenderAssetUsages;
use bevy::camera::RenderTarget;
use bevy::camera::visibility::RenderLayers;
use bevy::image::ToExtents;
use bevy::pbr::ScreenSpaceAmbientOcclusion;
use bevy::prelude::*;
use bevy::render::render_resource::{Extent3d, TextureDimension, TextureFormat};
use bevy::tasks::futures::check_ready;
use bevy::tasks::{AsyncComputeTaskPool, Task};
use bevy_visfield::prelude::*;
use clap::Parser;
use visfield::estimate::light::Light;
use visfield_workspace::headless::HeadlessApp;
use visfield_workspace::moving_objects::{
    SceneClock, camera_transform, default_parts, move_objects, objects, spawn_objects, spawn_surroundings,
};
use visfield_workspace::panes::{Pane, fit_panes, help, label};
use visfield_workspace::probe::{self, FrameProbe, ProbedCamera, ProbedFrame};
use visfield_workspace::recording::{Recording, RecordingOptions};
use visfield_workspace::reference::{Errors, ExactFrame, Progress, ReferenceMeshes, trace_frame};
use visfield_workspace::reference_view::{self, ExactVisibility};
use visfield_workspace::window::{Paused, exit_code, next_quality, tick, window_app};

/// Visibility fields, Bevy's screen-space ambient occlusion and shadow maps, exact rays, and the difference
#[derive(Parser, Resource, Clone, Debug)]
struct Options {
    #[command(flatten)]
    recording: RecordingOptions,
    /// Exact rays per pixel for ambient occlusion, and as many for the sun
    #[arg(long, default_value_t = 256, value_parser = clap::value_parser!(u32).range(1..=4096), value_name = "RAYS")]
    reference_rays: u32,
}

/// What cameras render to, if not the window.
#[derive(Resource)]
struct Target(Option<RenderTarget>);

#[derive(Resource)]
struct Meshes(ReferenceMeshes);

/// The camera of exact rays, the picture of differences, and what is written on both.
#[derive(Resource)]
struct ReferencePane {
    camera: Entity,
    text: Entity,
    difference: Entity,
}

/// The pane that shows a camera's image.
#[derive(Component)]
struct ShownIn(Entity);

/// The sun that shines into the panes of fields and exact rays, and the one with shadow maps.
const FIELD_LAYER: usize = 1;
const MAP_LAYER: usize = 2;
/// Where nothing is.
const EMPTY_LAYER: usize = 3;

/// The least width and height of the picture with Bevy's SSAO, in pixels: it makes five mip levels, too many for what a
/// minimised window leaves.
const LEAST_SSAO: u32 = 32;

fn main() -> ExitCode {
    let options = Options::parse();
    match run(options) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(options: Options) -> Result<ExitCode, Box<dyn Error>> {
    let meshes = Meshes(ReferenceMeshes::read()?);
    if options.recording.headless {
        record(options, meshes)?;
        return Ok(ExitCode::SUCCESS);
    }
    let mut app = window_app("visfield: compare");
    add_scene(&mut app, options, meshes, None);
    app.init_resource::<Paused>()
        .init_resource::<Job>()
        .add_systems(Update, ((tick, press_keys).before(move_objects), advance_reference.after(move_objects)));
    Ok(exit_code(app.run()))
}

fn add_scene(app: &mut App, options: Options, meshes: Meshes, target: Option<RenderTarget>) {
    app.add_plugins(VisibilityFieldPlugin)
        .insert_resource(ClearColor(Color::srgb(0.72, 0.80, 0.90)))
        .insert_resource(options)
        .insert_resource(meshes)
        .insert_resource(Target(target))
        .init_resource::<SceneClock>()
        .add_systems(Startup, (spawn_scene, spawn_panes, split_sun).chain())
        .add_systems(Update, (move_objects, (fit_panes, fit_image).chain()));
    probe::install(app);
    reference_view::install(app);
}

fn spawn_scene(
    mut commands: Commands,
    server: Res<AssetServer>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    spawn_objects(&mut commands, &mut materials, &default_parts(&server));
    spawn_surroundings(&mut commands, &mut meshes, &mut materials);
}

/// Gives Bevy's pane a sun of its own, with shadow maps.
fn split_sun(
    mut commands: Commands,
    sun: Single<(Entity, &DirectionalLight, &Transform)>,
    meshes: Query<Entity, With<Mesh3d>>,
) {
    let (entity, light, transform) = *sun;
    let with_maps = DirectionalLight { shadow_maps_enabled: true, ..*light };
    commands.spawn((with_maps, *transform, RenderLayers::layer(MAP_LAYER)));
    commands.entity(entity).insert(RenderLayers::layer(FIELD_LAYER));
    // Shadow maps show what shares a layer with their light.
    for mesh in &meshes {
        commands.entity(mesh).insert(RenderLayers::layer(0).with(MAP_LAYER));
    }
}

fn spawn_panes(mut commands: Commands, target: Res<Target>, mut images: ResMut<Assets<Image>>) {
    // Bevy's default font knows ASCII alone.
    let names = ["Bevy: SSAO and shadow maps", "visibility fields", "exact rays", "fields minus exact, 5 times"];
    let view =
        |order| (Camera3d::default(), Camera { order, ..default() }, Msaa::Off, Fxaa::default(), camera_transform());
    let panes = std::array::from_fn(|i| {
        let cell = uvec2(i as u32 % 2, i as u32 / 2);
        let mut camera = commands.spawn((view(i as isize), Pane { cell, grid: UVec2::splat(2) }));
        if let Some(target) = &target.0 {
            camera.insert(target.clone());
        }
        camera.id()
    });
    for (camera, name) in panes.into_iter().zip(names) {
        commands.spawn(label(camera, name));
    }
    let [maps, fields, exact, difference] = panes;
    let with_layer = |layer| RenderLayers::layer(0).with(layer);
    // Below the labels, in whatever order nodes are found.
    let back = ZIndex(-1);
    let all = Node { width: percent(100), height: percent(100), position_type: PositionType::Absolute, ..default() };
    // Bevy's screen-space ambient occlusion takes any viewport for the whole target. So its camera has an image as its target,
    // which this pane shows.
    let image = Image::new_target_texture(LEAST_SSAO, LEAST_SSAO, TextureFormat::Rgba8UnormSrgb, None);
    let image = images.add(image);
    commands.spawn((all.clone(), ImageNode::new(image.clone()), back, UiTargetCamera(maps)));
    let occlusion = ScreenSpaceAmbientOcclusion::default();
    commands.spawn((view(-1), RenderTarget::Image(image.into()), occlusion, with_layer(MAP_LAYER), ShownIn(maps)));
    commands.entity(maps).insert(RenderLayers::layer(EMPTY_LAYER));
    let occlusion = FieldOcclusion { quality: FieldOcclusionQuality::High, ..default() };
    commands.entity(fields).insert((occlusion, ProbedCamera, with_layer(FIELD_LAYER)));
    // What it finds is replaced, so it may be cheap.
    let replaced = FieldOcclusion { quality: FieldOcclusionQuality::Low, ..default() };
    commands.entity(exact).insert((replaced, RenderLayers::layer(EMPTY_LAYER)));
    commands.entity(difference).insert(RenderLayers::layer(EMPTY_LAYER));
    let picture = commands.spawn((all, ImageNode::default(), back, UiTargetCamera(difference))).id();
    let text = commands.spawn(help(exact, "pause to trace")).id();
    commands.insert_resource(ReferencePane { camera: exact, text, difference: picture });
    if target.0.is_none() {
        commands.spawn(help(fields, "Space pause and trace   Q quality   Esc quit"));
    }
}

/// Keeps a camera's image as large as the pane that shows it.
fn fit_image(
    panes: Query<&Camera>,
    shown: Single<(&ShownIn, &RenderTarget, &mut Projection)>,
    mut images: ResMut<Assets<Image>>,
) {
    let (pane, target, mut projection) = shown.into_inner();
    let size = panes.get(pane.0).ok().and_then(Camera::physical_viewport_size);
    let (Some(size), Some(handle)) = (size, target.as_image()) else { return };
    let size = size.max(UVec2::splat(LEAST_SSAO));
    if let Some(mut image) = images.get_mut(handle)
        && image.size() != size
    {
        image.resize(size.to_extents());
        // Bevy then looks at the target's size in this very frame.
        projection.set_changed();
    }
}

/// Everything that a reference needs of the world, to be traced elsewhere.
struct Question {
    frame: ProbedFrame,
    meshes: ReferenceMeshes,
    seconds: f32,
    rays: u32,
    sun: Light,
}

/// A reference, and what it says about the fields.
struct Answer {
    exact: ExactFrame,
    size: UVec2,
    difference: Vec<u8>,
    ambient: Errors,
    sun: Errors,
}

impl Question {
    fn new(
        frame: ProbedFrame,
        meshes: &Meshes,
        seconds: f32,
        options: &Options,
        (sun, shadows): (&GlobalTransform, &FieldShadows),
    ) -> Self {
        let sun = Light::directional(sun.back().into(), shadows.angular_radius);
        Self { frame, meshes: meshes.0.clone(), seconds, rays: options.reference_rays, sun }
    }

    /// `None` if it was cancelled.
    fn answer(&self, progress: &Progress) -> Option<Answer> {
        let frame = &self.frame;
        let instances = objects().into_iter().map(|object| (object.mesh, object.transform_at(self.seconds)));
        let scene = self.meshes.scene(instances, frame.camera.as_dvec3()).expect("they were baked");
        let exact = trace_frame(&scene, frame, self.rays, (&self.sun, self.rays), progress)?;
        let (mut ambient, mut sun) = (Errors::default(), Errors::default());
        let mut difference = Vec::new();
        for ((exact, found), pixel) in exact.iter().zip(&frame.visibility).zip(frame.geometry.pixels()) {
            let mut error = 0.0;
            if let Some(exact) = exact {
                ambient.add(found[0], exact[0]);
                sun.add(found[1], exact[1]);
                // As the scene's sky and sun share the light on a surface that faces the sun.
                let facing = frame.geometry.receiver_at(pixel).normal.dot(self.sun.origin).max(0.0);
                error = AMBIENT_SHARE * (found[0] - exact[0]) + (1.0 - AMBIENT_SHARE) * facing * (found[1] - exact[1]);
            }
            let grey = ((0.5 + 5.0 * error).clamp(0.0, 1.0) * 255.0).round() as u8;
            difference.extend([grey, grey, grey, 255]);
        }
        Some(Answer { exact, size: frame.geometry.size, difference, ambient, sun })
    }
}

/// Ambient light of 1,000 cd/m² beside a sun of 5,000 lx, which a white surface makes 5,000 ÷ π cd/m².
const AMBIENT_SHARE: f32 = 0.386;

impl Answer {
    fn show(&self, world: &mut World) {
        let extent = Extent3d { width: self.size.x, height: self.size.y, depth_or_array_layers: 1 };
        let usage = RenderAssetUsages::RENDER_WORLD;
        let (dimension, format) = (TextureDimension::D2, TextureFormat::Rgba8UnormSrgb);
        let image = Image::new(extent, dimension, self.difference.clone(), format, usage);
        let image = world.resource_mut::<Assets<Image>>().add(image);
        let pane = world.resource::<ReferencePane>();
        let (camera, text, difference) = (pane.camera, pane.text, pane.difference);
        world.entity_mut(difference).insert(ImageNode::new(image));
        let layers = RenderLayers::layer(0).with(FIELD_LAYER);
        world.entity_mut(camera).insert((layers, ExactVisibility::new(self.size, &self.exact)));
        let errors = format!("mean error: ambient {:.4}, sun {:.4}", self.ambient.mean(), self.sun.mean());
        world.entity_mut(text).insert(Text::new(errors));
    }
}

/// Records frames with a reference each.
fn record(options: Options, meshes: Meshes) -> image::ImageResult<()> {
    let recording = Recording::new(&options.recording, "compare")?;
    let mut headless = HeadlessApp::new(options.recording.size, |plugins| plugins);
    let target = headless.target();
    add_scene(&mut headless.app, options, meshes, Some(target));
    headless.wait_until_ready();
    recording.run(&mut headless, "compare", |headless| {
        let frame = probe::read(headless);
        let world = headless.app.world_mut();
        let sun = world.query::<(&GlobalTransform, &FieldShadows)>().single(world).expect("one sun has field shadows");
        let (meshes, clock, options) =
            (world.resource::<Meshes>(), world.resource::<SceneClock>().0, world.resource::<Options>());
        let question = Question::new(frame, meshes, clock, options, sun);
        let answer = question.answer(&Progress::default()).expect("nobody cancels it");
        println!("{:.2} s, ambient occlusion: {}", question.seconds, answer.ambient);
        println!("{:.2} s, sun: {}", question.seconds, answer.sun);
        answer.show(world);
        headless.wait_until_ready();
        headless.capture()
    })?;
    Ok(())
}

fn press_keys(
    keys: Res<ButtonInput<KeyCode>>,
    mut paused: ResMut<Paused>,
    mut job: ResMut<Job>,
    mut exit: MessageWriter<AppExit>,
    mut fields: Single<&mut FieldOcclusion, With<ProbedCamera>>,
) {
    if keys.just_pressed(KeyCode::Escape) {
        exit.write(AppExit::Success);
    }
    if keys.just_pressed(KeyCode::Space) {
        paused.0 = !paused.0;
        job.restart();
    }
    if keys.just_pressed(KeyCode::KeyQ) {
        fields.quality = next_quality(fields.quality);
        job.restart();
    }
}

/// The reference of a window's paused frame.
#[derive(Resource, Default)]
enum Job {
    #[default]
    Idle,
    /// The frames that were drawn since what is to be traced last changed.
    Settling(u32),
    Reading,
    Tracing {
        task: Task<Option<Answer>>,
        progress: Arc<Progress>,
        size: UVec2,
    },
    Shown(UVec2),
}

impl Job {
    fn restart(&mut self) {
        if let Self::Tracing { progress, .. } = self {
            progress.cancel();
        }
        *self = Self::Settling(0);
    }
}

/// Frames until a change has reached what is drawn: the render world is one behind.
const SETTLED: u32 = 3;

fn advance_reference(world: &mut World) {
    let paused = world.resource::<Paused>().0;
    let now = pane_size(world);
    let mut job = std::mem::take(&mut *world.resource_mut::<Job>());
    if !paused {
        if !matches!(job, Job::Idle) {
            hide_reference(world);
        }
        job = Job::Idle;
    } else if matches!(&job, Job::Tracing { size, .. } | Job::Shown(size) if Some(*size) != now) {
        job.restart();
    }
    let job = match job {
        Job::Settling(frames) if frames < SETTLED => Job::Settling(frames + 1),
        Job::Settling(_) => {
            world.resource::<FrameProbe>().request();
            Job::Reading
        }
        Job::Reading => match world.resource::<FrameProbe>().take() {
            Some(frame) => begin(world, frame),
            None => Job::Reading,
        },
        Job::Tracing { mut task, progress, size } => match check_ready(&mut task) {
            Some(Some(answer)) => {
                answer.show(world);
                Job::Shown(size)
            }
            Some(None) => Job::Settling(0),
            None => {
                let percent = 100 * progress.rows() / size.y.max(1);
                write(world, format!("tracing: {percent} %"));
                Job::Tracing { task, progress, size }
            }
        },
        Job::Idle | Job::Shown(_) => job,
    };
    *world.resource_mut::<Job>() = job;
}

fn pane_size(world: &mut World) -> Option<UVec2> {
    let camera = world.query_filtered::<&Camera, With<ProbedCamera>>().single(world).ok()?;
    camera.physical_viewport_size()
}

fn begin(world: &mut World, frame: ProbedFrame) -> Job {
    let Ok(sun) = world.query::<(&GlobalTransform, &FieldShadows)>().single(world) else { return Job::Idle };
    let (meshes, clock, options) =
        (world.resource::<Meshes>(), world.resource::<SceneClock>().0, world.resource::<Options>());
    let size = frame.geometry.size;
    let question = Question::new(frame, meshes, clock, options, sun);
    let progress = Arc::new(Progress::default());
    let shared = Arc::clone(&progress);
    let task = AsyncComputeTaskPool::get().spawn(async move { question.answer(&shared) });
    Job::Tracing { task, progress, size }
}

fn hide_reference(world: &mut World) {
    let pane = world.resource::<ReferencePane>();
    let (camera, difference) = (pane.camera, pane.difference);
    world.entity_mut(camera).insert(RenderLayers::layer(EMPTY_LAYER)).remove::<ExactVisibility>();
    world.entity_mut(difference).insert(ImageNode::default());
    write(world, "pause to trace");
}

fn write(world: &mut World, text: impl Into<String>) {
    let place = world.resource::<ReferencePane>().text;
    world.entity_mut(place).insert(Text::new(text));
}
