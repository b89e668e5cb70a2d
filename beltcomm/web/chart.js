// Charts by uPlot: colours of the page, width of their place, export of picture and numbers; the same way for all tabs.

import { said } from "./words.js";

const charts = new Set();

export function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name in made) made[name] = value;
    else made.setAttribute(name, value);
  }
  made.append(...children);
  return made;
}

export const floats = (text) => new Float32Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);

export const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

export function number(value, digits = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "none";
  return Math.abs(value) >= 100 && digits === 3 ? value.toFixed(0) : String(Number(value.toPrecision(digits)));
}

/** An error in mm as every screen has it: three digits, none finer than a tenth of a micrometre; below a micrometre two. */
export function mm(value_m) {
  const value = 1e3 * value_m;
  return Math.abs(value) < 1e-3 ? number(value, 2) : number(Number(Number(value.toPrecision(3)).toFixed(4)));
}

// In units of another kind of axis numbers are multiplied where they are written; what is drawn stays.
const timesOf = (which, v) => (v === null || v === undefined ? v : v * (which.factor || 1));

// Even steps in the unit that is written.
const steps = (which) => (u, k, low, high, found) => {
  const wanted = found * which.factor, ten = 10 ** Math.floor(Math.log10(wanted) + 1e-9), step = [1, 2, 5, 10].find((one) => one * ten >= 0.999 * wanted) * ten / which.factor;
  return Array.from({ length: Math.floor(high / step + 1e-9) - Math.ceil(low / step - 1e-9) + 1 }, (_, i) => (Math.ceil(low / step - 1e-9) + i) * step);
};

// Labels of an axis with as many digits as tell one from the next.
const even = (which) => (u, drawn) => {
  const splits = drawn.map((v) => timesOf(which, v)), known = splits.filter((v) => v !== null), step = known.length > 1 ? Math.abs(known[1] - known[0]) : 1, digits = Math.min(Math.max(Math.ceil(-Math.log10(step) - 1e-6), 0), 6);
  return splits.map((v) => (v === null ? "" : v.toFixed(Math.abs(step * 10 ** digits - Math.round(step * 10 ** digits)) > 1e-6 ? digits + 1 : digits)));
};

// Thousands of small dots as squares: circles take ten times as long, and nobody sees the difference.
const SPECK = 3;
function specks(u, k, look, size) {
  const { ctx, bbox } = u, { x, y } = u.scales, [from, to] = u.series[0].idxs, xs = u.data[0], ys = u.data[k], side = size * devicePixelRatio, linear = x.distr === 1 && y.distr === 1;
  const wide = bbox.width / (x.max - x.min), high = bbox.height / (y.max - y.min), left = bbox.left - 0.5 * side, base = bbox.top + bbox.height - 0.5 * side;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  ctx.fillStyle = look;
  for (let i = from; i <= to; i += 1) {
    if (ys[i] === null || ys[i] === undefined) continue;
    if (linear) ctx.fillRect(left + (xs[i] - x.min) * wide, base - (ys[i] - y.min) * high, side, side);
    else ctx.fillRect(u.valToPos(xs[i], "x", true) - 0.5 * side, u.valToPos(ys[i], "y", true) - 0.5 * side, side, side);
  }
  ctx.restore();
}

