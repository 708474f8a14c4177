"""Bare MuJoCo calls, noted while a world is driven and drawn, then issued again with nothing around them."""

import time
from collections.abc import Callable

import mujoco
import numpy as np
from harmzone_sim.camera import Camera
from harmzone_sim.world import World

# What stepping, drawing and casting rays cannot do without.
_TIMED = ("mj_step", "mjv_updateScene", "mjr_render", "mjr_readPixels", "mj_multiRay")
# What brings the poses up to date, so that the frames stay the same.
_UNTIMED = ("mj_kinematics", "mj_comPos", "mj_camlight")
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION.value


class CallLog:
    """Notes the calls of one world and its camera until `replay` or `stop`."""

    def __init__(self, world: World, camera: Camera) -> None:
        self._world = world
        self._camera = camera
        # The first pictures compile shaders, which belongs to no frame.
        camera.update()
        camera.rgb()
        camera.segmentation()
        self._begin = self._state()
        self._originals = {name: getattr(mujoco, name) for name in (*_TIMED, *_UNTIMED)}
        self._calls: list[tuple[str, tuple, np.ndarray | None]] = []
        for name, original in self._originals.items():
            setattr(mujoco, name, self._noting(name, original))

    def stop(self) -> None:
        """Notes no more calls."""
        for name, original in self._originals.items():
            setattr(mujoco, name, original)

    def replay(self) -> dict[str, float]:
        """Issues the noted calls again.

        Returns the seconds spent in each timed function. Raises RuntimeError if the last picture or the
        last rays come out otherwise, since it then were not the same work.
        """
        self.stop()
        last = {name: args for name, args, _ in self._calls}
        picture = next(buffer for buffer in last["mjr_readPixels"][:2] if buffer is not None)
        results = [picture, last["mj_multiRay"][8]]
        wanted = [result.copy() for result in results]
        spent = dict.fromkeys(_TIMED, 0)
        self._camera.make_current()
        model, data = self._world.model, self._world.data
        mujoco.mj_setState(model, data, self._begin, _STATE)
        for name in _UNTIMED:
            self._originals[name](model, data)
        for name, args, before in self._calls:
            function = self._originals[name]
            if name == "mj_step":
                mujoco.mj_setState(model, data, before, _STATE)
            elif name == "mjr_render":
                args[1].flags[:] = before
            begin = time.perf_counter_ns()
            function(*args)
            if name in spent:
                spent[name] += time.perf_counter_ns() - begin
        for found, expected in zip(results, wanted, strict=True):
            # Rays that met nothing were marked as such after the call.
            is_result = np.isfinite(expected)
            if not np.array_equal(found[is_result], expected[is_result]):
                raise RuntimeError("the calls, issued again, ended in another picture or in other ranges")
        return {name: spent_ns * 1e-9 for name, spent_ns in spent.items()}

    def _state(self) -> np.ndarray:
        state = np.empty(mujoco.mj_stateSize(self._world.model, _STATE))
        mujoco.mj_getState(self._world.model, self._world.data, state, _STATE)
        return state

    def _noting(self, name: str, original: Callable) -> Callable:
        """`original`, with each call noted, and what it reads besides its arguments."""

        def noting(*args: object) -> object:
            before = None
            if name == "mj_step":
                before = self._state()
            elif name == "mjr_render":
                before = np.array(args[1].flags)
            self._calls.append((name, args, before))
            return original(*args)

        return noting
