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

    /// The nearest value that was tabulated.
    pub(super) fn near(&self, x: f32) -> f32 {
        let last = (self.values.len() - 1) as f32;
        let place = ((x - self.first) * self.steps_per_unit + 0.5).clamp(0.0, last);
        self.values[place as i32 as usize]
    }

    pub(super) fn at(&self, x: f32) -> f32 {
        let place = ((x - self.first) * self.steps_per_unit).clamp(0.0, (self.values.len() - 1) as f32);
        let below = (place as i32 as usize).min(self.values.len() - 2);
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
        let step = floor(angle_rad * (Self::N as f32 / std::f32::consts::TAU));
        self.0[(step & (Self::N as i32 - 1)) as usize]
    }
}

/// The whole number below; `f32::floor` is a call where the processor's plainest instructions must do.
pub(super) fn floor(x: f32) -> i32 {
    let toward_zero = x as i32;
    toward_zero - i32::from(toward_zero as f32 > x)
}

/// atan2(y, x) to 2e-5, from -pi to pi (Abramowitz and Stegun 4.4.49).
pub(super) fn angle(y: f32, x: f32) -> f32 {
    let (flat, steep) = (x.abs(), y.abs());
    let t = flat.min(steep) / flat.max(steep).max(f32::MIN_POSITIVE);
    let t2 = t * t;
    let poly = 0.180_141 + t2 * (-0.085_133 + t2 * 0.020_835_1);
    let within = t * (0.999_866 + t2 * (-0.330_299_5 + t2 * poly));
    let upward = if steep > flat { std::f32::consts::FRAC_PI_2 - within } else { within };
    let turned = if x < 0.0 { std::f32::consts::PI - upward } else { upward };
    if y < 0.0 { -turned } else { turned }
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
    fn angles_are_near_those_of_the_standard_library_all_round() {
        for i in -400..400 {
            let (y, x) = (i as f32 * 0.0078).sin_cos();
            for scale in [1e-3, 1.0, 700.0] {
                let error = (angle(y * scale, x * scale) - y.atan2(x)).abs();
                assert!(error < 2e-5, "{x} {y}: {error}");
            }
        }
        assert_eq!((angle(0.0, 0.0), floor(-0.5), floor(-2.0), floor(2.9)), (0.0, -1, -2, 2));
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
