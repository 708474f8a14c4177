"""Pictures of the world through its camera, off screen by EGL."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from harmzone_sim.world import World

_MAX_GEOMS = 20_000


class Camera:
    """Renders the camera of a world; holds the OpenGL context."""

    def __init__(self, world: World) -> None:
        from mujoco.egl import GLContext

        self._world = world
        width_px, height_px = world.image_size_px
        self._gl = GLContext(width_px, height_px)
        self._gl.make_current()
        self._rect = mujoco.MjrRect(0, 0, width_px, height_px)
        self._scene = mujoco.MjvScene(world.model, maxgeom=max(_MAX_GEOMS, world.model.ngeom + 100))
        self._context = mujoco.MjrContext(world.model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._option = mujoco.MjvOption()
        self._option.geomgroup[:] = [1, 1, 1, 0, 0, 0]
        self._option.sitegroup[:] = 0
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        self._camera.fixedcamid = world.camera_id
        self._pixels = np.empty((height_px, width_px, 3), dtype=np.uint8)
        self._depth = np.empty((height_px, width_px), dtype=np.float32)
        self._geom_from_segment = np.empty(0, dtype=np.int32)

    def update(self) -> None:
        """Takes over the world's present poses, for the pictures that follow."""
        mujoco.mjv_updateScene(
            self._world.model,
            self._world.data,
            self._option,
            None,
            self._camera,
            mujoco.mjtCatBit.mjCAT_ALL.value,
            self._scene,
        )

    def rgb(self) -> NDArray[np.uint8]:
        """The picture: [height, width, 3], row 0 at the top."""
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = 0
        self._scene.flags[mujoco.mjtRndFlag.mjRND_IDCOLOR] = 0
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 1
        return np.ascontiguousarray(self._read()[::-1])

    def rgb_and_depth(self) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """The picture as `rgb` has it, and the distance along the optical axis of what it shows.

        Depth in metres [height, width], row 0 at the top, inf where there is nothing but sky.
        """
        picture = Camera.rgb(self)
        mujoco.mjr_readPixels(None, self._depth, self._rect, self._context)
        visual, extent = self._world.model.vis.map, self._world.model.stat.extent
        near_m, far_m = visual.znear * extent, visual.zfar * extent
        # MuJoCo draws with a reversed depth buffer and reads it as 0 (near) to 1 (far).
        with np.errstate(divide="ignore"):
            depth_m = near_m * far_m / (far_m - self._depth[::-1] * (far_m - near_m))
        depth_m[depth_m > 0.999 * far_m] = np.inf
        return picture, np.ascontiguousarray(depth_m, dtype=np.float32)

    def segmentation(self) -> NDArray[np.int32]:
        """Geom id of each pixel, -1 where there is none: [height, width], row 0 at the top."""
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = 1
        self._scene.flags[mujoco.mjtRndFlag.mjRND_IDCOLOR] = 1
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        pixels = self._read()[::-1]
        segment = pixels[..., 0].astype(np.int32)
        segment |= pixels[..., 1].astype(np.int32) << 8
        segment |= pixels[..., 2].astype(np.int32) << 16
        n_geoms = self._scene.ngeom
        # What is drawn does not change within an episode, so the table is made once.
        if self._geom_from_segment.size != n_geoms + 1:
            table = np.full(n_geoms + 1, -1, dtype=np.int32)
            for geom in self._scene.geoms[:n_geoms]:
                if geom.segid >= 0 and geom.objtype == mujoco.mjtObj.mjOBJ_GEOM:
                    table[geom.segid + 1] = geom.objid
            self._geom_from_segment = table
        return self._geom_from_segment[np.minimum(segment, n_geoms)]

    def make_current(self) -> None:
        """Makes the context the one that calls draw with."""
        self._gl.make_current()

    def close(self) -> None:
        """Frees what the driver holds for this camera."""
        self._gl.make_current()
        self._context.free()
        self._gl.free()

    def _read(self) -> NDArray[np.uint8]:
        self._gl.make_current()
        mujoco.mjr_render(self._rect, self._scene, self._context)
        mujoco.mjr_readPixels(self._pixels, None, self._rect, self._context)
        return self._pixels


def gl_info() -> tuple[str, str, str]:
    """Vendor, renderer and version of the OpenGL context that is current."""
    from OpenGL import GL

    return tuple(
        (GL.glGetString(name) or b"?").decode() for name in (GL.GL_VENDOR, GL.GL_RENDERER, GL.GL_VERSION)
    )
