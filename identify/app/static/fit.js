// Fits: start one, see how far it is, look into its result, hold two against each other.
import { address, button, choice, curves, duration, element, fileAddress, get, labelled, link, plain, post, put, refill, remember, say, shownTable, style, table } from "./base.js";
import { start, whenEnded } from "./jobs.js";
import { shade, TimeView } from "./plots.js";

/** The accuracies with what they cost and leave, of the last fit of this scene where it says so. */
function accuracies(seen) {
  const levels = Object.fromEntries((seen?.accuracy?.levels ?? []).map((level) => [level.accuracy, level]));
  return ["coarse", "default", "tight"].map((name) => [name, levels[name]
    ? `${name}: about ${plain(levels[name].seconds, 2)} s, steps leave ${plain(levels[name].error_in_standard_errors, 2)} standard errors` : name]);
}

/** The table of parameters of one fit, and under it that of a second with how far apart both are. */
function parameters(one, two, second) {
  const names = Object.keys(two?.parameters ?? {}), apart = (a, b) => a?.standard_error && b?.standard_error && a.value !== null && b.value !== null ? `${plain((b.value - a.value) / Math.hypot(a.standard_error, b.standard_error), 2)} s.e.` : "";
  return [shownTable(one.table, { id: "parameters", class: "cards" }), one.tolerances ? element("p", { class: "quiet" }, `${one.tolerances}.`) : null,
    two ? [element("h3", {}, second), shownTable(two.table, { id: "second", class: "cards" }, [{ number: "apart" }], (at) => [{ number: apart(one.parameters[names[at]], two.parameters[names[at]]) }])] : null];
}

function residualView(host, path, seen, session) {
  const logs = seen.logs.map((log, number) => ({ ...log, number: number + 1 })).filter((log) => log.cycles.length || !log.left_out);
  if (!logs.length) return undefined;
  const plots = element("div", { id: "residuals" }), list = element("p", {}), pick = element("span", {});
  let view = null;
  const showLog = (number) => {
    const log = logs.find((one) => one.number === Number(number)) ?? logs[0];
    view?.close();
    const end = log.cycles.length ? Math.max(...log.cycles.map((c) => c.arrest)) * 1.02 : 1e9;
    const fitted = log.cycles.some((cycle) => Number.isFinite(cycle.misfit_z)), worst = !fitted ? [] : [...log.cycles.keys()].sort((a, b) => Math.abs(log.cycles[b].misfit_z) - Math.abs(log.cycles[a].misfit_z)).slice(0, 5);
    const bad = (z) => Math.abs(z) > 4;
    curves("residuals", { path, number: log.number }).then((rows) => {
      const last = rows[0].length ? rows[0][rows[0].length - 1] : end;
      view = new TimeView(plots, {
        begin: rows[0].length ? rows[0][0] : 0, end: last, ask: (begin, to) => curves("residuals", { path, number: log.number, begin, end: to }),
        panels: !fitted ? [{ label: "force", unit: "N", height: 240, series: [{ row: 1, label: "measured", color: "--force" }] }]
          : [{ label: "force", unit: "N", height: 210, series: [{ row: 1, label: "measured", color: "--force" }, { row: 2, label: "fitted", color: "--model", dash: [6, 4] }] },
            { label: "difference", unit: "N", height: 150, series: [{ row: 3, label: "measured − fitted", color: "--residual" }] }],
        drawOver: (plot) => !fitted ? log.cycles.forEach((c) => shade(plot, c.onset, c.arrest, style("--model"))) : log.cycles.filter((c) => bad(c.misfit_z)).forEach((c) => shade(plot, c.onset, c.arrest, style("--bad"), { hatch: 6, label: "misfit" })),
      });
      plots.timeView = view;
    });
    refill(list, fitted ? "Cycles that fit worst: " : "Every slip was followed by itself; no one curve was fitted. ", worst.map((i) => {
      const cycle = log.cycles[i], room = 2 * (cycle.arrest - cycle.onset) + 0.02, window = [cycle.onset - room, cycle.arrest + room];
      return [button(`cycle ${i + 1}, z = ${plain(cycle.misfit_z, 2)}${bad(cycle.misfit_z) ? " ✗" : ""}`, () => view.go(...window), { "data-cycle": i + 1 }),
        " ", link("in the log", "log", { path: log.path, begin: Math.max(window[0], 0), end: window[1] }), " "];
    }), " ", button("all", () => view.go(...view.whole)));
  };
  pick.append(labelled(seen.uneven ? "Measured force of" : "Residuals of", choice(logs.map((log) => [String(log.number), `${log.path}${log.left_out ? " (left out)" : ""}`]), String(logs[0].number), showLog)));
  put(host, element("h3", {}, pick), plots, list);
  showLog(logs[0].number);
  return () => view?.close();
}

