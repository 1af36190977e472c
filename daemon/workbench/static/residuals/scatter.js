// A picture of residuals against something, on a canvas: thousands of points, redrawn in a blink.
import {label, t} from "../shared/language.js";
import {Density} from "./density.js";
import {el, number} from "../shared/dom.js";
import {meanLine} from "./means.js";
import {drawnAsItIsWide, line, placeOf, roomOf, sharp} from "../shared/space.js";
import {colours, onColours} from "../shared/theme.js";

const SIDES = {1: "minus", "-1": "plus", 0: "still"}; // names of colours, by side of approach
const ORDER = [0, 1, -1]; // sides, as the server counts them
const FAINT = 0.13;
const EDGE = {left: 46, right: 8, top: 8, bottom: 34};
const PARTS = 12;

/** Round numbers between two ends. */
export function ticks(low, high, count = 5) {
  const rough = (high - low) / count || 1;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((k) => k * power).find((s) => s >= rough);
  const out = [];
  for (let v = Math.ceil(low / step) * step; v <= high + 1e-9 * step; v += step)
    out.push(Math.abs(v) < 1e-9 * step ? 0 : v);
  return out;
}

export class Scatter {
  /**
   * One panel: `panel` as the server lists it, `reach` the greatest residual that is shown; the
   * element is `node`. Of more rows than are drawn one by one `cells` says how many lie where.
   */
  constructor(panel, linked, reach, cells = null) {
    this.cells = cells;
    this.density = cells && new Density(cells);
    this.number = panel.number;
    this.linked = linked;
    this.reach = reach;
    this.unit = linked.rows.units[panel.part];
    [this.x, this.label, this.side] = across(panel, linked.rows);
    const measured = panel.measured;
    this.indices = [...linked.rows.row.keys()].filter((i) => linked.rows.part[i] === panel.part
      && (measured === undefined || linked.rows.measured[i] === measured)
      && this.x[i] !== null && this.x[i] !== undefined);
    const own = this.indices.map((i) => this.x[i]);
    [this.low, this.high] = cells ? cells.ends : padded(min(own), max(own));
    this.canvas = el("canvas", {role: "img",
      "aria-label": t("Residuals {where}: {n} rows. The tables select rows, too.", {where: label(panel.title), n: cells ? cells.n : own.length})});
    this.tip = el("output", {class: "tip", hidden: true});
    this.node = el("figure", {class: "scatter", "data-panel": `${panel.part} ${panel.title}`},
      el("figcaption", {}, label(panel.title)), el("div", {}, this.canvas, this.tip));
    this.#listen();
    linked.pictures.push(this);
    onColours(this.canvas, () => this.draw());
    drawnAsItIsWide(this.canvas, () => this.draw());
  }

  get #wide() { return this.room[0] - EDGE.left - EDGE.right; }
  get #tall() { return this.room[1] - EDGE.top - EDGE.bottom; }
  #at(x) { return EDGE.left + ((x - this.low) / (this.high - this.low)) * this.#wide; }
  #px(i) { return this.#at(this.x[i]); }
  #py(v) { return EDGE.top + (0.5 - (0.5 * v) / this.reach) * this.#tall; }

  #x(px) { return this.low + ((px - EDGE.left) / this.#wide) * (this.high - this.low); }
  #y(py) { return this.reach * (1 - (2 * (py - EDGE.top)) / this.#tall); }

  draw() {
    if (!this.canvas.clientWidth) return;
    this.room = roomOf(this.canvas);
    const pen = sharp(this.canvas);
    this.#axes(pen);
    if (this.cells) this.#counted(pen);
    else this.#single(pen);
    if (this.from && this.to) {
      pen.strokeStyle = colours().ink;
      pen.setLineDash([4, 3]);
      pen.strokeRect(this.from[0], this.from[1], this.to[0] - this.from[0], this.to[1] - this.from[1]);
      pen.setLineDash([]);
    }
  }

