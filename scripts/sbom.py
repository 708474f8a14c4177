"""Lists the crates and Python packages that harmzone is made of, as a CycloneDX file (`make sbom`).

cargo-cyclonedx describes the crates of Cargo.lock, and cargo says which of them are compiled for Linux on
x86-64 and aarch64: those that are linked have the scope `required`, those that only help to compile are
`excluded`. cyclonedx-bom describes the pins of requirements.txt with their hashes; `.venv` knows their
licences. The file has no time, no random number and no path of this machine: the same sources give the same
bytes. CycloneDX's own schema checks it.

Usage: sbom.py CARGO_CYCLONEDX OUT, with the Python of `.venv-supply`
"""

import json
import os
import re
import subprocess
import sys
import tempfile
from email.message import Message
from email.parser import HeaderParser
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TARGETS = ("x86_64-unknown-linux-gnu", "aarch64-unknown-linux-gnu")
# The newest that cargo-cyclonedx writes.
VERSION = "1.5"


def main(cargo_cyclonedx: Path, out: Path) -> None:
    """Writes the list, checked, and tells how much is in it."""
    linked = crates_of("normal")
    crates = described_crates(cargo_cyclonedx)
    helping = crates_of("normal,build") - linked
    bom = merge(crates, linked, helping, described_packages(), licenses_of_packages())
    text = json.dumps(bom, indent=1, sort_keys=True, ensure_ascii=False) + "\n"
    check(text)
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(text)
    kinds = [(component["purl"].split("/")[0], component["scope"]) for component in bom["components"]]
    print(
        f"{kinds.count(('pkg:cargo', 'required'))} crates in the program, "
        f"{kinds.count(('pkg:cargo', 'excluded'))} that help to compile it, "
        f"{kinds.count(('pkg:pypi', 'required'))} Python packages; a valid CycloneDX {VERSION}: {out}"
    )


def crates_of(edges: str) -> set[str]:
    """The crates that the program takes on these edges, as `name@version`."""
    options = f"--locked --package harmzone --edges {edges} --prefix none --format {{p}}".split()
    for target in TARGETS:
        options += ["--target", target]
    words = [line.split() for line in run("cargo", "tree", *options).splitlines() if line]
    return {f"{name}@{version.removeprefix('v')}" for name, version, *_ in words}


def described_crates(cargo_cyclonedx: Path) -> dict:
    """What cargo-cyclonedx tells of all crates of the lock file.

    It writes beside each Cargo.toml, so it works on links to the sources, in a folder of its own.
    """
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary).resolve()
        mirror(ROOT, folder, ("Cargo.toml", "Cargo.lock"))
        (folder / "xtask").unlink()
        (folder / "xtask").mkdir()
        mirror(ROOT / "xtask", folder / "xtask", ("Cargo.toml",))
        options = f"--quiet --format json --spec-version {VERSION} --override-filename sbom".split()
        options += ["--target", "all"]
        command = [str(cargo_cyclonedx), "cyclonedx", *options, "--manifest-path", str(folder / "Cargo.toml")]
        # With this variable it writes no random number; the time is taken out below.
        run(*command, SOURCE_DATE_EPOCH="0")
        return json.loads((folder / "sbom.json").read_text().replace(str(folder), "/harmzone"))


def mirror(source: Path, target: Path, copied: tuple[str, ...]) -> None:
    """Makes links to what is in a folder, and copies of the named files."""
    for path in source.iterdir():
        if path.name in copied:
            (target / path.name).write_bytes(path.read_bytes())
        elif path.name not in ("target", ".git"):
            (target / path.name).symlink_to(path)


def described_packages() -> dict:
    """What cyclonedx-bom tells of requirements.txt."""
    program = str(Path(sys.executable).with_name("cyclonedx-py"))
    options = f"--output-reproducible --of JSON --sv {VERSION}".split()
    return json.loads(run(program, "requirements", *options, str(ROOT / "requirements.txt")))


