//! Whether a surface is closed.

use std::collections::BTreeMap;

use super::MeshPart;

/// Edges that do not lie between exactly two triangles, and all edges. Vertices closer than a millionth of the
/// size are one, over all parts: exporters split a surface at seams of its textures.
pub(super) fn open_edges(parts: &[MeshPart]) -> (usize, usize) {
    let all = || parts.iter().flat_map(|part| &part.positions);
    let size = all().flatten().fold(0.0_f32, |size, value| size.max(value.abs())).max(f32::MIN_POSITIVE);
    let key = |position: &[f32; 3]| position.map(|value| (value / size * 1e6).round() as i32);
    let mut n_of_edge: BTreeMap<[[i32; 3]; 2], u32> = BTreeMap::new();
    for part in parts {
        for triangle in &part.triangles {
            let corners = triangle.map(|corner| key(&part.positions[corner as usize]));
            for i in 0..3 {
                let mut edge = [corners[i], corners[(i + 1) % 3]];
                edge.sort_unstable();
                if edge[0] != edge[1] {
                    *n_of_edge.entry(edge).or_default() += 1;
                }
            }
        }
    }
    (n_of_edge.values().filter(|&&n| n != 2).count(), n_of_edge.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tetrahedron() -> MeshPart {
        MeshPart {
            positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            triangles: vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]],
            ..MeshPart::default()
        }
    }

    #[test]
    fn a_tetrahedron_is_closed_also_in_two_parts_and_open_without_a_face() {
        assert_eq!(open_edges(&[tetrahedron()]), (0, 6));
        let (mut first, mut second) = (tetrahedron(), tetrahedron());
        first.triangles.truncate(1);
        second.triangles.remove(0);
        assert_eq!(open_edges(&[second.clone()]), (3, 6));
        assert_eq!(open_edges(&[first, second]), (0, 6));
    }
}