/** Of a pair whose cycles differ: how peak, drop and period are spread; strength over rest is a picture of the report. */
const unevenView = (host, { headline, not_for, spread }) => put(host, element("p", {}, element("strong", {}, headline), ` ${not_for}`),
  table(["", { number: "median (95 % interval)" }, { number: "nine of ten cycles" }], spread.map(([name, median, range]) => [name, { number: median }, { number: range }]), { id: "spread", class: "cards" }));

async function result(host, path, second, session) {
  const seen = await get("fit", { path }), two = second ? await get("fit", { path: second }) : null;
  const others = session.folder.fits.map((fit) => fit.path).filter((other) => other !== path);
  const fitless = seen.status !== "converged";
  const says = (fit) => element("p", { class: fit.status === "converged" ? "good" : "bad" }, `${fit.status.replaceAll("_", " ")}: ${fit.message}`);
  refill(host, 
    element("h2", {}, path), says(seen), two ? element("p", {}, `second, ${second}: `, says(two)) : null,
    element("div", { class: "bar" }, element("a", { class: "main", href: fileAddress(`${path}/report.html`), target: "_blank", rel: "noopener" }, "open the report"),
      seen.uneven || fitless ? null : link("map from this fit", "map", { fit: path }),
      others.length ? labelled("compare with", choice([["", "no other fit"], ...others], second ?? "", (other) => { location.hash = address("fit", { path, second: other }); })) : null,
      element("small", {}, "Files: ", seen.files.map((name) => [element("a", { href: fileAddress(`${path}/${name}`, true) }, name), " "]))));
  if (seen.uneven) unevenView(host, seen.uneven);
  put(host, parameters(seen, two, second));
  put(host, element("details", {}, element("summary", {}, "Accuracy and computing time"), seen.costs.rows.length ? shownTable(seen.costs, { id: "price" }) : element("p", {}, `It took ${plain(seen.timing_s?.total, 2)} s.`)));
  const close = residualView(host, path, seen, session);
  const entries = seen.logs.filter((log) => log.left_out || log.text);
  if (entries.length) put(host, element("h3", {}, "What follows from it, log by log"), entries.map((log, i) => element("details", { open: i === 0 }, element("summary", {}, element("strong", {}, log.path), log.left_out ? " (left out)" : ""), element("p", {}, log.left_out ?? log.text))));
  if (seen.search?.length) put(host, element("details", {}, element("summary", {}, `Attempts of the search (${seen.search.length})`), table(["strategy", "status", { number: "misfit" }, { number: "seconds" }],
    seen.search.map((step) => [step.strategy, (step.status ?? "").replaceAll("_", " "), { number: plain(step.cost) }, { number: plain(step.seconds, 2) }])), seen.not_tried?.length ? element("p", {}, `No time for: ${seen.not_tried.map((name) => name.strategy ?? name).join(", ")}`) : null));
  if (seen.effects.length) put(host, element("details", {}, element("summary", {}, "Tests of the effects"), element("ul", {}, seen.effects.map((reason) => element("li", {}, `${reason.effect}: ${reason.sentence}`)))));
  const figure = (name) => {
    const words = name.replaceAll("_", " "), as = (form, columns) => `api/picture?${new URLSearchParams({ path, name, form, columns })}`;
    const forms = (columns) => ["svg", "pdf", "png"].map((form) => [element("a", { href: as(form, columns), download: `${name}_${columns}_column.${form}` }, form), " "]);
    return element("figure", {}, element("img", { src: as("svg", 1), alt: words, loading: "lazy" }), element("figcaption", {}, words, ": ", forms(1), "two columns wide: ", forms(2)));
  };
  const shots = (of) => element("div", { class: "pictures three" }, of.map(figure)), own = seen.figures.filter((name) => name.startsWith("log_"));
  const rest = seen.figures.filter((name) => !own.includes(name));
  if (rest.length) put(host, element("h3", {}, "Intervals, laws, residuals"), shots(rest));
  if (own.length) put(host, element("details", { open: Boolean(seen.uneven) }, element("summary", {}, `Pictures of each log (${own.length})`), shots(own)));
  put(host, element("details", {}, element("summary", {}, "The whole report, here"), element("iframe", { src: fileAddress(`${path}/report.html`), title: `report of ${path}`, sandbox: "allow-scripts allow-popups", loading: "lazy" })));
  return { close, seen };
}

