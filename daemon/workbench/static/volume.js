// Residuals in the machine's volume, as arrows along the measured direction: turned with the mouse.
import {el, number} from "./dom.js";
import {line, max, min, sharp} from "./scatter.js";

const HEIGHT = 420, REACH = 0.14;

export class Volume {
  constructor(linked, part, reach) {
    this.linked = linked;
    this.reach = reach;
    this.turn = [-0.6, 0.45];
    this.selects = false;
    const {rows} = linked;
    this.unit = rows.units[part];
    this.indices = [...rows.row.keys()].filter((i) => rows.part[i] === part);
    this.ends = [0, 1, 2].map((k) => {
      const own = this.indices.map((i) => rows.place[3 * i + k]);
      return [min(own), max(own)];
    });
    this.middle = this.ends.map(([a, b]) => 0.5 * (a + b));
    this.size = Math.hypot(...this.ends.map(([a, b]) => b - a)) || 1;
    this.canvas = el("canvas", {role: "img",
      "aria-label": "Residuals in the volume. The tables select rows, too."});
    const mode = el("button", {"aria-pressed": "false", onclick: () => {
      this.selects = !this.selects;
      mode.setAttribute("aria-pressed", String(this.selects));
    }}, "Select instead of turning");
    this.node = el("figure", {class: "volume", "data-panel": `${part} volume`},
      el("figcaption", {}, `In the volume: each arrow stands where the axes stood, along what was `
        + `measured; blue is minus, orange plus; the longest is ${number(reach / 1.05)} ${this.unit}. `,
      mode),
      el("div", {}, this.canvas));
    this.#listen();
    linked.pictures.push(this);
    new ResizeObserver(() => this.draw()).observe(this.canvas);
  }

  /** Where a point of the volume is on the canvas. */
  #at(p) {
    const [a, b] = this.turn;
    const [x, y, z] = p.map((v, k) => v - this.middle[k]);
    const [right, away] = [x * Math.cos(a) - y * Math.sin(a), x * Math.sin(a) + y * Math.cos(a)];
    const up = z * Math.cos(b) + away * Math.sin(b);
    const scale = (0.8 * Math.min(HEIGHT, this.canvas.clientWidth)) / this.size;
    return [this.canvas.clientWidth / 2 + scale * right, HEIGHT / 2 - scale * up];
  }

  #arrow(i) {
    const {rows, values} = this.linked;
    const from = [0, 1, 2].map((k) => rows.place[3 * i + k]);
    const long = (REACH * this.size * values[i]) / this.reach;
    const to = from.map((v, k) => v + long * rows.along[3 * i + k]);
    return [this.#at(from), this.#at(to)];
  }

  draw() {
    if (!this.canvas.clientWidth) return;
    const pen = sharp(this.canvas, HEIGHT);
    this.#box(pen);
    const {values, chosen} = this.linked;
    const faint = chosen.size > 0;
    for (const strong of [false, true]) {
      pen.globalAlpha = faint && !strong ? 0.12 : 0.75;
      pen.lineWidth = faint && strong ? 2.5 : 1.6;
      for (const i of this.indices) {
        if ((faint && chosen.has(i)) !== strong) continue;
        const [[x, y], [toX, toY]] = this.#arrow(i);
        pen.strokeStyle = pen.fillStyle = values[i] < 0 ? "#0072b2" : "#d55e00";
        line(pen, x, y, toX, toY);
        pen.fillRect(x - 1, y - 1, 2, 2);
        const away = Math.hypot(toX - x, toY - y);
        if (away > 6) this.#head(pen, x, y, toX, toY, away);
      }
    }
    pen.globalAlpha = pen.lineWidth = 1;
    this.node.dataset.selected = this.indices.filter((i) => chosen.has(i)).length;
    if (this.from && this.to && this.selects) {
      pen.strokeStyle = "#1b1f24";
      pen.strokeRect(this.from[0], this.from[1], this.to[0] - this.from[0], this.to[1] - this.from[1]);
    }
  }

  #head(pen, x, y, toX, toY, away) {
    const [u, v] = [(4 * (toX - x)) / away, (4 * (toY - y)) / away];
    pen.beginPath();
    pen.moveTo(toX, toY);
    pen.lineTo(toX - u - 0.6 * v, toY - v + 0.6 * u);
    pen.lineTo(toX - u + 0.6 * v, toY - v - 0.6 * u);
    pen.fill();
  }

  #box(pen) {
    const corner = (bits) => this.ends.map((end, k) => end[(bits >> k) & 1]);
    pen.strokeStyle = "#c3cad1";
    pen.fillStyle = "#1b1f24";
    pen.font = "13px system-ui, sans-serif";
    pen.textAlign = "center"; pen.textBaseline = "middle";
    for (let bits = 0; bits < 8; bits += 1)
      for (let k = 0; k < 3; k += 1)
        if (!(bits & (1 << k))) line(pen, ...this.#at(corner(bits)), ...this.#at(corner(bits | (1 << k))));
    // each axis is named at an edge that nothing stands before: the lowest, for Z that at the left
    for (let k = 0; k < 3; k += 1) {
      const [low, high] = this.ends[k];
      if (high === low) continue;
      const edges = [0, 1, 2, 3, 4, 5, 6, 7].filter((bits) => !(bits & (1 << k))).map((bits) => {
        const p = corner(bits);
        p[k] = 0.5 * (low + high);
        return this.#at(p);
      });
      const [x, y] = edges.sort((a, b) => (k === 2 ? a[0] - b[0] : b[1] - a[1]))[0];
      const words = `${"XYZ"[k]} ${number(low, 4)} … ${number(high, 4)} mm`;
      pen.textAlign = k === 2 || x < this.#at(this.middle)[0] ? "right" : "left";
      pen.fillText(words, x + (pen.textAlign === "right" ? -12 : 12), y + (k === 2 ? 0 : 12));
    }
  }

  #listen() {
    const at = (event) => {
      const box = this.canvas.getBoundingClientRect();
      return [event.clientX - box.left, event.clientY - box.top];
    };
    this.canvas.addEventListener("pointerdown", (event) => {
      this.canvas.setPointerCapture(event.pointerId);
      this.from = this.to = at(event);
    });
    this.canvas.addEventListener("pointermove", (event) => {
      if (!this.from) return;
      const now = at(event);
      if (!this.selects) {
        this.turn[0] += (now[0] - this.to[0]) / 150;
        this.turn[1] = Math.max(-1.5, Math.min(1.5, this.turn[1] + (now[1] - this.to[1]) / 150));
      }
      this.to = now;
      this.draw();
    });
    this.canvas.addEventListener("pointerup", () => {
      const [a, b] = [this.from, this.to];
      this.from = this.to = null;
      if (!this.selects || !a) return;
      this.linked.choose(this.indices.filter((i) => this.#arrow(i).some(([x, y]) =>
        (x - a[0]) * (x - b[0]) <= 0 && (y - a[1]) * (y - b[1]) <= 0)));
    });
  }
}
