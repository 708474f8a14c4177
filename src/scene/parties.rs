//! Who is in the streets: people alone and in groups, what each does, and models of them all.

use rand::RngExt;

use super::models::{Faces, Model, ModelFacts, Role};
use super::ood_placement::check_sum;
use super::path::Vec2;
use super::people::{Does, Holds, Person, Pushed, Stance, model};
use super::split::SceneSplit;
use crate::config::{InvalidConfig, SHARE, define_config};
use crate::object::{Distribution, Kind};
use crate::random::{self, Rng, pick_weighted};

define_config! {
    /// What people in the streets do and carry.
    pub struct PeopleConfig {
        /// Share of those who walk or stand that are two to four together.
        group_share: f64 = 0.3, in SHARE;
        /// Share of the people who are children of 2 to 15 years; those under 9 are never alone.
        child_share: f64 = 0.14, in SHARE;
        /// Shares of what they do, this one and the next five; the others walk. Stand.
        standing_share: f64 = 0.24, in SHARE;
        /// Sit.
        sitting_share: f64 = 0.06, in SHARE;
        /// Bend to a bag on the ground.
        stooping_share: f64 = 0.03, in SHARE;
        /// Run.
        running_share: f64 = 0.05, in SHARE;
        /// Move in a wheelchair.
        wheelchair_share: f64 = 0.02, in SHARE;
        /// Push a pram or a shopping trolley.
        pushing_share: f64 = 0.06, in SHARE;
        /// Carry a bag or a box, or look at a phone.
        carrying_share: f64 = 0.3, in SHARE;
        /// Of the adults who walk or stand in the rain.
        umbrella_share: f64 = 0.5, in SHARE;
    }
}

impl PeopleConfig {
    /// What people do, in the order of the shares; those that are left walk.
    fn shares(&self) -> [f64; 6] {
        let Self { standing_share, sitting_share, stooping_share, running_share, .. } = *self;
        [
            standing_share,
            sitting_share,
            stooping_share,
            running_share,
            self.wheelchair_share,
            self.pushing_share,
        ]
    }

    /// Whether what people do leaves some to walk.
    ///
    /// # Errors
    /// The shares are more than one in sum.
    pub fn check_shares(&self) -> Result<(), InvalidConfig> {
        check_sum("people", "standing, sitting, stooping, running, wheelchair and pushing", &self.shares())
    }
}

/// One of a party: a person or what it pushes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Member {
    pub model: usize,
    /// Place ahead and to the left of the first; of those who stand, of the middle.
    pub at: Vec2,
    pub yaw_rad: f64,
    /// Pushed by the first.
    pub is_stiff: bool,
}

/// What the members of a party do together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Together {
    /// On foot or on wheels, metres a second.
    Moves(f64),
    Stands,
    Sits,
    Stoops,
}

/// People who belong together; the first leads.
#[derive(Debug, Clone, PartialEq)]
pub struct Party {
    pub does: Together,
    pub members: Vec<Member>,
}

/// From one to the next, side by side and behind one another.
const BESIDE_M: f64 = 0.66;
const BEHIND_M: f64 = 1.15;
/// Radius of the circle in which people talk.
const TALK_M: f64 = 0.68;

/// Draws parties of `n` people in all, and adds their models.
pub fn draw_parties(
    config: &PeopleConfig,
    n: usize,
    is_raining: bool,
    seed: u64,
    models: &mut Vec<Model>,
) -> Vec<Party> {
    let mut rng = random::stream(seed, "parties", 0);
    let mut crowd = Crowd { config, is_raining, seed, models, n_people: 0, n_things: 0 };
    let mut parties = Vec::new();
    while crowd.n_people < n {
        parties.push(crowd.party(n - crowd.n_people, &mut rng));
    }
    parties
}

/// People that an actor of a scenario may be: a category, and the ages of its people.
const ACTORS: [(&str, [f64; 2]); 3] =
    [("adult", [20.0, 70.0]), ("child", [4.0, 11.0]), ("wheelchair", [30.0, 80.0])];

/// Adds a model for an actor that is a person: on foot at a speed, or standing; the actor's name is in the model's.
pub fn draw_actor(
    name: &str,
    category: &str,
    speed_mps: f64,
    is_raining: bool,
    seed: u64,
    models: &mut Vec<Model>,
) {
    let Some((_, [youngest, oldest])) = ACTORS.into_iter().find(|(known, _)| *known == category) else {
        return;
    };
    let mut rng = random::stream(seed, &format!("actor-person {name}"), 0);
    let age_years = youngest + (oldest - youngest) * rng.random::<f64>();
    let does = match category {
        "wheelchair" => Does::Rolls,
        _ if speed_mps > 0.0 => Does::Walks(speed_mps),
        _ => Does::Stands(Stance::Easy),
    };
    let person = Person::draw(age_years, rng.random_bool(0.5), does, Holds::Nothing, is_raining, &mut rng);
    let facts = facts(category, Kind::Pedestrian, person.outfit.reflectivity);
    let phases = person.phases(&mut rng);
    models.push(model(&actor_name(name), facts, person.body.mass_kg, &person.outfit.colours, &phases));
}

