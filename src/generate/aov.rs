//! Further pictures of each sample, for uses that need more than annotations (`render.aov`).
//!
//! `aov/<episode>/<sample>.exr`, losslessly compressed, one layer of the camera's size with the channels
//! `depth` (f32, metres along the optical axis, infinite for the sky), `instance` and `category` (u32,
//! 0 where there is no object); `aov/<episode>/objects.json` maps the numbers to objects and categories.

use std::io::Cursor;
use std::path::{Path, PathBuf};

use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, WritableImage,
};
use fs_err as fs;
use serde::Serialize;
use smallvec::smallvec;

use super::GenerateError;
use crate::files::{PARTIAL_SUFFIX, write_atomic};
use crate::scene::SceneObject;

/// The folder of all episodes' pictures.
const FOLDER: &str = "aov";

#[derive(Debug, Serialize)]
struct Entry<'a> {
    instance: u32,
    category_number: u32,
    id: &'a str,
    category: &'a str,
}

/// The pictures of one episode, in a partial folder until all are written.
#[derive(Debug)]
pub(super) struct AovWriter {
    partial: PathBuf,
    whole: PathBuf,
    size_px: (usize, usize),
    /// Category number of each object.
    categories: Vec<u32>,
}

impl AovWriter {
    /// Begins an episode's folder; deletes what an earlier run left of it.
    pub(super) fn create(
        data_set: &Path,
        episode: &str,
        size_px: (usize, usize),
        objects: &[SceneObject],
    ) -> Result<Self, GenerateError> {
        let folder = data_set.join(FOLDER);
        let whole = folder.join(episode);
        let partial = folder.join(format!("{episode}.{PARTIAL_SUFFIX}"));
        for old in [&whole, &partial] {
            if old.exists() {
                fs::remove_dir_all(old)?;
            }
        }
        fs::create_dir_all(&partial)?;
        let mut names: Vec<&str> = objects.iter().map(|object| object.category.as_str()).collect();
        names.sort_unstable();
        names.dedup();
        let number = |object: &SceneObject| {
            let place = names.iter().position(|name| *name == object.category);
            1 + place.expect("the list was made of these") as u32
        };
        let categories: Vec<u32> = objects.iter().map(number).collect();
        let entries: Vec<Entry<'_>> = (1..)
            .zip(objects.iter().zip(&categories))
            .map(|(instance, (object, &category_number))| Entry {
                instance,
                category_number,
                id: &object.id,
                category: &object.category,
            })
            .collect();
        let json = serde_json::to_string_pretty(&entries).expect("a list of entries has a JSON form");
        write_atomic(&partial.join("objects.json"), json.as_bytes())?;
        Ok(Self { partial, whole, size_px, categories })
    }

    /// Writes one sample; `objects` holds the object of each pixel.
    pub(super) fn write(
        &self,
        sample_idx: u64,
        depth_m: &[f32],
        objects: impl Iterator<Item = Option<usize>>,
    ) -> Result<(), GenerateError> {
        let objects: Vec<Option<usize>> = objects.collect();
        let instance = objects.iter().map(|object| object.map_or(0, |i| i as u32 + 1)).collect();
        let category = objects.iter().map(|object| object.map_or(0, |i| self.categories[i])).collect();
        let channels = AnyChannels::sort(smallvec![
            AnyChannel::new("depth", FlatSamples::F32(depth_m.to_vec())),
            AnyChannel::new("instance", FlatSamples::U32(instance)),
            AnyChannel::new("category", FlatSamples::U32(category)),
        ]);
        let layer =
            Layer::new(self.size_px, LayerAttributes::named("aov"), Encoding::SMALL_LOSSLESS, channels);
        let mut bytes = Cursor::new(Vec::new());
        Image::from_layer(layer)
            .write()
            .non_parallel()
            .to_buffered(&mut bytes)
            .map_err(|error| std::io::Error::other(format!("cannot pack an EXR picture: {error}")))?;
        write_atomic(&self.partial.join(format!("{sample_idx:06}.exr")), &bytes.into_inner())?;
        Ok(())
    }

    /// Gives the folder its name.
    pub(super) fn finish(self) -> Result<(), GenerateError> {
        Ok(fs::rename(&self.partial, &self.whole)?)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use exr::prelude::read_all_flat_layers_from_file;

    use super::*;
    use crate::object::{Distribution, Event, Kind};

    fn object(id: &str, category: &str) -> SceneObject {
        SceneObject {
            id: id.into(),
            category: category.into(),
            kind: Kind::Static,
            distribution: Distribution::Id,
            body_name: format!("obj:{id}"),
            bounds: [[0.0; 3].into(), [1.0; 3].into()],
            triangles: Arc::new(Vec::new()),
            reflectivity: 0.5,
            event: Event::None,
        }
    }

    #[test]
    fn an_exr_reads_back_as_it_was_written() {
        let folder = tempfile::tempdir().unwrap();
        let objects = [object("tree-0", "tree"), object("bin-1", "bin"), object("tree-2", "tree")];
        let writer = AovWriter::create(folder.path(), "e", (2, 2), &objects).unwrap();
        let depth_m = [1.5, f32::INFINITY, 0.25, 70.0];
        writer.write(3, &depth_m, [Some(0), None, Some(1), Some(2)].into_iter()).unwrap();
        assert!(!folder.path().join("aov/e").exists(), "not before it is whole");
        writer.finish().unwrap();
        let image = read_all_flat_layers_from_file(folder.path().join("aov/e/000003.exr")).unwrap();
        let channels = &image.layer_data[0].channel_data.list;
        let values = |name: &str| -> Vec<f32> {
            let channel = channels.iter().find(|channel| channel.name.eq(name)).unwrap();
            channel.sample_data.values_as_f32().collect()
        };
        assert_eq!(values("depth"), depth_m);
        assert_eq!(values("instance"), [1.0, 0.0, 2.0, 3.0]);
        assert_eq!(values("category"), [2.0, 0.0, 1.0, 2.0]);
        let json = fs::read_to_string(folder.path().join("aov/e/objects.json")).unwrap();
        assert!(json.contains("\"bin-1\"") && json.contains("\"category_number\": 2"), "{json}");
    }
}
