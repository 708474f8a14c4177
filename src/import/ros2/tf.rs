//! The tree of frames that `/tf` and `/tf_static` build, and the transform between any two of them at a time.
//!
//! Between two stamps of an edge its translation is interpolated linearly and its rotation along the great circle, as tf2
//! does. Beyond its first and last stamp an edge holds for the tolerance, and no further.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Isometry3;
use thiserror::Error;

use super::bag::seconds;
use super::cdr::{CdrError, Value};
use super::message::{frame_name, isometry_of, stamp_ns};

/// Frames further apart than this many edges are a circle.
const MOST_EDGES: usize = 100;
/// Of a static edge that is said twice, what differs by less is the same: metres and radians.
const SAME: f64 = 1e-3;

/// The edges by the name of the child.
#[derive(Debug, Clone, Default)]
pub struct TfTree {
    edges: BTreeMap<String, Edge>,
    /// Until [`TfTree::finish`]: the edges of children to the parents that they had before.
    others: BTreeMap<String, Vec<Edge>>,
    /// Until then: parent and child of static edges that messages give several values.
    replaced: BTreeSet<(String, String)>,
}

#[derive(Debug, Clone)]
struct Edge {
    parent: String,
    /// Whether it was said once for all times.
    is_static: bool,
    /// Whether all of its transforms are the same: then it holds at all times too.
    is_constant: bool,
    /// In order of time once [`TfTree::finish`] has run.
    stamped: Vec<(u64, Isometry3<f64>)>,
}

/// Why there is no transform.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum TfError {
    #[error("no tf path leads from `{from}` to `{to}`; {tree}")]
    NoPath { from: String, to: String, tree: String },
    #[error("tf `{parent}` -> `{child}` is known from {first} to {last}, not at {wanted}")]
    OutOfTime { parent: String, child: String, first: String, last: String, wanted: String },
}

impl TfTree {
    /// Takes up the transforms of a `tf2_msgs/TFMessage`. `log_time_ns` replaces the stamps if given. Returns how many
    /// were no transforms, such as rotations of length zero.
    ///
    /// # Errors
    /// A field is missing.
    pub fn add_message(
        &mut self,
        message: &Value,
        is_static: bool,
        log_time_ns: Option<u64>,
    ) -> Result<usize, CdrError> {
        let mut n_invalid = 0;
        for transform in message.list("transforms")? {
            let parent = transform.text("header.frame_id")?;
            let child = transform.text("child_frame_id")?;
            let stamp_ns = log_time_ns.map_or_else(|| stamp_ns(&transform, "header.stamp"), Ok)?;
            match isometry_of(&transform, "transform.translation", "transform.rotation")? {
                Some(isometry) => {
                    if is_static && self.is_other_static(parent, child, &isometry) {
                        self.replaced.insert((frame_name(parent).to_owned(), frame_name(child).to_owned()));
                    }
                    self.add(parent, child, is_static, stamp_ns, isometry);
                }
                None => n_invalid += 1,
            }
        }
        Ok(n_invalid)
    }

    /// Whether a static edge is known with another value.
    fn is_other_static(&self, parent: &str, child: &str, parent_from_child: &Isometry3<f64>) -> bool {
        let known = self.edges.get(frame_name(child));
        let known = known.filter(|edge| edge.is_static && edge.parent == frame_name(parent));
        known.and_then(|edge| edge.stamped.last()).is_some_and(|(_, known)| {
            let moved = known.inverse() * parent_from_child;
            moved.translation.vector.norm() > SAME || moved.rotation.angle() > SAME
        })
    }

    /// Takes up one transform: coordinates in `child` to coordinates in `parent`. A static one replaces what was.
    pub fn add(
        &mut self,
        parent: &str,
        child: &str,
        is_static: bool,
        stamp_ns: u64,
        parent_from_child: Isometry3<f64>,
    ) {
        let (parent, child) = (frame_name(parent).to_owned(), frame_name(child).to_owned());
        let new = || Edge { parent: parent.clone(), is_static, is_constant: is_static, stamped: Vec::new() };
        let edge = self.edges.entry(child.clone()).or_insert_with(new);
        if edge.parent != parent {
            let others = self.others.entry(child).or_default();
            let known = others.iter().position(|other| other.parent == parent);
            let known = known.map_or_else(new, |i| others.swap_remove(i));
            others.push(std::mem::replace(edge, known));
        }
        if is_static {
            *edge = new();
        }
        edge.stamped.push((stamp_ns, parent_from_child));
    }

