//! Advances a world, and tells what a body touches meanwhile.

use nalgebra::{Isometry3, Vector3};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use super::{SimError, Simulator};

/// A body that another one has come to touch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Touch {
    pub body: usize,
    /// Velocity of the one that touches, just before, at the point where they touch, along the world's axes.
    pub own_mps: Vector3<f64>,
    /// The same of the touched one; zero where it is moved by hand.
    pub other_mps: Vector3<f64>,
    /// Out of the one that touches, where MuJoCo would push it away: the shortest way out of what has sunk in within a step.
    pub normal: Vector3<f64>,
    /// Where they touch, in the frame of the one that touches.
    pub point_m: Vector3<f64>,
}

/// Controls, and poses of bodies that are moved by hand, as Python takes them.
type Inputs<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<i64>>, Bound<'py, PyArray2<f64>>);

impl Simulator {
    /// Sets the controls and the poses of mocap bodies (by mocap number), then advances `n_steps`.
    ///
    /// # Errors
    /// The physics became unstable, or sizes do not fit.
    pub fn step(
        &mut self,
        ctrl: &[f64],
        mocap: &[(usize, Isometry3<f64>)],
        n_steps: usize,
    ) -> Result<(), SimError> {
        self.ask("step", |world| {
            let (ctrl, ids, poses) = inputs(world.py(), ctrl, mocap)?;
            world.call_method1("step", (ctrl, ids, poses, n_steps)).map(drop)
        })
    }

    /// As [`Self::step`], and tells what a free body touches on the way, other than the geom `ground`; each body once.
    ///
    /// # Errors
    /// As [`Self::step`]; there is no such geom.
    pub fn step_touching(
        &mut self,
        ctrl: &[f64],
        mocap: &[(usize, Isometry3<f64>)],
        n_steps: usize,
        body: usize,
        ground: &str,
    ) -> Result<Vec<Touch>, SimError> {
        self.ask("step", |world| {
            let (ctrl, ids, poses) = inputs(world.py(), ctrl, mocap)?;
            let told = world.call_method1("step_touching", (ctrl, ids, poses, n_steps, body, ground))?;
            let (bodies, facts): (PyReadonlyArray1<'_, i32>, PyReadonlyArray2<'_, f64>) = told.extract()?;
            let (facts, _) = facts.as_slice()?.as_chunks::<12>();
            let touch = |(&body, &[a, b, c, d, e, f, g, h, i, x, y, z]): (&i32, &[f64; 12])| Touch {
                body: usize::try_from(body).expect("bodies are numbered from 0"),
                own_mps: Vector3::new(a, b, c),
                other_mps: Vector3::new(d, e, f),
                normal: Vector3::new(g, h, i),
                point_m: Vector3::new(x, y, z),
            };
            Ok(bodies.as_slice()?.iter().zip(facts).map(touch).collect())
        })
    }

    /// Mass of every body with all that hangs on it, kilograms, by body id.
    ///
    /// # Errors
    /// As [`Self::body_poses`].
    pub fn body_masses(&self) -> Result<Vec<f64>, SimError> {
        self.ask("tell masses", |world| {
            let masses: PyReadonlyArray1<'_, f64> = world.call_method0("body_masses")?.extract()?;
            Ok(masses.as_slice()?.to_vec())
        })
    }
}

fn inputs<'py>(py: Python<'py>, ctrl: &[f64], mocap: &[(usize, Isometry3<f64>)]) -> PyResult<Inputs<'py>> {
    let ids: Vec<i64> = mocap.iter().map(|&(id, _)| id as i64).collect();
    let poses: Vec<f64> = mocap
        .iter()
        .flat_map(|(_, Isometry3 { translation: p, rotation: q })| [p.x, p.y, p.z, q.w, q.i, q.j, q.k])
        .collect();
    let poses = PyArray1::from_vec(py, poses).reshape([mocap.len(), 7])?;
    Ok((PyArray1::from_slice(py, ctrl), PyArray1::from_vec(py, ids), poses))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::simulator::tests::{XML, mount};

    /// The ego, without weight, slides at 5 m/s, and turns so fast, to a cube whose face is 9 m ahead; its own front is at 4 m.
    /// What it touches first, in which step, and its mass.
    fn slide(spin_rps: f64) -> (usize, Touch, f64, Simulator) {
        let xml = XML.replace("timestep=\"0.005\"", "timestep=\"0.005\" gravity=\"0 0 0\"").replace(
            "size=\"2 1 1\" group=\"4\" contype=\"0\" conaffinity=\"0\"",
            "size=\"2 1 1\" group=\"4\"",
        );
        let mut sim = Simulator::new(&xml, &[], &mount()).unwrap();
        let ego = sim.body("ego").unwrap();
        sim.ask("set a velocity", |world| {
            let velocities = world.getattr("data")?.getattr("qvel")?;
            velocities.set_item(0, 5.0)?;
            velocities.set_item(5, spin_rps)
        })
        .unwrap();
        for step in 0..30 {
            let touches = sim.step_touching(&[], &[], 10, ego, "ground").unwrap();
            if let [touch] = touches[..] {
                let mass_kg = sim.body_masses().unwrap()[ego];
                return (step, touch, mass_kg, sim);
            }
            assert!(touches.is_empty(), "{touches:?}");
        }
        panic!("it has touched nothing")
    }

    #[test]
    fn what_a_sliding_body_runs_into_is_told_once_with_both_velocities() {
        let (step, touch, mass_kg, sim) = slide(0.0);
        assert_eq!(touch.body, sim.body("obj:cube").unwrap());
        // 5 m at 5 m/s: in the 20th twentieth of a second, or just after.
        assert!((19..=20).contains(&step), "{step}");
        assert!((touch.own_mps.x - 5.0).abs() < 1e-6 && touch.other_mps.norm() < 1e-12, "{touch:?}");
        assert!(touch.normal.x > 0.99, "{touch:?}");
        // On its front, or as far in as it slides in a step.
        assert!((touch.point_m.x - 4.0).abs() < 0.03 && touch.point_m.y.abs() <= 1.0, "{touch:?}");
        // 4 x 2 x 2 m at MuJoCo's density of water.
        assert!((mass_kg - 16_000.0).abs() < 1e-6, "{mass_kg}");
    }

    #[test]
    fn a_body_that_turns_touches_with_the_velocity_of_the_corner_that_touches() {
        let (_, touch, ..) = slide(0.2);
        // Its centre, 2 m ahead of the origin that set out at 5 m/s, goes straight on; a corner is 2 m ahead of it and 1 m aside.
        let of_corner = touch.own_mps - Vector3::new(5.0, 0.4, 0.0);
        assert!((of_corner.xy().norm() - 0.2 * 5_f64.sqrt()).abs() < 0.01, "{touch:?}");
    }
}
