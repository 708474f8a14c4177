"""What a model shows, laid out for OpenGL: vertices, and faces in chunks that are drawn or left out."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from harmzone_sim.shapes import CORNER, Shapes

# Ground (0), static scene (1) and objects (2); neither collision shapes (3) nor the own car (4).
VISIBLE_GROUPS = (1, 1, 1, 0, 0, 0)
_GROUND = 0
# Side of the squares into which fixed meshes are cut.
_CHUNK_M = 24.0

# A corner with all that its light depends on, and the geom that it belongs to.
VERTEX = np.dtype(
    [
        *((name, CORNER[name]) for name in CORNER.names),
        ("rgba", np.float32, 4),
        # Specular, shininess as an exponent, emission.
        ("gloss", np.float32, 3),
        ("geom", np.int32),
    ]
)

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class Drawing:
    """The visible geoms of a model.

    Vertices of what stands still are in the world frame, those of what moves in their body's. Faces lie
    chunk by chunk: chunk i is faces[begin[i]:end[i]], of body `body[i]` (0: it stands still), with texture
    `texture[i]` (-1: none), within `radius_m[i]` of `center_m[i]` in its frame.

    `casts_shadow[i]` is false for ground that the light `sun` meets everywhere from above: what lies in the
    shadow of ground lies behind a face of it that is turned away from the light.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, sun: int | None) -> None:
        self._model = model
        root_mocap = model.body_mocapid[model.body_rootid]
        self._is_still = (model.body_weldid == 0) & (root_mocap < 0)
        self._materials = np.array(model.geom_matid)
        self._span: dict[int, slice] = {}
        shapes = Shapes(model)
        vertices, faces, geoms, textures = [], [], [], []
        n_vertices = 0
        is_visible = np.array(VISIBLE_GROUPS, dtype=bool)[model.geom_group] & (model.geom_rgba[:, 3] > 0)
        for geom in np.flatnonzero(is_visible).tolist():
            corners, of_corners = shapes.of(geom)
            texture = self._texture(geom)
            self._span[geom] = slice(n_vertices, n_vertices + len(corners))
            vertices.append(self._vertices(data, geom, corners, texture))
            faces.append(of_corners + n_vertices)
            geoms.append(np.full(len(of_corners), geom))
            textures.append(np.full(len(of_corners), texture))
            n_vertices += len(corners)
        self.vertices = np.concatenate(vertices)
        self._lay_out(np.concatenate(faces), np.concatenate(geoms), np.concatenate(textures))
        light = np.zeros(3) if sun is None else data.light_xdir[sun]
        self.casts_shadow = np.logical_or.reduceat(self._is_caster(light), self.begin)

    def _texture(self, geom: int) -> int:
        material = self._model.geom_matid[geom]
        colour = mujoco.mjtTextureRole.mjTEXROLE_RGB
        return int(self._model.mat_texid[material, colour]) if material >= 0 else -1

    def _vertices(
        self, data: mujoco.MjData, geom: int, corners: NDArray[np.void], texture: int
    ) -> NDArray[np.void]:
        model, turn = self._model, np.empty(9)
        if self._is_still[model.geom_bodyid[geom]]:
            position, turn[:] = data.geom_xpos[geom], data.geom_xmat[geom]
        else:
            position = model.geom_pos[geom]
            mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
        turn_back = turn.reshape(3, 3).T
        vertices = np.empty(len(corners), VERTEX)
        vertices["position"] = corners["position"] @ turn_back + position
        vertices["normal"] = corners["normal"] @ turn_back
        vertices["uv"] = corners["uv"]
        if texture >= 0 and not corners["uv"].any():
            vertices["uv"] = self._spread(geom, corners["position"])
        vertices["geom"] = geom
        vertices["rgba"], vertices["gloss"] = self._look(geom)
        return vertices

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
            self.vertices["rgba"][span], self.vertices["gloss"][span] = self._look(geom)
        return list(spans.values())

    def _lay_out(self, faces: Indices, geoms: Indices, textures: Indices) -> None:
        body = self._model.geom_bodyid[geoms].astype(np.int64)
        is_still = self._is_still[body]
        corners = self.vertices["position"][faces].astype(np.float64)
        # Bodies stay whole; what belongs to the world itself is cut into squares.
        cell = np.floor(corners.mean(axis=1)[:, :2] / _CHUNK_M).astype(np.int64)
        cell[body > 0] = 0
        unit = np.where(body > 0, self._model.ngeom + body, geoms)
        keys = np.stack([is_still, textures, unit, cell[:, 0], cell[:, 1]])
        order = np.lexsort(keys[::-1])
        keys = keys[:, order]
        is_first = np.ones(len(order), dtype=bool)
        is_first[1:] = (keys[:, 1:] != keys[:, :-1]).any(axis=0)
        self.begin = np.flatnonzero(is_first)
        self.end = np.append(self.begin[1:], len(order))
        self.faces = faces[order].astype(np.uint32)
        self._geom_of_face = geoms[order]
        first = order[self.begin]
        self.body = np.where(is_still, 0, body)[first]
        self.texture = textures[first]
        low = np.minimum.reduceat(corners[order].min(axis=1), self.begin)
        high = np.maximum.reduceat(corners[order].max(axis=1), self.begin)
        self.center_m = (low + high) / 2
        self.radius_m = np.linalg.norm(high - low, axis=1) / 2

    def _is_caster(self, light: Array) -> NDArray[np.bool_]:
        """Whether a face is needed in the shadow map: [face]."""
        a, b, c = np.moveaxis(self.vertices["position"][self.faces], 1, 0)
        is_turned_away = np.cross(b - a, c - a) @ light > 0
        return is_turned_away | (self._model.geom_group[self._geom_of_face] != _GROUND)

    def centers_in_world_m(self, data: mujoco.MjData) -> Array:
        """Middles of the chunks: [chunk, 3]."""
        turn = data.xmat[self.body].reshape(-1, 3, 3)
        return np.einsum("cij,cj->ci", turn, self.center_m) + data.xpos[self.body]
