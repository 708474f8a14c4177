//! One drive: perception sees at each sample, the reflex decides at each control step, physics moves everything.

use std::collections::BTreeMap;
use std::path::Path;

use super::foresight::Foresight;
use super::notes::{Notes, Order};
use super::perception::{Instant, Perception, truly_harmful};
use super::recorder::Recorder;
use super::reflex::Reflex;
use super::rest::AtRest;
use super::route_ahead;
use super::scenario::Course;
use super::{DriveConfig, DriveError};
use crate::generate::{CONTROL_PERIOD_S, Contact, EpisodePlan, GenerateError, LiveEpisode, Timings};
use crate::infer::PredictError;
use crate::object::{Event, Object, Spot};
use crate::outcome::{Collision, DriveOutcome, End, is_sudden};
use crate::sample::EgoState;
use crate::scene::{EgoOrders, car};
use crate::sim::SimError;
use crate::worker::{lacks_memory, with_causes};
use crate::zone::Zone;

/// Slower than this the ego stands, m/s.
const STANDS_MPS: f64 = 0.3;
/// Slower than this it has not run into what stands still, m/s: that has come to it, and lies there.
const AT_REST_MPS: f64 = 0.05;
/// An ego that comes no faster towards what moves has not run into it: it came from the side or from behind.
const LEAST_APPROACH_MPS: f64 = 0.3;
/// What has run into the ego is run into by it once the ego comes so fast towards it.
const PUSHES_MPS: f64 = 1.0;
/// What closes no faster takes for ever to be met, m/s.
const LEAST_CLOSING_MPS: f64 = 0.1;
/// What was harmful so long before a collision was known to be, seconds.
const HARMFUL_BEFORE_S: f64 = 2.0;
/// So much of the route the driver under test is told, metres.
const LONGEST_ROUTE_M: f64 = 60.0;

/// Where a driver's files go.
pub(super) struct Files<'a> {
    /// The driver's folder.
    pub folder: &'a Path,
    pub who: &'a str,
    /// Whether episodes are recorded.
    pub records: bool,
}

/// Drives one episode; `on_sample` is called after each sample.
///
/// # Errors
/// There is no simulator, or the disk fails. A detector of another program that fails, a network whose numbers have no end, a
/// world that the simulator cannot go on with, and a state or box that no zone can be laid over, end the drive as [`End::Failed`].
pub(super) fn drive(
    course: &Course,
    perception: &mut Perception,
    needs_sensors: bool,
    files: &Files<'_>,
    on_sample: &mut dyn FnMut() -> std::io::Result<()>,
) -> Result<DriveOutcome, DriveError> {
    match drive_through(course, perception, needs_sensors, files, on_sample) {
        Err(DriveError::Generate(GenerateError::Simulation(
            error @ (SimError::Ask { .. } | SimError::Compile { .. }),
        ))) => {
            let message = error.to_string();
            // That is no fault of the world: the worker ends for it, and the drive is made again.
            if lacks_memory(&message) {
                return Err(DriveError::OutOfMemory { message });
            }
            Ok(failed(&course.plan, message))
        }
        Err(DriveError::Predict(error @ PredictError::NotFinite { .. })) => {
            Ok(failed(&course.plan, error.to_string()))
        }
        Err(DriveError::Zone(error)) => Ok(failed(&course.plan, error.to_string())),
        driven => driven,
    }
}

/// A drive that could not be made, and why.
pub(super) fn failed(plan: &EpisodePlan, reason: String) -> DriveOutcome {
    Notes::new().finish(plan, &[], End::Failed(reason))
}

