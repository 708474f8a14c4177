//! A clip as a folder of PNG files, `0000.png` and so on, and `frames.json` with how long each is shown.

use std::path::Path;

use image::RgbImage;
use serde::Serialize;

use super::ClipError;
use crate::files::{FolderContent, NewFolder};

/// The file by which such a folder is known.
const FRAMES: &str = "frames.json";

/// All files of such a folder.
const CONTENT: FolderContent =
    FolderContent { marker: FRAMES, files: &["####.png", "#####.png", "######.png"] };

/// One picture of the folder.
#[derive(Serialize)]
struct FrameEntry {
    file: String,
    duration_ms: u32,
}

pub(super) struct PictureFolder {
    folder: NewFolder,
    frames: Vec<FrameEntry>,
}

impl PictureFolder {
    pub(super) fn create(path: &Path, force: bool) -> Result<Self, ClipError> {
        Ok(Self { folder: NewFolder::create(path, CONTENT, force)?, frames: Vec::new() })
    }

    pub(super) fn add(&mut self, picture: &RgbImage, duration_ms: u32) -> Result<(), ClipError> {
        let file = format!("{:04}.png", self.frames.len());
        let mut png = Vec::new();
        picture
            .write_to(&mut std::io::Cursor::new(&mut png), image::ImageFormat::Png)
            .map_err(|error| super::encode_error(&self.folder.final_path(&file))(error.to_string()))?;
        self.folder.write(&file, &png)?;
        self.frames.push(FrameEntry { file, duration_ms });
        Ok(())
    }

    pub(super) fn finish(self) -> Result<(), ClipError> {
        let mut text = serde_json::to_string_pretty(&self.frames).expect("names and numbers are plain JSON");
        text.push('\n');
        self.folder.write(FRAMES, text.as_bytes())?;
        Ok(self.folder.finish()?)
    }
}
