// The past of a run: a picture for each kind of series, the same time in all; zoom asks the server again.
import {label, line, t} from "../shared/language.js";
import {el, number} from "../shared/dom.js";
import {get, Outside, Refusal} from "../shared/server.js";
import {colours, curve, letters, onColours} from "../shared/theme.js";

const SPANS = {Hour: 3600, Day: 86400, Month: 30 * 86400};
const LAST = {Hour: t("Last hour"), Day: t("Last day"), Month: t("Last month")};
const FOLLOW = 10_000; // ms until the present is asked for again
const HEIGHT = 190;
let library = null;

/** The chart library; fetched when the first picture is drawn. */
function charts() {
  library ??= new Promise((resolve, reject) => {
    document.head.append(el("link", {rel: "stylesheet", href: new URL("../uplot/uplot.min.css", import.meta.url)}));
    document.head.append(el("script", {src: new URL("../uplot/uplot.min.js", import.meta.url), onload: resolve, onerror: reject}));
  });
  return library;
}

export class History {
  constructor() {
    this.span = "Hour";
    this.zooms = [];
    this.pictures = [];
    this.said = el("p", {class: "note", role: "status"}, t("Being read …"));
    this.buttons = Object.keys(SPANS).map((name) => el("button", {class: "small", "data-span": name,
      "aria-pressed": String(name === this.span), onclick: () => this.#choose(name)}, LAST[name]));
    const tool = (words, act) => el("button", {class: "small", onclick: act}, words);
    this.back = tool(t("Back"), () => { this.zooms.pop(); this.#load(); });
    this.place = el("div", {class: "panels charts"});
    this.node = el("section", {id: "history"}, el("h2", {}, t("History")),
      el("p", {class: "tools"}, ...this.buttons,
        tool(t("Earlier"), () => this.#zoom((a, b) => [a - 0.5 * (b - a), a + 0.5 * (b - a)])),
        tool(t("Later"), () => this.#zoom((a, b) => [a + 0.5 * (b - a), b + 0.5 * (b - a)])),
        tool(t("Closer"), () => this.#zoom((a, b) => [a + 0.25 * (b - a), b - 0.25 * (b - a)])),
        tool(t("Wider"), () => this.#zoom((a, b) => [a - 0.5 * (b - a), b + 0.5 * (b - a)])),
        this.back),
      this.said, this.place);
    this.timer = setInterval(() => { if (!this.zooms.length && this.span !== "Month") this.#load(); }, FOLLOW);
    this.#load();
  }

  close() {
    clearInterval(this.timer);
    for (const picture of this.pictures) picture.close();
  }

  #choose(name) {
    this.span = name;
    this.zooms = [];
    for (const b of this.buttons) b.setAttribute("aria-pressed", String(b.dataset.span === name));
    this.#load();
  }

  #zoom(change) {
    const [first, last] = change(...this.range);
    if (last - first > 2) this.zoomTo(first, last);
  }

  zoomTo(first, last) {
    this.zooms.push([first, last]);
    this.#load();
  }

  async #load() {
    const turn = this.turn = (this.turn ?? 0) + 1;
    this.back.disabled = !this.zooms.length;
    try {
      const [known] = await Promise.all([get("/api/live/history"), charts()]);
      if (turn !== this.turn) return;
      const now = Date.now() / 1000;
      const oldest = known.range ? known.range[0] : now - 60;
      this.range = this.zooms.at(-1) ?? [Math.max(now - SPANS[this.span], Math.min(oldest, now - 60)), now];
      this.#lay(known.pictures);
      this.said.textContent = known.pictures.length
        ? t("{from} to {to}. Lines are means, shades reach from the least to the greatest. Drag across a picture to see a part of it.", {from: when(this.range[0]), to: when(this.range[1])})
        : t("Nothing has been recorded yet.");
      await Promise.all(this.pictures.map((picture) => picture.load(...this.range)));
      [this.node.dataset.first, this.node.dataset.last] = this.range.map((t) => t.toFixed(3));
      this.node.dataset.ready = String(turn);
    } catch (error) {
      if (turn === this.turn) this.said.textContent = error instanceof Refusal && !(error instanceof Outside) ? line(error.message) : t("The records cannot be read now.");
    }
  }

  #lay(wanted) {
    const key = JSON.stringify(wanted);
    if (key === this.key) return;
    this.key = key;
    for (const picture of this.pictures) picture.close();
    this.pictures = wanted.map((w) => new PastPicture(w, (first, last) => this.zoomTo(first, last)));
    this.place.replaceChildren(...this.pictures.map((picture) => picture.node));
  }
}

class PastPicture {
  constructor(wanted, zoom) {
    this.wanted = wanted;
    this.zoom = zoom;
    this.place = el("div", {class: "chart", role: "img", "aria-label": t("{what}, over time; the numbers stand below.", {what: label(wanted.title)})});
    this.values = wanted.series.map(() => el("span", {class: "number"}));
    this.names = wanted.series.map((name, k) => el("span", {class: "curve"},
      el("i", {class: `swatch swatch-${k % 7}`}), `${label(name)} `, this.values[k]));
    this.node = el("figure", {class: "past", "data-picture": wanted.name},
      el("figcaption", {}, `${label(wanted.title)}, ${wanted.unit}`), this.place,
      el("div", {class: "legend"}, ...this.names));
    this.observer = new ResizeObserver(() => {
      if (this.letters !== letters()) this.#draw();
      else this.chart?.setSize({width: this.place.clientWidth, height: HEIGHT * letters()});
    });
    this.observer.observe(this.place);
    onColours(this.place, () => this.#draw());
  }

  close() {
    this.observer.disconnect();
    this.chart?.destroy();
  }

  async load(first, last) {
    this.found = await get(`/api/live/picture?${new URLSearchParams({name: this.wanted.name, first, last})}`);
    if (this.chart?.series.length !== 1 + 3 * this.found.series.length) return this.#draw();
    // the same picture with other values: no new one for each look at the present
    this.chart.setSelect({left: 0, top: 0, width: 0, height: 0}, false);
    this.chart.setData(this.#values());
    this.#drawn();
  }

  #values() {
    return [this.found.time, ...this.found.series.flatMap((s) => [s.mean, s.least, s.greatest])];
  }

  #drawn() {
    this.node.dataset.points = String(this.found.time.length * this.found.series.length);
    this.#say(null);
  }

  #draw() {
    if (!this.found || !this.place.clientWidth) return;
    this.chart?.destroy();
    this.letters = letters();
    const {series} = this.found;
    const thin = {stroke: "transparent", width: 0, points: {show: false}};
    this.chart = new uPlot({
      width: this.place.clientWidth, height: HEIGHT * letters(), legend: {show: false},
      scales: {x: {time: true, range: () => [this.found.first, this.found.last]}, y: {range: (_, low, high) => around(low, high)}},
      cursor: {sync: {key: "past"}, drag: {x: true, y: false, setScale: false}, points: {show: false}},
      series: [{}, ...series.flatMap((_, k) => [
        {stroke: curve(k), width: 1.6, points: {show: () => this.found.time.length < 3}}, thin, thin])],
      bands: series.map((_, k) => ({series: [3 * k + 3, 3 * k + 2], fill: `color-mix(in srgb, ${curve(k)} 22%, transparent)`})),
      axes: [{...axis(), space: 76 * letters(), size: 50 * letters(), values: (_, splits, __, ___, step) => clock(splits, step)},
        {...axis(), size: 62 * letters(), space: 30 * letters(), values: (_, splits) => splits.map((v) => number(v, 5))}],
      hooks: {
        setSelect: [(u) => {
          if (u.select.width < 5) return;
          this.zoom(u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x"));
        }],
        setCursor: [(u) => this.#say(u.cursor.idx)],
      },
    }, this.#values(), this.place);
    this.#drawn();
  }

  /** The numbers at the pointer, or the last ones. */
  #say(at) {
    this.found.series.forEach((s, k) => {
      let i = at ?? s.mean.length - 1;
      while (at === null && i > 0 && s.mean[i] === null) i -= 1;
      const [mean, low, high] = [s.mean[i], s.least[i], s.greatest[i]];
      this.values[k].textContent = mean === null || mean === undefined ? "–"
        : low === high ? fixed(mean) : `${fixed(mean)} (${fixed(low)} … ${fixed(high)})`;
    });
  }
}

/** To a hundredth, where that is much less than what is shown. */
function fixed(value) {
  return (Math.abs(value) < 1000 ? value.toFixed(Math.abs(value) < 100 ? 2 : 1) : number(value))
    .replace("-", "−");
}

function axis() {
  const {quiet, grid} = colours();
  return {stroke: quiet, font: `${12 * letters()}px system-ui, sans-serif`, grid: {stroke: grid, width: 1}, ticks: {stroke: grid, width: 1}};
}

/** Ends of the vertical scale with some room; never closer than one can read. */
function around(low, high) {
  if (low === null || low === undefined) return [0, 1];
  const room = Math.max(0.08 * (high - low), 0.02 * Math.max(Math.abs(low), Math.abs(high)), 0.01);
  return [low - room, high + room];
}

const two = (n) => String(n).padStart(2, "0");
const day = (d) => `${d.getFullYear()}-${two(d.getMonth() + 1)}-${two(d.getDate())}`;

/** Times below a picture: clock, or days where the clock says nothing. */
function clock(splits, step) {
  return splits.map((s) => {
    const d = new Date(1000 * s);
    if (step >= 86400 || (d.getHours() === 0 && d.getMinutes() === 0 && d.getSeconds() === 0)) return day(d).slice(5);
    return `${two(d.getHours())}:${two(d.getMinutes())}${step < 60 ? `:${two(d.getSeconds())}` : ""}`;
  });
}

/** A moment for people. */
export function when(seconds) {
  const d = new Date(1000 * seconds);
  return `${day(d)} ${two(d.getHours())}:${two(d.getMinutes())}:${two(d.getSeconds())}`;
}
