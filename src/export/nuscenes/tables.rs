//! The tables of a version's folder as they are written: JSON lists, row by row.

use std::collections::BTreeMap;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use fs_err as fs;
use serde::Serialize;

use crate::nuscenes::{TABLES, TableRow};

/// All 13 tables of one version.
pub(super) struct Tables {
    files: BTreeMap<&'static str, TableFile>,
}

struct TableFile {
    file: BufWriter<fs::File>,
    is_empty: bool,
}

impl Tables {
    /// Starts the tables in a folder that exists.
    pub(super) fn create(folder: &Path) -> io::Result<Self> {
        let start = |table: &'static str| {
            let mut file = BufWriter::new(fs::File::create(folder.join(format!("{table}.json")))?);
            file.write_all(b"[")?;
            Ok((table, TableFile { file, is_empty: true }))
        };
        Ok(Self { files: TABLES.into_iter().map(start).collect::<io::Result<_>>()? })
    }

    pub(super) fn add<R: TableRow + Serialize>(&mut self, row: &R) -> io::Result<()> {
        let table = self.files.get_mut(R::TABLE).expect("`create` starts every table");
        table.file.write_all(if table.is_empty { b"\n" } else { b",\n" })?;
        table.is_empty = false;
        Ok(serde_json::to_writer(&mut table.file, row)?)
    }

    pub(super) fn add_all<'a, R: TableRow + Serialize + 'a>(
        &mut self,
        rows: impl IntoIterator<Item = &'a R>,
    ) -> io::Result<()> {
        rows.into_iter().try_for_each(|row| self.add(row))
    }

    pub(super) fn finish(self) -> io::Result<()> {
        for mut table in self.files.into_values() {
            table.file.write_all(b"\n]\n")?;
            table.file.into_inner().map_err(io::IntoInnerError::into_error)?.sync_all()?;
        }
        Ok(())
    }
}
