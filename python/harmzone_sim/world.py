"""A compiled MuJoCo model and its state."""

import platform
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Warnings after which the state is no longer a result of the physics (MuJoCo resets it by itself).
_FATAL_WARNINGS = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
    mujoco.mjtWarning.mjWARN_BADCTRL,
)


def library_versions() -> tuple[str, str]:
    """MuJoCo's version; the C library's name and version."""
    return mujoco.mj_versionString(), " ".join(platform.libc_ver())


class Mounted(NamedTuple):
    """A camera in the frame of the body that carries it.

    position_m: [3]. quaternion: [4] (w, x, y, z; MuJoCo looks along -z, up is y). size_px: width, height.
    """

    position_m: Array
    quaternion: Array
    fovy_deg: float
    size_px: tuple[int, int]


class World:
    """A model with cameras mounted on a body, and its simulated state."""

    def __init__(
        self,
        xml: str,
        assets: Mapping[str, bytes],
        camera_body: str,
        cameras: Sequence[Mounted],
        n_samples: int,
        shadow_size_px: int,
    ) -> None:
        """Compiles the model with at least one camera on `camera_body`."""
        cameras = [Mounted(*camera) for camera in cameras]
        spec = mujoco.MjSpec.from_string(xml, assets=dict(assets))
        body = spec.body(camera_body)
        if body is None:
            raise ValueError(f"the model has no body `{camera_body}`")
        names = [f"harmzone_camera_{i}" for i in range(len(cameras))]
        for name, camera in zip(names, cameras, strict=True):
            body.add_camera(name=name, pos=camera.position_m, quat=camera.quaternion, fovy=camera.fovy_deg)
        self.image_sizes_px = [camera.size_px for camera in cameras]
        widths_px, heights_px = zip(*self.image_sizes_px, strict=True)
        spec.visual.global_.offwidth, spec.visual.global_.offheight = max(widths_px), max(heights_px)
        spec.visual.quality.offsamples = n_samples
        spec.visual.quality.shadowsize = shadow_size_px
        # A narrower shadow frustum speckles the road: its depth bias is too small there (measured).
        spec.visual.map.shadowclip = 2.0
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.camera_ids = [self.model.camera(name).id for name in names]
        mujoco.mj_forward(self.model, self.data)

    def names(self, kind: str) -> list[str]:
        """Names in id order; `kind` is body, joint, actuator or geom."""
        obj = getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}")
        count = {
            "body": self.model.nbody,
            "joint": self.model.njnt,
            "actuator": self.model.nu,
            "geom": self.model.ngeom,
        }[kind]
        return [mujoco.mj_id2name(self.model, obj, i) or "" for i in range(count)]

    def timestep_s(self) -> float:
        """Time that one physics step takes, in seconds."""
        return float(self.model.opt.timestep)

    def geom_bodies(self) -> NDArray[np.int32]:
        """Body id of each geom: [geom]."""
        return np.ascontiguousarray(self.model.geom_bodyid, dtype=np.int32)

    def geom_materials(self) -> list[str]:
        """Name of each geom's material, empty where it has none."""
        kind = mujoco.mjtObj.mjOBJ_MATERIAL
        names = [mujoco.mj_id2name(self.model, kind, i) or "" for i in range(self.model.nmat)]
        return [names[i] if i >= 0 else "" for i in self.model.geom_matid]

    def geom_centers(self) -> Array:
        """Centres of all geoms in the world frame: [geom, 3]."""
        return np.ascontiguousarray(self.data.geom_xpos)

    def mocap_ids(self) -> NDArray[np.int32]:
        """Mocap id of each body, -1 where it is none: [body]."""
        return np.ascontiguousarray(self.model.body_mocapid, dtype=np.int32)

    def step(self, ctrl: Array, mocap_id: NDArray[np.int64], mocap_pose: Array, n_steps: int) -> None:
        """Sets controls and mocap poses, advances `n_steps`, brings all poses up to the new state.

        ctrl: [actuator]. mocap_id: [mover]. mocap_pose: [mover, 7], position and quaternion w, x, y, z.
        """
        self._command(ctrl, mocap_id, mocap_pose)
        if n_steps > 0:
            mujoco.mj_step(self.model, self.data, n_steps)
        self._bring_up()

    def _command(self, ctrl: Array, mocap_id: NDArray[np.int64], mocap_pose: Array) -> None:
        data = self.data
        data.ctrl[:] = ctrl
        data.mocap_pos[mocap_id] = mocap_pose[:, :3]
        data.mocap_quat[mocap_id] = mocap_pose[:, 3:]

    def _bring_up(self) -> None:
        """Checks that the physics is stable, and brings all poses up to the present state."""
        model, data = self.model, self.data
        for warning in _FATAL_WARNINGS:
            if data.warning[warning].number:
                raise FloatingPointError(f"unstable at {data.time:.3f} s of simulated time: {warning.name}")
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_camlight(model, data)

    def step_touching(
        self,
        ctrl: Array,
        mocap_id: NDArray[np.int64],
        mocap_pose: Array,
        n_steps: int,
        body: int,
        ground: str,
    ) -> tuple[NDArray[np.int32], Array]:
        """Steps as `step` does, and tells what a free body and its parts touch, but for the geom `ground`.

        Returns body [touch], the touched ones, each once, and [touch, 12]: the free body's velocity and the
        touched body's, just before they touched, both at the point where they touch, and the contact's normal
        out of the free body, all along the world's axes; then that point in the free body's frame. A body
        that is moved by hand has no velocity of its own: zeros.
        """
        model, data = self.model, self.data
        is_own = model.body_rootid[model.geom_bodyid] == body
        is_ground = np.zeros(model.ngeom, dtype=bool)
        is_ground[model.geom(ground).id] = True
        touched: dict[int, Array] = {}
        self._command(ctrl, mocap_id, mocap_pose)
        for _ in range(n_steps):
            velocities = data.qvel.copy()
            mujoco.mj_step(model, data)
            geoms = data.contact.geom
            first, second = geoms[:, 0], geoms[:, 1]
            meets = (is_own[first] != is_own[second]) & ~(is_ground[first] | is_ground[second])
            for i in np.flatnonzero(meets):
                is_first = is_own[first[i]]
                other = int(model.geom_bodyid[second[i] if is_first else first[i]])
                if other in touched:
                    continue
                normal = data.contact.frame[i, :3] if is_first else -data.contact.frame[i, :3]
                both = [self._velocity_at(data.contact.pos[i], one, velocities) for one in (body, other)]
                point = (data.contact.pos[i] - data.xpos[body]) @ data.xmat[body].reshape(3, 3)
                touched[other] = np.concatenate([*both, normal, point])
        self._bring_up()
        facts = np.array(list(touched.values()), dtype=np.float64).reshape(len(touched), 12)
        return np.array(list(touched), dtype=np.int32), facts

    def _velocity_at(self, point_m: Array, body: int, velocities: Array) -> Array:
        """A free body's velocity at a point, along the world's axes: [3]; zeros for a body that is not free.

        velocities: the generalized ones, of the instant whose poses `data` holds.
        """
        model, data = self.model, self.data
        if model.body_dofnum[body] != 6:
            return np.zeros(3)
        dof = model.body_dofadr[body]
        # A free joint counts its origin's velocity along the world's axes, its spin along its own.
        spin_rps = data.xmat[body].reshape(3, 3) @ velocities[dof + 3 : dof + 6]
        return velocities[dof : dof + 3] + np.cross(spin_rps, point_m - data.xpos[body])

    def body_masses(self) -> Array:
        """Mass of each body with all that hangs on it: [body]."""
        return np.ascontiguousarray(self.model.body_subtreemass)

    def set_materials(self, geoms: list[str], materials: list[str]) -> None:
        """Gives each geom the material of the same place in the other list, both by name."""
        for geom, material in zip(geoms, materials, strict=True):
            self.model.geom_matid[self.model.geom(geom).id] = self.model.material(material).id

    def release(self, body: int, linear_mps: Array, angular_rps: Array) -> None:
        """Lets a body go that a weld holds, with a velocity.

        linear_mps: [3], of the centre of mass. angular_rps: [3]. Both along the world's axes.
        """
        model, data = self.model, self.data
        is_weld = model.eq_type == mujoco.mjtEq.mjEQ_WELD
        holds = is_weld & (model.eq_obj1id == body) & (data.eq_active != 0)
        if not holds.any():
            raise ValueError(f"body {body} is not held")
        data.eq_active[holds] = 0
        dof = model.jnt_dofadr[model.body_jntadr[body]]
        world_from_body = data.xmat[body].reshape(3, 3)
        from_origin_m = world_from_body @ model.body_ipos[body]
        # A free joint counts its origin's velocity along the world's axes, its spin along its own.
        data.qvel[dof : dof + 3] = linear_mps - np.cross(angular_rps, from_origin_m)
        data.qvel[dof + 3 : dof + 6] = world_from_body.T @ angular_rps

    def body_poses(self) -> Array:
        """Poses in the world frame: [body, 7], position and quaternion w, x, y, z."""
        return np.concatenate([self.data.xpos, self.data.xquat], axis=1)

    def body_velocity(self, body: int) -> Array:
        """Velocity of a body's origin along the body's own axes: [6], angular then linear."""
        velocity = np.zeros(6)
        obj = mujoco.mjtObj.mjOBJ_XBODY
        mujoco.mj_comVel(self.model, self.data)
        mujoco.mj_objectVelocity(self.model, self.data, obj, body, velocity, 1)
        return velocity

    def joint_positions(self) -> Array:
        """First position coordinate of each joint: [joint]."""
        return self.data.qpos[self.model.jnt_qposadr]
