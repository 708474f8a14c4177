"""Draws a model by OpenGL as MuJoCo's classic renderer does, but colour, depth and geoms in one pass.

Light is worked out at the corners, as OpenGL's fixed functions do. Only chunks in view are drawn, and only
chunks that can throw a shadow into the view go to the shadow map. Everything is opaque.
"""

import ctypes

import mujoco
import numpy as np
from numpy.typing import NDArray

from harmzone_sim.drawing import COLUMNS, N_COLUMNS, Drawing
from harmzone_sim.hidden import Depths, Shown
from harmzone_sim.lights import Lights
from harmzone_sim.shaders import (
    DEPTH_SHADER,
    FRAGMENT_SHADER,
    NO_COLOUR_SHADER,
    VERTEX_SHADER,
    Program,
)
from harmzone_sim.view import Array, View, camera_view, outline_m, shadow_reach_m, sun_view
from harmzone_sim.world import World

# By slope and by steps of depth: how far casters are moved back, lest they shade themselves. By slope it is a
# texel more than MuJoCo's 1.5, since edges are softened over three.
_SHADOW_OFFSET = (-2.5, -4.0)
# What lies so many texels beside what is shown still casts: a soft edge reaches 0.7 texels to each
# side, and one more by the texture unit.
_MARGIN_TEXELS = 3
_STILL = np.eye(4, dtype=np.float32)


