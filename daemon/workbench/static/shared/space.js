// A box in space on a canvas, turned with the mouse, a finger or the arrow keys; paper gets it as it stands.
import {t} from "./language.js";
import {el, number} from "./dom.js";
import {colours, letters, onColours} from "./theme.js";

const STEP = 0.12;
const SOON = 1000; // ms until a picture that is not in view is drawn at the latest

export class Space {
  /** `ends`: lowest and highest of X, Y, Z; `names` of the axes; `label` for who does not see it. */
  constructor(ends, names, label) {
    this.turn = [-0.6, 0.45];
    this.names = names;
    this.canvas = el("canvas", {role: "img", tabindex: 0, "aria-label": t("{what} Arrow keys turn it.", {what: label})});
    this.setEnds(ends);
    this.#listen();
    onColours(this.canvas, () => this.draw());
    drawnAsItIsWide(this.canvas, () => this.draw());
  }

  setEnds(ends) {
    this.ends = ends;
    this.middle = ends.map(([a, b]) => 0.5 * (a + b));
    const [x, y, z] = ends.map(([a, b]) => b - a);
    this.size = Math.hypot(x, y, z) || 1;
    [this.across, this.tall] = [Math.hypot(x, y) || 0.3 * this.size, z];
  }

  /** Where a point is on the canvas. */
  at(p) {
    const [a, b] = this.turn;
    const [x, y, z] = p.map((v, k) => v - this.middle[k]);
    const [right, away] = [x * Math.cos(a) - y * Math.sin(a), x * Math.sin(a) + y * Math.cos(a)];
    const up = z * Math.cos(b) + away * Math.sin(b);
    // room for the names of the axes beside and below; the same however far it is turned
    const [width, height] = this.room;
    const scale = Math.min((0.96 * width - (this.narrow ? 40 : 150)) / this.across,
      (height - 90) / (this.tall * Math.cos(b) + this.across * Math.abs(Math.sin(b)) || 1));
    return [width / 2 + scale * right, height / 2 - scale * up];
  }

  draw() {
    if (!this.canvas.clientWidth) return;
    this.room = roomOf(this.canvas);
    const pen = sharp(this.canvas);
    this.box(pen);
    this.paint(pen);
    this.named(pen);
  }

  /** Whether there is no room beside the box for more than the letters of the axes. */
  get narrow() { return this.room[0] < 420; }

  /** What stands in the box. */
  paint() {}

  /** A press that does not turn: whether it was taken. */
  pressed() { return false; }

  box(pen) {
    const corner = (bits) => this.ends.map((end, k) => end[(bits >> k) & 1]);
    pen.strokeStyle = colours().line;
    for (let bits = 0; bits < 8; bits += 1)
      for (let k = 0; k < 3; k += 1)
        if (!(bits & (1 << k))) line(pen, ...this.at(corner(bits)), ...this.at(corner(bits | (1 << k))));
  }

  /** The names of the axes, before all lines. */
  named(pen) {
    const corner = (bits) => this.ends.map((end, k) => end[(bits >> k) & 1]);
    pen.fillStyle = colours().ink;
    pen.strokeStyle = colours().paper;
    pen.font = "13px system-ui, sans-serif";
    pen.textAlign = "center"; pen.textBaseline = "middle";
    // each axis is named at an edge that nothing stands before: the lowest, for Z that at the left
    const ranges = [];
    for (let k = 0; k < 3; k += 1) {
      const [low, high] = this.ends[k];
      if (high === low) continue;
      const edges = [0, 1, 2, 3, 4, 5, 6, 7].filter((bits) => !(bits & (1 << k))).map((bits) => {
        const p = corner(bits);
        p[k] = 0.5 * (low + high);
        return this.at(p);
      });
      const [x, y] = edges.sort((a, b) => (k === 2 ? a[0] - b[0] : b[1] - a[1]))[0];
      // both ends as finely: three digits of the larger
      const after = Math.max(0, 2 - Math.floor(Math.log10(Math.max(Math.abs(low), Math.abs(high)))));
      const [from, to] = [low, high].map((end) => number(Number(end.toFixed(Math.min(after, 6))), 7));
      const range = `${this.names[k]} ${from} … ${to}`;
      if (this.narrow) ranges.push(range);
      const words = this.narrow ? this.names[k] : `${range} mm`;
      const left = k === 2 || x < this.at(this.middle)[0];
      const wide = pen.measureText(words).width;
      // what has no room beside the edge stands below it
      const beside = left ? x - 12 - wide : x + 12;
      pen.textAlign = "left";
      const place = [Math.max(2, Math.min(this.room[0] - wide - 2, beside)), y + (k === 2 ? 0 : 14)];
      [pen.lineWidth, pen.lineJoin] = [5, "round"];
      pen.strokeText(words, ...place);
      pen.fillText(words, ...place);
    }
    pen.lineWidth = 1;
    if (!ranges.length) return;
    pen.textAlign = "center";
    pen.fillText(`${ranges.join(", ")} mm`, this.room[0] / 2, this.room[1] - 12, this.room[0] - 4);
  }

  head(pen, x, y, toX, toY) {
    const away = Math.hypot(toX - x, toY - y);
    if (away <= 6) return;
    const [u, v] = [(4 * (toX - x)) / away, (4 * (toY - y)) / away];
    pen.beginPath();
    pen.moveTo(toX, toY);
    pen.lineTo(toX - u - 0.6 * v, toY - v + 0.6 * u);
    pen.lineTo(toX - u + 0.6 * v, toY - v - 0.6 * u);
    pen.fill();
  }

