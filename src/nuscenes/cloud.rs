//! `.pcd.bin`: five little-endian float32 a point: x, y, z, intensity (0 to 255), ring.

use thiserror::Error;

/// Bytes of a point.
pub const POINT_BYTES: usize = 20;

/// A file that cannot hold whole points.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error(
    "it has {n_bytes} bytes, which is no multiple of {POINT_BYTES}: the file is cut short or no cloud of five float32 a point"
)]
pub struct CloudFault {
    pub n_bytes: usize,
}

/// The points of a file: x, y, z, intensity, ring, in the LiDAR's own axes.
///
/// # Errors
/// The file does not end with a whole point.
pub fn read_cloud(bytes: &[u8]) -> Result<Vec<[f32; 5]>, CloudFault> {
    let (points, rest) = bytes.as_chunks::<POINT_BYTES>();
    if !rest.is_empty() {
        return Err(CloudFault { n_bytes: bytes.len() });
    }
    let value = |point: &[u8; POINT_BYTES], i: usize| {
        f32::from_le_bytes([point[4 * i], point[4 * i + 1], point[4 * i + 2], point[4 * i + 3]])
    };
    Ok(points.iter().map(|point| std::array::from_fn(|i| value(point, i))).collect())
}

/// The bytes of a file with these points.
pub fn write_cloud(points: impl Iterator<Item = [f32; 5]>) -> Vec<u8> {
    points.flatten().flat_map(f32::to_le_bytes).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_survive_to_the_bit_and_a_cut_file_is_told() {
        let points = [[1.5, -0.0, f32::MIN_POSITIVE, 255.0, 31.0], [0.1, 0.2, 0.3, 0.4, 0.0]];
        let bytes = write_cloud(points.into_iter());
        assert_eq!(bytes.len(), 2 * POINT_BYTES);
        let back = read_cloud(&bytes).unwrap();
        assert_eq!(
            back.concat().iter().map(|x| x.to_bits()).collect::<Vec<_>>(),
            points.concat().iter().map(|x| x.to_bits()).collect::<Vec<_>>()
        );
        assert_eq!(read_cloud(&bytes[..39]), Err(CloudFault { n_bytes: 39 }));
    }
}
