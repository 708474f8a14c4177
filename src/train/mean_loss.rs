//! The mean loss over steps.

use super::losses::LossParts;
use crate::history::StepRow;

/// Running mean of losses.
#[derive(Default)]
pub struct MeanLoss {
    sum: LossParts,
    n: usize,
}

impl MeanLoss {
    /// Of the logged steps of the last one's epoch.
    pub fn of_last_epoch(steps: &[StepRow]) -> Self {
        let mut mean = Self::default();
        let Some(last) = steps.last() else { return mean };
        for row in steps.iter().filter(|row| (&row.stage, row.epoch) == (&last.stage, last.epoch)) {
            let [heatmap, harm, boxes, picture] =
                [row.heatmap, row.harm, row.boxes, row.picture].map(|part| part as f32);
            mean.add(LossParts { heatmap, harm, boxes, picture });
        }
        mean
    }

    pub fn add(&mut self, parts: LossParts) {
        self.sum.heatmap += parts.heatmap;
        self.sum.harm += parts.harm;
        self.sum.boxes += parts.boxes;
        self.sum.picture += parts.picture;
        self.n += 1;
    }

    pub fn mean(&self) -> LossParts {
        let n = self.n.max(1) as f32;
        let LossParts { heatmap, harm, boxes, picture } = self.sum;
        LossParts { heatmap: heatmap / n, harm: harm / n, boxes: boxes / n, picture: picture / n }
    }
}
