//! Files as other programs write them, and broken ones.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use fs_err as fs;
use tempfile::TempDir;

use super::*;
use crate::meshes::settings::LengthUnit;

/// The corners of a box from the origin, and its sides as triangles that face outwards.
fn cuboid([x, y, z]: [f32; 3]) -> MeshPart {
    let corner = |i: u32| {
        [if i & 1 > 0 { x } else { 0.0 }, if i & 2 > 0 { y } else { 0.0 }, if i & 4 > 0 { z } else { 0.0 }]
    };
    let sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    MeshPart {
        positions: (0..8).map(corner).collect(),
        triangles: sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect(),
        ..MeshPart::default()
    }
}

fn obj_of(part: &MeshPart, head: &str) -> String {
    let mut text = head.to_owned();
    for [x, y, z] in &part.positions {
        let _ = writeln!(text, "v {x} {y} {z}");
    }
    for corners in &part.triangles {
        let [a, b, c] = corners.map(|corner| corner + 1);
        let _ = writeln!(text, "f {a} {b} {c}");
    }
    text
}

fn stl_of(part: &MeshPart) -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend((part.triangles.len() as u32).to_le_bytes());
    for triangle in &part.triangles {
        bytes.extend([0_u8; 12]);
        for corner in triangle {
            bytes.extend(part.positions[*corner as usize].iter().flat_map(|value| value.to_le_bytes()));
        }
        bytes.extend([0_u8; 2]);
    }
    bytes
}

/// A GLB of one mesh, red, in a node that is twice as large.
fn glb_of(part: &MeshPart) -> Vec<u8> {
    glb_with(part, |_| ())
}

/// The same with a changed description.
fn glb_with(part: &MeshPart, change: impl FnOnce(&mut serde_json::Value)) -> Vec<u8> {
    let mut blob: Vec<u8> =
        part.positions.as_flattened().iter().flat_map(|value| value.to_le_bytes()).collect();
    let n_position_bytes = blob.len();
    blob.extend(part.triangles.as_flattened().iter().flat_map(|corner| corner.to_le_bytes()));
    let high = part.positions.iter().fold([0.0_f32; 3], |high, p| [0, 1, 2].map(|i| high[i].max(p[i])));
    let mut json = serde_json::json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "scale": [2.0, 2.0, 2.0] }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1, "material": 0 }] }],
        "materials": [{ "pbrMetallicRoughness": { "baseColorFactor": [1.0, 0.0, 0.0, 1.0] } }],
        "buffers": [{ "byteLength": blob.len() }],
        "bufferViews": [
            { "buffer": 0, "byteLength": n_position_bytes },
            { "buffer": 0, "byteOffset": n_position_bytes, "byteLength": blob.len() - n_position_bytes },
        ],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": part.positions.len(), "type": "VEC3",
              "min": [0.0, 0.0, 0.0], "max": high },
            { "bufferView": 1, "componentType": 5125, "count": part.triangles.len() * 3, "type": "SCALAR" },
        ],
    });
    change(&mut json);
    let mut json = json.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut bytes = b"glTF".to_vec();
    for number in [2, (12 + 8 + json.len() + 8 + blob.len()) as u32, json.len() as u32] {
        bytes.extend(number.to_le_bytes());
    }
    bytes.extend(b"JSON");
    bytes.extend(json);
    bytes.extend((blob.len() as u32).to_le_bytes());
    bytes.extend(b"BIN\0");
    bytes.extend(blob);
    bytes
}

fn put(folder: &TempDir, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
    let path = folder.path().join(name);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(&path, bytes).unwrap();
    path
}

fn made(path: &Path, folder: &TempDir, settings: &Settings) -> Prepared {
    prepare(path, folder.path(), settings).unwrap()
}

fn assert_size(prepared: &Prepared, wanted: [f64; 3]) {
    let differ = prepared.size_m.iter().zip(wanted).any(|(found, wanted)| (found - wanted).abs() > 1e-4);
    assert!(!differ, "{:?}, wanted {wanted:?}", prepared.size_m);
    let corners = prepared.parts.iter().flat_map(|part| &part.positions);
    let low = corners.fold([f32::MAX; 3], |low, p| [0, 1, 2].map(|i| low[i].min(p[i])));
    assert!((f64::from(low[0]) + wanted[0] / 2.0).abs() < 1e-4 && low[2].abs() < 1e-4, "stands at {low:?}");
}

