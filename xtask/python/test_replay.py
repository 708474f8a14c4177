"""Steps of a world, issued again with what a plain user draws and casts: the same work, or an error."""

from collections import Counter

import mujoco
import numpy as np
import pytest
from harmzone_sim.camera import Camera
from harmzone_sim.world import World
from replay import PlainSensors, StepLog, Stopwatch

# One wall ten metres ahead of the body that carries the camera.
SCENE = """
<mujoco>
  <visual><global offwidth="80" offheight="60"/><quality numquads="1"/></visual>
  <worldbody>
    <light directional="true" dir="0 0 -1" pos="0 0 10"/>
    <geom name="ground" type="plane" size="50 50 1" group="0"/>
    <geom name="wall" type="box" pos="10.5 0 1" size="0.5 20 30" group="1"/>
    <body name="ego" pos="0 0 1">
      <freejoint/>
      <geom type="box" pos="2 0 0" size="0.2 2 2" group="4" mass="1"/>
    </body>
  </worldbody>
</mujoco>
"""
FORWARD = np.array([0.5, 0.5, -0.5, -0.5])
SENSORS = {
    "ego_body": "ego",
    "lidar_position_m": np.zeros(3),
    "directions": np.array([[1.0, 0.0, 0.0]]),
    "max_range_m": 70.0,
    "with_depth": True,
}


def a_world():
    return World(SCENE, {}, "ego", [(np.array([0.0, 0.0, 0.5]), FORWARD, 60.0, (80, 60))], 0, 256)


def drive(world, n_steps):
    for _ in range(n_steps):
        world.step(np.zeros(0), np.zeros(0, dtype=np.int64), np.zeros((0, 7)), 5)


def test_the_reference_steps_draws_and_casts_for_each_sample_and_leaves_the_world_as_it_was(monkeypatch):
    world = a_world()
    log = StepLog(world)
    drive(world, 6)
    after = world.data.qpos.copy()
    log.stop()
    calls = Counter()

    def counting(name):
        original = getattr(mujoco, name)

        def call(*args):
            calls[name] += 1
            return original(*args)

        return call

    drawn = ("mjv_updateScene", "mjr_render", "mjr_readPixels", "mj_multiRay")
    for name in drawn:
        monkeypatch.setattr(mujoco, name, counting(name))
    seconds = log.replay(4, **SENSORS)
    assert np.array_equal(world.data.qpos, after)
    assert set(seconds) == {"mj_step", *drawn} and all(spent > 0 for spent in seconds.values())
    # Four samples and the warm-up: a picture and a segmentation of each.
    assert calls == {"mjv_updateScene": 5, "mjr_render": 10, "mjr_readPixels": 10, "mj_multiRay": 5}


def test_the_steps_are_noted_until_the_log_stops():
    mj_step = mujoco.mj_step
    log = StepLog(a_world())
    assert mujoco.mj_step is not mj_step
    log.stop()
    assert mujoco.mj_step is mj_step


def test_the_plain_camera_draws_what_the_worlds_own_draws_and_its_ray_meets_the_wall():
    world = a_world()
    camera = Camera(world)
    camera.draw()
    expected = camera.rgb().astype(int)
    plain = PlainSensors(world, **SENSORS)
    plain.see(Stopwatch())
    segments = plain.pixels.copy()
    assert plain.range_m == pytest.approx([10.0])
    assert len(np.unique(segments[..., 0])) > 1 and segments[..., 1:].max() == 0
    plain.draw(Stopwatch(), is_segmentation=False)
    assert np.mean(np.abs(plain.pixels[::-1] - expected) <= 2) > 0.99
    plain.close()


def test_steps_that_end_in_another_state_are_told():
    world = a_world()
    log = StepLog(world)
    drive(world, 3)
    # The world is pushed behind the log's back.
    world.data.qvel[0] += 1.0
    with pytest.raises(RuntimeError, match="another state"):
        log.replay(4, **SENSORS)


def test_samples_of_unequal_length_are_refused():
    log = StepLog(world := a_world())
    drive(world, 5)
    with pytest.raises(RuntimeError, match="5 steps"):
        log.replay(4, **SENSORS)
