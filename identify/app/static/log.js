// One log: force, load and speed over time; sticks and slips over them; cuts by dragging; the classical table alive.
import { address, button, choice, curves, element, get, guarded, here, labelled, link, newestWins, plain, post, put, quantity, refill, remember, say, shownTable, style } from "./base.js";
import { shade, TimeView } from "./plots.js";

const MODES = { move: "move and zoom", window: "use only …", exclude: "leave out …", tare: "set zero …" };
const HINTS = {
  move: "drag to move, turn the wheel to zoom, double-click for all; keys: ← → + − 0",
  window: "drag over the part that is to be used",
  exclude: "drag over what is to be left out; click a slip to take it out with its stick, click a left-out part to put it back",
  tare: "drag over a part where nothing rubs: its mean force is taken off",
};
/** Where the logs of the scene stand in it, and what is wrong with it. */
async function listed(session) {
  if (!session.scene) return { wrong: "", places: [] };
  const scene = await get("scene", { path: session.scene });
  return { wrong: scene.error, places: (scene.form?.logs ?? []).map((log, number) => ({ number, path: log.path, step: log.step })) };
}

export async function logView(host, asked, session) {
  const { wrong, places } = await listed(session), logs = session.folder.logs.map((log) => log.path);
  const ofScene = asked.number === undefined ? undefined : places[Number(asked.number)]?.path;
  const path = asked.path ?? ofScene ?? (logs.includes(session.log) ? session.log : places[0]?.path ?? logs[0]);
  if (!path) { put(host, element("p", {}, "There is no log in this folder yet: add one in ", link("the table of logs", "logs"), ".")); return undefined; }
  const inScene = wrong ? [] : places.filter((place) => place.path === path || session.scene.includes("/"));
  const which = !wrong && asked.number !== undefined && session.scene ? { scene: session.scene, number: Number(asked.number) }
    : inScene.length && asked.alone === undefined ? { scene: session.scene, number: inScene[0].number } : { path };
  session.log = path;
  const tools = element("div", { class: "bar" }), hint = element("small", {}), hover = element("p", { class: "hover quiet", "aria-live": "off" }, "Point at a slip to read its numbers."), plots = element("div", { id: "plots" });
  const beside = element("div", { class: "columns" }), title = element("h2", {});
  put(host, element("div", { class: "bar" }, labelled("log", choice(logs.includes(path) ? logs : [path, ...logs], path, (to) => { location.hash = address("log", { path: to }); }))),
    title, wrong ? element("p", { class: "warning" }, `${session.scene} is not complete: ${wrong}. `, link("complete it", "scene"), " to place cuts.") : null, tools, hint, plots, hover, beside);
  let mode = "move", view = null, cycles = [], cut = null, over = false;

  const about = await (async () => {
    for (;;) {
      const found = await get("log", which);
      if (found.error) throw new Error(found.error);
      if (found.ready) return found;
      title.textContent = `${found.path}: reading, ${Math.round(100 * found.share)} %`;
      await new Promise((done) => setTimeout(done, 150));
      if (over || !host.isConnected) return null;
    }
  })();
  if (!about) return undefined;
  title.textContent = `${about.path}${which.scene ? ` as log ${which.number + 1} of ${which.scene}` : ""}: ${about.rows.toLocaleString("en")} samples in ${quantity(about.duration, "s")}`;
  cut = about.cut;

  const at = (time) => cycles.find((c, i) => time <= c.arrest && time >= (i ? cycles[i - 1].arrest : -Infinity));
  const described = (time) => {
    const cycle = at(time), number = cycles.indexOf(cycle);
    if (!cycle) return `${quantity(time, "s", 6)}: no cycle here`;
    const before = number ? cycles[number - 1].arrest : null, stick = before === null ? "" : `, stick ${quantity(cycle.onset - before, "s", 3)}`;
    return `${quantity(time, "s", 6)}: cycle ${number + 1} of ${cycles.length}: onset ${quantity(cycle.onset, "s", 6)} at ${quantity(cycle.onset_force, "N", 3)}${stick}, `
      + `slip ${quantity(cycle.arrest - cycle.onset, "s", 3)}, drop ${quantity(cycle.drop ?? cycle.onset_force - cycle.arrest_force, "N", 3)}${cut && number < cut.skip_cycles ? ", skipped" : ""}`;
  };
  const drawOver = (plot, number) => {
    if (cut?.window) { shade(plot, 0, cut.window[0], style("--faint"), { hatch: 9, label: "not used" }); shade(plot, cut.window[1], about.duration, style("--faint"), { hatch: 9, label: "not used" }); }
    for (const [begin, end] of cut?.exclude ?? []) shade(plot, begin, end, style("--bad"), { hatch: 6, label: "left out" });
    if (cut?.tare) shade(plot, ...cut.tare, style("--speed"), { label: "zero" });
    if (number) return;
    const { top, height } = plot.bbox, context = plot.ctx, shown = cycles.filter((c) => c.arrest >= view.begin && c.onset <= view.end);
    if (shown.length > 300) return;
    for (const cycle of shown) {
      shade(plot, cycle.onset, cycle.arrest, style("--model"));
      const x = plot.valToPos(cycle.onset, "x", true);
      context.save(); context.strokeStyle = style("--model"); context.setLineDash([4, 4]); context.globalAlpha = shown.length > 20 ? 0.45 : 1; context.beginPath(); context.moveTo(x, top); context.lineTo(x, top + height); context.stroke(); context.restore();
    }
  };

  const panels = [
    { label: "friction", unit: "N", height: Math.min(330, Math.max(210, innerHeight * 0.38)), series: [{ row: 1, label: "friction force", color: "--force" }] },
    { label: "load", unit: "N", height: 120, series: [{ row: 2, label: "normal force", color: "--load" }] },
    ...(about.has_speed ? [{ label: "speed", unit: "mm/s", height: 135, series: [{ row: 3, label: "drive speed", color: "--speed" }] }] : []),
  ];
  const ask = async (begin, end) => {
    const rows = await curves("curves", { ...which, begin, end });
    if (rows[3]) for (let i = 0; i < rows[3].length; i++) rows[3][i] *= 1e3;
    return rows;
  };
  const picks = guarded(async (begin, end, name, click) => {
    const text = (from, to) => [`${plain(from, 7)} s`, `${plain(to, 7)} s`].map((t) => t.replace("−", "-"));
    if (name === "exclude") {
      let spans = (cut.exclude ?? []).map(([a, b]) => text(a, b));
      const hit = (cut.exclude ?? []).findIndex(([a, b]) => begin >= a && begin <= b), cycle = at(begin);
      if (click && hit >= 0) spans = spans.filter((_, i) => i !== hit);
      else if (click && cycle) {
        const number = cycles.indexOf(cycle), previous = number ? cycles[number - 1].arrest : cycle.onset - (cycle.arrest - cycle.onset);
        spans.push(text(number ? previous : Math.max(previous, 0), cycle.arrest));
      } else if (!click) spans.push(text(begin, end));
      else throw new Error("there is no slip here; drag over what is to be left out");
      await change([["exclude", spans]]);
    } else if (!click) await change([[name, text(begin, end)]]);
  });
  const past = []; // texts of the scene before each change
  const change = async (fields, numbers = [which.number]) => {
    past.push((await get("scene", { path: which.scene })).text);
    const changes = numbers.flatMap((number) => fields.map(([key, value]) => ({ keys: ["logs", String(number + 1), key], value })));
    const scene = await post("edit", { path: which.scene, changes });
    say(scene.error);
    await seen();
  };

  const skip = element("input", { type: "number", min: 0, max: 999, size: 3, "aria-label": "cycles to skip", onchange: guarded(() => change([["skip_cycles", skip.value === "0" ? "" : skip.value]])) });
  const seen = newestWins(async () => {
    if (which.scene) {
      const [found, opened] = await Promise.all([get("cut", which), get("log", which)]);
      cut = opened.cut;
      skip.value = cut.skip_cycles;
      cycles = found.cycles;
      refill(beside, element("div", {}, element("p", {}, element("strong", {}, `${cycles.length} cycles, ${found.regime || "regime unknown"}. `), `${found.evidence.join("; ")}. Noise ${quantity(found.noise, "N", 3)}.`,
        found.stick_slope ? ` Stick slope ${quantity(found.stick_slope, "N/s")}, over the drive speed ${quantity(found.stiffness_of_sticks, "N/m")}.` : "",
        found.sign < 0 ? " The sign of the force is reversed." : "", found.changes.map((text) => ` ${text}.`)), sceneLines()), shownTable(found.table, { class: "classical" }));
    } else if (about.inspection && !about.inspection.error) {
      const log = about.inspection;
      cycles = log.steps.flatMap((step) => step.onsets_s.map((onset, i) => ({ onset, arrest: step.arrests_s[i] })));
      refill(beside, element("div", {}, element("p", {}, element("strong", {}, `${cycles.length} slips, ${(log.regime ?? "regime unknown").replaceAll("_", " ")}. `), `${log.format}, ${quantity(log.sampling.rate, "Hz")}; ${log.evidence.join("; ")}`),
        element("ul", {}, log.quality.findings.map((f) => element("li", {}, element("strong", { class: f.severity }, f.severity), `: ${f.message}`))),
        wrong || places.some((place) => place.path === path) ? null : session.scene ? button(`add this log to ${session.scene}`, async () => { await post("edit", { path: session.scene, logs: [which.path] }); location.hash = address("scene"); }) : element("p", {}, "Cuts are kept in a scene: choose logs in ", link("the table", "logs"), " and make one.")), shownTable(about.classical, { class: "classical" }));
    }
    else if (!about.inspection) {
      refill(beside, element("p", { class: "quiet" }, "detecting its slips …"));
      setTimeout(guarded(async () => { if (over) return; Object.assign(about, await get("log", which)); await seen(); }), 1000);
      return;
    }
    view?.redraw();
    host.dataset.seen = "yes";
  });
  const sceneLines = () => {
    const lines = ["[[logs]]", `path = ${JSON.stringify(about.path)}`];
    for (const key of ["window", "tare"]) if (cut?.[key]) lines.push(`${key} = [${cut[key].map((t) => `"${plain(t, 7)} s"`).join(", ")}]`);
    if (cut?.exclude.length) lines.push(`exclude = [${cut.exclude.map((s) => `[${s.map((t) => `"${plain(t, 7)} s"`).join(", ")}]`).join(", ")}]`);
    if (cut?.skip_cycles) lines.push(`skip_cycles = ${cut.skip_cycles}`);
    return element("details", { open: true }, element("summary", {}, "cuts in the scene file"), element("pre", {}, lines.join("\n")), link("open the scene", "scene", { scene: which.scene }), " ",
      button("save the scene", async () => { await post("save", { path: which.scene }); say(`${which.scene} is saved`); }));
  };

  if (which.scene) {
    const buttons = Object.entries(MODES).map(([name, words]) => button(words, () => setMode(name), { "aria-pressed": name === mode, "data-mode": name }));
    const setMode = (name) => { mode = name; hint.textContent = HINTS[name]; buttons.forEach((one) => one.setAttribute("aria-pressed", one.dataset.mode === name)); };
    tools.append(...buttons, labelled("skip cycles", skip),
      button("undo", async () => {
        if (!past.length) { say("there is no cut to undo"); return; }
        await post("edit", { path: which.scene, text: past.pop() });
        say("");
        await seen();
      }),
      button("remove all cuts", () => change([["window", null], ["exclude", null], ["tare", null], ["skip_cycles", null]])),
      button("the same cut for all logs", async () => {
        const text = (pair) => pair.map((t) => `${plain(t, 7).replace("−", "-")} s`);
        await change([["window", cut.window && text(cut.window)], ["exclude", cut.exclude.map(text)], ["tare", cut.tare && text(cut.tare)], ["skip_cycles", cut.skip_cycles || ""]], places.map((place) => place.number));
        say("all logs of the scene now have this cut");
      }));
    if (inScene.length > 1) tools.append(choice(inScene.map((place) => [String(place.number), `log ${place.number + 1}${place.step ? `, step ${place.step}` : ""}`]), String(which.number), (number) => { location.hash = address("log", { path: about.path, number }); }));
    setMode("move");
  } else hint.textContent = HINTS.move;

  const shown = here().asked;
  const window = shown.begin !== undefined && shown.end !== undefined ? [Number(shown.begin), Number(shown.end)] : undefined;
  view = new TimeView(plots, { panels, begin: 0, end: about.duration, shown: window, ask, drawOver, hover: (time) => { hover.textContent = described(time); }, mode: () => mode, picks,
    moved: (begin, end) => remember({ begin: begin.toPrecision(7), end: end.toPrecision(7) }) });
  host.timeView = view;
  seen();
  return () => { over = true; view.close(); };
}
