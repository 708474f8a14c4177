// Plays an episode: reads samples ahead, draws them, tells what is there.

import { drawAbove, drawCamera, drawMarks } from "/draw.js";
import { count, describe, make } from "/list.js";

/** Samples that stay here, and that are read ahead. */
const KEPT = 80;
const AHEAD = 4;
/** Longest and shortest time that a sample stays, milliseconds. */
const STAY = [40, 2000];

const FAULTS = {
  not_seen: "missed: not seen", called_harmless: "missed: called harmless",
  called_harmful: "false alarm: a harmless object", nothing_there: "false alarm: nothing there",
};

const by = (id) => document.getElementById(id);

export class Player {
  /** `ask` fetches an address; `moved` is told where the player is. */
  constructor(ask, moved) {
    Object.assign(this, { ask, moved, frames: new Map(), episode: null, at: 0, isPlaying: false });
    this.layers = { truth: true, found: true, zone: true, points: true };
    for (const layer of Object.keys(this.layers)) {
      by(`show-${layer}`).addEventListener("input", (event) => {
        this.layers[layer] = event.target.checked;
        this.draw();
      });
    }
    by("play").addEventListener("click", () => this.toggle());
    by("back").addEventListener("click", () => this.step(-1));
    by("forward").addEventListener("click", () => this.step(1));
    by("next-fault").addEventListener("click", () => this.nextFault());
    by("seek").addEventListener("input", (event) => this.goAndTell(Number(event.target.value)));
    new ResizeObserver(() => this.draw()).observe(by("stage"));
    new ResizeObserver(() => this.drawMarks()).observe(by("marks"));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.drawMarks());
  }

  get isOpen() {
    return this.episode !== null;
  }

  /** Opens an episode of a set at a sample. */
  async open(set, name, sample) {
    this.close();
    const url = `/api/sets/${set}/episodes/${encodeURIComponent(name)}`;
    const turn = (this.turn = {});
    by("player-title").textContent = name;
    by("player-facts").textContent = "reading ...";
    by("player").hidden = false;
    const episode = await this.ask(url);
    if (turn !== this.turn) return;
    Object.assign(this, { episode, url, set });
    by("player-facts").textContent = [describe(episode), `${count(episode.n_samples)} samples`, ...this.sums()].join(" · ");
    Object.assign(by("seek"), { max: Math.max(episode.n_samples - 1, 0) });
    by("seek").disabled = episode.n_samples < 2;
    this.faults = [...Array(episode.n_samples).keys()].filter(
      (i) => (episode.by_sample.missed?.[i] ?? 0) + (episode.by_sample.false_alarms?.[i] ?? 0) > 0,
    );
    by("next-fault").disabled = !this.faults.length;
    this.drawMarks();
    if (episode.trouble) throw new Error(episode.trouble);
    if (!episode.n_samples) throw new Error("the episode has no sample");
    await this.go(Math.min(sample, episode.n_samples - 1));
  }

  sums() {
    const { harmful, missed, false_alarms: alarms } = this.episode;
    const all = [[harmful, "harmful"], [missed, "missed"], [alarms, "false"]];
    return all.filter(([n]) => n !== null).map(([n, word]) => `${count(n)} ${word}`);
  }

  close() {
    this.pause();
    this.turn = null;
    this.episode = null;
    this.shown = null;
    for (const frame of this.frames.values()) frame.then(({ picture }) => picture?.close(), () => {});
    this.frames.clear();
    // Nothing of the episode before stands beside the next one's name.
    for (const id of ["camera", "above", "marks"]) by(id).width = 0;
    by("here").replaceChildren();
    by("now").textContent = "";
  }

  /** A sample's parts; asked for once. The last used is the last of all. */
  load(sample) {
    const known = this.frames.get(sample);
    if (known) {
      this.frames.delete(sample);
      this.frames.set(sample, known);
      return known;
    }
    const url = `${this.url}/samples/${sample}`;
    const picture = this.ask(`${url}/image`, "blob").then((blob) => createImageBitmap(blob));
    const points = this.ask(`${url}/points`, "arrayBuffer").then((bytes) => new Int16Array(bytes));
    const frame = Promise.all([this.ask(url), picture, points]).then(([facts, picture, points]) => ({ ...facts, picture, points }));
    this.frames.set(sample, frame);
    // What failed may be asked for again.
    frame.catch(() => this.frames.delete(sample));
    if (this.frames.size > KEPT) this.makeRoom();
    return frame;
  }

  /** Lets the longest unused sample go, but not the one to be shown; a picture in view stays open. */
  makeRoom() {
    const [oldest, gone] = [...this.frames].find(([sample]) => sample !== this.at);
    this.frames.delete(oldest);
    gone.then((frame) => frame !== this.shown && frame.picture?.close(), () => {});
  }

  /** Shows a sample. */
  async go(sample) {
    if (!this.episode) return;
    const turn = this.turn;
    this.at = sample;
    by("seek").value = sample;
    const frame = await this.load(sample);
    if (turn !== this.turn || sample !== this.at) return;
    this.shown = frame;
    this.draw();
    this.tell();
    this.moved(sample);
    const last = this.episode.n_samples - 1;
    for (let ahead = 1; ahead <= AHEAD && sample + ahead <= last; ahead++) this.load(sample + ahead).catch(() => {});
  }

  step(by) {
    if (!this.episode) return;
    this.pause();
    const to = Math.min(Math.max(this.at + by, 0), this.episode.n_samples - 1);
    if (to !== this.at) this.goAndTell(to);
  }

  first() {
    this.step(-Infinity);
  }

  last() {
    this.step(Infinity);
  }

  nextFault() {
    if (!this.episode || !this.faults.length) return;
    this.pause();
    this.goAndTell(this.faults.find((sample) => sample > this.at) ?? this.faults[0]);
  }

  /** Shows a sample and says so to who does not see it. */
  goAndTell(sample) {
    const say = () => sample === this.at && this.say();
    this.go(sample).then(say, (error) => this.fail(error));
  }

  toggle() {
    if (this.isPlaying) this.pause();
    else this.play();
  }

  pause() {
    if (!this.isPlaying) return;
    this.isPlaying = false;
    by("play").textContent = "Play";
    this.say();
  }

  async play() {
    if (!this.episode || this.episode.n_samples < 2) return;
    this.isPlaying = true;
    by("play").textContent = "Pause";
    const [turn, last] = [this.turn, this.episode.n_samples - 1];
    // Who pauses and plays again begins another run.
    const run = (this.run = {});
    const isOn = () => this.isPlaying && run === this.run && turn === this.turn && this.at < last;
    try {
      if (this.at === last) await this.go(0);
      while (isOn()) {
        const begin = performance.now();
        const [from, next] = [this.shown, await this.load(this.at + 1)];
        const wanted = (1000 * (next.time_s - (from?.time_s ?? 0))) / Number(by("speed").value);
        const stay = Math.min(Math.max(wanted, STAY[0]), STAY[1]) - (performance.now() - begin);
        await new Promise((done) => setTimeout(done, Math.max(stay, 0)));
        if (isOn()) await this.go(this.at + 1);
      }
    } catch (error) {
      this.fail(error);
    }
    if (run === this.run) this.pause();
  }

  draw() {
    if (!this.shown || by("player").hidden) return;
    drawCamera(by("camera"), this.shown, this.layers);
    drawAbove(by("above"), this.shown, this.layers);
  }

  drawMarks() {
    if (this.episode) drawMarks(by("marks"), this.episode.by_sample, this.episode.n_samples);
  }

  /** Words for the sample in view. */
  tell() {
    const { shown, at, episode } = this;
    const turn = Math.abs(shown.steering_deg) < 0.05 ? "straight"
      : `${Math.abs(shown.steering_deg).toFixed(1)}° ${shown.steering_deg > 0 ? "left" : "right"}`;
    const place = `sample ${at + 1} of ${episode.n_samples}`;
    by("now").textContent = `${place} · ${shown.time_s.toFixed(1)} s · ${shown.speed_mps.toFixed(1)} m/s · ${turn}`;
    by("seek").setAttribute("aria-valuetext", place);
    const what = this.sentence();
    by("camera").setAttribute("aria-label", `Camera picture, ${place}: ${what}`);
    by("above").setAttribute("aria-label", `View from above, ${place}: ${shown.n_points} LiDAR points, ${what}`);
    this.fillTable();
  }

  sentence() {
    const { objects, detections } = this.shown;
    if (!objects) return `nobody annotated; ${detections?.length ?? 0} predicted boxes`;
    const harmful = objects.filter((of) => of.harm === "harmful").length;
    const missed = objects.filter((of) => of.fault).length;
    const alarms = (detections ?? []).filter((of) => of.fault).length;
    const parts = [`${objects.length} objects`, `${harmful} harmful`];
    if (detections) parts.push(`${missed} missed`, `${alarms} false alarms`);
    return parts.join(", ");
  }

  say() {
    if (this.shown && this.episode) by("said").textContent = `Sample ${this.at + 1}: ${this.sentence()}`;
  }

  fail(error) {
    this.onFail?.(error);
  }

  /** A harmful object that is no fault: far ones and those without LiDAR points are not scored. */
  isFound({ center: [x, y] }) {
    const { detections, match_m: near } = this.shown;
    const lies = ({ harm, center }) => harm === "harmful" && Math.hypot(center[0] - x, center[1] - y) < near;
    return detections.some(lies) ? "found" : "not scored";
  }

  fillTable() {
    const { objects, detections } = this.shown;
    const rows = (objects ?? []).map((of) => ({
      of, what: `${(of.category ?? of.kind ?? "object").replaceAll("_", " ")}${of.is_unfamiliar ? ", unfamiliar" : ""}`,
      label: of.harm ?? "no label", tone: of.harm,
      result: of.fault ? FAULTS[of.fault] : of.harm === "harmful" && detections ? this.isFound(of) : "",
    }));
    const alarms = (detections ?? []).filter((of) => of.fault || !objects);
    rows.push(...alarms.map((of) => ({
      of, what: `box of score ${of.score.toFixed(2)}`, label: `predicted ${of.harm}`, tone: `found-${of.harm}`, result: FAULTS[of.fault] ?? "",
    })));
    rows.sort((a, b) => range(a.of) - range(b.of));
    const shown = rows.map(({ of, what, label, tone, result }) => {
      const row = make("tr", of.fault ? "fault" : "");
      const name = make("th", "", what);
      name.scope = "row";
      row.append(name, make("td", `label ${tone ?? ""}`, label), make("td", "", where(of)), make("td", "result", result));
      return row;
    });
    if (!shown.length) {
      const row = make("tr");
      const cell = make("td", "", "nothing");
      cell.colSpan = 4;
      row.append(cell);
      shown.push(row);
    }
    by("here").replaceChildren(...shown);
  }
}

function range({ center }) {
  return Math.hypot(center[0], center[1]);
}

function where({ center: [x, y] }) {
  const aside = Math.abs(y) < 0.5 ? "straight on" : `${Math.abs(y).toFixed(0)} m ${y > 0 ? "left" : "right"}`;
  return `${x.toFixed(0)} m, ${aside}`;
}