  /** All rows, counted; those chosen before the others. */
  #counted(pen) {
    const chosen = this.linked.counted;
    const box = [EDGE.left, EDGE.top, this.#wide, this.#tall];
    this.density.draw(pen, this.cells, ...box, Boolean(chosen));
    if (!chosen) this.#curves(pen, [0, 1, 2].map((k) => this.cells.means[k]));
    const own = chosen?.panels[this.number];
    if (own) {
      this.front ??= new Density(this.cells);
      this.front.draw(pen, own, ...box);
    }
    this.node.dataset.selected = own?.n ?? 0;
  }

  /** Row by row. */
  #single(pen) {
    const {values, before, chosen} = this.linked;
    if (before) {
      pen.fillStyle = colours().still;
      pen.globalAlpha = 0.5;
      for (const i of this.indices) pen.fillRect(this.#px(i) - 1.5, this.#py(before[i]) - 1.5, 3, 3);
    }
    const faint = chosen.size > 0;
    pen.globalAlpha = faint ? FAINT : before ? 0.8 : 0.45;
    for (const i of this.indices) if (!chosen.has(i)) this.#mark(pen, i, values[i], 3);
    pen.globalAlpha = 1;
    if (!faint && !before) this.#means(pen, values);
    if (faint) for (const i of this.indices) if (chosen.has(i)) this.#mark(pen, i, values[i], 4.5);
    this.node.dataset.selected = this.indices.filter((i) => chosen.has(i)).length;
  }

  /** Up and down by shape as well as by colour. */
  #mark(pen, i, value, size) {
    if (value === null) return;
    const [x, y, side] = [this.#px(i), this.#py(value), this.side[i] ?? 0];
    // grey is what was before
    pen.fillStyle = colours()[side === 0 && this.linked.before ? "third" : SIDES[side]];
    pen.beginPath();
    if (side === 0) pen.arc(x, y, 0.7 * size, 0, 7);
    else {
      pen.moveTo(x, y - side * size);
      pen.lineTo(x - size, y + 0.7 * side * size);
      pen.lineTo(x + size, y + 0.7 * side * size);
    }
    pen.fill();
  }

