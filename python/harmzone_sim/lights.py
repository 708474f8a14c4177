"""The lights of a model, as the shaders take them."""

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Lights:
    """One light from the eye, and parallel ones, the last of which may cast shadows."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        active = np.flatnonzero(model.light_active).tolist()
        parallel = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
        if any(model.light_type[light] != parallel for light in active):
            raise ValueError("only parallel lights are drawn")
        casting = [light for light in active if model.light_castshadow[light]]
        if len(casting) > 1:
            raise ValueError("only one light can cast shadows")
        # Where there is no shadow map, this light is one among the others.
        self.casting = casting[0] if casting and model.vis.quality.shadowsize > 0 else None
        self._order = [light for light in active if light not in casting] + casting
        self.n = 1 + len(self._order)

    def values(self, data: mujoco.MjData, forward: Array) -> NDArray[np.float32]:
        """Direction, ambient, diffuse and specular of each light: [4 * light, 3].

        forward: [3], where the camera looks.
        """
        model, head = self._model, self._model.vis.headlight
        rows = [forward] + [part * bool(head.active) for part in (head.ambient, head.diffuse, head.specular)]
        for light in self._order:
            colours = (model.light_ambient[light], model.light_diffuse[light], model.light_specular[light])
            rows += [data.light_xdir[light], *colours]
        return np.array(rows, dtype=np.float32)
