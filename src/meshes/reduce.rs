//! Fewer triangles that look alike, by meshoptimizer.

use meshopt::SimplifyOptions;

use super::MeshPart;

/// Reduces the parts to about `most` triangles in all, each by its share; returns whether shape was lost beyond 5 % of the size.
pub(super) fn reduce(parts: &mut [MeshPart], most: usize) -> bool {
    let n_triangles: usize = parts.iter().map(|part| part.triangles.len()).sum();
    if n_triangles <= most {
        return false;
    }
    let mut is_coarse = false;
    for part in parts.iter_mut() {
        let wanted = (part.triangles.len() * most / n_triangles).max(12) * 3;
        let corners = part.triangles.as_flattened();
        let (options, mut error) = (SimplifyOptions::Prune, 0.0);
        let mut left =
            meshopt::simplify_decoder(corners, &part.positions, wanted, 0.05, options, Some(&mut error));
        if left.len() > wanted + wanted / 4 {
            // Loose triangles and seams hold the first way up; this one takes no care of them.
            left = meshopt::simplify_sloppy_decoder(corners, &part.positions, wanted, 0.1, Some(&mut error));
            is_coarse = true;
        }
        part.triangles = left.as_chunks::<3>().0.to_vec();
        drop_unused(part);
    }
    is_coarse
}

/// Leaves out vertices that no triangle names.
fn drop_unused(part: &mut MeshPart) {
    let mut new_of_old = vec![None; part.positions.len()];
    let (mut positions, mut places) = (Vec::new(), Vec::new());
    for corner in part.triangles.iter_mut().flatten() {
        let old = *corner as usize;
        *corner = *new_of_old[old].get_or_insert_with(|| {
            positions.push(part.positions[old]);
            places.extend(part.texture_places.get(old));
            positions.len() as u32 - 1
        });
    }
    part.positions = positions;
    part.texture_places = places;
}
