//! Reads the tables of a version's folder, row by row, and keeps what imports need of them.
//!
//! Of a whole nuScenes (2.6 million files) only key frames of the wanted channels stay in memory, and the poses of the LiDAR.

use std::collections::{HashMap, HashSet};
use std::io::BufReader;
use std::path::{Path, PathBuf};

use fs_err as fs;
use serde::Deserializer;
use serde::de::{DeserializeOwned, DeserializeSeed, Error as _, SeqAccess, Visitor};

use crate::files;
use crate::import::ImportError;
use crate::import::error::told;
use crate::nuscenes::{
    CalibratedSensorRow, CategoryRow, EgoPoseRow, InstanceRow, LogRow, SampleAnnotationRow, SampleDataRow,
    SampleRow, SceneRow, SensorRow, TABLES, TableRow, Token, VisibilityRow,
};

/// The LiDAR's channel.
pub(super) const LIDAR: &str = "LIDAR_TOP";

/// A table by token.
#[derive(Debug)]
pub(super) struct Table<R> {
    rows: HashMap<Token, R>,
    pub(super) path: PathBuf,
}

/// The tables of a version.
#[derive(Debug)]
pub(super) struct Tables {
    /// The folder that file names start from.
    pub(super) root: PathBuf,
    pub(super) category: Table<CategoryRow>,
    pub(super) instance: Table<InstanceRow>,
    pub(super) visibility: Table<VisibilityRow>,
    pub(super) sensor: Table<SensorRow>,
    pub(super) calibrated_sensor: Table<CalibratedSensorRow>,
    pub(super) log: Table<LogRow>,
    /// In the file's order.
    pub(super) scenes: Vec<SceneRow>,
    pub(super) sample: Table<SampleRow>,
    pub(super) ego_pose: Table<EgoPoseRow>,
    pub(super) sample_data_path: PathBuf,
    /// Key frames of the wanted channels by sample.
    pub(super) key_frames: HashMap<Token, Vec<SampleDataRow>>,
    /// Times and poses of the LiDAR's files by scene.
    pub(super) lidar_poses: HashMap<Token, Vec<(u64, Token)>>,
    pub(super) annotation: Table<SampleAnnotationRow>,
    /// Annotations by sample, in the file's order.
    pub(super) annotations_of: HashMap<Token, Vec<Token>>,
}

impl<R: TableRow> Table<R> {
    fn rows(&self) -> impl Iterator<Item = &R> {
        self.rows.values()
    }

    /// The row that another one names.
    ///
    /// # Errors
    /// There is no such row; the error names both tables and the token.
    pub(super) fn get(&self, token: &Token, named_by: &str) -> Result<&R, ImportError> {
        self.rows.get(token).ok_or_else(|| {
            let message = format!("no row `{token}` in the table `{}`, which {named_by} names", R::TABLE);
            ImportError::at(&self.path, message)
        })
    }

    pub(super) fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }
}

impl Tables {
    /// Reads the tables of a folder such as `v1.0-mini`; `channels` are those whose files are wanted.
    ///
    /// # Errors
    /// A table is missing or not valid, a token is there twice, or one that is needed to sort the rows is missing.
    pub(super) fn read(version: &Path, channels: &[&str]) -> Result<Self, ImportError> {
        for table in TABLES {
            if !files::is_file(&path_of(version, table))? {
                let message = format!(
                    "no table `{table}.json` here; a version's folder of nuScenes holds {}",
                    TABLES.join(", ")
                );
                return Err(ImportError::at(version, message));
            }
        }
        let sensor: Table<SensorRow> = read_table(version, |_| true)?;
        let calibrated_sensor: Table<CalibratedSensorRow> = read_table(version, |_| true)?;
        let sample: Table<SampleRow> = read_table(version, |_| true)?;
        let sample_data_path = path_of(version, SampleDataRow::TABLE);
        let mut key_frames: HashMap<Token, Vec<SampleDataRow>> = HashMap::new();
        let mut lidar_poses: HashMap<Token, Vec<(u64, Token)>> = HashMap::new();
        let mut wanted_poses = HashSet::new();
        let mut fault = None;
        let mut sort_out = |row: SampleDataRow| -> Result<(), ImportError> {
            let named_by = format!("sample_data `{}`", row.token);
            let channel = &sensor
                .get(
                    &calibrated_sensor.get(&row.calibrated_sensor_token, &named_by)?.sensor_token,
                    &named_by,
                )?
                .channel;
            if channel == LIDAR {
                let scene = &sample.get(&row.sample_token, &named_by)?.scene_token;
                wanted_poses.insert(row.ego_pose_token.clone());
                let of_scene = lidar_poses.entry(scene.clone()).or_default();
                of_scene.push((row.timestamp, row.ego_pose_token.clone()));
            }
            if row.is_key_frame && channels.contains(&channel.as_str()) {
                wanted_poses.insert(row.ego_pose_token.clone());
                key_frames.entry(row.sample_token.clone()).or_default().push(row);
            }
            Ok(())
        };
        read_rows(version, |row| {
            if fault.is_none() {
                fault = sort_out(row).err();
            }
        })?;
        if let Some(fault) = fault {
            return Err(fault);
        }
        let mut scenes = Vec::new();
        read_rows(version, |row| scenes.push(row))?;
        let (mut annotations, mut annotations_of) = (Vec::new(), HashMap::<Token, Vec<Token>>::new());
        read_rows(version, |row: SampleAnnotationRow| {
            annotations_of.entry(row.sample_token.clone()).or_default().push(row.token.clone());
            annotations.push(row);
        })?;
        Ok(Self {
            root: version.parent().map_or_else(PathBuf::new, Path::to_owned),
            category: read_table(version, |_| true)?,
            instance: read_table(version, |_| true)?,
            visibility: read_table(version, |_| true)?,
            log: read_table(version, |_| true)?,
            ego_pose: read_table(version, |row: &EgoPoseRow| wanted_poses.contains(&row.token))?,
            annotation: table_of(version, annotations)?,
            sensor,
            calibrated_sensor,
            scenes,
            sample,
            sample_data_path,
            key_frames,
            lidar_poses,
            annotations_of,
        })
    }

