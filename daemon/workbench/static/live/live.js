// Live: the machine as it stands, in the words of `abbe status`; its volume now; what was.
import {knowNow, label, line, say, stateOf, t} from "../shared/language.js";
import {draw, el, fill, lasting, refill, table, write} from "../shared/dom.js";
import {get, Outside, Refusal} from "../shared/server.js";
import {History, when} from "./history.js";
import {FigureInSpace} from "../shared/space.js";

const VOLUME_EVERY = 15_000, AGAIN = 2000; // ms

export class Live {
  /** `seen` is called when a run is seen that was not before. */
  constructor(seen) {
    this.seen = seen;
    this.state = el("h1", {id: "state"}, t("Looking for a run …"));
    this.age = el("p", {class: "note", id: "age"});
    this.lost = el("p", {class: "warning", id: "lost", role: "alert", hidden: true});
    this.warnings = el("div", {id: "warnings"});
    this.axes = el("div", {class: "axes"});
    this.cards = new Map();
    this.warm = el("div", {});
    this.links = el("ul", {class: "links"});
    this.more = el("div", {});
    this.beat = el("p", {});
    this.now = el("div", {id: "now", hidden: true},
      this.axes,
      el("div", {class: "columns"},
        this.volume = el("section", {class: "card", id: "volume"}, el("h2", {}, t("The volume now")), el("p", {class: "note"}, t("Being worked out …"))),
        el("section", {class: "card"}, el("h2", {}, t("Sensors and links")), this.warm, this.links)));
    this.node = el("div", {class: "live"},
      el("section", {class: "verdict"}, this.state, this.age, this.lost, this.warnings), this.now);
    this.past = el("div", {});
    this.how = el("details", {hidden: true}, el("summary", {}, t("Cycle, journal, files")), this.more);
    this.node.append(this.past, this.how);
    this.#begin();
  }

  close() {
    this.#unstream();
    document.removeEventListener("visibilitychange", this.turned);
    this.history?.close();
    clearInterval(this.clock);
    clearInterval(this.volumes);
  }

