"""Pictures beside those of MuJoCo's own renderer, which draws every geom in a pass for each light."""

import mujoco
import numpy as np
import pytest
from harmzone_sim.camera import Camera
from harmzone_sim.hidden import Depths
from harmzone_sim.world import World

SIZE_PX = (320, 180)
# One of each shape, some textured or shining; a wall behind the camera throws its shadow ahead.
SCENE = """
<mujoco>
  <statistic extent="30" center="0 0 0"/>
  <visual><global offwidth="320" offheight="180"/>
    <quality shadowsize="1024" numslices="10" numstacks="6" numquads="1"/>
    <headlight ambient="0.4 0.4 0.45" diffuse="0.12 0.12 0.12" specular="0 0 0"/>
    <map znear="0.008" zfar="8"/></visual>
  <asset>
    <texture name="tiles" type="2d" builtin="checker" rgb1="0.8 0.3 0.2" rgb2="0.2 0.5 0.3"
      width="64" height="64"/>
    <material name="tiles" texture="tiles" texrepeat="0.5 0.5" texuniform="true" specular="0"/>
    <material name="paint" rgba="0.7 0.1 0.1 1" specular="0.8" shininess="0.7"/>
    <material name="lamp" rgba="0.9 0.9 0.2 1" emission="0.6"/>
    <mesh name="wedge" vertex="0 0 0 2 0 0 0 2 0 2 2 0 0 0 2 0 2 2"/>
  </asset>
  <worldbody>
    <light name="sun" directional="true" castshadow="CAST" pos="-36 -18 44" dir="0.6 0.3 -0.74"
      diffuse="0.6 0.6 0.5" specular="0.3 0.3 0.3"/>
    <geom name="ground" type="plane" size="60 60 1" material="tiles" group="0"/>
    <geom type="box" pos="12 -3 1" size="0.8 1 1" material="paint" group="1"/>
    <geom type="box" pos="-4 -2 8" size="0.2 4 8" group="1"/>
    <geom type="sphere" pos="8 -1 1" size="0.8" material="paint" group="2"/>
    <geom type="ellipsoid" pos="9 2 1" size="0.5 1 0.7" material="paint" group="2"/>
    <geom type="capsule" pos="7 1 1" size="0.3 0.6" euler="40 20 0" rgba="0.2 0.3 0.9 1" group="2"/>
    <geom type="cylinder" pos="10 4 1" size="0.5 1" material="lamp" group="2"/>
    <body name="mover" mocap="true" pos="14 3 0" euler="0 0 30">
      <geom type="mesh" mesh="wedge" material="paint" group="2"/></body>
    <geom name="unseen" type="box" pos="5 0 1" size="0.1 5 5" group="3"/>
    <body name="ego" pos="0 0 1"><freejoint/>
      <geom type="box" pos="2 0 0" size="0.2 2 2" group="4" mass="1"/></body>
  </worldbody>
</mujoco>
"""
FORWARD = np.array([0.5, 0.5, -0.5, -0.5])


def a_world(casts: bool, n_samples: int = 0, shadow_px: int = 1024) -> World:
    xml = SCENE.replace("CAST", str(casts).lower())
    return World(xml, {}, "ego", [(np.array([0.0, 0.0, 0.5]), FORWARD, 50.0, SIZE_PX)], n_samples, shadow_px)


def mujocos_own(world: World) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    option = mujoco.MjvOption()
    option.geomgroup[:] = (1, 1, 1, 0, 0, 0)
    with mujoco.Renderer(world.model, SIZE_PX[1], SIZE_PX[0]) as renderer:
        renderer.update_scene(world.data, world.camera_ids[0], option)
        rgb = renderer.render()
        renderer.enable_depth_rendering()
        depth_m = renderer.render()
        renderer.disable_depth_rendering()
        renderer.enable_segmentation_rendering()
        return rgb, depth_m, renderer.render()[..., 0]


