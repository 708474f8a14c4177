//! The checks by name, what each finds in one place, and what its findings come to.

use std::collections::BTreeMap;

use super::{CheckVerdict, Severity, Symptom};

/// The checks, in the order of their verdicts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Aspect {
    Manifest,
    Config,
    Files,
    Hashes,
    Checksums,
    Schemas,
    Entries,
    Times,
    Ids,
    Boxes,
    Points,
    Clouds,
    Pictures,
    Camera,
    Rig,
    Motion,
    Labels,
    Statistics,
}

impl Aspect {
    pub(super) const ALL: [Self; 18] = [
        Self::Manifest,
        Self::Config,
        Self::Files,
        Self::Hashes,
        Self::Checksums,
        Self::Schemas,
        Self::Entries,
        Self::Times,
        Self::Ids,
        Self::Boxes,
        Self::Points,
        Self::Clouds,
        Self::Pictures,
        Self::Camera,
        Self::Rig,
        Self::Motion,
        Self::Labels,
        Self::Statistics,
    ];

    /// The check's name in verdicts.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Manifest => "manifest",
            Self::Config => "config",
            Self::Files => "files",
            Self::Hashes => "hashes",
            Self::Checksums => "crcs",
            Self::Schemas => "schemas",
            Self::Entries => "entries",
            Self::Times => "times",
            Self::Ids => "ids",
            Self::Boxes => "boxes",
            Self::Points => "points",
            Self::Clouds => "clouds",
            Self::Pictures => "pictures",
            Self::Camera => "camera",
            Self::Rig => "rig",
            Self::Motion => "motion",
            Self::Labels => "labels",
            Self::Statistics => "statistics",
        }
    }
}

/// What was found in one place. Places of one kind are counted together.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Remark {
    pub severity: Severity,
    pub aspect: Aspect,
    pub kind: &'static str,
    pub text: String,
}

impl Remark {
    pub(super) fn warning(aspect: Aspect, kind: &'static str, text: impl Into<String>) -> Self {
        Self { severity: Severity::Warning, aspect, kind, text: text.into() }
    }

    pub(super) fn fault(aspect: Aspect, kind: &'static str, text: impl Into<String>) -> Self {
        Self { severity: Severity::Fault, aspect, kind, text: text.into() }
    }

    /// A fault, unless there may be a reason for it: in a log, whose car and maker are not ours.
    pub(super) fn unless(may_be: bool, aspect: Aspect, kind: &'static str, text: impl Into<String>) -> Self {
        let severity = if may_be { Severity::Warning } else { Severity::Fault };
        Self { severity, aspect, kind, text: text.into() }
    }
}

/// Symptoms, the places of each kind counted together.
#[derive(Default)]
pub(super) struct Found {
    symptoms: Vec<(Aspect, Symptom)>,
    /// Where each kind stands among them.
    by_kind: BTreeMap<(Aspect, &'static str, Severity), usize>,
}

impl Found {
    pub(super) fn add(&mut self, at: &str, remark: Remark) {
        let Remark { severity, aspect, kind, text } = remark;
        if let Some(&idx) = self.by_kind.get(&(aspect, kind, severity)) {
            self.symptoms[idx].1.n_places += 1;
            return;
        }
        self.by_kind.insert((aspect, kind, severity), self.symptoms.len());
        let (check, first_at) = (aspect.name(), at.to_owned());
        self.symptoms.push((aspect, Symptom { severity, check, first_at, n_places: 1, text }));
    }

    /// A verdict for each check, with what it looked at, and the symptoms, faults first.
    pub(super) fn finish(self, figures: impl Fn(Aspect) -> String) -> (Vec<CheckVerdict>, Vec<Symptom>) {
        let verdict = |aspect: Aspect| {
            let of_check = self.symptoms.iter().filter(|(of, _)| *of == aspect);
            let worst = of_check.map(|(_, symptom)| symptom.severity).min();
            let verdict = worst.map_or("ok", Severity::name);
            CheckVerdict { check: aspect.name(), verdict, figures: figures(aspect) }
        };
        let verdicts = Aspect::ALL.into_iter().map(verdict).collect();
        let mut symptoms: Vec<Symptom> = self.symptoms.into_iter().map(|(_, symptom)| symptom).collect();
        symptoms.sort_by_key(|symptom| symptom.severity);
        (verdicts, symptoms)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_of_one_kind_are_one_symptom_and_a_fault_outweighs_warnings() {
        let mut found = Found::default();
        for i in 0..3 {
            let text = format!("text {i}");
            found.add(&format!("e/{i}"), Remark::warning(Aspect::Clouds, "empty", text));
        }
        found.add("e/9", Remark::fault(Aspect::Clouds, "unit", "broken"));
        let (verdicts, symptoms) = found.finish(|_| String::new());
        assert_eq!(symptoms.len(), 2);
        assert_eq!((symptoms[0].text.as_str(), symptoms[0].n_places), ("broken", 1));
        assert_eq!((symptoms[1].text.as_str(), symptoms[1].n_places), ("text 0", 3));
        let of = |name: &str| verdicts.iter().find(|of| of.check == name).map(|of| of.verdict);
        assert_eq!((of("clouds"), of("hashes")), (Some("fault"), Some("ok")));
    }
}
