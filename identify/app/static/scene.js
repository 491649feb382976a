// The scene: a form with units as typed, effects as switches, and the text beside it; what one side says the other shows.
import { button, choice, command, element, get, inOrder, labelled, link, plain, post, put, quantity, refill, say, settled, table } from "./base.js";

const LOG_COLUMNS = [["drive_speed", "drive speed"], ["step", "step"], ["labels", "labels"]];
const CUTS = [["window", "window"], ["exclude", "left out"], ["skip_cycles", "skipped cycles"], ["tare", "zero"]];
const EXAMPLES = { mass: "200 g", stiffness: "1.5 N/mm", zeta: "0.05", damping: "147 N/m", drive_speed: "0.1 mm/s", normal_force: "2 N", noise: "2 mN" };
const GUESS = 5; // factor either way in which a guess is searched
const missing = (value) => value.startsWith("TODO");
const SPEEDS = { "m/s": 1, "cm/s": 1e-2, "mm/s": 1e-3, "um/s": 1e-6, "µm/s": 1e-6, "mm/min": 1e-3 / 60 };

/** Stiffness [N/m] that the sticks of logs show: stick slope over the drive speed as it was typed; the middle one. */
function ofSticks(logs, known) {
  const each = logs.map((log) => { const [, v, unit] = log.drive_speed.match(/^\s*([\d.e-]+)\s*(\S+)\s*$/) ?? []; return (known[log.path]?.slope ?? NaN) / (v * SPEEDS[unit]); });
  const sound = each.filter((k) => k > 0 && Number.isFinite(k)).sort((a, b) => a - b);
  return sound[sound.length >> 1];
}

/** Bounds around a value as it was typed, in its unit; null where it is no number. */
function around(value) {
  const found = value.match(/^\s*([\d.]+(?:e[+-]?\d+)?)\s*(.*)$/i);
  return found && { lower: `${Number((found[1] / GUESS).toPrecision(4))} ${found[2]}`.trim(), upper: `${Number((found[1] * GUESS).toPrecision(4))} ${found[2]}`.trim() };
}

