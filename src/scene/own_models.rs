//! Objects from anywhere: a user's folder of meshes, made into model folders as harmzone's own are.
//!
//! [`bring_in`] makes one folder a mesh, with a `model.xml`, and [`load`] reads them; so a data set holds the objects
//! that it shows, and its worker processes prepare nothing.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use fs_err as fs;
use serde::Serialize;
use thiserror::Error;

use super::error::SceneError;
use super::models::{self, MODEL_FILE, Model};
use crate::files::{inside, sha256_hex, write_atomic};
use crate::meshes::{EXTENSIONS, Prepared, SettingsError, SettingsFile, prepare, snake_case};

/// Names of these models begin so: none of harmzone's does.
const PREFIX: &str = "own_";

/// Most vertices of a hull: MuJoCo collides such hulls fast.
const MOST_HULL_VERTICES: u32 = 48;

/// Why a folder of meshes cannot be used.
#[derive(Debug, Error)]
pub enum OwnModelsError {
    #[error(transparent)]
    Io(#[from] std::io::Error),
    #[error(transparent)]
    Settings(#[from] SettingsError),
    #[error("there is no mesh in the folder; files that end in {EXTENSIONS:?} are read: {}", path.display())]
    Empty { path: PathBuf },
    #[error("models.toml speaks of `{name}`, and there is no such mesh; there are {found:?}: {}", path.display())]
    Unknown { name: String, found: Vec<String>, path: PathBuf },
    #[error("{} of {n} meshes cannot be used; --skip-bad goes on without them:\n{}", bad.len(), lines(bad))]
    Bad { bad: Vec<BadMesh>, n: usize },
}

/// A mesh that cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct BadMesh {
    pub path: PathBuf,
    pub reason: String,
}

fn lines(bad: &[BadMesh]) -> String {
    let line = |mesh: &BadMesh| format!("  {}: {}", mesh.path.display(), mesh.reason);
    bad.iter().map(line).collect::<Vec<_>>().join("\n")
}

/// What became of a mesh.
#[derive(Debug, Clone, Serialize)]
pub struct OwnModel {
    /// From the folder, without its end: `chairs/armchair`.
    pub name: String,
    pub category: String,
    /// Length, width, height.
    pub size_m: [f64; 3],
    pub mass_kg: f64,
    /// Before and after reduction.
    pub n_triangles: [usize; 2],
    pub n_hulls: usize,
    pub is_watertight: bool,
    pub notes: Vec<String>,
}

/// A folder of meshes, made into model folders.
#[derive(Debug, Clone)]
pub struct OwnModels {
    pub models: Vec<OwnModel>,
    /// Left out.
    pub bad: Vec<BadMesh>,
    /// By path from the folder of the models.
    files: BTreeMap<String, Vec<u8>>,
}

impl OwnModels {
    /// SHA-256 over the names and contents of the files.
    #[must_use]
    pub fn sha256(&self) -> String {
        let line = |(file, bytes): (&String, &Vec<u8>)| format!("{file} {}\n", sha256_hex(bytes));
        sha256_hex(self.files.iter().map(line).collect::<String>().as_bytes())
    }

