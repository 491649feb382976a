// What all views share: elements, questions to the server, the address, numbers in words.

const there = (children) => children.flat(4).filter((child) => child !== null && child !== undefined);
/** Append, or put in place of what was there, the focus where it was; lists are spread, null is left out. */
export const put = (host, ...children) => host.append(...there(children));
export const refill = (host, ...children) => {
  const controls = () => [...host.querySelectorAll("a, button, input, select, summary")], at = controls().indexOf(document.activeElement);
  host.replaceChildren(...there(children));
  if (at >= 0) controls()[at]?.focus();
};

/** An element: attributes (on… are listeners), then children; text is always text, never markup. */
export function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [key, value] of Object.entries(attributes)) {
    if (value === undefined || value === null || value === false) continue;
    if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
    else if (key === "value" || key === "checked" || key === "disabled") made[key] = value;
    else made.setAttribute(key, value === true ? "" : value);
  }
  put(made, children);
  return made;
}

/** A table: heading, rows of cells (text, element, or {number: text}); of class "cards" it is one card a row where the
    screen is narrow, each cell after the name of its column. */
export function table(heading, rows, attributes = {}) {
  const isNumber = (value) => value !== null && typeof value === "object" && "number" in value;
  const named = heading.map((name) => typeof name === "string" ? name : isNumber(name) ? name.number : null);
  const cell = (tag, value, column) => { const label = tag === "td" ? named[column] : null;
    return isNumber(value) ? element(tag, { class: "number", "data-label": label }, value.number) : element(tag, { "data-label": label }, value ?? ""); };
  return element("div", { class: "wide" }, element("table", attributes,
    element("thead", {}, element("tr", {}, heading.map((name, column) => cell("th", name, column)))),
    element("tbody", {}, rows.map((row) => element("tr", {}, row.map((value, column) => cell("td", value, column)))))));
}

/** A table whose texts the server wrote, as report and terminal have them; `more`: of a row by its number, further cells. */
export const shownTable = ({ columns, numbers, rows }, attributes = {}, further = [], more = () => []) => table(
  [...columns.map((name, i) => numbers[i] ? { number: name } : name), ...further],
  rows.map((row, at) => [...row.map(({ text, note, kind }, i) => {
    const inside = [element("span", { class: kind }, text), note ? element("small", { class: i ? "under" : "" }, ` ${note}`) : null];
    return numbers[i] ? { number: inside } : inside;
  }), ...more(at)]), attributes);

export const button = (text, work, attributes = {}) => element("button", { type: "button", onclick: guarded(work), ...attributes }, text);
export const link = (text, view, asked) => element("a", { href: address(view, asked) }, text);
export const choice = (options, value, change, attributes = {}) => element("select", { onchange: (event) => change(event.target.value), ...attributes },
  options.map((option) => {
    const [key, text] = Array.isArray(option) ? option : [option, option];
    return element("option", { value: key, selected: key === value }, text);
  }));
export const labelled = (text, control) => element("label", {}, text, " ", control);
export const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/** Say a sentence to the person; "" takes it away. */
export function say(sentence) {
  document.getElementById("said").textContent = sentence;
}

/** The work, with its failure said as a sentence. */
export const guarded = (work) => async (...given) => {
  try {
    return await work(...given);
  } catch (error) {
    say(error.message);
    return undefined;
  }
};

async function asked(path, options) {
  let response;
  try {
    response = await fetch(path, options);
  } catch {
    throw new Error("the server does not answer; is stickslip app still running? Start it again: jobs and drafts are kept");
  }
  if (response.ok) return response;
  let sentence = `the server answered ${response.status}; load the page again`;
  try { sentence = (await response.json()).error ?? sentence; } catch { /* no JSON: the sentence above */ }
  throw new Error(sentence);
}

