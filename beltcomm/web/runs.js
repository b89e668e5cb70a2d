// The runs of one axis side by side, their curves laid over each other, and how each quantity went.

import { chart, element, number } from "./chart.js";

const $ = (id) => document.getElementById(id);
const LOOKS = ["first", "second", "chosen", "good", "soft", "ink"], HOUR = 3600, STEPS = [60, 300, 900, HOUR, 3 * HOUR, 6 * HOUR, ...[1, 2, 7, 14, 30, 91, 182, 365, 730].map((days) => 24 * HOUR * days)];

export function runs(ask) {
  let trend = null, found = null, laid = [], picked = null, asked = 0;

  const day = (seconds, from = 0, to = 16) => new Date(1e3 * seconds).toISOString().slice(from, to).replace("T", " ");

  function table() {
    const keys = [...new Set(found.runs.flatMap((one) => Object.keys(one.quantities)))];
    const words = Object.fromEntries(keys.map((key) => [key, found.runs.find((one) => one.quantities[key]).quantities[key]]));
    const added = found.runs.some((one) => one.added.length);
    const rows = found.runs.map((one) => {
      const box = element("input", { type: "checkbox", checked: picked.includes(one.name) });
      box.setAttribute("aria-label", `lay the curves of ${one.name} over the others`);
      box.addEventListener("change", () => {
        picked = box.checked ? [...picked, one.name].slice(-LOOKS.length) : picked.filter((name) => name !== one.name);
        for (const row of rows) row.firstChild.firstChild.checked = picked.includes(row.dataset.run);
        overlay().catch(problem);
      });
      const row = element("tr", { className: one.own ? "own" : "" }, element("td", {}, box), element("td", {}, one.own ? one.name : element("a", { href: `?run=${encodeURIComponent(one.name)}#laboratory` }, one.name)),
        element("td", { className: one.dated ? "" : "undated", title: one.dated ? "" : "by its files: the drive of this run knows no date" }, day(one.began_s)), element("td", {}, one.drive), element("td", { className: "number" }, one.ratio === null ? "" : one.ratio.toFixed(2)),
        element("td", { className: one.result.means }, one.result.word), ...(added ? [element("td", {}, one.added.join(", ").replaceAll("_", " "))] : []),
        ...keys.map((key) => { const q = one.quantities[key]; return element("td", { className: "number" }, q ? number(q.value, 4) + (q.interval === null ? "" : ` ± ${number(q.interval, 2)}`) : ""); }));
      row.dataset.run = one.name;
      return row;
    });
    $("beside").replaceChildren(element("thead", {}, element("tr", {}, ...["", "run", "begun", "drive", "error × noise", "result", ...(added ? ["added"] : [])].map((t) => element("th", {}, t)), ...keys.map((key) => element("th", { className: "number" }, words[key].words, element("br"), words[key].unit)))),
      element("tbody", {}, ...rows));
    $("quantity").replaceChildren(...keys.map((key) => element("option", { value: key }, `${words[key].words}, ${words[key].unit}`)));
  }

  // ---- curves of several runs on one scale

  async function overlay() {
    const mine = ++asked, told = await ask("runs-curves", { names: found.runs.map((one) => one.name).filter((name) => picked.includes(name)) });
    if (mine !== asked) return;
    for (const one of laid) one.remove();
    laid = [];
    const draw = (title, name, of, x, y, dots) => {
      const some = told.runs.filter((one) => one[of]);
      if (!some.length) return;
      const one = chart($("overlay"), { title, name, x, y, height: 260, series: some.map((run) => ({ name: run.name, look: LOOKS[told.runs.indexOf(run)], dots, size: 4, width: 1.5 })) });
      one.set(uPlot.join(some.map((run) => [run[of][x.key], run[of][y.key]])));
      laid.push(one);
    };
    draw("Frequency response at standstill, measured", "responses", "response", { key: "freq_hz", label: "frequency, Hz", log: true }, { key: "db", label: "dB re 1 rad/(N m)" }, true);
    draw("Error of the last move, at the motor", "move-errors", "move", { key: "t_s", label: "time in the move, s" }, { key: "error_mm", label: "reference − position, mm" }, false);
    const without = told.runs.filter((one) => !one.move).map((one) => one.name);
    $("overlay-words").textContent = (told.runs.length ? "" : "Tick runs in the table.") + (laid.length && without.length ? ` No move was driven in ${without.join(", ")}.` : "") + (told.runs.length && !laid.length ? " These runs hold neither a response at standstill nor a move." : "");
  }

  // ---- trend

  function drawTrend() {
    const key = $("quantity").value, some = found.runs.filter((one) => one.quantities[key]), dates = $("over").value === "date";
    trend?.remove();
    trend = null;
    $("trend-words").textContent = some.length < 2 ? "A trend needs two runs that know this quantity." : `${dates ? "" : `${some.map((one, k) => `${k + 1}: ${one.name}`).join("; ")}. `}Dotted: 95 % interval. \`beltcomm trend\` says what drifts and when a limit is reached.`;
    if (some.length < 2) return;
    const q = some.map((one) => one.quantities[key]), xs = dates ? some.map((one) => one.began_s) : some.map((_, k) => k + 1), gap = dates ? 0.04 * Math.max(xs.at(-1) - xs[0], 60) : 0.5;
    trend = chart($("trend"), { title: q[0].words, name: `trend-${key}`, height: 240, quiet: true, y: { label: q[0].unit },
      x: { label: !dates ? "run" : day(xs[0], 0, 10) === day(xs.at(-1), 0, 10) ? `begun, UTC, ${day(xs[0], 0, 10)}` : "begun, UTC", range: [xs[0] - gap, xs.at(-1) + gap], incrs: dates ? STEPS : [1, 2, 5, 10], space: dates ? 80 : 50,
        values: (u, splits) => splits.map((v) => (!dates ? v : xs.at(-1) - xs[0] > 72 * HOUR ? day(v, 0, 10) : day(v, day(xs[0], 0, 10) === day(xs.at(-1), 0, 10) ? 11 : 5))) },
      series: [{ name: "value", look: "first" }, { name: "run", look: "first", dots: true, size: 8 }, { name: "95 % low", look: "soft", width: 1, dash: [2, 3] }, { name: "95 % high", look: "soft", width: 1, dash: [2, 3] }] });
    const end = (sign) => q.map((one) => (one.interval === null ? null : one.value + sign * one.interval));
    trend.set([xs, q.map((one) => one.value), q.map((one) => one.value), end(-1), end(1)]);
  }

  const problem = (error) => { $("runs-words").textContent = error.message; };
  for (const id of ["quantity", "over"]) $(id).addEventListener("change", drawTrend);

  async function show() {
    try {
      found = await ask("runs-list");
    } catch (error) {
      problem(error);
      return;
    }
    const chosen = $("quantity").value, names = found.runs.map((one) => one.name), own = found.runs.find((one) => one.own);
    picked = (picked || [...names.filter((name) => name !== own?.name).slice(-2), ...(own ? [own.name] : [])]).filter((name) => names.includes(name));
    $("runs-words").textContent = `${names.length} run${names.length === 1 ? "" : "s"} of ${found.axis || "this axis"} in this folder.` + (found.left_out.length ? ` Left out: ${found.left_out.join("; ")}.` : "") + (names.length > 1 ? " A click on a name opens that run here; `beltcomm report RUN --against OTHER` says what changed between two." : "");
    table();
    if (chosen && [...$("quantity").options].some((one) => one.value === chosen)) $("quantity").value = chosen;
    drawTrend();
    await overlay().catch(problem);
  }

  return { show };
}
