// One record, measured and by the model: torque over time, frequency response.

import { chart, element, floats, number } from "./chart.js";

const $ = (id) => document.getElementById(id);
const BREAK = 180;

export function recordView(ask) {
  let found = null, plots = null, asked = 0, drawn = "";

  function make() {
    const hz = { label: "frequency, Hz", log: true, range: (u, low, high) => [low, high] }, both = [{ name: "measured", look: "second", dots: true, size: 3.5 }, { name: "model", look: "first", width: 1.5, gaps: true }];
    const word = { "N m": "torque", N: "force", A: "current", V: "voltage" }[found.units.force];
    plots?.forEach((one) => one.remove());
    plots = [
      chart($("record-charts"), { title: `Over time: ${word}`, name: "record-time", x: { label: "time in the record, s" }, y: { label: found.units.force }, height: 200, quiet: true, series: [{ name: "measured", look: "second", width: 3, gaps: true }, { name: "model", look: "first", width: 1, gaps: true }] }),
      chart($("record-charts"), { title: "Response: gain", name: "record-gain", x: hz, y: { label: "dB" }, height: 200, quiet: true, sync: "record", series: [...both, { name: "noise, 95 %", look: "soft", width: 1, dash: [2, 3] }] }),
      chart($("record-charts"), { title: "Response: phase", name: "record-phase", x: hz, y: { label: "degrees", range: [-370, 10] }, height: 200, quiet: true, sync: "record", series: both }),
    ];
  }

  // A new model: the same record again, where it is still there.
  async function draw(now) {
    found = now;
    const names = found.records.map((one) => one.name), before = $("record-name").value;
    $("record-name").replaceChildren(...names.map((name) => element("option", { value: name }, name)));
    $("record-name").value = names.includes(before) ? before : found.responses[0] || names[0];
    if (!plots || drawn !== found.units.force) make();
    drawn = found.units.force;
    await show();
  }

  async function show(name = $("record-name").value) {
    const mine = ++asked, told = await ask("laboratory-record", { record: name });
    if (mine !== asked) return;
    $("record-name").value = name;
    const time = floats(told.t_s), ends = (v, i) => (Number.isFinite(v) ? v : time[i - 1]), known = (text) => Array.from(floats(text), (v) => (Number.isFinite(v) ? v : null)); // a gap is no line
    for (const one of plots) one.spec.of = name;
    plots[0].set([Array.from(time, ends), known(told.measured), known(told.model)]);
    const own = found.records.find((one) => one.name === name), response = told.response;
    $("record-words").textContent = `${own.ratio.toFixed(2)} times the noise` + (own.plain ? `; error ${number(found.units.factor * own.plain.error)} ${found.units.small} rms, ${number(own.plain.percent)} % of the whole` : "") + (own.held_out ? "; held out, never fitted" : "") + "." + (told.excited ? "" : " Means of 20 ms; gaps where friction at rest leaves the torque open.") +
      (response ? ` Response: ${response.of}; model for the measured motion, friction included; dashed: the noise of the measurement, 95 %.` : " It holds no periodic excitation, so it has no frequency response.");
    for (const one of plots.slice(1)) one.figure.hidden = !response;
    if (!response) return;
    const whole = (deg) => deg.map((v, i) => (i && v !== null && deg[i - 1] !== null && Math.abs(v - deg[i - 1]) > BREAK ? null : v));
    plots[1].set([response.freq_hz, ...response.db, response.noise_db || response.freq_hz.map(() => null)]);
    plots[2].set([response.freq_hz, response.deg[0], whole(response.deg[1])]);
  }

  $("record-name").addEventListener("change", () => show().catch((problem) => { $("record-words").textContent = problem.message; }));
  return { draw, show };
}
