// What is selected in one picture is selected in all: rows of the campaign, by their place in the
// arrays that the server sent.
import {t} from "../shared/language.js";
import {number} from "../shared/dom.js";
import {Lost, post, Refusal} from "../shared/server.js";

export class Linked {
  /** `rows`, `values`: as the server sends them. */
  constructor(rows, values) {
    this.rows = rows;
    this.values = values;
    this.before = null; // what is drawn in grey behind them
    this.chosen = new Set();
    this.counted = null; // what the server says of all rows, where not all are drawn
    this.asked = null;
    this.pictures = [];
    this.bar = document.getElementById("selection");
    this.bar.querySelector("button").onclick = () => this.choose([]);
    this.choose([]);
  }

  choose(indices, counted = null) {
    if (!counted) this.asked = null;
    this.chosen = new Set(indices);
    this.counted = counted?.n ? counted : null;
    this.redraw();
    const count = this.counted?.n ?? this.chosen.size;
    this.bar.hidden = count === 0;
    this.bar.dataset.count = count;
    this.bar.dataset.turn = Number(this.bar.dataset.turn ?? 0) + 1;
    if (count) this.bar.querySelector("span").textContent = this.words();
  }

  /** Choose among all rows, of which not all are drawn: the server knows them. */
  async ask(asked = this.asked) {
    this.asked = asked;
    if (!asked) { this.redraw(); return; }
    const panels = this.pictures.filter((p) => p.cells).map((p) => p.number);
    try {
      const found = await post("/api/brush", {...asked, panels});
      if (this.asked === asked) this.choose(found.rows, found);
    } catch (error) {
      // the server is away, or compares anew: the page says so
      if (!(error instanceof Refusal) && !(error instanceof Lost)) throw error;
    }
  }

  redraw() {
    for (const picture of this.pictures) picture.draw();
  }

  /** Rows that are what a table's row says. */
  matching(wanted) {
    return [...this.rows.row.keys()].filter((i) => this.#is(i, wanted));
  }

  #is(i, w) {
    const r = this.rows;
    // a part has its lower end; its upper one is the next part's
    const within = (value) => value !== null && value >= w.from - 1e-6
      && (w.last ? value <= w.to + 1e-6 : value < w.to - 1e-6);
    if (w.row !== undefined) return r.row[i] === w.row;
    if (w.part !== undefined && r.part[i] !== w.part) return false;
    if (w.setup !== undefined) return r.setups[r.setup[i]] === w.setup;
    if (w.direction !== undefined)
      return r.axes[w.axis].side[i] === w.direction && r.measured[i] === w.measured;
    if (w.signal !== undefined) return within(r.signals[w.signal].at[i]);
    if (w.axis !== undefined) return within(r.axes[w.axis].at[i]);
    if (w.from !== undefined) return within(r.time[i] * 3600);
    return false;
  }

  /** One row in words. */
  label(i) {
    const r = this.rows;
    const where = Object.entries(r.axes).map(([a, q]) => `${a} ${number(q.at[i], 5)} ${q.unit}`);
    return [`${number(this.values[i])} ${r.units[r.part[i]]}`,
      t("{setup}, line {line}", {setup: r.setups[r.setup[i]] || t("no set-up"), line: r.line[i]}), where.join(", ")];
  }

  words() {
    const {parts: figures, setups} = this.counted ?? this.#count();
    const parts = this.rows.units.map((unit, part) => {
      if (!figures[part]) return null;
      const {n, rms, mean} = figures[part];
      return t("{n} rows, rms {rms} {unit}, mean {mean}", {n, rms: number(rms), unit, mean: number(mean)});
    });
    const {most} = setups;
    const more = setups.more === 1 ? t(" and one more set-up") : setups.more ? t(" and {n} more set-ups", {n: setups.more}) : "";
    return t("Selected: {what} – in {where}", {what: parts.filter(Boolean).join("; "), where: most.join(", ") + more});
  }

  /** Figures of the rows that are chosen, as the server makes them of many. */
  #count() {
    const chosen = [...this.chosen];
    const parts = this.rows.units.map((_, part) => {
      const own = chosen.filter((i) => this.rows.part[i] === part).map((i) => this.values[i]);
      if (!own.length) return null;
      const mean = own.reduce((a, b) => a + b, 0) / own.length;
      return {n: own.length, mean, rms: Math.sqrt(own.reduce((a, b) => a + b * b, 0) / own.length)};
    });
    const setups = new Map();
    for (const i of chosen) {
      const name = this.rows.setups[this.rows.setup[i]];
      setups.set(name, (setups.get(name) ?? 0) + 1);
    }
    const most = [...setups].sort((a, b) => b[1] - a[1]).slice(0, 3).map(([name]) => name);
    return {parts, setups: {most, more: Math.max(0, setups.size - 3)}};
  }
}