@pytest.mark.parametrize(("casts", "n_samples"), [(True, 0), (False, 0), (True, 4)])
def test_colours_depths_and_geoms_are_those_of_mujocos_own_renderer(casts, n_samples):
    world = a_world(casts, n_samples)
    world.step(np.zeros(0), np.array([0]), np.array([[13.0, 2.0, 0.0, 1.0, 0.0, 0.0, 0.0]]), 0)
    camera = Camera(world)
    camera.draw()
    rgb, depth_m, geoms = mujocos_own(world)
    ours = camera.rgb().astype(int)
    # Shadows have soft edges in place of steps, of a colour between those of MuJoCo's pixels two around, and
    # each of its passes rounds.
    sides = np.pad(rgb.astype(int), ((2, 2), (2, 2), (0, 0)), mode="edge")
    around = np.lib.stride_tricks.sliding_window_view(sides, (5, 5), axis=(0, 1))
    beyond = np.maximum(around.min(axis=(-2, -1)) - ours, ours - around.max(axis=(-2, -1))).max(axis=-1)
    assert np.mean(beyond <= 3) > 0.998 and np.abs(ours - rgb).max(axis=-1).mean() < 0.7
    assert np.mean(camera.geoms() == geoms) > (0.999 if n_samples == 0 else 0.98)
    seen = camera.geoms() >= 0
    assert np.isinf(camera.depth_m()[~seen]).all()
    same = seen & (camera.geoms() == geoms)
    if n_samples == 0:
        assert np.allclose(camera.depth_m()[same], depth_m[same], rtol=2e-3)
    camera.close()


def test_a_shadow_thrown_from_behind_the_camera_lies_in_the_picture():
    pictures = []
    for casts in (True, False):
        camera = Camera(a_world(casts))
        camera.draw()
        pictures.append(camera.rgb().astype(float).mean(axis=-1))
        camera.close()
    lit, unlit = pictures[1][-20:].mean(), pictures[0][-20:].mean()
    assert unlit < 0.8 * lit


def test_what_moves_is_drawn_where_it_is_now_and_in_its_present_colour():
    world = a_world(False)
    camera = Camera(world)
    wedge = int(np.flatnonzero(world.model.geom_bodyid == world.model.body("mover").id)[0])
    columns, colours = [], []
    for y_m, material in ((3.0, "paint"), (-3.0, "lamp")):
        world.step(np.zeros(0), np.array([0]), np.array([[13.0, y_m, 0.0, 1.0, 0.0, 0.0, 0.0]]), 0)
        world.model.geom_matid[wedge] = world.model.material(material).id
        camera.draw()
        shown = camera.geoms() == wedge
        columns.append(np.flatnonzero(shown.any(axis=0)).mean())
        colours.append(camera.rgb()[shown].mean(axis=0))
    camera.close()
    assert columns[0] < SIZE_PX[0] / 2 < columns[1]
    assert colours[0][1] < 60 < colours[1][1]


def test_what_a_wall_hides_is_left_out_and_the_picture_stays_the_same(monkeypatch):
    wall = '<geom type="mesh" mesh="slab" material="tiles" pos="6 0 0" group="1"/>'
    slab = (
        '<mesh name="slab" vertex="0 -3 0 0 1 0 0 1 4 0 -3 4 .2 -3 0 .2 1 0 .2 1 4 .2 -3 4" texcoord="{}"/>'
    )
    xml = SCENE.replace("CAST", "true").replace("</worldbody>", wall + "</worldbody>")
    xml = xml.replace("</asset>", slab.format("0 0 1 0 1 1 0 1 0 0 1 0 1 1 0 1") + "</asset>")
    world = World(xml, {}, "ego", [(np.array([0.0, 0.0, 0.5]), FORWARD, 50.0, SIZE_PX)], 0, 1024)
    shown, hides = [], Depths.hides
    counts = []

    def counting(self, center_m, radius_m):
        counts.append(int(hides(self, center_m, radius_m).sum()))
        return hides(self, center_m, radius_m)

    for function in (counting, lambda self, center_m, radius_m: np.zeros(len(center_m), dtype=bool)):
        monkeypatch.setattr(Depths, "hides", function)
        camera = Camera(world)
        camera.draw()
        shown.append((camera.rgb(), camera.geoms(), camera.depth_m()))
        camera.close()
    assert counts[0] >= 1
    assert all(np.array_equal(ours, full) for ours, full in zip(*shown, strict=True))


def test_a_light_that_is_not_parallel_is_refused():
    xml = SCENE.replace('directional="true" castshadow="CAST"', 'directional="false"')
    world = World(xml, {}, "ego", [(np.zeros(3), FORWARD, 50.0, SIZE_PX)], 0, 256)
    with pytest.raises(ValueError, match="parallel"):
        Camera(world)