    /// Sorts the stamps. An edge that never changes holds at all times. Of several parents of a child the one said last holds if it is
    /// static, else `fixed` if it is one of them, else the one with the most stamps. Returns a sentence for each such child, and for each
    /// static edge that messages give several values.
    #[must_use]
    pub fn finish(&mut self, fixed: &str) -> Vec<String> {
        let tell = |(parent, child): (String, String)| {
            format!("tf_static gives `{parent}` -> `{child}` several values; the last one holds at all times")
        };
        let mut told: Vec<String> = std::mem::take(&mut self.replaced).into_iter().map(tell).collect();
        for (child, others) in std::mem::take(&mut self.others) {
            let Some(last) = self.edges.remove(&child) else { continue };
            let mut parents = vec![last];
            parents.extend(others);
            let weight = |(i, edge): &(usize, &Edge)| {
                let is_last_word = *i == 0 && edge.is_static;
                let is_wanted = !fixed.is_empty() && edge.parent == fixed;
                // Of equals the one said last.
                (is_last_word, is_wanted, edge.stamped.len(), std::cmp::Reverse(*i))
            };
            let best = parents.iter().enumerate().max_by_key(weight).map_or(0, |(i, _)| i);
            let rest: Vec<String> = parents.iter().map(|edge| format!("`{}`", edge.parent)).collect();
            told.push(format!(
                "tf gives the frame `{child}` several parents ({}); only the one of `{}` is used",
                rest.join(", "),
                parents[best].parent
            ));
            self.edges.insert(child, parents.swap_remove(best));
        }
        for edge in self.edges.values_mut() {
            edge.stamped.sort_by_key(|(stamp_ns, _)| *stamp_ns);
            edge.stamped.dedup_by_key(|(stamp_ns, _)| *stamp_ns);
            let first = edge.stamped[0].1;
            edge.is_constant = edge.stamped.iter().all(|(_, isometry)| *isometry == first);
        }
        told
    }

    #[must_use]
    pub fn has(&self, frame: &str) -> bool {
        self.edges.iter().any(|(child, edge)| child == frame || edge.parent == frame)
    }

    /// All frames.
    #[must_use]
    pub fn frames(&self) -> Vec<String> {
        let mut frames: Vec<String> =
            self.edges.iter().flat_map(|(child, edge)| [child.clone(), edge.parent.clone()]).collect();
        frames.sort();
        frames.dedup();
        frames
    }

    /// The edges as lines for people: `odom -> base_link (100 stamps)`.
    #[must_use]
    pub fn edges(&self) -> Vec<String> {
        let tell = |(child, edge): (&String, &Edge)| {
            let rate =
                if edge.is_static { "static".into() } else { format!("{} stamps", edge.stamped.len()) };
            format!("{} -> {child} ({rate})", edge.parent)
        };
        self.edges.iter().map(tell).collect()
    }

    /// The edges from a frame up to its root, each with the child's name.
    fn chain(&self, frame: &str) -> Vec<(&str, &Edge)> {
        let mut chain: Vec<(&str, &Edge)> = Vec::new();
        let mut here = frame;
        while let Some((child, edge)) = self.edges.get_key_value(here) {
            if chain.len() == MOST_EDGES {
                break;
            }
            chain.push((child, edge));
            here = &edge.parent;
        }
        chain
    }

    /// The topmost frame above a frame.
    #[must_use]
    pub fn root(&self, frame: &str) -> String {
        self.chain(frame).last().map_or(frame, |(_, edge)| &edge.parent).to_owned()
    }

    /// The edges between two frames, upwards from each to where they meet; `None` where they do not.
    #[allow(clippy::type_complexity, reason = "two chains")]
    fn path(&self, to: &str, from: &str) -> Option<(Vec<(&str, &Edge)>, Vec<(&str, &Edge)>)> {
        let (mut of_to, mut of_from) = (self.chain(to), self.chain(from));
        let top = |chain: &[(&str, &Edge)], frame: &str| {
            chain.last().map_or_else(|| frame.to_owned(), |(_, edge)| edge.parent.clone())
        };
        if top(&of_to, to) != top(&of_from, from) {
            return None;
        }
        // What both have at the top they have in common.
        while let (Some((a, _)), Some((b, _))) = (of_to.last(), of_from.last()) {
            if a != b {
                break;
            }
            of_to.pop();
            of_from.pop();
        }
        Some((of_to, of_from))
    }

