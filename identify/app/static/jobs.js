// Jobs: what runs, how far it is, how it ended; each with the command that does the same.
import { button, command, duration, element, link, post, say } from "./base.js";

const WORDS = { running: "running", done: "done", failed: "failed", cancelled: "cancelled", killed: "ended from outside" };
const SECONDS = { min: 60, h: 3600 };
const BUDGET = 60; // seconds of a fit whose scene and command say nothing

/** Where the result of a job is looked at. */
function result(job) {
  if (job.state !== "done" || !job.out) return null;
  if (job.kind === "fit") return link("see the fit", "fit", { path: job.out });
  if (job.kind === "batch" || job.kind === "compare") return link("see the study", "study", { path: job.out, kind: job.kind });
  if (job.kind === "scene") return link("see the scene", "scene", { scene: job.out });
  if (job.kind === "rig" || job.kind === "plan") return link(`see the ${job.kind}`, job.kind);
  return link("see the map", "map", { job: job.id });
}

/** Seconds of the budget of a fit that are left, in words. */
function left(job) {
  if (job.kind !== "fit") return "";
  const words = (job.command.match(/--time-limit=([\d.]+ *\w*)/)?.[1] ?? job.limit ?? "").trim();
  const number = parseFloat(words), limit = Number.isFinite(number) ? number * (SECONDS[words.replace(/^[\d. ]+/, "")] ?? 1) : BUDGET;
  return `, about ${Math.max(Math.round(limit - job.seconds), 0)} s of at most ${Math.round(limit)} s left`;
}

/** A job at work: stage, time left, cancel. */
export function runningJob(job, session) {
  const stage = job.stages.length ? job.stages[job.stages.length - 1][0] : "starting";
  const bar = element("progress", { max: 1, "aria-label": `progress of ${job.kind}` });
  if (job.share !== null && job.share !== undefined) bar.value = job.share;
  const cancel = button("cancel", async () => { await post("cancel", { id: job.id }); await session.look(); });
  return element("section", { class: "job", "data-state": job.state },
    element("p", {}, element("strong", {}, job.kind), `${job.out && ` ${job.out}`}: ${stage} (${duration(job.seconds)}${left(job)}) `, cancel), bar,
    job.stages.length > 1 ? element("p", { class: "quiet" }, job.stages.map(([name, at]) => `${name} ${duration(at)}`).join(" → ")) : null, command(job.command));
}

const line = (job) => [element("strong", {}, job.kind), `${job.out && ` ${job.out}`}: ${WORDS[job.state]} after ${duration(job.seconds)} `, result(job)];

/** Jobs that have ended: the newest in one line, all with their commands beneath. */
export function endedJobs(jobs, clear, open) {
  return element("details", { open }, element("summary", {}, line(jobs[0]), " ", button("clear", clear)),
    jobs.map((job) => element("div", { class: "job", "data-state": job.state }, element("p", {}, line(job), job.message ? ` – ${job.message}` : ""), command(job.command))));
}

/** The fit of the scene that is worked on. */
export const fitOf = (session) => session.folder.fits.find((fit) => fit.path.startsWith("stickslip-") && session.folder.jobs.some((job) => job.out === fit.path && job.command.includes(`--scene ${session.scene} `)))
  ?? session.folder.fits.find((fit) => fit.path === `stickslip-${session.name}`);

/** Start a job and say that it runs. */
export async function start(session, asked) {
  const job = await post("start", asked);
  say("");
  await session.look();
  return job;
}

/** Call `then` once, when a job has ended. */
export function whenEnded(id, session, then) {
  const look = () => {
    const job = session.folder.jobs.find((one) => one.id === id);
    if (job && job.state === "running") return;
    document.removeEventListener("folder", look);
    if (job) then(job);
  };
  document.addEventListener("folder", look);
  return () => document.removeEventListener("folder", look);
}
