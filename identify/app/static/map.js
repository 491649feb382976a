// Map: stick-slip or steady sliding over two quantities, with an operating point to drag, what was tested, and advice.
import { address, button, choice, element, fileAddress, get, labelled, link, newestWins, plain, post, put, quantity, refill, remember, say, style, table } from "./base.js";
import { start, whenEnded } from "./jobs.js";
import { line, mark, picture } from "./plots.js";

const OUTCOMES = { // word, colour, pattern of dots or lines: readable without colour
  "always sticks": ["stick-slip", "--sticks", "lines"], bistable: ["both: depends on the start", "--either", "dots"],
  "never sticks": ["steady sliding", "--slides", ""], "sticks irregularly": ["irregular stick-slip", "--irregular", "cross"],
}; // words and colours of the report
const SWATCH = 14; // pixels
const REACH = 3; // factor by which a map reaches beyond its point

function cell(context, x, y, width, height, outcome) {
  const [, color, pattern] = OUTCOMES[outcome] ?? ["", "--faint", ""];
  context.fillStyle = style(color);
  context.fillRect(x, y, width + 0.6, height + 0.6);
  context.fillStyle = context.strokeStyle = style("--faint");
  context.globalAlpha = 0.3;
  context.lineWidth = 0.8;
  if (pattern === "lines") { context.beginPath(); context.moveTo(x, y + height); context.lineTo(x + width, y); context.stroke(); }
  if (pattern === "dots") context.fillRect(x + width / 2 - 1, y + height / 2 - 1, 2, 2);
  if (pattern === "cross") mark(context, x + width / 2, y + height / 2, style(color), "cross", 3);
  context.globalAlpha = 1;
}

/** How an outcome is drawn. */
function swatch(outcome) {
  const canvas = element("canvas", { width: SWATCH, height: SWATCH, class: "swatch" });
  cell(canvas.getContext("2d"), 0, 0, SWATCH, SWATCH, outcome);
  return canvas;
}

const edges = (values, log) => {
  const f = log ? Math.log : (v) => v, g = log ? Math.exp : (v) => v, at = values.map(f), out = [];
  for (let i = 0; i <= at.length; i++) out.push(g(i === 0 ? 1.5 * at[0] - 0.5 * at[1] : i === at.length ? 1.5 * at[i - 1] - 0.5 * at[i - 2] : 0.5 * (at[i - 1] + at[i])));
  return out;
};

