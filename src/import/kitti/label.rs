//! KITTI's label rows: boxes in the rectified camera 0, bottom centre, turned about its y axis.

use std::path::Path;

use nalgebra::{Isometry3, Point3, Vector3};

use crate::geometry::{Box3, Ego, Point};
use crate::import::error::read_text;
use crate::import::{ImportError, RawObject};
use crate::sample::IgnoredRegion;

/// Columns of a label without score, and with.
const COLUMNS: [usize; 2] = [15, 16];
/// The category of regions that nobody annotated.
const DONT_CARE: &str = "DontCare";

/// One row.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct LabelRow {
    /// Tracking only: the frame and the track; in the object set the row's number stands for the track.
    pub(super) frame: usize,
    pub(super) id: String,
    pub(super) category: String,
    /// Left, top, right, bottom.
    image_px: [f64; 4],
    /// Height, width, length; x, y, z of the bottom's centre; rotation about y.
    numbers: [f64; 7],
}

/// Reads a label file of the object set.
pub(super) fn read_object_labels(path: &Path) -> Result<Vec<LabelRow>, ImportError> {
    let text = read_text(path)?;
    let lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    lines.map(|(i, line)| parse(0, i.to_string(), &words(line), i, path)).collect()
}

/// Reads the label file of a tracking sequence: each row begins with the frame and the track.
pub(super) fn read_tracking_labels(path: &Path) -> Result<Vec<LabelRow>, ImportError> {
    let text = read_text(path)?;
    let lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let row = |(i, line): (usize, &str)| {
        let words = words(line);
        let fail = || fault(path, i, "a frame's number, a track's number and a label are needed", line);
        let [frame, track, rest @ ..] = words.as_slice() else { return Err(fail()) };
        let frame = frame.parse().map_err(|_| fail())?;
        // Regions have no track.
        let id = match *track {
            "-1" => format!("region-{i}"),
            track => track.to_owned(),
        };
        parse(frame, id, rest, i, path)
    };
    lines.map(row).collect()
}

fn words(line: &str) -> Vec<&str> {
    line.split_whitespace().collect()
}

fn fault(path: &Path, line_idx: usize, wanted: &str, found: &str) -> ImportError {
    ImportError::at(path, format!("line {} is `{found}`; {wanted}", line_idx + 1))
}

fn parse(
    frame: usize,
    id: String,
    words: &[&str],
    line_idx: usize,
    path: &Path,
) -> Result<LabelRow, ImportError> {
    let fail = |wanted: &str| fault(path, line_idx, wanted, &words.join(" "));
    if !COLUMNS.contains(&words.len()) {
        return Err(fail(
            "15 columns are needed: category, truncation, occlusion, alpha, box, sizes, place, rotation",
        ));
    }
    let numbers: Option<Vec<f64>> =
        words[4..15].iter().map(|word| word.parse().ok().filter(|number: &f64| number.is_finite())).collect();
    let numbers = numbers.ok_or_else(|| fail("finite numbers are needed after the category"))?;
    let row = LabelRow {
        frame,
        id,
        category: words[0].to_owned(),
        image_px: std::array::from_fn(|i| numbers[i]),
        numbers: std::array::from_fn(|i| numbers[4 + i]),
    };
    if !row.is_region() && row.numbers[..3].iter().any(|size| *size <= 0.0) {
        return Err(fail("sizes above 0 are needed"));
    }
    Ok(row)
}

impl LabelRow {
    pub(super) fn is_region(&self) -> bool {
        self.category == DONT_CARE
    }

    /// The region of the picture, of a `DontCare`.
    pub(super) fn region(&self) -> IgnoredRegion {
        let [left_px, top_px, right_px, bottom_px] = self.image_px;
        IgnoredRegion::Image { left_px, top_px, right_px, bottom_px }
    }

    /// The box in the ego frame.
    pub(super) fn box_in_ego(&self, ego_from_rect: &Isometry3<f64>) -> Box3<Ego> {
        let [height_m, width_m, length_m, x, y, z, rotation_y] = self.numbers;
        // y points down, so the middle lies above the bottom.
        let center = ego_from_rect * Point3::new(x, y - height_m / 2.0, z);
        let ahead = ego_from_rect * Vector3::new(rotation_y.cos(), 0.0, -rotation_y.sin());
        Box3 {
            center: Point::from_coords(center),
            length_m,
            width_m,
            height_m,
            yaw_rad: ahead.y.atan2(ahead.x),
        }
    }

    pub(super) fn object(&self, ego_from_rect: &Isometry3<f64>, velocity_in_ego_mps: [f64; 2]) -> RawObject {
        RawObject {
            id: self.id.clone(),
            category: self.category.clone(),
            box_in_ego: self.box_in_ego(ego_from_rect),
            velocity_in_ego_mps,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Rotation3, Translation3, UnitQuaternion};

    fn parsed(line: &str) -> Result<LabelRow, ImportError> {
        parse(0, "0".to_owned(), &words(line), 0, Path::new("label_2/000000.txt"))
    }

    #[test]
    fn a_car_that_drives_away_on_the_right_points_ahead_in_the_ego_frame() {
        // Optical axes onto forward, left, up; the camera 1.65 m over the ground.
        let axes = Matrix3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0);
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
        let ego_from_rect = Isometry3::from_parts(Translation3::new(1.0, 0.0, 1.65), rotation);
        let row = parsed("Car 0.00 0 -1.57 1 2 3 4 1.5 1.6 4.0 3.0 1.65 20.0 -1.5707963267948966").unwrap();
        let found = row.box_in_ego(&ego_from_rect);
        let center = [found.center.x(), found.center.y(), found.center.z()];
        let wanted = [21.0, -3.0, 0.75];
        assert!(center.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-9), "{center:?}");
        assert!(found.yaw_rad.abs() < 1e-9 && found.length_m == 4.0 && found.width_m == 1.6);
    }

    #[test]
    fn a_tracking_file_that_is_cut_is_told_with_its_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("0000.txt");
        for cut in ["15", "x 1 Car"] {
            let whole = "0 1 Person 0.00 0 -1.57 1 2 3 4 1.5 1.6 4.0 3.0 1.65 20.0 0.1\n";
            fs_err::write(&path, format!("{whole}{cut}")).unwrap();
            let told = read_tracking_labels(&path).unwrap_err().to_string();
            assert!(told.contains("line 2 is") && told.contains("track's number"), "{told}");
        }
    }

    #[test]
    fn rows_that_are_not_valid_are_told_with_their_line() {
        let told = |line: &str| parsed(line).unwrap_err().to_string();
        assert!(told("Car 0.00 0 -1.57 1 2 3").contains("line 1 is"));
        assert!(told("Car 0.00 0 -1.57 1 2 3 4 1.5 1.6 nan 3.0 1.65 20.0 0").contains("finite"));
        assert!(told("Car 0.00 0 -1.57 1 2 3 4 0 1.6 4 3.0 1.65 20.0 0").contains("above 0"));
        assert!(
            parsed("DontCare -1 -1 -10 503.89 169.71 590.61 190.13 -1 -1 -1 -1000 -1000 -1000 -10").is_ok()
        );
    }
}