#[test]
fn an_obj_in_centimetres_with_y_up_stands_upright_in_metres() {
    let folder = tempfile::tempdir().unwrap();
    let path = put(&folder, "Arm-Chair.obj", obj_of(&cuboid([60.0, 90.0, 70.0]), ""));
    let chair = made(&path, &folder, &Settings::default());
    assert_size(&chair, [0.6, 0.7, 0.9]);
    assert_eq!((chair.category.as_str(), chair.is_watertight, chair.hulls.len()), ("arm_chair", true, 1));
    assert_eq!(chair.notes, ["up guessed: y", "unit guessed: cm", "mass guessed: 56.7 kg"]);
    let settings = Settings {
        category: Some("chair".into()),
        unit: Some(LengthUnit::Centimetre),
        up: Some(UpAxis::Z),
        yaw_deg: 90.0,
        mass_kg: Some(9.0),
        ..Settings::default()
    };
    let chair = made(&path, &folder, &settings);
    assert_size(&chair, [0.9, 0.6, 0.7]);
    assert_eq!((chair.category.as_str(), chair.mass_kg, chair.notes.len()), ("chair", 9.0, 0));
}

#[test]
fn a_sheet_has_a_hull_with_a_volume_and_a_line_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let sheet = |name: &str, thickness_m: f64| {
        let corners = format!("v 0 0 0\nv 1 0 0\nv 0 1 {thickness_m}\nv 1 1 {thickness_m}\n");
        let path = put(&folder, name, corners + "f 1 2 4 3\n");
        prepare(&path, folder.path(), &Settings::default())
    };
    let hulls = sheet("sheet.obj", 0.008).unwrap().hulls;
    assert!(hulls.iter().all(|hull| hull.volume_m3 > 1e-3), "{hulls:?}");
    for thickness_m in [0.0, 0.004] {
        let told = sheet("paper.obj", thickness_m).unwrap_err();
        assert!(told.contains("its shortest side is 0.00") && told.contains("more than 0.005 m"), "{told}");
    }
    let line = put(&folder, "line.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n");
    let told = prepare(&line, folder.path(), &Settings::default()).unwrap_err();
    assert!(told.contains("no area"), "{told}");
}

#[test]
fn an_stl_of_cad_is_in_millimetres_and_open_without_a_side() {
    let folder = tempfile::tempdir().unwrap();
    let mut tray = cuboid([500.0, 400.0, 100.0]);
    let path = put(&folder, "tray.stl", stl_of(&tray));
    let closed = made(&path, &folder, &Settings::default());
    assert_size(&closed, [0.5, 0.4, 0.1]);
    assert!(closed.is_watertight && closed.notes.contains(&"unit guessed: mm".to_owned()));
    tray.triangles.truncate(10);
    let open = made(&put(&folder, "open.stl", stl_of(&tray)), &folder, &Settings::default());
    assert!(
        !open.is_watertight && open.notes.iter().any(|note| note.contains("4 of 17 edges are open")),
        "{:?}",
        open.notes
    );
}

#[test]
fn a_glb_has_metres_its_nodes_scale_and_a_colour() {
    let folder = tempfile::tempdir().unwrap();
    let path = put(&folder, "box.glb", glb_of(&cuboid([0.3, 0.5, 0.2])));
    let cube = made(&path, &folder, &Settings::default());
    assert_size(&cube, [0.6, 0.4, 1.0]);
    assert_eq!(cube.parts[0].color, [1.0, 0.0, 0.0]);
    assert_eq!(cube.notes, ["mass guessed: 36.0 kg"]);
    let longest = Settings { longest_m: Some(2.0), ..Settings::default() };
    assert_size(&made(&path, &folder, &longest), [1.2, 0.8, 2.0]);
}

#[test]
fn textures_come_along_from_the_folder_and_from_nowhere_else() {
    let folder = tempfile::tempdir().unwrap();
    let mut png = std::io::Cursor::new(Vec::new());
    RgbImage::from_pixel(1024, 8, image::Rgb([9, 8, 7])).write_to(&mut png, image::ImageFormat::Png).unwrap();
    let png = png.into_inner();
    put(&folder, "skins/wood.png", &png);
    put(&folder, "my wood.png", &png);
    let corners = "vt 0 0\nvt 1 0\nvt 1 1\n";
    let face = "v 0 0 0\nv 1 0.008 0\nv 1 0 1\nusemtl wood\nf 1/1 2/2 3/3\n";
    let path = put(&folder, "board.obj", format!("mtllib board.mtl\n{corners}{face}"));
    let mtl = |texture: &str| put(&folder, "board.mtl", format!("newmtl wood\nKd 1 0 0\nmap_Kd {texture}\n"));

    mtl("skins/wood.png");
    let board = made(&path, &folder, &Settings::default());
    let texture = board.parts[0].texture.as_ref().unwrap();
    assert_eq!(
        (texture.width(), texture.height(), texture.get_pixel(3, 1).0),
        (TEXTURE_SIDE_PX, 2, [9, 8, 7])
    );
    assert_eq!(board.parts[0].texture_places.len(), 3);

    for words in ["my wood.png", "-s 1 1 1 skins/wood.png"] {
        mtl(words);
        assert!(made(&path, &folder, &Settings::default()).parts[0].texture.is_some(), "{words}");
    }

    mtl("skins/oak.png");
    let board = made(&path, &folder, &Settings::default());
    assert!(board.parts[0].texture.is_none() && board.parts[0].color == [1.0, 0.0, 0.0]);
    assert!(board.notes[0].contains("`skins/oak.png`, which is not there"), "{:?}", board.notes);

    for outside in ["../wood.png", "skins/../../wood.png", "/etc/hostname"] {
        mtl(outside);
        let told = prepare(&path, folder.path(), &Settings::default()).unwrap_err();
        assert!(told.contains(outside) && told.contains("outside of the folder"), "{told}");
    }
}

