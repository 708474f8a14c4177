"""Runs the commands that README.md and the book show, and checks the built book's links (`make test-book`).

What the marks of a fenced block mean, behind its language; mdBook and GitHub show such blocks as any other:

- `sh`: run by `bash -eu`, block after block in one folder a chapter, with the program as `harmzone`.
- `sh,not-tested`: not run. The comment above it says why: `<!-- not tested: needs a GPU -->`.
- `toml,file=maps/town.toml` (any language): written to that file of the chapter's folder.
- `text,output`: the block of commands above it must have printed these lines in this order; `...` is any.

`<!-- given: data/id, kitti -->` anywhere in a chapter: what is there before its first command (GIVEN).

Usage: test_book.py [--program PATH] [--book DIR] [--keep DIR] [CHAPTER ..], a chapter being as docs/look.md
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import urllib.parse
from dataclasses import dataclass
from pathlib import Path

import lxml.html
from markdown_it import MarkdownIt

ROOT = Path(__file__).resolve().parent.parent
NOT_TESTED = re.compile(r"<!-- not tested: (.+?) -->", re.DOTALL)
GIVEN_COMMENT = re.compile(r"<!-- given: (.+?) -->", re.DOTALL)
# A command that hangs must not hang the test; the longest takes a tenth of it.
TIMEOUT_S = 300
FEW = ROOT / "tests" / "golden" / "nuscenes_few"
SMALL_SET = "--town downtown --episodes 4 --samples 6 --seed 3 --set sample_period_s=0.9"
# What chapters may take for granted: each path with the commands that make it, once for all chapters.
GIVEN = {
    "data/id": f"harmzone gen {SMALL_SET} --set val_every=2 --out data/id && harmzone label data/id",
    "data/ood": f"harmzone gen {SMALL_SET} --ood --out data/ood && harmzone label data/ood",
    "data/id2": "cp -r data/id data/id2",
    "data/my_car": "cp -r data/ood data/my_car",
    "runs/a": "harmzone train data/id --out runs/a --set fused_stage.epochs=2",
    "p.json": "harmzone predict runs/a --data data/ood --out p && cp p/predictions.json p.json",
    "kitti": "harmzone export kitti data/ood kitti --categories kinds",
    "docs/falls.toml": f"mkdir -p docs && cp {ROOT}/docs/falls.toml docs/falls.toml",
    "predictions.json": f"cp {FEW}.predictions.json predictions.json",
    "truth.json": f'sed \'s/"detection_name/"distribution": "ood", &/g\' {FEW}.truth.json >truth.json',
}


class BookError(Exception):
    """What is wrong with a chapter, for the reader of the table."""


@dataclass
class Block:
    """A fenced block of a chapter."""

    line: int
    language: str
    marks: list[str]
    text: str
    why_not_tested: str | None

    def file(self) -> str | None:
        """The file that the block is to be written to."""
        return next((mark.removeprefix("file=") for mark in self.marks if mark.startswith("file=")), None)

    def n_commands(self) -> int:
        """Commands of the block; a line that ends with a backslash goes on."""
        lines = self.text.replace("\\\n", " ").splitlines()
        return sum(1 for line in lines if line.strip() and not line.strip().startswith("#"))


@dataclass
class Row:
    """A chapter's line of the table."""

    chapter: str
    n_commands: int = 0
    n_not_tested: int = 0
    seconds: float = 0.0
    fault: str | None = None

    def result(self) -> str:
        """Its last column."""
        if self.fault is not None:
            return "FAILED"
        return "ok" if self.n_commands else "-"