    #[must_use]
    pub fn connects(&self, to: &str, from: &str) -> bool {
        to == from || self.path(to, from).is_some()
    }

    /// The transform from coordinates in `from` to coordinates in `to`.
    ///
    /// # Errors
    /// The frames are not connected, or an edge between them is not known at that time.
    pub fn lookup(
        &self,
        to: &str,
        from: &str,
        time_ns: u64,
        tolerance_ns: u64,
    ) -> Result<Isometry3<f64>, TfError> {
        let Some((of_to, of_from)) = self.path(to, from) else {
            if to == from {
                return Ok(Isometry3::identity());
            }
            return Err(TfError::NoPath { from: from.into(), to: to.into(), tree: self.describe() });
        };
        let climb = |chain: &[(&str, &Edge)]| -> Result<Isometry3<f64>, TfError> {
            chain.iter().try_fold(Isometry3::identity(), |top_from_frame, (child, edge)| {
                Ok(edge.at(child, time_ns, tolerance_ns)? * top_from_frame)
            })
        };
        Ok(climb(&of_to)?.inverse() * climb(&of_from)?)
    }

    /// The stamps of the most frequent edge between two frames that is not said once for all times; empty without one.
    #[must_use]
    pub fn stamps_between(&self, to: &str, from: &str) -> Vec<u64> {
        let Some((of_to, of_from)) = self.path(to, from) else { return Vec::new() };
        let moving = of_to.iter().chain(&of_from).filter(|(_, edge)| !edge.is_static);
        let densest = moving.max_by_key(|(_, edge)| edge.stamped.len());
        densest
            .map(|(_, edge)| edge.stamped.iter().map(|(stamp_ns, _)| *stamp_ns).collect())
            .unwrap_or_default()
    }

    fn describe(&self) -> String {
        if self.edges.is_empty() {
            return "the bag has no tf at all".into();
        }
        format!("the frames are {}; the edges are {}", self.frames().join(", "), self.edges().join(", "))
    }
}

impl Edge {
    fn at(&self, child: &str, time_ns: u64, tolerance_ns: u64) -> Result<Isometry3<f64>, TfError> {
        let (first, last) = (&self.stamped[0], &self.stamped[self.stamped.len() - 1]);
        if self.is_constant {
            return Ok(last.1);
        }
        if time_ns.saturating_add(tolerance_ns) < first.0 || time_ns > last.0.saturating_add(tolerance_ns) {
            return Err(TfError::OutOfTime {
                parent: self.parent.clone(),
                child: child.to_owned(),
                first: seconds(first.0),
                last: seconds(last.0),
                wanted: seconds(time_ns),
            });
        }
        let after = self.stamped.partition_point(|(stamp_ns, _)| *stamp_ns < time_ns);
        if after == 0 || after == self.stamped.len() {
            return Ok(if after == 0 { first.1 } else { last.1 });
        }
        let ((before_ns, before), (after_ns, after)) = (&self.stamped[after - 1], &self.stamped[after]);
        let share = (time_ns - before_ns) as f64 / (after_ns - before_ns) as f64;
        Ok(interpolate(before, after, share))
    }
}

