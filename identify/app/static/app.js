// The frame of the page: views by address, the scene that is worked on, the jobs at the bottom, news of the folder.
import { address, choice, element, get, guarded, here, refill, say, settled } from "./base.js";
import { endedJobs, runningJob } from "./jobs.js";
import { logsView } from "./logs.js";
import { logView } from "./log.js";
import { sceneView } from "./scene.js";
import { tryView } from "./try.js";
import { fitView } from "./fit.js";
import { mapView } from "./map.js";
import { studyView } from "./study.js";
import { benchView } from "./bench.js";

const VIEWS = {
  logs: ["Logs", logsView], log: ["One log", logView], scene: ["Scene", sceneView], try: ["Try", tryView],
  fit: ["Fit", fitView], map: ["Map", mapView], study: ["Study", studyView], bench: ["Bench", benchView],
};
const SOON = 700, LATER = 4000; // milliseconds between looks at the folder while something is at work, and else
const SHOWN = 8; // jobs that have ended

/** What all views work on: the folder as it was listed last, and the scene. */
const session = {
  folder: { folder: "", logs: [], scenes: [], rigs: [], fits: [], batches: [], jobs: [] },
  scene: "",
  use(scene) {
    this.scene = scene;
    localStorage.setItem("scene", scene);
    scenes();
  },
  async look() {
    this.folder = await get("folder");
    if (!this.folder.scenes.includes(this.scene)) this.scene = this.folder.scenes[0] ?? "";
    document.getElementById("folder").textContent = this.folder.folder;
    scenes();
    jobs();
    document.dispatchEvent(new Event("folder"));
  },
  working() { return this.folder.jobs.some((job) => job.state === "running") || this.folder.logs.some((log) => !log.ready); },
};
session.scene = localStorage.getItem("scene") ?? "";

let close = null, listed = "";

function scenes() {
  const options = session.folder.scenes.length ? session.folder.scenes : [["", "none yet"]], key = JSON.stringify([options, session.scene]);
  if (key === listed) return;
  listed = key;
  const made = choice(options, session.scene, (scene) => { session.use(scene); location.hash = address(here().view === "log" ? "scene" : here().view); show(); }, { id: "scene" });
  document.getElementById("scene").replaceWith(made);
}

function jobs() {
  const put = JSON.parse(localStorage.getItem("put-away") ?? "[]");
  const [running, others] = [true, false].map((now) => session.folder.jobs.filter((job) => (job.state === "running") === now));
  const ended = others.filter((job) => !put.includes(job.id)).slice(0, SHOWN), host = document.getElementById("jobs"), open = host.querySelector("details")?.open;
  refill(host, running.map((job) => runningJob(job, session)), ended.length ? endedJobs(ended, () => {
    localStorage.setItem("put-away", JSON.stringify([...others.map((job) => job.id), ...put].slice(0, 200)));
    jobs();
  }, open) : null);
}

const show = guarded(async () => {
  const { view, asked } = here(), [, make] = VIEWS[view] ?? VIEWS.logs;
  say("");
  close?.();
  close = null;
  if (asked.scene && session.folder.scenes.includes(asked.scene)) session.use(asked.scene);
  refill(document.getElementById("views"), ...Object.entries(VIEWS).map(([name, [words]]) =>
    element("a", { href: address(name), "aria-current": name === view ? "page" : null }, words)));
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
});
addEventListener("hashchange", show);
const redraw = () => document.dispatchEvent(new Event("redraw")); // what is drawn follows the width, and day and night
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
addEventListener("resize", settled(redraw, 150));
await watch();
await show();
document.body.dataset.ready = "yes";