function kept(text, name, type) {
  const link = element("a", { href: URL.createObjectURL(text instanceof Blob ? text : new Blob([text], { type })), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 5000);
}

/* spec: title, name (of files), x and y: {label, log, range: [low, high] or a function of the data, values}, series: [{name, look: "first", width, dash, dots, size, hidden, gaps}],
   of: what it shows, behind the title in an export, overlay(u, ctx), onSelect(low, high) for a drag (shift still magnifies), sync: key of charts that share a cursor, height. */
export function chart(place, spec) {
  const box = element("div", { className: "chart" });
  const picture = element("button", { type: "button", title: "the picture as PNG" }, "PNG"), table = element("button", { type: "button", title: "the numbers as CSV" }, "CSV");
  const values = element("span", { className: "values" });
  const figure = element("figure", { className: spec.quiet ? "quiet" : "" }, element("figcaption", {}, element("span", {}, spec.title || ""), values, element("span", {}, picture, " ", table)), box);
  place.append(figure);
  const one = { spec, data: null, u: null, box, figure, width: 0 };

  one.build = () => {
    if (!one.data || !box.clientWidth) return;
    one.u?.destroy();
    one.width = box.clientWidth;
    const ink = colour("ink"), grid = { stroke: colour("grid"), width: 1 }, axis = (which) => ({
      label: which.label, labelSize: 20, stroke: ink, grid, ticks: { ...grid, size: 4 }, ...(which.incrs ? { incrs: which.incrs, space: which.space || 50 } : {}), font: `11px ${colour("font")}`, labelFont: `12px ${colour("font")}`, values: which.values || even(which), ...(which.factor && !which.log ? { splits: steps(which) } : {}),
      ...(which.log ? { filter: (u, splits) => splits.map((v) => ([1, 2, 5].includes(Math.round(v / 10 ** Math.floor(Math.log10(v) + 1e-9))) ? v : null)), values: (u, splits) => splits.map((v) => (v === null ? "" : String(Number(timesOf(which, v).toPrecision(3))))) } : {}),
    });
    const scale = (which) => ({ time: false, distr: which.log ? 3 : 1, ...(which.range ? { range: typeof which.range === "function" ? which.range : () => which.range } : {}) });
    let shifted = false;
    one.u = new uPlot({
      width: one.width, height: spec.height || Math.round(Math.min(Math.max(0.52 * one.width, 180), 280)),
      legend: { live: true, markers: { width: 2, stroke: (u, i) => (i && spec.series[i - 1].dots ? "transparent" : colour(spec.series[i - 1]?.look || "soft")), fill: (u, i) => (i && spec.series[i - 1].dots ? colour(spec.series[i - 1].look) : "transparent"), dash: (u, i) => (i && spec.series[i - 1].dash ? "dotted" : "solid") } },
      scales: { x: scale(spec.x), y: scale(spec.y) },
      axes: [{ ...axis(spec.x), size: 34 }, { ...axis(spec.y), size: 52 }],
      cursor: { drag: { x: true, y: false, setScale: !spec.onSelect }, sync: spec.sync ? { key: spec.sync } : undefined, points: { size: 6 }, focus: { prox: 24 },
        bind: { mousedown: (u, target, handler) => (event) => { shifted = event.shiftKey; handler(event); } } },
      series: [{ label: spec.x.label, value: (u, v) => (v === null ? "" : number(timesOf(spec.x, v), 4)) }, ...spec.series.map((s) => ({
        label: s.name, stroke: colour(s.look), width: s.dots ? 0 : s.width || 2, dash: s.dash, spanGaps: !s.gaps, show: !s.hidden,
        paths: s.dots ? () => null : undefined,
        points: { show: Boolean(s.dots) && s.size > SPECK, size: s.size || 3, fill: colour(s.look), stroke: colour(s.look), width: 0 },
        value: (u, v) => (v === null || v === undefined ? "" : number(timesOf(spec.y, v), 4)),
      }))],
      hooks: {
        drawSeries: [(u, k) => { const s = spec.series[k - 1]; if (s?.dots && u.series[k].show && s.size <= SPECK) specks(u, k, colour(s.look), s.size); }],
        draw: spec.overlay ? [(u) => { u.ctx.save(); u.ctx.beginPath(); u.ctx.rect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height); u.ctx.clip(); spec.overlay(u, u.ctx); u.ctx.restore(); }] : [],
        // Without a legend the values under the pointer stand in the caption.
        setCursor: spec.quiet ? [(u) => {
          const i = u.cursor.idx;
          values.textContent = i === null || i === undefined ? "" : u.series.map((s, k) => (k === 0 ? number(timesOf(spec.x, u.data[0][i]), 4) : u.data[k][i] === null || u.data[k][i] === undefined ? "" : `${s.label} ${number(timesOf(spec.y, u.data[k][i]))}`)).filter(Boolean).join(" · ");
        }] : [],
        setSelect: spec.onSelect ? [(u) => {
          if (u.select.width < 3) return;
          const low = u.posToVal(u.select.left, "x"), high = u.posToVal(u.select.left + u.select.width, "x");
          u.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
          if (shifted) u.setScale("x", { min: low, max: high });
          else spec.onSelect(low, high);
        }] : [],
      },
    }, one.data, box);
    box.setAttribute("role", "img");
    box.setAttribute("aria-label", `${spec.title || spec.y.label}: ${spec.series.map((s) => s.name).join(", ")} over ${spec.x.label}`);
  };
  for (const which of [spec.x, spec.y]) said(which.label, (_, [label, factor]) => { which.label = label; if (factor !== 1) which.factor = factor; if (one.u) one.build(); });
  one.set = (data, keepScales = false) => {
    one.data = data;
    if (!one.u || box.clientWidth !== one.width) one.build();
    else {
      one.u.setData(data, !keepScales);
      if (keepScales) one.u.redraw(true, false);
    }
  };
  one.remove = () => { one.u?.destroy(); figure.remove(); charts.delete(one); };
  picture.addEventListener("click", () => {
    const own = one.u.ctx.canvas, px = devicePixelRatio, top = 40 * px, whole = element("canvas", { width: own.width, height: own.height + top }), ctx = whole.getContext("2d");
    ctx.fillStyle = colour("paper");
    ctx.fillRect(0, 0, whole.width, whole.height);
    ctx.drawImage(own, 0, top);
    // Away from the page a picture must say itself what it is.
    const write = (words, x, y, look, weight = "") => { ctx.font = `${weight} ${11 * px}px ${colour("font")}`; ctx.fillStyle = colour(look); ctx.fillText(words, x, y * px); return x + ctx.measureText(words).width + 12 * px; };
    write(document.title.replace("beltcomm – ", ""), write([spec.title || spec.y.label, spec.of].filter(Boolean).join(", "), 6 * px, 14, "ink", "bold"), 14, "soft");
    spec.series.reduce((x, s, k) => (one.u.series[k + 1].show && one.data[k + 1].some((v) => v !== null && v !== undefined) ? write(`${s.dots ? "●" : s.dash ? "┄" : "━"} ${s.name}`, x, 32, s.look) : x), 6 * px);
    whole.toBlob((blob) => kept(blob, `${spec.name || "picture"}.png`));
  });
  table.addEventListener("click", () => {
    const head = [spec.x.label, ...spec.series.map((s) => s.name)].map((name) => `"${name.replaceAll('"', "'")}"`);
    kept([head.join(","), ...one.data[0].map((x, i) => [timesOf(spec.x, x), ...one.data.slice(1).map((y) => timesOf(spec.y, y[i]) ?? "")].join(","))].join("\n") + "\n", `${spec.name || "numbers"}.csv`, "text/csv");
  });
  charts.add(one);
  return one;
}