#[test]
fn a_glb_names_its_texture_from_its_own_folder() {
    let folder = tempfile::tempdir().unwrap();
    let mut png = std::io::Cursor::new(Vec::new());
    RgbImage::from_pixel(4, 4, image::Rgb([9, 8, 7])).write_to(&mut png, image::ImageFormat::Png).unwrap();
    put(&folder, "skins/wood.png", png.into_inner());
    let cube = cuboid([0.3, 0.5, 0.2]);
    let glb = glb_with(&cube, |json| {
        json["images"] = serde_json::json!([{ "uri": "wood.png" }]);
        json["textures"] = serde_json::json!([{ "source": 0 }]);
        json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = serde_json::json!({ "index": 0 });
        // The places in the texture are the first numbers of the positions.
        let n = cube.positions.len();
        let places =
            serde_json::json!({ "bufferView": 0, "componentType": 5126, "count": n, "type": "VEC2" });
        json["accessors"].as_array_mut().unwrap().push(places);
        json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = serde_json::json!(2);
    });
    let cube = made(&put(&folder, "skins/box.glb", &glb), &folder, &Settings::default());
    assert_eq!(cube.parts[0].texture.as_ref().unwrap().get_pixel(1, 1).0, [9, 8, 7], "{:?}", cube.notes);
    let elsewhere = made(&put(&folder, "box.glb", &glb), &folder, &Settings::default());
    assert!(elsewhere.notes[0].contains("`wood.png`, which is not there"), "{:?}", elsewhere.notes);
}

#[test]
fn many_triangles_become_few_and_keep_the_shape() {
    let n = 120;
    let ball = |i: usize, j: usize| {
        let (theta, phi) =
            (std::f32::consts::PI * i as f32 / n as f32, std::f32::consts::TAU * j as f32 / n as f32);
        [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()].map(|value| 0.5 * value)
    };
    let mut part = MeshPart::default();
    for i in 0..n {
        for j in 0..n {
            let at = part.positions.len() as u32;
            part.positions.extend([ball(i, j), ball(i + 1, j), ball(i + 1, j + 1), ball(i, j + 1)]);
            part.triangles.extend([[at, at + 1, at + 2], [at, at + 2, at + 3]]);
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let path = put(&folder, "ball.obj", obj_of(&part, ""));
    let settings = Settings { max_triangles: 1000, unit: Some(LengthUnit::Metre), ..Settings::default() };
    let ball = made(&path, &folder, &settings);
    assert_eq!(ball.n_triangles[0], 2 * n * n);
    assert!((300..=1250).contains(&ball.n_triangles[1]), "{:?}", ball.n_triangles);
    assert!(ball.size_m.iter().all(|size| (size - 1.0).abs() < 0.05), "{:?}", ball.size_m);
}

#[test]
fn what_is_broken_is_told_with_its_reason() {
    let folder = tempfile::tempdir().unwrap();
    let cube = cuboid([1.0, 1.0, 1.0]);
    let glb = glb_of(&cube);
    let cases: [(&str, Vec<u8>, &str); 9] = [
        ("empty.obj", Vec::new(), "it holds no triangle"),
        ("points.obj", b"v 0 0 0\nv 1 1 1\n".to_vec(), "it holds no triangle"),
        (
            "index.obj",
            b"v 0 0 0\nf 1 2 3\n".to_vec(),
            "it is not a whole OBJ file: face vertex index out of bounds",
        ),
        ("nan.obj", b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".to_vec(), "a vertex is not finite"),
        ("cut.stl", stl_of(&cube)[..300].to_vec(), "it is not a whole STL file"),
        ("cut.glb", glb[..glb.len() - 40].to_vec(), "it is not a whole GLB file"),
        ("text.glb", b"no mesh".to_vec(), "it is not a whole GLB file"),
        (
            "dot.stl",
            stl_of(&cuboid([0.001, 0.001, 0.001])),
            "its longest side is 0.001 m; 0.05 to 12 are valid",
        ),
        ("flat.obj", b"v 0 0 0\nv 0 0 0\nv 0 0 0\nf 1 2 3\n".to_vec(), "its longest side is 0.000 m"),
    ];
    for (name, bytes, wanted) in cases {
        let told = prepare(&put(&folder, name, bytes), folder.path(), &Settings::default()).unwrap_err();
        assert!(told.contains(wanted), "{name}: {told}");
    }
}