    /// The channels of all sensors.
    pub(super) fn channels(&self) -> impl Iterator<Item = &str> {
        self.sensor.rows().map(|sensor| sensor.channel.as_str())
    }
}

fn path_of(version: &Path, table: &str) -> PathBuf {
    version.join(format!("{table}.json"))
}

fn read_table<R: TableRow + DeserializeOwned>(
    version: &Path,
    is_wanted: impl Fn(&R) -> bool,
) -> Result<Table<R>, ImportError> {
    let mut rows = Vec::new();
    read_rows(version, |row| {
        if is_wanted(&row) {
            rows.push(row);
        }
    })?;
    table_of(version, rows)
}

fn table_of<R: TableRow>(version: &Path, rows: Vec<R>) -> Result<Table<R>, ImportError> {
    let path = path_of(version, R::TABLE);
    let mut by_token = HashMap::with_capacity(rows.len());
    for row in rows {
        if let Some(twice) = by_token.insert(row.token().clone(), row) {
            let message = format!("the row `{}` is there twice; tokens are unique in a table", twice.token());
            return Err(ImportError::at(&path, message));
        }
    }
    Ok(Table { rows: by_token, path })
}

/// Hands over each row of a table; the file may be larger than the memory.
fn read_rows<R: TableRow + DeserializeOwned>(version: &Path, take: impl FnMut(R)) -> Result<(), ImportError> {
    let path = path_of(version, R::TABLE);
    let file = fs::File::open(&path).map_err(|error| told(&path, error))?;
    let mut json = serde_json::Deserializer::from_reader(BufReader::with_capacity(1 << 20, file));
    let read = Rows { take, row: std::marker::PhantomData }.deserialize(&mut json).and_then(|()| json.end());
    read.map_err(|error| match error.io_error_kind() {
        // A disk that fails is no fault of the log.
        Some(_) => {
            ImportError::Io(std::io::Error::other(format!("cannot read: {error}: {}", path.display())))
        }
        None => ImportError::at(&path, format!("the table `{}` is not valid: {error}", R::TABLE)),
    })
}

struct Rows<R, F> {
    take: F,
    row: std::marker::PhantomData<R>,
}

impl<'de, R: TableRow + DeserializeOwned, F: FnMut(R)> DeserializeSeed<'de> for Rows<R, F> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_seq(self)
    }
}

impl<'de, R: TableRow + DeserializeOwned, F: FnMut(R)> Visitor<'de> for Rows<R, F> {
    type Value = ();

    fn expecting(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str("a list of rows")
    }

    fn visit_seq<A: SeqAccess<'de>>(mut self, mut rows: A) -> Result<(), A::Error> {
        let mut n_rows = 0_usize;
        while let Some(row) =
            rows.next_element().map_err(|error| A::Error::custom(format!("row {n_rows}: {error}")))?
        {
            (self.take)(row);
            n_rows += 1;
        }
        Ok(())
    }
}
