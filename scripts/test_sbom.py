"""What `make sbom` keeps of the descriptions that it merges."""

from email.parser import HeaderParser

import pytest
import sbom


def crate(name: str) -> dict:
    return {
        "bom-ref": f"registry#{name}@1.0",
        "name": name,
        "version": "1.0",
        "purl": f"pkg:cargo/{name}@1.0",
    }


def descriptions() -> tuple[dict, dict]:
    root = {"bom-ref": "path#harmzone@0.1.0", "name": "harmzone", "version": "0.1.0"}
    crates = {
        "metadata": {
            "component": root,
            "tools": [{"vendor": "x", "name": "cargo-cyclonedx", "version": "1"}],
        },
        "components": [crate("linked"), crate("helping"), crate("only_locked")],
        "dependencies": [
            {"ref": root["bom-ref"], "dependsOn": ["registry#linked@1.0", "registry#only_locked@1.0"]},
            {"ref": "registry#only_locked@1.0"},
        ],
    }
    package = {"bom-ref": "requirements-L2", "name": "NumPy", "version": "2.0", "purl": "pkg:pypi/numpy@2.0"}
    return crates, {"metadata": {}, "components": [package | {"description": "requirements line 2: .."}]}


def test_only_what_is_compiled_is_kept():
    crates, packages = descriptions()
    linked = {"harmzone@0.1.0", "linked@1.0"}
    bom = sbom.merge(crates, linked, {"helping@1.0"}, packages, {"numpy@2.0": {"expression": "BSD-3-Clause"}})
    kept = {part["bom-ref"]: part["scope"] for part in bom["components"]}
    assert kept == {
        "pkg:pypi/numpy@2.0": "required",
        "registry#helping@1.0": "excluded",
        "registry#linked@1.0": "required",
    }
    assert bom["components"][0]["licenses"] == [{"expression": "BSD-3-Clause"}]
    needed = {entry["ref"]: entry.get("dependsOn") for entry in bom["dependencies"]}
    assert needed["path#harmzone@0.1.0"] == ["pkg:pypi/numpy@2.0", "registry#linked@1.0"]
    assert not {"timestamp", "serialNumber"} & (bom.keys() | bom["metadata"].keys())


def test_a_crate_that_is_not_described_is_a_fault():
    crates, packages = descriptions()
    with pytest.raises(SystemExit, match=r"does not know new@1\.0"):
        sbom.merge(crates, {"harmzone@0.1.0", "new@1.0"}, set(), packages, {})


@pytest.mark.parametrize(
    ("told", "wanted"),
    [
        ("License-Expression: MIT", {"expression": "MIT"}),
        ("License: BSD", {"license": {"name": "BSD"}}),
        ("Classifier: License :: OSI Approved :: BSD License", {"license": {"name": "BSD License"}}),
        ("Name: none", None),
    ],
)
def test_a_licence_is_read_in_whatever_form_a_package_tells_it(told, wanted):
    assert sbom.told_license(HeaderParser().parsestr(told)) == wanted
