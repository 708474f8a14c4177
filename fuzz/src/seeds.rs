//! Inputs to begin with, made in code: the fuzzers change them until something new happens.

use std::path::Path;

use fs_err as fs;
use harmzone::meshes::{MeshPart, to_glb};

use super::{archives, data_sets, imports, mesh_files, networks, results, roads};

/// Writes the made inputs of a target into a folder; `make_corpus.sh` adds those that lie in files.
///
/// # Errors
/// The folder cannot be written.
pub fn write_seeds(target: &str, folder: &Path) -> std::io::Result<()> {
    fs::create_dir_all(folder)?;
    for (i, seed) in seeds(target).into_iter().enumerate() {
        fs::write(folder.join(format!("made_{i:03}")), seed)?;
    }
    Ok(())
}

const STL_TEXT: &str = "solid wedge\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n\
                        facet normal 0 1 0\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 0 1\nendloop\nendfacet\nendsolid wedge\n";

/// Corners of a tetrahedron, and its faces.
const CORNERS: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
const FACES: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]];

/// A binary STL file.
fn stl() -> Vec<u8> {
    let mut file = vec![0; 80];
    file.extend((FACES.len() as u32).to_le_bytes());
    for face in FACES {
        file.extend([0.0_f32, 0.0, 1.0].iter().flat_map(|part| part.to_le_bytes()));
        let corners = face.map(|corner| CORNERS[corner as usize]);
        file.extend(corners.as_flattened().iter().flat_map(|part| part.to_le_bytes()));
        file.extend([0, 0]);
    }
    file
}

/// A GLB file of two parts.
fn glb() -> Vec<u8> {
    let part = MeshPart { positions: CORNERS.to_vec(), triangles: FACES.to_vec(), ..MeshPart::default() };
    to_glb(&[part.clone(), MeshPart { color: [1.0, 0.5, 0.0], ..part }])
}

fn with_kind(kind: usize, bytes: &[u8]) -> Vec<u8> {
    [&[kind as u8], bytes].concat()
}

fn seeds(target: &str) -> Vec<Vec<u8>> {
    match target {
        "episode" => archives::episode_seeds(),
        "sidecar" => archives::sidecar_seeds(),
        "manifest" => {
            let made = super::made_episode::dataset("seeds");
            let files = ["dataset.json", "labels/harm/labels.json"];
            let read = |file: &str| fs::read(made.dataset.join(file)).expect("it was just written");
            files.iter().enumerate().map(|(kind, file)| with_kind(kind, &read(file))).collect()
        }
        "data_set" => data_sets::seeds(),
        "results" => results::seeds(),
        "road" => vec![
            with_kind(0, roads::STREET.as_bytes()),
            with_kind(2, roads::STREET.as_bytes()),
            with_kind(0, roads::CROSSROADS.as_bytes()),
            with_kind(1, b"split = \"dev\"\n"),
        ],
        "mesh" => [mesh_files::OBJ, "", "", mesh_files::MTL, "", "", mesh_files::TOML]
            .iter()
            .enumerate()
            .flat_map(|(kind, text)| [kind, kind + 8].map(|kind| with_kind(kind, text.as_bytes())))
            .filter(|seed| seed.len() > 1)
            .chain([with_kind(1, STL_TEXT.as_bytes()), with_kind(1, &stl()), with_kind(2, &glb())])
            .collect(),
        "import_nuscenes" => imports::nuscenes_seeds(),
        "import_kitti" => imports::kitti_seeds(),
        "import_av2" => imports::av2_seeds(),
        "import_ros2" => imports::ros2_seeds(),
        "checkpoint" => networks::checkpoint_seeds(),
        _ => Vec::new(),
    }
}