    /// Writes the model folders into `out`.
    ///
    /// # Errors
    /// Any IO error.
    pub fn write(&self, out: &Path) -> std::io::Result<()> {
        for (file, bytes) in &self.files {
            let path = out.join(file);
            fs::create_dir_all(path.parent().expect("a file lies in its model's folder"))?;
            write_atomic(&path, bytes)?;
        }
        Ok(())
    }
}

/// Makes models of the meshes of `folder` and the folders in it.
///
/// # Errors
/// [`OwnModelsError`]; a bad mesh is one unless `skip_bad`, or no mesh is left.
pub fn bring_in(folder: &Path, skip_bad: bool) -> Result<OwnModels, OwnModelsError> {
    let settings = SettingsFile::read(folder)?;
    let mut paths = Vec::new();
    find(folder, &mut paths)?;
    let name_of = |path: &Path| {
        let inside = path.strip_prefix(folder).unwrap_or(path).with_extension("");
        inside.components().map(|part| part.as_os_str().to_string_lossy()).collect::<Vec<_>>().join("/")
    };
    let names: Vec<String> = paths.iter().map(|path| name_of(path)).collect();
    if let Some(name) = settings.names().find(|name| !names.iter().any(|found| found == name)) {
        return Err(OwnModelsError::Unknown { name: name.to_owned(), found: names, path: folder.to_owned() });
    }
    let (mut models, mut bad) = (Vec::new(), Vec::new());
    let mut files: BTreeMap<String, Vec<u8>> = BTreeMap::new();
    for (path, name) in paths.iter().zip(&names) {
        let own_name = format!("{PREFIX}{}", snake_case(name));
        let model_path = format!("{own_name}/{MODEL_FILE}");
        let made = if files.contains_key(&model_path) {
            Err(format!("another mesh is named `{name}`, or alike: only a to z and digits count"))
        } else {
            prepare(path, folder, settings.of(name)).and_then(|prepared| {
                let written = model_files(&own_name, &prepared)?;
                Ok((prepared, written))
            })
        };
        match made {
            Ok((prepared, written)) => {
                files.extend(written.into_iter().map(|(file, bytes)| (format!("{own_name}/{file}"), bytes)));
                models.push(OwnModel {
                    name: name.clone(),
                    category: prepared.category,
                    size_m: prepared.size_m,
                    mass_kg: prepared.mass_kg,
                    n_triangles: prepared.n_triangles,
                    n_hulls: prepared.hulls.len(),
                    is_watertight: prepared.is_watertight,
                    notes: prepared.notes,
                });
            }
            Err(reason) => bad.push(BadMesh { path: path.clone(), reason }),
        }
    }
    if paths.is_empty() {
        return Err(OwnModelsError::Empty { path: folder.to_owned() });
    }
    if models.is_empty() || !(bad.is_empty() || skip_bad) {
        return Err(OwnModelsError::Bad { bad, n: paths.len() });
    }
    Ok(OwnModels { models, bad, files })
}

/// Deletes the model folders that [`OwnModels::write`] left in `out`, and nothing else.
///
/// # Errors
/// Any IO error.
pub fn clear(out: &Path) -> std::io::Result<()> {
    if !out.is_dir() {
        return Ok(());
    }
    for entry in fs::read_dir(out)? {
        let path = entry?.path();
        let is_ours = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(PREFIX));
        if is_ours && path.join(MODEL_FILE).is_file() {
            fs::remove_dir_all(&path)?;
        }
    }
    Ok(())
}

/// Reads the model folders that [`bring_in`] made.
///
/// # Errors
/// [`SceneError::Model`] names the file and what is wrong in it; an unreadable folder is one, too.
pub fn load(out: &Path) -> Result<Vec<Model>, SceneError> {
    let fail = |message: String, path: &Path| SceneError::Model { message, path: path.to_owned() };
    let folder_error = |error: std::io::Error| fail(error.to_string(), out);
    let mut folders = Vec::new();
    for entry in fs::read_dir(out).map_err(folder_error)? {
        let path = entry.map_err(folder_error)?.path();
        if path.join(MODEL_FILE).is_file() {
            folders.push(path);
        }
    }
    folders.sort();
    let read = |folder: &PathBuf| {
        let path = folder.join(MODEL_FILE);
        let name = folder.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let bytes = |file: &str| fs::read(inside(folder, file).ok()?).ok().map(Into::into);
        let xml = fs::read_to_string(&path).map_err(|error| error.to_string());
        xml.and_then(|xml| models::read(&name, &xml, &bytes)).map_err(|message| fail(message, &path))
    };
    folders.iter().map(read).collect()
}

/// The meshes of a folder and of those in it, in the order of their names.
fn find(folder: &Path, paths: &mut Vec<PathBuf>) -> std::io::Result<()> {
    let mut entries: Vec<PathBuf> =
        fs::read_dir(folder)?.map(|entry| entry.map(|entry| entry.path())).collect::<Result<_, _>>()?;
    entries.sort();
    for path in entries {
        let end = path.extension().and_then(|end| end.to_str()).map(str::to_lowercase);
        if path.is_dir() && !path.is_symlink() {
            find(&path, paths)?;
        } else if end.is_some_and(|end| EXTENSIONS.contains(&end.as_str())) {
            paths.push(path);
        }
    }
    Ok(())
}

