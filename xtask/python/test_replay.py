"""Noted calls to MuJoCo, issued again: the same work, or an error."""

import mujoco
import numpy as np
import pytest
from harmzone_sim.camera import Camera
from harmzone_sim.rays import cast_rays
from harmzone_sim.world import World
from replay import CallLog

# One wall ten metres ahead of the body that carries the camera.
SCENE = """
<mujoco>
  <visual><global offwidth="80" offheight="60"/></visual>
  <worldbody>
    <light pos="0 0 10"/>
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


def frame(world, camera):
    ctrl, ids, poses = np.zeros(0), np.zeros(0, dtype=np.int64), np.zeros((0, 7))
    world.step(ctrl, ids, poses, 5)
    camera.update()
    camera.rgb()
    camera.segmentation()
    cast_rays(world, np.array([0.0, 0.0, 1.0]), np.array([[1.0, 0.0, 0.0]]), 70.0)


def test_noted_calls_are_issued_again_and_end_in_the_same_picture():
    world = World(SCENE, {}, "ego", np.array([0.0, 0.0, 0.5]), FORWARD, 60.0, (80, 60), 0, 256)
    camera = Camera(world)
    mj_step = mujoco.mj_step
    log = CallLog(world, camera)
    assert mujoco.mj_step is not mj_step
    for _ in range(3):
        frame(world, camera)
    after = world.data.qpos.copy()
    seconds = log.replay()
    assert mujoco.mj_step is mj_step
    assert np.array_equal(world.data.qpos, after)
    assert all(spent > 0 for spent in seconds.values()) and "mj_multiRay" in seconds


def test_calls_that_end_in_another_picture_are_told():
    world = World(SCENE, {}, "ego", np.array([0.0, 0.0, 0.5]), FORWARD, 60.0, (80, 60), 0, 256)
    camera = Camera(world)
    log = CallLog(world, camera)
    frame(world, camera)
    # The wall is moved behind the log's back.
    world.model.geom("wall").pos[0] += 5.0
    with pytest.raises(RuntimeError, match="another picture"):
        log.replay()
