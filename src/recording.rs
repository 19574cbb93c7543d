//! Frames of apps without a window, as files.

use std::path::Path;

use bevy::math::UVec2;
use image::RgbaImage;

use crate::headless::HeadlessApp;

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

/// Renders `count` frames into a folder, each set up by `prepare`, and returns them. The folder is made if it is missing; frames of an
/// earlier recording go.
///
/// # Errors
/// If a file cannot be written.
pub fn record_frames(
    headless: &mut HeadlessApp,
    folder: &Path,
    count: u32,
    mut prepare: impl FnMut(&mut HeadlessApp, u32),
) -> image::ImageResult<Vec<RgbaImage>> {
    std::fs::create_dir_all(folder)?;
    remove_old_frames(folder)?;
    let progress = indicatif::ProgressBar::new(count.into()).with_message("frames");
    let mut frames = Vec::new();
    for frame in 0..count {
        prepare(headless, frame);
        let picture = headless.capture();
        picture.save(folder.join(format!("frame_{frame:04}.png")))?;
        frames.push(picture);
        progress.inc(1);
    }
    progress.finish();
    Ok(frames)
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
