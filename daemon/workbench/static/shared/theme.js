// Colours of the pictures, as the style sheet has them: light, dark, and on paper.
import {Attached} from "./attached.js";

const NAMES = ["ink", "quiet", "line", "shade", "paper", "grid", "plus", "minus", "still", "accent",
  "first", "second", "third", "fourth", "fifth", "sixth", "seventh"];
const redraws = new Attached();
let known = null;

/** Name → colour at present. */
export function colours() {
  if (!known) {
    const style = getComputedStyle(document.documentElement);
    known = Object.fromEntries(NAMES.map((n) => [n, style.getPropertyValue(`--${n}`).trim()]));
  }
  return known;
}

let sized = null;

/** How large letters are beside those of a usual screen: more on one that is very wide. */
export function letters() {
  sized ??= parseFloat(getComputedStyle(document.documentElement).fontSize) / 16 || 1;
  return sized;
}

// letters are measured anew; on another screen every picture is drawn with those of that one
addEventListener("resize", () => {
  const before = sized;
  sized = null;
  if (before !== null && letters() !== before) redraws.call();
});

/** The colour of the k-th curve of a picture. */
export function curve(k) {
  return colours()[NAMES[10 + (k % 7)]];
}

/** Have `draw` called when the colours change; forgotten when its element is gone. */
export function onColours(element, draw) {
  redraws.add(element, draw);
}

async function changed() {
  known = null;
  await Promise.all(redraws.call());
}

/** Have everything in the colours of paper while `act` lasts. */
export async function onPaper(act) {
  const root = document.documentElement.classList;
  root.add("on-paper");
  try {
    await changed();
    return await act();
  } finally {
    root.remove("on-paper");
    await changed();
  }
}

matchMedia("(prefers-color-scheme: dark)").addEventListener("change", changed);
// paper is white, whatever the screen is
addEventListener("beforeprint", () => { document.documentElement.classList.add("on-paper"); changed(); });
addEventListener("afterprint", () => { document.documentElement.classList.remove("on-paper"); changed(); });
