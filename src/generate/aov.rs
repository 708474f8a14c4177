//! Further pictures of each sample, for uses that need more than annotations (`render.aov`).
//!
//! `aov/<episode>/<sample>.exr` of the front camera and `aov/<episode>/<camera>/<sample>.exr` of each other one, losslessly
//! compressed, one layer of the camera's size with the channels
//! `depth` (f32, metres along the optical axis, infinite for the sky), `instance` and `category` (u32,
//! instance 0 where there is no object, category 0 only for the sky); `aov/<episode>/objects.json` maps the numbers to
//! objects and categories. What is never annotated (`background`) has a category, and an instance if it is a thing.

use std::io::Cursor;
use std::path::{Path, PathBuf};

use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, WritableImage,
};
use fs_err as fs;
use serde::Serialize;
use smallvec::smallvec;

use super::GenerateError;
use crate::episode::EpisodeEntry;
use crate::episode::folder::AOV;
use crate::files::{PARTIAL_SUFFIX, give_final_name, write_atomic};
use crate::scene::SceneObject;
use crate::sensors::Rig;
use crate::store;

/// Name of the file that maps numbers to objects and categories.
const OBJECTS_FILE: &str = "objects.json";

/// What names of pictures end in.
const SUFFIX: &str = "exr";

/// The files of an episode's pictures from the data set's folder; `None` if any of `n_cameras` lacks one of the samples.
///
/// # Errors
/// The folder cannot be read.
pub(super) fn find_whole(
    data_set: &Path,
    entry: &EpisodeEntry,
    n_cameras: usize,
) -> std::io::Result<Option<Vec<PathBuf>>> {
    let inside = Path::new(AOV).join(&entry.name);
    let found = store::files_below(&data_set.join(&inside))?;
    let is_whole = lack_of(&found, n_cameras * entry.n_samples).is_none();
    Ok(is_whole.then(|| found.iter().map(|file| inside.join(file)).collect()))
}

/// What an episode lacks of its pictures, in words; `None` where they are whole.
///
/// # Errors
/// The folder cannot be read.
pub fn lacking_pictures(
    data_set: &Path,
    entry: &EpisodeEntry,
    n_cameras: usize,
) -> std::io::Result<Option<String>> {
    let found = store::files_below(&data_set.join(AOV).join(&entry.name))?;
    Ok(lack_of(&found, n_cameras * entry.n_samples))
}

/// What the files of an episode's pictures lack.
fn lack_of(files: &[PathBuf], wanted: usize) -> Option<String> {
    let is_picture = |file: &&PathBuf| file.extension().is_some_and(|suffix| suffix == SUFFIX);
    let n_pictures = files.iter().filter(is_picture).count();
    if n_pictures != wanted {
        return Some(format!("{n_pictures} of {wanted} further pictures are there"));
    }
    let has_objects = files.iter().any(|file| file == Path::new(OBJECTS_FILE));
    (!has_objects).then(|| format!("{OBJECTS_FILE} of the further pictures is missing"))
}

#[derive(Debug, Serialize)]
struct Entry<'a> {
    /// 0 for scenery.
    instance: u32,
    category_number: u32,
    id: &'a str,
    category: &'a str,
    background: bool,
}

/// The pictures of one episode, in a partial folder until all are written.
#[derive(Debug)]
pub(super) struct AovWriter {
    partial: PathBuf,
    whole: PathBuf,
    /// Folder under the partial one, and size, of each camera.
    cameras: Vec<(PathBuf, (usize, usize))>,
    /// Category number of each object, and of each category of the background.
    categories: Vec<u32>,
    background: Vec<u32>,
}

impl AovWriter {
    /// Begins an episode's folder; deletes what an earlier run left of it. `background`: categories without annotations.
    pub(super) fn create(
        data_set: &Path,
        episode: &str,
        rig: &Rig,
        objects: &[SceneObject],
        background: &[String],
    ) -> Result<Self, GenerateError> {
        let folder = data_set.join(AOV);
        let whole = folder.join(episode);
        let partial = folder.join(format!("{episode}.{PARTIAL_SUFFIX}"));
        for old in [&whole, &partial] {
            if old.exists() {
                fs::remove_dir_all(old)?;
            }
        }
        let cameras = rig.cameras.iter().enumerate().map(|(i, camera)| {
            let size_px = (camera.intrinsics.width_px as usize, camera.intrinsics.height_px as usize);
            (if i == 0 { PathBuf::new() } else { camera.name.clone().into() }, size_px)
        });
        let cameras: Vec<(PathBuf, (usize, usize))> = cameras.collect();
        for (of_camera, _) in &cameras {
            fs::create_dir_all(partial.join(of_camera))?;
        }
        let mut names: Vec<&str> = objects.iter().map(|object| object.category.as_str()).collect();
        names.extend(background.iter().map(String::as_str));
        names.sort_unstable();
        names.dedup();
        let number = |category: &str| {
            let place = names.iter().position(|name| *name == category);
            1 + place.expect("the list was made of these") as u32
        };
        let categories: Vec<u32> = objects.iter().map(|object| number(&object.category)).collect();
        let of_background: Vec<u32> = background.iter().map(|category| number(category)).collect();
        let things =
            (1..).zip(objects.iter().zip(&categories)).map(|(instance, (object, &category_number))| Entry {
                instance,
                category_number,
                id: &object.id,
                category: &object.category,
                background: object.is_background,
            });
        let scenery = background.iter().zip(&of_background).map(|(category, &category_number)| Entry {
            instance: 0,
            category_number,
            id: "",
            category,
            background: true,
        });
        let entries: Vec<Entry<'_>> = things.chain(scenery).collect();
        let json = serde_json::to_string_pretty(&entries).expect("a list of entries has a JSON form");
        write_atomic(&partial.join(OBJECTS_FILE), json.as_bytes())?;
        Ok(Self { partial, whole, cameras, categories, background: of_background })
    }