/// Categories of people that an actor may be, of which no model comes along.
pub fn actor_people() -> impl Iterator<Item = &'static str> {
    ACTORS.into_iter().map(|(category, _)| category)
}

/// Name of the model that is drawn for an actor.
pub fn actor_name(name: &str) -> String {
    format!("actor_{name}")
}

struct Crowd<'a> {
    config: &'a PeopleConfig,
    is_raining: bool,
    seed: u64,
    models: &'a mut Vec<Model>,
    n_people: usize,
    n_things: usize,
}

fn adult_years(rng: &mut Rng) -> f64 {
    17.0 + 66.0 * rng.random::<f64>().powf(1.3)
}

fn child_years(rng: &mut Rng) -> f64 {
    2.0 + 13.0 * rng.random::<f64>()
}

impl Crowd<'_> {
    fn party(&mut self, most: usize, rng: &mut Rng) -> Party {
        let shares = self.config.shares();
        let walks = (1.0 - shares.iter().sum::<f64>()).max(0.0);
        let alone = |does, model| {
            let member = Member { model, at: Vec2::zeros(), yaw_rad: 0.0, is_stiff: false };
            Party { does, members: vec![member] }
        };
        match pick_weighted(shares.into_iter().chain([walks]), rng).unwrap_or(6) {
            0 => self.standing(most, rng),
            1 => {
                let age = self.age(2.0, rng);
                alone(Together::Sits, self.person(age, Does::Sits, Holds::Nothing, rng))
            }
            2 => {
                let age = self.age(9.0, rng);
                alone(Together::Stoops, self.person(age, Does::Stoops, Holds::Nothing, rng))
            }
            3 => {
                let speed_mps = 2.5 + rng.random::<f64>();
                let age = self.age(9.0, rng).min(60.0);
                let model = self.person(age, Does::Walks(speed_mps), Holds::Nothing, rng);
                alone(Together::Moves(speed_mps), model)
            }
            4 => {
                let age = self.age(9.0, rng);
                let model = self.person(age, Does::Rolls, Holds::Nothing, rng);
                alone(Together::Moves(0.8 + 0.5 * rng.random::<f64>()), model)
            }
            5 => self.pushing(rng),
            _ => self.walking(most, rng),
        }
    }

    /// The age of someone alone: an adult, or a child of at least this age.
    fn age(&self, least_years: f64, rng: &mut Rng) -> f64 {
        if rng.random::<f64>() < self.config.child_share {
            child_years(rng).max(least_years)
        } else {
            adult_years(rng)
        }
    }

    fn n_together(&self, most: usize, rng: &mut Rng) -> usize {
        let is_group = rng.random::<f64>() < self.config.group_share;
        let n = 2 + pick_weighted([6.0, 3.0, 1.0].into_iter(), rng).unwrap_or(0);
        if is_group { n.min(most) } else { 1 }
    }

    /// Ages of a party: the first is an adult where there are small children.
    fn ages(&self, n: usize, rng: &mut Rng) -> Vec<f64> {
        if n == 1 {
            return vec![self.age(9.0, rng)];
        }
        // A family, or grown-ups, or children of the same age.
        let share = self.config.child_share;
        let kind = pick_weighted([2.2 * share, (1.0 - 3.0 * share).max(0.0), 0.5 * share].into_iter(), rng);
        match kind {
            Some(0) => (0..n)
                .map(|i| {
                    if i == 0 || (i == 3 && n == 4) {
                        24.0 + 20.0 * rng.random::<f64>()
                    } else {
                        child_years(rng)
                    }
                })
                .collect(),
            Some(2) => {
                let years = 9.0 + 6.0 * rng.random::<f64>();
                (0..n).map(|_| years + rng.random::<f64>()).collect()
            }
            _ => (0..n).map(|_| adult_years(rng)).collect(),
        }
    }

    fn walking(&mut self, most: usize, rng: &mut Rng) -> Party {
        let n = self.n_together(most, rng);
        let ages = self.ages(n, rng);
        let slowest = ages.iter().copied().fold(1.0, |slow: f64, age| {
            slow.min(if age < 10.0 { 0.6 + 0.04 * age } else { 1.0 - 0.008 * (age - 55.0).max(0.0) })
        });
        let speed_mps = (1.05 + 0.5 * rng.random::<f64>()) * slowest;
        let mut members = Vec::new();
        for (i, age) in ages.into_iter().enumerate() {
            let holds = self.holds(age, rng);
            let at = Vec2::new(-BEHIND_M * (i / 2) as f64, BESIDE_M * (i % 2) as f64);
            let model = self.person(age, Does::Walks(speed_mps), holds, rng);
            members.push(Member { model, at, yaw_rad: 0.0, is_stiff: false });
        }
        Party { does: Together::Moves(speed_mps), members }
    }

    fn standing(&mut self, most: usize, rng: &mut Rng) -> Party {
        let n = self.n_together(most, rng);
        let ages = self.ages(n, rng);
        let turn_rad = std::f64::consts::TAU * rng.random::<f64>();
        let mut members = Vec::new();
        for (i, age) in ages.into_iter().enumerate() {
            let weights = [4.0, 1.5, 0.7, 1.0, if n > 1 { 3.0 } else { 0.0 }];
            let stances = [
                Stance::Easy,
                Stance::HandsInPockets,
                Stance::HandsOnHips,
                Stance::ArmsFolded,
                Stance::Gestures,
            ];
            let stance = stances[pick_weighted(weights.into_iter(), rng).unwrap_or(0)];
            let holds = if stance == Stance::Easy { self.holds(age, rng) } else { Holds::Nothing };
            let model = self.person(age, Does::Stands(stance), holds, rng);
            let around_rad = turn_rad + std::f64::consts::TAU * i as f64 / n as f64;
            let radius_m = if n == 1 { 0.0 } else { TALK_M + 0.04 * n as f64 };
            let at = Vec2::new(around_rad.cos(), around_rad.sin()) * radius_m;
            let yaw_rad = if n == 1 { 0.0 } else { around_rad + std::f64::consts::PI };
            members.push(Member { model, at, yaw_rad, is_stiff: false });
        }
        Party { does: Together::Stands, members }
    }

    fn pushing(&mut self, rng: &mut Rng) -> Party {
        let speed_mps = 0.9 + 0.4 * rng.random::<f64>();
        let is_pram = rng.random_bool(0.6);
        let age = if is_pram { 20.0 + 25.0 * rng.random::<f64>() } else { adult_years(rng) };
        let person = self.person(age, Does::Walks(speed_mps), Holds::Bar, rng);
        let thing = self.pushed(if is_pram { Pushed::Pram } else { Pushed::Trolley }, rng);
        let forward_m = self.models[person].bounds[1].x - self.models[thing].bounds[0].x;
        let members = vec![
            Member { model: person, at: Vec2::zeros(), yaw_rad: 0.0, is_stiff: false },
            Member { model: thing, at: Vec2::new(forward_m, 0.0), yaw_rad: 0.0, is_stiff: true },
        ];
        Party { does: Together::Moves(speed_mps), members }
    }

    fn holds(&self, age_years: f64, rng: &mut Rng) -> Holds {
        let side = usize::from(rng.random_bool(0.5));
        let (umbrella, carries) = (rng.random::<f64>(), rng.random::<f64>());
        if self.is_raining && age_years > 12.0 && umbrella < self.config.umbrella_share {
            return Holds::Umbrella(side);
        }
        if carries >= self.config.carrying_share || age_years < 8.0 {
            return Holds::Nothing;
        }
        let kinds = [Holds::Bag(side), Holds::Crate, Holds::Phone(side), Holds::Call(side)];
        kinds[pick_weighted([4.0, 1.0, 2.0, 1.0].into_iter(), rng).unwrap_or(0)]
    }

    fn person(&mut self, age_years: f64, does: Does, holds: Holds, rng: &mut Rng) -> usize {
        let name = format!("person_{:03}", self.n_people);
        let mut own = random::stream(self.seed, "person", self.n_people as u64);
        self.n_people += 1;
        let person = Person::draw(age_years, rng.random_bool(0.5), does, holds, self.is_raining, &mut own);
        let category = match does {
            Does::Rolls => "wheelchair",
            _ if person.body.is_child() => "child",
            _ => "adult",
        };
        let facts = facts(category, Kind::Pedestrian, person.outfit.reflectivity);
        let phases = person.phases(&mut own);
        self.models.push(model(&name, facts, person.body.mass_kg, &person.outfit.colours, &phases));
        self.models.len() - 1
    }

    fn pushed(&mut self, thing: Pushed, rng: &mut Rng) -> usize {
        let name = format!("pushed_{:03}", self.n_things);
        self.n_things += 1;
        let mut own = random::stream(self.seed, "pushed", self.n_things as u64);
        let colours = Person::draw(30.0, true, Does::Sits, Holds::Nothing, false, &mut own).outfit.colours;
        let (category, kind) = match thing {
            Pushed::Pram => ("stroller", Kind::Pedestrian),
            Pushed::Trolley => ("shopping_trolley", Kind::Static),
        };
        let facts = facts(category, kind, 0.25 + 0.3 * rng.random::<f64>());
        self.models.push(model(&name, facts, 15.0, &colours, &thing.phases()));
        self.models.len() - 1
    }
}

/// A weight of 0: nothing but the crowd draws these models.
fn facts(category: &str, kind: Kind, reflectivity: f64) -> ModelFacts {
    ModelFacts {
        category: category.to_owned(),
        kind,
        distribution: Distribution::Id,
        role: Role::default(),
        split: SceneSplit::default(),
        reflectivity,
        weight: 0.0,
        faces: Faces::default(),
        rolls: None,
        paint: None,
    }
}
