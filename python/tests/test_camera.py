"""Pictures beside those of MuJoCo's own renderer, which draws every geom in a pass for each light."""

import itertools

import mujoco
import numpy as np
import pytest
from harmzone_sim.camera import Camera
from harmzone_sim.drawing import Drawing
from harmzone_sim.hidden import Depths, Shown
from harmzone_sim.view import View
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

    def counting(self, corners_m):
        counts.append(int(hides(self, corners_m).sum()))
        return hides(self, corners_m)

    for function in (counting, lambda self, corners_m: np.zeros(len(corners_m), dtype=bool)):
        monkeypatch.setattr(Depths, "hides", function)
        camera = Camera(world)
        camera.draw()
        shown.append((camera.rgb(), camera.geoms(), camera.depth_m()))
        camera.close()
    assert counts[0] >= 1
    assert all(np.array_equal(ours, full) for ours, full in zip(*shown, strict=True))


def test_a_wall_across_the_view_does_not_hide_itself():
    near_m, far_m = 0.1, 500.0
    projection = np.diag([1 / 0.8, 1 / 0.6, -(far_m + near_m) / (far_m - near_m), 0.0])
    projection[2, 3], projection[3, 2] = -2 * far_m * near_m / (far_m - near_m), -1.0
    view = View.make(np.zeros(3), np.eye(3), near_m, far_m, projection)
    for depth_m in (0.5, 20.0, 300.0):
        depth = near_m * (far_m / depth_m - 1) / (far_m - near_m)
        depths = Depths(view, np.full((240, 320), depth, dtype=np.float32))
        signs = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))

        nearest_m = [depth_m, 1.01 * depth_m, 0.9 * depth_m]
        corners_m = np.array([signs * [0.3, 0.2, 0.5] - [0.0, 0.0, near + 0.5] for near in nearest_m])
        assert depths.hides(corners_m).tolist() == [False, True, False], depth_m


def test_what_casts_no_shadow_into_the_picture_is_left_out_and_the_picture_stays_the_same(monkeypatch):
    # Shadows of some slabs fall into the view, and those of others far beside it.
    posts = "".join(
        f'<geom type="mesh" mesh="slab" material="tiles" pos="{x} {y} 0" group="1"/>'
        for x in (4, 8, 16, 30)
        for y in (-30, -12, 3, 6, 14, 25, 60)
    )
    slab = (
        '<mesh name="slab" vertex="0 -1 0 0 1 0 0 1 3 0 -1 3 .2 -1 0 .2 1 0 .2 1 3 .2 -1 3" texcoord="{}"/>'
    )
    xml = SCENE.replace("CAST", "true").replace("</worldbody>", posts + "</worldbody>")
    xml = xml.replace("</asset>", slab.format("0 0 1 0 1 1 0 1 0 0 1 0 1 1 0 1") + "</asset>")
    world = World(xml, {}, "ego", [(np.array([0.0, 0.0, 1.5]), FORWARD, 50.0, SIZE_PX)], 0, 1024)
    shown, counts, meets = [], [], Shown.meets

    def counting(self, lows, highs):
        met = meets(self, lows, highs)
        counts.append((int(met.sum()), int((~met).sum())))
        return met

    for function in (counting, lambda self, lows, highs: np.ones(len(lows), dtype=bool)):
        monkeypatch.setattr(Shown, "meets", function)
        camera = Camera(world)
        camera.draw()
        shown.append(camera.rgb())
        camera.close()
    assert min(counts[0]) >= 1, counts
    assert np.array_equal(*shown)


def test_a_box_meets_the_cells_in_which_something_is_shown_and_no_other():
    shown = Shown(np.zeros(2), np.full(2, 64.0), np.array([[10.5, 20.5]]), np.array([[10.6, 20.6]]), 0.0)
    cells = np.array([(10, 20), (9, 20), (11, 20), (10, 19), (10, 21), (20, 10)], dtype=float)
    assert shown.meets(cells + 0.2, cells + 0.8).tolist() == [True, False, False, False, False, False]
    # Over many cells, and with a margin that reaches the next cell.
    assert shown.meets(np.array([[3.0, 3.0]]), np.array([[40.0, 40.0]])).all()
    wide = Shown(np.zeros(2), np.full(2, 64.0), np.array([[10.5, 20.5]]), np.array([[10.6, 20.6]]), 0.6)
    assert wide.meets(cells + 0.2, cells + 0.8).tolist() == [True, True, True, True, True, False]
    nothing = Shown(np.zeros(2), np.full(2, 64.0), np.zeros((0, 2)), np.zeros((0, 2)), 1.0)
    assert not nothing.meets(cells, cells + 1).any()


