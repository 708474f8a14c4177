//! Meshes of users, with what lies beside them, and the model folders that are made of them.

use harmzone::scene::{bring_in, load_own_models};

use super::scratch;

/// The files that `mesh` takes, by the first byte.
pub const MESHES: [&str; 8] = [
    "mesh.obj",
    "mesh.stl",
    "mesh.glb",
    "mesh.mtl",
    "picture.png",
    "picture.jpg",
    "models.toml",
    "model.xml",
];

/// A wedge of 1 m with a texture.
pub const OBJ: &str = "mtllib mesh.mtl\nusemtl paint\nv 0 0 0\nv 1 0 0\nv 1 0 1\nv 0 0 1\nv 0 1 0\nv 1 1 0\nvt 0 0\nvt 1 0\n\
                       f 1/1 2/2 3/1 4/2\nf 1/1 5/1 6/1 2/1\nf 4/1 3/1 6/1 5/1\nf 1/1 4/1 5/1\nf 2/1 6/1 3/2\n";
pub const MTL: &str = "newmtl paint\nKd 0.2 0.3 0.8\nmap_Kd picture.png\n";
pub const TOML: &str = "[models.mesh]\nup = \"y\"\nunit = \"m\"\nmass_kg = 4\nmax_triangles = 60\n";

/// A mesh, or what is read with one; it is made into a model, which is loaded.
pub fn mesh(bytes: &[u8]) {
    let Some((kind, rest)) = scratch::split(bytes) else { return };
    let name = MESHES[kind % MESHES.len()];
    if name == "model.xml" {
        let path = scratch::write("mesh/own/own_mesh/model.xml", rest);
        scratch::write("mesh/own/own_mesh/part_0.obj", OBJ.as_bytes());
        if let Err(error) = load_own_models(path.ancestors().nth(2).expect("it lies in folders")) {
            scratch::tell(&error);
        }
        return;
    }
    let folder = scratch::empty_folder("mesh/in");
    if !name.starts_with("mesh.") || name == "mesh.mtl" {
        scratch::write("mesh/in/mesh.obj", OBJ.as_bytes());
        let mtl = if name == "picture.jpg" { MTL.replace("png", "jpg") } else { MTL.to_owned() };
        scratch::write("mesh/in/mesh.mtl", mtl.as_bytes());
    }
    if kind & 8 == 8 {
        scratch::write("mesh/in/models.toml", b"[defaults]\nlongest_m = 1.5\nmax_triangles = 50\n");
    }
    scratch::write(&format!("mesh/in/{name}"), rest);
    let models = match bring_in(&folder, false) {
        Ok(models) => models,
        Err(error) => return scratch::tell(&error),
    };
    let out = scratch::empty_folder("mesh/out");
    models.write(&out).expect("the scratch folder has room");
    load_own_models(&out).expect("what was made of a mesh can be loaded");
}
