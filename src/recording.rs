//! What the examples share: their options for rendering without a window, and the recording itself.

use std::path::{Path, PathBuf};

use bevy::math::UVec2;
use image::{ImageResult, RgbaImage};

use crate::headless::{HeadlessApp, write_gif};
use crate::moving_objects::{PERIOD, SceneClock};

/// The options of every example that records frames.
///
/// ```
/// use clap::Parser;
/// use visfield_workspace::recording::RecordingOptions;
/// #[derive(Parser)]
/// struct Options {
///     #[command(flatten)]
///     recording: RecordingOptions,
/// }
/// let options = Options::parse_from(["example", "--headless", "--frames", "3"]).recording;
/// assert!(options.headless && options.frames == 3);
/// ```
#[derive(clap::Args, Clone, Debug)]
pub struct RecordingOptions {
    /// Render without a window; write PNG frames and one animated GIF
    #[arg(long)]
    pub headless: bool,
    /// Number of frames of one loop to render without a window
    #[arg(long, default_value_t = 48, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub frames: u32,
    /// Folder for the frames and the GIF; made if it is missing [default: one under target]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Width and height of the frames in pixels
    #[arg(long, default_value = "640x360", value_parser = parse_size, value_name = "WIDTHxHEIGHT")]
    pub size: UVec2,
}

/// Parses the size of frames, for a command's arguments.
///
/// ```
/// use bevy::math::UVec2;
/// use visfield_workspace::recording::parse_size;
/// assert_eq!(parse_size("640x360"), Ok(UVec2::new(640, 360)));
/// assert!(parse_size("640").is_err());
/// ```
///
/// # Errors
/// A text that says what is expected.
pub fn parse_size(text: &str) -> Result<UVec2, String> {
    let side = |text: &str| text.parse().ok().filter(|side| (16..=8192).contains(side));
    let sides = text.split_once('x').and_then(|(width, height)| Some(UVec2::new(side(width)?, side(height)?)));
    sides.ok_or_else(|| "expected two numbers from 16 to 8192 such as 640x360".to_owned())
}

/// Frames on their way into a folder.
///
/// ```no_run
/// use visfield_workspace::headless::HeadlessApp;
/// use visfield_workspace::recording::{Recording, RecordingOptions};
/// fn record(mut headless: HeadlessApp, options: &RecordingOptions) -> image::ImageResult<()> {
///     let recording = Recording::new(options, "demo")?;
///     headless.wait_until_ready();
///     let gif = recording.run(&mut headless, "demo", HeadlessApp::capture)?;
///     println!("{}", gif.display());
///     Ok(())
/// }
/// ```
#[derive(Debug)]
pub struct Recording {
    folder: PathBuf,
    frames: u32,
}

impl Recording {
    /// Makes the folder, `target/NAME` unless another one was asked for, and clears it of an earlier recording.
    ///
    /// # Errors
    /// If the folder cannot be written to.
    pub fn new(options: &RecordingOptions, name: &str) -> std::io::Result<Self> {
        let folder = options.out.clone().unwrap_or_else(|| Path::new("target").join(name));
        clear(&folder)?;
        println!("rendering {} frames of {} × {} pixels", options.frames, options.size.x, options.size.y);
        Ok(Self { folder, frames: options.frames })
    }

    /// Takes frames evenly over one loop of the scene, whose [`SceneClock`] it sets, and returns the path of their GIF.
    ///
    /// # Errors
    /// If the folder cannot be written to.
    pub fn run(
        &self,
        headless: &mut HeadlessApp,
        name: &str,
        mut take: impl FnMut(&mut HeadlessApp) -> RgbaImage,
    ) -> ImageResult<PathBuf> {
        let frames = record_frames(headless, &self.folder, self.frames, |headless, frame| {
            headless.app.world_mut().resource_mut::<SceneClock>().0 = PERIOD * frame as f32 / self.frames as f32;
            take(headless)
        })?;
        let gif = self.folder.join(format!("{name}.gif"));
        write_gif(&gif, frames, PERIOD)?;
        println!("frames rendered: {}; the animation of {PERIOD} s is {}", self.frames, gif.display());
        Ok(gif)
    }
}

/// Renders `count` frames, each taken by `take`, into a folder, and returns them. The folder is made if it is missing; frames of an
/// earlier recording go.
///
/// # Errors
/// If a file cannot be written.
pub fn record_frames(
    headless: &mut HeadlessApp,
    folder: &Path,
    count: u32,
    mut take: impl FnMut(&mut HeadlessApp, u32) -> RgbaImage,
) -> ImageResult<Vec<RgbaImage>> {
    clear(folder)?;
    let progress = indicatif::ProgressBar::new(count.into()).with_message("frames");
    let mut frames = Vec::new();
    for frame in 0..count {
        let picture = take(headless, frame);
        picture.save(folder.join(format!("frame_{frame:04}.png")))?;
        frames.push(picture);
        progress.inc(1);
    }
    progress.finish();
    Ok(frames)
}

/// Makes a folder, or clears it of an earlier recording.
fn clear(folder: &Path) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)
        .and_then(|()| remove_old_frames(folder))
        .map_err(|error| std::io::Error::new(error.kind(), format!("{}: {error}", folder.display())))
}

/// Frames of an earlier, longer recording would mix with the new ones.
fn remove_old_frames(folder: &Path) -> std::io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let number = name.strip_prefix("frame_").and_then(|rest| rest.strip_suffix(".png"));
        // Only what a recording writes, not a user's own frame_final.png.
        if number.is_some_and(|number| number.len() == 4 && number.bytes().all(|digit| digit.is_ascii_digit())) {
            std::fs::remove_file(&path)?;
        }
    }
    Ok(())
}
