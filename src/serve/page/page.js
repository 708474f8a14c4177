// The page: views, filters, keys. Everything comes from the server on this machine that served it.

import { List, count, make } from "/list.js";
import { Player } from "/player.js";
import { showScores } from "/scores.js";

const by = (id) => document.getElementById(id);
const VIEWS = ["episodes", "scores", "report"];
/** How often the list is asked for while the server still reads, milliseconds. */
const POLL = 1000;
const isNarrow = matchMedia("(max-width: 899px)");

const state = { overview: null, set: 0, rows: [], filters: {}, open: null };

// The token has become a cookie: it need not stay in the address bar and the history.
if (location.search) history.replaceState(null, "", location.pathname + location.hash);

class GoneError extends Error {}

/** What an address answers; an answer that is an error is thrown with its words. */
async function ask(url, as = "json") {
  let response;
  try {
    response = await fetch(url, { credentials: "same-origin" });
  } catch {
    throw new GoneError("The server does not answer: it has ended, or this page is offline. Start `harmzone serve` again and open the URL that it prints.");
  }
  if (!response.ok) {
    const text = await response.text();
    let told = text;
    try {
      told = JSON.parse(text).error;
    } catch {
      // Plain words.
    }
    throw new Error(told || `${response.status} ${response.statusText}`);
  }
  return response[as]();
}

function notice(error) {
  const box = by("notice");
  box.hidden = !error;
  box.textContent = error ? String(error.message ?? error) : "";
}

// ---- The list

const list = new List(by("list"), (row) => go(`#/episodes/${state.set}/${encodeURIComponent(row.name)}/0`));

const FILTERS = {
  words: (row, value) => value.toLowerCase().split(/\s+/).every((word) => row.name.toLowerCase().includes(word)),
  town: (row, value) => row.town === value,
  weather: (row, value) => row.weather === value,
  split: (row, value) => row.split === value,
  kind: (row, value) => row[value] > 0,
  harmful: (row, value) => hasSome(row.harmful, value),
  missed: (row, value) => hasSome(row.missed, value),
  false_alarms: (row, value) => hasSome(row.false_alarms, value),
};

/** What is not known is neither some nor none. */
function hasSome(n, wanted) {
  return n !== null && n !== undefined && n > 0 === (wanted === "some");
}

/** Shows the episodes that are wanted. */
function filter() {
  const { order, ...wanted } = Object.fromEntries(new FormData(by("filters")));
  const set = Object.entries(wanted).filter(([, value]) => value.trim());
  let rows = state.rows.filter((row) => set.every(([name, value]) => FILTERS[name](row, value.trim())));
  if (order === "name") rows = rows.toSorted((a, b) => a.name.localeCompare(b.name));
  else if (order) rows = rows.toSorted((a, b) => (b[order] ?? -1) - (a[order] ?? -1));
  list.show(rows);
  by("count").textContent = `${count(rows.length)} of ${count(state.rows.length)} episodes`;
  const n = set.filter(([name]) => name !== "words").length + (order ? 1 : 0);
  by("n-filters").textContent = n ? `(${n})` : "";
  by("none").hidden = rows.length > 0;
  by("list").hidden = !rows.length;
}

function fillChoices() {
  for (const name of ["town", "weather", "split"]) {
    const select = by("filters").elements[name];
    const values = [...new Set(state.rows.map((row) => row[name]))].sort();
    const kept = values.includes(select.value) ? select.value : "";
    select.replaceChildren(new Option("any", ""), ...values.map((value) => new Option(value, value)));
    select.value = kept;
  }
}

/** Asks for a set's episodes, again while the server still reads them. */
async function loadRows(set) {
  const turn = (state.loading = {});
  for (let isFirst = true; turn === state.loading; isFirst = false) {
    const { episodes, n_read: nRead } = await ask(`/api/sets/${set}/episodes`);
    if (turn !== state.loading) return;
    state.rows = episodes;
    if (isFirst) fillChoices();
    filter();
    const isDone = nRead === episodes.length;
    by("reading").hidden = isDone;
    Object.assign(by("reading-bar"), { max: episodes.length, value: nRead });
    by("reading-text").textContent = `read ${count(nRead)} of ${count(episodes.length)}`;
    if (isDone) return;
    await new Promise((done) => setTimeout(done, POLL));
  }
}

