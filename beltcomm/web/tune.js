"use strict";
// The tuning page: sends what the controls hold, draws what comes back.  No library, nothing from outside.

const NAMES = {
  phase_margin_deg: ["Velocity phase margin, at least", "deg"],
  suppression_db: ["Open loop at the resonance", "dB"],
  position_phase_margin_deg: ["Position phase margin, at least", "deg"],
};
const $ = (id) => document.getElementById(id);
let begun, setting, latest, tracked, scales = {}, version = 0, drawn = 0, busy = false, saving = false;

// How long each change took, from the event to the drawn page, ms: for whoever measures.
window.timings = { update: [], track: [] };

async function ask(name, data) {
  const answer = await fetch(name, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(data) });
  const found = answer.headers.get("Content-Type") === "application/json" ? await answer.json() : { error: await answer.text() };
  if (!answer.ok) throw new Error(found.error || `the program answered with ${answer.status}`);
  return found;
}

function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name in made) made[name] = value;
    else made.setAttribute(name, value);
  }
  made.append(...children);
  return made;
}

function number(value) {
  if (value === null || value === undefined) return "none";
  return Math.abs(value) >= 100 ? value.toFixed(0) : String(Number(value.toPrecision(3)));
}

// ---- one change at a time: the newest setting is asked for, what it overtook is not drawn

const SOON_MS = 30;
let changedAt = 0;
function changed() {
  version += 1;
  changedAt = performance.now();
  work();
}

async function work() {
  if (busy) return;
  busy = true;
  try {
    while (drawn !== version) {
      const now = version, began = changedAt;
      const found = await ask("update", setting);
      const following = now === version && ask("track", setting);
      // What comes at once is drawn with the curves: painting a page takes longer than waiting for it.
      const early = following && (await Promise.race([following, new Promise((go) => setTimeout(go, SOON_MS))]));
      drawUpdate(found);
      if (early && now === version) drawTracked(early);
      window.timings.update.push(performance.now() - began);
      if (!following) continue;
      const path = early || (await following);
      if (now !== version) continue;
      if (!early) drawTracked(path);
      window.timings.track.push(performance.now() - began);
      const reach = await ask("reach", setting);
      if (now !== version) continue;
      drawReach(reach);
      drawn = now;
    }
  } catch (problem) {
    drawn = version;
    refuse(problem.message === "Failed to fetch" ? "The program that serves this page has ended: nothing is computed or saved any more." : problem.message, "");
  } finally {
    busy = false;
    document.body.dataset.drawn = drawn;
  }
}

function refuse(why, advice) {
  $("refusal").replaceChildren(element("b", {}, "Not possible: "), `${why}. ${advice}`.replace("..", "."));
  $("refusal").hidden = false;
  $("save").disabled = true;
  $("figures").classList.add("stale");
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
  $("figures").classList.remove("stale");
  $("save").disabled = saving;
  $("summary").textContent = found.sentence;
  $("binding").textContent = found.binding.length ? `Bound by: ${found.binding.join("; ")}.` : "";
  rows([...found.changes, ...(tracked && tracked.changes ? tracked.changes : [])]);
  for (const name of Object.keys(NAMES)) {
    const has = found.new.worst[name], spare = name === "suppression_db" ? setting[name] - has : has - setting[name];
    $(`has-${name}`).textContent = spare > 0.6 ? `It has ${has.toFixed(1)} ${NAMES[name][1]}: less need not be asked for, other conditions bind.` : "";
  }
  plots();
}

