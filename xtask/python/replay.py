"""What a plain MuJoCo user issues for a world's frames, whatever the world's driver itself calls."""

import time
from collections.abc import Callable

import mujoco
import numpy as np
from harmzone_sim.world import Array, World

# What the frames cannot do without.
_TIMED = ("mj_step", "mjv_updateScene", "mjr_render", "mjr_readPixels", "mj_multiRay")
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION.value
# Ground, static scene and objects; neither collision shapes nor the own car.
_VISIBLE_GROUPS = [1, 1, 1, 0, 0, 0]


def _state(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """All that a step starts from, controls and mocap poses included."""
    state = np.empty(mujoco.mj_stateSize(model, _STATE))
    mujoco.mj_getState(model, data, state, _STATE)
    return state


class StepLog:
    """Notes the steps of one world until `replay` or `stop`."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._begin = _state(world.model, world.data)
        self._steps: list[tuple[Array, int]] = []
        self._mj_step = mujoco.mj_step
        mujoco.mj_step = self._note_step

    def stop(self) -> None:
        """Notes no more steps."""
        mujoco.mj_step = self._mj_step

    def replay(
        self,
        n_samples: int,
        ego_body: str,
        lidar_position_m: Array,
        directions: Array,
        max_range_m: float,
        with_depth: bool,
    ) -> dict[str, float]:
        """Steps again from the noted states; each sample's picture and segmentation are drawn, its rays cast.

        The first sample is of the state in which the log began, and each has as many steps.
        lidar_position_m: [3], directions: [ray, 3], unit vectors, both in the frame of `ego_body`.
        with_depth: the depths are read with a picture.
        Returns the seconds spent in each function. Raises RuntimeError if it ends in another state than the
        world did, since it then were not the same work.
        """
        self.stop()
        model, data = self._world.model, self._world.data
        ended = _state(model, data)
        n_steps, n_left = divmod(len(self._steps), max(n_samples - 1, 1))
        if n_left:
            raise RuntimeError(f"{len(self._steps)} steps are not as many for each of {n_samples} samples")
        stopwatch = Stopwatch()
        plain = PlainSensors(self._world, ego_body, lidar_position_m, directions, max_range_m, with_depth)
        mujoco.mj_setState(model, data, self._begin, _STATE)
        plain.see(Stopwatch())  # The first pictures compile shaders, which belongs to no frame.
        for sample in range(n_samples):
            first = (sample - 1) * n_steps
            for before, n in self._steps[max(first, 0) : max(first + n_steps, 0)]:
                mujoco.mj_setState(model, data, before, _STATE)
                stopwatch.time("mj_step", mujoco.mj_step, model, data, n)
            plain.see(stopwatch)
        plain.close()
        if not np.array_equal(_state(model, data), ended):
            raise RuntimeError("the steps, issued again, ended in another state")
        return stopwatch.spent_s

    def _note_step(self, model: mujoco.MjModel, data: mujoco.MjData, nstep: int = 1) -> None:
        self._steps.append((_state(model, data), nstep))
        self._mj_step(model, data, nstep)


class Stopwatch:
    """Seconds by name."""

    def __init__(self) -> None:
        self.spent_s = dict.fromkeys(_TIMED, 0.0)

    def time(self, name: str, function: Callable, *args: object) -> None:
        """Calls a function and adds what it takes."""
        begin = time.perf_counter()
        function(*args)
        self.spent_s[name] += time.perf_counter() - begin


class PlainSensors:
    """Camera and LiDAR of a world by MuJoCo's own functions, with an OpenGL context of their own."""

    def __init__(
        self,
        world: World,
        ego_body: str,
        lidar_position_m: Array,
        directions: Array,
        max_range_m: float,
        with_depth: bool,
    ) -> None:
        self._model, self._data = world.model, world.data
        self._ego = world.model.body(ego_body).id
        self._lidar_position_m, self._directions, self._max_range_m = (
            lidar_position_m,
            directions,
            max_range_m,
        )
        width_px, height_px = world.image_sizes_px[0]
        self._gl = mujoco.GLContext(width_px, height_px)
        self._gl.make_current()
        self._rect = mujoco.MjrRect(0, 0, width_px, height_px)
        self._scene = mujoco.MjvScene(world.model, maxgeom=world.model.ngeom + 100)
        self._context = mujoco.MjrContext(world.model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._option = mujoco.MjvOption()
        self._option.geomgroup[:] = _VISIBLE_GROUPS
        self._option.sitegroup[:] = 0
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        self._camera.fixedcamid = world.camera_ids[0]
        self.pixels = np.empty((height_px, width_px, 3), dtype=np.uint8)
        self._depth = np.empty((height_px, width_px), dtype=np.float32) if with_depth else None
        n_rays = len(directions)
        self._geom_id, self.range_m = np.empty(n_rays, dtype=np.int32), np.empty(n_rays)
        self._normals = np.empty(3 * n_rays)

    def see(self, stopwatch: Stopwatch) -> None:
        """One sample of the present state."""
        model, data, scene = self._model, self._data, self._scene
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_camlight(model, data)
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        stopwatch.time(
            "mjv_updateScene",
            mujoco.mjv_updateScene,
            *(model, data, self._option, None, self._camera, everything, scene),
        )
        self.draw(stopwatch, is_segmentation=False)
        self.draw(stopwatch, is_segmentation=True)
        world_from_ego = data.xmat[self._ego].reshape(3, 3)
        origin_m = data.xpos[self._ego] + world_from_ego @ self._lidar_position_m
        rays = (self._directions @ world_from_ego.T).reshape(-1)
        groups = np.array(_VISIBLE_GROUPS, dtype=np.uint8)
        hits = (self._geom_id, self.range_m, self._normals)
        stopwatch.time(
            "mj_multiRay",
            mujoco.mj_multiRay,
            *(model, data, origin_m, rays, groups, 1, -1, *hits, len(self._directions), self._max_range_m),
        )

    def draw(self, stopwatch: Stopwatch, is_segmentation: bool) -> None:
        """A picture with shadows, or a full segmentation without, into `pixels`, row 0 at the bottom."""
        flags = self._scene.flags
        flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = is_segmentation
        flags[mujoco.mjtRndFlag.mjRND_IDCOLOR] = is_segmentation
        flags[mujoco.mjtRndFlag.mjRND_SHADOW] = not is_segmentation
        depth = None if is_segmentation else self._depth
        self._gl.make_current()
        stopwatch.time("mjr_render", mujoco.mjr_render, self._rect, self._scene, self._context)
        stopwatch.time("mjr_readPixels", mujoco.mjr_readPixels, self.pixels, depth, self._rect, self._context)

    def close(self) -> None:
        """Frees what the driver holds."""
        self._gl.make_current()
        self._context.free()
        self._gl.free()
