// The design: sends what the controls hold, draws what comes back.

import { chart, colour, element, horizontal, mm, number, vertical } from "./chart.js";

const $ = (id) => document.getElementById(id);
const NAMES = {
  phase_margin_deg: ["Velocity phase margin, at least", "deg"],
  suppression_db: ["Open loop at the resonance", "dB"],
  position_phase_margin_deg: ["Position phase margin, at least", "deg"],
};
// Fields of a move: their unit on a belt axis, and that in SI.
const MOVE = { start_m: ["mm", 1e-3], end_m: ["mm", 1e-3], speed_m_s: ["m/s", 1], acceleration_m_s2: ["m/s²", 1], jerk_m_s3: ["m/s³", 1] };
const LOOPS = ["velocity", "position"], LOOKS = { velocity: "first", position: "second" };
const SOON_MS = 30;

export function design(ask) {
  let begun = null, setting, latest, tracked, scales = {}, plots = {}, version = 0, drawn = 0, busy = false, saving = false, round = 0, changedAt = 0, beginning = false, looked = 0;
  const state = () => Object.assign(document.body.dataset, { design: version > 0 && drawn === version && !busy ? "settled" : "busy" });

  // ---- one change at a time: the newest setting is asked for, what it overtook is not drawn

  function changed() {
    version += 1;
    changedAt = performance.now();
    state();
    work();
  }

  async function work() {
    if (busy) return;
    busy = true;
    try {
      while (drawn !== version) {
        const now = version, from = changedAt;
        const found = await ask("design-update", setting);
        const following = now === version && ask("design-track", setting);
        // What comes at once is drawn with the curves: painting a page takes longer than waiting for it.
        const early = following && (await Promise.race([following, new Promise((go) => setTimeout(go, SOON_MS))]));
        drawUpdate(found);
        if (early && now === version) drawTracked(early);
        window.timings.update.push(performance.now() - from);
        if (!following) continue;
        const path = early || (await following);
        if (now !== version) continue;
        if (!early) drawTracked(path);
        window.timings.track.push(performance.now() - from);
        const reach = await ask("design-reach", setting);
        if (now !== version) continue;
        drawReach(reach);
        drawn = now;
      }
    } catch (problem) {
      drawn = version;
      refuse(problem.message, "");
    } finally {
      busy = false;
      state();
    }
  }

  function refuse(why, advice) {
    $("refusal").replaceChildren(element("b", {}, "Not possible: "), `${why}. ${advice}`.replace(/\.\. ?/, ". "));
    $("refusal").hidden = false;
    $("save").disabled = true;
    $("bench").classList.add("stale");
  }

  // ---- what comes back

  function drawUpdate(found) {
    if (found.refusal) {
      refuse(found.refusal, "");
      $("summary").textContent = "The curves are those of the last setting that was possible.";
      return;
    }
    latest = found;
    $("refusal").hidden = true;
    $("bench").classList.remove("stale");
    $("save").disabled = saving;
    $("summary").textContent = found.sentence;
    $("binding").textContent = found.binding.length ? `Limited by: ${found.binding.join("; ")}.` : "";
    rows([...found.changes, ...(tracked && tracked.changes ? tracked.changes : [])]);
    for (const name of Object.keys(NAMES)) {
      const has = found.new.worst[name], spare = name === "suppression_db" ? setting[name] - has : has - setting[name];
      $(`has-${name}`).textContent = spare > 0.6 ? `It has ${has.toFixed(1)} ${NAMES[name][1]}: less need not be asked for, other conditions bind.` : "";
    }
    drawLoops();
  }

  function drawTracked(found) {
    if (found.refusal) return;
    tracked = found;
    if (found.sentence) $("summary").textContent = latest.sentence.startsWith("Nothing") ? found.sentence : `${latest.sentence.slice(0, -1)}; ${found.sentence.replace("Against the present design: ", "")}`;
    rows([...latest.changes, ...found.changes]);
    const { dynamic_mm, static_mm, places } = begun.targets, { error, cart_error } = found.new;
    const judged = (place, one) => {
      if (!places.includes(place)) return "";
      const missed = [1e3 * one.dynamic_m > dynamic_mm && `${dynamic_mm} mm`, 1e3 * one.static_m > static_mm && `${static_mm} mm`].filter(Boolean);
      return missed.length ? ` (misses ${missed.join(" and ")})` : ` (meets ${dynamic_mm} mm and ${static_mm} mm)`;
    };
    const rest = places.includes("carriage") ? ` while moving, ${mm(cart_error.static_m)} mm at rest` : "";
    $("error").textContent = `At the motor ${mm(error.dynamic_m)} mm while moving, ${mm(error.static_m)} mm at rest${judged("motor", error)}; ` +
      `at the carriage ${mm(cart_error.dynamic_m)} mm${rest}${judged("carriage", cart_error)}.` + (found.new.saturated.length ? ` It reaches ${found.new.saturated.join(" and ")}.` : "");
    const now = found.new, was = found.present;
    scales.tracking = range("tracking", [...now.motor_mm, ...now.cart_mm, ...was.motor_mm, ...was.cart_mm]);
    plots.tracking.set(uPlot.join([[now.t_s, now.motor_mm, now.cart_mm], [was.t_s, was.motor_mm, was.cart_mm]]));
  }

  function drawReach(reach) {
    for (const name of Object.keys(NAMES)) {
      const [low, high] = begun.ranges[name], pieces = reach.pieces[name], value = setting[name];
      $(`track-${name}`).replaceChildren(...pieces.map(([from, to]) => {
        const part = element("i");
        part.style.left = `${100 * (from - low) / (high - low)}%`;
        part.style.width = `${Math.max(100 * (to - from) / (high - low), 0.5)}%`;
        return part;
      }));
      const words = pieces.map(([from, to]) => `${number(from)} to ${number(to)}`).join(", ");
      $(`range-${name}`).textContent = pieces.length ? `possible: ${words} ${NAMES[name][1]}` : "not possible with the other sliders as they are";
      $(`knob-${name}`).classList.toggle("out", !$("refusal").hidden && !pieces.some(([from, to]) => from <= value && value <= to));
    }
    if (!$("refusal").hidden && reach.advice) $("refusal").append(` ${reach.advice}`);
  }

  function rows(changes) {
    $("changes").tBodies[0].replaceChildren(...changes.map((one) => element("tr", {},
      element("td", {}, one.name), element("td", { className: "number" }, number(one.present)), element("td", { className: "number" }, number(one.new)), element("td", {}, one.unit),
      one.same ? element("td", {}, "same") : one.better === null ? element("td", {}, "changed") : element("td", { className: one.better ? "good" : "bad" }, one.better ? "▲ better" : "▼ worse"))));
  }

  // ---- curves

  // An axis keeps its range as long as the curves fit and fill a third of it: what moves is the curve and not the scale.
  function range(id, values, least = 0) {
    const shown = values.filter((value) => value !== null), low = Math.min(0, ...shown), high = Math.max(least, ...shown), known = scales[id];
    if (!known || low < known[0] || high > known[1] || high - low < 0.33 * (known[1] - known[0])) return [low < 0 ? 1.15 * low : 0, 1.15 * high];
    return known;
  }

  // Where a loop's gain passes 0 dB last, and its phase there; where its phase passes -180 degrees, and its gain there.
  function crossings(loops, loop) {
    const freq = loops.freq_hz, db = loops[`${loop}_db`], deg = loops[`${loop}_deg`], at = {};
    for (let k = 1; k < freq.length; k += 1) {
      const between = (a, b, level) => freq[k - 1] * (freq[k] / freq[k - 1]) ** ((level - a) / (b - a));
      if (db[k - 1] >= 0 && db[k] < 0 && !at.gain) at.gain = [between(db[k - 1], db[k], 0), 180 + deg[k]];
      if (deg[k - 1] >= -180 && deg[k] < -180 && !at.phase) at.phase = [between(deg[k - 1], deg[k], -180), -db[k]];
    }
    return at;
  }

  function makePlots() {
    const hz = { label: "frequency, Hz", log: true, range: () => [0.3, latest ? latest.new.open_loops.freq_hz.at(-1) : 500] };
    const curves = [...LOOPS.map((loop) => ({ name: `${loop} loop`, look: LOOKS[loop] })), ...LOOPS.map((loop) => ({ name: `present ${loop}`, look: LOOKS[loop], width: 1.2, dash: [2, 3] })),
      ...LOOPS.map((loop) => ({ name: `measured ${loop}`, look: LOOKS[loop], dots: true, size: 3.5 }))];
    const margins = (kind) => (u, ctx) => {
      horizontal(u, ctx, kind === "db" ? 0 : -180, colour("soft"));
      if (!latest) return;
      const at = crossings(latest.new.open_loops, "velocity");
      if (kind === "deg" && at.gain) vertical(u, ctx, at.gain[0], `velocity loop here: ${at.gain[1].toFixed(0)}° margin at ${number(at.gain[0])} Hz`, colour("first"));
      if (kind === "db" && at.phase) vertical(u, ctx, at.phase[0], `velocity loop here: ${at.phase[1].toFixed(1)} dB margin at ${number(at.phase[0])} Hz`, colour("first"));
    };
    plots.tracking = chart($("tracking"), { title: "", name: "tracking-error", x: { label: "time, s" }, y: { label: "reference − position, mm", range: () => scales.tracking || [-1, 1] }, height: 200, overlay: (u, ctx) => horizontal(u, ctx, 0, colour("soft")),
      series: [{ name: "motor", look: "first" }, { name: "carriage", look: "second" }, { name: "present, motor", look: "first", width: 1.2, dash: [2, 3] }, { name: "present, carriage", look: "second", width: 1.2, dash: [2, 3] }] });
    plots.gain = chart($("loops"), { title: "Open loops, gain", name: "gain", x: hz, y: { label: "gain, dB", range: [-60, 40] }, series: curves, sync: "loops", overlay: margins("db") });
    plots.phase = chart($("loops"), { title: "Open loops, phase", name: "phase", x: hz, y: { label: "phase, degrees", range: [-360, 0] }, series: curves, sync: "loops", overlay: margins("deg") });
    const time = { label: "time, s", range: () => [0, latest ? latest.new.responses.t_s.at(-1) : 1] };
    plots.step = chart($("loops"), { title: "Step of the reference", name: "step", x: time, y: { label: "share of the step", range: () => scales.step || [0, 1.3] }, sync: "steps", overlay: (u, ctx) => horizontal(u, ctx, 1, colour("soft")),
      series: [{ name: "speed", look: "first" }, { name: "position", look: "second" }, { name: "present speed", look: "first", width: 1.2, dash: [2, 3] }, { name: "present position", look: "second", width: 1.2, dash: [2, 3] }] });
    plots.disturbance = chart($("loops"), { title: "Step of torque at the motor", name: "disturbance", x: time, y: { label: `mm on ${begun.disturbance_nm} N m`, range: () => scales.disturbance || [0, 1] }, sync: "steps",
      series: [{ name: "position at the motor", look: "first" }, { name: "present", look: "first", width: 1.2, dash: [2, 3] }] });
  }

  function drawLoops() {
    const now = latest.new, was = latest.present, seen = latest.measured;
    for (const [id, kind] of [["gain", "db"], ["phase", "deg"]]) {
      const of = (one) => [one.freq_hz, ...LOOPS.map((loop) => one[`${loop}_${kind}`])];
      const tables = [of(now.open_loops), of(was.open_loops), ...(seen ? [of(seen)] : [])], joined = uPlot.join(tables);
      plots[id].set(seen ? joined : [...joined, ...LOOPS.map(() => joined[0].map(() => null))]);
    }
    const inMm = (one) => one.responses.disturbance_m.map((value) => (value === null ? null : 1e3 * value));
    scales.step = range("step", [now, was].flatMap((one) => [...one.responses.position, ...one.responses.velocity]));
    scales.disturbance = range("disturbance", [...inMm(now), ...inMm(was)]);
    plots.step.set(uPlot.join([[now.responses.t_s, now.responses.velocity, now.responses.position], [was.responses.t_s, was.responses.velocity, was.responses.position]]));
    plots.disturbance.set(uPlot.join([[now.responses.t_s, inMm(now)], [was.responses.t_s, inMm(was)]]));
    $("measured-words").textContent = `Speed: the velocity loop alone. Position: the whole cascade without feedforward.` + (seen ? ` Dots: these gains on the measured response of ${seen.record} at ${number(1e3 * seen.place_m)} mm; friction makes it lower where it hardly moves.` : "");
  }

  // ---- controls

  function place() {
    for (const name of Object.keys(NAMES)) {
      $(name).value = setting[name];
      $(`box-${name}`).value = setting[name].toFixed(1);
      $(name).setAttribute("aria-valuetext", `${setting[name].toFixed(1)} ${NAMES[name][1]}`);
    }
    $("prefilter").value = setting.prefilter;
    $("lag").value = setting.velocity_filter_s;
    $("payload").value = Number((begun.units.kg.factor * setting.payload_kg).toPrecision(4));
    $("loaded").checked = setting.loaded;
    $("loaded").disabled = setting.payload_kg === 0;
    $("position").value = 1e3 * setting.position_m;
    $("place").textContent = `${(1e3 * setting.position_m).toFixed(0)} mm`;
  }

  function turn(some) {
    setting = { ...setting, ...some };
    place();
    changed();
  }

  function knob(name) {
    const [title, unit] = NAMES[name], [low, high] = begun.ranges[name];
    const slider = element("input", { type: "range", id: name, min: low, max: high, step: 0.1 }), box = element("input", { type: "number", id: `box-${name}`, min: low, max: high, step: 0.1 });
    box.setAttribute("aria-label", `${title}, ${unit}`);
    slider.setAttribute("aria-describedby", `range-${name}`);
    slider.addEventListener("input", () => turn({ [name]: Number(slider.value) }));
    box.addEventListener("change", () => turn({ [name]: Math.min(Math.max(Number(box.value) || 0, low), high) }));
    $("knobs").append(element("div", { className: "knob", id: `knob-${name}` },
      element("div", { className: "pair" }, element("label", { htmlFor: name }, title), element("span", {}, box, ` ${unit}`)),
      slider, element("div", { className: "track", id: `track-${name}` }), element("div", { className: "small range", id: `range-${name}` }, "what is possible is being computed …"),
      element("div", { className: "small", id: `has-${name}` })));
  }

  function prefilterName(one) {
    const kind = { none: "none", notch: `notch at ${number(one.hz)} Hz`, butterworth: `Butterworth low-pass at ${number(one.hz)} Hz` }[one.kind];
    return one.roll_off_hz ? `${kind}, low-pass at ${number(one.roll_off_hz)} Hz` : kind;
  }

  // ---- presets: computed one by one while nothing else is asked

  async function presets() {
    const mine = ++round, best = {};
    $("paces").replaceChildren(element("td"), ...begun.paces.map((pace) => element("th", { scope: "col" }, pace.title)));
    $("kinds").replaceChildren(...begun.kinds.map((kind) => element("tr", { title: kind.words }, element("th", { scope: "row" }, kind.title),
      ...begun.paces.map((pace) => element("td", {}, element("button", { type: "button", id: `preset-${kind.key}-${pace.key}`, disabled: true }, "…"))))));
    for (const pace of begun.paces) for (const kind of begun.kinds) {
      while (busy || saving) await new Promise((go) => setTimeout(go, 50));
      if (mine !== round) return;
      const found = await ask("design-preset", { setting, kind: kind.key, pace: pace.key }).catch((problem) => ({ setting: null, refusal: problem.message }));
      if (mine !== round) return;
      const button = $(`preset-${kind.key}-${pace.key}`);
      button.dataset.ready = "true";
      if (!found.setting) {
        button.textContent = "not possible";
        button.title = found.refusal;
        continue;
      }
      button.disabled = false;
      button.replaceChildren(`${number(found.position_crossover_hz)} Hz`, element("br"), `${mm(found.dynamic_m)} mm`);
      button.title = `${kind.words}; ${pace.title}: position bandwidth at rest ${number(found.position_crossover_hz)} Hz, predicted error ${mm(found.dynamic_m)} mm`;
      button.setAttribute("aria-label", `${kind.title}, ${button.title}`);
      button.addEventListener("click", () => turn({ ...found.setting, payload_kg: setting.payload_kg, position_m: setting.position_m, loaded: setting.loaded }));
      if (!best[pace.key] || found.stiffness > best[pace.key].stiffness) {
        if (best[pace.key]) best[pace.key].button.firstChild.textContent = best[pace.key].button.firstChild.textContent.replace("★ ", "");
        button.firstChild.textContent = `★ ${button.firstChild.textContent}`;
        best[pace.key] = { stiffness: found.stiffness, button };
      }
    }
    document.body.dataset.presets = mine;
  }

  async function save() {
    saving = true;
    $("save").disabled = true;
    $("saved").hidden = false;
    $("saved").className = "";
    $("saved").textContent = "Proving the design on the recordings of the run: this can take a minute …";
    try {
      const found = await ask("design-save", setting);
      $("saved").className = found.failed || found.doubts.length ? "doubtful" : "";
      $("saved").replaceChildren(
        element("b", {}, found.failed ? "Saved, but not to be used: " : "Saved. "), `${found.doubts.join("; ")}${found.doubts.length ? ". " : ""}The design before is kept as ${found.replaced}. Nothing was written to a drive. Next, in a terminal:`,
        ...found.next.map((line) => element("pre", {}, line)), "The first proves the gains by a move, which the second asks for.",
        element("details", {}, element("summary", {}, "The proof"), element("pre", {}, found.lines.join("\n"))));
    } catch (problem) {
      $("saved").className = "doubtful";
      $("saved").textContent = `Not saved: ${problem.message}`;
    }
    dispatchEvent(new Event("saved"));
    $("saved").scrollIntoView({ block: "nearest" });
    saving = false;
    $("save").disabled = !$("refusal").hidden;
  }

  async function drive() {
    const given = Object.fromEntries(Object.entries(MOVE).map(([name, [unit, si]]) => [name, si / begun.units[unit].factor]));
    $("move-refusal").textContent = "";
    try {
      const asked = Object.fromEntries(Object.entries(given).map(([name, unit]) => [name, $(name).value === "" ? null : unit * Number($(name).value)]));
      $("move").textContent = `The ${(await ask("design-move", asked)).move}, with the present feedforward.`;
      scales.tracking = undefined;
      changed();
    } catch (problem) {
      $("move-refusal").textContent = problem.message;
    }
  }

  async function begin() {
    begun = await ask("design-begin");
    setting = begun.setting;
    $("bench").hidden = false;
    $("knobs").replaceChildren($("knobs").firstElementChild);
    for (const name of ["phase_margin_deg", "suppression_db", "position_phase_margin_deg"]) knob(name);
    $("prefilter").replaceChildren(...Object.entries(begun.prefilters).map(([key, one]) => element("option", { value: key }, prefilterName(one))));
    $("lag").replaceChildren(...begun.velocity_filters_s.map((lag) => element("option", { value: lag }, `${number(1e3 * lag)} ms`)));
    Object.assign($("position"), { min: 1e3 * begun.ends_m[0], max: 1e3 * begun.ends_m[1], step: 1 });
    $("payload").max = begun.units.kg.factor * begun.most_payload_kg;
    for (const one of $("controls").querySelectorAll("[data-unit]")) one.textContent = begun.units[one.dataset.unit].symbol;
    $("where").textContent = `The gains hold at both ends of the travel, with and without the payload, for every friction; ${number(begun.mounted_kg)} kg move without it.`;
    $("move").textContent = `The ${begun.move}, with the present feedforward.` + (begun.compensated.length ? ` Torque for ${begun.compensated.join(", ")} is sent along, as by \`verify\`.` : "");
    for (const [name, value] of Object.entries(begun.editor)) $(name).value = Number((begun.units[MOVE[name][0]].factor * value).toPrecision(4));
    if (!plots.gain) makePlots();
    place();
    changed();
    presets();
  }

  function payload() {
    const kg = Math.min(Math.max((Number($("payload").value) || 0) / begun.units.kg.factor, 0), begun.most_payload_kg);
    turn({ payload_kg: kg, loaded: kg > 0 });
    presets();
  }

  $("prefilter").addEventListener("change", () => turn({ prefilter: $("prefilter").value }));
  $("lag").addEventListener("change", () => turn({ velocity_filter_s: Number($("lag").value) }));
  $("payload").addEventListener("change", payload);
  $("loaded").addEventListener("change", () => turn({ loaded: $("loaded").checked }));
  $("position").addEventListener("input", () => turn({ position_m: Number($("position").value) / 1e3 }));
  $("reset").addEventListener("click", () => turn(begun.setting));
  $("save").addEventListener("click", save);
  $("drive").addEventListener("click", drive);
  $("controls").addEventListener("submit", (event) => event.preventDefault());

  async function show() {
    if (begun || beginning) return;
    beginning = true;
    $("summary").textContent = "Loading the design: the plants of this run are computed …";
    await begin().catch((problem) => { $("summary").textContent = problem.message; $("summary").classList.add("bad"); });
    beginning = false;
  }

  // The model of the run may change while this tab is open: then the sliders begin anew.
  async function heard() {
    if (!begun || beginning || busy || saving || performance.now() - looked < 2000) return;
    looked = performance.now();
    if ((await ask("design-stamp")).stale) {
      begun = null;
      await show();
      $("summary").textContent = `The model of this run has changed; the sliders begin at its present design. ${$("summary").textContent}`;
    }
  }

  return { show, heard };
}