// A line through points that are no series: means, marks.
export function line(u, ctx, xs, ys, stroke, width = 2, dash = []) {
  ctx.strokeStyle = stroke;
  ctx.lineWidth = width * devicePixelRatio;
  ctx.setLineDash(dash.map((part) => part * devicePixelRatio));
  ctx.beginPath();
  let pen = false;
  xs.forEach((x, i) => {
    if (ys[i] === null || !Number.isFinite(ys[i])) { pen = false; return; }
    const [px, py] = [u.valToPos(x, "x", true), u.valToPos(ys[i], "y", true)];
    if (pen) ctx.lineTo(px, py); else ctx.moveTo(px, py);
    pen = true;
  });
  ctx.stroke();
}

export const horizontal = (u, ctx, y, stroke, dash = [4, 3]) => line(u, ctx, [u.scales.x.min, u.scales.x.max], [y, y], stroke, 1, dash);
export function vertical(u, ctx, x, words, stroke, row = 0) {
  const px = u.valToPos(x, "x", true);
  ctx.strokeStyle = ctx.fillStyle = stroke;
  ctx.lineWidth = devicePixelRatio;
  ctx.setLineDash([2 * devicePixelRatio, 3 * devicePixelRatio]);
  ctx.beginPath();
  ctx.moveTo(px, u.bbox.top);
  ctx.lineTo(px, u.bbox.top + u.bbox.height);
  ctx.stroke();
  ctx.font = `${11 * devicePixelRatio}px ${colour("font")}`;
  ctx.textBaseline = "top";
  ctx.textAlign = "left"; // whole: cut in front, 12.4 reads 2.4
  const wide = ctx.measureText(` ${words} `).width, left = Math.max(Math.min(px, u.bbox.left + u.bbox.width - wide), u.bbox.left);
  const top = u.bbox.top + (3 + 14 * row) * devicePixelRatio;
  ctx.fillStyle = colour("paper"); // no dot runs through the words
  ctx.fillRect(left + devicePixelRatio, top - devicePixelRatio, wide - 2 * devicePixelRatio, 13 * devicePixelRatio);
  ctx.fillStyle = stroke;
  ctx.fillText(` ${words} `, left, top);
}

// Charts of a view that is hidden are drawn when it is shown.
export const shown = () => { for (const one of charts) if (one.data && one.box.clientWidth && (!one.u || one.box.clientWidth !== one.width)) one.build(); };
const again = () => { for (const one of charts) one.width = 0; shown(); };
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", again);
// On paper: dark lines, and as wide as a sheet, whatever the screen has.
for (const kind of ["beforeprint", "afterprint"]) addEventListener(kind, () => { document.documentElement.toggleAttribute("data-printing", kind === "beforeprint"); again(); });
let waiting = 0;
new ResizeObserver(() => {
  clearTimeout(waiting);
  waiting = setTimeout(shown, 60);
}).observe(document.body);