/// The files of a model's folder.
fn model_files(name: &str, prepared: &Prepared) -> Result<Vec<(String, Vec<u8>)>, String> {
    let mut files = Vec::new();
    let (mut assets, mut geoms) = (String::new(), String::new());
    for (i, part) in prepared.parts.iter().enumerate() {
        let key = format!("{name}/part_{i}");
        let look = if let Some(picture) = &part.texture {
            let mut png = Cursor::new(Vec::new());
            picture.write_to(&mut png, image::ImageFormat::Png).map_err(|error| error.to_string())?;
            files.push((format!("part_{i}.png"), png.into_inner()));
            let texture = format!("{name}/texture_{i}");
            let _ = writeln!(assets, "    <texture name=\"{texture}\" type=\"2d\" file=\"part_{i}.png\"/>");
            format!("texture=\"{texture}\"")
        } else {
            let [red, green, blue] = part.color;
            format!("rgba=\"{red:.3} {green:.3} {blue:.3} 1\"")
        };
        let _ = writeln!(assets, "    <material name=\"{key}\" {look} specular=\"0.2\" shininess=\"0.2\"/>");
        // As shells they may be flat; the hulls have the mass.
        let _ = writeln!(assets, "    <mesh name=\"{key}\" file=\"part_{i}.obj\" inertia=\"shell\"/>");
        let _ = writeln!(
            geoms,
            "      <geom type=\"mesh\" mesh=\"{key}\" material=\"{key}\" group=\"2\" contype=\"0\" conaffinity=\"0\" mass=\"0\"/>"
        );
        files.push((format!("part_{i}.obj"), obj(&part.positions, &part.texture_places, &part.triangles)));
    }
    let volume_m3: f64 = prepared.hulls.iter().map(|hull| hull.volume_m3).sum();
    for (i, hull) in prepared.hulls.iter().enumerate() {
        let key = format!("{name}/hull_{i}");
        let mass_kg = prepared.mass_kg * hull.volume_m3 / volume_m3;
        let _ = writeln!(
            assets,
            "    <mesh name=\"{key}\" file=\"hull_{i}.obj\" inertia=\"convex\" maxhullvert=\"{MOST_HULL_VERTICES}\"/>"
        );
        let _ = writeln!(
            geoms,
            "      <geom type=\"mesh\" mesh=\"{key}\" group=\"3\" mass=\"{mass_kg:.4}\" condim=\"6\" priority=\"1\" friction=\"0.7 0.01 0.01\" solref=\"0.02 0.8\"/>"
        );
        files.push((format!("hull_{i}.obj"), obj(&hull.points, &[], &hull.triangles)));
    }
    let Prepared { category, reflectivity, .. } = prepared;
    let xml = format!(
        "<mujoco model=\"{name}\">\n  <custom>\n    <text name=\"category\" data=\"{category}\"/>\n    \
         <text name=\"kind\" data=\"static\"/>\n    <text name=\"distribution\" data=\"ood\"/>\n    \
         <numeric name=\"reflectivity\" data=\"{reflectivity}\"/>\n  </custom>\n  <asset>\n{assets}  </asset>\n  \
         <worldbody>\n    <body name=\"{name}\">\n{geoms}    </body>\n  </worldbody>\n</mujoco>\n"
    );
    files.push((MODEL_FILE.to_owned(), xml.into_bytes()));
    Ok(files)
}

