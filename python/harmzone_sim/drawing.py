"""What a model shows, laid out for OpenGL: vertices, and faces in chunks that are drawn or left out."""

import itertools
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from harmzone_sim.shapes import Shapes

# Ground (0), static scene (1) and objects (2); neither collision shapes (3) nor the own car (4).
VISIBLE_GROUPS = (1, 1, 1, 0, 0, 0)
_GROUND = 0
# OpenGL rounds: the boxes round chunks are larger by so much on each side.
_SLACK_M = 0.01
# Side of the squares into which fixed meshes are cut.
_CHUNK_M = 24.0

# Parts of a vertex, each with its first column: floats, but for the geom's id, which is an integer's bits.
N_COLUMNS = 16
COLUMNS = {
    "position": (0, 3),
    "normal": (3, 3),
    "uv": (6, 2),
    "rgba": (8, 4),
    "gloss": (12, 3),
    "geom": (15, 1),
}
_SIGNS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
_GLOSS = slice(12, 15)
_RGBA = slice(8, 12)

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class Drawing:
    """The visible geoms of a model.

    Vertices of what stands still are in the world frame, those of what moves in their body's. Faces lie
    chunk by chunk: chunk i is faces[begin[i]:end[i]], of body `body[i]` (0: it stands still), with texture
    `texture[i]` (-1: none), in a box along the axes of its frame, with middle
    `center_m[i]` and half diagonal `radius_m[i]`.

    `casts_shadow[i]` is false for ground that the light `sun` meets everywhere from above: what lies in the
    shadow of ground lies behind a face of it that is turned away from the light. Ground (`is_ground[i]`) is
    an open sheet; of all else only outer sides are ever seen.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, sun: int | None) -> None:
        self._model = model
        root_mocap = model.body_mocapid[model.body_rootid]
        self._is_still = (model.body_weldid == 0) & (root_mocap < 0)
        self._materials = np.array(model.geom_matid)
        self._span: dict[int, slice] = {}
        shapes = Shapes(model)
        is_visible = np.array(VISIBLE_GROUPS, dtype=bool)[model.geom_group] & (model.geom_rgba[:, 3] > 0)
        drawn = np.flatnonzero(is_visible).tolist()
        n_vertices = 0
        for geom in drawn:
            n = len(shapes.of(geom)[0])
            self._span[geom] = slice(n_vertices, n_vertices + n)
            n_vertices += n
        self.vertices = np.zeros((n_vertices, N_COLUMNS), dtype=np.float32)
        light = np.zeros(3) if sun is None else data.light_xdir[sun]
        parts = []
        for geom in drawn:
            corners, faces = shapes.of(geom)
            self._fill(data, geom, corners)
            parts += self._cut(geom, faces + self._span[geom].start, light)
        self._lay_out(parts)

    def _texture(self, geom: int) -> int:
        material = self._model.geom_matid[geom]
        colour = mujoco.mjtTextureRole.mjTEXROLE_RGB
        return int(self._model.mat_texid[material, colour]) if material >= 0 else -1

    def _fill(self, data: mujoco.MjData, geom: int, corners: NDArray[np.void]) -> None:
        """Writes a geom's vertices."""
        model, turn = self._model, np.empty(9)
        if self._is_still[model.geom_bodyid[geom]]:
            position, turn[:] = data.geom_xpos[geom], data.geom_xmat[geom]
        else:
            position = model.geom_pos[geom]
            mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
        turn_back = turn.reshape(3, 3).T.astype(np.float32)
        vertices = self.vertices[self._span[geom]]
        vertices[:, 0:3] = corners["position"] @ turn_back + position.astype(np.float32)
        vertices[:, 3:6] = corners["normal"] @ turn_back
        vertices[:, 6:8] = corners["uv"]
        if self._texture(geom) >= 0 and not corners["uv"].any():
            vertices[:, 6:8] = self._spread(geom, corners["position"])
        vertices[:, _RGBA], vertices[:, _GLOSS] = self._look(geom)
        vertices[:, 15] = np.array(geom, dtype=np.int32).view(np.float32)

    def _spread(self, geom: int, position: NDArray[np.float32]) -> Array:
        """Texture coordinates where a shape has none of its own: by place in the geom's plane."""
        model, material = self._model, self._model.geom_matid[geom]
        if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_PLANE:
            raise ValueError(f"geom {geom} has a texture, but no coordinates in it")
        half_m = model.geom_size[geom, :2]
        unit_m = np.where((half_m > 0) & ~bool(model.mat_texuniform[material]), half_m, 1.0)
        return position[:, :2] / unit_m * (0.5 * model.mat_texrepeat[material] * [1, -1]) - 0.5

    def _look(self, geom: int) -> tuple[Array, tuple[float, float, float]]:
        model, material = self._model, self._model.geom_matid[geom]
        if material < 0:
            return model.geom_rgba[geom], (0.5, 0.5 * 128.0, 0.0)
        # A geom's default colour means the material's.
        is_own = not np.array_equal(model.geom_rgba[geom], [0.5, 0.5, 0.5, 1.0])
        rgba = model.geom_rgba[geom] if is_own else model.mat_rgba[material]
        shininess = 128.0 * model.mat_shininess[material]
        return rgba, (model.mat_specular[material], shininess, model.mat_emission[material])

    def repaint(self) -> list[slice]:
        """Gives geoms their present materials; returns the vertices that have changed."""
        changed = np.flatnonzero(self._materials != self._model.geom_matid).tolist()
        self._materials[:] = self._model.geom_matid
        spans = {geom: self._span[geom] for geom in changed if geom in self._span}
        for geom, span in spans.items():
            self.vertices[span, _RGBA], self.vertices[span, _GLOSS] = self._look(geom)
        return list(spans.values())

    def _cut(self, geom: int, faces: Indices, light: Array) -> list["_Part"]:
        """The faces of a geom: a body's stay together, those of the world itself are cut into squares."""
        body = int(self._model.geom_bodyid[geom])
        is_still, texture = bool(self._is_still[body]), self._texture(geom)
        span = self.vertices[self._span[geom], 0:3]
        if body > 0:
            box = (span.min(axis=0), span.max(axis=0))
            return [_Part((is_still, texture, body), faces, *box, casts_shadow=True, is_ground=False)]
        corners = self.vertices[faces, 0:3]
        casts = np.ones(len(faces), dtype=bool)
        is_ground = bool(self._model.geom_group[geom] == _GROUND)
        if is_ground:
            a, b, c = np.moveaxis(corners, 1, 0)
            casts = np.cross(b - a, c - a) @ light > 0
        low, high = corners.min(axis=1), corners.max(axis=1)
        cell = np.floor((low + high)[:, :2] / (2 * _CHUNK_M)).astype(np.int64)
        order = np.lexsort(cell.T)
        is_first = np.append(True, (np.diff(cell[order], axis=0) != 0).any(axis=1))
        begin = np.flatnonzero(is_first)
        lows, highs = np.minimum.reduceat(low[order], begin), np.maximum.reduceat(high[order], begin)
        casts = np.logical_or.reduceat(casts[order], begin)
        own = self._model.nbody + geom
        split = np.split(faces[order], begin[1:])
        return [
            _Part((is_still, texture, own, i), *values, is_ground)
            for i, values in enumerate(zip(split, lows, highs, casts.tolist(), strict=True))
        ]

    def _lay_out(self, parts: list["_Part"]) -> None:
        parts.sort(key=lambda part: part.key)
        self.faces = np.concatenate([part.faces for part in parts]).astype(np.uint32)
        first = [i for i, part in enumerate(parts) if i == 0 or part.key != parts[i - 1].key]
        ends = np.cumsum([len(part.faces) for part in parts])
        self.end = np.append(ends[np.array(first[1:], dtype=np.int64) - 1], ends[-1])
        self.begin = np.append(0, self.end[:-1])
        keys = [parts[i].key for i in first]
        self.body = np.array([0 if is_still else body for is_still, _, body, *_ in keys])
        self.texture = np.array([texture for _, texture, *_ in keys])
        self.casts_shadow = np.array([parts[i].casts_shadow for i in first])
        self.is_ground = np.array([parts[i].is_ground for i in first])
        low = np.minimum.reduceat(np.array([part.low for part in parts], dtype=float), first)
        high = np.maximum.reduceat(np.array([part.high for part in parts], dtype=float), first)
        self.center_m = (low + high) / 2
        self._half_m = (high - low) / 2 + _SLACK_M
        self.radius_m = np.linalg.norm(self._half_m, axis=1)

    def centers_in_world_m(self, data: mujoco.MjData) -> Array:
        """Middles of the chunks: [chunk, 3]."""
        turn = data.xmat[self.body].reshape(-1, 3, 3)
        return np.einsum("cij,cj->ci", turn, self.center_m) + data.xpos[self.body]

    def reach_along_m(self, data: mujoco.MjData, axes: Array) -> Array:
        """How far the chunks reach from their middles along axes [axis, 3] of the world: [chunk, axis]."""
        turn = data.xmat[self.body].reshape(-1, 3, 3)
        return np.einsum("caj,cj->ca", np.abs(axes @ turn), self._half_m)

    def corners_in_world_m(self, data: mujoco.MjData, chunks: Indices) -> Array:
        """Corners of the boxes round some chunks: [chunk, 8, 3]."""
        body = self.body[chunks]
        turn = data.xmat[body].reshape(-1, 3, 3)
        corners = self.center_m[chunks, None] + _SIGNS * self._half_m[chunks, None]
        return np.einsum("cij,ckj->cki", turn, corners) + data.xpos[body, None]


@dataclass(frozen=True)
class _Part:
    """Faces with the same key go into the same chunk; low and high are the corners of the box round them."""

    key: tuple[int, ...]
    faces: Indices
    low: NDArray[np.float32]
    high: NDArray[np.float32]
    casts_shadow: bool
    is_ground: bool
