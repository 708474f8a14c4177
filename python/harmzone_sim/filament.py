"""Physically based pictures by MuJoCo's Filament renderer; needs the wheel `mujoco-studio` and Vulkan."""

import collections.abc
import ctypes
import importlib

import mujoco
import numpy as np
from numpy.typing import NDArray

from harmzone_sim.camera import Camera
from harmzone_sim.drawing import VISIBLE_GROUPS
from harmzone_sim.world import World


class FilamentCamera(Camera):
    """Cameras whose colours come from Filament; depth and geom ids from the classic renderer."""

    def __init__(self, world: World) -> None:
        super().__init__(world)
        try:
            # Filament ends the process where it finds no Vulkan.
            ctypes.CDLL("libvulkan.so.1")
        except OSError as error:
            raise RuntimeError("no Vulkan: install libvulkan1 and mesa-vulkan-drivers") from error
        if not hasattr(collections.abc, "Buffer"):
            # The module names it on import; Python has it since 3.12. Arrays are all that is passed here.
            collections.abc.Buffer = np.ndarray
        try:
            # Registers Filament's materials.
            importlib.import_module("mujoco.studio.window")
            from mujoco import mjrf
            from mujoco.rendering.filament import model_scene, renderer
        except ImportError as error:
            raise RuntimeError(f"no Filament: install mujoco-studio {mujoco.__version__}") from error
        config = mjrf.ContextConfig()
        config.graphics_api = mjrf.GraphicsApi.GRAPHICS_API_VULKAN
        config.software_rendering = True
        self._filament = renderer.Renderer(mjrf.Context(config))
        context = self._filament.context
        self._model_scene = model_scene.ModelScene(context, world.model, self._filament.scene("world"))
        option = mujoco.MjvOption()
        option.geomgroup[:] = VISIBLE_GROUPS
        option.sitegroup[:] = 0
        self._model_scene._renderables.set_options(option)
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        self._colours = []
        for i, (width_px, height_px) in enumerate(world.image_sizes_px):
            self._colours.append(np.empty((height_px, width_px, 3), dtype=np.uint8))
            self._filament.target(f"picture {i}", self._colours[i])
        self._drawn = 0
        self._view = renderer.View

    def draw(self, camera: int = 0) -> None:
        """Draws the world as it is now through one of its cameras; what follows reads of this picture."""
        self._drawn = camera
        super().draw(camera)

    def rgb(self) -> NDArray[np.uint8]:
        """The picture: [height, width, 3], row 0 at the top."""
        self._model_scene.update(self._world.data)
        self._camera.fixedcamid = self._world.camera_ids[self._drawn]
        camera = mujoco.mjv_camera2GLCamera(self._world.model, self._world.data, self._camera)
        self._filament.render([self._view(scene="world", target=f"picture {self._drawn}", camera=camera)])
        return self._colours[self._drawn].copy()
