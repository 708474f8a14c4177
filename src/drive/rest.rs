//! How long the ego has stood for perception's sake, and whether for something.

use crate::generate::CONTROL_PERIOD_S;
use crate::outcome::End;

/// The ego at a control step.
#[derive(Debug, Clone, Copy)]
pub(super) struct AtRest {
    pub stands: bool,
    /// Whether perception orders it to brake.
    pub is_ordered: bool,
    /// Whether it stands at the line of a light or a junction that does not let it through: there any car would.
    pub waits_at_line: bool,
    /// Whether there is anything to stand for.
    pub is_harmed: bool,
    /// Whether all of that moves by itself, and may go away.
    pub all_move: bool,
}

/// How long it has stood for one thing, or for nothing, throughout.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct TimeAtRest {
    stands_s: f64,
    is_harmed: bool,
}

impl TimeAtRest {
    /// Takes one control step; tells how the drive ended, if it has stood for so long.
    pub fn after(&mut self, now: AtRest, standing_s: f64) -> Option<End> {
        let waits = now.waits_at_line || (now.is_harmed && now.all_move);
        let goes_on = now.stands && now.is_ordered && !waits && now.is_harmed == self.is_harmed;
        self.is_harmed = now.is_harmed;
        self.stands_s = if goes_on { self.stands_s + CONTROL_PERIOD_S } else { 0.0 };
        let end = if now.is_harmed { End::Stopped } else { End::Stuck };
        (self.stands_s >= standing_s).then_some(end)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FOR_NOTHING: AtRest =
        AtRest { stands: true, is_ordered: true, waits_at_line: false, is_harmed: false, all_move: true };

    /// The step, counted from one, at which a drive ends that stands in these ways for so many steps each; four seconds are 80.
    fn end(ways: &[(AtRest, u32)]) -> Option<(u32, End)> {
        let (mut rest, mut step) = (TimeAtRest::default(), 0);
        for &(now, n_steps) in ways {
            for _ in 0..n_steps {
                step += 1;
                if let Some(end) = rest.after(now, 4.0 - 1e-9) {
                    return Some((step, end));
                }
            }
        }
        None
    }

    #[test]
    fn who_stands_for_nothing_is_stuck_and_who_stands_for_something_has_stopped() {
        assert_eq!(end(&[(FOR_NOTHING, 100)]), Some((80, End::Stuck)));
        let harmed = AtRest { is_harmed: true, all_move: false, ..FOR_NOTHING };
        // The first step is the last of what was before.
        assert_eq!(end(&[(harmed, 100)]), Some((81, End::Stopped)));
        assert_eq!(end(&[(FOR_NOTHING, 79), (harmed, 80)]), None);
    }

    #[test]
    fn a_wait_at_a_line_for_movers_or_without_an_order_does_not_count() {
        let at_line = AtRest { waits_at_line: true, ..FOR_NOTHING };
        let at_line_harmed = AtRest { is_harmed: true, all_move: false, ..at_line };
        let for_movers = AtRest { is_harmed: true, ..FOR_NOTHING };
        let free = AtRest { is_ordered: false, ..FOR_NOTHING };
        let moving = AtRest { stands: false, ..FOR_NOTHING };
        for waits in [at_line, at_line_harmed, for_movers, free, moving] {
            assert_eq!(end(&[(waits, 1000)]), None, "{waits:?}");
        }
        // Green, and it still stands for nothing.
        assert_eq!(end(&[(at_line, 400), (FOR_NOTHING, 100)]), Some((480, End::Stuck)));
    }
}
