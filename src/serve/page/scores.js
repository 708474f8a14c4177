// Scores as tables.

import { make } from "/list.js";

function cellInto(element, { text, below }) {
  element.textContent = text;
  element.append(...below.map((line) => make("small", "", line)));
  return element;
}

function table(of, id) {
  const scroll = make("div", "scroll");
  // A table may be wider than a phone: the keyboard scrolls it, too.
  Object.assign(scroll, { tabIndex: 0 });
  scroll.setAttribute("role", "region");
  scroll.setAttribute("aria-labelledby", id);
  const table = make("table");
  const head = make("tr");
  head.append(...of.head.map((name) => Object.assign(make("th", "", name), { scope: "col" })));
  const body = of.rows.map((cells) => {
    const row = make("tr");
    const [name, ...values] = cells;
    row.append(cellInto(Object.assign(make("th"), { scope: "row" }), name), ...values.map((cell) => cellInto(make("td"), cell)));
    return row;
  });
  table.append(make("thead"), make("tbody"));
  table.tHead.append(head);
  table.tBodies[0].append(...body);
  scroll.append(table);
  return [scroll, ...(of.note ? [make("p", "note", of.note)] : [])];
}

/** The content of the view. */
export function showScores(scores) {
  const parts = [];
  if (scores.standing) parts.push(make("p", "standing", scores.standing));
  if (scores.command) {
    const command = make("p", "command");
    command.append("Made by ", make("code", "", scores.command));
    parts.push(command);
  }
  scores.tables.forEach((of, i) => {
    const id = `table-${i}`;
    const title = Object.assign(make(of.is_main ? "h2" : "span", "", of.title), { id });
    if (of.is_main) {
      parts.push(title, ...table(of, id));
    } else {
      const fold = make("details");
      const summary = make("summary");
      summary.append(title);
      fold.append(summary, ...table(of, id));
      parts.push(fold);
    }
  });
  return parts;
}
