//! People, each unlike the others: a body by age and sex, clothes, colours, what they carry and what they do.
//!
//! A person's surface is made anew for each phase of the gait, of about 1,700 triangles.

mod clothes;
mod figure;
mod gait;
mod model;
mod outfit;
mod poses;
mod shell;
mod skeleton;
mod stature;
mod things;

use rand::RngExt;

use figure::Dressed;
use gait::{Gait, N_PHASES};
pub use model::model;
use outfit::Outfit;
pub use poses::{Holds, Stance};
use shell::Shell;
use skeleton::{Pose, Skeleton};
use stature::Body;

use crate::random::Rng;

/// What a person does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Does {
    /// Walks or runs at this speed, metres a second.
    Walks(f64),
    Stands(Stance),
    Sits,
    /// Bends to a bag.
    Stoops,
    /// Rolls along in a wheelchair.
    Rolls,
}

/// What is pushed ahead.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pushed {
    Pram,
    Trolley,
}

/// A person or what it pushes, as surfaces: the first is the one at rest, the others are the phases of a gait.
pub struct Phases {
    pub shells: Vec<Shell>,
    /// Way of one cycle, where there are phases.
    pub stride_m: f64,
}

/// One person.
#[derive(Debug, Clone, PartialEq)]
pub struct Person {
    pub body: Body,
    pub outfit: Outfit,
    pub does: Does,
    pub holds: Holds,
    /// How lively it walks, about 1.
    swing: f64,
}

impl Person {
    pub fn draw(
        age_years: f64,
        is_female: bool,
        does: Does,
        holds: Holds,
        is_raining: bool,
        rng: &mut Rng,
    ) -> Self {
        let body = Body::draw(age_years, is_female, rng);
        let outfit = Outfit::draw(&body, is_raining, rng);
        Self { body, outfit, does, holds, swing: 0.75 + 0.5 * rng.random::<f64>() }
    }

    fn shell(&self, mut pose: Pose) -> Shell {
        poses::hold(&mut pose, &self.body, self.holds);
        let skeleton = Skeleton::new(&self.body, &pose);
        let figure = Dressed { body: &self.body, outfit: &self.outfit, skeleton: &skeleton };
        let mut shell = Shell::default();
        figure.add_trunk(&mut shell);
        clothes::legs(&figure, &mut shell);
        clothes::drape(&figure, &mut shell);
        for i in 0..2 {
            clothes::arm_sleeve(&figure, &mut shell, i);
            figure.add_hand(&mut shell, i);
        }
        figure.add_head(&mut shell);
        figure.add_hair(&mut shell);
        things::carry(&figure, self.holds, &mut shell);
        if self.does == Does::Stoops {
            things::bag_on_ground(&figure, &mut shell);
        }
        shell
    }

    /// Its surfaces.
    pub fn phases(&self, rng: &mut Rng) -> Phases {
        let body = &self.body;
        let alone = |shell| Phases { shells: vec![shell], stride_m: 0.0 };
        match self.does {
            Does::Walks(speed_mps) => {
                let gait = Gait::new(body, speed_mps, self.swing);
                let mut shells = vec![self.shell(poses::stand(body, Stance::Easy, rng))];
                let share = |phase| phase as f64 / N_PHASES as f64;
                shells.extend((0..N_PHASES).map(|phase| self.shell(gait.pose(body, share(phase)))));
                Phases { shells, stride_m: gait.stride_m }
            }
            Does::Stands(stance) => alone(self.shell(poses::stand(body, stance, rng))),
            Does::Sits => alone(self.shell(poses::sit(body, poses::BENCH_M, rng))),
            Does::Stoops => alone(self.shell(poses::stoop(body, rng))),
            Does::Rolls => {
                let mut shell = self.shell(poses::sit(body, poses::WHEELCHAIR_M, rng));
                things::wheelchair(&mut shell);
                alone(shell)
            }
        }
    }
}

