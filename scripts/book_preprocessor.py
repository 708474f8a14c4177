"""mdBook's preprocessor for what lies outside of docs/; mdBook calls it (book.toml). Standard library only.

- A chapter that is nothing but `{{#include FILE}}` becomes that file, such as docs/project/changelog.md.
- A link to a file that is a chapter leads to that chapter. One to any other file outside of docs/ becomes the
  file's path in code letters: the book has no copy of it.
"""

import json
import posixpath
import re
import sys
from collections.abc import Iterator
from pathlib import Path

INCLUDE = re.compile(r"\{\{#include ([^}\s]+)\}\}")
# Code comes first, so that what looks like a link inside of it stays; a link's words may hold code.
LINK_OR_CODE = re.compile(
    r"^ *```.*?^ *```|"
    r"(?P<picture>!?)\[(?P<words>(?:`[^`\n]*`|[^\[\]`]|\[[^\]]*\])*)\]\((?P<target>[^()\s]+)\)|"
    r"`[^`\n]*`",
    re.MULTILINE | re.DOTALL,
)


def main() -> None:
    """Rewrites the book that mdBook writes to standard input."""
    if sys.argv[1:2] == ["supports"]:
        return
    context, book = json.load(sys.stdin)
    source = context["config"]["book"]["src"]
    root = Path(context["root"])
    chapters = list(chapters_of(book["items"]))
    origins = {id(chapter): origin_of(chapter, source) for chapter in chapters}
    pages = {origins[id(chapter)]: chapter["path"] for chapter in chapters}
    for chapter in chapters:
        origin = origins[id(chapter)]
        is_include = INCLUDE.fullmatch(chapter["content"].strip())
        text = (root / origin).read_text() if is_include else chapter["content"]
        chapter["content"] = with_links(text, origin, chapter["path"], pages, source)
    json.dump(book, sys.stdout)


def chapters_of(items: list) -> Iterator[dict]:
    """All chapters with a file."""
    for item in items:
        if isinstance(item, dict) and "Chapter" in item:
            if item["Chapter"]["path"]:
                yield item["Chapter"]
            yield from chapters_of(item["Chapter"]["sub_items"])


def origin_of(chapter: dict, source: str) -> str:
    """Path in the repository of the file that a chapter's text stands in."""
    path = posixpath.join(source, chapter["source_path"])
    include = INCLUDE.fullmatch(chapter["content"].strip())
    return posixpath.normpath(posixpath.join(posixpath.dirname(path), include[1])) if include else path


def with_links(text: str, origin: str, page: str, pages: dict[str, str], source: str) -> str:
    """The text with each relative link as it must be in the book."""

    def link(match: re.Match) -> str:
        picture, words, target = match["picture"], match["words"], match["target"]
        if target is None or re.match(r"[a-z]+:|#", target):
            return match[0]
        path, hash_mark, anchor = target.partition("#")
        path = posixpath.normpath(posixpath.join(posixpath.dirname(origin), path))
        if path in pages:
            inside = pages[path]
        elif path.startswith(source + "/"):
            inside = posixpath.relpath(path, source)
        elif words.strip("`") in (path, posixpath.basename(path)):
            return f"`{path}`"
        else:
            return f"{words} (`{path}`)"
        relative = posixpath.relpath(inside, posixpath.dirname(page) or ".")
        return f"{picture}[{words}]({relative}{hash_mark}{anchor})"

    return LINK_OR_CODE.sub(link, text)


if __name__ == "__main__":
    main()
