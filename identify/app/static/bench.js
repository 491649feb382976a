// At the bench: a rig from short records of it, or which logs to record next: tables, and what the command line prints.
import { button, command, duration, element, fileAddress, get, labelled, link, plain, post, put, quantity, refill, say, style, SYMBOLS, table } from "./base.js";
import { fitOf, start } from "./jobs.js";
import { line, picture } from "./plots.js";

const BEFORE = "before.toml"; // a scene of no log: what a first plan starts from
const EFFECTS = ["inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening", "varying_normal_force"];

const RIG = { mass: ["moving mass", "kg"], stiffness: ["stiffness", "N/m"], zeta: ["damping ratio", ""], skin_stiffness: ["stiffness on skin", "N/m"] };
/** A range with its unit once, where both ends have the same. */
const within = (ends, unit) => { const [low, high] = ends.map((end) => quantity(end, unit, 3)), tail = high.match(/\s\D+$/)?.[0] ?? ""; return `${tail && low.endsWith(tail) ? low.slice(0, -tail.length) : low} to ${high}`; };
const share = (half) => half === null || half === undefined ? "open" : `± ${plain(100 * half, 2)} %`;
/** What was measured of a rig; what the logs of a plan identify, now and then, and which logs those are. */
const TABLES = {
  rig: (found) => [table(["", { number: "value" }, "95 % interval"], Object.entries(RIG).filter(([name]) => found[name]).map(([name, [words, unit]]) => [words, { number: quantity(found[name].value, unit, 3) }, within(found[name].interval, unit)])), element("div", { id: "halves" })],
  plan: ({ logs, now, then, verdicts }) => [
    logs.length ? table([...["drive speed", "normal force", "stiffness", "duration", "rate", "slips"].map((number) => ({ number })), ""], logs.map((log) => [
      ...[quantity(log.drive, "m/s", 3), quantity(log.normal_force, "N", 3), quantity(log.stiffness, "N/m", 3), duration(log.duration), quantity(log.sampling_rate, "Hz", 3), plain(log.slips, 3)].map((number) => ({ number })), log.repeats ? "a repeat with another specimen" : ""]), { class: "cards" }) : null,
    table(["parameter", { number: "now" }, { number: "with these logs" }, "then"], Object.keys(then).map((name) => [SYMBOLS[name] ?? name, { number: share(now[name]) }, { number: share(then[name]) }, verdicts[name]]), { class: "cards" }), element("p", { class: "quiet" }, "Thin: now. Thick: with these logs."), element("div", { id: "halves" })],
};

/** The intervals of a rig in the form of a plan's. */
const certain = (found) => { const then = Object.fromEntries(Object.entries(RIG).filter(([name]) => found[name]).map(([name, [words]]) => [words, (found[name].interval[1] - found[name].interval[0]) / 2 / found[name].value])); return { now: then, then }; };
/** How far the intervals of a plan reach now, and with its logs. */
function halves(host, { now, then }) {
  const names = Object.keys(then), known = [...Object.values(now), ...Object.values(then)].filter((half) => Number.isFinite(half)), reach = Math.min(100, 120 * Math.max(0.01, ...known));
  picture(host, { height: 60 + 24 * names.length, x: { label: "95 % interval about the value (%)", range: [-1.4 * reach, 1.1 * reach] }, y: { label: "", range: [names.length - 0.5, -0.5], names: true },
    draw: (context, x, y) => names.forEach((name, i) => {
      for (const [of, width] of [[now, 1.5], [then, 5]]) { const half = Math.min(100 * (of[name] ?? Infinity), 1.1 * reach); line(context, [-half, half], [i, i], x, y, style("--model"), { width }); }
      context.fillStyle = style("--ink"); context.font = "13px system-ui"; context.textAlign = "left"; context.textBaseline = "middle"; context.fillText(SYMBOLS[name] ?? name, x(-1.39 * reach) + 4, y(i));
    }) });
}

/** What is typed here is kept: a page that is loaded again has it still. */
function kept(key, attributes) {
  const name = `bench ${key}`;
  const made = element("input", { spellcheck: "false", "data-kept": key, ...attributes, value: localStorage.getItem(name) ?? attributes.value ?? "", oninput: () => localStorage.setItem(name, made.value) });
  return made;
}