class Painter:
    """What a world's pictures need in the OpenGL context that is current while it is made and used."""

    def __init__(self, world: World) -> None:
        from OpenGL import GL
        from OpenGL.raw.GL.VERSION.GL_1_4 import glMultiDrawElements

        self._gl, self._draw_many = GL, glMultiDrawElements
        self._world = world
        self._lights = Lights(world.model)
        self._drawing = Drawing(world.model, world.data, self._lights.casting)
        self._has_shadow = self._lights.casting is not None
        self._upload()
        self._textures = [self._make_texture(world.model, texture) for texture in range(world.model.ntex)]
        shaders = (VERTEX_SHADER, FRAGMENT_SHADER)
        self._plain, self._textured = (Program(GL, self._words(i), *shaders) for i in (0, 1))
        self._depth_only = Program(GL, self._words(0), DEPTH_SHADER, NO_COLOUR_SHADER)
        if self._has_shadow:
            self._make_shadow_map(int(world.model.vis.quality.shadowsize))
        n_samples = min(int(world.model.vis.quality.offsamples), GL.glGetIntegerv(GL.GL_MAX_SAMPLES))
        # Cameras with pictures of one size share their frames.
        self._frames: dict[tuple[int, int], tuple[int, int | None]] = {}
        for self._size_px in sorted(set(world.image_sizes_px)):
            smooth_frame = self._make_frame(n_samples) if n_samples > 0 else None
            self._frames[self._size_px] = self._make_frame(0), smooth_frame
        self._choose(0)

    def _words(self, has_texture: int) -> dict[str, int]:
        return {"N_LIGHTS": self._lights.n, "HAS_SHADOW": int(self._has_shadow), "HAS_TEXTURE": has_texture}

    def _upload(self) -> None:
        gl, drawing = self._gl, self._drawing
        gl.glBindVertexArray(gl.glGenVertexArrays(1))
        self._vertex_buffer = gl.glGenBuffers(1)
        gl.glBindBuffer(gl.GL_ARRAY_BUFFER, self._vertex_buffer)
        gl.glBufferData(gl.GL_ARRAY_BUFFER, drawing.vertices.nbytes, drawing.vertices, gl.GL_STATIC_DRAW)
        for i, (name, (column, n)) in enumerate(COLUMNS.items()):
            place = ctypes.c_void_p(4 * column)
            gl.glEnableVertexAttribArray(i)
            if name == "geom":
                gl.glVertexAttribIPointer(i, n, gl.GL_INT, 4 * N_COLUMNS, place)
            else:
                gl.glVertexAttribPointer(i, n, gl.GL_FLOAT, False, 4 * N_COLUMNS, place)
        gl.glBindBuffer(gl.GL_ELEMENT_ARRAY_BUFFER, gl.glGenBuffers(1))
        gl.glBufferData(gl.GL_ELEMENT_ARRAY_BUFFER, drawing.faces.nbytes, drawing.faces, gl.GL_STATIC_DRAW)

    def _make_texture(self, model: mujoco.MjModel, texture: int) -> int:
        gl = self._gl
        size = int(model.tex_width[texture]), int(model.tex_height[texture])
        n_channels, first = int(model.tex_nchannel[texture]), int(model.tex_adr[texture])
        if model.tex_type[texture] != mujoco.mjtTexture.mjTEXTURE_2D or n_channels not in (3, 4):
            raise ValueError(f"texture {texture} is not a flat picture, which is all that is drawn")
        name = gl.glGenTextures(1)
        gl.glBindTexture(gl.GL_TEXTURE_2D, name)
        gl.glTexParameteri(gl.GL_TEXTURE_2D, gl.GL_TEXTURE_MAG_FILTER, gl.GL_LINEAR)
        gl.glTexParameteri(gl.GL_TEXTURE_2D, gl.GL_TEXTURE_MIN_FILTER, gl.GL_LINEAR_MIPMAP_LINEAR)
        gl.glPixelStorei(gl.GL_UNPACK_ALIGNMENT, 1)
        layout = gl.GL_RGB if n_channels == 3 else gl.GL_RGBA
        texels = model.tex_data[first : first + size[0] * size[1] * n_channels]
        gl.glTexImage2D(gl.GL_TEXTURE_2D, 0, layout, *size, 0, layout, gl.GL_UNSIGNED_BYTE, texels)
        gl.glGenerateMipmap(gl.GL_TEXTURE_2D)
        return name

    def _make_shadow_map(self, size_px: int) -> None:
        gl = self._gl
        self._shadow_px = size_px
        gl.glActiveTexture(gl.GL_TEXTURE1)
        texture = gl.glGenTextures(1)
        gl.glBindTexture(gl.GL_TEXTURE_2D, texture)
        size, layout = (size_px, size_px), (gl.GL_DEPTH_COMPONENT, gl.GL_UNSIGNED_INT)
        gl.glTexImage2D(gl.GL_TEXTURE_2D, 0, gl.GL_DEPTH_COMPONENT24, *size, 0, *layout, None)
        for key, value in (
            (gl.GL_TEXTURE_MIN_FILTER, gl.GL_LINEAR),
            (gl.GL_TEXTURE_MAG_FILTER, gl.GL_LINEAR),
            (gl.GL_TEXTURE_WRAP_S, gl.GL_CLAMP_TO_EDGE),
            (gl.GL_TEXTURE_WRAP_T, gl.GL_CLAMP_TO_EDGE),
            (gl.GL_TEXTURE_COMPARE_MODE, gl.GL_COMPARE_REF_TO_TEXTURE),
            (gl.GL_TEXTURE_COMPARE_FUNC, gl.GL_GEQUAL),
        ):
            gl.glTexParameteri(gl.GL_TEXTURE_2D, key, value)
        gl.glActiveTexture(gl.GL_TEXTURE0)
        self._shadow_frame = gl.glGenFramebuffers(1)
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, self._shadow_frame)
        gl.glFramebufferTexture2D(gl.GL_FRAMEBUFFER, gl.GL_DEPTH_ATTACHMENT, gl.GL_TEXTURE_2D, texture, 0)
        gl.glDrawBuffer(gl.GL_NONE)
        # Nothing but the drawn part is ever cleared again.
        gl.glClearDepth(0.0)
        gl.glClear(gl.GL_DEPTH_BUFFER_BIT)

    def _make_frame(self, n_samples: int) -> int:
        """Colour, geom ids and depth."""
        gl = self._gl
        frame = gl.glGenFramebuffers(1)
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, frame)
        parts = [gl.GL_COLOR_ATTACHMENT0, gl.GL_COLOR_ATTACHMENT1, gl.GL_DEPTH_ATTACHMENT]
        layouts = [gl.GL_RGBA8, gl.GL_R32I, gl.GL_DEPTH_COMPONENT32F]
        for part, layout in zip(parts, layouts, strict=True):
            target = gl.glGenRenderbuffers(1)
            gl.glBindRenderbuffer(gl.GL_RENDERBUFFER, target)
            gl.glRenderbufferStorageMultisample(gl.GL_RENDERBUFFER, n_samples, layout, *self._size_px)
            gl.glFramebufferRenderbuffer(gl.GL_FRAMEBUFFER, part, gl.GL_RENDERBUFFER, target)
        gl.glDrawBuffers(2, parts[:2])
        state = gl.glCheckFramebufferStatus(gl.GL_FRAMEBUFFER)
        if state != gl.GL_FRAMEBUFFER_COMPLETE:
            raise RuntimeError(f"OpenGL has no frame of {self._size_px} px with {n_samples} samples: {state}")
        return frame

    def _choose(self, camera: int) -> None:
        self._size_px = self._world.image_sizes_px[camera]
        self._frame, self._smooth_frame = self._frames[self._size_px]

    def draw(self, camera: int) -> None:
        """Draws the present state through one of the world's cameras; reading is of this picture."""
        self._choose(camera)
        gl, model, data, drawing = self._gl, self._world.model, self._world.data, self._drawing
        for span in drawing.repaint():
            part = drawing.vertices[span]
            gl.glBindBuffer(gl.GL_ARRAY_BUFFER, self._vertex_buffer)
            gl.glBufferSubData(gl.GL_ARRAY_BUFFER, 4 * N_COLUMNS * span.start, part.nbytes, part)
        view = camera_view(model, data, self._world.camera_ids[camera], self._size_px)
        center_m = drawing.centers_in_world_m(data)
        planes = view.planes()
        inside_m = center_m @ planes[:, :3].T + planes[:, 3]
        is_seen = (inside_m > -drawing.reach_along_m(data, planes[:, :3])).all(axis=1)
        gl.glEnable(gl.GL_DEPTH_TEST)
        gl.glDepthFunc(gl.GL_GEQUAL)
        gl.glClearDepth(0.0)
        # Ground and walls hide much of a town: their depths tell what need not be drawn.
        self._start(self._frame)
        self._depth_only.use()
        self._depth_only.set_matrix("clip_from_world", view.clip_from_world)
        seen = np.flatnonzero(is_seen)
        self._draw_chunks(seen[drawing.texture[seen] >= 0], self._depth_only)
        depths = Depths(view, self._read_depth())
        seen = seen[~depths.hides(drawing.corners_in_world_m(data, seen))]
        shadow_from_world = np.eye(4)
        if self._has_shadow:
            shadow_from_world = self._draw_shadows(view, depths, center_m, seen)
        lights = self._lights.values(data, -view.axes[2])
        for program in (self._plain, self._textured):
            program.use()
            program.set_matrix("clip_from_world", view.clip_from_world)
            program.set_matrix("shadow_from_world", shadow_from_world)
            program.set_vectors("eye", view.eye_m)
            program.set_vectors("lights", lights)
            program.set_unit("picture", 0)
            program.set_unit("shadow_map", 1)
        # Near things first, lest what they hide is painted in vain.
        far_m = np.linalg.norm(center_m[seen] - view.eye_m, axis=1) - drawing.radius_m[seen]
        seen = seen[np.lexsort((far_m, drawing.texture[seen]))]
        self._fill(self._frame, seen)
        if self._smooth_frame is None:
            return
        self._start(self._smooth_frame)
        self._fill(self._smooth_frame, seen)
        gl.glBindFramebuffer(gl.GL_READ_FRAMEBUFFER, self._smooth_frame)
        gl.glBindFramebuffer(gl.GL_DRAW_FRAMEBUFFER, self._frame)
        gl.glReadBuffer(gl.GL_COLOR_ATTACHMENT0)
        gl.glDrawBuffers(2, [gl.GL_COLOR_ATTACHMENT0, gl.GL_NONE])
        whole = (0, 0, *self._size_px)
        gl.glBlitFramebuffer(*whole, *whole, gl.GL_COLOR_BUFFER_BIT, gl.GL_NEAREST)

    def _start(self, frame: int) -> None:
        """Clears a frame, and makes depths all that is drawn."""
        gl = self._gl
        self._aim(frame)
        gl.glClearBufferfv(gl.GL_COLOR, 0, np.zeros(4, dtype=np.float32))
        gl.glClearBufferiv(gl.GL_COLOR, 1, np.full(4, -1, dtype=np.int32))
        gl.glClear(gl.GL_DEPTH_BUFFER_BIT)
        gl.glDrawBuffer(gl.GL_NONE)

    def _aim(self, frame: int) -> None:
        gl = self._gl
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, frame)
        gl.glDrawBuffers(2, [gl.GL_COLOR_ATTACHMENT0, gl.GL_COLOR_ATTACHMENT1])
        # Row 0 at the top.
        gl.glClipControl(gl.GL_UPPER_LEFT, gl.GL_ZERO_TO_ONE)
        gl.glViewport(0, 0, *self._size_px)
        gl.glEnable(gl.GL_CULL_FACE)

    def _fill(self, frame: int, seen: NDArray[np.int64]) -> None:
        gl = self._gl
        self._aim(frame)
        textures = self._drawing.texture[seen]
        for texture in np.unique(textures).tolist():
            if texture >= 0:
                gl.glBindTexture(gl.GL_TEXTURE_2D, self._textures[texture])
            self._draw_chunks(seen[textures == texture], self._plain if texture < 0 else self._textured)

    def _draw_shadows(self, view: View, depths: Depths, center_m: Array, seen: NDArray[np.int64]) -> Array:
        """Fills the part of the shadow map that the camera can see; returns the way into the map."""
        gl, model, data, drawing = self._gl, self._world.model, self._world.data, self._drawing
        n = self._shadow_px
        sun, reach_m = sun_view(model, data, self._lights.casting, view), shadow_reach_m(model)
        eye, axes = sun.axes[:2] @ sun.eye_m, sun.axes[:2]
        half_m = drawing.reach_along_m(data, np.concatenate([axes, [[0.0, 0.0, 1.0]]]))
        low_m = (center_m[:, 2] - half_m[:, 2])[seen].min(initial=view.eye_m[2])
        high_m = (center_m[:, 2] + half_m[:, 2])[seen].max(initial=view.eye_m[2])
        corners = outline_m(view, reach_m, low_m, high_m) @ axes.T - eye
        # Shadows fall on what the depths hold and on the things before it.
        in_map = center_m @ axes.T - eye
        boxes = in_map - half_m[:, :2], in_map + half_m[:, :2]
        things = seen[drawing.texture[seen] < 0]
        lows, highs = depths.boxes(axes)
        lows = np.concatenate([lows - eye, boxes[0][things]])
        highs = np.concatenate([highs - eye, boxes[1][things]])
        low = np.maximum(lows.min(axis=0, initial=np.inf), corners.min(axis=0)).clip(-reach_m, reach_m)
        high = np.minimum(highs.max(axis=0, initial=-np.inf), corners.max(axis=0)).clip(-reach_m, reach_m)
        # Where there is only sky, nothing is drawn.
        high = np.maximum(low, high)
        margin_m = _MARGIN_TEXELS * 2 * reach_m / n
        is_beside = (boxes[0] > high + margin_m) | (boxes[1] < low - margin_m)
        casters = np.flatnonzero(drawing.casts_shadow & ~is_beside.any(axis=1))
        shown = Shown(low, high, lows, highs, margin_m)
        casters = casters[shown.meets(boxes[0][casters], boxes[1][casters])]
        # A texel more than is seen on each side. The map's own edge stays clear: all beyond is in the light.
        first = np.floor((low / reach_m + 1) / 2 * n).astype(int).clip(2, n - 2) - 1
        last = np.ceil((high / reach_m + 1) / 2 * n).astype(int).clip(2, n - 2) + 1
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, self._shadow_frame)
        gl.glClipControl(gl.GL_LOWER_LEFT, gl.GL_ZERO_TO_ONE)
        gl.glViewport(0, 0, n, n)
        gl.glEnable(gl.GL_SCISSOR_TEST)
        gl.glScissor(*first.tolist(), *(last - first).tolist())
        gl.glClear(gl.GL_DEPTH_BUFFER_BIT)
        gl.glEnable(gl.GL_POLYGON_OFFSET_FILL)
        gl.glPolygonOffset(*_SHADOW_OFFSET)
        self._depth_only.use()
        self._depth_only.set_matrix("clip_from_world", sun.clip_from_world)
        # The light, too, sees only outer sides, but for the ground's.
        is_ground = drawing.is_ground[casters]
        gl.glEnable(gl.GL_CULL_FACE)
        self._draw_chunks(casters[~is_ground], self._depth_only)
        gl.glDisable(gl.GL_CULL_FACE)
        self._draw_chunks(casters[is_ground], self._depth_only)
        gl.glDisable(gl.GL_SCISSOR_TEST)
        gl.glDisable(gl.GL_POLYGON_OFFSET_FILL)
        map_from_clip = np.diag([0.5, 0.5, 1.0, 1.0])
        map_from_clip[:2, 3] = 0.5
        return map_from_clip @ sun.clip_from_world

    def _draw_chunks(self, chunks: NDArray[np.int64], program: Program) -> None:
        gl, data, drawing = self._gl, self._world.data, self._drawing
        program.use()
        counts = (3 * (drawing.end - drawing.begin)[chunks]).astype(np.int32)
        offsets = (3 * drawing.faces.itemsize * drawing.begin[chunks]).astype(np.uintp)
        body = drawing.body[chunks]
        for i in np.flatnonzero(body > 0).tolist():
            world_from_body = np.eye(4)
            world_from_body[:3, :3] = data.xmat[body[i]].reshape(3, 3)
            world_from_body[:3, 3] = data.xpos[body[i]]
            program.set_matrix("world_from_body", world_from_body)
            place = ctypes.c_void_p(int(offsets[i]))
            gl.glDrawElements(gl.GL_TRIANGLES, int(counts[i]), gl.GL_UNSIGNED_INT, place)
        is_still = body == 0
        counts, offsets = counts[is_still], offsets[is_still]
        program.set_matrix("world_from_body", _STILL)
        self._draw_many(
            gl.GL_TRIANGLES,
            counts.ctypes.data_as(ctypes.POINTER(ctypes.c_int)),
            gl.GL_UNSIGNED_INT,
            ctypes.cast(offsets.ctypes.data, ctypes.POINTER(ctypes.c_void_p)),
            len(counts),
        )

    def read_rgb(self) -> NDArray[np.uint8]:
        """Colours of what was drawn: [height, width, 3], row 0 at the top, as all that is read."""
        gl = self._gl
        rgb = np.empty((self._size_px[1], self._size_px[0], 3), dtype=np.uint8)
        self._read(self._frame, gl.GL_COLOR_ATTACHMENT0, gl.GL_RGB, gl.GL_UNSIGNED_BYTE, rgb)
        return rgb

    def read_geoms(self) -> NDArray[np.int32]:
        """Geom ids of what was drawn, -1 where nothing was: [height, width]."""
        gl = self._gl
        geoms = np.empty((self._size_px[1], self._size_px[0]), dtype=np.int32)
        self._read(self._frame, gl.GL_COLOR_ATTACHMENT1, gl.GL_RED_INTEGER, gl.GL_INT, geoms)
        return geoms

    def read_depth_m(self) -> NDArray[np.float32]:
        """Distances along the optical axis, infinite where nothing was drawn: [height, width]."""
        model, depth = self._world.model, self._read_depth()
        near_m, far_m = (getattr(model.vis.map, name) * model.stat.extent for name in ("znear", "zfar"))
        is_sky = depth <= 0
        # depth = near (far - d) / (d (far - near)), turned round.
        depth *= np.float32(far_m - near_m)
        depth += np.float32(near_m)
        np.divide(np.float32(near_m * far_m), depth, out=depth)
        depth[is_sky] = np.inf
        return depth

    def _read_depth(self) -> NDArray[np.float32]:
        gl = self._gl
        depth = np.empty((self._size_px[1], self._size_px[0]), dtype=np.float32)
        self._read(self._frame, gl.GL_COLOR_ATTACHMENT0, gl.GL_DEPTH_COMPONENT, gl.GL_FLOAT, depth)
        return depth

    def _read(self, frame: int, part: int, layout: int, kind: int, into: NDArray[np.generic]) -> None:
        gl = self._gl
        gl.glBindFramebuffer(gl.GL_READ_FRAMEBUFFER, frame)
        gl.glReadBuffer(part)
        gl.glPixelStorei(gl.GL_PACK_ALIGNMENT, 1)
        gl.glReadPixels(0, 0, *self._size_px, layout, kind, into)
