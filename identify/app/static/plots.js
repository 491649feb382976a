// Curves over time (uPlot) and pictures of points and lines (a canvas of our own), readable without colour.
import { button, element, newestWins, plain, refill, style } from "./base.js";

const CLICK = 4; // pixels that a click may move
const HAIR = 1 / (devicePixelRatio || 1); // thicker lines of thousands of points take browsers five times as long

/** A button that keeps what is drawn on these canvases, one below the other, as a PNG. */
function keep(name, canvases) {
  return button("save as PNG", (event) => {
    event.stopPropagation();
    const all = canvases(), sheet = element("canvas", { width: Math.max(...all.map((one) => one.width)), height: all.reduce((sum, one) => sum + one.height, 0) }), context = sheet.getContext("2d");
    context.fillStyle = style("--paper");
    context.fillRect(0, 0, sheet.width, sheet.height);
    all.reduce((top, one) => { context.drawImage(one, 0, top); return top + one.height; }, 0);
    element("a", { href: sheet.toDataURL("image/png"), download: `${name.replace(/[^\w.-]+/g, "_")}.png` }).click();
  }, { class: "keep", onpointerdown: (event) => event.stopPropagation() });
}

/** Curves over time in panels one below the other, of which only the visible window is asked for.

    panels: [{label, unit, height, series: [{row, label, color, dash}]}]; ask(begin, end) gives rows, the first the time;
    drawOver(plot, panel) draws over them; hover(time); mode(): "move", or the name that picks(begin, end, name, click)
    is called; moved(begin, end). */
export class TimeView {
  constructor(host, { panels, begin, end, shown, ask, drawOver, hover, mode, picks, moved }) {
    Object.assign(this, { host, panels, ask, drawOver, hover, picks, moved, whole: [begin, end], mode: mode ?? (() => "move") });
    [this.begin, this.end] = shown ?? this.whole;
    this.fetch = newestWins(async () => {
      this.rows = await this.ask(this.begin, this.end);
      this.show();
      host.dataset.drawn = String(Number(host.dataset.drawn ?? 0) + 1);
    });
    this.plots = panels.map((panel, number) => this.plot(panel, number));
    host.append(keep(`${panels[0].label} over time`, () => this.plots.map((plot) => plot.ctx.canvas)));
    this.observer = new ResizeObserver(() => this.plots.forEach((plot, number) => plot.setSize({ width: this.width(), height: panels[number].height })));
    this.observer.observe(host);
    this.again = () => this.redraw();
    document.addEventListener("redraw", this.again);
    this.released = () => { this.grip = null; };
    this.pulled = (event) => this.pull(event);
    addEventListener("pointermove", this.pulled);
    addEventListener("pointerup", this.released);
    host.tabIndex = 0;
    host.onkeydown = (event) => this.key(event);
    this.fetch();
  }

  width() { return Math.max(this.host.clientWidth - 2, 200); }

  plot(panel, number) {
    const place = element("div", { class: "plot" });
    this.host.append(place);
    const ink = () => style("--ink"), pale = () => style("--line"), axis = { stroke: ink, grid: { stroke: pale, width: 1 }, ticks: { stroke: pale }, labelSize: 18 };
    const last = number === this.panels.length - 1;
    const options = {
      width: this.width(), height: panel.height, legend: { show: false },
      cursor: { sync: { key: "time", scales: ["x", null] }, drag: { x: true, y: false, setScale: false }, points: { show: false } },
      scales: { x: { time: false, range: () => [this.begin, this.end] } },
      axes: [last ? { ...axis, label: "time (s)", size: 34 } : { ...axis, values: () => [], size: 8 }, { ...axis, label: `${panel.label} (${panel.unit})`, size: 58, space: 18 }],
      series: [{}, ...panel.series.map((s) => ({ label: s.label, stroke: () => style(s.color), width: HAIR, dash: s.dash, points: { show: false } }))],
      hooks: {
        draw: [(u) => this.drawOver?.(u, number)],
        setCursor: [(u) => { if (u.cursor.left >= 0) this.hover?.(u.posToVal(u.cursor.left, "x")); }],
        setSelect: [(u) => this.selected(u)],
      },
    };
    const made = new uPlot(options, [[], ...panel.series.map(() => [])], place);
    made.over.addEventListener("wheel", (event) => {
      event.preventDefault();
      const at = made.posToVal(event.offsetX, "x"), factor = event.deltaY < 0 ? 0.7 : 1 / 0.7;
      this.go(at - (at - this.begin) * factor, at + (this.end - at) * factor);
    }, { passive: false });
    made.over.addEventListener("dblclick", () => this.go(...this.whole));
    let pressed = 0;
    made.over.addEventListener("click", (event) => {
      if (this.mode() === "move" || Math.abs(event.clientX - pressed) > CLICK) return;
      const time = made.posToVal(event.offsetX, "x");
      this.picks?.(time, time, this.mode(), true);
    });
    made.over.addEventListener("pointerdown", (event) => {
      pressed = event.clientX;
      if (this.mode() === "move") this.grip = { x: event.clientX, width: made.over.clientWidth, begin: this.begin, end: this.end };
    });
    return made;
  }

