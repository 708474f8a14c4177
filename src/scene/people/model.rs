//! People as models: a mesh for each look, a palette for the colours, and a box that others can hit.

use std::fmt::Write as _;
use std::io::Cursor;
use std::sync::Arc;

use image::{ImageFormat, Rgb, RgbImage};

use super::Phases;
use super::shell::{N_TONES, Shell};
use crate::scene::bounds::{bounds_below, bounds_of};
use crate::scene::models::{Model, ModelFacts, SOLID_M};
use crate::scene::shape::Shape;

/// Makes a model.
///
/// # Panics
/// If there are no phases.
pub fn model(
    name: &str,
    facts: ModelFacts,
    mass_kg: f64,
    colours: &[[f64; 3]; N_TONES],
    phases: &Phases,
) -> Model {
    let mut files: Vec<(String, Arc<[u8]>)> = vec![(format!("{name}__palette.png"), palette(colours).into())];
    let mut assets_xml = format!(
        "<texture name=\"{name}/palette\" type=\"2d\" file=\"{name}__palette.png\"/>\n\
         <material name=\"{name}/palette\" texture=\"{name}/palette\" specular=\"0.05\" shininess=\"0.1\"/>\n"
    );
    let mut shapes = Vec::new();
    for (i, shell) in phases.shells.iter().enumerate() {
        let file = format!("{name}__{i}.msh");
        let _ = writeln!(assets_xml, "<mesh name=\"{name}/{i}\" file=\"{file}\" inertia=\"shell\"/>");
        files.push((file, shell.mesh().to_msh().into()));
        let geoms_xml = format!(
            "<geom type=\"mesh\" mesh=\"{name}/{i}\" material=\"{name}/palette\" group=\"2\" contype=\"0\" conaffinity=\"0\" mass=\"0\"/>\n"
        );
        shapes.push(Shape { geoms_xml, triangles: Arc::new(shell.corners()) });
    }
    let all: Vec<_> = phases.shells.iter().flat_map(Shell::corners).collect();
    let bounds = bounds_of(all.iter().flatten().copied()).expect("a person has a surface");
    let solid = bounds_below(&all, SOLID_M).unwrap_or(bounds);
    let (middle, half) = (nalgebra::center(&solid[0], &solid[1]), (solid[1] - solid[0]) / 2.0);
    let mut geoms_xml = format!(
        "<geom type=\"box\" size=\"{:.3} {:.3} {:.3}\" pos=\"{:.3} {:.3} {:.3}\" group=\"3\" mass=\"{mass_kg:.1}\" condim=\"6\" priority=\"1\" friction=\"0.8 0.01 0.01\"/>\n",
        0.6 * half.x,
        0.7 * half.y,
        half.z,
        middle.x,
        middle.y,
        middle.z
    );
    let triangles = Arc::clone(&shapes[0].triangles);
    // A body that keeps its shape shows it itself.
    if let [only] = &shapes[..] {
        geoms_xml += &only.geoms_xml;
        shapes.clear();
    }
    Model {
        name: name.to_owned(),
        facts,
        mass_kg,
        bounds,
        solid,
        overhang_m: bounds[1].x,
        triangles,
        assets_xml,
        paint_xml: None,
        geoms_xml,
        shapes,
        stride_m: phases.stride_m,
        files,
    }
}

/// One pixel for each tone.
fn palette(colours: &[[f64; 3]; N_TONES]) -> Vec<u8> {
    let pixel = |x: u32, _| Rgb(colours[x as usize].map(|c| (c * 255.0).round() as u8));
    let mut bytes = Cursor::new(Vec::new());
    let image = RgbImage::from_fn(N_TONES as u32, 1, pixel);
    image.write_to(&mut bytes, ImageFormat::Png).expect("encoding to memory cannot fail");
    bytes.into_inner()
}
