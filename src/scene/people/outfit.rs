//! What a person wears and carries, and its colours.

use rand::RngExt;

use super::shell::N_TONES;
use super::stature::Body;
use crate::random::{Rng, pick_weighted};

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Upper {
    /// Short sleeves.
    Shirt,
    /// Long sleeves, close to the body.
    Pullover,
    /// Wide, to the hips.
    Jacket,
    /// Open at the front of the neck, down to this share of the legs.
    Coat(f64),
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Lower {
    /// Radius of the hem as part of the ankle's.
    Trousers(f64),
    /// Down to this share of the legs.
    Shorts(f64),
    Skirt(f64),
    /// A skirt in the tone of the upper part.
    Dress(f64),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Hair {
    None,
    Short,
    Bob,
    Long,
    Tail,
    Bun,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Headwear {
    None,
    Cap,
    Beanie,
    Brim,
    Hood,
    Scarf,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Luggage {
    None,
    Backpack,
    /// On the hip of this side, 0 left, 1 right, with a strap across the trunk.
    Shoulder(usize),
}

/// Clothes and colours.
#[derive(Debug, Clone, PartialEq)]
pub struct Outfit {
    pub upper: Upper,
    pub lower: Lower,
    pub hair: Hair,
    pub headwear: Headwear,
    pub bag: Luggage,
    /// Legs under a skirt, a dress or shorts are bare.
    pub bare_legs: bool,
    /// A scarf around the neck.
    pub has_scarf: bool,
    /// Bands of another colour across the upper part.
    pub is_striped: bool,
    /// How wide the clothes are, metres between them and the body.
    pub ease_m: f64,
    /// Red, green and blue of each tone, 0 to 1.
    pub colours: [[f64; 3]; N_TONES],
    /// Share of the LiDAR's light that comes back at right angles.
    pub reflectivity: f64,
}

/// Colours of cloth: greys and dark blues are what most people wear.
const CLOTH: [([f64; 3], f64); 20] = [
    ([0.05, 0.05, 0.06], 6.0),
    ([0.11, 0.11, 0.13], 4.0),
    ([0.24, 0.24, 0.26], 3.0),
    ([0.45, 0.45, 0.47], 2.5),
    ([0.72, 0.72, 0.72], 1.5),
    ([0.90, 0.89, 0.86], 2.5),
    ([0.07, 0.10, 0.22], 4.0),
    ([0.14, 0.22, 0.42], 3.0),
    ([0.32, 0.47, 0.68], 1.5),
    ([0.20, 0.17, 0.13], 1.5),
    ([0.42, 0.31, 0.20], 1.5),
    ([0.70, 0.60, 0.44], 1.8),
    ([0.18, 0.25, 0.15], 1.5),
    ([0.35, 0.40, 0.25], 1.0),
    ([0.45, 0.07, 0.09], 1.2),
    ([0.75, 0.12, 0.12], 0.8),
    ([0.85, 0.45, 0.12], 0.4),
    ([0.90, 0.78, 0.25], 0.4),
    ([0.80, 0.45, 0.55], 0.6),
    ([0.40, 0.20, 0.45], 0.5),
];
const SKIN: [[f64; 3]; 6] = [
    [0.90, 0.74, 0.64],
    [0.85, 0.67, 0.55],
    [0.77, 0.58, 0.45],
    [0.62, 0.44, 0.32],
    [0.45, 0.30, 0.21],
    [0.30, 0.20, 0.14],
];
const HAIR: [[f64; 3]; 6] = [
    [0.07, 0.06, 0.05],
    [0.17, 0.11, 0.07],
    [0.30, 0.19, 0.10],
    [0.50, 0.35, 0.18],
    [0.72, 0.56, 0.32],
    [0.45, 0.20, 0.09],
];

fn pick<T: Copy>(choices: &[(T, f64)], rng: &mut Rng) -> T {
    choices[pick_weighted(choices.iter().map(|choice| choice.1), rng).unwrap_or(0)].0
}

fn vary(colour: [f64; 3], rng: &mut Rng) -> [f64; 3] {
    let bright = 0.82 + 0.36 * rng.random::<f64>();
    colour.map(|c| (c * bright * (0.94 + 0.12 * rng.random::<f64>()) + 0.015).min(0.95))
}

fn cloth(rng: &mut Rng) -> [f64; 3] {
    let colour = pick(&CLOTH, rng);
    vary(colour, rng)
}

impl Outfit {
    /// Draws clothes for a body; in rain more hoods, coats and jackets.
    pub fn draw(body: &Body, is_raining: bool, rng: &mut Rng) -> Self {
        let (is_child, is_female) = (body.age_years < 13.0, body.is_female);
        // One draw stands for how warm the person dresses, so that sandals do not meet fur.
        let warm = if is_raining { 0.5 + 0.5 * rng.random::<f64>() } else { rng.random::<f64>() };
        let coat = 0.12 + 0.5 * rng.random::<f64>();
        let upper = if warm < 0.33 {
            Upper::Shirt
        } else if warm < 0.6 {
            pick(&[(Upper::Pullover, 3.0), (Upper::Shirt, 0.5), (Upper::Jacket, 2.0)], rng)
        } else {
            pick(&[(Upper::Pullover, 0.7), (Upper::Jacket, 3.0), (Upper::Coat(coat), 2.0)], rng)
        };
        let hem = 0.3 + 0.55 * rng.random::<f64>();
        let flare = 1.35 + 0.75 * rng.random::<f64>();
        let skirts = if is_female { 1.0 } else { 0.0 };
        let cool = if warm < 0.4 { 1.0 } else { 0.05 };
        let lower = pick(
            &[
                (Lower::Trousers(flare), 4.5),
                (Lower::Shorts(0.3 + 0.18 * rng.random::<f64>()), 2.0 * cool),
                (Lower::Skirt(hem), 1.1 * skirts),
                (Lower::Dress(hem), 1.1 * skirts * (0.3 + cool)),
            ],
            rng,
        );
        let hair = if is_female {
            pick(
                &[
                    (Hair::Short, 1.0),
                    (Hair::Bob, 2.5),
                    (Hair::Long, 2.5),
                    (Hair::Tail, 2.0),
                    (Hair::Bun, 1.0),
                ],
                rng,
            )
        } else {
            let bald = if body.age_years > 35.0 { 1.5 } else { 0.15 };
            pick(&[(Hair::Short, 7.0), (Hair::None, bald), (Hair::Bob, 0.5), (Hair::Tail, 0.2)], rng)
        };
        let wet = if is_raining { 3.0 } else { 0.4 };
        let headwear = pick(
            &[
                (Headwear::None, 9.0),
                (Headwear::Cap, 1.2),
                (Headwear::Beanie, 1.6 * warm),
                (Headwear::Brim, 0.4),
                (Headwear::Hood, wet),
                (Headwear::Scarf, 0.7 * skirts * f64::from(u8::from(!is_child))),
            ],
            rng,
        );
        let side = usize::from(rng.random_bool(0.5));
        let shoulder = if is_female { 2.5 } else { 0.9 };
        let bag = pick(
            &[
                (Luggage::None, 5.5),
                (Luggage::Backpack, 2.2),
                (Luggage::Shoulder(side), if is_child { 0.1 } else { shoulder }),
            ],
            rng,
        );
        let age_grey = ((body.age_years - 40.0) / 35.0).clamp(0.0, 1.0);
        let natural = HAIR[rng.random_range(0..HAIR.len())];
        let grey = if rng.random::<f64>() < age_grey { 0.55 + 0.25 * rng.random::<f64>() } else { 0.0 };
        let hair_colour = if grey > 0.0 { [grey; 3] } else { natural };
        let skin = SKIN[pick_weighted([5.0, 4.0, 2.5, 1.2, 0.8, 0.6].into_iter(), rng).unwrap_or(0)];
        let shoes =
            pick(&[([0.05, 0.05, 0.05], 4.0), ([0.3, 0.2, 0.13], 2.0), ([0.85, 0.85, 0.83], 2.5)], rng);
        let colours = [
            vary(skin, rng),
            vary(hair_colour, rng),
            cloth(rng),
            cloth(rng),
            cloth(rng),
            vary(shoes, rng),
            cloth(rng),
            cloth(rng),
            cloth(rng),
            [0.06, 0.06, 0.065],
        ];
        Self {
            upper,
            lower,
            hair,
            headwear,
            bag,
            bare_legs: warm < 0.45,
            has_scarf: warm > 0.75 && rng.random_bool(0.35),
            is_striped: !matches!(upper, Upper::Coat(_)) && rng.random_bool(0.14),
            ease_m: (0.008 + 0.016 * rng.random::<f64>() + 0.008 * warm) * (0.4 + 0.6 * body.height_m / 1.75),
            colours,
            // At 905 nm dyed cloth sends back far more than the eye expects: 0.2 to 0.7, little of it told by its colour.
            reflectivity: 0.18 + 0.5 * rng.random::<f64>() * (0.6 + 0.4 * rng.random::<f64>()),
        }
    }
}
