//! `sensor_msgs/PointCloud2` to points: any layout of fields, either byte order, organised or not.
//!
//! The points stay the bytes that they are until each is read once. What the bytes do not say of themselves - the unit
//! of times, whether rings count from below - is decided once a drive, on its first cloud ([`Cloud::habits`]).

use nalgebra::{UnitQuaternion, Vector3};

use super::cdr::{CdrError, Numbers, Value};
use super::mapping::{LidarMapping, TimeUnit};
use super::schema::NumberType;
use crate::import::RawPoint;

const INTENSITY_NAMES: [&str; 4] = ["intensity", "intensities", "reflectivity", "i"];
/// Where a cloud has both, as Ouster's do, the first counts photons and falls with the range.
const SIGNAL_AND_REFLECTIVITY: [&str; 2] = ["intensity", "reflectivity"];
const RING_NAMES: [&str; 5] = ["ring", "channel", "line", "laser_id", "laser_number"];
const TIME_NAMES: [&str; 7] =
    ["t", "time", "timestamp", "time_stamp", "offset_time", "point_time_offset", "time_offset"];
/// A turn lasts this long, at the least and at the most: 5 Hz to 100 Hz with a margin.
const TURN_S: [f64; 2] = [0.005, 1.0];
/// Times beyond this count from an epoch, not from the cloud's stamp.
const LONGEST_OFFSET_S: f64 = 1.0;
/// A cloud with fewer points does not tell how its rings are counted.
const LEAST_POINTS: usize = 100;

/// A cloud as its message describes it.
pub struct Cloud<'a> {
    width: usize,
    height: usize,
    point_step: usize,
    row_step: usize,
    is_big_endian: bool,
    data: Numbers<'a>,
    xyz: [Field; 3],
    intensity: Option<Field>,
    /// Whether the reflectivity was preferred to an intensity that is there too.
    has_signal: bool,
    ring: Option<Field>,
    time: Option<Field>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Field {
    offset: usize,
    number: NumberType,
}

/// What holds for all clouds of a drive.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CloudHabits {
    pub time: Option<TimeHabit>,
    /// `None`: the rings are of no use, or there are none.
    pub rings: Option<RingHabit>,
}

/// How the times of points are counted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimeHabit {
    pub unit_s: f64,
    pub origin: TimeOrigin,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TimeOrigin {
    /// From the cloud's stamp.
    Stamp,
    /// From the epoch of the stamps.
    Epoch,
    /// From another epoch, such as the sensor's start: the earliest point is taken to have the cloud's stamp.
    Unknown,
}

impl TimeOrigin {
    /// As people say it.
    #[must_use]
    pub fn tell(self) -> &'static str {
        match self {
            Self::Stamp => "the cloud's stamp",
            Self::Epoch => "the epoch of the stamps",
            Self::Unknown => "the earliest point, which is taken to have the cloud's stamp",
        }
    }
}

/// How rings are counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RingHabit {
    FromBelow,
    /// From above, among so many.
    FromAbove {
        n_rings: u16,
    },
}

impl RingHabit {
    #[must_use]
    pub fn is_turned(self) -> bool {
        self != Self::FromBelow
    }
}

fn number_type(datatype: f64) -> Option<NumberType> {
    let types = [
        NumberType::I8,
        NumberType::U8,
        NumberType::I16,
        NumberType::U16,
        NumberType::I32,
        NumberType::U32,
        NumberType::F32,
        NumberType::F64,
    ];
    let types = types.get((datatype as usize).checked_sub(1)?);
    types.copied()
}

impl<'a> Cloud<'a> {
    /// Reads what the message says of its layout, and compares it with its length.
    ///
    /// # Errors
    /// A field that is needed is missing or of no known type, or the data is not as long as the layout says.
    pub fn of(message: &Value<'a>, mapping: &LidarMapping) -> Result<Self, String> {
        let tell = |error: CdrError| error.to_string();
        let mut fields = Vec::new();
        for field in message.list("fields").map_err(tell)? {
            let name = field.text("name").map_err(tell)?.to_owned();
            let (offset, datatype) =
                (field.number("offset").map_err(tell)? as usize, field.number("datatype").map_err(tell)?);
            let number = number_type(datatype).ok_or_else(|| {
                format!("the cloud's field `{name}` has the type {datatype}; 1 to 8 are known")
            })?;
            fields.push((name, Field { offset, number }));
        }
        let names = || fields.iter().map(|(name, _)| format!("`{name}`")).collect::<Vec<_>>().join(", ");
        let named = |name: &str| fields.iter().find(|(found, _)| found == name).map(|(_, field)| *field);
        let needed = |name: &str| {
            named(name).ok_or_else(|| format!("the cloud has no field `{name}`; it has {}", names()))
        };
        let chosen = |choice: &str, known: &[&str]| match choice {
            "" => Ok(None),
            "auto" => Ok(known.iter().find_map(|name| named(name))),
            name => needed(name).map(Some),
        };
        let has_signal = mapping.intensity_field == "auto"
            && SIGNAL_AND_REFLECTIVITY.iter().all(|name| named(name).is_some());
        let intensity_field =
            if has_signal { SIGNAL_AND_REFLECTIVITY[1] } else { mapping.intensity_field.as_str() };
        let [width, height, point_step, row_step] =
            message.numbers_at("", ["width", "height", "point_step", "row_step"]).map_err(tell)?;
        let cloud = Self {
            width: width as usize,
            height: height as usize,
            point_step: point_step as usize,
            row_step: row_step as usize,
            is_big_endian: message.number("is_bigendian").map_err(tell)? != 0.0,
            data: message.numbers("data").map_err(tell)?,
            xyz: [needed("x")?, needed("y")?, needed("z")?],
            intensity: chosen(intensity_field, &INTENSITY_NAMES)?,
            has_signal,
            ring: chosen(&mapping.ring_field, &RING_NAMES)?,
            time: chosen(&mapping.time_field, &TIME_NAMES)?,
        };
        cloud.check()?;
        Ok(cloud)
    }

