"""Uses the page of `harmzone serve` in Chromium: wide and narrow, light and dark, by keyboard and by touch.

Usage: check_serve.py URL [PICTURES]. The folder that is served has a data set of 1,000 episodes or more with
boxes of a detector, of which episode-0007 is damaged, scores and a report. With a second folder, screenshots
are kept there. Exit 0: all holds; 1: a claim failed; 77: no Chromium here (`apt-get install chromium`, or
CHROMIUM=path).
"""

import re
import sys
from pathlib import Path

import axe
from check_report import SKIPPED, check_width, find_chromium
from playwright.sync_api import Browser, Page, expect, sync_playwright

VIEWS = {"wide": (1280, 900), "narrow": (360, 740)}
# Longest time from a key in the search field to the next picture of the list, milliseconds. An eye sees 100.
MOST_FILTER_MS = 100
N_TRIES = 5
# The texts that the button of the player shows from now on.
WATCH_PLAY = """() => {
  const play = document.querySelector("#play");
  window.playTexts = [];
  const note = () => window.playTexts.push(play.textContent);
  new MutationObserver(note).observe(play, { childList: true, characterData: true, subtree: true });
}"""
# Presses play, pause and play at once, and plays to the end: the seconds at which each next sample was shown.
PLAY_AGAIN = """async () => {
  const [play, now] = ["play", "now"].map((id) => document.getElementById(id));
  const shown = [];
  const watch = new MutationObserver(() => shown.push([now.textContent, performance.now() / 1000]));
  watch.observe(now, { childList: true });
  for (let press = 0; press < 3; press++) play.click();
  while (play.textContent !== "Play") await new Promise((done) => setTimeout(done, 20));
  watch.disconnect();
  return shown;
}"""
# Reads many samples into the player's store: 0 is in view, 1 is used each time, 3 is to be shown next.
FILL_STORE = """async () => {
  const { Player } = await import("/player.js");
  const blob = await new OffscreenCanvas(1, 1).getContext("2d").canvas.convertToBlob();
  const ask = async (_, as) => ({ blob, arrayBuffer: new ArrayBuffer(0) })[as] ?? {};
  const store = Object.assign(Object.create(Player.prototype), { ask, frames: new Map(), at: 3 });
  const first = (store.shown = await store.load(0));
  for (let sample = 1; sample < 200; sample++) await Promise.all([store.load(sample), store.load(1)]);
  const kept = [0, 1, 2, 3].filter((sample) => store.frames.has(sample));
  return { kept, n: store.frames.size, widths: [first, await store.load(1)].map((of) => of.picture.width) };
}"""
# What one key in the search field costs until the browser has drawn the list.
TIME_FILTER = """async (words) => {
  const field = document.querySelector("[name=words]");
  const begin = performance.now();
  field.value = words;
  field.dispatchEvent(new Event("input", { bubbles: true }));
  await new Promise((done) => requestAnimationFrame(() => setTimeout(done)));
  return performance.now() - begin;
}"""
# The longest time between two frames while the list scrolls from its top to its end.
TIME_SCROLL = """async () => {
  const list = document.getElementById("list");
  let [longest, last] = [0, performance.now()];
  for (let step = 0; step <= 60; step++) {
    list.scrollTop = (step / 60) * list.scrollHeight;
    await new Promise((done) => requestAnimationFrame(done));
    const now = performance.now();
    [longest, last] = [Math.max(longest, now - last), now];
  }
  list.scrollTop = 0;
  return longest;
}"""


def counts(page: Page) -> tuple[int, int]:
    """How many episodes the page says it shows, and of how many."""
    found = re.fullmatch(r"([\d,]+) of ([\d,]+) episodes", page.inner_text("#count"))
    assert found, page.inner_text("#count")
    return int(found[1].replace(",", "")), int(found[2].replace(",", ""))


def facts(page: Page) -> str:
    """The words about the sample that the player shows."""
    return page.inner_text("#now")


def wait_for_sample(page: Page, number: int) -> None:
    """Until the player shows the sample of this number, from 1."""
    expect(page.locator("#now")).to_have_text(re.compile(rf"^sample {number} of "))


