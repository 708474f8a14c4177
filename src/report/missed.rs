//! Harm that was missed at fixed false alarms, with which every table of results begins.

use super::table::{Cell, Table, percent};
use crate::eval::safety::{Alarms, OperatingPoint};

/// A set's name and its figures.
pub type NamedAlarms<'a> = (&'a str, &'a Alarms);

/// The point in the middle of those asked for, by which rows are compared: 10 false alarms a kilometre by default.
#[must_use]
pub fn middle(alarms: &Alarms) -> Option<&OperatingPoint> {
    alarms.points.get(alarms.points.len() / 2)
}

/// A share of some number, with its interval.
fn share(value: Option<f64>, of: usize, interval: Option<[f64; 2]>) -> Cell {
    Cell { text: percent(value), below: ends(interval).into_iter().chain([format!("of {of}")]).collect() }
}

/// The ends of a share's interval, in percent.
fn ends(interval: Option<[f64; 2]>) -> Option<String> {
    interval.map(|[low, high]| format!("{:.1}–{:.1}", 100.0 * low, 100.0 * high))
}

/// Missed harm and warnings in time at each number of false alarms; `None` where nothing is known of any set.
#[must_use]
pub fn table(sets: &[NamedAlarms<'_>]) -> Option<Table> {
    let points: Vec<(&str, &OperatingPoint)> =
        sets.iter().flat_map(|&(name, of)| of.points.iter().map(move |point| (name, point))).collect();
    if points.is_empty() {
        return None;
    }
    let warned = points.iter().flat_map(|(_, point)| &point.warned);
    let mut decelerations: Vec<f64> = warned.map(|of| of.deceleration_mps2).collect();
    decelerations.sort_by(f64::total_cmp);
    decelerations.dedup();
    let row = |&(name, point): &(&str, &OperatingPoint)| {
        let at = format!("at {} false alarms/km", point.max_false_alarms_per_km);
        let name = if sets.len() > 1 { format!("{name}, {at}") } else { at };
        let missed = [
            share(point.missed_per_event, point.n_events, point.missed_per_event_interval),
            share(point.missed_per_sample, point.n_harmful, point.missed_per_sample_interval),
        ];
        let warned = decelerations.iter().map(|&deceleration_mps2| {
            let of = point.warned.iter().find(|of| of.deceleration_mps2 == deceleration_mps2);
            of.map_or_else(|| "–".into(), |of| share(of.in_time, of.n_stoppable, of.in_time_interval))
        });
        std::iter::once(Cell::from(name)).chain(missed).chain(warned).collect()
    };
    let rows = points.iter().map(row).collect();
    let head = ["harm missed", "harmful events", "harmful objects"].map(str::to_owned).into_iter();
    let warned = decelerations.iter().map(|of| format!("warned in time, {of} m/s²"));
    let note = "Lower is better; of warnings, higher. docs/evaluation.md, Safety, says what is counted.";
    Some(Table::new(head.chain(warned), rows).with_note(note))
}

/// The same by family of a set's unfamiliar objects; `None` where there are none.
#[must_use]
pub fn by_family((name, alarms): NamedAlarms<'_>) -> Option<Table> {
    let groups: Vec<_> =
        alarms.groups.iter().filter(|group| !["id", "ood"].contains(&group.name.as_str())).collect();
    if groups.is_empty() {
        return None;
    }
    let rows = groups.into_iter().map(|group| {
        let missed = group.shares().map(|[events, objects]| {
            let of_objects = format!("{} of objects", percent(objects.value));
            Cell {
                text: percent(events.value),
                below: ends(events.interval).into_iter().chain([of_objects]).collect(),
            }
        });
        let counts = [group.n_events, group.n_harmful].map(|n| n.to_string().into());
        std::iter::once(group.name.replace('_', " ").into()).chain(counts).chain(missed).collect()
    });
    let at = alarms
        .points
        .iter()
        .map(|point| format!("missed at {} false alarms/km", point.max_false_alarms_per_km));
    let head =
        [format!("{name}: harm missed"), "events".to_owned(), "objects".to_owned()].into_iter().chain(at);
    let note = "Intervals by a bootstrap over the clips: of few events, or where all or none are missed, they say too little.";
    Some(Table::new(head, rows.collect()).with_note(note))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::results::test_data::test_alarms;

    #[test]
    fn sets_are_named_where_there_are_several_and_families_stand_apart() {
        let alarms = test_alarms();
        let both = table(&[("ID", &alarms), ("OOD", &alarms)]).unwrap();
        assert_eq!((both.rows.len(), both.rows[3][0].text.as_str()), (4, "OOD, at 10 false alarms/km"));
        assert_eq!(both.rows[0][1].to_string(), "30.0 % (25.0–35.0, of 20)");
        assert_eq!(both.head[3], "warned in time, 8 m/s²");
        assert_eq!(table(&[("ID", &alarms)]).unwrap().rows[1][0].text, "at 10 false alarms/km");
        let families = by_family(("OOD", &alarms)).unwrap();
        assert_eq!((families.rows.len(), families.rows[0][0].text.as_str()), (1, "hay bale"));
        assert_eq!(families.rows[0][3].to_string(), "25.0 % (12.5–50.0, 50.0 % of objects)");
        assert_eq!(middle(&alarms).unwrap().max_false_alarms_per_km, 10.0);
        let none = Alarms { points: vec![], groups: vec![], ..alarms };
        assert!(
            table(&[("ID", &none)]).is_none()
                && by_family(("OOD", &none)).is_none()
                && middle(&none).is_none()
        );
    }
}
