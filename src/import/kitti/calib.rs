//! KITTI's calibration files: projections, rectification, where the Velodyne and the GPS/IMU sit.
//!
//! The object set's rows end in a colon, the tracking set's do not always; raw drives have three files with rotations and translations apart.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::import::ImportError;
use crate::import::error::read_text;

/// The rig of one frame or sequence.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Calibration {
    /// From the Velodyne to the rectified camera 0.
    pub(super) rect_from_velo: Isometry3<f64>,
    /// Of cameras 0 to 3, row by row; `None` where the file lacks one.
    projections: [Option<[f64; 12]>; 4],
    pub(super) velo_from_imu: Option<Isometry3<f64>>,
    /// The file, for messages.
    path: PathBuf,
}

/// One camera after rectification.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RectifiedCamera {
    /// Row by row, digit for digit.
    pub(super) k: [f64; 9],
    /// From the rectified camera 0 to this one: its baseline, which the projection's last column holds, and in exports of pitched cameras a
    /// turn.
    pub(super) camera_from_rect: Isometry3<f64>,
}

impl Calibration {
    /// Reads `calib/NNNNNN.txt` of the object set, or `calib/NNNN.txt` of the tracking set.
    pub(super) fn read(path: &Path) -> Result<Self, ImportError> {
        let rows = Rows::read(path)?;
        let rect = rows.rotation(&["R0_rect", "R_rect"])?;
        let velo_to_cam = rows.rigid(&["Tr_velo_to_cam", "Tr_velo_cam"])?;
        let imu = ["Tr_imu_to_velo", "Tr_imu_velo"];
        let velo_from_imu = if rows.has(&imu) { Some(rows.rigid(&imu)?) } else { None };
        let mut projections = [None; 4];
        for (camera, projection) in projections.iter_mut().enumerate() {
            let name = format!("P{camera}");
            if rows.has(&[&name]) {
                *projection = Some(rows.numbers(&[&name])?);
            }
        }
        let rect_from_velo = Isometry3::from_parts(Translation3::identity(), rect) * velo_to_cam;
        Ok(Self { rect_from_velo, projections, velo_from_imu, path: path.to_owned() })
    }

    /// Reads the three files of a raw recording's date.
    pub(super) fn read_raw(date: &Path) -> Result<Self, ImportError> {
        let cameras = Rows::read(&date.join("calib_cam_to_cam.txt"))?;
        let velo = Rows::read(&date.join("calib_velo_to_cam.txt"))?;
        let imu = Rows::read(&date.join("calib_imu_to_velo.txt"))?;
        let rect = cameras.rotation(&["R_rect_00"])?;
        let mut projections = [None; 4];
        for (camera, projection) in projections.iter_mut().enumerate() {
            let name = format!("P_rect_0{camera}");
            if cameras.has(&[&name]) {
                *projection = Some(cameras.numbers(&[&name])?);
            }
        }
        Ok(Self {
            rect_from_velo: Isometry3::from_parts(Translation3::identity(), rect) * velo.pose()?,
            projections,
            velo_from_imu: Some(imu.pose()?),
            path: cameras.path,
        })
    }

    /// A camera by its number.
    pub(super) fn camera(&self, camera: usize) -> Result<RectifiedCamera, ImportError> {
        let fail = |message: String| ImportError::at(&self.path, message);
        let projection = self.projections.get(camera).copied().flatten();
        let p = projection
            .ok_or_else(|| fail(format!("the calibration has no row `P{camera}`; it is needed")))?;
        let is_pinhole = p[0] > 0.0 && p[5] > 0.0 && [p[1], p[4], p[8], p[9]] == [0.0; 4] && p[10] == 1.0;
        if is_pinhole {
            let z = p[11];
            let baseline = Vector3::new((p[3] - p[2] * z) / p[0], (p[7] - p[6] * z) / p[5], z);
            let k = [p[0], 0.0, p[2], 0.0, p[5], p[6], 0.0, 0.0, 1.0];
            return Ok(RectifiedCamera { k, camera_from_rect: Translation3::from(baseline).into() });
        }
        split_projection(&p).ok_or_else(|| {
            fail(format!(
                "the row `P{camera}` is {p:?}; a pinhole is needed, [f 0 cu .., 0 f cv .., 0 0 1 ..], or one that is turned"
            ))
        })
    }
}