fn interpolate(before: &Isometry3<f64>, after: &Isometry3<f64>, share: f64) -> Isometry3<f64> {
    let translation = before.translation.vector.lerp(&after.translation.vector, share);
    let rotation = before.rotation.try_slerp(&after.rotation, share, 1e-12).unwrap_or(before.rotation);
    Isometry3::from_parts(translation.into(), rotation)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    fn tree() -> TfTree {
        let mut tree = TfTree::default();
        let yaw = |x: f64, yaw: f64| Isometry3::new(Vector3::new(x, 0.0, 0.0), Vector3::z() * yaw);
        tree.add("odom", "base_link", false, 2_000_000_000, yaw(10.0, 0.2));
        tree.add("odom", "base_link", false, 1_000_000_000, yaw(0.0, 0.0));
        tree.add("/base_link", "/lidar", true, 0, yaw(1.0, 0.0));
        tree.add("base_link", "camera", true, 0, yaw(2.0, 0.0));
        assert!(tree.finish("odom").is_empty());
        tree
    }

    #[test]
    fn two_publishers_of_a_frames_parent_do_not_erase_each_other() {
        let two = || {
            let mut tree = TfTree::default();
            let at = |x: f64| Isometry3::translation(x, 0.0, 0.0);
            for i in 0..10_u64 {
                tree.add("odom", "base_link", false, i * 100, at(i as f64));
                if i % 3 == 0 {
                    tree.add("map", "base_link", false, i * 100 + 5, at(100.0 + i as f64));
                }
            }
            tree
        };
        let mut tree = two();
        let told = tree.finish("");
        assert!(
            matches!(&told[..], [told] if told.contains("`base_link`") && told.contains("of `odom`")),
            "{told:?}"
        );
        assert_eq!(tree.stamps_between("odom", "base_link").len(), 10);
        assert_eq!(tree.lookup("odom", "base_link", 450, 0).unwrap().translation.x, 4.5);
        let mut tree = two();
        assert_eq!(tree.finish("map").len(), 1);
        assert_eq!(tree.stamps_between("map", "base_link"), [5, 305, 605, 905]);
        // What is said once for all times at the end, as by a mapping, holds.
        let mut tree = two();
        tree.add("rig", "base_link", true, 0, Isometry3::identity());
        assert_eq!(tree.finish("map").len(), 1);
        assert!(tree.connects("rig", "base_link") && !tree.connects("map", "base_link"));
    }

    #[test]
    fn a_static_edge_of_two_values_is_told_and_one_said_twice_is_not() {
        let numbers = |names: &[&'static str], values: &[f64]| {
            let fields = names.iter().zip(values).map(|(name, value)| (*name, Value::Number(*value)));
            Value::Struct(fields.collect())
        };
        let message = |x: f64| {
            let stamp = numbers(&["sec", "nanosec"], &[1.0, 0.0]);
            let transform = Value::Struct(vec![
                ("translation", numbers(&["x", "y", "z"], &[x, 0.0, 0.0])),
                ("rotation", numbers(&["x", "y", "z", "w"], &[0.0, 0.0, 0.0, 1.0])),
            ]);
            let edge = Value::Struct(vec![
                ("header", Value::Struct(vec![("stamp", stamp), ("frame_id", Value::Text("base_link"))])),
                ("child_frame_id", Value::Text("lidar")),
                ("transform", transform),
            ]);
            Value::Struct(vec![("transforms", Value::List(vec![edge]))])
        };
        let told = |places: [f64; 2]| {
            let mut tree = TfTree::default();
            for x in places {
                assert_eq!(tree.add_message(&message(x), true, None), Ok(0));
            }
            tree.finish("")
        };
        assert!(told([1.2, 1.2]).is_empty());
        let other = told([1.2, 0.7]);
        assert!(matches!(&other[..], [told] if told.contains("`base_link` -> `lidar`")), "{other:?}");
    }

    #[test]
    fn a_transform_is_interpolated_between_its_stamps() {
        let at = tree().lookup("odom", "lidar", 1_500_000_000, 0).unwrap();
        assert!((at.translation.x - (5.0 + 0.1f64.cos())).abs() < 1e-12);
        assert!((at.rotation.euler_angles().2 - 0.1).abs() < 1e-12);
    }

    #[test]
    fn siblings_meet_at_their_parent_at_any_time() {
        let lidar_from_camera = tree().lookup("lidar", "camera", 99, 0).unwrap();
        assert_eq!(lidar_from_camera.translation.x, 1.0);
    }

    #[test]
    fn a_missing_path_tells_the_tree_and_a_late_time_the_span() {
        let told = tree().lookup("base_link", "gps", 0, 0).unwrap_err().to_string();
        assert!(
            told.contains("`gps` to `base_link`") && told.contains("odom -> base_link (2 stamps)"),
            "{told}"
        );
        assert!(tree().lookup("odom", "base_link", 2_040_000_000, 50_000_000).is_ok());
        let told = tree().lookup("odom", "base_link", 2_060_000_000, 50_000_000).unwrap_err().to_string();
        assert!(told.contains("from 1.000000000 s to 2.000000000 s, not at 2.060000000 s"), "{told}");
    }
}