function drawTracked(found) {
  if (found.refusal) return;
  tracked = found;
  if (found.sentence) $("summary").textContent = latest.sentence.startsWith("Nothing") ? found.sentence : `${latest.sentence.slice(0, -1)}; ${found.sentence.replace("Against the present design: ", "")}`;
  rows([...latest.changes, ...found.changes]);
  const { dynamic_mm, static_um } = begun.targets, error = found.new.error, met = 1e3 * error.dynamic_m <= dynamic_mm && 1e6 * error.static_m <= static_um;
  $("error").textContent = `At the motor ${number(1e3 * error.dynamic_m)} mm while moving, ${number(1e6 * error.static_m)} µm at rest (${met ? "meets" : "misses"} ${dynamic_mm} mm and ${static_um} µm); ` +
    `at the carriage ${number(1e3 * found.new.cart_error.dynamic_m)} mm.` + (found.new.saturated.length ? ` It reaches ${found.new.saturated.join(" and ")}.` : "");
  plotTracked();
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

const SVG = "http://www.w3.org/2000/svg";
function draw(parent, tag, attributes, text) {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  if (text !== undefined) made.textContent = text;
  parent.append(made);
  return made;
}

function ticks(low, high, count) {
  const raw = (high - low) / count, power = 10 ** Math.floor(Math.log10(raw)), step = power * [1, 2, 5, 10].find((factor) => factor * power >= raw * 0.999);
  const found = [];
  for (let value = Math.ceil(low / step - 1e-6) * step; value <= high + 1e-6 * step; value += step) found.push(Math.abs(value) < 1e-9 * step ? 0 : value);
  return found;
}

// Asked for once a window: asking makes the browser lay out all that was drawn before.
let widths = {};
window.addEventListener("resize", () => {
  widths = {};
  plots();
  plotTracked();
});

function plot(id, x, y, curves) {
  const place = $(id), width = Math.max(widths[id] ||= place.clientWidth, 240), height = Math.min(Math.max(0.52 * width, 190), 300);
  const left = 54, right = 12, top = 22 * Math.ceil(curves.length / (width < 330 ? 1 : 2)) + 6, bottom = 40;
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("viewBox", `0 0 ${width} ${height + top}`);
  svg.setAttribute("role", "img");
  svg.setAttribute("aria-label", `${y.label} over ${x.label}: ${curves.map((one) => one.name).join(", ")}`);
  const full = height + top, turn = x.log ? Math.log10 : (value) => value;
  const [x0, x1] = x.range.map(turn), [y0, y1] = y.range;
  const px = (value) => left + (width - left - right) * (turn(value) - x0) / (x1 - x0);
  const py = (value) => full - bottom - (full - top - bottom) * (value - y0) / (y1 - y0);
  const decades = [];
  if (x.log) for (let power = Math.ceil(x0); power <= x1; power += 1) decades.push(10 ** power);
  for (const value of x.log ? decades : ticks(x.range[0], x.range[1], width < 420 ? 4 : 6)) {
    draw(svg, "line", { class: "grid", x1: px(value), x2: px(value), y1: top, y2: full - bottom });
    draw(svg, "text", { class: "tick", x: px(value), y: full - bottom + 15, "text-anchor": "middle" }, String(Number(value.toPrecision(6))));
  }
  for (const value of y.ticks || ticks(y0, y1, 5)) {
    draw(svg, "line", { class: value === y.mark ? "mark" : "grid", x1: left, x2: width - right, y1: py(value), y2: py(value) });
    draw(svg, "text", { class: "tick", x: left - 5, y: py(value) + 4, "text-anchor": "end" }, String(Number(value.toPrecision(6))));
  }
  draw(svg, "rect", { class: "frame", x: left, y: top, width: width - left - right, height: full - top - bottom });
  draw(svg, "text", { x: left + (width - left - right) / 2, y: full - 6, "text-anchor": "middle" }, x.label);
  draw(svg, "text", { x: 0, y: 0, "text-anchor": "middle", transform: `translate(13 ${top + (full - top - bottom) / 2}) rotate(-90)` }, y.label);
  const clip = draw(draw(svg, "clipPath", { id: `inside-${id}` }), "rect", { x: left, y: top, width: width - left - right, height: full - top - bottom });
  clip.setAttribute("rx", 0);
  const columns = width < 330 ? 1 : 2;
  curves.forEach((one, k) => {
    const points = one.x.map((value, i) => (value < x.range[0] * (1 - 1e-9) || value > x.range[1] * (1 + 1e-9) || one.y[i] === null ? "" : `${px(value).toFixed(1)},${py(one.y[i]).toFixed(1)}`)).filter(Boolean);
    draw(svg, "polyline", { class: `curve ${one.look}`, points: points.join(" "), "clip-path": `url(#inside-${id})` });
    const lx = left + (k % columns) * (width - left - right) / columns, ly = 14 + 20 * Math.floor(k / columns);
    draw(svg, "line", { class: `curve ${one.look}`, x1: lx, x2: lx + 26, y1: ly - 4, y2: ly - 4 });
    draw(svg, "text", { x: lx + 32, y: ly }, one.name);
  });
  place.replaceChildren(svg);
}

// An axis keeps its range as long as the curves fit and fill a third of it: what moves is the curve and not the scale.
function range(id, values, least = 0) {
  const shown = values.filter((value) => value !== null), low = Math.min(0, ...shown), high = Math.max(least, ...shown);
  const known = scales[id];
  if (!known || low < known[0] || high > known[1] || high - low < 0.33 * (known[1] - known[0])) scales[id] = [low < 0 ? 1.15 * low : 0, 1.15 * high];
  return scales[id];
}

const both = (pick) => [...pick(latest.new), ...pick(latest.present)];

function plots() {
  if (!latest) return;
  const now = latest.new, was = latest.present, hz = { label: "frequency, Hz", log: true, range: [0.3, now.open_loops.freq_hz.at(-1)] };
  const loops = (kind) => [["velocity loop", "first", now], ["position loop", "second", now], ["present velocity", "first was", was], ["present position", "second was", was]].map(([name, look, one]) => (
    { name, look, x: one.open_loops.freq_hz, y: one.open_loops[`${name.includes("velocity") ? "velocity" : "position"}_${kind}`] }));
  plot("gain", hz, { label: "gain, dB", range: [-60, 40], mark: 0, ticks: [-60, -40, -20, 0, 20, 40] }, loops("db"));
  plot("phase", hz, { label: "phase, degrees", range: [-360, 0], mark: -180, ticks: [-360, -270, -180, -90, 0] }, loops("deg"));
  const span = { label: "time, s", range: [0, now.responses.t_s.at(-1)] };
  plot("step", span, { label: "share of the step", range: range("step", both((one) => [...one.responses.position, ...one.responses.velocity])), mark: 1 }, [
    { name: "speed", look: "first", x: now.responses.t_s, y: now.responses.velocity }, { name: "position", look: "second", x: now.responses.t_s, y: now.responses.position },
    { name: "present speed", look: "first was", x: was.responses.t_s, y: was.responses.velocity }, { name: "present position", look: "second was", x: was.responses.t_s, y: was.responses.position }]);
  const mm = (one) => one.responses.disturbance_m.map((value) => (value === null ? null : 1e3 * value));
  plot("disturbance", span, { label: `mm on ${begun.disturbance_nm} N m`, range: range("disturbance", both(mm)) }, [
    { name: "position at the motor", look: "first", x: now.responses.t_s, y: mm(now) }, { name: "present", look: "first was", x: was.responses.t_s, y: mm(was) }]);
}

function plotTracked() {
  if (!tracked) return;
  const now = tracked.new, was = tracked.present;
  plot("tracking", { label: "time, s", range: [0, now.t_s.at(-1)] }, { label: "reference − position, mm", range: range("tracking", [...now.motor_mm, ...now.cart_mm, ...was.motor_mm, ...was.cart_mm]), mark: 0 }, [
    { name: "motor", look: "first", x: now.t_s, y: now.motor_mm }, { name: "carriage", look: "second", x: now.t_s, y: now.cart_mm },
    { name: "present, motor", look: "first was", x: was.t_s, y: was.motor_mm }, { name: "present, carriage", look: "second was", x: was.t_s, y: was.cart_mm }]);
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
  $("payload").value = setting.payload_kg;
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
  const slider = element("input", { type: "range", id: name, min: low, max: high, step: 0.1 });
  const box = element("input", { type: "number", id: `box-${name}`, min: low, max: high, step: 0.1 });
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

let round = 0;
async function presets() {
  const mine = ++round, best = {};
  $("paces").replaceChildren(element("td"), ...begun.paces.map((pace) => element("th", { scope: "col" }, pace.title)));
  $("kinds").replaceChildren(...begun.kinds.map((kind) => element("tr", { title: kind.words }, element("th", { scope: "row" }, kind.title),
    ...begun.paces.map((pace) => element("td", {}, element("button", { type: "button", id: `preset-${kind.key}-${pace.key}`, disabled: true }, "…"))))));
  for (const pace of begun.paces) for (const kind of begun.kinds) {
    while (busy || saving) await new Promise((go) => setTimeout(go, 50));
    if (mine !== round) return;
    const found = await ask("preset", { setting, kind: kind.key, pace: pace.key }).catch((problem) => ({ setting: null, refusal: problem.message }));
    if (mine !== round) return;
    const button = $(`preset-${kind.key}-${pace.key}`);
    button.dataset.ready = "true";
    if (!found.setting) {
      button.textContent = "not possible";
      button.title = found.refusal;
      continue;
    }
    button.disabled = false;
    button.replaceChildren(`${number(found.position_crossover_hz)} Hz`, element("br"), `${number(1e3 * found.dynamic_m)} mm`);
    button.title = `${kind.words}; ${pace.title}: position bandwidth ${number(found.position_crossover_hz)} Hz, predicted error ${number(1e3 * found.dynamic_m)} mm`;
    button.setAttribute("aria-label", `${kind.title}, ${button.title}`);
    const { position_m, loaded } = found.setting, { payload_kg } = setting;
    button.addEventListener("click", () => turn({ ...found.setting, payload_kg, position_m: setting.position_m ?? position_m, loaded: setting.loaded ?? loaded }));
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
    const found = await ask("save", setting);
    $("saved").className = found.failed || found.doubts.length ? "doubtful" : "";
    $("saved").replaceChildren(
      element("b", {}, found.failed ? "Saved, but not to be used: " : "Saved. "), `${found.doubts.join("; ")}${found.doubts.length ? ". " : ""}The design before is kept as ${found.replaced}. Nothing was written to a drive. Next, in a terminal:`,
      ...found.next.map((line) => element("pre", {}, line)), "The first proves the gains by a move, which the second asks for.",
      element("details", {}, element("summary", {}, "The proof"), element("pre", {}, found.lines.join("\n"))));
  } catch (problem) {
    $("saved").className = "doubtful";
    $("saved").textContent = `Not saved: ${problem.message}`;
  }
  $("saved").scrollIntoView({ block: "nearest" });
  saving = false;
  $("save").disabled = !$("refusal").hidden;
}

async function begin() {
  begun = await ask("begin", {});
  setting = begun.setting;
  document.title = `beltcomm tune – ${begun.axis}`;
  $("axis").textContent = begun.axis;
  $("run").textContent = begun.run;
  for (const name of ["phase_margin_deg", "suppression_db", "position_phase_margin_deg"]) knob(name);
  $("prefilter").append(...Object.entries(begun.prefilters).map(([key, one]) => element("option", { value: key }, prefilterName(one))));
  $("lag").append(...begun.velocity_filters_s.map((lag) => element("option", { value: lag }, `${number(1e3 * lag)} ms`)));
  Object.assign($("position"), { min: 1e3 * begun.ends_m[0], max: 1e3 * begun.ends_m[1], step: 1 });
  $("payload").max = begun.most_payload_kg;
  $("where").textContent = `The gains hold at both ends of the travel, with and without the payload, for every friction; ${number(begun.mounted_kg)} kg move without it.`;
  $("move").textContent = `The ${begun.move}, with the present feedforward.` + (begun.compensated.length ? ` \`verify\` sends torque for ${begun.compensated.join(", ")} along; that is not in here.` : "");
  $("prefilter").addEventListener("change", () => turn({ prefilter: $("prefilter").value }));
  $("lag").addEventListener("change", () => turn({ velocity_filter_s: Number($("lag").value) }));
  $("payload").addEventListener("change", () => {
    const payload = Math.min(Math.max(Number($("payload").value) || 0, 0), begun.most_payload_kg);
    turn({ payload_kg: payload, loaded: payload > 0 });
    presets();
  });
  $("loaded").addEventListener("change", () => turn({ loaded: $("loaded").checked }));
  $("position").addEventListener("input", () => turn({ position_m: Number($("position").value) / 1e3 }));
  $("reset").addEventListener("click", () => turn(begun.setting));
  $("save").addEventListener("click", save);
  $("controls").addEventListener("submit", (event) => event.preventDefault());
  let width = 0;
  new ResizeObserver(() => {
    if (width === $("gain").clientWidth) return;
    width = $("gain").clientWidth;
    plots();
    plotTracked();
  }).observe($("figures"));
  place();
  changed();
  presets();
}

begin().catch((problem) => refuse(problem.message, "Reload the page"));