def test_all_that_a_picture_shows_lies_in_the_boxes_of_its_tiles():
    near_m, far_m, size_px = 0.1, 500.0, (47, 33)
    projection = np.diag([1 / 0.8, 1 / 0.6, -(far_m + near_m) / (far_m - near_m), 0.0])
    projection[2, 3], projection[3, 2] = -2 * far_m * near_m / (far_m - near_m), -1.0
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    view = View.make(np.array([4.0, -3.0, 2.0]), turn, near_m, far_m, projection)
    depth_m = np.full(size_px[::-1], 80.0)
    depth_m[4, 41], depth_m[22:25, 12:15] = 3.0, 17.0
    depth_m[28:, 33:] = np.inf
    depth = np.where(np.isinf(depth_m), 0.0, near_m * (far_m / depth_m - 1) / (far_m - near_m))
    axes = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0][:2]
    lows, highs = Depths(view, depth.astype(np.float32)).boxes(axes)
    row, column = np.nonzero(np.isfinite(depth_m))
    for shift_x, shift_y in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)):
        x = ((column + shift_x) / size_px[0] * 2 - 1) * 0.8
        y = (1 - (row + shift_y) / size_px[1] * 2) * 0.6
        ways = x[:, None] * turn[0] + y[:, None] * turn[1] - turn[2]
        places = (view.eye_m + ways * depth_m[row, column][:, None]) @ axes.T
        inside = (places[:, None] >= lows - 1e-3) & (places[:, None] <= highs + 1e-3)
        assert inside.all(axis=2).any(axis=1).all()
    # Not all of the scene: a tile's box is smaller than the picture's.
    assert ((highs - lows) < 0.7 * (highs.max(axis=0) - lows.min(axis=0))).all(axis=1).mean() > 0.8


def test_boxes_of_turned_bodies_reach_as_far_as_their_corners():
    world = a_world(False)
    drawing = Drawing(world.model, world.data, None)
    body = world.model.body("mover").id
    world.step(np.zeros(0), np.array([0]), np.array([[13.0, 1.0, 0.5, 0.8, 0.1, 0.2, 0.55]]), 0)
    chunks = np.flatnonzero(drawing.body == body)
    corners_m = drawing.corners_in_world_m(world.data, chunks)
    wedge = np.array([(0, 0, 0), (2, 0, 0), (0, 2, 0), (2, 2, 0), (0, 0, 2), (0, 2, 2)], dtype=float)
    turn = world.data.xmat[body].reshape(3, 3)
    axes = np.vstack([np.eye(3), [0.6, 0.0, 0.8]])
    along_m = (wedge @ turn.T + world.data.xpos[body]) @ axes.T
    boxes_m = corners_m[0] @ axes.T
    assert len(chunks) == 1
    # The wedge has a corner at or near each side of its box, but for those along the slope.
    assert (boxes_m.min(axis=0) <= along_m.min(axis=0)).all() and (
        boxes_m.max(axis=0) >= along_m.max(axis=0)
    ).all()
    center_m = drawing.centers_in_world_m(world.data)[chunks[0]] @ axes.T
    reach_m = drawing.reach_along_m(world.data, axes)[chunks[0]]
    np.testing.assert_allclose(boxes_m.max(axis=0) - center_m, reach_m, atol=1e-9)
    assert (boxes_m.max(axis=0) - boxes_m.min(axis=0) < 4.1).all()


@pytest.mark.parametrize("pitch_deg", [0, 20, 40, 60, 90, -90])
def test_shadows_fall_into_the_picture_whichever_way_the_camera_looks(monkeypatch, pitch_deg):
    # A wall throws its shadow on a wide plain before a camera that may look down at it, or at the sky alone.
    wall = '<geom type="box" pos="-8 -4 8" size="0.2 8 8" group="1"/>'
    xml = SCENE.replace("CAST", "true").replace('size="60 60 1"', 'size="600 600 1"')
    xml = xml.replace('<geom type="box" pos="-4 -2 8" size="0.2 4 8" group="1"/>', wall)
    turn = np.empty(4)
    mujoco.mju_axisAngle2Quat(turn, np.array([0.0, 1.0, 0.0]), np.radians(pitch_deg))
    quaternion = np.empty(4)
    mujoco.mju_mulQuat(quaternion, turn, FORWARD)
    world = World(xml, {}, "ego", [(np.array([0.0, 0.0, 0.5]), quaternion, 50.0, SIZE_PX)], 0, 1024)
    camera = Camera(world)
    camera.draw()
    ours = camera.rgb()
    camera.close()
    own = mujocos_own(world)[0]
    assert np.abs(ours.astype(int) - own).mean() < 1.0


def test_a_light_that_is_not_parallel_is_refused():
    xml = SCENE.replace('directional="true" castshadow="CAST"', 'directional="false"')
    world = World(xml, {}, "ego", [(np.zeros(3), FORWARD, 50.0, SIZE_PX)], 0, 256)
    with pytest.raises(ValueError, match="parallel"):
        Camera(world)
