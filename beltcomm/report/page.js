"use strict";
// A page's charts: the picture stays what is printed and what is seen without scripts; a click on it, or Enter, draws its curves anew by uPlot.
const VALUES = "Values and zoom", PICTURE = "Picture";
const named = JSON.parse(document.getElementById("colours").textContent);
const ink = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const shown = (value) => value == null ? "–" : Number(value.toPrecision(4)).toString();

function chart(panel, place, key) {
  const [time, ...rest] = uPlot.join(panel.curves.map((curve) => curve.xy));
  const axis = (label, extra) => ({ label, stroke: ink("--soft"), grid: { stroke: ink("--grid"), width: 1 }, ticks: { stroke: ink("--grid") }, ...extra });
  const drawn = new uPlot({
    width: Math.max(300, place.clientWidth), height: 260, title: panel.title,
    cursor: { sync: { key, scales: ["x", null] }, focus: { prox: 24 } },
    scales: { x: { time: false, distr: panel.log[0] ? 3 : 1 }, y: { distr: panel.log[1] ? 3 : 1 } },
    axes: [axis(panel.x), axis(panel.y, { size: 64 })],
    series: [{ label: panel.x, value: (_, v) => shown(v) }, ...panel.curves.map((curve) => {
      const stroke = named[curve.colour] ? ink(named[curve.colour]) : curve.colour;
      const marks = curve.dots ? { paths: () => null, points: { show: true, size: 3, fill: stroke } } : { points: { show: false } };
      return { label: curve.label || panel.y, stroke, width: 1.2, spanGaps: true, value: (_, v) => shown(v), ...marks };
    })],
  }, [time, ...rest], place);
  return drawn;
}

document.querySelectorAll("figure script").forEach((script, number) => {
  const figure = script.closest("figure"), picture = figure.querySelector(".scroll"), place = document.createElement("div");
  const button = document.createElement("button");
  let charts = [];
  place.className = "charts";
  place.hidden = true;
  button.textContent = VALUES;
  button.type = "button";
  picture.after(place);
  figure.querySelector("h3").append(" ", button);
  const draw = () => { charts = JSON.parse(script.textContent).map((panel) => chart(panel, place, `figure ${number}`)); };
  const change = () => {
    place.hidden = !place.hidden;
    picture.classList.toggle("away", !place.hidden);
    button.textContent = place.hidden ? VALUES : PICTURE;
    charts.forEach((one) => one.destroy());
    charts = [];
    if (!place.hidden) draw();
  };
  button.addEventListener("click", change);
  picture.addEventListener("click", change);
  addEventListener("resize", () => charts.forEach((one) => one.setSize({ width: Math.max(300, place.clientWidth), height: 260 })));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { if (charts.length) { change(); change(); } });
});

const parts = [...document.querySelectorAll("section details")];
let before = [];
addEventListener("beforeprint", () => { before = parts.filter((part) => !part.open); before.forEach((part) => { part.open = true; }); });
addEventListener("afterprint", () => before.forEach((part) => { part.open = false; }));
const reveal = (hash) => { const part = document.querySelector(`${hash || "#none"} > details`); if (part) part.open = true; };
addEventListener("hashchange", () => reveal(location.hash));
// A link to the part whose address the page already has changes no hash.
addEventListener("click", (event) => { const link = event.target.closest("a[href^='#']"); if (link) reveal(link.hash); });
reveal(location.hash);
