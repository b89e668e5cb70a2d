// Words and units of axes that are no belts: what stands on the page is said by the program in those of this axis, as every screen is.

const known = new Map(), asked = new Map(), own = new WeakMap(), MOST = 200;
let ask = null, due = false;

/** From now on every text on the page is said in the axis's words; the numbers as they stand are right in the units said. */
export function sayAll(question) {
  ask = question;
  new MutationObserver((changes) => changes.forEach((one) => (one.type === "characterData" ? take(one.target) : one.addedNodes.forEach(below))))
    .observe(document.body, { subtree: true, childList: true, characterData: true });
  below(document.body);
  for (const [text, heard] of early) said(text, heard);
}

const early = [];

/** Hands a text to `heard` in the axis's words, once they are known; and as label of an axis, with the factor of its numbers. */
export function said(text, heard) {
  if (!ask) early.push([text, heard]);
  else if (known.has(text)) heard(...known.get(text));
  else {
    asked.set(text, [...(asked.get(text) || []), heard]);
    if (!due) setTimeout(inquire, 0);
    due = true;
  }
}

function below(node) {
  if (node.nodeType === Node.TEXT_NODE) take(node);
  else if (node.nodeType === Node.ELEMENT_NODE && !node.matches("script, style, code")) node.childNodes.forEach(below);
}

function take(node) {
  const text = node.data;
  if (own.get(node) === text || !/[A-Za-zµ°]/.test(text) || node.parentElement?.closest("script, style, code, option:not([value])")) return;
  said(text, (words) => {
    if (node.data !== text) return;
    own.set(node, words);
    if (words !== text) node.data = words;
  });
}

async function inquire() {
  due = false;
  const texts = [...asked.keys()].slice(0, MOST), heard = texts.map((text) => asked.get(text));
  texts.forEach((text) => asked.delete(text));
  if (asked.size) { due = true; setTimeout(inquire, 0); }
  try {
    const found = await ask("words", { texts });
    texts.forEach((text, k) => { known.set(text, [found.texts[k], found.labels[k]]); heard[k].forEach((one) => one(...known.get(text))); });
  } catch { /* the page says itself that its program has ended; what stands there stays */ }
}
