//! Raw recordings, synchronised: `<date>/<date>_drive_NNNN_sync/{velodyne_points,image_02,oxts}/data`, stamps, the date's calibration.

use std::path::{Path, PathBuf};

use super::calib::Calibration;
use super::oxts::Packet;
use super::rig::{FRONT, Rig};
use super::sequence::Parts;
use super::tracklets::read_tracklets;
use crate::files;
use crate::import::ImportError;
use crate::import::error::{listed, read_text};

/// Reads what a drive needs.
pub(super) fn read_drive(drive: &Path, rig: &Rig) -> Result<Parts, ImportError> {
    let date = drive.parent().unwrap_or(drive);
    let calibration = Calibration::read_raw(date)?;
    let clouds = drive.join("velodyne_points");
    let times_ns = read_stamps(&clouds.join("timestamps.txt"))?;
    let front = drive.join(format!("image_0{FRONT}"));
    let picture_stamps = front.join("timestamps.txt");
    let picture_times_ns =
        if files::is_dir(&front)? { read_stamps(&picture_stamps)? } else { times_ns.clone() };
    let n_lines = times_ns.len();
    if picture_times_ns.len() != n_lines {
        let message = format!(
            "there are {} stamps of pictures and {n_lines} of clouds; as many are needed",
            picture_times_ns.len()
        );
        return Err(ImportError::at(&picture_stamps, message));
    }
    // What was not recorded has an empty line, and its number no file.
    let whole: Vec<(usize, u64, u64)> =
        (0..n_lines).filter_map(|i| Some((i, times_ns[i]?, picture_times_ns[i]?))).collect();
    let oxts_times_ns = read_stamps(&drive.join("oxts/timestamps.txt"))?;
    let mut packets = Vec::with_capacity(oxts_times_ns.len());
    let stamped = oxts_times_ns.into_iter().enumerate().filter_map(|(i, time_ns)| Some((i, time_ns?)));
    for (i, time_ns) in stamped {
        let path = drive.join("oxts/data").join(format!("{i:010}.txt"));
        let packet = Packet::parse(read_text(&path)?.trim(), &path)?;
        // A few drives have packets out of order; the odometry must rise.
        if packets.last().is_none_or(|(last_ns, _)| *last_ns < time_ns) {
            packets.push((time_ns, packet));
        }
    }
    let tracklets = drive.join("tracklet_labels.xml");
    let annotated = if files::is_file(&tracklets)? {
        let mut by_line = read_tracklets(&tracklets, &rig.ego_from_velo(&calibration), n_lines)?;
        let of_frame =
            |(frame_idx, (i, ..)): (usize, &(usize, u64, u64))| Some((frame_idx, by_line.remove(i)?));
        Some(whole.iter().enumerate().filter_map(of_frame).collect())
    } else {
        None
    };
    let n_out = n_lines - whole.len();
    let left_out =
        format!("{n_out} of {n_lines}, which have no stamp of the cloud or the picture, are left out");
    Ok(Parts {
        path: drive.to_owned(),
        description: format!(
            "KITTI raw recording {}",
            drive.file_name().unwrap_or_default().to_string_lossy()
        ),
        frames: whole.iter().map(|(i, time_ns, _)| (format!("{i:010}"), *time_ns)).collect(),
        clouds: clouds.join("data"),
        pictures: |parts, number| pictures(parts, number),
        picture_times_ns: whole.iter().map(|(.., time_ns)| *time_ns).collect(),
        calibration,
        packets,
        annotated,
        methods: (n_out > 0).then_some(("frames", left_out)).into_iter().collect(),
    })
}

fn pictures(parts: &Parts, number: usize) -> PathBuf {
    parts.path.join(format!("image_{number:02}")).join("data")
}

/// The drives of a source: itself, those of a date's folder, or those of all dates in it.
///
/// # Errors
/// A folder cannot be read.
pub(super) fn find_drives(source: &Path) -> std::io::Result<Vec<PathBuf>> {
    let is_drive = |path: &Path| -> std::io::Result<bool> {
        Ok(files::is_dir(&path.join("velodyne_points"))? && files::is_dir(&path.join("oxts"))?)
    };
    if is_drive(source)? {
        return Ok(vec![source.to_owned()]);
    }
    let here = listed(source)?;
    let mut places = here.clone();
    for folder in here {
        if files::is_dir(&folder)? {
            places.extend(listed(&folder)?);
        }
    }
    let mut drives = Vec::new();
    for place in places {
        if is_drive(&place)? {
            drives.push(place);
        }
    }
    drives.sort();
    Ok(drives)
}

/// One stamp a line: `2011-09-26 13:02:25.964389445`; `None` for an empty line before the last stamp.
fn read_stamps(path: &Path) -> Result<Vec<Option<u64>>, ImportError> {
    let text = read_text(path)?;
    let fail = |line: &str| {
        ImportError::at(path, format!("a stamp is `{line}`; `2011-09-26 13:02:25.964389445` would be valid"))
    };
    let stamp = |line: &str| match line.trim() {
        "" => Ok(None),
        line => parse_stamp(line).map(Some).ok_or_else(|| fail(line)),
    };
    text.trim_end().lines().map(stamp).collect()
}

/// Nanoseconds since 1970.
fn parse_stamp(line: &str) -> Option<u64> {
    let (date, clock) = line.split_once(' ')?;
    let mut date = date.split('-').map(|part| part.parse::<i64>().ok());
    let (year, month, day) = (date.next()??, date.next()??, date.next()??);
    let (clock, fraction) = clock.split_once('.').unwrap_or((clock, "0"));
    let mut clock = clock.split(':').map(|part| part.parse::<i64>().ok());
    let (hours, minutes, seconds) = (clock.next()??, clock.next()??, clock.next()??);
    let nanoseconds: u64 = format!("{fraction:0<9}").get(..9)?.parse().ok()?;
    // Nanoseconds of 64 bits end in the year 2554.
    let is_day = (1970..=2500).contains(&year) && (1..=12).contains(&month) && (1..=31).contains(&day);
    let is_clock = (0..24).contains(&hours) && (0..60).contains(&minutes) && (0..=60).contains(&seconds);
    if !(is_day && is_clock) {
        return None;
    }
    // Days from civil (Hinnant): years begin in March.
    let year = if month <= 2 { year - 1 } else { year };
    let of_year = (153 * ((month + 9) % 12) + 2) / 5 + day - 1;
    let of_era = year.rem_euclid(400) * 365 + year.rem_euclid(400) / 4 - year.rem_euclid(400) / 100 + of_year;
    let days = year.div_euclid(400) * 146_097 + of_era - 719_468;
    let seconds = u64::try_from(((days * 24 + hours) * 60 + minutes) * 60 + seconds).ok()?;
    Some(seconds * 1_000_000_000 + nanoseconds)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stamp_is_read_to_the_nanosecond() {
        assert_eq!(parse_stamp("2011-09-26 13:02:25.964389445"), Some(1_317_042_145_964_389_445));
        assert_eq!(parse_stamp("1970-01-01 00:00:01.5"), Some(1_500_000_000));
        assert_eq!(parse_stamp("26.9.2011"), None);
        assert_eq!(parse_stamp("20101-09-26 13:02:25.1"), None);
    }
}