    fn check(&self) -> Result<(), String> {
        let Self { width, height, point_step, row_step, .. } = *self;
        let all = self.xyz.into_iter().chain([self.intensity, self.ring, self.time].into_iter().flatten());
        let end = all.map(|field| field.offset.saturating_add(field.number.size())).max().unwrap_or(0);
        if self.is_empty() {
            return Ok(());
        }
        if end > point_step {
            return Err(format!(
                "the cloud's fields end at byte {end} of a point, and a point has {point_step} bytes"
            ));
        }
        if row_step < width.saturating_mul(point_step) && height > 1 {
            return Err(format!(
                "a row of the cloud has {row_step} bytes; {width} points of {point_step} bytes need {}",
                width * point_step
            ));
        }
        let needed = (height - 1).saturating_mul(row_step).saturating_add(width.saturating_mul(point_step));
        let found = self.data.bytes.len();
        if found < needed {
            return Err(format!(
                "the cloud has {found} bytes; {width} x {height} points of {point_step} bytes need {needed}"
            ));
        }
        Ok(())
    }

    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.width == 0 || self.height == 0
    }

    /// The bytes of each point, row by row.
    fn records(&self) -> impl Iterator<Item = &'a [u8]> + '_ {
        let bytes = self.data.bytes;
        (0..self.height).flat_map(move |row| {
            (0..self.width).map(move |column| {
                let begin = row * self.row_step + column * self.point_step;
                &bytes[begin..begin + self.point_step]
            })
        })
    }

    fn read(&self, field: Field, record: &[u8]) -> f64 {
        let bytes = &record[field.offset..field.offset + field.number.size()];
        field.number.read(bytes, self.is_big_endian)
    }

    fn position(&self, record: &[u8]) -> [f64; 3] {
        self.xyz.map(|field| self.read(field, record))
    }

    /// The bytes of the points that are returns: others have stamps of no meaning.
    fn returns(&self) -> impl Iterator<Item = &'a [u8]> + '_ {
        self.records().filter(move |record| {
            let position = self.position(record);
            position.iter().all(|part| part.is_finite()) && position != [0.0; 3]
        })
    }

    /// The points in the order of the message; `stamp_ns` is the sample's time.
    #[must_use]
    pub fn points(&self, habits: &CloudHabits, stamp_ns: u64) -> Vec<RawPoint> {
        let time = self.time.zip(habits.time);
        let earliest = match time {
            Some((field, TimeHabit { origin: TimeOrigin::Unknown, .. })) => {
                self.returns().map(|record| self.read(field, record)).fold(f64::INFINITY, f64::min)
            }
            _ => 0.0,
        };
        let offset_s = |record: &[u8], field: Field, habit: TimeHabit| match habit.origin {
            TimeOrigin::Stamp => self.read(field, record) * habit.unit_s,
            TimeOrigin::Unknown => (self.read(field, record) - earliest) * habit.unit_s,
            TimeOrigin::Epoch => self.read(field, record) * habit.unit_s - stamp_ns as f64 * 1e-9,
        };
        self.records()
            .map(|record| {
                let [x_m, y_m, z_m] = self.position(record).map(|value| value as f32);
                let ring = self.ring.zip(habits.rings).map(|(field, habit)| {
                    let ring = self.read(field, record) as u16;
                    match habit {
                        RingHabit::FromBelow => ring,
                        RingHabit::FromAbove { n_rings } => (n_rings - 1).saturating_sub(ring),
                    }
                });
                RawPoint {
                    x_m,
                    y_m,
                    z_m,
                    intensity: self.intensity.map_or(0.0, |field| self.read(field, record) as f32),
                    ring,
                    time_offset_s: time.map(|(field, habit)| offset_s(record, field, habit) as f32),
                }
            })
            .collect()
    }

    /// How this cloud counts times and rings, and what is to be told of it. `base_from_lidar` tells which way is up.
    #[must_use]
    pub fn habits(
        &self,
        mapping: &LidarMapping,
        base_from_lidar: UnitQuaternion<f64>,
        stamp_ns: u64,
    ) -> (CloudHabits, Vec<String>) {
        let mut told = Vec::new();
        let time = self.time.and_then(|field| self.time_habit(field, mapping.time_unit, stamp_ns, &mut told));
        let rings = self.ring.and_then(|field| self.ring_habit(field, base_from_lidar, &mut told));
        if self.has_signal {
            let [signal, taken] = SIGNAL_AND_REFLECTIVITY;
            told.push(format!(
                "the cloud has the fields `{signal}` and `{taken}`; `{taken}` is taken (lidar.intensity_field)"
            ));
        }
        if self.intensity.is_none() {
            told.push("the cloud has no intensity; 0 stands for all".into());
        }
        (CloudHabits { time, rings }, told)
    }

    fn time_habit(
        &self,
        field: Field,
        unit: TimeUnit,
        stamp_ns: u64,
        told: &mut Vec<String>,
    ) -> Option<TimeHabit> {
        let times = self.returns().map(|record| self.read(field, record)).filter(|time| time.is_finite());
        let (first, last) = times.fold((f64::INFINITY, f64::NEG_INFINITY), |(first, last), time| {
            (first.min(time), last.max(time))
        });
        let span = last - first;
        if !(span > 0.0) {
            told.push(
                "the points' times are all the same, so that the ego's motion within a turn is not compensated".into(),
            );
            return None;
        }
        let is_turn = |unit_s: f64| (TURN_S[0]..=TURN_S[1]).contains(&(span * unit_s));
        let unit_s = match unit {
            TimeUnit::S => 1.0,
            TimeUnit::Ms => 1e-3,
            TimeUnit::Us => 1e-6,
            TimeUnit::Ns => 1e-9,
            TimeUnit::Auto => {
                let Some(unit_s) = [1.0, 1e-3, 1e-6, 1e-9].into_iter().find(|&unit_s| is_turn(unit_s)) else {
                    told.push(format!(
                        "the points' times span {span}, in no unit the length of a turn; they are not used (lidar.time_field, \
                         lidar.time_unit)"
                    ));
                    return None;
                };
                unit_s
            }
        };
        let (first_s, last_s, stamp_s) = (first * unit_s, last * unit_s, stamp_ns as f64 * 1e-9);
        // A stamp on the points' clock lies in the turn or close by; further away, the clocks differ.
        let margin_s = (last_s - first_s) / 2.0;
        let origin = if first_s.abs() <= LONGEST_OFFSET_S && last_s.abs() <= LONGEST_OFFSET_S {
            TimeOrigin::Stamp
        } else if (first_s - margin_s..=last_s + margin_s).contains(&stamp_s) {
            TimeOrigin::Epoch
        } else {
            told.push(format!(
                "the points' times begin {:.3} s from the cloud's stamp, on another clock; the earliest point is taken to \
                 have the stamp", first_s - stamp_s
            ));
            TimeOrigin::Unknown
        };
        Some(TimeHabit { unit_s, origin })
    }

    /// Rings must rise or fall with the elevation of their beams, in the LiDAR's frame, which may be tilted or hang upside down.
    fn ring_habit(
        &self,
        field: Field,
        base_from_lidar: UnitQuaternion<f64>,
        told: &mut Vec<String>,
    ) -> Option<RingHabit> {
        let up = (base_from_lidar * Vector3::z()).z.signum();
        let (mut n, mut sums, mut last_ring) = (0.0, [0.0; 5], 0);
        for record in self.records() {
            let [x, y, z] = self.position(record);
            let (elevation, ring) = (up * z.atan2(x.hypot(y)), self.read(field, record));
            if !elevation.is_finite() || !ring.is_finite() || Vector3::new(x, y, z).norm() < 0.5 {
                continue;
            }
            last_ring = last_ring.max(ring as u16);
            n += 1.0;
            let terms = [elevation, ring, elevation * ring, elevation * elevation, ring * ring];
            sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
        }
        let [elevation, ring, both, elevation2, ring2] = sums.map(|sum: f64| sum / n);
        let correlation = (both - elevation * ring)
            / ((elevation2 - elevation * elevation) * (ring2 - ring * ring)).sqrt().max(1e-12);
        if n < LEAST_POINTS as f64 || correlation > 0.9 {
            return Some(RingHabit::FromBelow);
        }
        if correlation < -0.9 {
            // An organised cloud has a row for each ring, also for those that hit nothing.
            let n_rows = u16::try_from(self.height).unwrap_or(0);
            let n_seen = last_ring.saturating_add(1);
            let n_rings = if (n_seen..=2 * n_seen).contains(&n_rows) { n_rows } else { n_seen };
            told.push(format!(
                "the cloud counts its {n_rings} rings from above; they are counted from below"
            ));
            return Some(RingHabit::FromAbove { n_rings });
        }
        told.push(
            "the cloud's rings do not follow the beams' elevations; rings are computed from these".into(),
        );
        None
    }
}
