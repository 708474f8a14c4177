//! What `--list` prints: the topics and frames of a bag as comments, and the proposed mapping as TOML under them.
//!
//! The whole text is TOML, so that it can be saved and used as a mapping as it is.

use std::path::Path;

use super::bag::{Bag, BagTopic, seconds};
use super::container::bags_under;
use super::message::stamp_ns;
use super::propose::{Proposal, tf_tree};
use crate::import::ImportError;
use crate::text_table::text_table;

/// The listing of a bag, or of the first of a folder of bags.
///
/// # Errors
/// The bag is damaged or of another container.
pub fn list(path: &Path) -> Result<String, ImportError> {
    let bags = bags_under(path)?;
    let bag = Bag::open(&bags[0])?;
    let tf = tf_tree(&bag)?;
    let mut lines = vec![format!("Topics of the ROS 2 bag {}", bags[0].display()), String::new()];
    if bags.len() > 1 {
        lines.insert(1, format!("the first of {} bags; a mapping holds for all of them", bags.len()));
    }
    lines.extend(topic_table(&bag)?.lines().map(str::to_owned));
    lines.push(String::new());
    lines.push("Frames (tf):".into());
    let edges = tf.edges();
    lines.extend(if edges.is_empty() { vec!["  none".into()] } else { indented(&edges) });
    for topic in bag.topics() {
        if let Err(why) = topic.message_type() {
            lines.push(format!("NOT READ: {why}"));
        }
    }
    let proposal = Proposal::of(&bag, &tf)?;
    let mut text: String =
        lines.iter().map(|line| format!("# {line}").trim_end().to_owned() + "\n").collect();
    text.push_str("\n# The proposed mapping. configs/import/ros2_mapping.toml says what each key means.\n\n");
    text.push_str(&to_toml(&proposal));
    Ok(text)
}

fn indented(lines: &[String]) -> Vec<String> {
    lines.iter().map(|line| format!("  {line}")).collect()
}

fn topic_table(bag: &Bag) -> Result<String, ImportError> {
    let heads = ["topic", "type", "messages", "per second", "frame", "first stamp"];
    let mut rows = vec![heads.map(str::to_owned)];
    for topic in bag.topics() {
        let places = bag.places(topic)?;
        let rate = match (places.first(), places.last()) {
            (Some(first), Some(last)) if last.log_time_ns > first.log_time_ns => {
                let span_s = (last.log_time_ns - first.log_time_ns) as f64 * 1e-9;
                format!("{:.1}", (places.len() - 1) as f64 / span_s)
            }
            _ => "-".into(),
        };
        let (frame, stamp) = first_header(bag, topic)?;
        let n_messages = places.len().to_string();
        rows.push([topic.name.clone(), topic.type_name.clone(), n_messages, rate, frame, stamp]);
    }
    Ok(text_table(rows))
}

/// Frame and stamp of the first message, or what there is instead.
fn first_header(bag: &Bag, topic: &BagTopic) -> Result<(String, String), ImportError> {
    let nothing = || ("-".to_owned(), "-".to_owned());
    let first = bag.places(topic)?.first().copied();
    let Some(first) = first.filter(|_| topic.message_type().is_ok()) else { return Ok(nothing()) };
    let frame = bag.first_frame(topic)?.filter(|frame| !frame.is_empty()).unwrap_or_else(|| "-".into());
    let stamp = bag.read(topic, first, |value| {
        Ok(stamp_ns(value, "header.stamp").map_or_else(|_| "-".into(), seconds))
    })?;
    Ok((frame, stamp))
}

/// The mapping as TOML, each table under its reasons.
fn to_toml(proposal: &Proposal) -> String {
    let mut text = String::new();
    let mapping = toml::to_string(&proposal.mapping).expect("a config always has a TOML form");
    for line in mapping.lines() {
        if let Some(table) = line.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')) {
            for (_, reason) in proposal.reasons.iter().filter(|(of, _)| *of == table) {
                text.push_str(&format!("# {reason}\n"));
            }
        }
        text.push_str(line);
        text.push('\n');
    }
    text
}
