//! What an import has to tell: one sentence for each thing that was found and is not as it should be, each told once.

use std::collections::BTreeMap;

/// The sentences so far, and how often each was met.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Notes {
    /// In the order of their first occurrence.
    sentences: Vec<String>,
    n_met: BTreeMap<String, usize>,
    /// Of sentences about a share of something: how many of how many.
    shares: BTreeMap<String, (usize, usize)>,
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

    /// Takes up a sentence about `n` of `of_all`: `points are not finite`. Shares of the same sentence are added up.
    pub fn tell_share(&mut self, n: usize, of_all: usize, sentence: &str) {
        if !self.shares.contains_key(sentence) {
            self.sentences.push(sentence.to_owned());
        }
        let share = self.shares.entry(sentence.to_owned()).or_default();
        *share = (share.0 + n, share.1 + of_all);
    }

    /// All sentences in the order in which they came up, each with its count where it came up more than once.
    pub fn sentences(&self) -> impl Iterator<Item = String> + '_ {
        self.sentences.iter().map(|sentence| self.in_full(sentence))
    }

    fn in_full(&self, sentence: &str) -> String {
        match (self.shares.get(sentence), self.n_met.get(sentence)) {
            (Some((n, of_all)), _) => format!("{n} of {of_all} {sentence}"),
            (None, Some(n_met)) if *n_met > 1 => format!("{sentence} ({n_met} times)"),
            _ => sentence.to_owned(),
        }
    }

    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.sentences.is_empty()
    }

    /// Sentences that came up since the last call.
    pub(super) fn take_new(&mut self) -> Vec<String> {
        let new = self.sentences[self.n_told..].iter().map(|sentence| self.in_full(sentence)).collect();
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
        notes.tell_share(3, 10, "points are black");
        notes.tell_share(1, 20, "points are black");
        assert_eq!(notes.take_new(), ["4 of 30 points are black"]);
    }
}
