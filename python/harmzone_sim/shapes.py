"""Triangles of a model's geoms as MuJoCo's classic renderer draws them, in the frame of each geom."""

import mujoco
import numpy as np
from numpy.typing import NDArray

# Position, normal, texture coordinates.
CORNER = np.dtype([("position", np.float32, 3), ("normal", np.float32, 3), ("uv", np.float32, 2)])
# How far an infinite plane reaches, as a multiple of the far clipping distance.
_PLANE_REACH = 2.5
# Most cells of a plane along a side.
_MAX_CELLS = 198
# Steps of 1 / 512 tell one normal from another.
_NORMAL_STEPS = 512

Corners = NDArray[np.void]
Faces = NDArray[np.int64]


class Shapes:
    """Corners and faces of geoms; meshes and tessellations are made once."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self._meshes: dict[int, tuple[Corners, Faces]] = {}
        quality = model.vis.quality
        self._n_slices, self._n_stacks = quality.numslices, quality.numstacks

    def of(self, geom: int) -> tuple[Corners, Faces]:
        """Corners [corner], to be left as they are, and faces [face, 3], counter-clockwise from the front."""
        model, kind = self._model, mujoco.mjtGeom(self._model.geom_type[geom])
        if kind == mujoco.mjtGeom.mjGEOM_MESH:
            mesh = int(model.geom_dataid[geom])
            if mesh not in self._meshes:
                self._meshes[mesh] = _mesh(model, mesh)
            return self._meshes[mesh]
        x, y, z = (float(half) for half in model.geom_size[geom])
        if kind == mujoco.mjtGeom.mjGEOM_PLANE:
            far_m = _PLANE_REACH * model.vis.map.zfar * model.stat.extent
            return _plane(x or far_m, y or far_m, z if self._shines(geom) else np.inf)
        if kind == mujoco.mjtGeom.mjGEOM_BOX:
            return _scale(_box(), [x, y, z])
        if kind in (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_ELLIPSOID):
            half = [x, x, x] if kind == mujoco.mjtGeom.mjGEOM_SPHERE else [x, y, z]
            return _scale(self._turned(_arc(self._n_stacks, 0.0)), half)
        if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
            return self._turned(_arc(self._n_stacks, y / x), x)
        if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
            return _scale(self._turned(_CYLINDER), [x, x, y])
        raise ValueError(f"geom {geom} is a {kind.name}, which is not drawn")

    def _shines(self, geom: int) -> bool:
        material = self._model.geom_matid[geom]
        return material < 0 or self._model.mat_specular[material] > 0

    def _turned(self, profile: NDArray[np.float64], scale: float = 1.0) -> tuple[Corners, Faces]:
        """A profile [point, 4] of radius, z and normal, upwards, turned about z."""
        n = len(profile)
        angle = np.arange(self._n_slices + 1) * (2 * np.pi / self._n_slices)
        cos, sin = np.cos(angle)[:, None], np.sin(angle)[:, None]
        corners = np.zeros((len(angle), n), CORNER)
        for part, (out, up) in (("position", (0, 1)), ("normal", (2, 3))):
            radius = profile[None, :, out]
            corners[part] = np.stack([cos * radius, sin * radius, 0 * cos + profile[None, :, up]], axis=-1)
        corners["position"] *= scale
        slices, points = np.meshgrid(np.arange(self._n_slices), np.arange(n - 1), indexing="ij")
        first = (slices * n + points).reshape(-1)
        quads = np.stack([first, first + n, first + n + 1, first + 1], axis=1)
        return corners.reshape(-1), _split(quads)


# Bottom, side and top: radius, z, normal outwards and up.
_CYLINDER = np.array(
    [(0, -1, 0, -1), (1, -1, 0, -1), (1, -1, 1, 0), (1, 1, 1, 0), (1, 1, 0, 1), (0, 1, 0, 1)], dtype=float
)


def _arc(n_stacks: int, half_gap: float) -> NDArray[np.float64]:
    """The profile of a ball whose halves are `half_gap` radii off the middle."""
    elevation = np.linspace(-np.pi / 2, np.pi / 2, 2 * (n_stacks // 2) + 1)
    ball = np.stack([np.cos(elevation), np.sin(elevation)] * 2, axis=1)
    if half_gap == 0.0:
        return ball
    middle = n_stacks // 2
    low, high = ball[: middle + 1].copy(), ball[middle:].copy()
    low[:, 1] -= half_gap
    high[:, 1] += half_gap
    return np.concatenate([low, high])


def _split(quads: NDArray[np.int64]) -> Faces:
    return quads[:, [0, 1, 3, 1, 2, 3]].reshape(-1, 3)


def _plane(half_x_m: float, half_y_m: float, cell_m: float) -> tuple[Corners, Faces]:
    """A level rectangle in cells of two `cell_m`, since glints are worked out at their corners."""
    x, y = (
        np.linspace(-half_m, half_m, 1 + int(np.clip(half_m / max(cell_m, 1e-9), 1, _MAX_CELLS)))
        for half_m in (half_x_m, half_y_m)
    )
    corners = np.zeros((len(x), len(y)), CORNER)
    corners["position"][..., 0], corners["position"][..., 1] = x[:, None], y
    corners["normal"] = (0, 0, 1)
    rows, columns = np.meshgrid(np.arange(len(x) - 1), np.arange(len(y) - 1), indexing="ij")
    first = (rows * len(y) + columns).reshape(-1)
    quads = np.stack([first, first + len(y), first + len(y) + 1, first + 1], axis=1)
    return corners.reshape(-1), _split(quads)


def _box() -> tuple[Corners, Faces]:
    corners = np.zeros((6, 4), CORNER)
    for side in range(6):
        axis, sign = side % 3, 1.0 if side < 3 else -1.0
        normal = np.eye(3)[axis] * sign
        u = np.eye(3)[(axis + 1) % 3]
        v = np.cross(normal, u)
        corners[side]["normal"] = normal
        corners[side]["position"] = [normal + a * u + b * v for a, b in [(-1, -1), (1, -1), (1, 1), (-1, 1)]]
    return corners.reshape(-1), _split(np.arange(24).reshape(6, 4))


def _scale(shape: tuple[Corners, Faces], half: list[float]) -> tuple[Corners, Faces]:
    corners, faces = shape
    corners = corners.copy()
    corners["position"] *= np.array(half, dtype=np.float32)
    normal = corners["normal"] / np.array(half, dtype=np.float32)
    corners["normal"] = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    return corners, faces


def _mesh(model: mujoco.MjModel, mesh: int) -> tuple[Corners, Faces]:
    first, n = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    vertex = model.mesh_face[first : first + n].astype(np.int64)
    position = model.mesh_vert[model.mesh_vertadr[mesh] + vertex]
    normal_idx = model.mesh_facenormal[first : first + n].astype(np.int64)
    normal = model.mesh_normal[model.mesh_normaladr[mesh] + normal_idx]
    uv = np.zeros((n, 3, 2), dtype=np.float32)
    if model.mesh_texcoordadr[mesh] >= 0:
        uv_idx = model.mesh_facetexcoord[first : first + n].astype(np.int64)
        uv = model.mesh_texcoord[model.mesh_texcoordadr[mesh] + uv_idx]
        key = (vertex * (normal_idx.max() + 1) + normal_idx) * (uv_idx.max() + 1) + uv_idx
    else:
        # Where the smoothed normal leans away from the face's, MuJoCo takes the face's.
        flat = np.cross(position[:, 1] - position[:, 0], position[:, 2] - position[:, 0])
        flat /= np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-12)
        leans = np.einsum("fci,fi->fc", normal, flat) < 0.8
        normal = np.where(leans[..., None], flat[:, None, :], normal)
        steps = np.rint(normal * _NORMAL_STEPS).astype(np.int64) + _NORMAL_STEPS
        key = ((vertex * 2048 + steps[..., 0]) * 2048 + steps[..., 1]) * 2048 + steps[..., 2]
    _, kept, faces = np.unique(key.reshape(-1), return_index=True, return_inverse=True)
    corners = np.empty(len(kept), CORNER)
    corners["position"] = position.reshape(-1, 3)[kept]
    corners["normal"] = normal.reshape(-1, 3)[kept]
    corners["uv"] = uv.reshape(-1, 2)[kept]
    return corners, faces.reshape(-1, 3)
