//! Models in another size: meshes, collision shapes and all that is known of them.

use std::sync::Arc;

use super::models::Model;

impl Model {
    /// The model `factor` times as large, about its origin on the ground. Its mass stays.
    pub(super) fn scale_by(&mut self, factor: f64) {
        let scale = format!("<mesh scale=\"{factor:.5} {factor:.5} {factor:.5}\" ");
        self.assets_xml = self.assets_xml.replace("<mesh ", &scale);
        for attribute in ["size", "pos"] {
            self.geoms_xml = scale_attribute(&self.geoms_xml, attribute, factor);
        }
        for corner in self.bounds.iter_mut().chain(&mut self.solid) {
            corner.coords *= factor;
        }
        self.overhang_m *= factor;
        let enlarge =
            |triangle: &[_; 3]| triangle.map(|corner: nalgebra::Point3<f32>| corner * factor as f32);
        self.triangles = Arc::new(self.triangles.iter().map(enlarge).collect());
    }
}

/// Multiplies all numbers of an attribute, wherever it stands.
fn scale_attribute(xml: &str, attribute: &str, factor: f64) -> String {
    let open = format!(" {attribute}=\"");
    let mut parts = xml.split(open.as_str());
    let mut scaled = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let (numbers, rest) = part.split_once('"').unwrap_or((part, ""));
        let times = |number: &str| number.parse::<f64>().map(|n| format!("{:.5}", n * factor));
        let numbers: Vec<String> =
            numbers.split_whitespace().map(|n| times(n).unwrap_or_else(|_| n.to_owned())).collect();
        scaled += &format!("{open}{}\"{rest}", numbers.join(" "));
    }
    scaled
}

#[cfg(test)]
mod tests {
    use super::super::models;

    #[test]
    fn a_larger_lorry_is_larger_in_all_that_is_known_of_it() {
        let mut lorry = models::load().unwrap().into_iter().find(|model| model.name == "truck").unwrap();
        assert!(!lorry.assets_xml.contains("scale=") && lorry.geoms_xml.contains("size=\"2.970 "));
        let (before, n_meshes) = (lorry.clone(), lorry.assets_xml.matches("<mesh ").count());
        lorry.scale_by(1.05);
        assert!((lorry.length_m() - 1.05 * before.length_m()).abs() < 1e-12);
        assert!((lorry.solid[1].z - 1.05 * before.solid[1].z).abs() < 1e-12);
        let n_scaled = lorry.assets_xml.matches("<mesh scale=\"1.05000 1.05000 1.05000\" name=").count();
        assert!(n_scaled == n_meshes && n_meshes > 5, "{n_scaled} of {n_meshes}");
        assert!(
            lorry.geoms_xml.contains("size=\"3.11850 1.31250 1.77450\" pos=\"-1.03950 0.00000 1.77450\"")
        );
        assert!((lorry.triangles[7][2] - before.triangles[7][2] * 1.05).norm() < 1e-5);
        assert_eq!(lorry.mass_kg, before.mass_kg);
    }
}
