"""Accessibility of a page by axe-core, out of axe-playwright-python: no serious or critical finding."""

from importlib import resources

from playwright.sync_api import Page

BAD = ("serious", "critical")
SCRIPT = resources.files("axe_playwright_python").joinpath("axe.min.js").read_text(encoding="utf-8")


def check(page: Page, where: str) -> int:
    """Fails on a serious or critical finding; returns how many rules the page passes.

    The script is put in by the debugger, so that the page's own policy stays as strict as it is.
    """
    if not page.evaluate("typeof axe === 'object'"):
        page.evaluate(SCRIPT)
    found = page.evaluate("axe.run(document, {resultTypes: ['violations', 'passes']})")
    told = [
        f"{one['id']} ({one['impact']}): {one['help']}: {[node['html'][:200] for node in one['nodes'][:3]]}"
        for one in found["violations"]
        if one["impact"] in BAD
    ]
    assert told == [], f"axe, {where}:\n" + "\n".join(told)
    return len(found["passes"])
