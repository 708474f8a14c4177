//! What was looked at, counted: the figures of the verdicts.

use std::collections::BTreeSet;

use super::check::Aspect;

/// Sums over the episodes that were read.
#[derive(Debug, Clone, Default)]
pub(super) struct Tally {
    /// Files whose content hash is the one that is told.
    pub n_hashed: u64,
    pub n_archives: u64,
    pub n_bytes: u64,
    pub n_records: u64,
    pub n_opened: u64,
    /// Episodes of which every sample was read.
    pub n_whole: u64,
    pub n_samples: u64,
    pub n_objects: u64,
    pub n_ids: u64,
    pub farthest_m: f64,
    pub fastest_mps: f64,
    /// Objects whose points were counted.
    pub n_counted: u64,
    pub n_points: u64,
    /// Points between the left and the right edge of the picture, and those of them that are in it.
    pub n_across: u64,
    pub n_inside: u64,
    pub picture_sizes: BTreeSet<(u32, u32)>,
    /// Calibrations that differ.
    pub n_rigs: u64,
    /// Episodes in which poses and states were set side by side.
    pub n_driven: u64,
    pub n_label_files: u64,
    pub n_labels: u64,
}

impl Tally {
    pub(super) fn add(&mut self, other: &Self) {
        self.n_hashed += other.n_hashed;
        self.n_archives += other.n_archives;
        self.n_bytes += other.n_bytes;
        self.n_records += other.n_records;
        self.n_opened += other.n_opened;
        self.n_whole += other.n_whole;
        self.n_samples += other.n_samples;
        self.n_objects += other.n_objects;
        self.n_ids += other.n_ids;
        self.farthest_m = self.farthest_m.max(other.farthest_m);
        self.fastest_mps = self.fastest_mps.max(other.fastest_mps);
        self.n_counted += other.n_counted;
        self.n_points += other.n_points;
        self.n_across += other.n_across;
        self.n_inside += other.n_inside;
        self.picture_sizes.extend(&other.picture_sizes);
        self.n_rigs += other.n_rigs;
        self.n_driven += other.n_driven;
        self.n_label_files += other.n_label_files;
        self.n_labels += other.n_labels;
    }

    /// What a check looked at. What only the folder tells (manifest, config, files, statistics) is said elsewhere.
    pub(super) fn figures(&self, aspect: Aspect) -> String {
        let percent = |part: u64, of: u64| 100.0 * part as f64 / of.max(1) as f64;
        match aspect {
            Aspect::Hashes => format!("{} files are as their manifests say", self.n_hashed),
            Aspect::Checksums => format!(
                "{} files read whole: {} records, {:.1} MB",
                self.n_archives,
                self.n_records,
                self.n_bytes as f64 * 1e-6
            ),
            Aspect::Schemas => {
                format!("{} episodes and {} label files opened", self.n_opened, self.n_label_files)
            }
            Aspect::Entries => {
                format!("{} episodes set beside dataset.json: {} samples", self.n_whole, self.n_samples)
            }
            Aspect::Times => format!("{} samples", self.n_samples),
            Aspect::Ids => format!("{} ids of {} boxes", self.n_ids, self.n_objects),
            Aspect::Boxes => format!(
                "{} boxes, up to {:.1} m away and {:.1} m/s fast",
                self.n_objects, self.farthest_m, self.fastest_mps
            ),
            Aspect::Points => format!("the points of {} boxes counted", self.n_counted),
            Aspect::Clouds => {
                let mean = self.n_points as f64 / self.n_samples.max(1) as f64;
                format!("{} clouds of {mean:.0} points in the mean", self.n_samples)
            }
            Aspect::Pictures => {
                let sizes: Vec<String> =
                    self.picture_sizes.iter().map(|(width, height)| format!("{width} x {height}")).collect();
                format!("{} pictures unpacked ({})", self.n_samples, sizes.join(", "))
            }
            Aspect::Camera => format!(
                "{:.1}% of the points lie across the picture, {:.1}% of those in it",
                percent(self.n_across, self.n_points),
                percent(self.n_inside, self.n_across)
            ),
            Aspect::Rig => format!("{} calibrations in {} episodes", self.n_rigs, self.n_whole),
            Aspect::Motion => format!("poses and states of {} episodes set side by side", self.n_driven),
            Aspect::Labels => format!("{} labels set beside their objects", self.n_labels),
            Aspect::Manifest | Aspect::Config | Aspect::Files | Aspect::Statistics => String::new(),
        }
    }
}
