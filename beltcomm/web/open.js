// The page's frame: tabs, what the program is asked, what it is busy with.  Nothing from outside.

import { element, shown } from "./chart.js";
import { laboratory } from "./laboratory.js";
import { design } from "./design.js";
import { live } from "./live.js";
import { runs } from "./runs.js";
import { sayAll } from "./words.js";

const $ = (id) => document.getElementById(id);

// The run that this window shows: that of `beltcomm open`, or another one beside it.
const chosen = new URLSearchParams(location.search).get("run") || "";

export async function ask(name, asked = {}, run = chosen) {
  let answer;
  try {
    answer = await fetch(name, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify({ run, asked }) });
  } catch {
    throw new Error("The program that serves this page has ended: nothing is computed or saved any more. Type beltcomm open again.");
  }
  const found = answer.headers.get("Content-Type") === "application/json" ? await answer.json() : { error: await answer.text() };
  if (!answer.ok) throw new Error(found.error || `the program answered with ${answer.status}`);
  return found;
}

const tabs = { laboratory: laboratory(ask), design: design(ask), live: live(ask), runs: runs(ask) };
const names = Object.keys(tabs);
let current = "";

function show(name) {
  if (!names.includes(name) || name === current) return;
  current = name;
  for (const one of names) {
    $(one).hidden = one !== name;
    $(`tab-${one}`).setAttribute("aria-selected", one === name);
    $(`tab-${one}`).tabIndex = one === name ? 0 : -1;
  }
  history.replaceState(null, "", `#${name}`);
  shown();
  tabs[name].show();
}

for (const [k, name] of names.entries()) {
  $(`tab-${name}`).addEventListener("click", () => show(name));
  $(`tab-${name}`).addEventListener("keydown", (event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1, Home: -k, End: names.length - 1 - k }[event.key];
    if (!step) return;
    const next = names[(k + step + names.length) % names.length];
    show(next);
    $(`tab-${next}`).focus();
  });
}
addEventListener("hashchange", () => show(location.hash.slice(1)));

document.querySelector("nav").hidden = false; // without scripts there is nothing to choose from

// The first sentence on the run, as every screen has it; asked for again where a model or a design is new.
let judged = "0 0";
async function judge() {
  const { headline } = await ask("begin");
  $("headline").className = `told ${headline.means}`;
  $("headline").replaceChildren(element("b", {}, headline.word), ` ${headline.sentence}`);
  $("headline").hidden = false;
  $("warnings").replaceChildren(...headline.warnings.map((words) => element("li", {}, `! ${words}`)));
  $("next").replaceChildren(...(headline.next.command ? ["Next: ", element("code", {}, headline.next.command), ` ${headline.next.why}`] : []));
}
addEventListener("saved", () => judge().catch((problem) => failed(problem.message)));

let ended = false;
export function failed(words) {
  $("failed").replaceChildren(...(words ? [element("span", {}, words)] : []));
  $("failed").hidden = !words;
}

async function look() {
  try {
    const state = await ask("laboratory-state");
    $("busy").hidden = !state.busy || current !== "laboratory";
    if (state.share === null) $("share").removeAttribute("value");
    else $("share").value = state.share;
    $("doing").textContent = state.busy ? `${state.busy} …` : "";
    failed(state.failed && current === "laboratory" ? `Not done: ${state.failed}` : "");
    await tabs.laboratory.heard(state);
    if (current === "design") await tabs.design.heard();
    if (judged !== `${state.version} ${state.rungs}`) {
      judged = `${state.version} ${state.rungs}`;
      await judge();
    }
  } catch (problem) {
    failed(problem.message);
    ended = problem.message.startsWith("The program");
    $("busy").hidden = true;
  }
  if (!ended) setTimeout(look, document.hidden ? 2000 : 400);
}

ask("begin").then((begun) => {
  document.title = `beltcomm – ${begun.axis || begun.run}`;
  if (begun.own_words) sayAll(ask);
  $("axis").textContent = begun.axis;
  $("run").textContent = begun.run;
  judge().catch((problem) => failed(problem.message));
  show(names.includes(location.hash.slice(1)) ? location.hash.slice(1) : begun.live ? "live" : "laboratory");
  look();
}).catch((problem) => failed(problem.message));
