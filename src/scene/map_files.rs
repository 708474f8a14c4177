//! Maps that a user gives by path.

use std::collections::BTreeSet;
use std::path::Path;

use super::error::SceneError;
use super::town::is_map_file;
use crate::files::sha256_of;

/// Comments for a config's text: the SHA-256 of each map that is given by path, and of the `town.toml` beside it. By them a
/// run knows that the maps of an earlier one were others; shipped towns need none.
///
/// # Errors
/// A file cannot be read.
pub fn map_hashes<'a>(towns: impl Iterator<Item = &'a String>) -> Result<String, SceneError> {
    let maps: BTreeSet<&Path> =
        towns.map(|town| Path::new(town.as_str())).filter(|path| is_map_file(path)).collect();
    let mut text = String::new();
    for map in maps {
        for file in [map.to_owned(), map.with_file_name("town.toml")] {
            if file.is_file() {
                text += &format!(
                    "# {}: SHA-256 {}\n",
                    file.display().to_string().escape_debug(),
                    sha256_of(&file)?
                );
            }
        }
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use fs_err as fs;

    use super::*;

    #[test]
    fn a_map_by_path_is_known_by_its_bytes_and_those_of_its_town_toml() {
        let folder = tempfile::tempdir().unwrap();
        let map = folder.path().join("road.xodr");
        fs::write(&map, "a").unwrap();
        let towns = ["downtown".to_owned(), map.display().to_string()];
        let hashes = || map_hashes(towns.iter().chain(&towns)).unwrap();
        let of_map = hashes();
        assert!(
            of_map.lines().count() == 1 && of_map.starts_with("# ") && of_map.contains("road.xodr"),
            "{of_map}"
        );
        fs::write(map.with_file_name("town.toml"), "verge_m = 3.0").unwrap();
        let with_town = hashes();
        assert!(with_town.lines().count() == 2 && with_town.starts_with(&of_map), "{with_town}");
        fs::write(&map, "b").unwrap();
        assert_ne!(hashes().lines().next(), with_town.lines().next());
        assert_eq!(map_hashes([towns[0].clone()].iter()).unwrap(), "");
    }
}
