// Residuals in the machine's volume, as arrows along the measured direction.
import {t} from "../shared/language.js";
import {el, number} from "../shared/dom.js";
import {max, min} from "./scatter.js";
import {line, Space} from "../shared/space.js";
import {colours} from "../shared/theme.js";

const REACH = 0.14;
const FLAT = 0.02; // of the other sides: a plane

export class Volume extends Space {
  /** `many`: there are more rows than are drawn, and the server knows them. */
  constructor(linked, part, reach, many = false) {
    const {rows} = linked;
    const indices = [...rows.row.keys()].filter((i) => rows.part[i] === part);
    super([0, 1, 2].map((k) => {
      const own = indices.map((i) => rows.place[3 * i + k]);
      return [min(own), max(own)];
    }), ["X", "Y", "Z"], t("Residuals in the volume. The tables select rows, too."));
    // of a lathe's plane X-Z the broad side is seen, and Y in perspective still
    const wide = this.ends.map(([a, b]) => b - a);
    if (wide[1] < FLAT * Math.min(wide[0], wide[2])) this.turn = [-0.3, 0.25];
    else if (wide[0] < FLAT * Math.min(wide[1], wide[2])) this.turn = [-1.3, 0.25];
    this.linked = linked;
    this.reach = reach;
    [this.part, this.many] = [part, many];
    this.selects = false;
    this.indices = indices;
    const mode = el("button", {"aria-pressed": "false", onclick: () => {
      this.selects = !this.selects;
      mode.setAttribute("aria-pressed", String(this.selects));
    }}, t("Select instead of turning"));
    this.node = el("figure", {class: "volume", "data-panel": `${part} volume`},
      el("figcaption", {}, t("In the volume: each arrow stands where the axes stood, along what was measured; blue is minus, orange plus; the longest is {size} {unit}. ", {size: number(reach / 1.05), unit: rows.units[part]}),
      mode),
      el("div", {}, this.canvas));
    linked.pictures.push(this);
  }

  #arrow(i) {
    const {rows, values} = this.linked;
    const from = [0, 1, 2].map((k) => rows.place[3 * i + k]);
    const long = (REACH * this.size * values[i]) / this.reach;
    const to = from.map((v, k) => v + long * rows.along[3 * i + k]);
    return [this.at(from), this.at(to)];
  }

  paint(pen) {
    if (!this.linked) return;
    const {values, chosen} = this.linked;
    const faint = chosen.size > 0;
    for (const strong of [false, true]) {
      pen.globalAlpha = faint && !strong ? 0.12 : 0.75;
      pen.lineWidth = faint && strong ? 2.5 : 1.6;
      for (const i of this.indices) {
        if ((faint && chosen.has(i)) !== strong) continue;
        const [[x, y], [toX, toY]] = this.#arrow(i);
        pen.strokeStyle = pen.fillStyle = values[i] < 0 ? colours().minus : colours().plus;
        line(pen, x, y, toX, toY);
        pen.fillRect(x - 1, y - 1, 2, 2);
        this.head(pen, x, y, toX, toY);
      }
    }
    pen.globalAlpha = pen.lineWidth = 1;
    this.node.dataset.selected = this.indices.filter((i) => chosen.has(i)).length;
    if (this.from && this.to && this.selects) {
      pen.strokeStyle = colours().ink;
      pen.strokeRect(this.from[0], this.from[1], this.to[0] - this.from[0], this.to[1] - this.from[1]);
    }
  }

  select(a, b) {
    if (this.many) {
      // where a point of space lies on the screen is linear: four points say it all
      const zero = this.at([0, 0, 0]);
      const ways = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map((p) => this.at(p).map((v, k) => v - zero[k]));
      const [right, up] = [0, 1].map((k) => [...ways.map((way) => way[k]), zero[k]]);
      this.linked.ask({space: {part: this.part, right, up, long: (REACH * this.size) / this.reach,
        x: [a[0], b[0]], y: [a[1], b[1]]}});
    } else this.linked.choose(this.indices.filter((i) => this.#arrow(i).some(([x, y]) =>
      (x - a[0]) * (x - b[0]) <= 0 && (y - a[1]) * (y - b[1]) <= 0)));
  }
}