def drag(page: Page, sample_idx: int) -> None:
    """Puts the bar of the player to a sample."""
    script = "(bar, to) => { bar.value = to; bar.dispatchEvent(new Event('input')); }"
    page.eval_on_selector("#seek", script, sample_idx)


def is_drawn(page: Page, canvas: str) -> bool:
    """Whether a canvas shows more than one colour."""
    return page.evaluate(
        """(id) => {
          const canvas = document.getElementById(id);
          const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
          const colors = new Set();
          for (let i = 0; i < data.length; i += 404) colors.add(`${data[i]} ${data[i + 1]} ${data[i + 2]}`);
          return colors.size > 8;
        }""",
        canvas,
    )


def check_list(page: Page) -> str:
    """Filters do what they say, quickly, and the list holds few rows. Returns what was measured."""
    n_all = counts(page)[1]
    assert n_all >= 1000, f"{n_all} episodes are too few to tell of lag"
    assert page.inner_text("#min-score") == "boxes from score 0.20 on"
    assert 0 < page.locator("#list .row").count() < 60, "only the rows in view are in the document"
    page.eval_on_selector("#more", "more => { more.open = true; }")
    for name in ("town", "weather", "split"):
        options = page.eval_on_selector_all(f"[name={name}] option", "all => all.map(one => one.value)")[1:]
        n_shown = 0
        for option in options:
            page.select_option(f"[name={name}]", option)
            n_shown += counts(page)[0]
        page.select_option(f"[name={name}]", "")
        assert options and n_shown == n_all, f"{name}: {n_shown} of {n_all} in all"
    for name in ("harmful", "missed", "false_alarms"):
        n_of = []
        for option in ("some", "none"):
            page.select_option(f"[name={name}]", option)
            n_of.append(counts(page)[0])
        page.select_option(f"[name={name}]", "")
        assert n_of[0] > 0 and sum(n_of) <= n_all, f"{name}: {n_of} of {n_all}"
    for name in ("vehicle", "unfamiliar"):
        page.select_option("[name=kind]", name)
        assert 0 < counts(page)[0] <= n_all
    page.click("#filters [type=reset]")
    expect(page.locator("#count")).to_have_text(f"{n_all:,} of {n_all:,} episodes")
    page.fill("[name=words]", "no episode has this name")
    assert counts(page)[0] == 0 and page.is_visible("#none")
    page.fill("[name=words]", "")

    # Of some tries the best: whatever else the machine does, it does not do it each time.
    times = [
        min(page.evaluate(TIME_FILTER, words) for _ in range(N_TRIES))
        for words in ("e", "ep", "epi", "1", "12", "x", "")
    ]
    assert max(times) < MOST_FILTER_MS, f"a key in the search takes {times} ms"
    scroll_ms = min(page.evaluate(TIME_SCROLL) for _ in range(N_TRIES))
    assert scroll_ms < 2 * MOST_FILTER_MS, f"a step of the list takes {scroll_ms} ms"
    page.select_option("[name=order]", "missed")
    assert "missed" in page.inner_text("#list [aria-posinset='1']")
    page.select_option("[name=order]", "")
    return f"filter of {n_all} at most {max(times):.0f} ms, scroll {scroll_ms:.0f} ms a frame"


