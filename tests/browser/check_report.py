"""Opens a report in Chromium from disk and uses it: no error, nothing fetched, the gallery sorts and filters,
no serious finding of axe.

Usage: check_report.py REPORT_HTML [PICTURES]. With a folder, screenshots of a wide and a narrow page, light
and dark, are kept there. Exit 0: all holds; 1: a claim failed; 77: no Chromium here (`apt-get install
chromium`, or CHROMIUM=path).
"""

import os
import shutil
import sys
from pathlib import Path

import axe
from playwright.sync_api import Page, expect, sync_playwright

SKIPPED = 77
# Orders of the gallery, and whether the largest comes first.
ORDERS = {"score": True, "range": False, "margin": False, "speed": True, "samples": True}
VIEWS = {"wide": (1280, 900), "narrow": (390, 844)}


def find_chromium() -> str | None:
    """Path of a Chromium or Chrome, if there is one."""
    names = [os.environ.get("CHROMIUM"), "chromium", "chromium-browser", "google-chrome"]
    return next((path for name in names if name and (path := shutil.which(name))), None)


def values(page: Page, key: str) -> list[str]:
    """What the cards that are shown have under a key, in their order."""
    return page.eval_on_selector_all(".card:not([hidden])", f"cards => cards.map(card => card.dataset.{key})")


def check_gallery(page: Page) -> None:
    """Each order and each filter does what it says, together and back again."""
    n_cards = page.locator(".card").count()
    assert n_cards > 3, f"{n_cards} cards are too few to sort"
    first = values(page, "rank")
    for key, falls in ORDERS.items():
        page.select_option("[name=sort]", key)
        numbers = [float(text) for text in values(page, key) if text]
        assert len(numbers) > 3, f"too few cards know their {key}"
        assert numbers == sorted(numbers, reverse=falls), f"not sorted by {key}: {numbers}"
        known = [text != "" for text in values(page, key)]
        assert known == sorted(known, reverse=True), f"cards without {key} are not last"
    filters = page.eval_on_selector_all("[data-filter]", "all => all.map(one => one.name)")
    assert "set" in filters, f"the filters are {filters}"
    for name in filters:
        options = page.eval_on_selector_all(f"[name={name}] option", "all => all.map(one => one.value)")[1:]
        assert len(options) > 1, f"{name} has one option"
        n_shown = 0
        for option in options:
            page.select_option(f"[name={name}]", option)
            shown = values(page, name)
            assert shown and set(shown) == {option}, f"{name}={option} shows {set(shown)}"
            assert page.inner_text("#count") == f"{len(shown)} of {n_cards}"
            n_shown += len(shown)
        assert n_shown <= n_cards
        page.select_option(f"[name={name}]", "")
    page.fill("[name=words]", "no card has these words")
    assert values(page, "rank") == [] and page.is_visible(".none")
    page.click("#controls [type=reset]")
    expect(page.locator("#count")).to_have_text(f"{n_cards} of {n_cards}")
    assert values(page, "rank") == first, "reset brings the first order back"


def check_pictures(page: Page) -> None:
    """Pictures load, and enlarge into a dialog that steps and closes."""
    for image in page.locator(".card img").all():
        image.scroll_into_view_if_needed()
        assert image.evaluate("image => image.decode().then(() => image.naturalWidth)") > 100
    page.locator(".card .pictures").first.click()
    assert page.locator("dialog[open] img").count() == 2
    before = page.inner_text("dialog .large-text")
    page.keyboard.press("ArrowRight")
    assert page.inner_text("dialog .large-text") != before, "the next card"
    page.keyboard.press("Escape")
    assert page.locator("dialog[open]").count() == 0


def check_width(page: Page) -> None:
    """Nothing but what scrolls by itself is wider than the page."""
    width, inner = page.evaluate("[document.documentElement.scrollWidth, innerWidth]")
    assert width <= inner, f"the page is {width} wide in a window of {inner}"


def main() -> int:
    """Opens the page in each view; see the top of the file."""
    chromium = find_chromium()
    if chromium is None:
        print("no Chromium here: `apt-get install chromium`, or CHROMIUM=path", file=sys.stderr)
        return SKIPPED
    report = Path(sys.argv[1]).resolve().as_uri()
    pictures = Path(sys.argv[2]) if len(sys.argv) > 2 else None
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        for view, (width, height) in VIEWS.items():
            for scheme in ("light", "dark"):
                page = browser.new_page(
                    viewport={"width": width, "height": height},
                    color_scheme=scheme,
                    has_touch=view == "narrow",
                )
                told: list[str] = []
                fetched: list[str] = []
                page.on("console", lambda message, told=told: told.append(f"{message.type}: {message.text}"))
                page.on("pageerror", lambda error, told=told: told.append(str(error)))
                page.on("request", lambda request, fetched=fetched: fetched.append(request.url))
                page.goto(report)
                assert page.locator("section").count() > 5 and page.locator(".plot svg").count() > 3
                check_width(page)
                dark = "rgb(16, 20, 27)"
                ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
                assert (ground == dark) == (scheme == "dark"), f"{scheme}: the ground is {ground}"
                page.eval_on_selector_all("details", "all => all.forEach(one => { one.open = true; })")
                check_width(page)
                axe.check(page, f"report, {view}, {scheme}")
                page.eval_on_selector_all("details", "all => all.forEach(one => { one.open = false; })")
                check_gallery(page)
                if page.locator(".card .pictures").count():
                    check_pictures(page)
                assert told == [], f"the console says {told}"
                others = [url for url in fetched if url != report and not url.startswith("data:")]
                assert others == [], f"it fetched {others}"
                if pictures:
                    pictures.mkdir(parents=True, exist_ok=True)
                    page.evaluate("scrollTo(0, 0)")
                    page.screenshot(path=pictures / f"{view}-{scheme}.png", full_page=True)
                page.close()
        browser.close()
    print("opened wide and narrow, light and dark")
    return 0


if __name__ == "__main__":
    sys.exit(main())
