"""Every object model as a free body: dropped on a plane, it comes to rest on it."""

import tomllib
from pathlib import Path

import mujoco
import numpy as np
import pytest

ASSETS = Path(__file__).parents[2] / "mjcf_assets"
TOWNS = ASSETS.parent / "scenes"
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
    assert len(kinds["id", "vehicle"]) >= 8 + 16 + 1  # and the ego's
    assert len(kinds["id", "static"]) >= 11
    out_of_distribution = {group: names for (which, group), names in kinds.items() if which == "ood"}
    assert sum(len(names) >= 3 for names in out_of_distribution.values()) >= 11, out_of_distribution


# Length, width with mirrors and doors, height: of the smallest and largest that drive on real streets.
VEHICLE_SIZES_M = {
    "car": ((3.4, 1.6, 1.2), (5.1, 2.7, 1.9)),
    "van": ((4.2, 1.8, 1.7), (7.0, 2.6, 3.2)),
    "truck": ((5.0, 1.9, 1.7), (12.5, 3.1, 3.6)),
}
VEHICLE_MASS_KG = {"car": (800, 2200), "van": (1300, 3500), "truck": (1800, 18000)}
MOST_TRIANGLES = 2500


def test_vehicles_are_as_large_and_heavy_as_real_ones_and_cheap_to_draw():
    n_cars = 0
    for name in MODELS:
        spec = mujoco.MjSpec.from_file(str(ASSETS / name / "model.xml"))
        category = {t.name: t.data for t in spec.texts}["category"]
        if category not in VEHICLE_SIZES_M:
            continue
        n_cars += category == "car"
        model = spec.compile()
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        points, n_triangles = [], 0
        for geom in np.flatnonzero(model.geom_group == 2):
            mesh = model.geom_dataid[geom]
            start = model.mesh_vertadr[mesh]
            vertices = model.mesh_vert[start : start + model.mesh_vertnum[mesh]]
            points.append(vertices @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom])
            n_triangles += int(model.mesh_facenum[mesh])
        size = np.ptp(np.concatenate(points), axis=0)
        low, high = VEHICLE_SIZES_M[category]
        assert (size >= low).all() and (size <= high).all(), (name, size)
        least_kg, most_kg = VEHICLE_MASS_KG[category]
        assert least_kg <= model.body_mass.sum() <= most_kg, name
        assert n_triangles <= MOST_TRIANGLES, (name, n_triangles)
    assert n_cars >= 2 * 2


def test_a_model_with_an_open_door_never_drives():
    tables = [tomllib.loads(path.read_text())["traffic"] for path in TOWNS.glob("*/town.toml")]
    assert any(name.endswith("_door_open") for table in tables for name in table["parked_weights"])
    assert not any(name.endswith("_door_open") for table in tables for name in table["vehicle_weights"])
    for name in (name for name in MODELS if name.endswith("_door_open")):
        spec = mujoco.MjSpec.from_file(str(ASSETS / name / "model.xml"))
        assert {n.name: list(n.data) for n in spec.numerics}["weight"] == [0.0], name