def licenses_of_packages() -> dict[str, dict]:
    """The licences of what is installed in `.venv`, as the packages tell them, by `name@version`."""
    found = {}
    for path in sorted((ROOT / ".venv" / "lib").glob("python3*/site-packages/*.dist-info/METADATA")):
        metadata = HeaderParser().parsestr(path.read_text(encoding="utf-8"))
        if told := told_license(metadata):
            found[f"{metadata['Name'].lower().replace('_', '-')}@{metadata['Version']}"] = told
    return found


def told_license(metadata: Message) -> dict | None:
    """A package's licence as CycloneDX writes it: newer ones tell an SPDX expression, older ones a name."""
    if expression := metadata["License-Expression"]:
        return {"expression": expression}
    classes = [line for line in metadata.get_all("Classifier", []) if line.startswith("License ::")]
    names = [metadata["License"] or "", *(line.rsplit(" :: ", 1)[1] for line in classes)]
    return next(({"license": {"name": name}} for name in names if name and "\n" not in name), None)


def merge(crates: dict, linked: set[str], helping: set[str], packages: dict, licenses: dict) -> dict:
    """One list of the crates that are compiled and of the packages, without crates that are only locked."""
    root = crates["metadata"]["component"]
    kept = []
    for crate in crates["components"]:
        name = f"{crate['name']}@{crate['version']}"
        if name in linked or name in helping:
            kept.append(crate | {"scope": "required" if name in linked else "excluded"})
    for package in packages["components"]:
        ref = re.sub(r"\?.*", "", package["purl"])
        package |= {"bom-ref": ref, "scope": "required"}
        # It repeats the line of the list.
        package.pop("description", None)
        if told := licenses.get(ref.removeprefix("pkg:pypi/")):
            package["licenses"] = [told]
        kept.append(package)
    missing = (linked | helping) - {f"{part['name']}@{part['version']}" for part in [root, *kept]}
    if missing:
        sys.exit(f"sbom: cargo-cyclonedx does not know {', '.join(sorted(missing))}")

    refs = {part["bom-ref"] for part in [root, *kept]}
    dependencies = {ref: set() for ref in refs}
    for entry in crates["dependencies"]:
        if entry["ref"] in refs:
            dependencies[entry["ref"]] = refs & set(entry.get("dependsOn", []))
    dependencies[root["bom-ref"]] |= {ref for ref in refs if ref.startswith("pkg:pypi/")}
    return {
        "bomFormat": "CycloneDX",
        "specVersion": VERSION,
        "version": 1,
        "metadata": {"component": root, "tools": tools_of(crates, packages)},
        "components": sorted(kept, key=lambda part: part["bom-ref"]),
        "dependencies": [
            {"ref": ref} | ({"dependsOn": sorted(needed)} if needed else {})
            for ref, needed in sorted(dependencies.items())
        ],
    }


def tools_of(*boms: dict) -> list[dict]:
    """The programs that wrote the lists, in the older form, which has no hashes and licences of theirs."""
    found = []
    for bom in boms:
        tools = bom["metadata"].get("tools", [])
        for tool in tools if isinstance(tools, list) else tools.get("components", []):
            found.append({"vendor": "CycloneDX", "name": tool["name"], "version": tool["version"]})
    return sorted(found, key=lambda tool: tool["name"])


def check(text: str) -> None:
    """Ends the program if the list is not as CycloneDX's schema wants it."""
    # Only `.venv-supply` has it.
    from cyclonedx.schema import SchemaVersion
    from cyclonedx.validation.json import JsonStrictValidator

    fault = JsonStrictValidator(SchemaVersion.from_version(VERSION)).validate_str(text)
    if fault is not None:
        sys.exit(f"sbom: no valid CycloneDX {VERSION}: {fault}")


def run(*command: str, **variables: str) -> str:
    """What a program prints; ends this one if it fails."""
    found = subprocess.run(command, cwd=ROOT, env=os.environ | variables, capture_output=True, text=True)
    if found.returncode != 0:
        sys.exit(f"sbom: {' '.join(command)}: {found.stderr}")
    return found.stdout


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve())
