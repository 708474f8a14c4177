//! The tables of a version's folder as they are written: JSON lists, row by row.

use std::collections::BTreeMap;
use std::io::{self, BufWriter, Write};
use std::path::PathBuf;

use fs_err as fs;
use serde::Serialize;

use crate::files::{NewFolder, told_with_room};
use crate::nuscenes::{TABLES, TableRow};

/// All 13 tables of one version.
pub(super) struct Tables {
    files: BTreeMap<&'static str, TableFile>,
}

struct TableFile {
    file: BufWriter<fs::File>,
    /// Where it will lie.
    path: PathBuf,
    n_bytes: u64,
    is_empty: bool,
}

impl Tables {
    /// Starts the tables in a folder of this name inside an export's.
    pub(super) fn create(folder: &NewFolder, version: &str) -> io::Result<Self> {
        let home = folder.make(version)?;
        let start = |table: &'static str| {
            let path = folder.final_path(&format!("{version}/{table}.json"));
            let file = fs::File::create(home.join(format!("{table}.json")));
            let file = BufWriter::new(file.map_err(|error| told_with_room(error, &path, 1))?);
            let mut file = TableFile { file, path, n_bytes: 0, is_empty: true };
            file.write(b"[")?;
            Ok((table, file))
        };
        Ok(Self { files: TABLES.into_iter().map(start).collect::<io::Result<_>>()? })
    }

    pub(super) fn add<R: TableRow + Serialize>(&mut self, row: &R) -> io::Result<()> {
        let table = self.files.get_mut(R::TABLE).expect("`create` starts every table");
        let separator: &[u8] = if table.is_empty { b"\n" } else { b",\n" };
        table.write(separator)?;
        table.is_empty = false;
        table.write(&serde_json::to_vec(row)?)
    }

    pub(super) fn add_all<'a, R: TableRow + Serialize + 'a>(
        &mut self,
        rows: impl IntoIterator<Item = &'a R>,
    ) -> io::Result<()> {
        rows.into_iter().try_for_each(|row| self.add(row))
    }

    pub(super) fn finish(self) -> io::Result<()> {
        for mut table in self.files.into_values() {
            table.write(b"\n]\n")?;
            let TableFile { file, path, n_bytes, .. } = table;
            let written = file.into_inner().map_err(io::IntoInnerError::into_error);
            let synced = written.and_then(|file| file.sync_all());
            synced.map_err(|error| told_with_room(error, &path, n_bytes))?;
        }
        Ok(())
    }
}

impl TableFile {
    /// Writes some bytes; of a full disk it tells what the table wants up to here.
    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.n_bytes += bytes.len() as u64;
        self.file.write_all(bytes).map_err(|error| told_with_room(error, &self.path, self.n_bytes))
    }
}
