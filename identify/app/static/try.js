// Simulate: sliders over the parameters, the simulated force over the measured one, and what the model does beneath.
import { button, choice, command, element, get, labelled, link, newestWins, plain, post, quantity, remember, say, shownIn, style, put } from "./base.js";
import { line, picture, span } from "./plots.js";

const STEPS = 400, REACH = 4; // a slider goes from a quarter to four times the value where no interval is known

/** How early or late simulated slips come, in words: the start is one noisy sample, so a little of it says nothing. */
const shift = (late) => late === null ? "" : `, ${quantity(Math.abs(late), "s", 2)} ${late < 0 ? "early" : "late"} in the median`;

export async function tryView(host, asked, session) {
  if (!session.scene) {
    put(host, element("p", {}, "There is no scene yet: choose logs in ", link("the table", "logs"), " and make one from them."));
    return undefined;
  }
  const path = session.scene, seen = await get("scene", { path });
  if (seen.error) {
    put(host, element("p", { class: "error" }, `The scene is not complete: ${seen.error} `, link("open it", "scene")));
    return undefined;
  }
  const stem = path.split("/").pop().replace(/\.toml$/, "");
  const fits = session.folder.fits.filter((fit) => fit.status === "converged"), own = fits.find((fit) => fit.path === `stickslip-${seen.form.name || stem}`);
  const values = {}, sliders = new Map();
  let number = Number(asked.number ?? 0), first = Number(asked.first ?? 0), count = Number(asked.count ?? 8);
  const force = element("div", { id: "force" }), phase = element("div", {}), speed = element("div", {}), summary = element("p", { class: "hover", id: "summary" });

  const draw = (made) => {
    const { measured, simulated } = made, blue = () => style("--force"), red = () => style("--model");
    const reach = [0, Math.max(measured.time[measured.time.length - 1], 1e-9)];
    picture(force, { height: 300, x: { label: `time after the arrest at ${plain(made.begin, 5)} s (s)`, range: reach }, y: { label: "friction force (N)", range: span([...measured.force, ...simulated.force]) },
      draw: (context, x, y) => { line(context, measured.time, measured.force, x, y, blue(), { width: 1.5 }); line(context, simulated.time, simulated.force, x, y, red(), { width: 1.5, dash: [7, 4] }); } });
    const moving = simulated.speed.map((v) => v * 1e3);
    picture(phase, { x: { label: "friction force (N)", range: span(simulated.force) }, y: { label: "sliding speed (mm/s)", range: span(moving) }, draw: (context, x, y) => line(context, simulated.force, moving, x, y, red()) });
    picture(speed, { x: { label: "sliding speed (mm/s)", range: span(moving) }, y: { label: "friction coefficient while sliding", range: span(simulated.coefficient) }, draw: (context, x, y) => line(context, moving, simulated.coefficient, x, y, red()) });
    summary.textContent = `off by ${quantity(made.rms, "N", 3)} (rms; noise ${quantity(made.noise, "N", 2)}); ${made.slips.simulated} slips simulated, ${made.slips.measured} measured${shift(made.late)}. Measured: solid; simulated: dashed.${made.uneven ? " The cycles of this log differ among themselves: judge by slope, mean drop and mean period." : ""}`;
    host.dataset.tried = String(Number(host.dataset.tried ?? 0) + 1);
  };
  const simulate = newestWins(async () => draw(await post("try", { scene: path, number, first, count, values })));
  const note = () => remember({ number, first, count, ...Object.fromEntries(Object.entries(values).map(([name, value]) => [`p.${name}`, value.toPrecision(8)])) });

  const again = () => { say(""); note(); return simulate(); }; // the words of what was done before go at once, not when this is drawn

  function slider(p) {
    const held = own?.parameters[p.name], tight = held?.interval && held.interval[0] !== null && held.interval[1] !== null;
    const middle = held?.value ?? p.value, log = p.logarithmic && middle > 0;
    let low, high;
    const bounds = (from, to) => { [low, high] = [Math.max(from, p.lowest), Math.min(to, p.highest)]; };
    const around = (at) => log ? bounds(at / REACH, at * REACH) : bounds(at - Math.max(Math.abs(at), 0.05), at + Math.max(Math.abs(at), 0.05));
    around(middle);
    values[p.name] = Number(asked[`p.${p.name}`] ?? middle);
    const place = (value) => STEPS * (log ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low));
    const value = (at) => log ? low * (high / low) ** (at / STEPS) : low + (high - low) * at / STEPS;
    const [unit, size] = shownIn(middle || 1, p.unit), shown = () => { box.value = String(Number((values[p.name] / size).toPrecision(4))); };
    const moved = (to) => { set(to); again(); };
    const range = element("input", { type: "range", min: 0, max: STEPS, step: 1, value: String(place(values[p.name])), "aria-label": p.name, "data-parameter": p.name,
      oninput: () => { values[p.name] = value(Number(range.value)); shown(); again(); } });
    const box = element("input", { type: "number", step: "any", "aria-label": `value of ${p.name}`, "data-box": p.name, onchange: () => {
      const to = Number(box.value) * size;
      if (box.value !== "" && to >= p.lowest && to <= p.highest) moved(to); else { shown(); say(`${p.name} goes from ${quantity(p.lowest, p.unit)} to ${quantity(p.highest, p.unit)}`); }
    } });
    const set = (to) => { if (to < low || to > high) around(to); values[p.name] = to; range.value = String(place(to)); shown(); };
    shown();
    const narrow = (on) => { if (on && tight) bounds(...held.interval); else around(middle); set(Math.min(Math.max(values[p.name], low), high)); };
    sliders.set(p.name, { set, narrow });
    return element("div", { class: "slider" }, element("label", { title: p.meaning }, p.symbol || p.name), range, element("span", {}, box, ` ${unit}`), button("reset", () => moved(middle), { "aria-label": `reset ${p.name}` }));
  }

  const shown = seen.form.parameters.filter((p) => p.kind === "friction");
  const logs = seen.form.logs.map((log, i) => [String(i), `${i + 1}: ${log.path}`]);
  const amount = (label, value, change, low = 0) => labelled(label, element("input", { type: "number", min: low, max: 999, value: String(value), size: 4, "aria-label": label, onchange: (event) => { change(Number(event.target.value)); again(); } }));
  const box = element("input", { type: "checkbox", onchange: () => { sliders.forEach((one) => one.narrow(box.checked)); again(); } });
  put(host, element("h2", {}, `Simulate: ${path}`),
    element("div", { class: "bar" }, labelled("log", choice(logs, String(number), (to) => { number = Number(to); again(); })), amount("from cycle", first + 1, (to) => { first = to - 1; }, 1), amount("cycles", count, (to) => { count = to; }, 1),
      button("start from the data", async () => {
        say("estimating from the mean cycle of each log …");
        const found = await post("start-values", { scene: path });
        for (const [name, value] of Object.entries(found.values)) sliders.get(name)?.set(value);
        say(`started from ${found.source}`);
        note();
        draw(await post("try", { scene: path, number, first, count, values }));
      }),
      own ? button("values of the fit", () => { for (const [name, entry] of Object.entries(own.parameters)) if (entry.value !== null) sliders.get(name)?.set(entry.value); return again(); }) : null,
      own ? element("label", {}, box, " over the 95 % intervals of the fit") : null,
      button("use as start values of the scene", async () => {
        const changes = shown.filter((p) => !p.fixed).map((p) => ({ keys: ["parameters", p.name, "start"], value: `${values[p.name].toPrecision(6)} ${p.unit}`.trim() }));
        await post("edit", { path, changes });
        say("these start values are in the draft of the scene");
      })),
    shown.map(slider), summary, force, element("div", { class: "columns" }, phase, speed), command(`stickslip fit --scene ${path} --preview`));
  await simulate();
  return undefined;
}
