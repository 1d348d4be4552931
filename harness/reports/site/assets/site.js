// The scripts of the site: the colours, copying, the search, the box for errors, and the filters of a matrix.
// Everything from a report is shown as text: nothing here writes HTML.
"use strict";

const MOST = 20;
const LONGEST = 200000;
// Rows and squares that are shown at once: a browser needs long for the layout of thousands.
const LISTED = 60;
const COLUMNS = 30;
const SQUARES = 600;

function make(tag, attributes, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes || {})) {
    if (value !== null && value !== false) node.setAttribute(name, value);
  }
  node.append(...children.filter((child) => child !== null && child !== ""));
  return node;
}

// --- colours -------------------------------------------------------------------------------------------------

function stored(name) {
  try { return localStorage.getItem(name); } catch { return null; }
}

function keep(name, value) {
  try { localStorage.setItem(name, value); } catch { /* a page opened from disk may not keep anything */ }
}

const theme = stored("theme");
if (theme === "dark" || theme === "light") document.documentElement.dataset.theme = theme;

function setUpTheme() {
  const button = document.querySelector("[data-theme-switch]");
  const dark = () => (document.documentElement.dataset.theme || (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light")) === "dark";
  const label = () => { button.textContent = dark() ? "Light colours" : "Dark colours"; };
  button.hidden = false;
  label();
  button.addEventListener("click", () => {
    document.documentElement.dataset.theme = dark() ? "light" : "dark";
    keep("theme", document.documentElement.dataset.theme);
    label();
  });
}

// --- copying -------------------------------------------------------------------------------------------------

function setUpCopying() {
  for (const box of document.querySelectorAll(".copy")) {
    const button = make("button", { type: "button" }, "Copy");
    button.addEventListener("click", async () => {
      const text = box.querySelector("code").textContent;
      try {
        await navigator.clipboard.writeText(text);
        button.textContent = "Copied";
      } catch {
        getSelection().selectAllChildren(box.querySelector("code"));
        button.textContent = "Selected";
      }
      setTimeout(() => { button.textContent = "Copy"; }, 1500);
    });
    box.append(button);
  }
}

// --- the search ----------------------------------------------------------------------------------------------

const ORDER = ["package", "environment", "known issue", "matrix", "combination"];

function searched(query) {
  const words = query.toLowerCase().split(/\s+/).filter(Boolean);
  const hits = [];
  if (!words.length) return hits;
  for (const [kind, name, link, text] of window.SEARCH || []) {
    const low = name.toLowerCase();
    const all = low + " " + text.toLowerCase();
    if (!link || !words.every((word) => all.includes(word))) continue;
    const rank = low === words.join(" ") ? 0 : low.startsWith(words[0]) ? 1 : low.includes(words[0]) ? 2 : 3;
    hits.push([rank, ORDER.indexOf(kind), kind, name, link]);
  }
  return hits.sort((a, b) => a[0] - b[0] || a[1] - b[1] || a[3].length - b[3].length);
}

function setUpSearch(root) {
  const form = document.querySelector("[data-search]");
  if (!form) return;
  const input = form.querySelector("input");
  const result = document.querySelector("[data-search-result]");
  const show = () => {
    const hits = searched(input.value);
    const items = hits.slice(0, MOST).map(([, , kind, name, link]) =>
      make("li", {}, make("a", { href: root + link }, name), " ", make("small", {}, kind)));
    const words = hits.length > MOST ? `${hits.length} results, the first ${MOST} of them:` : `${hits.length} results`;
    result.replaceChildren(...(input.value.trim() ? [make("p", {}, words), make("ul", {}, ...items)] : []));
  };
  input.addEventListener("input", show);
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    const link = result.querySelector("a");
    if (link) location.href = link.href;
  });
  show();
}

// --- the box for errors --------------------------------------------------------------------------------------

const compiled = new Map();

function pattern(text) {
  if (!compiled.has(text)) {
    let expression = null;
    try { expression = new RegExp(text, "m"); } catch { /* matched by the words of its examples instead */ }
    compiled.set(text, expression);
  }
  return compiled.get(text);
}

function patternMeets(issue, text) {
  const expression = issue.pattern ? pattern(issue.pattern) : null;
  if (!expression || !issue.literals.every((clause) => clause.some((literal) => text.includes(literal)))) return false;
  return expression.test(text);
}

function explained(text) {
  const words = new Set(text.toLowerCase().match(/[a-z_][a-z0-9_]{2,}/g) || []);
  const met = [];
  const near = [];
  for (const issue of window.ISSUES || []) {
    if (patternMeets(issue, text)) met.push(issue);
    else if (words.size >= 3 && issue.words.length) {
      const common = issue.words.filter((word) => words.has(word)).length;
      const share = common / Math.min(issue.words.length, words.size);
      if (common >= 4 && share >= 0.7) near.push([share, issue]);
    }
  }
  met.sort((a, b) => a.generic - b.generic);
  near.sort((a, b) => b[0] - a[0]);
  return { met, near: near.slice(0, 5).map(([, issue]) => issue) };
}

