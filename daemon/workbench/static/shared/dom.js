// Elements, pictures and numbers. Text goes into the page as text only, never as HTML.
import {label} from "./language.js";
import {colours, letters, onColours} from "./theme.js";

/** An element: tag, properties (`class`, `on…`, attributes), children (elements or text). */
export function el(tag, properties = {}, ...children) {
  const made = document.createElement(tag);
  for (const [key, value] of Object.entries(properties)) {
    if (value === null || value === undefined || value === false) continue;
    if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
    else if (value === true) made.setAttribute(key, "");
    else made.setAttribute(key, String(value));
  }
  const own = TYPED.has(tag) ? (child) => child : typeset;
  made.append(...children.filter((child) => child !== null && child !== undefined).map(own));
  return made;
}

const TYPED = new Set(["code", "option"]); // what is copied, as it was typed

/** A text with true minus signs before its numbers: the commands print hyphens. */
export function typeset(text) {
  return typeof text === "string" ? text.replace(/(?<![^\s(])-(?=\d)/g, "−") : text;
}

/** A text in which of many numbers in a row, as a cause may have them, the first and the last stand. */
function briefly(text) {
  return typeof text === "string" ? text.replace(/((?:[^\s,]+,){3})(?:[−\d.]+,){4,}(?=[−\d])/g, "$1…,") : text;
}

/** A table of text cells; `last(i)` makes a further cell of row i. */
export function table(title, columns, found, last = null) {
  const cells = found.map((row) => row.map((text) => briefly(typeset(text))));
  const numeric = columns.map((_, k) => cells.some((row) => /^[−–]?[\d.]+( (°C|K|s|%|µm|mm|bar|hPa))?$/.test(row[k])));
  const side = (k) => (numeric[k] ? "number" : null);
  // a column without a name is no heading
  const head = columns.map((name, k) => (name ? el("th", {scope: "col", class: side(k)}, label(name)) : el("td", {})));
  const body = cells.map((row, i) => el("tr", {},
    ...row.map((text, k) => el("td", {class: side(k) ?? (text?.length > LONG ? "long" : null)},
      SHA256.test(text) ? el("code", {class: "sha"}, text) : text)),
    last ? el("td", {}, last(i)) : null));
  // what is wider than the window is scrolled with keys, too
  const words = title || columns.filter(Boolean).map(label).join(", ");
  return el("div", {class: "wide", tabindex: 0, role: "group", "aria-label": words}, el("table", {},
    title ? el("caption", {}, title) : null,
    el("thead", {}, el("tr", {}, ...head, last ? el("td", {}) : null)),
    el("tbody", {}, ...body)));
}

/** The figures that say most, each under its name; those of rotations stand in a line of their own. */
export function keyFigures(found) {
  const at = found.findIndex(([name]) => name.startsWith("rotations"));
  const lines = at > 0 ? [found.slice(0, at), found.slice(at)] : [found];
  return lines.map((own) => el("dl", {class: "key"}, ...own.map(([name, value, unit]) =>
    el("div", {}, el("dt", {}, label(name)), el("dd", {}, `${value} `, el("small", {}, label(unit)))))));
}

/** Other texts in the cells of such a table; false where it has other rows. */
export function refill(place, cells) {
  const rows = place.querySelectorAll("tbody tr");
  if (rows.length !== cells.length) return false;
  cells.forEach((row, i) => row.forEach((text, k) => write(rows[i].cells[k], text)));
  return true;
}

/** Put a text where it does not stand yet. */
export function write(node, text) {
  const shown = typeset(text);
  if (node.textContent !== shown) node.textContent = shown;
}

/** Fill a place anew where what it is made from has changed. */
export function fill(place, content, make) {
  const key = JSON.stringify(content);
  if (made.get(place) === key) return;
  made.set(place, key);
  place.replaceChildren(...make());
}

const made = new WeakMap();

/** A number for people: significant digits, a true minus sign, no exponent but a power of ten. */
export function number(value, digits = 3) {
  if (value === null || !Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size < 1e-12) return "0";
  if (size >= 1e-6 && size < 1e7) {
    const after = Math.max(0, digits - 1 - Math.floor(Math.log10(size)));
    const text = value.toFixed(Math.min(after, 20));
    return (text.includes(".") ? text.replace(/\.?0+$/, "") : text).replace("-", "−");
  }
  const [mantissa, power] = value.toExponential(digits - 1).split("e");
  const raised = [...power.replace("+", "")].map((c) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(c)]).join("");
  return `${mantissa.includes(".") ? mantissa.replace(/\.?0+$/, "") : mantissa}·10${raised}`.replace("-", "−");
}

