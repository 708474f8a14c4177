"""The world's visible geometry, and rays against it."""

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


def visible_geometry(
    world: World,
) -> tuple[
    NDArray[np.int32],
    list[str],
    NDArray[np.int32],
    Array,
    Array,
    NDArray[np.int32],
    list[tuple[NDArray[np.float32], NDArray[np.int32]]],
    NDArray[np.bool_],
]:
    """What rays and cameras see, as `cast_rays` does.

    Returns id, kind (`box`, `mesh`, ..), body and size [geom, 3] of each geom; its pose in the body
    [geom, 7], position and quaternion w, x, y, z; its mesh, -1 for none; vertices [vertex, 3] and faces
    [face, 3] of each mesh; and for each body whether it can move.
    """
    model = world.model
    material = model.geom_matid
    alpha = np.where(material < 0, model.geom_rgba[:, 3], 1.0)
    alpha[material >= 0] = model.mat_rgba[material[material >= 0], 3]
    group = np.clip(model.geom_group, 0, _VISIBLE_GROUPS.size - 1)
    geoms = np.flatnonzero((_VISIBLE_GROUPS[group] != 0) & (alpha != 0))
    kinds = [mujoco.mjtGeom(kind).name.removeprefix("mjGEOM_").lower() for kind in model.geom_type[geoms]]
    is_mesh = model.geom_type[geoms] == mujoco.mjtGeom.mjGEOM_MESH
    used, mesh = np.unique(model.geom_dataid[geoms][is_mesh], return_inverse=True)
    meshes = []
    for i in used:
        vertices = slice(model.mesh_vertadr[i], model.mesh_vertadr[i] + model.mesh_vertnum[i])
        faces = slice(model.mesh_faceadr[i], model.mesh_faceadr[i] + model.mesh_facenum[i])
        meshes.append((model.mesh_vert[vertices].copy(), model.mesh_face[faces].copy()))
    mesh_of_geom = np.full(geoms.size, -1, dtype=np.int32)
    mesh_of_geom[is_mesh] = mesh
    return (
        geoms.astype(np.int32),
        kinds,
        model.geom_bodyid[geoms].astype(np.int32),
        model.geom_size[geoms],
        np.concatenate([model.geom_pos[geoms], model.geom_quat[geoms]], axis=1),
        mesh_of_geom,
        meshes,
        model.body_weldid != 0,
    )
