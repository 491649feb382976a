// Study: a batch from chosen logs, its fits as they finish, the comparison by a label, every point linked to its fit.
import { address, button, choice, element, fileAddress, get, labelled, link, newestWins, post, put, refill, remember, say, style, SYMBOLS, table } from "./base.js";
import { start, whenEnded } from "./jobs.js";
import { meant } from "./logs.js";
import { mark, picture, span } from "./plots.js";

const SHAPES = ["circle", "square", "diamond", "cross"];

/** One parameter over the groups, with intervals; a click on a row opens its fit. */
function forest(host, groups, name, label) {
  const rows = groups.filter((group) => group.parameters?.[name]?.value !== null && group.parameters?.[name] !== undefined);
  if (!rows.length) { refill(host, element("p", {}, `no group has a value of ${SYMBOLS[name] ?? name} yet`)); return; }
  const ends = rows.flatMap(({ parameters: { [name]: p } }) => [p.value, ...(p.interval ?? []).filter((end) => end !== null)]);
  const kinds = [...new Set(rows.map((row) => row.labels?.[label] ?? ""))];
  const made = picture(host, { height: 60 + 24 * rows.length, x: { label: `${SYMBOLS[name] ?? name} ${rows[0].parameters[name].unit}`, range: span(ends) }, y: { label: "", range: [rows.length - 0.5, -0.9], names: true },
    draw: (context, x, y) => rows.forEach((row, i) => {
      const p = row.parameters[name], [low, high] = p.interval ?? [null, null];
      context.strokeStyle = style("--ink"); context.lineWidth = 1.5;
      context.beginPath(); context.moveTo(x(low ?? ends[0]), y(i)); context.lineTo(x(high ?? p.value), y(i)); if (low !== null && high !== null) context.stroke();
      mark(context, x(p.value), y(i), style("--force"), SHAPES[kinds.indexOf(row.labels?.[label] ?? "") % SHAPES.length], 5);
      context.fillStyle = style("--ink"); context.font = "12px system-ui"; context.textAlign = "left"; context.fillText(row.group, 70, y(i) - 6);
    }) });
  host.style.cursor = "pointer";
  host.title = "a click opens the fit";
  host.onclick = (event) => { const row = rows[Math.round(made.y(event.offsetY))]; if (row?.fit) location.hash = address("fit", { path: row.fit }); };
}

/** Groups and labels of the chosen logs, as they were left: `kept`, rows of the manifest; `changed` is called on every change. */
function manifest(session, host, speeds, kept, changed) {
  const paths = new Set(meant(session)), logs = session.folder.logs.filter((log) => paths.has(log.path));
  if (!logs.length) { put(host, element("p", {}, "There is no log in this folder yet: add some in ", link("the table of logs", "logs"), ".")); return null; }
  const given = Object.keys(kept[0] ?? {}).find((key) => !["path", "group", "drive_speed", "step"].includes(key)) ?? "material";
  const labelName = element("input", { value: given, size: 10, "aria-label": "name of the label" });
  const cells = logs.map((log) => {
    const left = kept.find((row) => row.path === log.path), plainSpeed = log.speed && !log.speed.includes(",") ? log.speed : log.hint ?? "";
    const cell = (name, value, size) => element("input", { value, size, "aria-label": `${name} of ${log.path}` });
    return { path: log.path, group: cell("group", left?.group ?? log.pair, 16),
      speed: cell("drive speed", left?.drive_speed || speeds[log.path] || plainSpeed, 12), step: cell("step", left?.step ?? "", 3), label: cell("label", left?.[given] ?? "", 12) };
  });
  const named = () => cells.forEach((cell) => { cell.label.placeholder = labelName.value; });
  labelName.addEventListener("input", named);
  named();
  host.onchange = changed;
  put(host, element("p", {}, "Logs with the same group name are fitted together. Shown are the logs marked in the table of logs, or all of them. ", button("all in one group", () => { cells.forEach((cell) => { cell.group.value = cells[0].group.value; }); return changed(); })),
    table(["log", "group", "drive speed", "step", labelName], cells.map((cell) => [cell.path, cell.group, cell.speed, cell.step, cell.label]), { class: "cards" }));
  return () => cells.map((cell) => Object.fromEntries(Object.entries({ path: cell.path, group: cell.group.value, drive_speed: cell.speed.value, step: cell.step.value, [labelName.value]: cell.label.value }).filter(([key, value]) => key === "path" || key === "group" || value)));
}

