//! Bevy apps that render into an image, without a window: for recordings and tests.

use std::path::Path;
use std::sync::{Arc, LazyLock, Mutex};

use bevy::app::PluginsState;
use bevy::camera::RenderTarget;
use bevy::prelude::*;
use bevy::render::pipelined_rendering::PipelinedRenderingPlugin;
use bevy::render::render_resource::{PipelineCache, TextureFormat};
use bevy::render::view::screenshot::{Screenshot, ScreenshotCaptured};
use bevy::render::{RenderApp, RenderPlugin};
use bevy::window::ExitCondition;
use bevy::winit::WinitPlugin;
use image::RgbaImage;

/// The folder of the project's assets: below `BEVY_ASSET_ROOT` where that is set, as for programs that were copied somewhere else, or
/// in the source tree.
pub static ASSETS: LazyLock<String> = LazyLock::new(|| match std::env::var("BEVY_ASSET_ROOT") {
    Ok(root) => format!("{root}/assets"),
    Err(_) => concat!(env!("CARGO_MANIFEST_DIR"), "/assets").to_owned(),
});

/// Updates after which an app that is still not ready is given up.
const MAX_UPDATES: usize = 20_000;

/// An app that renders into an image.
///
/// ```no_run
/// use bevy::prelude::*;
/// use visfield_workspace::headless::HeadlessApp;
/// let mut headless = HeadlessApp::new(UVec2::new(320, 180), |plugins| plugins);
/// let target = headless.target();
/// headless.app.world_mut().spawn((Camera3d::default(), target));
/// headless.wait_until_ready();
/// headless.capture().save("empty.png")?;
/// # Ok::<(), image::ImageError>(())
/// ```
pub struct HeadlessApp {
    /// The app; add plugins, systems and entities before the first update.
    pub app: App,
    target: Handle<Image>,
    started: bool,
}

impl HeadlessApp {
    /// An app with Bevy's default plugins less the window, and an image of `size` pixels to render into. `adjust` may change
    /// the plugins further.
    pub fn new(
        size: UVec2,
        adjust: impl FnOnce(bevy::app::PluginGroupBuilder) -> bevy::app::PluginGroupBuilder,
    ) -> Self {
        let plugins = DefaultPlugins
            .set(WindowPlugin { primary_window: None, exit_condition: ExitCondition::DontExit, ..default() })
            .set(AssetPlugin { file_path: ASSETS.to_owned(), ..default() })
            // A frame is complete as soon as its assets are: no pipeline is still compiling.
            .set(RenderPlugin { synchronous_pipeline_compilation: true, ..default() })
            .disable::<WinitPlugin>()
            // So that an update ends with its own frame, and tests can look into the render world.
            .disable::<PipelinedRenderingPlugin>();
        let mut app = App::new();
        app.add_plugins(adjust(plugins));
        let image = Image::new_target_texture(size.x, size.y, TextureFormat::Rgba8UnormSrgb, None);
        let target = app.world_mut().resource_mut::<Assets<Image>>().add(image);
        Self { app, target, started: false }
    }

    /// What a camera needs to render into the image.
    pub fn target(&self) -> RenderTarget {
        RenderTarget::Image(self.target.clone().into())
    }

    /// Runs one frame.
    pub fn update(&mut self) {
        if !self.started {
            while self.app.plugins_state() == PluginsState::Adding {
                bevy::tasks::tick_global_task_pools_on_main_thread();
            }
            self.app.finish();
            self.app.cleanup();
            self.started = true;
        }
        self.app.update();
    }

    /// Runs frames until `done` says so.
    ///
    /// # Panics
    /// After very many frames: what is waited for will not happen.
    pub fn update_until(&mut self, mut done: impl FnMut(&mut App) -> bool) {
        for _ in 0..MAX_UPDATES {
            self.update();
            if done(&mut self.app) {
                return;
            }
            // Assets load in the background; leave them the processor.
            std::thread::sleep(std::time::Duration::from_millis(2));
        }
        panic!("the app is still not ready after {MAX_UPDATES} frames");
    }

    /// Runs frames until every mesh and field that an entity uses has arrived, and every pipeline is compiled, for several
    /// frames in a row.
    pub fn wait_until_ready(&mut self) {
        let mut calm = 0;
        self.update_until(|app| {
            calm = if assets_arrived(app) && pipelines_compiled(app) { calm + 1 } else { 0 };
            calm > 3
        });
    }

    /// Renders one more frame and returns it.
    ///
    /// # Panics
    /// If the frame never arrives.
    pub fn capture(&mut self) -> RgbaImage {
        let captured: Arc<Mutex<Option<Image>>> = Arc::default();
        let slot = Arc::clone(&captured);
        self.app.world_mut().spawn(Screenshot::image(self.target.clone())).observe(
            move |screenshot: On<ScreenshotCaptured>| {
                *slot.lock().expect("no observer panicked") = Some(screenshot.image.clone());
            },
        );
        self.update_until(|_| captured.lock().expect("no observer panicked").is_some());
        let image = captured.lock().expect("no observer panicked").take().expect("it was just seen");
        image.try_into_dynamic().expect("the target has a format that images know").into_rgba8()
    }
}

/// # Panics
/// If an asset failed to load: it will not arrive.
fn assets_arrived(app: &mut App) -> bool {
    use bevy_visfield::prelude::{VisibilityField, VisibilityField3d};
    let world = app.world_mut();
    let meshes: Vec<_> = world.query::<&Mesh3d>().iter(world).map(|mesh| mesh.id()).collect();
    let fields: Vec<_> = world.query::<&VisibilityField3d>().iter(world).map(|field| field.id()).collect();
    let server = world.resource::<AssetServer>();
    let mesh_ids = meshes.iter().map(|id| id.untyped());
    let mut all = mesh_ids.chain(fields.iter().map(|id| id.untyped()));
    let failed = all.find(|id| server.load_state(*id).is_failed());
    assert!(failed.is_none(), "asset {failed:?} failed to load");
    let have_meshes = world.resource::<Assets<Mesh>>();
    let have_fields = world.get_resource::<Assets<VisibilityField>>();
    meshes.iter().all(|id| have_meshes.contains(*id))
        && fields.iter().all(|id| have_fields.is_some_and(|fields| fields.contains(*id)))
}

fn pipelines_compiled(app: &App) -> bool {
    let cache = app.sub_app(RenderApp).world().resource::<PipelineCache>();
    cache.waiting_pipelines().next().is_none()
}

/// Writes frames as one looping GIF, `seconds` long.
///
/// # Errors
/// If the file cannot be written.
pub fn write_gif(path: &Path, frames: Vec<RgbaImage>, seconds: f32) -> image::ImageResult<()> {
    use image::codecs::gif::{GifEncoder, Repeat};
    let per_frame = std::time::Duration::from_secs_f32(seconds / frames.len().max(1) as f32);
    let delay = image::Delay::from_saturating_duration(per_frame);
    let file = std::io::BufWriter::new(std::fs::File::create(path)?);
    let mut encoder = GifEncoder::new_with_speed(file, 10);
    encoder.set_repeat(Repeat::Infinite)?;
    encoder.encode_frames(frames.into_iter().map(|frame| image::Frame::from_parts(frame, 0, 0, delay)))
}