def main() -> int:
    """Runs the chapters and prints the table; 1 if anything failed."""
    parser = argparse.ArgumentParser(description="Run the commands that README.md and the book show.")
    parser.add_argument("--program", type=Path, default=ROOT / "target" / "release" / "harmzone")
    parser.add_argument("--book", type=Path, help="the built book, whose links are checked")
    parser.add_argument("--keep", type=Path, help="keep the chapters' folders here")
    parser.add_argument("chapters", nargs="*", metavar="CHAPTER")
    arguments = parser.parse_args()
    program = arguments.program.resolve()
    if not program.is_file():
        parser.error(f"no program at {program}; make build")
    with tempfile.TemporaryDirectory(prefix="harmzone-book-") as temporary:
        work = (arguments.keep or Path(temporary)).resolve()
        work.mkdir(parents=True, exist_ok=True)
        # What an earlier program made is not given.
        shutil.rmtree(work / "given", ignore_errors=True)
        environment = environment_with(program, work)
        rows = []
        for chapter in arguments.chapters or all_chapters():
            rows.append(run_chapter(chapter, work, environment))
            print(f"{rows[-1].chapter}: {rows[-1].result()}", file=sys.stderr)
    print_table([row for row in rows if row.n_commands or row.n_not_tested or row.fault])
    broken = broken_links(arguments.book) if arguments.book else []
    for line in broken:
        print(line)
    if arguments.book:
        print(f"links of {arguments.book}: {len(broken)} broken")
    return int(bool(broken) or any(row.fault is not None for row in rows))


def all_chapters() -> list[str]:
    """README.md and the chapters that docs/SUMMARY.md lists, in its order."""
    listed = re.findall(r"\]\(([^)]+\.md)\)", (ROOT / "docs" / "SUMMARY.md").read_text())
    return ["README.md", *(f"docs/{path}" for path in listed)]


def environment_with(program: Path, work: Path) -> dict[str, str]:
    """This environment with the program as the first `harmzone` of PATH."""
    folder = work / "bin"
    folder.mkdir(exist_ok=True)
    link = folder / "harmzone"
    link.unlink(missing_ok=True)
    link.symlink_to(program)
    return os.environ | {"PATH": f"{folder}{os.pathsep}{os.environ['PATH']}", "NO_COLOR": "1"}


def blocks_of(text: str) -> list[Block]:
    """The fenced blocks of a chapter, in order."""
    blocks, comment = [], None
    for token in MarkdownIt("commonmark").parse(text):
        if token.type == "html_block":
            comment = NOT_TESTED.search(token.content)
        elif token.type == "fence":
            language, *marks = re.split(r"[,\s]+", token.info.strip())
            # Lines of a file count from 1, and the first of a block is its fence.
            why = " ".join(comment[1].split()) if comment else None
            blocks.append(Block(token.map[0] + 1, language, marks, token.content, why))
            comment = None
        elif token.nesting >= 0:
            comment = None
    return blocks


def run_chapter(chapter: str, work: Path, environment: dict[str, str]) -> Row:
    """Runs a chapter in a folder of its own."""
    row = Row(chapter)
    text = (ROOT / chapter).read_text()
    blocks = blocks_of(text)
    folder = work / chapter.removesuffix(".md").replace("/", "-")
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    try:
        runs = any(block.language == "sh" and "not-tested" not in block.marks for block in blocks)
        if runs and (given := GIVEN_COMMENT.search(text)):
            lay_out([name.strip() for name in given[1].split(",")], folder, work / "given", environment)
        printed = ""
        for block in blocks:
            at = f"{chapter}:{block.line}"
            if block.file():
                (folder / block.file()).parent.mkdir(parents=True, exist_ok=True)
                (folder / block.file()).write_text(block.text)
            elif block.language == "sh" and "not-tested" in block.marks:
                if block.why_not_tested is None:
                    raise BookError(f"{at}: no comment above says why: <!-- not tested: .. -->")
                row.n_not_tested += block.n_commands()
                print(f"{at}: not tested: {block.why_not_tested}", file=sys.stderr)
            elif block.language == "sh":
                start = time.monotonic()
                printed = run_block(block.text, at, folder, environment)
                row.seconds += time.monotonic() - start
                row.n_commands += block.n_commands()
            elif block.language == "text" and "output" in block.marks:
                check_output(block.text, printed, at)
    except BookError as fault:
        row.fault = str(fault)
    return row