fn obj(positions: &[[f32; 3]], places: &[[f32; 2]], triangles: &[[u32; 3]]) -> Vec<u8> {
    let mut text = String::new();
    for [x, y, z] in positions {
        let _ = writeln!(text, "v {x:.6} {y:.6} {z:.6}");
    }
    for [u, v] in places {
        let _ = writeln!(text, "vt {u:.6} {v:.6}");
    }
    for corners in triangles {
        let [a, b, c] = corners.map(|corner| corner + 1);
        let _ = match places {
            [] => writeln!(text, "f {a} {b} {c}"),
            _ => writeln!(text, "f {a}/{a} {b}/{b} {c}/{c}"),
        };
    }
    text.into_bytes()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::object::Distribution;
    use crate::scene::{PopulateConfig, Town, populate_in};

    /// A wedge of 1 m, named so that its model is `own_<name>`.
    fn wedge(folder: &Path, name: &str) {
        let corners = "v 0 0 0\nv 1 0 0\nv 1 0 1\nv 0 0 1\nv 0 1 0\nv 1 1 0\n";
        let faces = "f 1 2 3 4\nf 1 5 6 2\nf 4 3 6 5\nf 1 4 5\nf 2 6 3\n";
        let path = folder.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, format!("{corners}{faces}")).unwrap();
    }

    #[test]
    fn meshes_become_models_that_stand_in_the_street() {
        let (folder, out) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        wedge(folder.path(), "Ramp.obj");
        wedge(folder.path(), "more/block.obj");
        fs::write(folder.path().join("models.toml"), "[models.\"more/block\"]\nmass_kg = 30\n").unwrap();
        let brought = bring_in(folder.path(), false).unwrap();
        assert_eq!(brought.sha256(), bring_in(folder.path(), false).unwrap().sha256());
        brought.write(out.path()).unwrap();
        let models = load(out.path()).unwrap();
        let names: Vec<&str> = models.iter().map(|model| model.name.as_str()).collect();
        assert_eq!(names, ["own_more_block", "own_ramp"]);
        assert!((models[0].mass_kg - 30.0).abs() < 0.01 && models[0].triangles.len() == 8);
        assert!((models[1].height_m() - 1.0).abs() < 1e-5 && models[1].facts.category == "ramp");

        let town = Arc::new(Town::load("downtown").unwrap());
        let config = PopulateConfig { ood: true, shipped_kinds: false, ..PopulateConfig::default() };
        let world = populate_in(&town, models, &config, false, 3).unwrap();
        let is_ood = |object: &&crate::scene::SceneObject| object.distribution == Distribution::Ood;
        let found: Vec<&str> =
            world.objects.iter().filter(is_ood).map(|object| object.category.as_str()).collect();
        assert!(found.len() > 10 && found.contains(&"ramp") && found.contains(&"block"), "{found:?}");
        assert!(found.iter().all(|category| ["ramp", "block"].contains(category)), "{found:?}");
    }

    #[test]
    fn a_bad_mesh_is_named_and_left_out_only_if_wanted() {
        let folder = tempfile::tempdir().unwrap();
        let told = |skip_bad| bring_in(folder.path(), skip_bad).map_err(|error| error.to_string());
        assert!(told(true).unwrap_err().contains("there is no mesh in the folder"));
        fs::write(folder.path().join("bad.obj"), "v 0 0 0\nf 1 2 3\n").unwrap();
        assert!(told(true).unwrap_err().contains("1 of 1 meshes cannot be used"), "none is left");
        wedge(folder.path(), "good.obj");
        let error = told(false).unwrap_err();
        assert!(
            error.contains("bad.obj: it is not a whole OBJ file") && error.contains("--skip-bad"),
            "{error}"
        );
        let brought = told(true).unwrap();
        assert_eq!((brought.models.len(), brought.bad.len()), (1, 1));
        fs::copy(folder.path().join("good.obj"), folder.path().join("GOOD.obj")).unwrap();
        assert!(told(false).unwrap_err().contains("another mesh is named `good`"));
        fs::write(folder.path().join("models.toml"), "[models.god]\n").unwrap();
        let error = told(true).unwrap_err();
        assert!(error.contains("models.toml speaks of `god`") && error.contains("\"good\""), "{error}");
    }

    #[test]
    fn a_model_names_files_in_its_own_folder_alone() {
        let (folder, out) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        wedge(folder.path(), "ramp.obj");
        bring_in(folder.path(), false).unwrap().write(out.path()).unwrap();
        let path = out.path().join("own_ramp").join(MODEL_FILE);
        let xml = fs::read_to_string(&path).unwrap();
        let part = "file=\"part_0.obj\"";
        assert!(xml.contains(part), "{xml}");
        fs::copy(out.path().join("own_ramp/part_0.obj"), out.path().join("part_0.obj")).unwrap();
        let absolute = out.path().join("part_0.obj").display().to_string();
        for name in ["../part_0.obj", &absolute] {
            fs::write(&path, xml.replace(part, &format!("file=\"{name}\""))).unwrap();
            let told = load(out.path()).unwrap_err().to_string();
            assert!(
                told.contains(name) && told.contains("in the folder") && told.contains(MODEL_FILE),
                "{told}"
            );
        }
        fs::write(&path, xml.replace(part, &format!("{part} fileup=\"/etc/passwd\""))).unwrap();
        assert!(load(out.path()).unwrap_err().to_string().contains("`fileup`"));
    }
}