  pull(event) {
    if (!this.grip) return;
    const shift = (this.grip.x - event.clientX) / this.grip.width * (this.grip.end - this.grip.begin);
    this.go(this.grip.begin + shift, this.grip.end + shift);
  }

  selected(plot) {
    const { left, width } = plot.select, name = this.mode();
    if (plot.select.width || plot.select.height) plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
    if (name === "move" || width <= CLICK) return;
    const [begin, end] = [left, left + width].map((at) => Math.min(Math.max(plot.posToVal(at, "x"), this.whole[0]), this.whole[1]));
    this.picks?.(begin, end, name, false);
  }

  key(event) {
    if (event.target.matches("input, select, textarea") || event.ctrlKey || event.metaKey || event.altKey) return;
    const part = 0.25 * (this.end - this.begin);
    const moves = { ArrowLeft: [-part, -part], ArrowRight: [part, part], "+": [part, -part], "=": [part, -part], "-": [-part, part] };
    if (moves[event.key]) this.go(this.begin + moves[event.key][0], this.end + moves[event.key][1]);
    else if (event.key === "0" || event.key === "Home") this.go(...this.whole);
    else return;
    event.preventDefault();
    this.hover?.((this.begin + this.end) / 2);
  }

  /** Show another window, within the whole. */
  go(begin, end) {
    const [first, last] = this.whole, span = Math.min(Math.max(end - begin, 1e-9 * (last - first)), last - first);
    this.begin = Math.min(Math.max(begin, first), last - span);
    this.end = this.begin + span;
    this.moved?.(this.begin, this.end);
    this.fetch();
  }

  show() {
    this.plots.forEach((plot, number) => plot.setData([this.rows[0], ...this.panels[number].series.map((s) => this.rows[s.row])]));
  }

  redraw() { this.plots.forEach((plot) => plot.redraw(false)); }

  close() {
    this.observer.disconnect();
    removeEventListener("pointermove", this.pulled);
    removeEventListener("pointerup", this.released);
    document.removeEventListener("redraw", this.again);
    this.plots.forEach((plot) => plot.destroy());
    refill(this.host);
  }
}

/** Shade a stretch of time, hatched where it has to read without colour. */
export function shade(plot, begin, end, color, { hatch = 0, label = "" } = {}) {
  const { left, top, width, height } = plot.bbox, context = plot.ctx, ratio = devicePixelRatio || 1;
  const a = Math.max(plot.valToPos(begin, "x", true), left), b = Math.min(plot.valToPos(end, "x", true), left + width);
  if (b <= a) return;
  context.save();
  context.beginPath(); context.rect(a, top, b - a, height); context.clip();
  context.fillStyle = context.strokeStyle = color;
  context.globalAlpha = 0.16; context.fillRect(a, top, b - a, height);
  context.globalAlpha = 0.7; context.lineWidth = ratio;
  for (let x = a - height; hatch && x < b; x += hatch * ratio) {
    context.beginPath(); context.moveTo(x, top + height); context.lineTo(x + height, top); context.stroke();
  }
  if (label && b - a > 40 * ratio) { context.globalAlpha = 1; context.font = `${12 * ratio}px system-ui`; context.fillText(label, a + 4 * ratio, top + 14 * ratio); }
  context.restore();
}

/** A canvas with axes that stays in its host and draws itself again; draw(context, x, y) gets the functions from values
    to pixels.

    x, y: {label, range: [low, high], log, size: of the unit of the label}. Returns the canvas and the ways back from pixels to values. */
export function picture(host, options) {
  if (!host.picture || !host.contains(host.picture.canvas)) {
    const canvas = element("canvas", { role: "img" });
    refill(host, element("div", { class: "plot" }, canvas), keep(`${options.y.label || host.id} over ${options.x.label}`, () => [canvas]));
    host.picture = { canvas };
    const again = () => { if (host.isConnected) drawn(host.picture, host); else document.removeEventListener("redraw", again); };
    document.addEventListener("redraw", again);
  }
  return drawn(Object.assign(host.picture, { options }), host);
}

