// A session in this folder, while it lasts.  It looks only: nothing here moves a machine.

import { chart, element, number } from "./chart.js";

const $ = (id) => document.getElementById(id);
const TITLES = { commission: "A session is at work in this run.", still: "No session is at work in this run; this is how it ended. A session is begun in a terminal, by beltcomm commission; `beltcomm open` on its folder then shows it here." };

export function live(ask) {
  let plots = null, timer = 0;

  function make() {
    const time = { label: "time in the record, s" };
    plots = {
      torque: chart($("live-charts"), { title: "Torque at the motor", name: "live-torque", x: time, y: { label: "N m" }, height: 190, sync: "live", series: [{ name: "torque", look: "first" }] }),
      place: chart($("live-charts"), { title: "Position", name: "live-position", x: time, y: { label: "" }, height: 190, sync: "live", series: [{ name: "position", look: "second" }] }),
      response: chart($("live-charts"), { title: "Frequency response, the newest record", name: "live-response", x: { label: "frequency, Hz", log: true }, y: { label: "dB re 1 rad/(N m)" }, height: 220, series: [{ name: "newest", look: "first", dots: true, size: 4 }, { name: "one before", look: "second", dots: true, size: 3 }] }),
    };
  }

  function meter(name, value, most, unit) {
    const share = most ? Math.min(Math.abs(value ?? 0) / most, 1) : 0;
    $(`meter-${name}`).style.width = `${100 * share}%`;
    $(`meter-${name}`).className = share > 0.9 ? "high" : "";
    $(`value-${name}`).textContent = value === null || value === undefined ? "" : `${number(value)}${most ? ` of ${number(most)}` : ""} ${unit}`;
  }

  async function look() {
    const found = await ask("live-state");
    if (!plots) make();
    const { record, limits } = found;
    const peak = (values) => Math.max(0, ...values.slice(-60).map(Math.abs));
    const elapsed = (Number.parseFloat(found.lines.at(-1)) || 0) + (record ? record.t_s.at(-1) : 0), planned = found.experiments.reduce((sum, one) => sum + one.seconds, 0), made = found.done.length;
    $("live-words").textContent = `${found.running ? TITLES.commission : TITLES.still} ${made} records are finished.` + (planned && found.running ? ` About ${number(Math.max(planned - elapsed, 0), 2)} of ${number(planned)} s in motion are left.` : "") + (record ? ` Now: ${record.name}, ${number(record.t_s.at(-1))} s.` : "");
    $("journal").textContent = found.lines.join("\n");
    $("steps").replaceChildren(...found.experiments.map((one) => element("li", {}, `${one.title}, ${number(one.seconds)} s`)));
    $("made").replaceChildren(...found.done.map((name) => element("li", {}, name)), ...(record ? [element("li", { className: "now" }, `${record.name} …`)] : []));
    for (const one of [plots.torque, plots.place]) one.figure.hidden = !record;
    const [low, high] = [limits.low_m ?? null, limits.high_m ?? null], at = record ? record.position.at(-1) : null;
    $("now").hidden = !record;
    $("carriage").hidden = at === null || low === null;
    if (at !== null && low !== null) $("carriage").style.left = `${100 * Math.min(Math.max((at - low) / (high - low), 0), 1)}%`;
    $("window-words").textContent = low === null ? "" : `${number(1e3 * low)} to ${number(1e3 * high)} mm` + (at === null ? "" : `, now at ${number(1e3 * at)} mm`);
    meter("torque", record ? peak(record.torque) : null, limits.torque_nm, "N m");
    meter("force", record && record.unit === "m" && record.ratio ? peak(record.torque) / record.ratio : null, limits.force_n, "N");
    meter("speed", record ? peak(record.speed) : null, limits.speed_m_s, record && record.unit === "rad" ? "rad/s" : "m/s");
    if (record) {
      plots.torque.set([record.t_s, record.torque]);
      plots.place.spec.y.label = record.unit;
      plots.place.set([record.t_s, record.position]);
    }
    const [before, newest] = found.responses.slice(-2).length === 2 ? found.responses.slice(-2) : [null, found.responses.at(-1)];
    if (newest) {
      const joined = uPlot.join([[newest.freq_hz, newest.db], ...(before ? [[before.freq_hz, before.db]] : [])]);
      plots.response.set(before ? joined : [...joined, joined[0].map(() => null)]);
    }
  }

  function again() {
    clearTimeout(timer);
    if ($("live").hidden) return;
    look().catch((problem) => { $("live-words").textContent = problem.message; }).finally(() => { timer = setTimeout(again, document.hidden ? 3000 : 500); });
  }

  return { show: again };
}
