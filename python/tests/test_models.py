"""Every object model as a free body: dropped on a plane, it comes to rest on it."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

ASSETS = Path(__file__).parents[2] / "mjcf_assets"
MODELS = sorted(path.parent.name for path in ASSETS.glob("*/model.xml"))
STEP_S = 0.005
N_STEPS = 1000
DROP_M = 0.05
# A contact gives way by millimetres; what lies deeper has sunk in.
DEEPEST_M = 0.02
# A sharp edge of a hull, or a handle that no collision shape holds, may lie off the plane by this.
OFF_PLANE_M = 0.06
AT_REST_MPS = 0.05


def dropped(name: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    spec = mujoco.MjSpec.from_file(str(ASSETS / name / "model.xml"))
    spec.option.timestep = STEP_S
    # As the worlds of harmzone set it.
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 5
    spec.worldbody.add_geom(
        name="ground", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], friction=[1.1, 0.005, 0.0001]
    )
    body = spec.body(name)
    body.pos = [0, 0, DROP_M]
    body.add_freejoint()
    model = spec.compile()
    return model, mujoco.MjData(model)


def lowest_point_m(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Of the meshes that are seen."""
    lowest = np.inf
    for geom in np.flatnonzero(model.geom_group == 2):
        mesh = model.geom_dataid[geom]
        start = model.mesh_vertadr[mesh]
        vertices = model.mesh_vert[start : start + model.mesh_vertnum[mesh]]
        z = vertices @ data.geom_xmat[geom].reshape(3, 3)[2] + data.geom_xpos[geom, 2]
        lowest = min(lowest, float(z.min()))
    return lowest


@pytest.mark.parametrize("name", MODELS)
def test_a_dropped_model_comes_to_rest_on_the_ground(name):
    model, data = dropped(name)
    deepest_m = 0.0
    for _ in range(N_STEPS):
        mujoco.mj_step(model, data)
        if data.ncon:
            deepest_m = max(deepest_m, -float(data.contact.dist.min()))
    assert not any(warning.number for warning in data.warning)
    assert np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all()
    assert deepest_m < DEEPEST_M
    assert np.linalg.norm(data.qvel[:3]) < AT_REST_MPS and np.linalg.norm(data.qvel[3:]) < 4 * AT_REST_MPS
    mujoco.mj_kinematics(model, data)
    assert -DEEPEST_M < lowest_point_m(model, data) < OFF_PLANE_M


def test_a_body_that_no_shape_holds_would_be_noticed():
    spec = mujoco.MjSpec.from_string(
        '<mujoco><worldbody><geom type="plane" size="0 0 1"/><body pos="0 0 0.1"><freejoint/>'
        '<geom type="box" size="0.1 0.1 0.1" contype="0" conaffinity="0"/></body></worldbody></mujoco>'
    )
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, N_STEPS)
    assert data.qpos[2] < -DEEPEST_M


def test_there_are_as_many_shapes_as_the_readme_says():
    kinds: dict[tuple[str, str], list[str]] = {}
    for name in MODELS:
        texts = {t.name: t.data for t in mujoco.MjSpec.from_file(str(ASSETS / name / "model.xml")).texts}
        group = texts["category"] if texts["distribution"] == "ood" else texts["kind"]
        kinds.setdefault((texts["distribution"], group), []).append(name)
    assert len(kinds["id", "vehicle"]) >= 6 + 1  # and the ego's
    assert len(kinds["id", "pedestrian"]) >= 4
    assert len(kinds["id", "static"]) >= 11
    out_of_distribution = {group: names for (which, group), names in kinds.items() if which == "ood"}
    assert sum(len(names) >= 3 for names in out_of_distribution.values()) >= 11, out_of_distribution