export async function sceneView(host, asked, session) {
  if (!session.scene) {
    put(host, element("p", {}, "There is no scene yet: choose logs in ", link("the table", "logs"), " and make one from them."));
    return undefined;
  }
  const path = session.scene, first = await get("scene", { path }), form = element("div", {}), state = element("div", { class: "bar" }), error = element("p", { class: "error", role: "alert" });
  const text = element("textarea", { "aria-label": "the scene as TOML", spellcheck: "false", oninput: () => { state.dataset.saved = "no"; typed(); } });
  const send = inOrder(async (asked, fromText) => show(await post("edit", { path, ...asked }), fromText));
  const typed = settled(() => send({ text: text.value }, true));
  const change = (keys, value) => send({ changes: [{ keys, value }] });
  const input = (keys, value, attributes = {}) => {
    const place = keys.join(".");
    const open = missing(value), example = EXAMPLES[keys[keys.length - 1]];
    const made = element("input", { value: open ? "" : value, "data-place": place, "data-open": open, "aria-label": attributes.label ?? place, spellcheck: "false", onchange: () => change(keys, made.value), ...attributes,
      placeholder: open ? `such as ${example}` : attributes.placeholder });
    return made;
  };

  const stem = path.split("/").pop().replace(/\.toml$/, ""), last = session.folder.fits.find((fit) => fit.path.startsWith("stickslip-") && [stem, first.form?.name].includes(fit.path.slice(10)));
  const reasons = Object.fromEntries(((last && await get("fit", { path: last.path }).catch(() => null))?.effects ?? []).map((reason) => [reason.effect, reason.sentence]));
  const folded = (name, words, ...inside) => element("details", { class: "folded", open: form.querySelector(`[data-folded=${name}]`)?.open, "data-folded": name }, element("summary", {}, words), inside);
  function effects(seen, on) {
    return seen.effects.filter((effect) => effect.on === on).map((effect) => {
      const box = element("input", { type: "checkbox", checked: effect.on, onchange: () => {
        let on = [...form.querySelectorAll("[data-effect]")].filter((one) => one.querySelector("input").checked).map((one) => one.dataset.effect).filter((name) => name !== effect.name);
        if (box.checked) on = [...on.filter((name) => !effect.role || seen.effects.find((one) => one.name === name).role !== effect.role), ...effect.needs.filter((name) => !on.includes(name)), effect.name];
        change(["effects"], on);
      } });
      const many = (number, word) => number ? `${number} ${word}${number === 1 ? "" : "s"}` : "";
      const adds = [many(effect.states, "state"), many(effect.searched, "estimated parameter")].filter(Boolean).join(", ");
      return element("div", { class: "effect", "data-effect": effect.name }, element("label", {}, box, " ", element("strong", {}, effect.name.replaceAll("_", " ")), ": ", effect.says),
        element("small", {}, adds ? `adds ${adds}` : "adds no parameter", effect.parameters.length ? ` (${effect.parameters.join(", ")})` : "", effect.role ? `; one ${effect.role} at most` : "", effect.needs.length ? `; needs ${effect.needs.join(", ")}` : ""),
        effect.on && reasons[effect.name] ? element("small", {}, `Last fit: ${reasons[effect.name].replace(`${effect.says}; `, "")}.`) : effect.matters ? element("small", {}, `In this scene: ${effect.matters}.`) : null);
    });
  }

  function rigField(field, seen) {
    const k = field.key === "stiffness" && missing(field.value) ? ofSticks(seen.logs, known()) : undefined;
    const label = element("label", {}, field.label, field.unit === "no unit" ? "" : ` (${field.unit})`), made = input(["rig", field.key], field.value, { placeholder: field.needed ? `such as ${EXAMPLES[field.key] ?? ""}` : "", label: field.label });
    const box = !field.guess ? null : element("input", { type: "checkbox", checked: field.searched !== "", "data-guess": field.key, onchange: () => {
      const bounds = around(made.value);
      if (box.checked && !bounds) { box.checked = false; made.focus(); say(`type an estimate of the ${field.label} first, with its unit`); return; }
      change(["parameters", field.key], box.checked ? bounds : null);
    } });
    return element("div", { class: "field" }, label, made, element("small", {}, field.help), k ? element("small", {}, button(`use ${plain(k, 3)} N/m, as the sticks of the logs show`, () => change(["rig", "stiffness"], `${plain(k, 4)} N/m`))) : null,
      box ? element("small", {}, element("label", {}, box, field.searched ? ` uncertain: estimated by the fit, ${field.searched.replace(/[{}"]/g, "").trim()}` : ` uncertain: estimate it in the fit, within a factor of ${GUESS}`)) : null);
  }

  function parameters(seen) {
    return element("div", { class: "wide" }, element("table", {}, element("thead", {}, element("tr", {}, ["parameter", "start", "lower", "upper", "fixed at"].map((name) => element("th", {}, name)))),
      element("tbody", {}, seen.parameters.map((p) => element("tr", {},
        element("td", { class: "meaning" }, element("label", { title: p.meaning }, `${p.symbol} ${p.name}`), element("br"), element("small", {}, p.meaning)),
        ["start", "lower", "upper", "fixed"].map((word) => element("td", {}, p.kind === "given" && (word === "lower" || word === "upper") ? "" : input(["parameters", p.name, word], p[word],
          { size: 9, label: `${word} of ${p.name}`, placeholder: word === "start" ? quantity(p.value, p.unit, 3) : word === "fixed" && p.kind === "given" ? quantity(p.value, p.unit, 3) : "" }))))))));
  }

  const known = () => Object.fromEntries(session.folder.logs.map((log) => [log.path, log]));
  function logs(seen) {
    const of = known(), field = (log, number, key) => [input(["logs", String(number + 1), key], log[key], { size: missing(log[key]) ? 15 : Math.min(Math.max(log[key].length, key === "step" ? 3 : 8), 22), label: `${key} of log ${number + 1}` }),
      key === "drive_speed" && missing(log[key]) && of[log.path]?.hint ? button(`${of[log.path].hint} by its ${of[log.path].hinted_by}`, () => change(["logs", String(number + 1), key], of[log.path].hint)) : null,
      key === "drive_speed" && of[log.path]?.slope ? element("small", { class: "under" }, `sticks rise by ${quantity(of[log.path].slope, "N/s", 3)}: stiffness times drive speed`) : null];
    const cuts = (log) => CUTS.filter(([key]) => log[key]).map(([key, name]) => `${name} ${log[key]}`).join("; ").replaceAll('"', "") || "none";
    return table(["file", ...LOG_COLUMNS.map(([, name]) => name), "cuts", ""], seen.logs.map((log, number) => [link(log.path || "unknown", "log", { path: log.path, number: String(number) }), ...LOG_COLUMNS.map(([key]) => element("span", {}, field(log, number, key))),
      element("span", {}, `${cuts(log)} `, link("edit", "log", { path: log.path, number: String(number) })), button("remove", () => change(["logs", String(number + 1)], null))]), { class: "cards" });
  }

  const refused = new Map(); // what was refused in a field: red until something else stands there
  function show(seen, fromText = false) {
    if (!fromText && text.value !== seen.text) text.value = seen.text;
    const active = form.contains(document.activeElement) ? document.activeElement : null, focus = active?.dataset?.place, typing = active?.value;
    error.textContent = seen.error;
    if (Boolean(seen.error) !== Boolean(session.missing)) session.look(); // the next step is another one
    state.dataset.saved = seen.saved ? "yes" : "no";
    refill(state, button("save", async () => { show(await post("save", { path })); say(""); }, { class: "main", disabled: seen.saved }),
      element("span", { class: "quiet" }, seen.saved ? "saved" : "changed; kept as a draft, saved when you fit"), seen.error ? "" : element("span", {}, "Complete: ", link("check the logs", "log"), ", ", link("simulate", "try"), " or ", link("fit", "fit"), "."));
    text.setAttribute("aria-invalid", String(Boolean(seen.error)));
    if (seen.form) {
      const { rig, rig_file: file, time_limit: limit } = seen.form;
      const files = [...new Set([...session.folder.rigs, ...(file ? [file] : [])])];
      refill(form, 
        element("h3", {}, "Rig"), files.length ? labelled("rig from", choice([["", "the values below"], ...files], file, (name) => change(["rig"], name || null), { "data-place": "rig" })) : null,
        file ? element("p", { class: "quiet" }, `Mass, stiffness and damping are those of ${file}; its tolerances are the priors of every fit.`) : rig.filter((field) => field.needed).map((field) => rigField(field, seen.form)), element("h3", {}, "Logs"), logs(seen.form),
        folded("optional", "More of the rig, and time", file ? null : rig.filter((field) => !field.needed).map((field) => rigField(field, seen.form)),
          element("div", { class: "field" }, element("label", {}, "time for a fit"), input(["fit", "time_limit"], limit, { placeholder: "60 s" }))),
        element("h3", {}, "Effects: what the model is made of"),
        seen.form.auto ? element("p", {}, "The fit chooses the effects (effects = \"auto\"). ", button("choose them here", () => change(["effects"], ["inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening"])))
          : [effects(seen.form, true), folded("effects", `${seen.form.effects.filter((one) => !one.on).length} more effects`, effects(seen.form, false))],
        folded("parameters", "Parameters: start values, bounds, fixed values", parameters(seen.form)));
    }
    for (const field of form.querySelectorAll("[data-place]")) {
      const { place } = field.dataset, here = Boolean(seen.place) && (place === seen.place || place.startsWith(`${seen.place}.`) || seen.place.startsWith(`${place}.`));
      if (here) refused.set(place, field.value); else if (!seen.error || refused.get(place) !== field.value) refused.delete(place);
      field.setAttribute("aria-invalid", String("open" in field.dataset || refused.has(place)));
      if (field.dataset.place === focus) { field.focus(); field.value = typing; }
    }
    host.dataset.shown = String(Number(host.dataset.shown ?? 0) + 1);
  }

  put(host, element("h2", {}, path), state, error,
    element("div", { class: "columns form" }, element("div", {}, form), element("div", { class: "beside" }, element("h3", {}, "The scene file"), text, command(`stickslip fit --scene ${path}`))));
  show(first);
  return undefined;
}