  #turned(right, up) {
    this.turn[0] += right;
    this.turn[1] = Math.max(-1.5, Math.min(1.5, this.turn[1] + up));
    this.draw();
  }

  #listen() {
    const at = (event) => {
      return placeOf(event, this.canvas);
    };
    this.canvas.addEventListener("pointerdown", (event) => {
      this.canvas.setPointerCapture(event.pointerId);
      this.from = this.to = at(event);
    });
    this.canvas.addEventListener("pointermove", (event) => {
      if (!this.from) return;
      const now = at(event), before = this.to;
      this.to = now;
      if (this.selects) this.draw();
      else this.#turned((now[0] - before[0]) / 150, (now[1] - before[1]) / 150);
    });
    this.canvas.addEventListener("pointerup", () => {
      const [a, b] = [this.from, this.to];
      this.from = this.to = null;
      if (this.selects && a) this.select(a, b);
    });
    this.canvas.addEventListener("pointercancel", () => { this.from = this.to = null; this.draw(); });
    this.canvas.addEventListener("keydown", (event) => {
      const way = {ArrowLeft: [-STEP, 0], ArrowRight: [STEP, 0], ArrowUp: [0, -STEP], ArrowDown: [0, STEP]}[event.key];
      if (!way) return;
      event.preventDefault();
      this.#turned(...way);
    });
  }
}

/** A Plotly figure whose traces are lines in space, drawn without the graphics card. */
export class FigureInSpace extends Space {
  constructor(figure, label) {
    super([[0, 1], [0, 1], [0, 1]], ["X", "Y", "Z"], label);
    this.show(figure);
  }

  show(figure) {
    this.traces = figure.data;
    // the box is what is indicated: the first trace
    const first = figure.data[0];
    this.setEnds(["x", "y", "z"].map((k) => ends(first[k])));
    this.names = ["x", "y", "z"].map((k) =>
      figure.layout.scene[`${k}axis`].title.text.replace(" (mm)", ""));
    this.draw();
  }

  paint(pen) {
    for (const trace of this.traces ?? []) {
      const {color, width, cmin, cmax, colorscale} = trace.line;
      const arrows = Array.isArray(color);
      pen.lineWidth = 0.5 * width;
      let last = null;
      for (let i = 0; i < trace.x.length; i += 1) {
        const p = [trace.x[i], trace.y[i], trace.z[i]];
        if (p[0] === null) { last = null; continue; }
        const now = this.at(p);
        if (last) {
          pen.strokeStyle = pen.fillStyle = arrows
            ? shade(colorscale, (color[i] - cmin) / (cmax - cmin)) : onScreen(color);
          line(pen, ...last, ...now);
          if (arrows) this.head(pen, ...last, ...now);
        }
        last = now;
      }
    }
    pen.lineWidth = 1;
  }
}

/** Figures have colours for paper; what is on the screen may be dark. */
function onScreen(colour) {
  return {"#0072b2": colours().minus, "#9aa4ae": colours().still}[colour] ?? colour;
}

function shade(scale, share) {
  const [from, to] = [scale[0][1], scale[scale.length - 1][1]].map((hex) =>
    [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16)));
  const s = Math.max(0, Math.min(1, share));
  return `rgb(${from.map((v, k) => Math.round(v + s * (to[k] - v))).join(" ")})`;
}

function ends(values) {
  const own = values.filter((v) => v !== null);
  return [own.reduce((a, b) => Math.min(a, b)), own.reduce((a, b) => Math.max(a, b))];
}

let finer = 0; // dots for each of the screen's; 0: as the screen

/** Have pictures drawn finer than the screen while `act` lasts. */
export async function drawnFiner(factor, act) {
  finer = factor;
  try {
    return await act();
  } finally {
    finer = 0;
  }
}

const draws = new WeakMap(); // canvas -> what draws it

/** Have a picture drawn when its size is known, and when it changes: at first after what is read, and what is in view before the rest. */
export function drawnAsItIsWide(canvas, draw) {
  draws.set(canvas, draw);
  new ResizeObserver(([{target}], observer) => {
    if (!target.clientWidth) return;
    observer.disconnect();
    // a picture that is gone meanwhile is kept by nothing
    const reference = new WeakRef(target);
    const begin = () => {
      const place = reference.deref();
      if (!place) return;
      // draws it now, too
      new ResizeObserver(() => draws.get(place)()).observe(place);
    };
    if (target.getBoundingClientRect().top < innerHeight) requestAnimationFrame(begin);
    else requestIdleCallback(begin, {timeout: SOON});
  }).observe(canvas);
}

/** How wide and high a canvas is where letters have their usual size: on a 4K screen all is drawn larger. */
export function roomOf(canvas) {
  return [canvas.clientWidth / letters(), canvas.clientHeight / letters()];
}

/** Where a pointer is on a canvas, in its room. */
export function placeOf(event, canvas) {
  const box = canvas.getBoundingClientRect();
  return [(event.clientX - box.left) / letters(), (event.clientY - box.top) / letters()];
}

/** A canvas's pen, as sharp as the screen. */
export function sharp(canvas) {
  const dots = finer || window.devicePixelRatio || 1;
  const [wide, tall] = [canvas.clientWidth, canvas.clientHeight].map((size) => Math.round(size * dots));
  const scale = dots * letters();
  if (canvas.width !== wide || canvas.height !== tall) [canvas.width, canvas.height] = [wide, tall];
  const pen = canvas.getContext("2d");
  pen.setTransform(scale, 0, 0, scale, 0, 0);
  pen.clearRect(0, 0, ...roomOf(canvas));
  return pen;
}

export function line(pen, x, y, toX, toY) {
  pen.beginPath();
  pen.moveTo(x, y);
  pen.lineTo(toX, toY);
  pen.stroke();
}