/// A pinhole that is turned against the rectified frame, `P = K [R | t]`, as exports of pitched cameras have it (Hartley and Zisserman
/// 2004, sec. 6.2.4); `None` where `K` would have skew or `R` would mirror.
fn split_projection(p: &[f64; 12]) -> Option<RectifiedCamera> {
    const MAX_SKEW: f64 = 1e-6;
    let m = Matrix3::new(p[0], p[1], p[2], p[4], p[5], p[6], p[8], p[9], p[10]);
    if !(m.determinant() > 0.0) {
        return None;
    }
    // The inverse of M is the inverse of R, a rotation, times that of K, which is upper triangular.
    let (q, r) = m.try_inverse()?.qr().unpack();
    let signs = Matrix3::from_diagonal(&r.diagonal().map(f64::signum));
    let (rotation, k) = ((q * signs).transpose(), (signs * r).try_inverse()?);
    let baseline = k.try_inverse()? * Vector3::new(p[3], p[7], p[11]);
    let scaled = k / k[(2, 2)];
    let is_usable = rotation.determinant() > 0.0
        && scaled[(0, 0)] > 0.0
        && scaled[(1, 1)] > 0.0
        && scaled[(0, 1)].abs() < MAX_SKEW * scaled[(0, 0)];
    let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    is_usable.then(|| RectifiedCamera {
        k: [scaled[(0, 0)], 0.0, scaled[(0, 2)], 0.0, scaled[(1, 1)], scaled[(1, 2)], 0.0, 0.0, 1.0],
        camera_from_rect: Isometry3::from_parts(Translation3::from(baseline), turn),
    })
}

/// The rows of a file: a name, then numbers.
struct Rows {
    rows: BTreeMap<String, String>,
    path: PathBuf,
}

impl Rows {
    fn read(path: &Path) -> Result<Self, ImportError> {
        let text = read_text(path)?;
        let row = |line: &str| {
            let (name, rest) = line.trim().split_once(|c: char| c == ':' || c.is_whitespace())?;
            Some((name.to_owned(), rest.trim_start_matches(':').trim().to_owned()))
        };
        Ok(Self { rows: text.lines().filter_map(row).collect(), path: path.to_owned() })
    }

    fn has(&self, names: &[&str]) -> bool {
        names.iter().any(|name| self.rows.contains_key(*name))
    }

    /// The numbers of the first of some names that is there.
    fn numbers<const N: usize>(&self, names: &[&str]) -> Result<[f64; N], ImportError> {
        let fail = |message: String| ImportError::at(&self.path, message);
        let Some((name, text)) = names.iter().find_map(|name| Some((name, self.rows.get(*name)?))) else {
            let found: Vec<&String> = self.rows.keys().collect();
            return Err(fail(format!("the calibration has the rows {found:?} and lacks `{}`", names[0])));
        };
        let numbers: Option<Vec<f64>> = text.split_whitespace().map(|word| word.parse().ok()).collect();
        let numbers = numbers.filter(|numbers| numbers.iter().all(|number: &f64| number.is_finite()));
        let numbers = numbers.and_then(|numbers| <[f64; N]>::try_from(numbers).ok());
        numbers.ok_or_else(|| fail(format!("the row `{name}` is `{text}`; {N} finite numbers are needed")))
    }

    fn rotation(&self, names: &[&str]) -> Result<UnitQuaternion<f64>, ImportError> {
        let matrix = Matrix3::from_row_slice(&self.numbers::<9>(names)?);
        self.checked_rotation(names[0], matrix)
    }

    fn rigid(&self, names: &[&str]) -> Result<Isometry3<f64>, ImportError> {
        let [a, b, c, x, d, e, f, y, g, h, i, z] = self.numbers::<12>(names)?;
        let rotation = self.checked_rotation(names[0], Matrix3::new(a, b, c, d, e, f, g, h, i))?;
        Ok(Isometry3::from_parts(Translation3::new(x, y, z), rotation))
    }

    /// `R` and `T` of a raw recording's file.
    fn pose(&self) -> Result<Isometry3<f64>, ImportError> {
        let [x, y, z] = self.numbers::<3>(&["T"])?;
        Ok(Isometry3::from_parts(Translation3::new(x, y, z), self.rotation(&["R"])?))
    }