export async function mapView(host, asked, session) {
  const fits = session.folder.fits.filter((fit) => fit.status === "converged").map((fit) => fit.path);
  let source = asked.fit && fits.includes(asked.fit) ? asked.fit : asked.fit === "" || !fits.length ? "" : fits[0];
  let jobs = session.folder.jobs.filter((job) => job.kind === "stability" && job.state === "done"), made = null, view = null, advice = [], stop = () => {}, here = {};
  if (!source && !session.scene) { put(host, element("h2", {}, "Map"), element("p", {}, "A map needs a fit or a scene; there is none yet. Choose logs in ", link("the table", "logs"), " and make a scene of them.")); return undefined; }
  const base = () => source ? { fit: source } : { scene: session.scene };
  const logs = async () => source ? (await get("fit", { path: source })).logs.map((log) => log.path) : ((await get("scene", { path: session.scene })).form?.logs ?? []).map((log) => log.path);
  const controls = element("div", { class: "bar" }), place = element("div", { id: "map" }), answer = element("div", { id: "answer", "aria-live": "polite" }), legend = element("p", { class: "quiet" });
  const number = Number(asked.number ?? 0), where = await logs();
  const point = newestWins(async () => {
    const found = await post("point", { ...base(), number, changes: here }), numbers = Object.entries(found.numbers).filter(([, entry]) => entry.value !== null);
    refill(answer, element("h3", {}, (OUTCOMES[found.outcome] ?? [found.outcome])[0]), element("p", {}, found.text.split("\n").map((part) => [part, element("br")])), found.beyond ? element("p", { class: "warning" }, found.beyond) : "",
      numbers.length ? table(["", { number: "here" }], numbers.map(([name, entry]) => [name.replaceAll("_", " "), { number: quantity(entry.value, entry.unit, 3) }])) : null);
    host.dataset.answered = String(Number(host.dataset.answered ?? 0) + 1);
    return found;
  });
  const sources = labelled("of", choice([...fits.map((fit) => [fit, `the fit ${fit}`]), ...(session.scene ? [["", `the scene ${session.scene}`]] : [])], source, (to) => { location.hash = address("map", { fit: to }); }));
  const before = source || !session.missing ? await post("point", { ...base(), number, changes: {} }) : { missing: session.missing };
  if (before.missing) {
    put(host, element("h2", {}, "Map"), element("div", { class: "bar" }, sources, source ? link("see this fit", "fit", { path: source }) : link("open the scene", "scene")), element("p", {}, `There is no map of this: ${before.missing}.`));
    return undefined;
  }
  const axes = before.axes, axis = (name) => axes.find((one) => one.name === name);
  let [across, up] = [axis(asked.x) ? asked.x : "drive_speed", axis(asked.y) ? asked.y : "stiffness"];
  const name = `${(source || session.scene).split("/").pop().replace(/\.toml$/, "")}.map`;
  const speed = () => `drive_speed=${Number((axis("drive_speed").value * 1e3).toPrecision(10))} mm/s`;
  const range = (quantityName, low, high) => low.value.trim() && high.value.trim() ? [`${quantityName}=${low.value.trim()}:${high.value.trim()}`] : [];
  const limits = ["across from", "across to", "up from", "up to"].map((label) => element("input", { size: 10, "aria-label": label }));
  // drive speeds reach beyond where stick-slip ends: a map without its end is of little use
  const ends = (name) => name === "drive_speed" ? before.ends.filter((end) => end !== null) : [];
  const inUnits = () => limits.forEach((limit, i) => {
    const one = axis(i < 2 ? across : up), far = ends(one.name);
    limit.placeholder = `${i % 2 ? "to" : "from"}${one.unit ? ` … ${one.unit}` : ""}`;
    limit.value = !far.length ? "" : quantity(i % 2 ? Math.max(3 * Math.max(...far), REACH * one.value) : Math.min(Math.min(...far) / 3, one.value / REACH), one.unit, 2);
  });
  inUnits();
  const points = element("input", { value: asked.points ?? "40", size: 3, "aria-label": "points along each quantity" });

  const draw = () => {
    if (!made) return;
    const { x, y } = made.map, logs = [axis(x.name)?.logarithmic ?? true, axis(y.name)?.logarithmic ?? true];
    const [xs, ys] = [edges(x.values, logs[0]), edges(y.values, logs[1])];
    here = { [x.name]: here[x.name] ?? axis(x.name)?.value, [y.name]: here[y.name] ?? axis(y.name)?.value };
    const sized = (one) => { const [unit, size] = one.unit === "m/s" ? ["mm/s", 1e-3] : [one.unit, 1]; return { label: `${axis(one.name)?.label ?? one.name}${unit ? ` (${unit})` : ""}`, size }; };
    view = picture(place, { height: Math.min(520, Math.max(320, innerHeight * 0.6)), x: { ...sized(x), range: [xs[0], xs[xs.length - 1]], log: logs[0] }, y: { ...sized(y), range: [ys[0], ys[ys.length - 1]], log: logs[1] },
      draw: (context, tox, toy) => {
        made.map.outcomes.forEach((row, j) => row.forEach((outcome, i) => cell(context, tox(xs[i]), toy(ys[j + 1]), tox(xs[i + 1]) - tox(xs[i]), toy(ys[j]) - toy(ys[j + 1]), outcome)));
        for (const [lines, dash, color] of [[made.map.end_of_stick_slip, [], "--model"], [made.map.loss_of_stability, [6, 4], "--accent"]]) for (const points of lines) line(context, points.map((p) => p[0]), points.map((p) => p[1]), tox, toy, style(color), { width: 2, dash });
        tested(context, tox, toy, x, y);
        arrows(context, tox, toy, x, y);
        mark(context, tox(here[x.name]), toy(here[y.name]), style("--ink"), "circle", 7);
        mark(context, tox(here[x.name]), toy(here[y.name]), style("--paper"), "circle", 3);
      } });
    showFiles();
    showLegend();
  };
  const showLegend = () => {
    const shares = Object.entries(made.map.shares).map(([outcome, share]) => [swatch(outcome), `${(OUTCOMES[outcome] ?? [outcome])[0]} ${share < 0.005 ? "under 1" : Math.round(100 * share)} %; `]);
    refill(legend, shares, `solid line: end of stick-slip; dashed: sliding loses its stability; hatched: tested by the logs. Drag the point, or move it with the arrow keys.`);
    host.dataset.mapped = "yes";
  };
  const again = () => { if (made) showLegend(); }; // its colours follow day and night
  document.addEventListener("redraw", again);
  function tested(context, tox, toy, x, y) {
    const spans = before.tested, part = (q, to, whole) => { const s = spans[q.name]; return s ? [to(s[0]), to(s[1])] : whole; };
    if (!spans[x.name] && !spans[y.name]) return;
    const [a, b] = part(x, tox, [0, 4000]), [d, c] = part(y, toy, [4000, 0]);
    context.save();
    context.beginPath(); context.rect(a - 2, c - 2, b - a + 4, d - c + 4); context.clip();
    context.strokeStyle = style("--ink"); context.globalAlpha = 0.6; context.lineWidth = 1;
    for (let at = a - (d - c); at < b; at += 9) { context.beginPath(); context.moveTo(at, c); context.lineTo(at + (d - c), d); context.stroke(); }
    context.restore();
    context.strokeStyle = style("--ink"); context.lineWidth = 1; context.strokeRect(a - 2, c - 2, b - a + 4, d - c + 4);
  }
  function arrows(context, tox, toy, x, y) {
    const from = [tox(axis(x.name).value), toy(axis(y.name).value)];
    for (const change of advice) {
      if (change.advised.value === null) continue;
      const to = change.quantity === x.name ? [tox(change.advised.value), from[1]] : change.quantity === y.name ? [from[0], toy(change.advised.value)] : null;
      if (!to) continue;
      const turn = Math.atan2(to[1] - from[1], to[0] - from[0]);
      context.save();
      context.strokeStyle = context.fillStyle = style("--good"); context.lineWidth = 3;
      context.beginPath(); context.moveTo(...from); context.lineTo(...to); context.stroke();
      context.translate(...to); context.rotate(turn);
      context.beginPath(); context.moveTo(0, 0); context.lineTo(-12, -6); context.lineTo(-12, 6); context.closePath(); context.fill();
      context.restore();
    }
  }
  function drag() {
    let held = false;
    place.tabIndex = 0;
    const move = (px, py) => {
      if (!made) return;
      const { x, y } = made.map, clamp = (value, values) => Math.min(Math.max(value, values[0]), values[values.length - 1]);
      here = { [x.name]: clamp(view.x(px), x.values), [y.name]: clamp(view.y(py), y.values) };
      remember({ [`at.${x.name}`]: here[x.name].toPrecision(6), [`at.${y.name}`]: here[y.name].toPrecision(6) });
      point();
    };
    place.addEventListener("pointerdown", (event) => { held = true; event.target.setPointerCapture(event.pointerId); move(event.offsetX, event.offsetY); });
    place.addEventListener("pointermove", (event) => { if (held) move(event.offsetX, event.offsetY); });
    place.addEventListener("pointerup", () => { held = false; draw(); });
    place.addEventListener("keydown", (event) => {
      if (!made) return;
      const { x, y } = made.map, along = { ArrowLeft: [x, -1], ArrowRight: [x, 1], ArrowDown: [y, -1], ArrowUp: [y, 1] }[event.key];
      if (!along) return;
      event.preventDefault();
      const [q, way] = along, low = q.values[0], high = q.values[q.values.length - 1];
      const next = axis(q.name)?.logarithmic ?? true ? here[q.name] * (high / low) ** (way / 50) : here[q.name] + way * (high - low) / 50;
      here = { ...here, [q.name]: Math.min(Math.max(next, low), high) };
      point(); draw();
    });
  }
  drag();
  const load = async (id) => {
    const found = await get("job", { id });
    if (!found.map?.y) throw new Error("this job is no map over two quantities");
    made = found;
    [across, up] = [found.map.x.name, found.map.y.name];
    here = Object.fromEntries([across, up].map((q) => [q, asked[`at.${q}`] !== undefined ? Number(asked[`at.${q}`]) : axis(q)?.value]));
    remember({ job: id, x: across, y: up });
    draw();
    await point();
  };
  const files = element("span", {}), showFiles = () => refill(files, ["svg", "csv"].map((kind) => [element("a", { href: fileAddress(`${name}.${kind}`, true) }, kind === "svg" ? "picture" : "data"), " "]));
  const about = () => source ? { result: `${source}/result.json` } : { scene: session.scene };
  controls.append(
    sources, labelled("at the point of", choice(where.map((path, i) => [String(i), path]), String(number), (to) => { location.hash = address("map", { fit: source, number: to }); }, { id: "where" })),
    labelled("across", choice(axes.map((one) => [one.name, one.label]), across, (to) => { across = to; inUnits(); }, { id: "across" })), limits[0], limits[1],
    labelled("up", choice(axes.map((one) => [one.name, one.label]), up, (to) => { up = to; inUnits(); }, { id: "up" })), limits[2], limits[3], labelled("points", points),
    button("make the map", async () => {
      if (session.scene && !source) await post("save", { path: session.scene });
      const job = await start(session, { command: "stability", ...about(), map: [across, up], range: [...range(across, limits[0], limits[1]), ...range(up, limits[2], limits[3])], points: points.value,
        at: [speed()], plot: `${name}.svg`, data: `${name}.csv` });
      stop();
      stop = whenEnded(job.id, session, (ended) => { if (ended.state === "done") load(ended.id).catch((error) => say(error.message)); else say(ended.message); });
    }, { class: "main" }),
    button("how to make it steady", async () => {
      const job = await start(session, { command: "stability", ...about(), at: [speed()], advice: true });
      whenEnded(job.id, session, async (ended) => {
        if (ended.state !== "done") { say(ended.message); return; }
        const found = (await get("job", { id: ended.id })).points[0].advice;
        advice = found.changes;
        draw();
        say(advice.filter((c) => c.advised.value !== null).map((c) => `${c.label} at ${c.at} ${quantity(c.advised.value, c.advised.unit, 3)}${c.extrapolated ? " (outside the tested range)" : ""}`).join("; or ") || "it is steady, or nothing reaches that");
      });
    }), files);
  put(host, element("h2", {}, "Map"), controls, place, legend, answer);
  const known = asked.job ? jobs.find((job) => job.id === asked.job) : jobs.find((job) => job.out === `${name}.csv`);
  if (known) await load(known.id).catch((error) => say(error.message)); else { here = {}; await point(); }
  return () => { document.removeEventListener("redraw", again); stop(); };
}