def check_keys(page: Page) -> None:
    """All that a mouse does, keys do."""
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("/")
    assert page.evaluate("document.activeElement.name") == "words"
    page.keyboard.type("no such name")
    page.keyboard.press("Escape")
    assert page.evaluate("document.activeElement.id") == "list"
    assert counts(page)[0] == counts(page)[1], "Escape empties the search"
    page.keyboard.press("End")
    last = page.locator("#list .row.active")
    assert last.get_attribute("aria-posinset") == last.get_attribute("aria-setsize")
    assert page.get_attribute("#list", "aria-activedescendant") == last.get_attribute("id")
    for key, position in (("Home", "1"), ("ArrowDown", "2"), ("ArrowUp", "1")):
        page.keyboard.press(key)
        assert page.locator("#list .row.active").get_attribute("aria-posinset") == position, key
    page.keyboard.press("Enter")
    wait_for_sample(page, 1)
    first = page.inner_text("#player-title")
    for key, number in (("ArrowRight", 2), ("ArrowRight", 3), ("ArrowLeft", 2)):
        page.keyboard.press(key)
        wait_for_sample(page, number)
    page.evaluate("document.activeElement.blur()")
    n_samples = int(re.search(r" of (\d+)", facts(page))[1])
    for key, number in (("End", n_samples), ("Home", 1)):
        page.keyboard.press(key)
        wait_for_sample(page, number)
    assert is_drawn(page, "camera") and is_drawn(page, "above")
    assert "LiDAR points" in page.get_attribute("#above", "aria-label")
    page.evaluate(WATCH_PLAY)
    page.keyboard.press("Space")
    wait_for_sample(page, n_samples)
    expect(page.locator("#play")).to_have_text("Play")
    assert "Pause" in page.evaluate("window.playTexts")
    expect(page.locator("#said")).to_have_text(re.compile(rf"^Sample {n_samples}: "))
    check_play_again(page, n_samples)
    page.keyboard.press("j")
    expect(page.locator("#player-title")).not_to_have_text(first)
    page.keyboard.press("k")
    expect(page.locator("#player-title")).to_have_text(first)
    page.keyboard.press("?")
    expect(page.locator("#help")).to_be_visible()
    page.keyboard.press("Escape")
    expect(page.locator("#help")).to_be_hidden()
    page.keyboard.press("Escape")
    expect(page.locator("#player")).to_be_hidden()


def check_play_again(page: Page, n_samples: int) -> None:
    """Who pauses and plays again within a sample does not play at double speed."""
    page.keyboard.press("Home")
    wait_for_sample(page, 1)
    shown = page.evaluate(PLAY_AGAIN)
    told = [re.match(r"sample (\d+) of .* · ([\d.]+) s · ", text) for text, _ in shown]
    assert [int(one[1]) for one in told] == list(range(2, n_samples + 1)), shown
    for i in range(1, len(shown)):
        wanted_s = float(told[i][2]) - float(told[i - 1][2])
        assert shown[i][1] - shown[i - 1][1] > 0.7 * wanted_s, f"too fast: {shown}"


def check_damaged_sample(page: Page) -> None:
    """A sample that cannot be read says so where the bar is put to it, and is asked for again."""
    drag(page, 0)
    wait_for_sample(page, 1)
    page.route("**/samples/1", lambda route: route.fulfill(body="torn"))
    page.reload()
    wait_for_sample(page, 1)
    expect(page.locator("#notice")).to_be_hidden()
    drag(page, 1)
    expect(page.locator("#notice")).to_be_visible()
    page.unroute("**/samples/1")
    drag(page, 1)
    wait_for_sample(page, 2)


def check_store(page: Page) -> None:
    """Samples that are used stay, and no picture is closed while it is in view."""
    found = page.evaluate(FILL_STORE)
    # A picture that is closed has no width.
    assert found == {"kept": [1, 3], "n": 80, "widths": [1, 1]}, found


def check_player(page: Page) -> None:
    """An episode with a miss shows it, as words too; layers and the bar work by hand."""
    page.eval_on_selector("#more", "more => { more.open = true; }")
    page.select_option("[name=missed]", "some")
    page.locator("#list .row").first.click()
    wait_for_sample(page, 1)
    page.click("#next-fault")
    expect(page.locator("#here tr.fault")).not_to_have_count(0)
    assert re.search("missed: |false alarm: ", page.inner_text("#here")), page.inner_text("#here")
    before = page.eval_on_selector("#above", "canvas => canvas.toDataURL()")
    for layer in ("points", "zone", "truth", "found"):
        page.uncheck(f"#show-{layer}")
        after = page.eval_on_selector("#above", "canvas => canvas.toDataURL()")
        assert after != before, f"{layer} makes no difference"
        before = after
    for layer in ("points", "zone", "truth", "found"):
        page.check(f"#show-{layer}")
    check_damaged_sample(page)
    check_store(page)
    place = page.evaluate("location.hash")
    page.reload()
    wait_for_sample(page, 2)
    assert page.evaluate("location.hash") == place, "a reload stays where it was"