  /** The mean of each side, along the picture; set-ups are beside one another by chance. */
  #means(pen, values) {
    if (!this.label) return;
    this.#curves(pen, ORDER.map((side) => {
      const own = this.indices.filter((i) => (this.side[i] ?? 0) === side && values[i] !== null);
      if (own.length < 6) return [];
      const x = own.map((i) => this.x[i]);
      const part = x.map((at) => Math.min(PARTS - 1,
        Math.floor(((at - this.low) / (this.high - this.low)) * PARTS)));
      return meanLine(x, own.map((i) => values[i]), part, PARTS);
    }));
  }

  /** A curve for each side, in the order of `ORDER`. */
  #curves(pen, curves) {
    curves.forEach((points, k) => {
      for (const [width, colour] of [[6, colours().paper], [3, colours()[SIDES[ORDER[k]]]]]) {
        pen.strokeStyle = colour; pen.lineWidth = width; pen.lineJoin = "round";
        pen.beginPath();
        for (const [x, v] of points) pen.lineTo(this.#at(x), this.#py(v));
        pen.stroke();
      }
      pen.lineWidth = 1;
    });
  }

  #axes(pen) {
    pen.font = "12px system-ui, sans-serif";
    pen.lineWidth = 1;
    pen.textBaseline = "middle"; pen.textAlign = "right";
    for (const v of ticks(-this.reach, this.reach, 7)) {
      pen.strokeStyle = v === 0 ? colours().still : colours().grid;
      line(pen, EDGE.left, this.#py(v), EDGE.left + this.#wide, this.#py(v));
      pen.fillStyle = colours().quiet;
      pen.fillText(number(v), EDGE.left - 6, this.#py(v));
    }
    pen.textAlign = "center"; pen.textBaseline = "top";
    if (this.label) {
      for (const v of ticks(this.low, this.high, Math.max(2, this.#wide / 80))) {
        const x = this.#at(v);
        pen.strokeStyle = colours().grid;
        line(pen, x, EDGE.top, x, EDGE.top + this.#tall);
        pen.fillStyle = colours().quiet;
        pen.fillText(number(v, 4), x, this.room[1] - EDGE.bottom + 4);
      }
      pen.fillText(this.label, EDGE.left + this.#wide / 2, this.room[1] - 14);
    } else pen.fillText(t("one column for each set-up"), EDGE.left + this.#wide / 2, this.room[1] - 22);
    pen.save();
    pen.translate(9, EDGE.top + this.#tall / 2);
    pen.rotate(-Math.PI / 2);
    pen.fillText(this.unit, 0, -5);
    pen.restore();
  }

  #listen() {
    const at = (event) => {
      return placeOf(event, this.canvas);
    };
    this.canvas.addEventListener("pointerdown", (event) => {
      if (event.button) return;
      this.canvas.setPointerCapture(event.pointerId);
      this.from = at(event);
      this.to = null;
    });
    this.canvas.addEventListener("pointermove", (event) => {
      if (!this.from) { this.#point(at(event)); return; }
      this.to = at(event);
      this.draw();
    });
    const stop = () => { this.from = this.to = null; this.draw(); };
    this.canvas.addEventListener("pointerup", () => {
      if (!this.from) return;
      const [a, b] = [this.from, this.to];
      this.from = this.to = null;
      if (!b || Math.hypot(b[0] - a[0], b[1] - a[1]) < 4) { this.linked.choose([]); return; }
      if (this.cells) {
        const box = {x: [a, b].map(([x]) => this.#x(x)), y: [a, b].map(([, y]) => this.#y(y))};
        this.linked.ask({box: {panel: this.number, ...box}});
      } else this.linked.choose(this.indices.filter((i) => {
        const [x, y] = [this.#px(i), this.#py(this.linked.values[i])];
        return (x - a[0]) * (x - b[0]) <= 0 && (y - a[1]) * (y - b[1]) <= 0;
      }));
    });
    this.canvas.addEventListener("pointercancel", stop);
    this.canvas.addEventListener("pointerleave", () => { this.tip.hidden = true; });
  }

  #point([x, y]) {
    let best = null, near = 8;
    for (const i of this.indices) {
      const away = Math.hypot(this.#px(i) - x, this.#py(this.linked.values[i]) - y);
      if (away < near) [best, near] = [i, away];
    }
    this.tip.hidden = best === null;
    if (best === null) return;
    this.tip.replaceChildren(...this.linked.label(best).map((text) => el("div", {}, text)));
    this.tip.style.top = `${(y + 14) / 16}rem`;
    this.tip.style.left = `${Math.max(0, Math.min(x, this.room[0] - 190)) / 16}rem`;
  }
}

/** Ends with a little room beside them. */
function padded(low, high) {
  if (low === high) return padded(low - 0.5, high + 0.5);
  const pad = 0.03 * (high - low);
  return [low - pad, high + pad];
}

/** What lies across a panel: a value for each row, its title, the side of approach of each. */
function across(panel, rows) {
  if (panel.by === "axis") {
    const axis = rows.axes[panel.axis];
    return [axis.at, `${panel.axis} (${axis.unit})`, axis.side];
  }
  if (panel.by === "signal") {
    const signal = rows.signals[panel.signal];
    return [signal.at, `${panel.signal} (${signal.unit})`, []];
  }
  return panel.by === "time" ? [rows.time, t("time (h)"), []] : [rows.setup, "", []];
}

export const min = (values) => values.reduce((a, b) => Math.min(a, b), Infinity);
export const max = (values) => values.reduce((a, b) => Math.max(a, b), -Infinity);

/** The greatest residual of each part. */
export function reaches(rows, values) {
  const reach = [0, 0];
  values.forEach((v, i) => { reach[rows.part[i]] = Math.max(reach[rows.part[i]], Math.abs(v)); });
  return reach.map((v) => 1.05 * v || 1);
}
