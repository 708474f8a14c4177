//! What an import has to tell: one sentence for each thing that was found and is not as it should be, each told once.

use std::collections::BTreeMap;

/// The sentences so far, and how often each was met.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Notes {
    /// In the order of their first occurrence.
    sentences: Vec<String>,
    n_met: BTreeMap<String, usize>,
    n_told: usize,
}

impl Notes {
    /// Takes up a sentence: what was found, what would be right. The same sentence is kept once and counted.
    pub fn tell(&mut self, sentence: impl Into<String>) {
        let sentence = sentence.into();
        let n_met = self.n_met.entry(sentence.clone()).or_insert(0);
        *n_met += 1;
        if *n_met == 1 {
            self.sentences.push(sentence);
        }
    }

    /// All sentences in the order in which they came up, each with its count where it came up more than once.
    pub fn sentences(&self) -> impl Iterator<Item = String> + '_ {
        self.sentences.iter().map(|sentence| match self.n_met[sentence] {
            1 => sentence.clone(),
            n_met => format!("{sentence} ({n_met} times)"),
        })
    }

    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.sentences.is_empty()
    }

    /// Sentences that came up since the last call.
    pub(super) fn take_new(&mut self) -> &[String] {
        let new = &self.sentences[self.n_told..];
        self.n_told = self.sentences.len();
        new
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sentence_is_kept_once_and_counted() {
        let mut notes = Notes::default();
        notes.tell("the cloud is empty");
        notes.tell("3 points are not finite");
        notes.tell("the cloud is empty");
        assert_eq!(notes.take_new().len(), 2);
        assert!(notes.take_new().is_empty());
        let told: Vec<String> = notes.sentences().collect();
        assert_eq!(told, ["the cloud is empty (2 times)", "3 points are not finite"]);
    }
}