export function benchView(host, part, session) {
  const rows = element("div", {}), rigs = element("div", {}), plans = element("div", {});
  const out = kept("rig", { value: "rig.toml", "aria-label": "file of the rig", size: 14 }), steps = kept("steps", { value: "next.steps.csv", "aria-label": "file of the programme", size: 14 });
  const speed = kept("speed", { placeholder: "1 mm/s", "aria-label": "drive speed of the test", size: 9 }), load = kept("load", { placeholder: "1 N", "aria-label": "normal force of the test", size: 9 });
  const budget = kept("budget", { placeholder: "15 min", "aria-label": "time there is", size: 9 });
  const of = element("strong", {}, session.scene || "none yet");
  let listed = "", shown = {};

  const fields = new Map();
  const field = (path, what, example) => { const made = kept(`${what} of ${path}`, { placeholder: example, "aria-label": `${what} of ${path}`, size: 9 }); fields.set(`${what} ${path}`, made); return made; };
  const boxes = new Map();
  const said = (what, logs) => logs.map((path) => [path, fields.get(`${what} ${path}`).value.trim()]).filter(([, value]) => value).map(([path, value]) => `${path}=${value}`);

  async function measure() {
    const logs = [...boxes].filter(([, box]) => box.checked).map(([path]) => path);
    if (!logs.length) { say("choose the records of the rig first"); return; }
    await start(session, { command: "rig", logs, out: out.value, "drive-speed": said("speed", logs), "added-mass": said("mass", logs) });
  }
  async function scene() {
    await post("edit", { path: BEFORE, text: `effects = [${EFFECTS.map((name) => JSON.stringify(name)).join(", ")}]\n${session.folder.rigs.length ? `rig = ${JSON.stringify(session.folder.rigs[0])}\n` : ""}` });
    await post("save", { path: BEFORE });
    await session.look();
    session.use(BEFORE);
    of.textContent = BEFORE;
    say(`${BEFORE} is the scene now: state drive speed and normal force of the test, and plan`);
  }
  async function plan() {
    if (!session.scene) { say("a plan needs a scene: make one of logs, or the one before any test"); return; }
    await post("save", { path: session.scene });
    const set = [["rig.drive_speed", speed], ["rig.normal_force", load]].filter(([, input]) => input.value.trim()).map(([key, input]) => `${key}=${input.value.trim()}`);
    const fit = fitOf(session), source = fit?.status === "converged" && !set.length ? `${fit.path}/result.json` : session.scene; // its estimates, where it stands
    await start(session, { command: "plan", source, out: steps.value, budget: budget.value.trim() || undefined, set });
  }

  /** The newest job of a kind that has ended: what it said, and its file. */
  async function report(kind, place, words, more) {
    const job = session.folder.jobs.find((one) => one.kind === kind && one.state !== "running");
    if (!job || shown[kind] === job.id) return;
    shown[kind] = job.id;
    const found = job.state === "done" ? await get("job", { id: job.id }) : null, written = job.out && found?.out;
    refill(place, found ? TABLES[kind](found) : element("p", {}, job.message), found ? element("details", { open: !found.out }, element("summary", {}, "in words"), element("pre", { "data-said": kind }, job.words)) : null,
      written ? element("p", {}, element("a", { href: fileAddress(job.out, true) }, job.out), words, more) : null, command(job.command));
    if (found) halves(place.querySelector("#halves"), kind === "plan" ? found : certain(found));
  }
  const fill = () => {
    const key = JSON.stringify(session.folder.logs.map((log) => log.path));
    if (key !== listed) {
      listed = key;
      const on = Object.fromEntries([...boxes].map(([path, box]) => [path, box.checked]));
      boxes.clear();
      refill(rows, !session.folder.logs.length ? element("p", {}, "There is no record in this folder yet: add some in ", link("the table of logs", "logs"), ".") : table(["record", "drive speed of a pull", "mass fixed to the holder"], session.folder.logs.map(({ path }) => {
        const box = element("input", { type: "checkbox", checked: on[path] ?? false, "aria-label": `a record of the rig: ${path}` });
        boxes.set(path, box);
        return [element("label", {}, box, " ", path), field(path, "speed", "0.1 mm/s"), field(path, "mass", "50 g")];
      }), { class: "cards" }));
    }
    report("rig", rigs, " holds the rig; a scene takes it at its field “rig from”. ").catch((error) => say(error.message));
    report("plan", plans, " is the programme, a row for each step of the drive. ").catch((error) => say(error.message));
  };

  put(host, part === "rig" ? [element("h2", {}, "Measure the rig from short records"),
    element("p", { class: "quiet" }, "Taps that ring down with the drive at rest, a tap with a known mass fixed to the holder, a slow pull on a rigid block: any two give mass, stiffness and damping with their intervals, which are the priors of every fit. Mark them, and state speed or added mass."),
    rows, element("div", { class: "bar" }, button("measure the rig", measure, { class: "main" }), labelled("as", out)), rigs]
    : [element("h2", {}, "Plan the next logs"),
      element("p", { class: "quiet" }, "For the scene ", of, ": what its logs identify and which to add; before any test, the few logs that identify most. ", button("make a scene before any test", scene)),
      element("div", { class: "bar" }, button("plan", plan, { class: "main" }), labelled("drive speed", speed), labelled("normal force", load), labelled("time available", budget), labelled("as", steps)), plans]);
  document.addEventListener("folder", fill);
  fill();
  return () => document.removeEventListener("folder", fill);
}