function setUpPaste(root) {
  const form = document.querySelector("[data-paste]");
  if (!form) return;
  const input = form.querySelector("textarea");
  const result = document.querySelector("[data-paste-result]");
  const list = (issues) => make("ul", {}, ...issues.map((issue) =>
    make("li", {}, make("a", { href: root + issue.link }, make("code", {}, issue.title)), " ", make("small", {}, issue.name))));
  const show = () => {
    const text = input.value.slice(0, LONGEST).replace(/\r\n/g, "\n");
    if (!text.trim()) return result.replaceChildren();
    const { met, near } = explained(text);
    const parts = [];
    if (met.length) parts.push(make("p", {}, `Pages whose pattern this text meets: ${met.length}.`), list(met.slice(0, MOST)));
    if (near.length) parts.push(make("p", {}, "Pages with a similar example:"), list(near));
    if (!parts.length) parts.push(make("p", {}, "No page meets this text."));
    parts.push(make("p", {}, "Which of them is the cause depends on your versions. This command looks at them:"),
      make("pre", {}, make("code", {}, "simmatrix explain error.log")));
    result.replaceChildren(...parts);
  };
  let waiting = 0;
  input.addEventListener("input", () => { clearTimeout(waiting); waiting = setTimeout(show, 120); });
  form.addEventListener("submit", (event) => { event.preventDefault(); show(); });
  show();
}

// --- the filters of a matrix ---------------------------------------------------------------------------------

const FIELDS = ["verdict", "phase", "cause", "family"];

const compareVersions = new Intl.Collator("en", { numeric: true }).compare;

