// The folder as a table, filled as files are read; a file dropped in is added; from chosen logs to a scene or a study.
import { add, button, element, labelled, link, post, put, refill, say, table } from "./base.js";
import { start, whenEnded } from "./jobs.js";

const SIGNS = { accept: "✓ accept", "accept with warnings": "! accept with warnings", reject: "✗ reject" };
const CLASSES = { accept: "accept", "accept with warnings": "warning", reject: "reject" };
export const chosen = new Set(JSON.parse(sessionStorage.getItem("chosen") ?? "[]"));

function choose(path, on) {
  if (on) chosen.add(path); else chosen.delete(path);
  sessionStorage.setItem("chosen", JSON.stringify([...chosen]));
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
  const make = button("make a scene from the chosen logs", async () => {
    if (!chosen.size) throw new Error("no log is chosen; mark some in the table");
    const job = await start(session, { command: "scene", logs: [...chosen], out: out.value });
    stop = whenEnded(job.id, session, (ended) => { if (ended.state === "done") { session.use(ended.out); location.hash = `#scene?scene=${encodeURIComponent(ended.out)}`; } else say(ended.message); });
  }, { class: "main" });
  let stop = () => {}, shown = "";

  const fill = () => {
    const logs = session.folder.logs, key = JSON.stringify(logs);
    if (key === shown) return;
    shown = key;
    const all = element("input", { type: "checkbox", "aria-label": "choose all logs", checked: logs.length > 0 && logs.every((log) => chosen.has(log.path)),
      onchange: () => { logs.forEach((log) => choose(log.path, all.checked)); shown = ""; fill(); } });
    refill(rows, table(
      [all, "log", "format", "drive speed", "load", "rate", { number: "slips" }, "regime", "verdict and the reason that matters"],
      logs.map((log) => [
        element("input", { type: "checkbox", "aria-label": `choose ${log.path}`, checked: chosen.has(log.path), onchange: (event) => choose(log.path, event.target.checked) }),
        link(log.path, "log", { path: log.path }),
        ...(log.ready ? [log.format, log.speed, log.load, log.rate, { number: log.slips ?? "" }, log.regime,
          element("span", {}, element("span", { class: CLASSES[log.verdict] ?? "" }, SIGNS[log.verdict] ?? log.verdict), log.reason ? `: ${log.reason}` : "")]
          : ["reading …", "", "", "", "", "", ""]),
      ]), { id: "logs" }));
    refill(foot, logs.length ? "" : element("p", {}, "There is no log in this folder yet. Drop files here, or ",
      button("put the example logs here", async () => { await post("examples"); await session.look(); })));
  };

  put(host, 
    element("div", { class: "bar" }, make, labelled("as", out), button("use for a study", () => { location.hash = "#study"; }),
      button("add files …", () => file.click()), file, element("small", {}, "or drop them anywhere on this view")),
    rows, foot);
  const over = (event) => { event.preventDefault(); host.classList.toggle("drop", event.type === "dragover"); };
  host.addEventListener("dragover", over);
  host.addEventListener("dragleave", over);
  host.addEventListener("drop", (event) => { over(event); taken(event.dataTransfer.files).catch((error) => say(error.message)); });
  document.addEventListener("folder", fill);
  fill();
  return () => { document.removeEventListener("folder", fill); stop(); };
}