function chooseSet(idx) {
  state.set = idx;
  by("set").value = idx;
  const { trouble, min_score: minScore } = state.overview.sets[idx];
  by("trouble").hidden = !trouble;
  by("trouble").textContent = trouble ?? "";
  by("min-score").hidden = minScore === null;
  by("min-score").textContent = minScore === null ? "" : `boxes from score ${minScore.toFixed(2)} on`;
  loadRows(idx).catch(notice);
}

by("filters").addEventListener("input", () => {
  by("list").scrollTop = 0;
  filter();
});
by("filters").addEventListener("submit", (event) => event.preventDefault());
// A reset takes effect after its event.
by("filters").addEventListener("reset", () => setTimeout(filter));
by("set").addEventListener("input", (event) => {
  chooseSet(Number(event.target.value));
  go("#/episodes");
});

// ---- The player

const player = new Player(ask, (sample) => {
  if (!state.open) return;
  const hash = `#/episodes/${state.open.set}/${encodeURIComponent(state.open.name)}/${sample}`;
  history.replaceState(null, "", hash);
});
player.onFail = notice;

async function openEpisode(set, name, sample) {
  state.open = { set, name };
  if (set !== state.set) chooseSet(set);
  list.mark(name);
  by("nothing-open").hidden = true;
  document.body.classList.add("playing");
  if (isNarrow.matches) by("player-title").focus();
  try {
    await player.open(set, name, sample);
  } catch (error) {
    if (state.open?.name === name) notice(error);
  }
}

function closeEpisode() {
  const wasOpen = state.open;
  state.open = null;
  player.close();
  by("player").hidden = true;
  by("nothing-open").hidden = !state.overview?.sets.length;
  document.body.classList.remove("playing");
  list.mark(null);
  if (wasOpen) by("list").focus();
}

function openBeside(step) {
  const row = list.beside(step);
  if (row) go(`#/episodes/${state.set}/${encodeURIComponent(row.name)}/0`);
}

by("previous-episode").addEventListener("click", () => openBeside(-1));
by("next-episode").addEventListener("click", () => openBeside(1));

// ---- Views

function choices(select, label, names) {
  select.replaceChildren(...names.map((name, i) => new Option(name, i)));
  label.hidden = names.length < 2;
}