export async function fitView(host, asked, session) {
  const place = element("div", {}), list = element("div", {});
  const scene = session.scene, stem = scene.split("/").pop()?.replace(/\.toml$/, "") ?? "";
  const text = scene ? await get("scene", { path: scene }) : null;
  const out = element("input", { value: `stickslip-${text?.form?.name || stem}`, size: 22, "aria-label": "folder of the result" });
  const of = [asked.path, out.value].map((path) => session.folder.fits.find((fit) => fit.path === path)).find(Boolean);
  let accuracy = choice(accuracies(), "default", () => {}, { "aria-label": "accuracy" });
  const limit = element("input", { value: text?.form?.time_limit || "60 s", size: 7, "aria-label": "time limit" });
  const more = Object.entries({ profile: "profile of every parameter", "accuracy-table": "measure every accuracy" }).map(([name, words]) => {
    return element("label", {}, element("input", { type: "checkbox", "data-option": name }), " ", words);
  });
  let close = null, stop = () => {};
  const begin = button("fit", async () => {
    await post("save", { path: scene });
    const options = Object.fromEntries(more.map((label) => [label.firstChild.dataset.option, label.firstChild.checked]));
    const job = await start(session, { command: "fit", scene, out: out.value, accuracy: accuracy.value, "time-limit": limit.value, ...options });
    stop();
    refill(place, element("p", { class: "quiet" }, "The fit is running; its stage and the time left are shown at the bottom. It continues when this page is closed."));
    stop = whenEnded(job.id, session, (ended) => { if (ended.state === "done" && host.isConnected) { remember({ path: ended.out, second: "" }); show(ended.out); } else if (ended.state !== "done") { refill(place); say(ended.message); } });
  }, { class: "main", disabled: !scene || Boolean(text?.error) });
  const show = async (path, second) => {
    close?.();
    const found = await result(place, path, second, session), renewed = choice(accuracies(found.seen), accuracy.value, () => {}, { "aria-label": "accuracy" });
    close = found.close;
    accuracy.replaceWith(renewed);
    accuracy = renewed;
  };
  const fill = () => {
    const key = JSON.stringify(session.folder.fits.map((fit) => [fit.path, fit.finished]));
    if (key === list.dataset.key) return;
    list.dataset.key = key;
    refill(list, session.folder.fits.length ? table(["fit", "status", "finished", "message"], session.folder.fits.map((fit) => [link(fit.path, "fit", { path: fit.path }), fit.status, fit.finished.replace("T", " ").replace("Z", ""), fit.message]), { id: "fits", class: "cards" })
      : element("p", {}, "No fit in this folder yet. ", scene ? null : [link("Open the logs", "logs"), " and make a scene of them first."]));
  };
  put(host, element("div", { class: "bar" }, begin, labelled(scene ? `${scene} into` : "no scene yet;", out), labelled("accuracy", accuracy), labelled("at most", limit)),
    element("div", { class: "bar" }, element("span", { class: "quiet" }, "takes longer:"), more), text?.error ? element("p", { class: "error" }, `The scene is not complete: ${text.error} `, link("open it", "scene")) : null,
    place, element("details", { open: !of }, element("summary", {}, "All fits of the folder"), list));
  document.addEventListener("folder", fill);
  fill();
  // a fit that was started before the page was opened is waited for all the same
  const running = session.folder.jobs.find((job) => job.kind === "fit" && job.state === "running" && job.out === out.value);
  if (running) stop = whenEnded(running.id, session, (ended) => { if (ended.state === "done") show(ended.out); });
  if (of) await show(of.path, asked.second);
  return () => { document.removeEventListener("folder", fill); stop(); close?.(); };
}
