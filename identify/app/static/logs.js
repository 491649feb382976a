// The folder as a table, filled as files are read; a file dropped in is added; from chosen logs to a scene or a study.
import { add, button, element, labelled, link, post, put, refill, say, style, table } from "./base.js";
import { start, whenEnded } from "./jobs.js";

const SIGNS = { accept: "✓ accept", "accept with warnings": "! accept with warnings", reject: "✗ reject" };
const CLASSES = { accept: "accept", "accept with warnings": "warning", reject: "reject" };
const chosen = new Set(JSON.parse(sessionStorage.getItem("chosen") ?? "[]"));

function choose(path, on) {
  if (on) chosen.add(path); else chosen.delete(path);
  sessionStorage.setItem("chosen", JSON.stringify([...chosen]));
}

/** The logs that a button is about: those that are marked; where none is, all but files that are no logs. */
export const meant = (session) => {
  const logs = session.folder.logs, some = logs.filter((log) => chosen.has(log.path));
  return (some.length ? some : logs.filter((log) => !log.ready || log.format)).map((log) => log.path);
};

/** The friction force of a whole log, small: a bar from lowest to highest for each stretch of time. */
function thumbnail({ curve, path }) {
  const canvas = element("canvas", { width: 2 * curve.length, height: 30, class: "thumbnail", role: "img", "aria-label": `friction force of ${path} over time` });
  const ends = curve.flat(), low = Math.min(...ends), size = 28 / (Math.max(...ends) - low || 1), context = canvas.getContext("2d");
  context.fillStyle = style("--force");
  curve.forEach(([from, to], i) => context.fillRect(2 * i, 29 - (to - low) * size, 2, Math.max((to - from) * size, 1)));
  return canvas;
}

export function logsView(host, asked, session) {
  const rows = element("div", {}), foot = element("div", {});
  const out = element("input", { value: "scene.toml", "aria-label": "name of the new scene", size: 18 });
  const taken = async (files) => {
    for (const file of files) { say(`adding ${file.name} …`); await add(file); }
    say("");
    await session.look();
  };
  const file = element("input", { type: "file", multiple: true, hidden: true, onchange: () => taken(file.files).catch((error) => say(error.message)) });
  const make = button("", async () => {
    const job = await start(session, { command: "scene", logs: meant(session), out: out.value });
    say("writing the scene from the logs; it opens when it is ready …");
    stop = whenEnded(job.id, session, (ended) => { if (ended.state === "done") { session.use(ended.out); location.hash = `#scene?scene=${encodeURIComponent(ended.out)}`; } else say(ended.message); });
  }, { class: "main" });
  let stop = () => {}, shown = "";
  const count = () => {
    const some = meant(session).length, marked = session.folder.logs.some((log) => chosen.has(log.path));
    make.textContent = !marked && some > 1 ? `make a scene from all ${some} logs` : `make a scene from the ${some} chosen ${some === 1 ? "log" : "logs"}`;
    make.disabled = !some;
  };

  const fill = () => {
    const logs = session.folder.logs, key = JSON.stringify(logs);
    count();
    if (key === shown) return;
    shown = key;
    const all = element("input", { type: "checkbox", "aria-label": "choose all logs", checked: logs.length > 0 && logs.every((log) => chosen.has(log.path)),
      onchange: () => { logs.forEach((log) => choose(log.path, all.checked)); shown = ""; fill(); } });
    const whole = element("label", {}, all, element("span", { class: "narrow" }, " choose all"));
    refill(rows, table(
      [whole, "log", "format", "drive speed", "load", "rate", { number: "slips" }, "regime", "verdict, and why"],
      logs.map((log) => [
        element("input", { type: "checkbox", "aria-label": `choose ${log.path}`, checked: chosen.has(log.path), onchange: (event) => { choose(log.path, event.target.checked); count(); } }),
        element("span", {}, link(log.path, "log", { path: log.path }), log.curve?.length ? thumbnail(log) : null),
        ...(log.ready ? [log.format, log.speed || (log.hint ? element("span", {}, `unknown; ${log.hint}?`, element("small", { class: "under" }, `by its ${log.hinted_by}`)) : "unknown"), log.load, log.rate, { number: log.slips ?? "" }, log.regime,
          element("span", {}, element("span", { class: CLASSES[log.verdict] ?? "" }, SIGNS[log.verdict] ?? log.verdict), log.reason ? `: ${log.reason}` : "", log.more ? [" ", link(`and ${log.more} more`, "log", { path: log.path })] : "")]
          : [log === logs.find((one) => !one.ready) ? "inspecting …" : "waiting", "", "", "", "", "", ""]),
      ]), { id: "logs", class: "cards" }));
    const done = logs.filter((log) => log.ready).length;
    refill(foot, logs.length ? (done < logs.length ? element("p", { class: "quiet", "aria-live": "polite" }, `${done} of ${logs.length} files inspected, one after the other; their curves can be opened already.`) : "") : element("p", {}, "There is no log in this folder yet. Drop files here, or ",
      button("put the example logs here", async () => { await post("examples"); await session.look(); })));
  };

  put(host, 
    element("div", { class: "bar" }, make, labelled("as", out), button("one fit for each log, to compare", () => { location.hash = "#study"; }),
      button("add files …", () => file.click()), file, element("small", {}, "or drop them anywhere on this view")),
    element("p", { class: "quiet" }, "Click a log to check its curves. Then mark the logs of one pair of surfaces on one rig and make a scene of them: the file that states rig, logs and model of one fit."),
    rows, foot);
  const over = (event) => { event.preventDefault(); host.classList.toggle("drop", event.type === "dragover"); };
  host.addEventListener("dragover", over);
  host.addEventListener("dragleave", over);
  host.addEventListener("drop", (event) => { over(event); taken(event.dataTransfer.files).catch((error) => say(error.message)); });
  const again = () => { shown = ""; fill(); }; // the colours of thumbnails follow day and night
  document.addEventListener("folder", fill);
  document.addEventListener("redraw", again);
  fill();
  return () => { document.removeEventListener("folder", fill); document.removeEventListener("redraw", again); stop(); };
}