export async function studyView(host, asked, session) {
  const make = element("div", {}), seen = element("div", { id: "study" }), out = element("input", { value: "study", size: 14, "aria-label": "folder of the study" });
  let stop = () => {}, path = asked.path ?? "";
  const scene = session.scene ? await get("scene", { path: session.scene }) : null;
  const file = () => `${out.value}.manifest.csv`, keep = () => post("manifest", { path: file(), rows: rows() });
  const kept = (await get("groups", { path: file() })).rows;
  const rows = manifest(session, make, Object.fromEntries((scene?.form?.logs ?? []).map((log) => [log.path, log.drive_speed.startsWith("TODO") ? "" : log.drive_speed])), kept, newestWins(keep));
  if (rows) make.append(element("div", { class: "bar" }, button("fit all groups", async () => {
    await post("save", { path: session.scene });
    const written = await keep();
    const job = await start(session, { command: "batch", source: [written.path], scene: session.scene, out: out.value, resume: session.folder.batches.includes(out.value) });
    path = out.value;
    remember({ path });
    stop = whenEnded(job.id, session, (ended) => { if (ended.state !== "done") say(ended.message); fill(true); });
  }, { class: "main", disabled: !session.scene }), labelled("with the rig of", element("strong", {}, session.scene || "no scene yet")), labelled("into", out)));

  let shown = "", parameter = "", label = "";
  const fill = async (always = false) => {
    if (!path) return;
    const busy = session.folder.jobs.some((job) => job.out === path && job.state === "running");
    if (!busy && !always && shown) return;
    if (asked.kind === "compare") {
      refill(seen, element("iframe", { src: fileAddress(`${path}/report.html`), title: `comparison ${path}`, sandbox: "allow-scripts allow-popups" }));
      shown = path;
      return;
    }
    const found = await get("batch", { path }).catch(() => ({ groups: [], labels: [], report: "" })), key = JSON.stringify([found, busy]);
    if (key === shown) return;
    shown = key;
    const names = [...new Set(found.groups.flatMap((group) => Object.keys(group.parameters ?? {})))];
    parameter = parameter || names[0] || "";
    label = label || found.labels[0] || "";
    const plot = element("div", { id: "forest" }), into = `${path}-by-${label || "group"}`;
    refill(seen, element("h2", {}, path), element("p", {}, `${found.groups.length} groups done${busy ? "; the batch is running" : ""}`),
      table(["group", "status", ...names.map((name) => ({ number: SYMBOLS[name] ?? name })), "message"], found.groups.map((group) => [group.fit ? link(group.group, "fit", { path: group.fit }) : group.group, (group.status ?? "").replaceAll("_", " "),
        ...names.map((name) => ({ number: group.shown?.[name] ?? "–" })), group.message]), { id: "groups", class: "cards" }),
      names.length ? element("div", { class: "bar" }, labelled("forest plot of", choice(names.map((name) => [name, SYMBOLS[name] ?? name]), parameter, (to) => { parameter = to; forest(plot, found.groups, parameter, label); })),
        found.labels.length ? labelled("marks by", choice(found.labels, label, (to) => { label = to; shown = ""; fill(true); })) : "",
        label ? button(`compare by ${label}`, async () => {
          const job = await start(session, { command: "compare", fits: [path], by: label, out: into });
          whenEnded(job.id, session, (ended) => { if (ended.state === "done") location.hash = address("study", { path: into, kind: "compare" }); else say(ended.message); });
        }) : "", found.report && !busy ? element("a", { href: fileAddress(found.report), target: "_blank", rel: "noopener" }, "the report of the batch") : "") : "",
      plot);
    if (parameter) forest(plot, found.groups, parameter, label);
  };
  const listener = () => fill().catch((error) => say(error.message));
  put(host, element("h2", {}, "Compare: one fit for each group of logs"), make, session.folder.batches.length ? element("p", {}, "Batches of this folder: ", session.folder.batches.map((name) => [link(name, "study", { path: name }), " "])) : "", seen);
  document.addEventListener("folder", listener);
  await fill(true);
  return () => { document.removeEventListener("folder", listener); stop(); };
}
