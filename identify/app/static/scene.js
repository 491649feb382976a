// The scene: a form with units as typed, effects as switches, and the text beside it; what one side says the other shows.
import { button, command, element, get, link, newestWins, plain, post, put, quantity, refill, say, settled } from "./base.js";

const LOG_COLUMNS = [["path", "file"], ["drive_speed", "drive speed"], ["step", "step"], ["window", "window"], ["exclude", "left out"], ["skip_cycles", "skip"], ["tare", "zero"], ["labels", "labels"]];

export async function sceneView(host, asked, session) {
  if (!session.scene) {
    put(host, element("p", {}, "There is no scene yet: choose logs in ", link("the table", "logs"), " and make one from them."));
    return undefined;
  }
  const path = session.scene, first = await get("scene", { path }), form = element("div", {}), state = element("div", { class: "bar" }), error = element("p", { class: "error", role: "alert" });
  const text = element("textarea", { "aria-label": "the scene as TOML", spellcheck: "false", oninput: () => { state.dataset.saved = "no"; typed(); } });
  const send = newestWins(async (asked, fromText) => show(await post("edit", { path, ...asked }), fromText));
  const typed = settled(() => send({ text: text.value }, true));
  const change = (keys, value) => send({ changes: [{ keys, value }] });
  const input = (keys, value, attributes = {}) => {
    const place = keys.join(".");
    const made = element("input", { value, "data-place": place, "aria-label": attributes.label ?? place, spellcheck: "false", onchange: () => change(keys, made.value), ...attributes });
    return made;
  };

  let costs = {};
  const stem = path.split("/").pop().replace(/\.toml$/, ""), last = session.folder.fits.find((fit) => fit.path.startsWith("stickslip-") && [stem, first.form?.name].includes(fit.path.slice(10)));
  const reasons = Object.fromEntries(((last && await get("fit", { path: last.path }).catch(() => null))?.effects ?? []).map((reason) => [reason.effect, reason.sentence]));
  function effects(seen) {
    return seen.effects.map((effect) => {
      const box = element("input", { type: "checkbox", checked: effect.on, onchange: () => {
        let on = seen.effects.filter((one) => one.on && one.name !== effect.name).map((one) => one.name);
        if (box.checked) on = [...on.filter((name) => !effect.role || seen.effects.find((one) => one.name === name).role !== effect.role), ...effect.needs.filter((name) => !on.includes(name)), effect.name];
        change(["effects"], on);
      } });
      const said = `costs ${effect.states} state${effect.states === 1 ? "" : "s"}, ${effect.searched} searched parameter${effect.searched === 1 ? "" : "s"}`;
      const paid = effect.name in costs ? `, ${plain(costs[effect.name], 2)} ms of a simulated cycle` : "";
      return element("div", { class: "effect", "data-effect": effect.name }, element("label", {}, box, " ", element("strong", {}, effect.name.replaceAll("_", " ")), ": ", effect.says),
        element("small", {}, said + paid, effect.parameters.length ? ` (${effect.parameters.join(", ")})` : "", effect.role ? `; one ${effect.role} at most` : "", effect.needs.length ? `; needs ${effect.needs.join(", ")}` : ""),
        effect.matters ? element("small", {}, `Here: ${effect.matters}.`) : null, effect.on && reasons[effect.name] ? element("small", {}, `The last fit: ${reasons[effect.name]}.`) : null);
    });
  }

  function parameters(seen) {
    return element("div", { class: "wide" }, element("table", {}, element("thead", {}, element("tr", {}, ["parameter", "start", "lower", "upper", "held at"].map((name) => element("th", {}, name)))),
      element("tbody", {}, seen.parameters.map((p) => element("tr", {},
        element("td", { class: "meaning" }, element("label", { title: p.meaning }, `${p.symbol} ${p.name}`), element("br"), element("small", {}, p.meaning)),
        ["start", "lower", "upper", "fixed"].map((word) => element("td", {}, p.kind === "given" && (word === "lower" || word === "upper") ? "" : input(["parameters", p.name, word], p[word],
          { size: 9, label: `${word} of ${p.name}`, placeholder: word === "start" ? quantity(p.value, p.unit, 3) : word === "fixed" && p.kind === "given" ? quantity(p.value, p.unit, 3) : "" }))))))));
  }

  function logs(seen) {
    return element("div", { class: "wide" }, element("table", {}, element("thead", {}, element("tr", {}, LOG_COLUMNS.map(([, name]) => element("th", {}, name)))),
      element("tbody", {}, seen.logs.map((log, number) => element("tr", {}, LOG_COLUMNS.map(([key]) => element("td", {},
        input(["logs", String(number + 1), key], log[key], { size: Math.min(Math.max(log[key].length, 6), 22), label: `${key} of log ${number + 1}` }))),
        element("td", {}, link("see", "log", { path: log.path, number: String(number) }), " ", button("drop", () => change(["logs", String(number + 1)], null))))))));
  }

  function show(seen, fromText = false) {
    if (!fromText && text.value !== seen.text) text.value = seen.text;
    const focus = document.activeElement?.dataset?.place;
    error.textContent = seen.error;
    state.dataset.saved = seen.saved ? "yes" : "no";
    refill(state, button("save", async () => { show(await post("save", { path })); say(""); }, { class: "main", disabled: seen.saved }),
      element("span", { class: "quiet" }, seen.saved ? "saved" : "draft, kept; the file is as it was"), seen.error ? "" : link("try values", "try"), seen.error ? "" : link("fit", "fit"));
    text.setAttribute("aria-invalid", String(Boolean(seen.error)));
    if (seen.form) {
      const { rig, time_limit: limit } = seen.form;
      refill(form, 
        element("h3", {}, "Rig"),
        rig.map((field) => element("div", { class: "field" }, element("label", {}, `${field.label} (${field.unit})`), input(["rig", field.key], field.value, { placeholder: `such as "… ${field.unit}"`, label: field.label }), element("small", {}, field.help))),
        element("div", { class: "field" }, element("label", {}, "time for a fit"), input(["fit", "time_limit"], limit, { placeholder: "60 s" })),
        element("h3", {}, "Effects ", button("measure what each costs", async () => { costs = await post("costs", { scene: path }); show(seen); })), seen.form.auto ? element("p", {}, "The scene leaves the choice to the fit (effects = \"auto\"). ", button("choose them here", () => change(["effects"], ["inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening"]))) : effects(seen.form),
        element("h3", {}, "Parameters"), parameters(seen.form), element("h3", {}, "Logs"), logs(seen.form));
    }
    for (const field of form.querySelectorAll("[data-place]")) {
      const wrong = Boolean(seen.place) && (field.dataset.place === seen.place || field.dataset.place.startsWith(`${seen.place}.`) || seen.place.startsWith(`${field.dataset.place}.`));
      field.setAttribute("aria-invalid", String(wrong));
      if (field.dataset.place === focus) field.focus();
    }
    host.dataset.shown = String(Number(host.dataset.shown ?? 0) + 1);
  }

  put(host, element("h2", {}, path), state, error,
    element("div", { class: "columns" }, element("div", {}, form), element("div", { class: "beside" }, element("h3", {}, "The same as text"), text, command(`stickslip fit --scene ${path}`))));
  show(first);
  return undefined;
}
