"""Pictures of the world through its cameras, off screen by EGL."""

import numpy as np
from numpy.typing import NDArray

from harmzone_sim.painter import Painter
from harmzone_sim.world import World


class Camera:
    """Renders the cameras of a world; holds the OpenGL context."""

    def __init__(self, world: World) -> None:
        from mujoco.egl import GLContext

        self._world = world
        self._gl = GLContext(*world.image_sizes_px[0])
        self._gl.make_current()
        self._painter = Painter(world)

    def draw(self, camera: int = 0) -> None:
        """Draws the world as it is now through one of its cameras; what follows reads of this picture."""
        self._gl.make_current()
        self._painter.draw(camera)

    def rgb(self) -> NDArray[np.uint8]:
        """The picture: [height, width, 3], row 0 at the top."""
        self._gl.make_current()
        return self._painter.read_rgb()

    def depth_m(self) -> NDArray[np.float32]:
        """Distances along the optical axis, inf where there is nothing but sky: [height, width]."""
        self._gl.make_current()
        return self._painter.read_depth_m()

    def geoms(self) -> NDArray[np.int32]:
        """Geom id of each pixel, -1 where there is none: [height, width]."""
        self._gl.make_current()
        return self._painter.read_geoms()

    def make_current(self) -> None:
        """Makes the context the one that calls draw with."""
        self._gl.make_current()

    def close(self) -> None:
        """Frees what the driver holds for these cameras."""
        self._gl.make_current()
        self._gl.free()


def gl_info() -> tuple[str, str, str]:
    """Vendor, renderer and version of the OpenGL context that is current."""
    from OpenGL import GL

    return tuple(
        (GL.glGetString(name) or b"?").decode() for name in (GL.GL_VENDOR, GL.GL_RENDERER, GL.GL_VERSION)
    )
