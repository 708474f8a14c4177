//! Smooth functions as tables, for values that every pixel of a picture needs.

/// A function of one number, by linear interpolation between evenly spaced values; constant outside.
#[derive(Debug, Clone)]
pub(super) struct Table {
    first: f32,
    steps_per_unit: f32,
    values: Vec<f32>,
}

impl Table {
    /// Tabulates `f` from `first` to `last` in `n` steps.
    pub(super) fn new(first: f32, last: f32, n: usize, f: impl Fn(f32) -> f32) -> Self {
        let step = (last - first) / n as f32;
        let values = (0..=n).map(|i| f(first + step * i as f32)).collect();
        Self { first, steps_per_unit: step.recip(), values }
    }

    pub(super) fn at(&self, x: f32) -> f32 {
        let place = ((x - self.first) * self.steps_per_unit).clamp(0.0, (self.values.len() - 1) as f32);
        let below = (place as usize).min(self.values.len() - 2);
        let (low, high) = (self.values[below], self.values[below + 1]);
        low + (high - low) * (place - below as f32)
    }
}

/// The sine to 2e-3, from a table that a turn fills.
#[derive(Debug, Clone)]
pub(super) struct Sine(Vec<f32>);

impl Sine {
    const N: usize = 4096;

    pub(super) fn new() -> Self {
        Self((0..Self::N).map(|i| (i as f32 / Self::N as f32 * std::f32::consts::TAU).sin()).collect())
    }

    pub(super) fn of(&self, angle_rad: f32) -> f32 {
        let step = (angle_rad * (Self::N as f32 / std::f32::consts::TAU)).floor() as i32;
        self.0[(step & (Self::N as i32 - 1)) as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_is_near_its_function_and_constant_outside() {
        let table = Table::new(0.0, 4.0, 512, |x| (-x).exp());
        for i in 0..400 {
            let x = i as f32 * 0.01;
            assert!((table.at(x) - (-x).exp()).abs() < 1e-5);
        }
        assert_eq!((table.at(-1.0), table.at(9.0)), (1.0, (-4f32).exp()));
    }

    #[test]
    fn the_sine_holds_for_any_turn() {
        let sine = Sine::new();
        for i in -2000..2000 {
            let angle_rad = i as f32 * 0.037;
            assert!((sine.of(angle_rad) - angle_rad.sin()).abs() < 2e-3, "{angle_rad}");
        }
    }
}
