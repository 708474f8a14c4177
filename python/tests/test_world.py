"""Questions to MuJoCo with answers that can be checked by hand: one wall ten metres ahead."""

import numpy as np
import pytest
from harmzone_sim.camera import Camera
from harmzone_sim.rays import cast_rays
from harmzone_sim.world import World

SCENE = """
<mujoco>
  <visual><global offwidth="80" offheight="60"/></visual>
  <worldbody>
    <light directional="true" dir="0 0 -1" pos="0 0 10"/>
    <geom name="ground" type="plane" size="50 50 1" group="0"/>
    <geom name="wall" type="box" pos="10.5 0 1" size="0.5 20 30" group="1"/>
    <geom name="unseen" type="box" pos="5 0 1" size="0.1 5 5" group="3"/>
    <body name="ego" pos="0 0 1">
      <freejoint/>
      <geom name="own" type="box" pos="2 0 0" size="0.2 2 2" group="4" mass="1"/>
    </body>
  </worldbody>
</mujoco>
"""
# Looks along +x with z up: MuJoCo's cameras look along -z with y up.
FORWARD = np.array([0.5, 0.5, -0.5, -0.5])


@pytest.fixture(scope="module")
def world():
    return World(SCENE, {}, "ego", [(np.array([0.0, 0.0, 0.5]), FORWARD, 60.0, (80, 60))], 0, 256)


def test_a_ray_meets_the_wall_and_passes_collision_shapes_and_the_own_car(world):
    directions = np.array([[1.0, 0.0, 0.0], [0.8, 0.6, 0.0], [-1.0, 0.0, 0.0]])
    range_m, geom_id, cos_incidence = cast_rays(world, np.array([0.0, 0.0, 1.0]), directions, 70.0)
    assert range_m[:2] == pytest.approx([10.0, 12.5])
    assert [world.names("geom")[i] for i in geom_id[:2]] == ["wall", "wall"]
    assert cos_incidence[:2] == pytest.approx([1.0, 0.8])
    assert np.isinf(range_m[2]) and geom_id[2] == -1


def test_beyond_its_range_a_ray_meets_nothing(world):
    directions = np.array([[1.0, 0.0, 0.0]])
    range_m, geom_id, _ = cast_rays(world, np.array([0.0, 0.0, 1.0]), directions, 9.0)
    assert np.isinf(range_m[0]) and geom_id[0] == -1


def test_the_camera_sees_the_wall_above_the_ground(world):
    camera = Camera(world)
    camera.draw()
    segments = camera.geoms()
    names = world.names("geom")
    assert segments.shape == (60, 80)
    assert names[segments[5, 40]] == "wall" and names[segments[59, 40]] == "ground"
    assert camera.rgb().shape == (60, 80, 3)


def test_an_unknown_body_is_named():
    with pytest.raises(ValueError, match="nobody"):
        World(SCENE, {}, "nobody", [(np.zeros(3), FORWARD, 60.0, (80, 60))], 0, 256)