    /// Writes one sample of a camera; `shown` holds the object and the background category of each pixel, by index.
    pub(super) fn write(
        &self,
        camera_idx: usize,
        sample_idx: u64,
        depth_m: &[f32],
        shown: impl Iterator<Item = (Option<usize>, Option<usize>)>,
    ) -> Result<(), GenerateError> {
        let (of_camera, size_px) = &self.cameras[camera_idx];
        let (instance, category) = shown
            .map(|shown| match shown {
                (Some(object), _) => (object as u32 + 1, self.categories[object]),
                (None, Some(background)) => (0, self.background[background]),
                (None, None) => (0, 0),
            })
            .unzip();
        let channels = AnyChannels::sort(smallvec![
            AnyChannel::new("depth", FlatSamples::F32(depth_m.to_vec())),
            AnyChannel::new("instance", FlatSamples::U32(instance)),
            AnyChannel::new("category", FlatSamples::U32(category)),
        ]);
        let layer = Layer::new(*size_px, LayerAttributes::named("aov"), Encoding::SMALL_LOSSLESS, channels);
        let mut bytes = Cursor::new(Vec::new());
        Image::from_layer(layer)
            .write()
            .non_parallel()
            .to_buffered(&mut bytes)
            .map_err(|error| std::io::Error::other(format!("cannot pack an EXR picture: {error}")))?;
        write_atomic(
            &self.partial.join(of_camera).join(format!("{sample_idx:06}.{SUFFIX}")),
            &bytes.into_inner(),
        )?;
        Ok(())
    }

    /// Gives the folder its name.
    pub(super) fn finish(self) -> Result<(), GenerateError> {
        Ok(give_final_name(&self.partial, &self.whole)?)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use exr::prelude::read_all_flat_layers_from_file;

    use super::*;
    use crate::object::{Distribution, Event, Kind, Spot};
    use crate::sensors::{RigCameraConfig, RigConfig};

    fn object(id: &str, category: &str) -> SceneObject {
        SceneObject {
            id: id.into(),
            category: category.into(),
            kind: Kind::Static,
            distribution: Distribution::Id,
            body_name: format!("obj:{id}"),
            bounds: [[0.0; 3].into(), [1.0; 3].into()],
            solid: [[0.0; 3].into(), [1.0; 3].into()],
            triangles: Arc::new(Vec::new()),
            shapes: Vec::new(),
            reflectivity: 0.5,
            event: Event::None,
            spot: Spot::None,
            is_tipped: false,
            is_background: id.starts_with("bush"),
        }
    }

    #[test]
    fn an_exr_reads_back_as_it_was_written() {
        let folder = tempfile::tempdir().unwrap();
        let mut config = RigConfig::default();
        let front = config.cameras.get_mut("cam_front").unwrap();
        (front.width_px, front.height_px) = (16, 16);
        let back = RigCameraConfig { yaw_deg: 180.0, ..front.clone() };
        config.cameras.insert("cam_back".into(), back);
        let mut rig = Rig::try_from(&config).unwrap();
        for camera in &mut rig.cameras {
            (camera.intrinsics.width_px, camera.intrinsics.height_px) = (5, 1);
        }
        let objects = [object("tree-0", "tree"), object("bin-1", "bin"), object("bush-2", "bush")];
        let background = ["bush", "wall"].map(str::to_owned);
        let writer = AovWriter::create(folder.path(), "e", &rig, &objects, &background).unwrap();
        let depth_m = [1.5, f32::INFINITY, 0.25, 70.0, 3.0];
        let shown =
            [(Some(0), None), (None, None), (Some(1), None), (Some(2), Some(0)), (None, Some(1))].into_iter();
        writer.write(0, 3, &depth_m, shown).unwrap();
        writer.write(1, 3, &depth_m, [(None, None); 5].into_iter()).unwrap();
        assert!(!folder.path().join("aov/e").exists(), "not before it is whole");
        writer.finish().unwrap();
        let image = read_all_flat_layers_from_file(folder.path().join("aov/e/000003.exr")).unwrap();
        assert!(folder.path().join("aov/e/cam_back/000003.exr").exists());
        let channels = &image.layer_data[0].channel_data.list;
        let values = |name: &str| -> Vec<f32> {
            let channel = channels.iter().find(|channel| channel.name.eq(name)).unwrap();
            channel.sample_data.values_as_f32().collect()
        };
        assert_eq!(values("depth"), depth_m);
        assert_eq!(values("instance"), [1.0, 0.0, 2.0, 3.0, 0.0]);
        assert_eq!(values("category"), [3.0, 0.0, 1.0, 2.0, 4.0]);
        let json = fs::read_to_string(folder.path().join("aov/e/objects.json")).unwrap();
        assert!(json.contains("\"bin-1\"") && json.contains("\"category_number\": 2"), "{json}");
        assert_eq!(json.matches("\"background\": true").count(), 3, "a thing and two categories: {json}");
    }
}
