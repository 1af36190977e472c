// Colours of the pictures, as the style sheet has them: light, dark, and on paper.
const NAMES = ["ink", "quiet", "line", "shade", "paper", "grid", "plus", "minus", "still", "accent",
  "first", "second", "third", "fourth", "fifth", "sixth", "seventh"];
const redraws = new Set();
let known = null;

/** Name → colour at present. */
export function colours() {
  if (!known) {
    const style = getComputedStyle(document.documentElement);
    known = Object.fromEntries(NAMES.map((n) => [n, style.getPropertyValue(`--${n}`).trim()]));
  }
  return known;
}

/** The colour of the k-th curve of a picture. */
export function curve(k) {
  return colours()[NAMES[10 + (k % 7)]];
}

/** Have `draw` called when the colours change; forgotten when its element is gone. */
export function onColours(element, draw) {
  redraws.add([new WeakRef(element), draw]);
}

function changed() {
  known = null;
  for (const entry of redraws) {
    if (entry[0].deref()?.isConnected) entry[1]();
    else redraws.delete(entry);
  }
}

matchMedia("(prefers-color-scheme: dark)").addEventListener("change", changed);
// paper is white, whatever the screen is
addEventListener("beforeprint", () => { document.documentElement.classList.add("on-paper"); changed(); });
addEventListener("afterprint", () => { document.documentElement.classList.remove("on-paper"); changed(); });