const query = (values) => new URLSearchParams(Object.entries(values).filter(([, value]) => value !== undefined && value !== null && value !== ""));
export const get = async (name, values = {}) => (await asked(`api/${name}?${query(values)}`)).json();
export const post = async (name, values = {}) => (await asked(`api/${name}`, { method: "POST", body: JSON.stringify(values) })).json();
export const add = async (file) => (await asked(`api/add?${query({ name: file.name })}`, { method: "POST", body: file })).json();
export const fileAddress = (path, keep = false) => `files/${path.split("/").map(encodeURIComponent).join("/")}${keep ? "?keep=1" : ""}`;

/** Rows of numbers: an array of Float64Array. */
export async function curves(name, values) {
  const response = await asked(`api/${name}?${query(values)}`);
  const rows = Number(response.headers.get("x-rows")), all = new Float64Array(await response.arrayBuffer());
  const length = all.length / rows;
  return Array.from({ length: rows }, (_, row) => all.subarray(row * length, (row + 1) * length));
}

/** At most one question at a time; of those that come meanwhile only the newest is asked. */
export function newestWins(work) {
  let busy = false, waiting = null;
  return async function ask(...given) {
    if (busy) { waiting = given; return; }
    busy = true;
    await guarded(work)(...given);
    busy = false;
    if (waiting) { const next = waiting; waiting = null; await ask(...next); }
  };
}

/** One question after the other, none left out. */
export function inOrder(work) {
  let last = Promise.resolve();
  return (...given) => { last = last.then(() => guarded(work)(...given)); return last; };
}

/** Wait until nothing has come for so long [ms]. */
export function settled(work, pause = 350) {
  let timer;
  return (...given) => { clearTimeout(timer); timer = setTimeout(() => work(...given), pause); };
}

export const address = (view, values = {}) => `#${view}?${query(values)}`;
export function here() {
  const [view, rest] = location.hash.slice(1).split("?");
  return { view: view || "logs", asked: Object.fromEntries(new URLSearchParams(rest ?? "")) };
}
/** Change what the address says of this view without loading it again: nothing is lost on reload. */
export function remember(values) {
  const { view, asked: before } = here();
  history.replaceState(null, "", address(view, { ...before, ...values }));
}

const UNITS = {
  m: [["mm", 1e-3], ["µm", 1e-6], ["nm", 1e-9]],
  s: [["s", 1], ["ms", 1e-3], ["µs", 1e-6]],
  N: [["N", 1], ["mN", 1e-3], ["µN", 1e-6]],
  "1/m^0.5": [["1/√mm", 10 ** 1.5]],
  "m/s": [["mm/s", 1e-3], ["µm/s", 1e-6], ["nm/s", 1e-9]],
  kg: [["kg", 1], ["g", 1e-3]],
  Hz: [["Hz", 1], ["mHz", 1e-3]],
  "N/s": [["N/s", 1], ["mN/s", 1e-3]],
};
export function plain(value, digits = 4) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  return String(Number(value.toPrecision(digits))).replace("-", "−");
}
/** A number with its unit, as a laboratory writes it. */
export function quantity(value, unit = "", digits = 4) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const [name, factor] = shownIn(value || 1, unit);
  return `${plain(value / factor, digits)} ${name}`.trim();
}
/** The unit in which a value is shown, and its size in SI. */
export const shownIn = (value, unit) => { const known = UNITS[unit] ?? [[unit, 1]]; return known.find(([, size]) => Math.abs(value) >= 0.0999 * size) ?? known[known.length - 1]; };
export const duration = (value) => value < 100 ? `${value.toFixed(value < 10 ? 1 : 0)} s` : `${Math.round(value / 60)} min`;

/** A command with a button that copies it: what was done here, for the command line. */
export function command(text) {
  return element("p", {}, element("code", {}, text), " ", button("copy", () => navigator.clipboard.writeText(text), { title: "Copy this command" }));
}

/** Parameters as the report writes them. */
export const SYMBOLS = { mu_s: "μₛ", mu_k0: "μₖ₀", delta_mu_k: "Δμₖ" };