function setUpMatrix(root) {
  const data = window.MATRIX;
  const form = document.querySelector("[data-filters]");
  if (!data || !form) return;
  for (const cell of data.cells) {
    cell.why = data.texts[cell.why];
    cell.text = [cell.label, cell.why, cell.cause, ...cell.versions, ...cell.more.map((place) => data.texts[place])].join(" ").toLowerCase();
  }
  const list = document.querySelector("[data-list] tbody");
  const pivot = document.querySelector("[data-pivot]");
  const drawn = [...pivot.childNodes];
  const count = form.querySelector("[data-count]");
  let most = LISTED;
  let whole = false;
  const more = make("button", { type: "button", hidden: "" });
  document.querySelector("[data-list]").after(more);
  more.addEventListener("click", () => { most = data.cells.length; apply(); });
  const wider = make("button", { type: "button", hidden: "" });
  pivot.after(wider);
  wider.addEventListener("click", () => { whole = true; apply(); });
  const values = (field) => [...new Set(data.cells.flatMap((cell) => cell[field]).filter(Boolean))].sort(compareVersions);
  const fill = (select, options, any) => {
    select.replaceChildren(...(any ? [make("option", { value: "" }, "any")] : []),
      ...options.map(([value, text]) => make("option", { value }, text)));
  };
  const plain = (names) => names.map((name) => [name, name]);
  fill(form.elements.rows, plain(data.axes));
  fill(form.elements.columns, plain(data.axes));
  fill(form.elements.verdict, values("verdict").map((name) => [name, `${data.signs[name]} ${data.words[name]}`]), true);
  for (const field of FIELDS.slice(1)) {
    const options = values(field);
    fill(form.elements[field], plain(options), true);
    form.elements[field].closest("label").hidden = !options.length;
  }
  const axes = form.querySelector("[data-axes]");
  data.axes.forEach((axis, place) => {
    const options = [...new Set(data.cells.map((cell) => cell.axes[place]))].sort(compareVersions);
    const select = make("select", { name: `axis.${axis}` });
    fill(select, plain(options), true);
    axes.append(make("label", {}, `${axis} `, select));
  });
  const controls = [...form.elements].filter((control) => control.name);

  const read = () => {
    const state = new URLSearchParams(location.hash.slice(1));
    for (const control of controls) {
      const first = control.name === "rows" ? data.pivot[0] : control.name === "columns" ? data.pivot[1] : "";
      control.value = state.get(control.name) ?? first;
      if (control.selectedIndex === -1) control.value = first;
    }
  };
  const state = () => {
    const pairs = controls.filter((control) => control.value
      && !(control.name === "rows" && control.value === data.pivot[0])
      && !(control.name === "columns" && control.value === data.pivot[1]));
    return new URLSearchParams(pairs.map((control) => [control.name, control.value])).toString();
  };
  const kept = () => {
    const words = form.elements.text.value.toLowerCase().split(/\s+/).filter(Boolean);
    const wanted = data.axes.map((axis) => form.elements[`axis.${axis}`].value);
    const field = Object.fromEntries(FIELDS.map((name) => [name, form.elements[name].value]));
    return data.cells.filter((cell) =>
      (!field.verdict || cell.verdict === field.verdict) && (!field.phase || cell.phase === field.phase)
      && (!field.cause || cell.cause === field.cause) && (!field.family || cell.family.includes(field.family))
      && wanted.every((value, place) => !value || cell.axes[place] === value)
      && words.every((word) => cell.text.includes(word)));
  };
  const named = (name, link) => (link && name ? make("a", { href: root + link }, name) : name);
  const row = (cell) => make("tr", {},
    make("td", { class: "nowrap" },
      make("span", { class: `verdict ${cell.verdict}` }, make("span", { "aria-hidden": "true" }, data.signs[cell.verdict]),
        ` ${data.words[cell.verdict]}${cell.phase ? ` in ${cell.phase}` : ""}`),
      cell.expected === false ? ", not expected" : ""),
    make("td", {}, named(cell.label, cell.link)),
    make("td", { class: "why" }, cell.why),
    make("td", {}, named(cell.cause, data.issues[cell.cause])),
    make("td", {}, cell.tasks),
    ...cell.versions.map((version) => make("td", {}, version)));
  const apply = () => {
    const shown = kept();
    const total = shown.length;
    list.replaceChildren(...shown.slice(0, most).map((cell) => cell.row ??= row(cell)));
    count.textContent = `${total} of ${data.cells.length} combinations`;
    more.hidden = total <= most;
    more.textContent = `The first ${most} of ${total} are listed. List all`;
    const plainView = total === data.cells.length && form.elements.rows.value === data.pivot[0] && form.elements.columns.value === data.pivot[1];
    if (plainView && drawn.length > 1) {
      wider.hidden = true;
      if (pivot.firstChild !== drawn[0]) pivot.replaceChildren(...drawn);
    } else pivot.replaceChildren(table(shown));
  };
  const table = (cells) => {
    const [down, across] = [form.elements.rows.value, form.elements.columns.value];
    const [row, column] = [data.axes.indexOf(down), data.axes.indexOf(across)];
    const names = (place) => [...new Set(cells.map((cell) => cell.axes[place]))].sort(compareVersions);
    const [allRows, allColumns] = [names(row), names(column)];
    const columns = whole ? allColumns : allColumns.slice(0, COLUMNS);
    const rows = whole ? allRows : allRows.slice(0, Math.max(1, Math.floor(SQUARES / columns.length)));
    wider.hidden = rows.length === allRows.length && columns.length === allColumns.length;
    wider.textContent = `${rows.length} of ${allRows.length} rows and ${columns.length} of ${allColumns.length} columns are shown. Show all`;
    const lines = new Map(rows.map((name) => [name, new Map(columns.map((other) => [other, new Map()]))]));
    for (const cell of cells) {
      const square = lines.get(cell.axes[row])?.get(cell.axes[column]);
      if (!square) continue;
      if (!square.has(cell.verdict)) square.set(cell.verdict, []);
      square.get(cell.verdict).push(cell);
    }
    const link = (name, other, verdict) => `#${new URLSearchParams([["rows", down], ["columns", across], [`axis.${down}`, name], [`axis.${across}`, other], ["verdict", verdict]])}`;
    const square = (name, other, verdict, held) => make("a", {
      class: `square ${verdict}`,
      title: data.words[verdict],
      href: held.length === 1 ? root + held[0].link : link(name, other, verdict),
    }, `${data.signs[verdict]}${held.length > 1 ? ` ${held.length}` : ""}`, make("span", { class: "hide" }, ` ${data.words[verdict]}`));
    const body = [...lines].map(([name, squares]) => make("tr", {}, make("th", { scope: "row" }, name),
      ...[...squares].map(([other, verdicts]) => make("td", {}, ...[...verdicts].map(([verdict, held]) => square(name, other, verdict, held))))));
    return make("table", { class: "pivot" },
      make("caption", {}, `Rows: ${down}. Columns: ${across}. A number counts combinations, variants and repairs among them.`),
      make("thead", {}, make("tr", {}, make("th", { scope: "col" }, `${down} ╲ ${across}`), ...columns.map((name) => make("th", { scope: "col" }, name)))),
      make("tbody", {}, ...body));
  };
  const changed = () => {
    const hash = state();
    history.replaceState(null, "", hash ? `#${hash}` : location.pathname + location.search);
    apply();
  };
  form.hidden = false;
  form.addEventListener("input", changed);
  form.addEventListener("submit", (event) => event.preventDefault());
  form.addEventListener("reset", () => { history.replaceState(null, "", location.pathname + location.search); setTimeout(() => { read(); apply(); }); });
  addEventListener("hashchange", () => { read(); apply(); });
  read();
  apply();
}

document.addEventListener("DOMContentLoaded", () => {
  const root = document.body.dataset.root;
  setUpTheme();
  setUpCopying();
  setUpSearch(root);
  setUpPaste(root);
  setUpMatrix(root);
});
