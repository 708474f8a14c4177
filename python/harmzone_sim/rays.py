"""Rays against the world's visible geometry."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from harmzone_sim.world import Array, World

# Ground (0), static scene (1) and objects (2); neither collision shapes (3) nor the own car (4).
_VISIBLE_GROUPS = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)


def cast_rays(
    world: World, origin_m: Array, directions: Array, max_range_m: float
) -> tuple[Array, NDArray[np.int32], Array]:
    """First hit of each ray in the world frame.

    origin_m: [3]. directions: [ray, 3], unit vectors.
    Returns range_m [ray], inf where nothing is hit; geom_id [ray], -1 there; and the cosine of the
    angle between ray and surface normal [ray], 0 there.
    """
    n_rays = directions.shape[0]
    geom_id = np.full(n_rays, -1, dtype=np.int32)
    range_m = np.full(n_rays, -1.0)
    normals = np.zeros((n_rays, 3))
    mujoco.mj_multiRay(
        world.model,
        world.data,
        origin_m,
        directions.reshape(-1),
        _VISIBLE_GROUPS,
        1,
        -1,
        geom_id,
        range_m,
        normals.reshape(-1),
        n_rays,
        max_range_m,
    )
    # MuJoCo takes its own limit as a hint and may report hits beyond it.
    missed = (geom_id < 0) | (range_m < 0) | (range_m > max_range_m)
    cos_incidence = np.abs(np.einsum("ij,ij->i", directions, normals))
    range_m[missed], geom_id[missed], cos_incidence[missed] = np.inf, -1, 0.0
    return range_m, geom_id, cos_incidence
