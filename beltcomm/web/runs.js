// The runs of one axis side by side, and how each quantity went.

import { chart, element, number } from "./chart.js";

const $ = (id) => document.getElementById(id);

export function runs(ask) {
  let plot = null, found = null;

  const day = (one) => (one.dated ? new Date(1e3 * one.began_s).toISOString().slice(0, 16).replace("T", " ") : "");

  function table() {
    const keys = [...new Set(found.runs.flatMap((one) => Object.keys(one.quantities)))];
    const words = Object.fromEntries(keys.map((key) => [key, found.runs.find((one) => one.quantities[key]).quantities[key]]));
    $("beside").replaceChildren(element("thead", {}, element("tr", {}, ...["run", "began", "drive", "error × noise", "move", "added"].map((t) => element("th", {}, t)), ...keys.map((key) => element("th", { className: "number" }, words[key].words, element("br"), words[key].unit)))),
      element("tbody", {}, ...found.runs.map((one) => element("tr", { className: one.own ? "own" : "" }, element("td", {}, one.own ? one.name : element("a", { href: `?run=${encodeURIComponent(one.name)}#laboratory` }, one.name)), element("td", {}, day(one)), element("td", {}, one.drive), element("td", { className: "number" }, number(one.ratio)),
        element("td", { className: one.passed ? "good" : one.passed === false ? "bad" : "" }, one.passed === null ? "" : one.passed ? "meets its targets" : "misses"), element("td", {}, one.effects.slice(6).join(", ")),
        ...keys.map((key) => { const q = one.quantities[key]; return element("td", { className: "number" }, q ? number(q.value, 4) + (q.interval === null ? "" : ` ± ${number(q.interval, 2)}`) : ""); })))));
    $("quantity").replaceChildren(...keys.map((key) => element("option", { value: key }, `${words[key].words}, ${words[key].unit}`)));
  }

  function draw() {
    const key = $("quantity").value, some = found.runs.filter((one) => one.quantities[key]);
    plot?.remove();
    plot = null;
    $("trend-words").textContent = some.length < 2 ? "A trend needs two runs that know this quantity." : `${some.map((one, k) => `${k + 1}: ${one.name}`).join("; ")}. \`beltcomm trend\` says what drifts and when a limit is reached.`;
    if (some.length < 2) return;
    const q = some.map((one) => one.quantities[key]);
    plot = chart($("trend"), { title: q[0].words, name: `trend-${key}`, x: { label: "run", range: [0.5, some.length + 0.5], values: (u, splits) => splits.map((v) => (Number.isInteger(v) ? v : "")) }, y: { label: q[0].unit }, height: 240, quiet: true,
      series: [{ name: "value", look: "first" }, { name: "run", look: "first", dots: true, size: 8 }, { name: "95 % low", look: "soft", width: 1, dash: [2, 3] }, { name: "95 % high", look: "soft", width: 1, dash: [2, 3] }] });
    plot.set([some.map((_, k) => k + 1), q.map((one) => one.value), q.map((one) => one.value), q.map((one) => (one.interval === null ? null : one.value - one.interval)), q.map((one) => (one.interval === null ? null : one.value + one.interval))]);
  }

  $("quantity").addEventListener("change", draw);

  async function show() {
    try {
      found = await ask("runs-list");
    } catch (problem) {
      $("runs-words").textContent = problem.message;
      return;
    }
    const chosen = $("quantity").value;
    $("runs-words").textContent = `${found.runs.length} run${found.runs.length === 1 ? "" : "s"} of ${found.axis || "this axis"} in this folder.` + (found.left_out.length ? ` Left out: ${found.left_out.join("; ")}.` : "") + (found.runs.length > 1 ? " A click on another one opens it here; in a terminal, `beltcomm report RUN --against OTHER` lays their curves over each other." : "");
    table();
    if (chosen && [...$("quantity").options].some((one) => one.value === chosen)) $("quantity").value = chosen;
    draw();
  }

  return { show };
}