def check_torn(page: Page) -> None:
    """The damaged episode says what is wrong with it, and the next one plays."""
    page.goto(page.url.split("#")[0] + "#/episodes")
    page.fill("[name=words]", "episode-0007")
    expect(page.locator("#list .row")).to_have_count(1)
    assert "cannot be shown" in page.inner_text("#list .row")
    page.locator("#list .row").click()
    expect(page.locator("#notice")).to_contain_text("episode-0007.mcap")
    assert page.inner_text("#now") == "" and page.locator("#here tr").count() == 0
    page.keyboard.press("Escape")
    page.fill("[name=words]", "")
    expect(page.locator("#notice")).to_be_hidden()
    page.evaluate("location.hash = '#/episodes/0/episode-0008/1'")
    wait_for_sample(page, 2)


def check_scores_and_report(page: Page) -> None:
    """Tables, and the report in an origin of its own."""
    page.click("nav >> text=Scores")
    expect(page.locator("#tables h2").first).to_be_visible()
    assert page.locator("#tables table").count() > 5
    check_width(page)
    page.click("nav >> text=Report")
    frame = page.frame_locator("#report-frame iframe")
    expect(frame.locator("h1")).to_be_visible()
    origin = next(one for one in page.frames if "/reports/" in one.url).evaluate("origin")
    assert origin == "null", f"the report's origin is {origin}"


def use(browser: Browser, url: str, view: str, scheme: str, pictures: Path | None) -> str:
    """Goes through the page once; returns what was measured."""
    width, height = VIEWS[view]
    context = browser.new_context(
        viewport={"width": width, "height": height},
        color_scheme=scheme,
        has_touch=view == "narrow",
        reduced_motion="reduce",
    )
    page = context.new_page()
    told: list[str] = []
    fetched: list[str] = []
    page.on("console", lambda message: told.append(f"{message.type}: {message.text}"))
    page.on("pageerror", lambda error: told.append(str(error)))
    page.on("request", lambda request: fetched.append(request.url))
    page.goto(url)
    expect(page.locator("#list .row").first).to_be_visible()
    expect(page.locator("#reading")).to_be_hidden(timeout=120_000)
    assert "token" not in page.url, "the token leaves the address bar"
    dark = "rgb(16, 20, 27)"
    ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (ground == dark) == (scheme == "dark"), f"{scheme}: the ground is {ground}"

    def look(name: str, full: bool = False) -> int:
        check_width(page)
        if pictures:
            pictures.mkdir(parents=True, exist_ok=True)
            page.screenshot(path=pictures / f"serve-{view}-{scheme}-{name}.png", full_page=full)
        return axe.check(page, f"{view}, {scheme}, {name}")

    n_passes = [look("list")]
    measured = check_list(page)
    check_keys(page)
    check_player(page)
    n_passes.append(look("player", full=True))
    page.keyboard.press("?")
    n_passes.append(look("help"))
    page.keyboard.press("Escape")
    check_torn(page)
    check_scores_and_report(page)
    n_passes.append(look("report"))
    page.click("nav >> text=Scores")
    page.eval_on_selector_all("#tables details", "all => all.forEach(one => { one.open = true; })")
    n_passes.append(look("scores", full=True))
    own = url.split("?")[0]
    others = [one for one in fetched if not one.startswith((own, "data:", f"blob:{own}"))]
    assert others == [], f"it fetched {others}"
    assert told == [], f"the console says {told}"
    context.close()
    return f"{view}, {scheme}: {measured}; axe passes {n_passes} rules"


def main() -> int:
    """Uses the page in each view; see the top of the file."""
    chromium = find_chromium()
    if chromium is None:
        print("no Chromium here: `apt-get install chromium`, or CHROMIUM=path", file=sys.stderr)
        return SKIPPED
    pictures = Path(sys.argv[2]) if len(sys.argv) > 2 else None
    # A busy machine may take long for anything.
    expect.set_options(timeout=60_000)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        for view in VIEWS:
            for scheme in ("light", "dark"):
                print(use(browser, sys.argv[1], view, scheme, pictures))
        # A stranger's browser, without the token.
        page = browser.new_page()
        answer = page.goto(sys.argv[1].split("?")[0])
        assert answer.status == 403 and "token" in page.inner_text("body")
        browser.close()
    print("used wide and narrow, light and dark")
    return 0


if __name__ == "__main__":
    sys.exit(main())
