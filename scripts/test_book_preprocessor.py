import pytest
import test_book
from book_preprocessor import with_links

PAGES = {"docs/zones.md": "zones.md", "CHANGELOG.md": "project/changelog.md"}


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("[zones](../zones.md#rect)", "[zones](../zones.md#rect)"),
        ("[what changed](../../CHANGELOG.md)", "[what changed](../project/changelog.md)"),
        ("[`configs/drive.toml`](../../configs/drive.toml)", "`configs/drive.toml`"),
        ("[the keys](../../configs/drive.toml)", "the keys (`configs/drive.toml`)"),
        ("![zones](../pictures/zones.png)", "![zones](../pictures/zones.png)"),
        ("[there](https://mcap.dev) [here](#rect)", "[there](https://mcap.dev) [here](#rect)"),
        ("`[a](../../b)` [c](../../d)", "`[a](../../b)` c (`d`)"),
        ("```sh\n[a](../../b)\n```", "```sh\n[a](../../b)\n```"),
    ],
)
def test_links_that_leave_the_book_lead_to_a_chapter_or_become_a_path(text, wanted):
    assert with_links(text, "docs/tutorial/one.md", "tutorial/one.md", PAGES, "docs") == wanted


def test_links_of_an_included_file_are_those_of_its_own_folder():
    text = with_links("[zones](docs/zones.md)", "CHANGELOG.md", "project/changelog.md", PAGES, "docs")
    assert text == "[zones](../zones.md)"


def test_a_block_keeps_its_marks_and_the_reason_above_it():
    text = """
```xml,file=a/b.xodr
<x/>
```

<!-- not tested: hours -->
```sh,not-tested
make \\
  all
# no
```
"""
    shown, skipped = test_book.blocks_of(text)
    assert (shown.file(), shown.language, shown.line, shown.why_not_tested) == ("a/b.xodr", "xml", 2, None)
    assert (skipped.marks, skipped.why_not_tested, skipped.n_commands()) == (["not-tested"], "hours", 1)


def test_output_must_have_the_shown_lines_in_their_order():
    test_book.check_output("one\n...\nthree  3\n", "zero\none\ntwo\nthree 3\n", "here")
    with pytest.raises(test_book.BookError, match="not printed"):
        test_book.check_output("two\none\n", "one\ntwo\n", "here")


def test_links_of_the_book_to_files_and_anchors_that_are_absent_are_broken(tmp_path):
    links = ("b.html", "b.html#there", "b.html#absent", "absent.html", "#absent", "https://mcap.dev")
    (tmp_path / "a.html").write_text("".join(f'<a href="{link}">x</a>' for link in links))
    (tmp_path / "b.html").write_text('<h1 id="there">x</h1>')
    broken = [line.split()[-1] for line in test_book.broken_links(tmp_path)]
    assert broken == ["b.html#absent", "absent.html", "#absent"]