fn drive_through(
    course: &Course,
    perception: &mut Perception,
    needs_sensors: bool,
    files: &Files<'_>,
    on_sample: &mut dyn FnMut() -> std::io::Result<()>,
) -> Result<DriveOutcome, DriveError> {
    let Course { config, checked, plan, family } = course;
    let zone = Zone::try_from(config.zone.clone())?;
    let live = LiveEpisode::start(checked, plan, files.folder)?;
    let path = files.folder.join(plan.file());
    let recorder = files.records.then(|| Recorder::create(&live, &path)).transpose()?;
    let reflex = Reflex::new(&config.reflex, perception.scores(&config.reflex))?;
    let foresight = Foresight::of_truth(config.met_within_s)?;
    let free_way_m = live.free_way_m(config.n_steps() as usize);
    let ego_kg = live.ego_mass_kg()?;
    let mut drive = Run {
        config,
        zone,
        foresight,
        live,
        reflex,
        recorder,
        senses: needs_sensors || files.records,
        seen: Seen::default(),
        notes: Notes::new(),
        busy_until_s: f64::NEG_INFINITY,
        delay_s: config.reflex.latency_s,
        speed_error_mps: 0.0,
        steering_error_rad: 0.0,
        ego_kg,
    };
    let every = u64::from(checked.control_steps_per_sample);
    let mut end = End::Time;
    for step in 0..config.n_steps() {
        if step % every == 0 {
            if let Err(error) = drive.see(step, step / every, plan, perception) {
                let DriveError::External(error) = error else { return Err(error) };
                perception.give_up();
                end = End::Failed(with_causes(&error));
                break;
            }
            on_sample()?;
        }
        if let Some(found) = drive.go_on(step)? {
            end = found;
            break;
        }
    }
    let Run { recorder, notes, .. } = drive;
    let mut outcome = notes.finish(plan, &free_way_m, end);
    outcome.family.clone_from(family);
    // Half a drive is no episode of a data set; what it wrote keeps its unfinished name, which the next command clears away.
    let is_whole = |recorder: &Recorder| !recorder.is_empty() && !outcome.is_failed();
    if let Some(recorder) = recorder.filter(is_whole) {
        outcome.entry = Some(recorder.finish(files.folder, files.who, plan, config)?);
    }
    Ok(outcome)
}

/// What was true at the last samples.
#[derive(Default)]
struct Seen {
    present: Vec<(usize, Object)>,
    /// Numbers of the harmful ones.
    harmful: Vec<usize>,
    /// How far the ego had driven then, metres.
    at_m: f64,
    /// When each object was last harmful, and anything.
    harmful_s: BTreeMap<usize, f64>,
    any_harmful_s: Option<f64>,
    /// When the ego's coming set an object off, and how fast it came, m/s.
    set_off: BTreeMap<usize, [f64; 2]>,
}

struct Run<'a> {
    config: &'a DriveConfig,
    zone: Zone,
    foresight: Foresight,
    live: LiveEpisode<'a>,
    reflex: Reflex,
    recorder: Option<Recorder>,
    /// Whether the sensors measure.
    senses: bool,
    seen: Seen,
    notes: Notes,
    /// Perception looks at its last sample until then, where its own time counts; and from that sample to the brake.
    busy_until_s: f64,
    delay_s: f64,
    /// What was measured beside the truth at the last sample: speed, and steering angle.
    speed_error_mps: f64,
    steering_error_rad: f64,
    ego_kg: f64,
}

