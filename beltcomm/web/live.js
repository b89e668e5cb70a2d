// A session in this folder, or the virtual one that is started here, while it lasts.  Nothing here moves a machine.

import { chart, element, number } from "./chart.js";

const $ = (id) => document.getElementById(id);
const HEADLINE = /^ {2}[A-Z]{4}[A-Z ]* {3}\S/, ENDS = { 0: "The session is done.", 1: "The session is done: a target is missed, or the model does not explain the data.", 4: "The session was stopped; what was recorded is kept." };

export function live(ask) {
  let plots = null, timer = 0, session = { name: "", running: false, lines: [] }, offered = false, shown = "", drawnSession = "";

  function make() {
    const time = { label: "time in the record, s" };
    plots = {
      torque: chart($("live-charts"), { title: "Torque at the motor", name: "live-torque", x: time, y: { label: "N m" }, height: 190, sync: "live", quiet: true, series: [{ name: "torque", look: "first" }] }),
      place: chart($("live-charts"), { title: "Position", name: "live-position", x: time, y: { label: "" }, height: 190, sync: "live", quiet: true, series: [{ name: "position", look: "second" }] }),
      response: chart($("live-charts"), { title: "Frequency response", name: "live-response", quiet: true, x: { label: "frequency, Hz", log: true }, y: { label: "dB re 1 rad/(N m)" }, height: 220, series: [{ name: "newest", look: "first", dots: true, size: 4 }, { name: "one before", look: "second", dots: true, size: 3 }] }),
    };
  }

  function meter(name, gauge) {
    const share = gauge ? Math.min(gauge.value / gauge.limit, 1) : 0;
    $(`meter-${name}`).style.width = `${100 * share}%`;
    $(`meter-${name}`).className = share > 0.9 ? "high" : "";
    $(`value-${name}`).textContent = gauge ? `${number(gauge.value)} of ${number(gauge.limit)} ${gauge.unit}` : "";
  }

  // ---- the virtual session of this page

  async function offers() {
    const found = await ask("session-offers"), options = (some) => Object.entries(some).map(([value, words]) => element("option", { value }, words));
    $("session-kind").replaceChildren(...options(found.kinds));
    $("session-drive").replaceChildren(...options(found.drives));
    offered = true;
  }

  function drawSession() {
    const told = JSON.stringify(session);
    if (told === drawnSession) return; // a link stays where it is while somebody is about to click it
    drawnSession = told;
    $("session-start").disabled = session.running;
    $("session-ending").hidden = !session.running;
    $("session-stop").disabled = session.stopping;
    $("session-end").hidden = session.running || !session.name;
    if (session.command) $("session-words").replaceChildren(session.stopping ? "Stopping … " : session.running ? "This runs: " : "This ran: ", element("code", {}, session.command));
    if (session.running || !session.name) return;
    const answer = session.lines.lastIndexOf("", session.lines.length - 3), from = session.lines.findLastIndex((line) => HEADLINE.test(line));
    $("session-verdict").textContent = ENDS[session.code] || "The session could not go on.";
    $("session-verdict").className = session.code ? "bad" : "good";
    $("session-open").hidden = !session.made;
    $("session-open").replaceChildren(element("a", { href: `?run=${encodeURIComponent(session.name)}#laboratory` }, `Open ${session.name} on this page`), " It stands under Runs, too.");
    $("session-lines").textContent = session.lines.slice(from >= 0 ? from : Math.max(answer, session.lines.length - 12)).join("\n").trimEnd();
  }

  async function start(event) {
    event.preventDefault();
    $("session-start").disabled = true;
    try {
      session = await ask("session-start", { kind: $("session-kind").value, drive: $("session-drive").value, realtime: $("session-realtime").checked });
      drawSession();
      again();
    } catch (problem) {
      $("session-words").textContent = problem.message;
      $("session-start").disabled = false;
    }
  }

  $("session").addEventListener("submit", start);
  $("session-stop").addEventListener("click", async () => {
    $("session-stop").disabled = true;
    session = await ask("session-stop");
    drawSession();
  });

  // ---- what a run shows while it grows

  function words(found, record, running) {
    const planned = found.planned_s, elapsed = (Number.parseFloat(found.lines.at(-1)) || 0) + (record ? record.t_s.at(-1) : 0), left = Math.max(planned - elapsed, 0);
    const whose = session.name === shown && shown ? `The virtual session in ${shown}` : "A session";
    const made = `${found.done.length} record${found.done.length === 1 ? " is" : "s are"} finished.`;
    $("live-words").textContent = running ? `${whose} is at work. ${made}` : session.name === shown && shown ? `${whose} is over. ${made}` : found.done.length ? `No session is at work in this run; ${made} A session that is begun in a terminal, by \`beltcomm commission\`, is shown by \`beltcomm open\` on its run while it lasts.` : "No session is at work in this run.";
    $("phase").hidden = !running || !found.phase;
    if (!running || !found.phase) {
      if ($("headline").dataset.live) dispatchEvent(new Event("saved")); // what the run is now is told anew
      delete $("headline").dataset.live;
      return;
    }
    $("headline").dataset.live = "yes";
    $("headline").className = "told note";
    $("headline").replaceChildren(element("b", {}, "IN PROGRESS"), ` ${found.phase.title}, ${found.phase.number} of ${found.phase.count}`); $("warnings").replaceChildren(); $("next").replaceChildren();
    $("headline").hidden = false;
    $("phase-words").textContent = `${found.phase.number}/${found.phase.count} ${found.phase.title}${record ? `: ${record.name}` : ""}`;
    $("phase-share").value = planned ? Math.min(elapsed / planned, 1) : 0;
    $("phase-left").textContent = planned ? `${Math.round(left)} of ${Math.round(planned)} s in motion left` : "";
  }

  async function look() {
    if (!offered) await offers();
    session = await ask("session-state");
    drawSession();
    shown = session.name;
    if (shown && !session.made) {
      $("live-words").textContent = session.running ? "The virtual session is being prepared …" : "The virtual session made no run.";
      return;
    }
    const found = shown ? await ask("live-state", {}, shown) : await ask("live-state");
    if (!plots) make();
    const { record } = found, running = shown ? session.running : found.running;
    words(found, record, running);
    $("journal").textContent = found.lines.join("\n");
    $("planned").hidden = !found.experiments.length;
    $("steps").replaceChildren(...found.experiments.map((one) => element("li", {}, `${one.title}, ${Math.round(one.seconds)} s`)));
    $("made").replaceChildren(...found.done.map((name) => element("li", {}, name)), ...(record ? [element("li", { className: "now" }, `${record.name} …`)] : []));
    // Between two records the last one stays: what comes and goes every second is not read.
    for (const one of [plots.torque, plots.place]) one.figure.hidden = !running || (!record && !one.data);
    $("now").hidden = !running || (!record && $("now").hidden);
    if (record) {
      const [low, high] = found.travel_mm || [null, null], at = record.position.at(-1);
      $("carriage").hidden = low === null;
      if (low !== null) $("carriage").style.left = `${100 * Math.min(Math.max((at - low) / (high - low), 0), 1)}%`;
      $("window-words").textContent = low === null ? "" : `${number(low)} to ${number(high)} mm, now at ${number(at)} mm`;
      for (const name of ["torque", "belt", "speed"]) meter(name, record.gauges[name]);
      for (const one of [plots.torque, plots.place]) one.spec.of = record.name;
      plots.torque.set([record.t_s, record.torque]);
      plots.place.spec.y.label = record.unit;
      plots.place.set([record.t_s, record.position]);
    }
    const drawn = found.responses.filter((one) => one.db), [before, newest] = drawn.length > 1 ? drawn.slice(-2) : [null, drawn.at(-1)];
    plots.response.figure.hidden = !newest;
    if (newest) {
      plots.response.figure.querySelector("figcaption span").replaceChildren("Frequency response", ...[["first", newest], ["second", before]].flatMap(([look, one]) => (one ? [element("i", { className: `dot ${look}` }), ` ${one.name}${one.periods ? `, ${one.periods} periods so far` : ""}`] : [])));
      const joined = uPlot.join([[newest.freq_hz, newest.db], ...(before ? [[before.freq_hz, before.db]] : [])]);
      plots.response.set(before ? joined : [...joined, joined[0].map(() => null)]);
    }
  }

  function again() {
    clearTimeout(timer);
    if ($("live").hidden) return;
    look().catch((problem) => { $("live-words").textContent = problem.message; }).finally(() => { timer = setTimeout(again, document.hidden ? 3000 : 400); });
  }

  return { show: again };
}