/** A time that lasts, as people say it. */
export function lasting(seconds) {
  if (seconds < 90) return `${Math.round(seconds)} s`;
  const whole = Math.ceil(seconds / 60);
  return whole < 60 ? `${whole} min` : `${Math.floor(whole / 60)} h ${String(whole % 60).padStart(2, "0")} min`;
}

/** A moment as people write it. */
export function moment(text) {
  return /^\d{4}-\d\d-\d\dT/.test(text) ? text.slice(0, 16).replace("T", " ") : text;
}

/** Have `redraw` make something anew; what a person typed into fields stays, and where one types. */
export function keepingTyped(place, redraw) {
  const fields = () => [...place.querySelectorAll("input[id], textarea[id]")].filter((f) => !["password", "range", "file"].includes(f.type));
  const typed = new Map(fields().filter((f) => f.value !== f.defaultValue).map((f) => [f.id, f.value]));
  const {activeElement} = document;
  const at = place.contains(activeElement) ? activeElement.id : "";
  redraw();
  for (const field of fields()) if (typed.has(field.id)) field.value = typed.get(field.id);
  if (at && at !== document.activeElement?.id) document.getElementById(at)?.focus();
}

const LONG = 24; // letters of a cell that may be broken anywhere on paper
const SHA256 = /^[0-9a-f]{64}$/;
let plotly = null;

/** Draw a Plotly figure; the library is fetched when the first is drawn. */
export async function draw(place, figure) {
  plotly ??= new Promise((resolve, reject) => {
    document.head.append(el("script", {src: new URL("../plotly.min.js", import.meta.url), onload: resolve, onerror: reject}));
  });
  await plotly;
  const now = () => {
    // gone meanwhile: nothing of it stays behind
    if (!place.isConnected) return null;
    const shown = onScreen(figure);
    return Plotly.react(place, shown.data, {...shown.layout, autosize: true},
      {responsive: true, displaylogo: false, showSendToCloud: false, displayModeBar: false});
  };
  // a plot that was drawn anew in the same place has one way to be drawn in other colours
  const first = !drawing.has(place);
  drawing.set(place, now);
  await now();
  if (first) onColours(place, () => drawing.get(place)());
}

const drawing = new WeakMap();
const WORDS = new Set(["text", "name"]); // of a figure: titles of axes and names of curves
const LARGER = new Set(["size", "l", "r", "t", "b", "height"]); // of a figure, with its letters

/** Put other parts in a place; plots that stood there are let go of: Plotly listens to the window for each. */
export function replace(place, ...parts) {
  for (const plot of place.querySelectorAll(".js-plotly-plot")) Plotly.purge(plot);
  place.replaceChildren(...parts);
}

/** Figures have colours for paper, and letters of a usual screen; what is on the screen may be dark, or very wide. */
function onScreen(figure) {
  const c = colours();
  const instead = {"#1b1f24": c.ink, "#000000": c.ink, "#57606a": c.quiet, "#e6e9ec": c.grid,
    "#9aa4ae": c.still, "#0072b2": c.first, "#d55e00": c.second, "#009e73": c.third,
    "#cc79a7": c.fourth, "#e69f00": c.fifth, "#56b4e9": c.sixth, "#d8dce0": c.line, "#ffffff": c.paper};
  const size = letters();
  const shown = JSON.parse(JSON.stringify(figure).replace(/"(#[0-9a-f]{6})"/g, (all, colour) =>
    (instead[colour] ? `"${instead[colour]}"` : all)), (key, value) =>
    (WORDS.has(key) && typeof value === "string" ? typeset(label(value)) : size > 1 && typeof value === "number" && LARGER.has(key) ? value * size : value));
  shown.layout.font = {size: 12 * size, ...shown.layout.font};
  return shown;
}