def lay_out(names: list[str], folder: Path, made: Path, environment: dict[str, str]) -> None:
    """Copies what is given into a chapter's folder."""
    made.mkdir(exist_ok=True)
    for name in names:
        if name not in GIVEN:
            raise BookError(f"nothing given is called `{name}`; there are {', '.join(GIVEN)}")
        make_given(name, made, environment)
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if (made / name).is_dir():
            shutil.copytree(made / name, target)
        else:
            shutil.copy(made / name, target)


def make_given(name: str, made: Path, environment: dict[str, str]) -> None:
    """Makes what is given, and first what its commands name, unless it is there already."""
    if (made / name).exists():
        return
    for other in GIVEN:
        if other != name and re.search(rf"(?<![\w./]){re.escape(other)}(?![\w./])", GIVEN[name]):
            make_given(other, made, environment)
    run_block(GIVEN[name], f"given {name}", made, environment)


def run_block(text: str, at: str, folder: Path, environment: dict[str, str]) -> str:
    """Runs a block and returns what it printed, on both outputs."""
    command = ["bash", "-eu", "-o", "pipefail", "-c", text]
    done = subprocess.Popen(
        command,
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    try:
        printed, _ = done.communicate(timeout=TIMEOUT_S)
    except subprocess.TimeoutExpired:
        os.killpg(done.pid, 9)
        printed, _ = done.communicate()
        raise BookError(
            f"{at}: took more than {TIMEOUT_S} s\n{indented(text)}\n{indented(printed)}"
        ) from None
    if done.returncode != 0:
        raise BookError(f"{at}: exit code {done.returncode}\n{indented(text)}\n{indented(printed)}")
    return printed


def check_output(shown: str, printed: str, at: str) -> None:
    """Raises unless the printed lines have the shown ones in their order."""
    lines = iter(" ".join(line.split()) for line in printed.splitlines())
    for wanted in (" ".join(line.split()) for line in shown.splitlines()):
        if wanted not in ("", "...") and wanted not in lines:
            raise BookError(
                f"{at}: this line was not printed, or not in this place\n  {wanted}\n{indented(printed)}"
            )


def indented(text: str) -> str:
    """The text's last lines, moved to the right."""
    return "\n".join(f"    {line}" for line in text.splitlines()[-40:])


def print_table(rows: list[Row]) -> None:
    """Prints the table, and below it what failed."""
    width = max((len(row.chapter) for row in rows), default=7)
    total = Row(
        "all",
        sum(row.n_commands for row in rows),
        sum(row.n_not_tested for row in rows),
        sum(row.seconds for row in rows),
    )
    print(f"{'chapter':<{width}}  commands  not tested  seconds  result")
    for row in [*rows, total]:
        figures = f"{row.n_commands:>8}  {row.n_not_tested:>10}  {row.seconds:>7.1f}"
        print(f"{row.chapter:<{width}}  {figures}  {'' if row is total else row.result()}".rstrip())
    for row in rows:
        if row.fault is not None:
            print(f"\n{row.fault}")


def broken_links(book: Path) -> list[str]:
    """Links of the built book to files or anchors that are not there; nothing is fetched."""
    pages = {page: lxml.html.parse(page).getroot() for page in sorted(book.resolve().rglob("*.html"))}
    anchors = {page: {*tree.xpath("//@id"), *tree.xpath("//a/@name")} for page, tree in pages.items()}
    broken = []
    for page, tree in pages.items():
        # 404.html is for servers, and print.html holds all chapters once more.
        if page.name in ("404.html", "print.html"):
            continue
        for _, attribute, link, _ in tree.iterlinks():
            url = urllib.parse.urlsplit(link)
            if attribute not in ("href", "src") or url.scheme or url.netloc:
                continue
            target = (page.parent / urllib.parse.unquote(url.path)).resolve() if url.path else page
            target = target / "index.html" if target.is_dir() else target
            has_anchor = not url.fragment or urllib.parse.unquote(url.fragment) in anchors.get(target, ())
            if not target.is_file() or not has_anchor:
                broken.append(f"{page.relative_to(book.resolve())}: broken link {link}")
    return broken


if __name__ == "__main__":
    sys.exit(main())