impl Run<'_> {
    /// One sample: what is there, what is measured, what is found.
    fn see(
        &mut self,
        step: u64,
        sample_idx: u64,
        plan: &EpisodePlan,
        perception: &mut Perception,
    ) -> Result<(), DriveError> {
        let time_s = step as f64 * CONTROL_PERIOD_S;
        let true_state = self.live.ego_state()?;
        let present = self.live.present();
        let harmful = truly_harmful(&self.zone, &self.foresight, &true_state, &present)?;
        self.seen.harmful_s.extend(harmful.iter().map(|&i| (i, time_s)));
        if !harmful.is_empty() {
            self.seen.any_harmful_s = Some(time_s);
        }
        let sensed =
            if self.senses { Some(self.live.measure(sample_idx, &mut Timings::default())?) } else { None };
        let told = self.live.measured_state(sample_idx)?;
        self.speed_error_mps = told.speed_mps - true_state.speed_mps;
        self.steering_error_rad = told.steering_angle_rad - true_state.steering_angle_rad;
        let is_busy = time_s + 1e-9 < self.busy_until_s;
        let found = if is_busy {
            Vec::new()
        } else {
            let is_loading = perception.is_loading();
            let begin = std::time::Instant::now();
            let found = perception.detect(
                &self.zone,
                &Instant {
                    episode: &plan.name,
                    sample_idx,
                    measured: sensed.as_ref().map(|(sample, ..)| &sample.measured),
                    present: &present,
                    true_state: &true_state,
                },
            )?;
            let is_timed = self.config.reflex.real_latency && !is_loading;
            let took_s = if is_timed { begin.elapsed().as_secs_f64() } else { 0.0 };
            self.busy_until_s = time_s + took_s;
            self.delay_s = self.config.reflex.latency_s + took_s;
            let knows_velocities = perception.knows_velocities();
            self.reflex.see([time_s, took_s], &self.live.world_from_ego(), &found, knows_velocities);
            found
        };
        (self.seen.present, self.seen.harmful, self.seen.at_m) = (present, harmful, self.notes.distance_m);
        self.notes.n_samples += 1;
        if let (Some(recorder), Some(sensed)) = (&mut self.recorder, sensed) {
            recorder.record(sensed, found)?;
        }
        Ok(())
    }

    /// One control step; tells how the drive ended, if it has.
    fn go_on(&mut self, step: u64) -> Result<Option<End>, DriveError> {
        let time_s = step as f64 * CONTROL_PERIOD_S;
        let true_state = self.live.ego_state()?;
        let state = EgoState {
            speed_mps: true_state.speed_mps + self.speed_error_mps,
            steering_angle_rad: true_state.steering_angle_rad + self.steering_error_rad,
            ..true_state
        };
        let route = self.live.route_ahead(LONGEST_ROUTE_M, route_ahead::STEP_M);
        let orders = self.reflex.orders(time_s, &self.live.world_from_ego(), &state, &route)?;
        self.note_braking(time_s, true_state.speed_mps, &orders);
        let before = self.live.world_from_ego().isometry.translation.vector;
        let contacts = self.live.step_ordered(orders)?;
        let now_s = time_s + CONTROL_PERIOD_S;
        self.live.set_off().for_each(|i| {
            self.seen.set_off.entry(i).or_insert([time_s, true_state.speed_mps]);
        });
        let moved_m = (self.live.world_from_ego().isometry.translation.vector - before).xy().norm();
        self.notes.n_steps += 1;
        self.notes.distance_m += moved_m;
        for contact in &contacts {
            self.note_contact(now_s, contact);
        }
        if self.notes.collision.is_some() {
            return Ok(Some(End::Collision));
        }
        let speed_mps = self.live.ego_state()?.speed_mps;
        self.notes.speeds_mps.push(speed_mps);
        if let Some(recorder) = &mut self.recorder {
            recorder.note(&orders, speed_mps, !self.seen.harmful.is_empty());
        }
        Ok(self.has_come_to_rest(speed_mps, &orders))
    }

    /// Whether the ego has stood long enough for perception's sake, not for a red light's, and why.
    fn has_come_to_rest(&mut self, speed_mps: f64, orders: &EgoOrders) -> Option<End> {
        // The zone of a car that stands has no depth: what lies right before it is what it stands for, too.
        let reflex = &self.config.reflex;
        let holds_up = |(i, object): &&(usize, Object)| {
            self.seen.harmful.contains(i) || reflex.is_near(&object.solid_in_ego(), car::FRONT_BUMPER_X_M)
        };
        let held_up_by: Vec<usize> = self.seen.present.iter().filter(holds_up).map(|(i, _)| *i).collect();
        let now = AtRest {
            stands: speed_mps < STANDS_MPS,
            is_ordered: orders.braking_mps2.is_some(),
            waits_at_line: self.live.ego_waits_at_line(),
            is_harmed: !held_up_by.is_empty(),
            all_move: held_up_by.iter().all(|&i| self.live.moves_by_itself(i)),
        };
        self.notes.rest.after(now, self.config.standing_s)
    }

    fn note_braking(&mut self, time_s: f64, speed_mps: f64, orders: &EgoOrders) {
        let since_m = self.notes.distance_m - self.seen.at_m;
        let Notes { has_braked, first_brake_ttc_s, .. } = &mut self.notes;
        let moves = speed_mps > STANDS_MPS;
        if orders.braking_mps2.is_some() && moves && !self.seen.harmful.is_empty() && !*has_braked {
            *has_braked = true;
            let bumper_m = car::FRONT_BUMPER_X_M;
            let ttc_s = |object: &Object| {
                let corners = object.solid_in_ego().footprint();
                let ahead_m =
                    corners.iter().map(|corner| corner.x_m - bumper_m).fold(f64::INFINITY, f64::min);
                let closing_mps = speed_mps - object.velocity_in_ego_mps[0];
                (closing_mps > LEAST_CLOSING_MPS).then(|| (ahead_m - since_m).max(0.0) / closing_mps)
            };
            let harmful = self.seen.present.iter().filter(|(i, _)| self.seen.harmful.contains(i));
            *first_brake_ttc_s = harmful.filter_map(|(_, object)| ttc_s(object)).min_by(f64::total_cmp);
        }
        // A hazard may be remembered, and the truth is known at samples alone.
        let reflex = &self.config.reflex;
        let remembered_s = reflex.free_s + self.delay_s + self.config.world.sample_period_s;
        let is_right =
            self.seen.any_harmful_s.is_some_and(|harmful_s| time_s - harmful_s <= remembered_s + 1e-9);
        let braking_mps2 = orders.braking_mps2.unwrap_or(0.0);
        let order = Order { time_s, speed_mps, braking_mps2, moves, is_right };
        self.notes.hard_stops.note(&order);
        self.notes.brakes.note(&order);
    }

    fn note_contact(&mut self, time_s: f64, contact: &Contact) {
        let object = contact.object_idx.map(|i| &self.live.objects()[i]);
        let id = object.map_or_else(|| format!("scenery-{}", contact.body), |object| object.id.clone());
        let ego_mps = contact.ego_mps.xy().norm();
        let approach_mps = contact.ego_mps.dot(&contact.normal);
        // What stands still has come to nobody, however slowly it is touched.
        let moves = contact.other_mps.norm() >= STANDS_MPS;
        let comes_mps = -contact.other_mps.dot(&contact.normal);
        let is_struck = if moves {
            // What leaves as fast as the ego comes has brushed it in passing.
            ego_mps < STANDS_MPS || approach_mps < LEAST_APPROACH_MPS || approach_mps + comes_mps <= 0.0
        } else {
            ego_mps < AT_REST_MPS || (ego_mps < STANDS_MPS && comes_mps > approach_mps.max(0.0))
        };
        let has_struck = self.notes.struck_by.contains(&id);
        if is_struck || (has_struck && approach_mps < PUSHES_MPS) {
            if !has_struck {
                self.notes.struck_by.push(id);
            }
            return;
        }
        if self.notes.collision.is_some() {
            return;
        }
        let relative_mps = contact.ego_mps - contact.other_mps;
        let along_mps = relative_mps.dot(&contact.normal).max(0.0);
        let reduced_kg = if contact.mass_kg.is_finite() {
            self.ego_kg * contact.mass_kg / (self.ego_kg + contact.mass_kg)
        } else {
            self.ego_kg
        };
        let set_off = contact.object_idx.and_then(|i| self.seen.set_off.get(&i));
        let set_off = set_off.map(|&[set_off_s, speed_mps]| [time_s - set_off_s, speed_mps]);
        let harmful_s = contact.object_idx.and_then(|i| self.seen.harmful_s.get(&i));
        self.notes.collision = Some(Collision {
            time_s,
            category: object.map_or_else(|| "scenery".to_owned(), |object| object.category.clone()),
            object: id,
            kind: object.map(|object| object.kind),
            distribution: object.map(|object| object.distribution),
            event: object.map_or(Event::None, |object| object.event),
            spot: object.map_or(Spot::None, |object| object.spot),
            is_background: object.is_some_and(|object| object.is_background),
            impact_mps: along_mps,
            relative_mps: Some(relative_mps.norm()),
            ego_mps,
            energy_j: reduced_kg * along_mps * along_mps / 2.0,
            set_off_s: set_off.map(|[set_off_s, _]| set_off_s),
            // By the speed then: who brakes makes nothing less sudden.
            is_sudden: set_off.is_some_and(|[set_off_s, speed_mps]| is_sudden(set_off_s, speed_mps)),
            was_harmful: harmful_s.is_some_and(|harmful_s| time_s - harmful_s <= HARMFUL_BEFORE_S),
        });
    }
}
