// Jobs: what runs, how far it is, how it ended; each with the command that does the same.
import { button, command, duration, element, link, post, say } from "./base.js";

const WORDS = { running: "running", done: "done", failed: "not done", cancelled: "cancelled", killed: "ended from outside" };
const BUDGET = 60; // seconds of a fit whose scene and command say nothing

/** Where the result of a job is looked at. */
function result(job) {
  if (job.state !== "done" || !job.out) return null;
  if (job.kind === "fit") return link("see the fit", "fit", { path: job.out });
  if (job.kind === "batch" || job.kind === "compare") return link("see the study", "study", { path: job.out, kind: job.kind });
  if (job.kind === "scene") return link("see the scene", "scene", { scene: job.out });
  return link("see the map", "map", { job: job.id });
}

/** Seconds of the budget of a fit that are left, in words. */
function left(job) {
  if (job.kind !== "fit") return "";
  const said = job.command.match(/--time-limit=(?:'([^']*)'|(\S+))/), words = (said?.[1] ?? said?.[2] ?? job.limit ?? "").trim();
  const number = parseFloat(words), limit = Number.isFinite(number) ? number * (words.endsWith("min") ? 60 : 1) : BUDGET;
  return `, about ${Math.max(Math.round(limit - job.seconds), 0)} s of at most ${Math.round(limit)} s left`;
}

export function jobCard(job, session, putAway) {
  const name = job.out ? ` ${job.out}` : "";
  const stage = job.stages.length ? job.stages[job.stages.length - 1][0] : "starting";
  const running = job.state === "running";
  const bar = running ? element("progress", { max: 1, "aria-label": `progress of ${job.kind}` }) : null;
  if (bar && job.share !== null && job.share !== undefined) bar.value = job.share;
  if (!running) {
    const message = job.message ? `: ${job.message}` : "";
    return element("details", { class: "job", "data-job": job.id, "data-state": job.state },
      element("summary", {}, element("strong", {}, job.kind), `${name}: ${WORDS[job.state]} after ${duration(job.seconds)}${message} `, result(job), " ", button("put away", putAway)), command(job.command));
  }
  const cancel = button("cancel", async () => { await post("cancel", { id: job.id }); await session.look(); });
  return element("section", { class: "job", "data-job": job.id, "data-state": job.state },
    element("p", {}, element("strong", {}, job.kind), `${name}: ${stage} (${duration(job.seconds)}${left(job)}) `, cancel), bar,
    job.stages.length > 1 ? element("p", { class: "quiet" }, job.stages.map(([name, at]) => `${name} ${duration(at)}`).join(" → ")) : null, command(job.command));
}

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
