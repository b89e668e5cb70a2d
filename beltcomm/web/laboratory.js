// The laboratory: what the model leaves along every coordinate, linked; what could explain a part of it; adding and taking out.

import { chart, colour, element, floats, horizontal, line, mm, number, vertical } from "./chart.js";
import { recordView } from "./record.js";

const $ = (id) => document.getElementById(id);
const TITLES = { time: "time", position: "position", speed: "speed", angle: "motor angle", torque: "motor torque", frequency: "frequency" };
const WEIGHING = "still weighing what could explain it …", ROUNDED_S = 0.001, MEAN_BINS = 60, FEWEST = 3, CARDS = 3, LEAST_FALL = 0.005;

const bits = (text, count) => { const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0)); return Array.from({ length: count }, (_, i) => (bytes[i >> 3] >> (7 - (i & 7))) & 1); };

// How long each choice took, from the event to the drawing, ms: for whoever measures.
window.timings = { segment: [], add: [], update: [], track: [] };

export function laboratory(ask) {
  let found = null, cells = null, plots = {}, chosen = null, candidates = [], version = -1, known = -1, searched = false, cards = new Map(), began = 0, evidence = null, busy = false, failed = false, rungs = 0, choice = 0;
  const oneRecord = recordView(ask);

  // ---- what comes

  async function heard(state) {
    busy = Boolean(state.busy);
    if (state.version !== version && state.version > 0) {
      version = state.version;
      known = -1;
      await draw();
    }
    if (found && (state.candidates !== known || state.searched !== searched)) {
      known = state.candidates;
      searched = state.searched;
      if (chosen) await mark(chosen.along, chosen.low, chosen.high, chosen.record, true);
      else await whole();
    }
    if (found && state.rungs !== rungs) await drawStairs();
    rungs = state.rungs;
    if (JSON.stringify(state.evidence) !== JSON.stringify(evidence)) {
      evidence = state.evidence;
      drawEvidence();
    }
    if (state.failed && !failed && began) began = 0;
    failed = Boolean(state.failed);
    for (const button of document.querySelectorAll(".changes")) button.disabled = busy && !/^(weighing|what .* costs)/.test(state.busy);
  }

  async function draw() {
    found = await ask("laboratory-residual");
    cells = Object.fromEntries(Object.entries(found.cells).map(([name, text]) => [name, floats(text)]));
    chosen = null;
    drawModel();
    drawRecords();
    await drawStairs();
    drawResiduals();
    await oneRecord.draw(found);
    $("clear").disabled = true;
    $("low").value = $("high").value = $("explain-words").textContent = "";
    if (began) {
      window.timings.add.push(performance.now() - began);
      began = 0;
    }
    document.body.dataset.version = version;
  }

  async function whole() {
    const told = await ask("laboratory-candidates");
    candidates = told.candidates;
    const some = told.candidates.filter((one) => one.share > 0.01 && helps(one)).slice(0, 6);
    $("explain-title").textContent = "What could explain what is left?";
    drawCandidates(some, told.searched ? "" : WEIGHING);
  }

  // again : more has been weighed meanwhile; what somebody types is left alone, and so is another choice made while this was asked.
  async function mark(along, low, high, record = $("within").value, again = false) {
    const clicked = performance.now(), mine = again ? choice : ++choice;
    const told = await ask("laboratory-segment", { along, low, high, record });
    if (mine !== choice) return;
    chosen = { along, low, high, record, mask: bits(told.chosen, cells.count.length), spectrum: told.spectrum };
    for (const one of Object.values(plots)) one.mark();
    if (!again) {
      $("within").value = record;
      $("along").value = along;
      $("low").value = Number(low.toPrecision(4));
      $("high").value = Number(high.toPrecision(4));
    }
    $("clear").disabled = false;
    const unit = unitOf(along), most = Object.entries(told.records).sort((a, b) => b[1] - a[1])[0], share = Math.round(100 * Math.max(told.share, 0));
    $("explain-title").textContent = `What could explain ${TITLES[along]} ${number(low)} to ${number(high)} ${unit}${record ? ` in ${record}` : ""}?`;
    $("explain-words").textContent = told.samples ? `${number(told.ratio, 2)} times the noise there${told.force === null ? "" : `, ${number(found.units.factor * told.force)} ${found.units.small} rms`}; it holds ${share} % of all that lies above the noise` +
      (most && !record ? `, most of it in ${most[0]}` : "") + "." + (told.mean.length ? ` Mean: ${told.mean.map((v, i) => `${v === null ? "–" : number(found.units.factor * v)} ${found.units.small} ${["forward", "backward"][i]}`).join(", ")}.` : " Marked are the samples where it is loud.") : "No sample lies there.";
    drawCandidates(told.candidates.filter((one) => told.searched || one.likely), told.searched ? (told.candidates.length ? "" : "None of the known effects explains a hundredth of it.") : WEIGHING);
    if (!again) requestAnimationFrame(() => window.timings.segment.push(performance.now() - clicked));
  }

  // ---- model, records, staircase

  const unitOf = (along) => ({ time: "s", position: found.units.length, speed: `${found.units.length}/s`, angle: "rad", torque: found.units.force, frequency: "Hz" })[along];

  const sentence = (text) => `${text[0].toUpperCase()}${text.slice(1).replace(/\.$/, "")}.`;

  function drawModel() {
    $("ratio").textContent = `${found.ratio.toFixed(2)} × the noise`;
    $("ratio").className = `big ${found.state.style}`;
    const plain = found.plain ? ` That is ${number(found.units.factor * found.plain.error)} ${found.units.small}, ${number(found.plain.percent)} % of the torque.` : "";
    $("ratio-words").textContent = `${sentence(found.state.sentence)} At 1.00 nothing but noise is left.${plain}` +
      (found.held_out === null ? "" : ` Records held out: ${found.held_out.toFixed(2)}.`) + (found.change ? ` ${found.change.change}: ${found.before ? found.before.ratio.toFixed(2) : ""} → ${found.ratio.toFixed(2)}.` : "");
    $("effects").replaceChildren(...found.effects.map((one) => {
      const chip = element("span", { title: one.title }, one.name.replaceAll("_", " "));
      if (one.removable) {
        const out = element("button", { type: "button", className: "changes", title: `take ${one.name} out again` }, "×");
        out.setAttribute("aria-label", `take ${one.name} out`);
        out.addEventListener("click", () => change("remove", one.name));
        chip.append(" ", out);
      }
      return chip;
    }));
    $("parameters").tBodies[0].replaceChildren(...Object.entries(found.parameters).map(([name, one]) => element("tr", {}, element("td", {}, name), element("td", { className: "number" }, number(one.value, 4)),
      element("td", {}, one.interval === null ? "" : `± ${number(one.interval, 2)}`), element("td", {}, one.unit === "1" ? "" : one.unit))));
  }

  function drawRecords(candidate = null) {
    const before = found.before ? Object.fromEntries(found.before.records.map((one) => [one.name, one.ratio])) : {};
    $("head-force").textContent = found.units.small;
    $("records").tBodies[0].replaceChildren(...found.records.map((one) => {
      const after = candidate ? candidate.after[one.name] : null, was = before[one.name];
      const ratio = after ? `${one.ratio.toFixed(2)} → ${after.toFixed(2)}` : was ? `${was.toFixed(2)} → ${one.ratio.toFixed(2)}` : one.ratio.toFixed(2);
      const row = element("tr", {}, element("td", {}, recordButton(one.name)), element("td", { className: "number" }, one.plain ? number(found.units.factor * one.plain.error) : ""), element("td", { className: "number" }, one.plain ? number(one.plain.percent) : ""),
        element("td", { className: `number ${(after || one.ratio) <= found.explained ? "good" : "bad"}` }, ratio), element("td", {}, one.held_out ? "held out" : ""));
      row.dataset.record = one.name;
      return row;
    }));
    $("records-words").textContent = candidate ? `→ what ${candidate.effect.replaceAll("_", " ")} would leave, foretold to first order` : found.before ? `→ after ${found.change.change}, everything fitted again` : "";
  }

  // A record is a choice as a stretch is: marked in every picture, explained, and drawn beside its model.
  function recordButton(name) {
    const button = element("button", { type: "button", className: "plain", title: `mark ${name} in all pictures, and show what was measured and what the model says` }, name);
    button.addEventListener("click", () => {
      const own = found.names.indexOf(name), times = cells.time.filter((_, i) => cells.record[i] === own);
      oneRecord.show(name).catch(problem);
      if (times.length) mark("time", times.reduce((a, b) => Math.min(a, b)) - ROUNDED_S, times.reduce((a, b) => Math.max(a, b)) + ROUNDED_S, name).catch(problem);
    });
    return button;
  }

  async function drawStairs() {
    const { revisions } = await ask("laboratory-ladder");
    $("stairs-words").hidden = revisions.length < 2;
    const top = Math.max(1.2, ...revisions.map((one) => one.ratio));
    $("stairs").replaceChildren(...revisions.slice(-8).map((one) => {
      const bar = element("i");
      bar.style.height = `${Math.max(4 * (one.ratio - 1) / (top - 1), 0)}rem`;  // above the noise, which is the bar's foot
      const cost = one.cost && one.cost.unaware ? ` ${mm(one.cost.unaware.dynamic_m)} → ${mm(one.cost.aware.dynamic_m)} mm` : "";
      const step = element("li", { title: `${one.name}: ${one.ratio.toFixed(3)} times the noise${cost ? `; predicted error of the move, gains designed without and with it: ${cost}` : ""}` },
        element("b", {}, one.ratio.toFixed(2)), bar, one.change.replaceAll("_", " "), ...(cost ? [element("br"), cost] : []));
      if (one.confirmed === false) step.className = "worse";
      return step;
    }));
  }

  // ---- the residual along every coordinate

  function means(xs, keep, edges) {
    const sum = new Float64Array(MEAN_BINS), count = new Float64Array(MEAN_BINS), seen = new Float64Array(MEAN_BINS);
    xs.forEach((x, i) => {
      if (!keep(i)) return;
      const bin = Math.floor((x - edges[0]) / (edges[1] - edges[0]) * MEAN_BINS);
      if (bin < 0 || bin >= MEAN_BINS) return;
      sum[bin] += cells.more[i] * cells.count[i];
      count[bin] += cells.count[i];
      seen[bin] += 1;
    });
    return Array.from(sum, (v, k) => (seen[k] >= FEWEST ? v / count[k] : null));
  }

  function quantile(values, share) {
    const sorted = Float32Array.from(values).sort();
    return sorted[Math.min(sorted.length - 1, Math.max(0, Math.round(share * (sorted.length - 1))))];
  }

  function drawResiduals() {
    for (const one of Object.values(plots)) one.chart.remove();
    plots = {};
    const reach = 1.5 * Math.max(-quantile(cells.more, 0.003), quantile(cells.more, 0.997));
    const many = cells.count.length > 6000 ? 2 : 3;
    for (const along of ["position", "time", "speed", "angle", "torque"]) {
      const xs = cells[along], order = Array.from(xs.keys()).sort((a, b) => xs[a] - xs[b]), edges = [quantile(xs, 0.002), quantile(xs, 0.998)];
      const centres = Array.from({ length: MEAN_BINS }, (_, k) => edges[0] + (k + 0.5) * (edges[1] - edges[0]) / MEAN_BINS);
      const both = ["first", "second"].map((look, k) => [look, means(xs, (i) => (k ? cells.speed[i] < 0 : cells.speed[i] > 0), edges)]);
      const x = order.map((i) => xs[i]), forward = order.map((i) => (cells.speed[i] > 0 ? cells.more[i] : null)), backward = order.map((i) => (cells.speed[i] > 0 ? null : cells.more[i]));
      const drawn = chart($("residuals"), {
        title: `Over ${TITLES[along]}`, name: `residual-${along}`, x: { label: `${TITLES[along]}, ${unitOf(along)}` }, y: { label: `measured − model, ${found.units.force}`, range: [-reach, reach] }, height: 200, quiet: true,
        series: [{ name: "forward", look: "first", dots: true, size: many }, { name: "backward", look: "second", dots: true, size: many }, { name: "marked", look: "chosen", dots: true, size: Math.min(many + 1, 3) }],
        onSelect: (low, high) => mark(along, low, high).catch(problem),
        overlay: (u, ctx) => { horizontal(u, ctx, 0, colour("soft")); if (along !== "time") for (const [, values] of both) line(u, ctx, centres, values, colour("paper"), 5); if (along !== "time") for (const [look, values] of both) line(u, ctx, centres, values, colour(look), 2.5); },
      });
      const none = order.map(() => null);
      drawn.set([x, forward, backward, none]);
      plots[along] = { chart: drawn, mark: () => drawn.set([x, forward, backward, chosen ? order.map((i) => (chosen.mask[i] ? cells.more[i] : null)) : none], true) };
    }
    const hz = found.edges.slice(1).map((high, k) => 0.5 * (high + found.edges[k])), top = Math.max(3, ...found.spectrum.filter((v) => v !== null)) * 1.3;
    const spectrum = chart($("residuals"), {
      title: "Over frequency", name: "residual-frequency", x: { label: "frequency, Hz" }, y: { label: "× the noise", log: true, range: [0.5, top] }, height: 200, quiet: true,
      series: [{ name: "all", look: "first" }, { name: "marked", look: "chosen", width: 1.5 }],
      onSelect: (low, high) => mark("frequency", Math.max(low, 0), high).catch(problem),
      overlay: (u, ctx) => { horizontal(u, ctx, 1, colour("good")); Object.entries(found.landmarks).forEach(([name, f], k) => vertical(u, ctx, f, name, colour("soft"), k)); },
    });
    const blank = hz.map(() => null);
    spectrum.set([hz, found.spectrum, blank]);
    plots.frequency = { chart: spectrum, mark: () => spectrum.set([hz, found.spectrum, chosen ? chosen.spectrum : blank], true) };
    $("places").replaceChildren(...found.places.map((one) => {
      const button = element("button", { type: "button", title: one.text }, one.text.split("; ")[0]);
      button.dataset.along = one.along;
      button.addEventListener("click", () => mark(one.along, one.low, one.high, "").catch(problem));
      return button;
    }), ...(found.places.length ? [] : [element("span", { className: "small" }, "No place stands out.")]));
    $("within").replaceChildren(element("option", { value: "" }, "all records"), ...found.names.map((name) => element("option", { value: name }, name)));
    $("along").replaceChildren(...Object.keys(TITLES).map((name) => element("option", { value: name }, `${name}, ${unitOf(name)}`)));
  }

  // ---- candidates

  // What stays the same stays where it is: more comes in while somebody reads, or is about to click.
  function drawCandidates(some, more) {
    const before = cards;
    cards = new Map();
    const helping = some.filter(helps), made = helping.slice(0, CARDS).map((one, k) => {
      const key = `${version} ${one.effect} ${Math.round(100 * one.share)} ${k === 0 && one.likely} ${JSON.stringify(chosen && [chosen.along, chosen.low, chosen.high])}`;
      cards.set(key, before.get(key) || card(one, k === 0 && one.likely));
      return cards.get(key);
    });
    const others = [...helping.slice(CARDS), ...(chosen ? some.filter((one) => !helps(one)) : [])].map((one) => row(one));
    const now = [...made.map((one) => one.box), ...(others.length ? [element("div", { id: "others", className: "scroll" }, element("table", {}, element("tbody", {}, ...others)))] : []), ...(more ? [element("p", { className: "small" }, more)] : []),
      ...(!helping.length && !more ? [element("p", { className: "small" }, !found.missing && found.state.style !== "note" ? "What is left is noise: no known effect would lower it. Mark a part of a picture to ask about that part." : "No known effect lowers the error of all records.")] : [])];
    const place = $("candidates");
    for (const old of [...place.children]) if (!now.includes(old)) old.remove();
    now.forEach((one, k) => { if (place.children[k] !== one) place.insertBefore(one, place.children[k] || null); });
    for (const [key, one] of before) if (!cards.has(key)) one.law?.remove();
    for (const one of made) if (one.law && !one.law.data) one.law.set(one.law.given);
  }

  // What explains a part but makes all records together worse is no cure: it is told of, behind those that are.
  const helps = (one) => one.ratio === null || one.ratio < found.ratio - LEAST_FALL;

  const ratios = (one) => (one.ratio === null ? "" : helps(one) ? `; all records ${found.ratio.toFixed(2)} → ${one.ratio.toFixed(2)} × the noise, foretold` : "; it would make the rest worse");

  function row(one) {
    const add = element("button", { type: "button", className: "changes" }, "Add");
    add.addEventListener("click", () => change("add", one.effect));
    return element("tr", { title: one.title }, element("td", {}, one.effect.replaceAll("_", " ")), element("td", {}, `explains ${Math.round(100 * one.share)} %${ratios(one)}`), element("td", {}, add));
  }

  function card(one, first) {
    const bar = element("i");
    bar.style.width = `${100 * one.share}%`;
    const made = element("article", { className: first ? "card first" : "card" },
      element("h3", {}, one.effect.replaceAll("_", " ")), element("div", { className: "small" }, one.title),
      element("div", { className: "bar" }, bar),
      element("div", {}, `explains ${Math.round(100 * one.share)} % of ${chosen ? "this part" : "what is left"}${ratios(one)}`),
      element("div", { className: "small" }, Object.entries(one.values).filter(([, [v]]) => v !== 0).map(([name, [v, unit]]) => `${name} ${number(v)}${unit && unit !== "1" ? ` ${unit}` : ""}`).join(", ")));
    made.dataset.effect = one.effect;
    const box = { box: made, law: null };
    const buttons = element("div", { className: "buttons" }), add = element("button", { type: "button", className: first ? "main-action changes" : "changes" }, `Add ${one.effect.replaceAll("_", " ")}`), doubt = element("button", { type: "button", className: "changes" }, "Is it that?");
    add.addEventListener("click", () => change("add", one.effect));
    doubt.title = "evidence, records held out, runner-up, and what would tell them apart; the best effects are refitted with everything free";
    doubt.addEventListener("click", () => { evidence = null; ask("laboratory-evidence").catch(problem); });
    buttons.append(add, " ", doubt);
    if (one.law) {
      const place = element("div");
      made.append(place);
      const law = chart(place, {
        title: "Its law over what is left", name: `law-${one.effect}`, x: { label: `${TITLES[one.law.along]}, ${unitOf(one.law.along)}` }, y: { label: found.units.force }, height: 190, quiet: true,
        series: [{ name: "missing, forward", look: "first", dots: true, size: 5 }, { name: "missing, backward", look: "second", dots: true, size: 5 }, { name: "law, forward", look: "first" }, { name: "law, backward", look: "second" }],
        overlay: (u, ctx) => horizontal(u, ctx, 0, colour("soft")),
      });
      law.given = [one.law.x, one.law.missing_forward, one.law.missing_backward, one.law.forward, one.law.backward];
      box.law = law;
    } else if (one.along === "frequency") made.append(element("p", { className: "small" }, "It acts on the dynamics: no curve along one coordinate shows it."));
    made.append(element("p", { className: "small" }, `Seen: ${one.seen}. Check: ${one.check}.`), buttons);
    const own = version;
    for (const kind of ["mouseenter", "focusin"]) made.addEventListener(kind, () => own === version && Object.keys(one.after).length && drawRecords(one));
    for (const kind of ["mouseleave", "focusout"]) made.addEventListener(kind, () => own === version && drawRecords());
    return box;
  }

  function problem(error) {
    $("explain-words").textContent = error.message;
  }

  async function change(job, effect) {
    began = performance.now();
    for (const button of document.querySelectorAll(".changes")) button.disabled = true;
    const foretold = candidates.find((one) => one.effect === effect);
    if (foretold && job === "add") drawRecords(foretold);
    try {
      await ask(`laboratory-${job}`, { effect });
    } catch (error) {
      began = 0;
      problem(error);
    }
  }

  // ---- the sceptic's answer

  function drawEvidence() {
    $("evidence").hidden = !evidence;
    if (!evidence) return;
    const [best, second] = evidence.ranking, refitted = evidence.ranking.filter((one) => one.refitted);
    const ahead = best && second && second.refitted ? `${number(best.evidence - second.evidence)} nats more evidence than ${second.effect.replaceAll("_", " ")}` : "nothing else came near";
    const [command, why] = String(evidence.lines.at(-1)).replace("Next: ", "").split(/ {3}\((.*)\)\.?$/);
    $("evidence").replaceChildren(element("h3", {}, sentence(`${evidence.state.word}: ${evidence.state.sentence}`)),
      ...(!refitted.length ? [] : [element("div", { className: "scroll" }, element("table", {}, element("thead", {}, element("tr", {}, ...["effect", "evidence, nats", "explains", "records held out", "against it"].map((t) => element("th", {}, t)))),
        element("tbody", {}, ...refitted.map((one) => element("tr", {}, element("td", {}, one.effect), element("td", { className: "number" }, number(one.evidence)), element("td", { className: "number" }, `${Math.round(100 * one.explained)} %`),
          element("td", { className: "number" }, one.held_out_gain === null ? "none here" : `${one.held_out_gain > 0 ? "better by" : "worse by"} ${number(Math.abs(one.held_out_gain))}`), element("td", {}, one.accepted ? "nothing" : one.against))))))]),
      ...(refitted.length ? [element("p", { className: "small" }, `Evidence: log-likelihood that it gains, less what as many free parameters would gain by chance; above ${found.evidence} nats it counts.`)] : []),
      element("p", {}, best && refitted.length ? `${best.effect.replaceAll("_", " ")}: ${ahead}.` : "", evidence.twins.length ? ` No record here tells ${evidence.twins.join(" and ")} apart.` : ""),
      ...evidence.by_hand.map((one) => element("p", { className: "small" }, `By hand, ${one.cause || ""}: ${one.change}; then ${one.record}: ${one.tells}`)),
      element("p", { className: "small" }, why ? `Next (${why}), in a terminal:` : "Next, in a terminal:"), element("pre", {}, command),
      element("details", {}, element("summary", {}, "All that `beltcomm diagnose --next` says"), element("pre", {}, evidence.lines.join("\n"))));
  }

  $("choose").addEventListener("submit", (event) => {
    event.preventDefault();
    if (found) mark($("along").value, ...["low", "high"].map((id) => ($(id).value === "" ? null : Number($(id).value)))).catch(problem);
  });
  $("clear").addEventListener("click", async () => {
    chosen = null;
    choice += 1;
    $("within").value = "";
    for (const one of Object.values(plots)) one.mark();
    $("clear").disabled = true;
    $("explain-words").textContent = "";
    await whole();
  });

  return { heard, show: () => {} };
}