  #stream() {
    const source = this.source = new EventSource("/api/live/stream");
    const take = (kind, act) => source.addEventListener(kind, (event) => {
      this.heard = Date.now();
      if (kind !== "lost") this.told = {clock: this.heard, running: performance.now()};
      act(JSON.parse(event.data));
    });
    take("run", (found) => this.#run(found));
    take("cycle", (found) => this.#cycle(found));
    take("lost", (found) => this.#lose([
      t("The machine is not seen since {since}: {why}. It is asked again every second.", {since: when(Date.parse(found.since) / 1000), why: label(found.why)}),
      this.found ? "" : t("A correction is started at a terminal: abbe run CONFIG.toml. It then stands here by itself.")].filter(Boolean).join(" ")));
    source.onerror = () => {
      const since = this.heard ? when(this.heard / 1000) : t("the beginning");
      const outside = source.readyState === EventSource.CLOSED;
      this.#lose(outside ? new Outside().message
        : t("The server is lost since {since}. It is asked again; if 'abbe open' was ended, start it anew.", {since}));
      // a stream that was refused is not asked for again by the browser
      if (outside) this.again = setTimeout(() => this.#stream(), AGAIN);
    };
  }

  #unstream() {
    this.source?.close();
    clearTimeout(this.again);
  }

  #begin() {
    // a browser has six connections to a server: windows that nobody sees leave them to the others
    this.turned = () => { this.#unstream(); if (!document.hidden) this.#stream(); };
    this.turned();
    document.addEventListener("visibilitychange", this.turned);
    this.clock = setInterval(() => this.#say(), 1000);
    this.volumes = setInterval(() => { if (!document.hidden && !this.isLost) this.#volume(); }, VOLUME_EVERY);
  }

  #lose(words) {
    this.isLost = true;
    write(this.lost, words);
    this.lost.hidden = false;
    this.node.classList.add("old");
    // what stood here last says nothing of the present: neither its words nor its colour
    this.state.textContent = this.found ? t("Not seen any more; last: {state}", {state: stateOf(this.found.state)}) : t("No run is seen");
    this.state.className = this.found ? "bad" : "";
    this.node.dataset.seen = "lost";
    this.#say();
  }

  /** How old what stands here is. */
  #say() {
    if (!this.found) return;
    // a clock that is set back makes nothing younger; the other one stands while the computer sleeps
    const seconds = Math.max(0, Date.now() - this.told.clock, performance.now() - this.told.running) / 1000;
    this.age.textContent = this.isLost || seconds > 3
      ? t("What stands here is {time} old and says nothing of the present.", {time: lasting(seconds)})
      : `${when(Date.parse(this.found.at) / 1000)}; ${say(this.found.cycle)}`;
  }

  #run(found) {
    const first = !this.found;
    this.found = found;
    knowNow(found);
    this.now.hidden = this.how.hidden = false;
    const back = this.isLost;
    this.isLost = false;
    this.lost.hidden = true;
    this.node.classList.remove("old");
    this.node.dataset.seen = "run";
    this.state.textContent = this.#words(found);
    this.state.className = found.light;
    const others = found.files.filter((f) => f[3]);
    fill(this.warnings, [others, found.faults, found.less_sure, found.checks, found.switches], () => [
      ...others.map(([role, file]) => el("p", {class: "warning"}, t("On the disk lies another {file} than runs ({role}): it counts from the next start on.", {file, role: label(role)}))),
      ...found.faults.map((text) => el("p", {class: "warning"}, line(text))),
      ...found.less_sure.map((text) => el("p", {class: "warning"}, t("less sure: {what}", {what: line(text)}))),
      ...[...found.checks, ...found.switches].map((text) => el("p", {class: "note"}, line(text)))]);
    this.#axes(found.axes);
    // once a second for hours: what has not changed stays as it is
    const sensors = found.signals.map((s) => [s.name, label(s.where), s.value, line(s.stale) || s.age]);
    if (!refill(this.warm, sensors))
      this.warm.replaceChildren(table("", [t("Sensor"), t("Where"), t("Reads"), t("Age")], sensors));
    const rows = this.warm.querySelectorAll("tbody tr");
    found.signals.forEach((s, k) => rows[k].classList.toggle("stale", Boolean(s.stale)));
    fill(this.links, found.links, () => found.links.map((l) => el("li", {class: l.light}, say(l.words))));
    write(this.beat, say(found.cycle));
    fill(this.more, [found.files, found.events], () => [this.beat,
      table(t("What runs"), ["", t("File"), "SHA-256", ""], found.files.map(([role, ...rest]) => [label(role), ...rest.map(label)])),
      table(t("Journal, newest first"), [t("Time"), "", t("What")], found.events.map(([time, level, text]) => [time, label(level), label(text)]))]);
    this.#say();
    if (first || back) {
      this.seen();
      this.#volume();
    }
    if (!this.history) {
      this.history = new History();
      this.past.append(this.history.node);
    }
  }

  /** The state, and of which axes: where some have no correction at all, the others are named. */
  #words({state, axes}) {
    const corrected = Object.keys(axes).filter((name) => axes[name].light);
    const some = corrected.length > 0 && corrected.length < Object.keys(axes).length;
    return some && !state.includes(": ") ? `${corrected.join(", ")}: ${stateOf(state)}` : stateOf(state);
  }

  #axes(axes) {
    const names = Object.keys(axes);
    if (names.join() !== [...this.cards.keys()].join()) {
      this.cards = new Map(names.map((name) => [name, new AxisCard(name)]));
      this.axes.replaceChildren(...[...this.cards.values()].map((card) => card.node));
    }
    for (const [name, axis] of Object.entries(axes)) this.cards.get(name).show(axis);
  }

  #cycle(found) {
    if (this.isLost) return;
    for (const [name, axis] of Object.entries(found.axes)) this.cards.get(name)?.show(axis);
    this.node.dataset.cycle = found.cycle;
  }

  async #volume() {
    let found;
    try {
      found = await get("/api/live/volume");
    } catch (error) {
      if (error instanceof Refusal && !(error instanceof Outside) && !this.space) this.volume.lastChild.textContent = line(error.message);
      return;
    }
    if (this.space) {
      this.space.show(found.figure);
      write(this.title, say(found.title));
      write(this.words, say(found.words));
      return;
    }
    const words = `${say(found.title)}. ${say(found.words)}`;
    this.space = found.figure.layout.scene ? new FigureInSpace(found.figure, words) : new FigureAlong(found.figure, words);
    this.title = el("h2", {}, say(found.title));
    this.words = el("figcaption", {}, say(found.words));
    this.volume.replaceChildren(this.title, el("figure", {class: "volume"}, this.words, el("div", {}, this.space.canvas)));
  }
}

/** Of a machine that errs along one line alone: its components along that. */
class FigureAlong {
  constructor(figure, words) {
    this.canvas = el("div", {class: "plot", role: "img", "aria-label": words});
    this.show(figure);
  }

  show(figure) {
    draw(this.canvas, figure);
  }
}

class AxisCard {
  constructor(name) {
    const row = (words, part) => el("div", {}, el("dt", {}, words), part);
    this.parts = Object.fromEntries(["indicated", "correction", "measured"].map((k) => [k, el("dd", {})]));
    this.corrected = el("p", {class: "large"});
    this.guard = el("span", {class: "guard"});
    this.stale = el("p", {class: "warning", hidden: true});
    this.measured = row(t("error, measured independently"), this.parts.measured);
    this.node = el("section", {class: "card axis", "data-axis": name, "aria-label": t("Axis {name}", {name})},
      el("h2", {}, name, " ", this.guard), this.corrected,
      el("dl", {}, row(t("indicated"), this.parts.indicated), row(t("correction"), this.parts.correction), this.measured),
      this.stale);
  }

  show(axis) {
    write(this.corrected, axis.corrected);
    write(this.guard, label(axis.guard));
    this.guard.className = `guard ${axis.light}`;
    write(this.parts.indicated, axis.indicated);
    write(this.parts.correction, [axis.correction || t("none"), axis.sure ? `± ${axis.sure}` : ""].join(" "));
    if (axis.measured) write(this.parts.measured, label(axis.measured));
    if (!this.parts.measured.textContent) this.measured.hidden = true;
    else this.measured.hidden = false;
    write(this.stale, line(axis.stale));
    this.stale.hidden = !axis.stale;
  }
}