impl Pushed {
    pub fn phases(self) -> Phases {
        let mut shell = Shell::default();
        match self {
            Self::Pram => things::pram(&mut shell),
            Self::Trolley => things::trolley(&mut shell),
        }
        Phases { shells: vec![shell], stride_m: 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random;

    fn people() -> Vec<(Person, Phases)> {
        let does = [
            Does::Walks(1.3),
            Does::Walks(3.0),
            Does::Stands(Stance::Gestures),
            Does::Sits,
            Does::Stoops,
            Does::Rolls,
        ];
        let make = |i: u64| {
            let mut rng = random::stream(i, "people-test", 0);
            let age = [3.0, 8.0, 14.0, 30.0, 75.0][i as usize % 5];
            let holds = if i % 6 < 2 && i > 11 { Holds::Umbrella(0) } else { Holds::Nothing };
            let person = Person::draw(
                age,
                i.is_multiple_of(2),
                does[i as usize % 6],
                holds,
                i.is_multiple_of(3),
                &mut rng,
            );
            let phases = person.phases(&mut rng);
            (person, phases)
        };
        (0..60).map(make).collect()
    }

    fn lowest_m(shell: &Shell) -> f64 {
        shell.vertices.iter().map(|(at, _)| at.z).fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn no_two_people_are_alike_and_each_is_the_same_again() {
        let (first, again) = (people(), people());
        for (i, (person, phases)) in first.iter().enumerate() {
            assert!(*person == again[i].0 && phases.shells == again[i].1.shells);
            for (other, shells) in &first[..i] {
                assert!(person != other && phases.shells != shells.shells);
                assert!(person.outfit.colours != other.outfit.colours);
            }
        }
    }

    #[test]
    fn everybody_stands_on_the_ground_in_every_phase() {
        for (person, phases) in people() {
            let lows: Vec<f64> = phases.shells.iter().map(lowest_m).collect();
            assert!(lows.iter().all(|low| *low > -0.02), "{:?}: {lows:?}", person.does);
            let flies = |low: &&f64| **low > 0.03;
            // Runners are in the air twice a cycle, and a small child's feet hang from a bench.
            let may_fly = matches!(person.does, Does::Sits) || person.does == Does::Walks(3.0);
            assert!(may_fly || lows.iter().filter(flies).count() == 0, "{:?}: {lows:?}", person.does);
            assert!(lows.iter().filter(flies).count() < lows.len() || person.does == Does::Sits);
        }
    }

    #[test]
    fn a_person_is_as_high_as_its_body_and_not_too_fine() {
        for (person, phases) in people() {
            let triangles = phases.shells[0].triangles.len();
            assert!((1000..3000).contains(&triangles), "{triangles}");
            if let Does::Walks(_) | Does::Stands(_) = person.does
                && person.holds == Holds::Nothing
            {
                let high = |shell: &Shell| shell.vertices.iter().map(|(at, _)| at.z).fold(0.0, f64::max);
                let top = phases.shells.iter().map(high).fold(0.0, f64::max);
                let over = top / person.body.height_m;
                assert!((0.92..1.08).contains(&over), "{over} of {}", person.body.height_m);
            }
        }
    }

    #[test]
    fn the_box_of_a_model_holds_every_phase() {
        use crate::object::{Distribution, Kind};
        use crate::scene::models::ModelFacts;
        for (person, phases) in people().into_iter().take(12) {
            let facts: ModelFacts = serde_json::from_value(serde_json::json!({
                "category": "adult", "kind": Kind::Pedestrian, "distribution": Distribution::Id, "reflectivity": 0.3
            }))
            .unwrap();
            let made = model("person_000", facts, 70.0, &person.outfit.colours, &phases);
            let [low, high] = made.bounds;
            for corner in phases.shells.iter().flat_map(Shell::corners).flatten() {
                let at = corner.cast::<f64>();
                assert!(low <= at && at <= high);
            }
            assert_eq!(made.shapes.len(), if phases.shells.len() > 1 { 1 + N_PHASES } else { 0 });
        }
    }
}
