"""The out-of-distribution kinds: which split they are of, how their shapes differ, and that none is a box."""

from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest
from test_models import dropped, lowest_point_m

ASSETS = Path(__file__).parents[2] / "mjcf_assets"
MOST_TRIANGLES = 2600


def texts(name: str) -> dict[str, str]:
    spec = mujoco.MjSpec.from_file(str(ASSETS / name / "model.xml"))
    return {text.name: text.data for text in spec.texts}


FACTS = {path.parent.name: texts(path.parent.name) for path in sorted(ASSETS.glob("*/model.xml"))}
OOD = [name for name, facts in FACTS.items() if facts["distribution"] == "ood"]
TEST = [name for name in OOD if FACTS[name].get("split") == "test"]


def shapes_by_kind(names: list[str]) -> dict[str, list[str]]:
    kinds: dict[str, list[str]] = {}
    for name in names:
        kinds.setdefault(FACTS[name]["category"], []).append(name)
    return kinds


@cache
def seen(name: str) -> tuple[np.ndarray, float]:
    """Corners of the triangles that are seen [triangle, 3, 3], and the mass."""
    model = mujoco.MjModel.from_xml_path(str(ASSETS / name / "model.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    triangles = []
    for geom in np.flatnonzero(model.geom_group == 2):
        mesh = model.geom_dataid[geom]
        v = model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]]
        f = model.mesh_face[model.mesh_faceadr[mesh] :][: model.mesh_facenum[mesh]]
        triangles.append((v @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom])[f])
    return np.concatenate(triangles), float(model.body_mass.sum())


def size_m(name: str) -> np.ndarray:
    corners = seen(name)[0].reshape(-1, 3)
    return corners.max(0) - corners.min(0)


def test_fourteen_kinds_and_more_are_of_the_test_split_alone_each_in_three_shapes():
    dev, test = shapes_by_kind([name for name in OOD if name not in TEST]), shapes_by_kind(TEST)
    assert len(test) >= 14 and len(dev) >= 11
    assert not set(dev) & set(test)
    assert all(len(names) >= 3 for names in test.values()), test


@pytest.mark.parametrize("kind", shapes_by_kind(TEST))
def test_the_shapes_of_a_kind_differ_in_size_and_colour(kind):
    names = shapes_by_kind(TEST)[kind]
    for i, one in enumerate(names):
        for other in names[i + 1 :]:
            ratio = size_m(one) / size_m(other)
            assert np.maximum(ratio, 1 / ratio).max() > 1.15, (one, other)
            colours = [
                {tuple(m.rgba) for m in mujoco.MjSpec.from_file(str(ASSETS / n / "model.xml")).materials}
                for n in (one, other)
            ]
            assert colours[0] != colours[1], (one, other)


@pytest.mark.parametrize("name", TEST)
def test_a_shape_is_of_a_sane_size_and_no_box(name):
    triangles, mass_kg = seen(name)
    size = size_m(name)
    assert 100 < len(triangles) < MOST_TRIANGLES
    assert size.min() > 0.08 and size.max() < 4.0
    # From cardboard to rock, as heavy as its bounds allow.
    assert 5 < mass_kg / size.prod() < 2600 and 0.8 < mass_kg < 700
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    areas = np.linalg.norm(normals, axis=1) / 2
    oblique = np.abs(normals).max(1) < 0.98 * 2 * areas
    share = areas[oblique].sum() / areas.sum()
    volume = np.einsum("ij,ij->i", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])).sum() / 6
    assert 0 < volume < 0.75 * size.prod()
    # Few faces lie along the box's, or there is little in it.
    assert share > 0.2 or volume < 0.35 * size.prod()


def may_be_thrown(name: str) -> bool:
    """As `src/scene/events.rs` chooses: small and light, very light, or round."""
    mass_kg = seen(name)[1]
    return "rolls" in FACTS[name] or mass_kg <= 6 or (mass_kg <= 25 and size_m(name).max() < 1.1)


@pytest.mark.parametrize("name", [name for name in TEST if may_be_thrown(name)])
def test_what_events_throw_tumbles_and_lies_on_the_ground(name):
    model, data = dropped(name)
    data.qpos[2] = 4.0
    data.qvel[:] = [6.0, 0.5, 1.5, 1.0, -2.5, 2.0]
    for _ in range(1600):
        mujoco.mj_step(model, data)
    assert not any(warning.number for warning in data.warning)
    assert data.qpos[0] > 2.0
    # What is round may roll on.
    assert "rolls" in FACTS[name] or np.linalg.norm(data.qvel) < 0.1
    mujoco.mj_kinematics(model, data)
    assert -0.03 < lowest_point_m(model, data) < 0.08


def test_animals_are_never_thrown():
    animals = [name for name in TEST if FACTS[name]["category"] in ("dog", "deer", "boar")]
    assert len(animals) == 9 and not any(map(may_be_thrown, animals))


def test_the_scripts_write_what_lies_here(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(ASSETS))
    import make_models
    import model_writer

    monkeypatch.setattr(model_writer, "ASSETS", tmp_path)
    for model in make_models.test_props():
        model.write()
    written = sorted(path.relative_to(tmp_path) for path in tmp_path.rglob("*") if path.is_file())
    assert {path.parts[0] for path in written} == set(TEST)
    for path in written:
        assert (tmp_path / path).read_bytes() == (ASSETS / path).read_bytes(), path