function view(name) {
  for (const other of VIEWS) by(other).hidden = other !== name;
  document.body.dataset.view = name;
  for (const link of document.querySelectorAll("nav a")) {
    if (link.dataset.view === name) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  document.title = `${name[0].toUpperCase()}${name.slice(1)} · ${state.overview.folder} · harmzone`;
}

async function viewScores(idx) {
  const names = state.overview.scores;
  if (!names.length) {
    by("tables").replaceChildren(make("p", "soft", "No scores lie here: `harmzone eval RUN --data DIR --out SCORES` makes them, below this folder."));
    return;
  }
  by("scores-choice").value = idx;
  const turn = (state.scores = {});
  const scores = await ask(`/api/scores/${idx}`);
  if (turn === state.scores) by("tables").replaceChildren(...showScores(scores));
}

function viewReport(idx) {
  const names = state.overview.reports;
  const [space, url] = [by("report-frame"), `/reports/${idx}`];
  by("report-alone").hidden = !names.length;
  if (!names.length) {
    space.replaceChildren(make("p", "soft", "No report lies here: `harmzone report PAGE.html --id SCORES` makes it, below this folder."));
    return;
  }
  by("report-choice").value = idx;
  by("report-alone").href = url;
  if (space.dataset.url === url) return;
  space.dataset.url = url;
  const frame = make("iframe");
  frame.title = `Report ${names[idx]}`;
  // In an origin of its own: its script reaches nothing here.
  frame.setAttribute("sandbox", "allow-scripts allow-forms");
  frame.src = url;
  space.replaceChildren(frame);
}

/** Goes to a view at once: a sample that is drawn meanwhile must not put its own address before it is read. */
function go(hash) {
  if (location.hash !== hash) history.pushState(null, "", hash);
  route();
}

function route() {
  notice(null);
  const [name = "episodes", ...rest] = location.hash.replace(/^#\/?/, "").split("/").filter(Boolean);
  const wanted = VIEWS.includes(name) ? name : "episodes";
  view(wanted);
  if (wanted !== "episodes") player.pause();
  if (wanted === "scores") viewScores(index(rest[0], state.overview.scores)).catch(notice);
  if (wanted === "report") viewReport(index(rest[0], state.overview.reports));
  if (wanted !== "episodes") return;
  const [set, episode, sample] = rest;
  if (episode === undefined) closeEpisode();
  else openEpisode(index(set, state.overview.sets), decodeURIComponent(episode), Math.max(0, Number(sample) || 0));
}

function index(text, all) {
  const idx = Number(text ?? 0);
  return Number.isInteger(idx) && idx >= 0 && idx < all.length ? idx : 0;
}

by("scores-choice").addEventListener("input", (event) => go(`#/scores/${event.target.value}`));
by("report-choice").addEventListener("input", (event) => go(`#/report/${event.target.value}`));
window.addEventListener("hashchange", route);
by("skip").addEventListener("click", (event) => {
  // Not by its address, which is the place in the page's views.
  event.preventDefault();
  by("main").focus();
});

// ---- Keys

const help = by("help");
by("help-button").addEventListener("click", () => help.showModal());

/** Whether a key is for the element itself. */
function isTaken(target, key) {
  if (target.matches("input[type=search], select, textarea")) return true;
  if (target.matches("input[type=range]")) return key !== " " && !/^[a-z/?]$/.test(key);
  return key === " " && target.matches("button, summary, a, input");
}

document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey || help.open) return;
  const { key, target } = event;
  if (key === "Escape" && target.matches("input[type=search]")) {
    target.value = "";
    filter();
    by("list").focus();
    return;
  }
  if (isTaken(target, key)) return;
  const keys = { "?": () => help.showModal() };
  if (document.body.dataset.view === "episodes") {
    keys["/"] = () => {
      if (isNarrow.matches && state.open) go("#/episodes");
      by("filters").elements.words.focus();
    };
    if (state.open) {
      Object.assign(keys, {
        " ": () => player.toggle(), ArrowLeft: () => player.step(-1), ArrowRight: () => player.step(1),
        Home: () => player.first(), End: () => player.last(), f: () => player.nextFault(),
        Escape: () => go("#/episodes"),
      });
    }
    Object.assign(keys, { j: () => openBeside(1), k: () => openBeside(-1) });
  }
  const action = keys[key];
  if (!action) return;
  event.preventDefault();
  action();
});

// ---- Begin

async function begin() {
  state.overview = await ask("/api/folder");
  const { folder, sets, scores, reports, is_cut: isCut } = state.overview;
  by("folder").textContent = folder;
  choices(by("set"), by("set-label"), sets.map((set) => set.name));
  choices(by("scores-choice"), by("scores-label"), scores);
  choices(by("report-choice"), by("report-label"), reports);
  by("more").open = !isNarrow.matches;
  if (sets.length) chooseSet(0);
  else by("browse").replaceChildren(by("episodes-title"), make("p", "soft", "No data set lies here: `harmzone gen --out DIR` makes one, below this folder."));
  route();
  if (isCut) notice("The folder holds more files than are looked through: serve a folder closer to the data.");
  if (!sets.length && location.hash === "") go(scores.length ? "#/scores" : "#/report");
}

begin().catch(notice);