function drawn(made, host) {
  const { canvas, options: { x, y, height = 280, draw } } = made;
  const width = Math.max(host.clientWidth - 2, 220), ratio = devicePixelRatio || 1, [bottom, top, right] = [42, 10, 12];
  canvas.width = width * ratio; canvas.height = height * ratio;
  canvas.style.width = `${width}px`; canvas.style.height = `${height}px`;
  canvas.setAttribute("aria-label", `${y.label} over ${x.label}`);
  const context = canvas.getContext("2d");
  context.scale(ratio, ratio);
  const along = (axis, from, to) => {
    const f = axis.log ? Math.log : (v) => v, g = axis.log ? Math.exp : (v) => v, [low, high] = axis.range.map(f);
    const size = high - low || 1;
    return { to: (v) => from + (f(v) - low) / size * (to - from), back: (p) => g(low + (p - from) / (to - from) * size) };
  };
  const rungs = y.names ? [] : ticks(y, 5);
  context.font = "12px system-ui";
  const left = Math.max(62, 28 + Math.max(...rungs.map(([, text]) => context.measureText(text).width)));
  const across = along(x, left, width - right), up = along(y, height - bottom, top);
  context.strokeStyle = style("--line"); context.fillStyle = style("--ink");
  const stroke = (...points) => { context.beginPath(); context.moveTo(points[0], points[1]); context.lineTo(points[2], points[3]); context.stroke(); };
  context.textAlign = "center";
  for (const [v, text] of ticks(x, width < 400 ? 4 : 7)) {
    stroke(across.to(v), top, across.to(v), height - bottom);
    context.fillText(text, across.to(v), height - bottom + 15);
  }
  context.fillText(x.label, (left + width - right) / 2, height - 6);
  context.textAlign = "right";
  for (const [v, text] of rungs) {
    stroke(left, up.to(v), width - right, up.to(v));
    context.fillText(text, left - 5, up.to(v) + 4);
  }
  context.save();
  context.translate(13, (top + height - bottom) / 2); context.rotate(-Math.PI / 2); context.textAlign = "center"; context.fillText(y.label, 0, 0);
  context.restore();
  context.save();
  context.beginPath(); context.rect(left, top, width - right - left, height - bottom - top); context.clip();
  draw(context, across.to, up.to);
  context.restore();
  context.strokeRect(left, top, width - right - left, height - bottom - top);
  return Object.assign(made, { x: across.back, y: up.back });
}

/** Values and texts along an axis. */
function ticks({ range, log, size: unit = 1 }, count) {
  const [low, high] = range.map((end) => end / unit), out = [], decades = Math.log10(high / low);
  if (log && decades > 0.5) {
    const from = Math.floor(Math.log10(low)), to = Math.ceil(Math.log10(high));
    for (let e = from; e <= to; e += Math.max(1, Math.ceil((to - from) / count))) for (const m of decades > 2.5 ? [1] : [1, 2, 5]) out.push(m * 10 ** e);
    return out.filter((v) => v >= low * 0.999 && v <= high * 1.001).map((v) => [v * unit, plain(v, 3)]);
  }
  const raw = (high - low) / count || 1, size = 10 ** Math.floor(Math.log10(raw)), step = [1, 2, 5, 10].find((m) => m * size >= raw) * size;
  for (let v = Math.ceil(low / step) * step; v <= high + 1e-9 * step; v += step) out.push(Math.abs(v) < 1e-12 * step ? 0 : v);
  const digits = Math.max(3, Math.ceil(Math.log10(Math.max(Math.abs(low), Math.abs(high)) / step)) + 1);
  return out.map((v) => [v * unit, plain(v, digits)]);
}

/** Lowest and highest of finite values, with a margin. */
export function span(values, { margin = 0.05, log = false } = {}) {
  let low = Infinity, high = -Infinity;
  for (const v of values) if (v !== null && Number.isFinite(v) && (!log || v > 0)) { low = Math.min(low, v); high = Math.max(high, v); }
  if (low > high) return log ? [0.1, 1] : [0, 1];
  if (log) return [low / (1 + margin), high * (1 + margin)];
  const more = high - low > 1e-2 * Math.abs(high) ? (high - low) * margin : Math.abs(high) * margin || 1;
  return [low - more, high + more];
}

/** A line through points, broken where a value is missing. */
export function line(context, xs, ys, x, y, color, { dash = [], width = HAIR } = {}) {
  context.save();
  context.strokeStyle = color; context.lineWidth = width; context.setLineDash(dash);
  context.beginPath();
  let pen = false;
  for (let i = 0; i < xs.length; i++) {
    const there = xs[i] !== null && ys[i] !== null && Number.isFinite(xs[i]) && Number.isFinite(ys[i]);
    if (there && pen) context.lineTo(x(xs[i]), y(ys[i])); else if (there) context.moveTo(x(xs[i]), y(ys[i]));
    pen = there;
  }
  context.stroke();
  context.restore();
}

/** A mark that differs by shape: circle, square, diamond, cross. */
export function mark(context, x, y, color, shape = "circle", size = 4) {
  context.save();
  context.fillStyle = context.strokeStyle = color; context.lineWidth = 1.5;
  context.beginPath();
  if (shape === "circle") context.arc(x, y, size, 0, 2 * Math.PI);
  else if (shape === "square") context.rect(x - size, y - size, 2 * size, 2 * size);
  else if (shape === "diamond") { context.moveTo(x, y - size - 1); context.lineTo(x + size + 1, y); context.lineTo(x, y + size + 1); context.lineTo(x - size - 1, y); context.closePath(); }
  else { context.moveTo(x - size, y - size); context.lineTo(x + size, y + size); context.moveTo(x + size, y - size); context.lineTo(x - size, y + size); }
  if (shape === "cross") context.stroke(); else context.fill();
  context.restore();
}
