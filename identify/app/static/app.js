// The frame of the page: views by address, the scene that is worked on, the jobs at the bottom, news of the folder.
import { address, choice, element, get, guarded, here, refill, say, settled } from "./base.js";
import { endedJobs, fitOf, runningJob } from "./jobs.js";
import { logsView } from "./logs.js";
import { logView } from "./log.js";
import { sceneView } from "./scene.js";
import { tryView } from "./try.js";
import { fitView } from "./fit.js";
import { mapView } from "./map.js";
import { studyView } from "./study.js";
import { benchView } from "./bench.js";

const VIEWS = {
  logs: ["Logs", logsView], log: ["Check a log", logView], scene: ["Rig and scene", sceneView], try: ["Simulate", tryView],
  fit: ["Fit", fitView], map: ["Map", mapView], study: ["Compare", studyView],
  rig: ["Measure the rig", (host, asked, session) => benchView(host, "rig", session)], plan: ["Plan", (host, asked, session) => benchView(host, "plan", session)],
};
const STEPS = [["Open logs", ["logs", "log"]], ["Describe", ["rig", "scene", "try"]], ["Fit", ["fit"]], ["Use", ["map", "study", "plan"]]];
const SOON = 700, LATER = 4000; // milliseconds between looks at the folder while something is at work, and else
const SHOWN = 8; // jobs that have ended

/** What all views work on: the folder as it was listed last, and the scene. */
const session = {
  folder: { folder: "", logs: [], scenes: [], rigs: [], fits: [], batches: [], jobs: [] },
  scene: "",
  missing: "", // what the scene lacks, "" where it is complete
  name: "", // of the scene, after which the folder of its fit is called
  use(scene) {
    this.scene = scene;
    localStorage.setItem("scene", scene);
    scenes();
  },
  async look() {
    this.folder = await get("folder");
    if (!this.folder.scenes.includes(this.scene)) this.scene = this.folder.scenes[0] ?? "";
    const seen = this.scene ? await get("scene", { path: this.scene }).catch((error) => ({ error: error.message })) : { error: "" };
    [this.missing, this.name] = [seen.error, seen.form?.name || this.scene.split("/").pop().replace(/\.toml$/, "")];
    document.getElementById("folder").textContent = this.folder.folder;
    scenes();
    steps();
    jobs();
    document.dispatchEvent(new Event("folder"));
  },
  working() { return this.folder.jobs.some((job) => job.state === "running") || this.folder.logs.some((log) => !log.ready); },
};
session.scene = localStorage.getItem("scene") ?? "";

let close = null, listed = "";

/** The steps with what is done, the views of each, and the one next thing to do. */
function steps() {
  const { logs, scenes: known } = session.folder, { view } = here(), fit = session.scene ? fitOf(session) : null, running = session.folder.jobs.some((job) => job.kind === "fit" && job.state === "running");
  const done = [logs.length > 0, Boolean(session.scene) && !session.missing, fit?.status === "converged", false];
  const [words, to, asked] = !logs.length ? ["add logs", "logs"] : !known.length ? ["make a scene of the logs", "logs"] : session.missing ? ["complete the scene", "scene"]
    : running ? ["follow the fit", "fit"] : !fit ? ["start the fit", "fit"] : fit.status !== "converged" ? ["read why the fit did not converge", "fit", { path: fit.path }] : view === "map" ? ["compare fits", "study"] : ["map what follows", "map", { fit: fit.path }];
  refill(document.getElementById("views"), STEPS.map(([name, views], i) => element("section", { class: "step", "data-done": done[i] ? "yes" : "no", "data-now": views.includes(view) ? "yes" : "no" },
    element("a", { class: "name", href: address(views[0]) }, `${done[i] ? "✓" : i + 1} ${name}`), (views.length > 1 ? views : []).map((one) => element("a", { href: address(one), "aria-current": one === view ? "page" : null }, VIEWS[one][0])))));
  const next = document.getElementById("next");
  refill(next, `Next: ${words}`);
  next.href = address(to, asked);
  document.body.dataset.next = to === view ? "here" : "elsewhere";
  next.hidden = to === view && !(asked && Object.keys(asked).some((key) => here().asked[key] !== asked[key]));
}

function scenes() {
  const options = session.folder.scenes.length ? session.folder.scenes : [["", "none yet"]], key = JSON.stringify([options, session.scene]);
  if (key === listed) return;
  listed = key;
  const made = choice(options, session.scene, (scene) => { session.use(scene); location.hash = address(here().view === "log" ? "scene" : here().view); show(); }, { id: "scene" });
  document.getElementById("scene").replaceWith(made);
}

function jobs() {
  const put = JSON.parse(localStorage.getItem("cleared") ?? "[]");
  const [running, others] = [true, false].map((now) => session.folder.jobs.filter((job) => (job.state === "running") === now));
  const ended = others.filter((job) => !put.includes(job.id)).slice(0, SHOWN), host = document.getElementById("jobs"), open = host.querySelector("details")?.open;
  refill(host, running.map((job) => runningJob(job, session)), ended.length ? endedJobs(ended, () => {
    localStorage.setItem("cleared", JSON.stringify([...others.map((job) => job.id), ...put].slice(0, 200)));
    jobs();
  }, open) : null);
}

const show = guarded(async () => {
  const { view, asked } = here(), [, make] = VIEWS[view] ?? VIEWS.logs;
  say("");
  close?.();
  close = null;
  if (asked.scene && session.folder.scenes.includes(asked.scene)) session.use(asked.scene);
  steps();
  const host = element("main", { id: "view", tabindex: -1 });
  document.getElementById("view").replaceWith(host);
  document.title = `${(VIEWS[view] ?? VIEWS.logs)[0]} – stick-slip workbench`;
  close = await make(host, asked, session);
});

async function watch() {
  await guarded(() => session.look())();
  setTimeout(watch, session.working() ? SOON : LATER);
}

document.addEventListener("keydown", (event) => {
  if (!event.altKey || event.ctrlKey || event.metaKey) return;
  const name = Object.keys(VIEWS)[Number(event.key) - 1];
  if (name) { event.preventDefault(); location.hash = address(name); }
  if (event.key === "0") { event.preventDefault(); document.getElementById("next").click(); }
});
addEventListener("hashchange", show);
const redraw = () => document.dispatchEvent(new Event("redraw")); // what is drawn follows the width, and day and night
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
addEventListener("resize", settled(redraw, 150));
await watch();
await show();
document.body.dataset.ready = "yes";
