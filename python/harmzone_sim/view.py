"""Where the camera and the sun look: matrices, and what lies within."""

import itertools
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Shadows fall on nothing farther than this from the camera, as a multiple of the shadow map's half width.
_SHADOWED = 1.5


@dataclass(frozen=True)
class View:
    """A view of the world; matrices are [4, 4] and act on columns.

    eye_m: [3], where it looks from. axes: [3, 3], rows right, up and back. Depth in clip coordinates runs
    from 1 (near) to 0 (far), as MuJoCo has it, which keeps digits where they count.
    """

    eye_m: Array
    axes: Array
    near_m: float
    far_m: float
    clip_from_world: Array

    @classmethod
    def make(cls, eye_m: Array, axes: Array, near_m: float, far_m: float, projection: Array) -> "View":
        """`projection` maps to depths from -1 (near) to 1 (far), as OpenGL's own matrices do."""
        view = np.eye(4)
        view[:3, :3], view[:3, 3] = axes, -axes @ eye_m
        reverse = np.diag([1.0, 1.0, -0.5, 1.0])
        reverse[2, 3] = 0.5
        return cls(eye_m, axes, near_m, far_m, reverse @ projection @ view)

    def planes(self) -> Array:
        """Sides of the view and the plane through the eye: [plane, 4], unit normals that point inwards."""
        sides = self.clip_from_world[:2]
        planes = np.concatenate([sides, -sides, np.zeros((1, 4))]) + self.clip_from_world[3]
        return planes / np.linalg.norm(planes[:, :3], axis=1, keepdims=True)


def _depth_limits_m(model: mujoco.MjModel) -> tuple[float, float]:
    extent = model.stat.extent
    return model.vis.map.znear * extent, model.vis.map.zfar * extent


def camera_view(model: mujoco.MjModel, data: mujoco.MjData, camera: int, size_px: tuple[int, int]) -> View:
    """The view of a fixed camera, as wide as the picture is."""
    near_m, far_m = _depth_limits_m(model)
    tangent = np.tan(np.radians(model.cam_fovy[camera]) / 2)
    projection = np.zeros((4, 4))
    projection[0, 0], projection[1, 1] = size_px[1] / size_px[0] / tangent, 1 / tangent
    projection[2, 2:] = np.array([-(far_m + near_m), -2 * far_m * near_m]) / (far_m - near_m)
    projection[3, 2] = -1.0
    axes = data.cam_xmat[camera].reshape(3, 3).T
    return View.make(data.cam_xpos[camera].copy(), axes, near_m, far_m, projection)


def sun_view(model: mujoco.MjModel, data: mujoco.MjData, light: int, camera: View) -> View:
    """The view of a parallel light, turned so that the camera looks along its up axis."""
    near_m, far_m = _depth_limits_m(model)
    half_m = shadow_reach_m(model)
    projection = np.diag([1 / half_m, 1 / half_m, -2 / (far_m - near_m), 1.0])
    projection[2, 3] = -(far_m + near_m) / (far_m - near_m)
    back = -data.light_xdir[light]
    side = np.cross(back, camera.axes[2])
    if np.linalg.norm(side) < 1e-3:
        side = np.cross(back, camera.axes[1])
    side /= np.linalg.norm(side)
    axes = np.stack([side, np.cross(back, side), back])
    return View.make(data.light_xpos[light].copy(), axes, near_m, far_m, projection)


def shadow_reach_m(model: mujoco.MjModel) -> float:
    """Half the width of the shadow map on the ground under a light from above."""
    return float(model.vis.map.shadowclip * model.stat.extent)


def outline_m(view: View, reach_m: float, low_m: float, high_m: float) -> Array:
    """Corners of the part of a camera's view between two heights, as far as shadows go: [corner, 3]."""
    tangents = 1 / np.array([np.linalg.norm(view.clip_from_world[i, :3]) for i in range(2)])
    ends = [view.eye_m]
    for x, y in itertools.product((-1, 1), repeat=2):
        way = x * tangents[0] * view.axes[0] + y * tangents[1] * view.axes[1] - view.axes[2]
        ends.append(view.eye_m + _SHADOWED * reach_m * way)
    corners = [end for end in ends if low_m <= end[2] <= high_m]
    for (a, b), z in itertools.product(itertools.combinations(ends, 2), (low_m, high_m)):
        if min(a[2], b[2]) < z < max(a[2], b[2]):
            corners.append(a + (b - a) * ((z - a[2]) / (b[2] - a[2])))
    return np.array(corners)
