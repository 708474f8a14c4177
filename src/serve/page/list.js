// The list of episodes: only the rows in view are in the document, so that thousands scroll without lag.

const MORE_ROWS = 6;

/** Thousands with a comma. */
export function count(n) {
  return n.toLocaleString("en");
}

/** An element with a class and text. */
export function make(tag, name, text) {
  const element = document.createElement(tag);
  if (name) element.className = name;
  if (text !== undefined) element.textContent = text;
  return element;
}

/** What stands under a row's name. */
export function describe(row) {
  return [row.town, row.weather, row.split].filter(Boolean).join(" · ");
}

function tags(row) {
  if (row.trouble) return [["trouble", "cannot be shown"]];
  if (!row.is_read) return [];
  const all = [["harm", row.harmful, "harmful"], ["miss", row.missed, "missed"], ["alarm", row.false_alarms, "false"]];
  return all.filter(([, n]) => n).map(([name, n, word]) => [name, `${count(n)} ${word}`]);
}

export class List {
  /** `open` is called with the row that was chosen. */
  constructor(element, open) {
    this.element = element;
    this.open = open;
    this.rows = [];
    this.active = 0;
    this.chosen = null;
    this.space = make("div", "space");
    this.space.setAttribute("role", "presentation");
    element.replaceChildren(this.space);
    element.addEventListener("scroll", () => this.plan(), { passive: true });
    element.addEventListener("keydown", (event) => this.press(event));
    element.addEventListener("click", (event) => {
      const row = event.target.closest("[role=option]");
      if (row) this.choose(Number(row.dataset.idx));
    });
    new ResizeObserver(() => this.plan()).observe(element);
  }

  /** Shows these rows; the active one stays if it is among them. */
  show(rows) {
    const active = this.rows[this.active];
    this.rows = rows;
    this.active = Math.max(0, active ? rows.findIndex((row) => row.name === active.name) : 0);
    this.draw();
  }

  /** Marks an episode as the one that is open. */
  mark(name) {
    this.chosen = name;
    const idx = this.rows.findIndex((row) => row.name === name);
    if (idx >= 0) this.activate(idx);
    else this.draw();
  }

  /** The row that is so many after the open one. */
  beside(by) {
    const idx = this.rows.findIndex((row) => row.name === this.chosen);
    return this.rows[idx < 0 ? 0 : idx + by];
  }

  choose(idx) {
    this.active = idx;
    this.draw();
    if (this.rows[idx]) this.open(this.rows[idx]);
  }

  activate(idx) {
    this.active = Math.min(Math.max(idx, 0), this.rows.length - 1);
    const [height, top] = [this.rowHeight(), this.active * this.rowHeight()];
    const { scrollTop, clientHeight } = this.element;
    if (top < scrollTop) this.element.scrollTop = top;
    if (top + height > scrollTop + clientHeight) this.element.scrollTop = top + height - clientHeight;
    this.draw();
  }

  press(event) {
    if (event.ctrlKey || event.altKey || event.metaKey || !this.rows.length) return;
    const page = Math.max(1, Math.floor(this.element.clientHeight / this.rowHeight()) - 1);
    const to = {
      ArrowDown: this.active + 1, ArrowUp: this.active - 1, PageDown: this.active + page, PageUp: this.active - page,
      Home: 0, End: this.rows.length - 1,
    }[event.key];
    if (to !== undefined) this.activate(to);
    else if (event.key === "Enter") this.choose(this.active);
    else return;
    event.preventDefault();
    event.stopPropagation();
  }

  /** A row's height follows the font's. */
  rowHeight() {
    return 4.1 * parseFloat(getComputedStyle(document.documentElement).fontSize);
  }

  plan() {
    this.waiting ??= requestAnimationFrame(() => this.draw());
  }

  draw() {
    if (this.waiting !== undefined) cancelAnimationFrame(this.waiting);
    this.waiting = undefined;
    const [height, n] = [this.rowHeight(), this.rows.length];
    this.space.style.height = `${n * height}px`;
    const first = Math.max(0, Math.floor(this.element.scrollTop / height) - MORE_ROWS);
    const last = Math.min(n, Math.ceil((this.element.scrollTop + this.element.clientHeight) / height) + MORE_ROWS);
    const shown = [];
    // The active row is always there: the list names it to screen readers.
    if (n && this.active < first) shown.push(this.row(this.active, height));
    for (let i = first; i < last; i++) shown.push(this.row(i, height));
    if (n && this.active >= last) shown.push(this.row(this.active, height));
    this.space.replaceChildren(...shown);
    if (n) this.element.setAttribute("aria-activedescendant", `row-${this.active}`);
    else this.element.removeAttribute("aria-activedescendant");
  }

  row(idx, height) {
    const row = this.rows[idx];
    const element = make("div", "row");
    element.id = `row-${idx}`;
    element.dataset.idx = idx;
    element.setAttribute("role", "option");
    element.setAttribute("aria-selected", String(row.name === this.chosen));
    element.setAttribute("aria-posinset", idx + 1);
    element.setAttribute("aria-setsize", this.rows.length);
    element.classList.toggle("active", idx === this.active);
    element.style.top = `${idx * height}px`;
    element.style.height = `${height}px`;
    element.append(make("span", "name", row.name), make("span", "facts", describe(row)));
    const marks = make("span", "tags");
    marks.append(...tags(row).map(([name, text]) => make("span", `tag ${name}`, text)));
    element.append(marks);
    return element;
  }
}
