// What is selected in one picture is selected in all: rows of the campaign, by their place in the
// arrays that the server sent.
import {t} from "./language.js";
import {number} from "./dom.js";

export class Linked {
  /** `rows`, `values`: as the server sends them. */
  constructor(rows, values) {
    this.rows = rows;
    this.values = values;
    this.before = null; // what is drawn in grey behind them
    this.chosen = new Set();
    this.pictures = [];
    this.bar = document.getElementById("selection");
    this.bar.querySelector("button").onclick = () => this.choose([]);
    this.choose([]);
  }

  choose(indices) {
    this.chosen = new Set(indices);
    this.redraw();
    this.bar.hidden = this.chosen.size === 0;
    this.bar.dataset.count = this.chosen.size;
    if (this.chosen.size) this.bar.querySelector("span").textContent = this.words();
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
    const within = (value) => value !== null && value >= w.from - 1e-6 && value <= w.to + 1e-6;
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
    const chosen = [...this.chosen];
    const parts = this.rows.units.map((unit, part) => {
      const own = chosen.filter((i) => this.rows.part[i] === part).map((i) => this.values[i]);
      if (!own.length) return null;
      const mean = own.reduce((a, b) => a + b, 0) / own.length;
      const rms = Math.sqrt(own.reduce((a, b) => a + b * b, 0) / own.length);
      return t("{n} rows, rms {rms} {unit}, mean {mean}", {n: own.length, rms: number(rms), unit, mean: number(mean)});
    });
    const setups = new Map();
    for (const i of chosen) {
      const name = this.rows.setups[this.rows.setup[i]];
      setups.set(name, (setups.get(name) ?? 0) + 1);
    }
    const most = [...setups].sort((a, b) => b[1] - a[1]).slice(0, 3).map(([name]) => name);
    const more = setups.size > 3 ? t(" and {n} more set-ups", {n: setups.size - 3}) : "";
    return t("Selected: {what} – in {where}", {what: parts.filter(Boolean).join("; "), where: most.join(", ") + more});
  }
}