    fn checked_rotation(&self, name: &str, matrix: Matrix3<f64>) -> Result<UnitQuaternion<f64>, ImportError> {
        let off = (matrix.transpose() * matrix - Matrix3::identity()).abs().max();
        if off > 1e-3 || matrix.determinant() < 0.0 {
            let message =
                format!("the row `{name}` is no rotation (off by {off:.3}); a right-handed one is needed");
            return Err(ImportError::at(&self.path, message));
        }
        let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix));
        // Seven digits make a rotation to 1e-7 only; a quaternion of another length than 1 would not invert.
        Ok(UnitQuaternion::new_normalize(turn.into_inner()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(super) const TEXT: &str = "\
P2: 7.0e+02 0 6.0e+02 4.5e+01 0 7.0e+02 1.8e+02 -3.5e-01 0 0 1 5.0e-03
R0_rect: 1 0 0 0 1 0 0 0 1
Tr_velo_to_cam: 0 -1 0 0.01 0 0 -1 -0.08 1 0 0 -0.27
";

    fn read(text: &str) -> Result<Calibration, ImportError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("000000.txt");
        fs_err::write(&path, text).unwrap();
        Calibration::read(&path)
    }

    #[test]
    fn the_baseline_of_the_projection_is_kept() {
        let calibration = read(TEXT).unwrap();
        let camera = calibration.camera(2).unwrap();
        let point = Vector3::new(3.0, 1.0, 20.0);
        let moved = camera.camera_from_rect * nalgebra::Point3::from(point);
        let (u, v) = (700.0 * moved.x / moved.z + 600.0, 700.0 * moved.y / moved.z + 180.0);
        let z = point.z + 5.0e-3;
        let (wanted_u, wanted_v) =
            ((700.0 * 3.0 + 600.0 * 20.0 + 45.0) / z, (700.0 + 180.0 * 20.0 - 0.35) / z);
        assert!((u - wanted_u).abs() < 1e-9 && (v - wanted_v).abs() < 1e-9, "{u} {v}");
        assert!(calibration.camera(3).unwrap_err().to_string().contains("`P3`"));
    }

    #[test]
    fn a_turned_pinhole_is_split_into_its_k_and_its_turn_and_a_skewed_one_is_refused() {
        let k = Matrix3::new(700.0, 0.0, 600.0, 0.0, 710.0, 180.0, 0.0, 0.0, 1.0);
        let turn = Isometry3::from_parts(
            Translation3::new(0.06, -0.01, 0.002),
            UnitQuaternion::from_euler_angles(0.1, -0.02, 0.05),
        );
        let of = |k: Matrix3<f64>| {
            let m = k * turn.to_homogeneous().fixed_view::<3, 4>(0, 0);
            let mut p = [0.0; 12];
            (0..12).for_each(|i| p[i] = m[(i / 4, i % 4)]);
            split_projection(&p)
        };
        let camera = of(k).unwrap();
        assert!((Matrix3::from_row_slice(&camera.k) - k).abs().max() < 1e-9, "{:?}", camera.k);
        assert!((camera.camera_from_rect.to_homogeneous() - turn.to_homogeneous()).abs().max() < 1e-12);
        assert!(of(Matrix3::new(700.0, 5.0, 600.0, 0.0, 710.0, 180.0, 0.0, 0.0, 1.0)).is_none());
        assert!(of(-k).is_none());
    }

    #[test]
    fn a_missing_a_short_and_a_twisted_row_are_told() {
        let missing = read(&TEXT.replace("Tr_velo_to_cam", "Tr_x")).unwrap_err().to_string();
        assert!(missing.contains("lacks `Tr_velo_to_cam`") && missing.contains("000000.txt"), "{missing}");
        let short = read(&TEXT.replace("R0_rect: 1", "R0_rect:")).unwrap_err().to_string();
        assert!(short.contains("9 finite numbers"), "{short}");
        let twisted = read(&TEXT.replace("R0_rect: 1", "R0_rect: 2")).unwrap_err().to_string();
        assert!(twisted.contains("no rotation"), "{twisted}");
    }
}
