// What if: sliders for a cause's parameters; the residuals answer while they are moved.
import {label, line, t} from "../shared/language.js";
import {el, number} from "../shared/dom.js";
import {Lost, Outside, post} from "../shared/server.js";
import {Linked} from "../residuals/linked.js";
import {legend} from "./compare.js";
import {reaches, Scatter} from "../residuals/scatter.js";

const STEPS = 400, MANY = 6, CONVINCING = 12;
const AGAIN = 1000; // ms until the server is asked again that is away

/** Fill `place` with one cause to be tried. */
export async function tryOut(place, spec, found, state, act) {
  place.dataset.spec = spec;
  delete place.dataset.ready;
  // trying changes nothing, so it is asked again
  const later = () => setTimeout(() => { if (place.isConnected && place.dataset.spec === spec) tryOut(place, spec, found, state, act); }, AGAIN);
  let answer;
  try {
    answer = await post("/api/try", {spec});
  } catch (error) {
    if (error instanceof Lost || error instanceof Outside) return void later(); // the frame says so
    place.replaceChildren(el("h2", {}, t("What if")), el("p", {class: "warning"}, line(error.message)));
    return;
  }
  if (place.dataset.spec !== spec) return; // another one was asked for meanwhile
  if (!answer) return void later(); // causes are not known yet
  const linked = new Linked(found.rows, answer.values);
  linked.before = found.values;
  const reach = reaches(found.rows, found.values);
  const bars = new Bars(found);
  const values = Object.fromEntries(answer.sliders.map((s) => [s.name, s.value]));
  const best = {...values};
  const show = (said) => {
    linked.values = said.values;
    linked.redraw();
    bars.show(said.rms);
    place.dataset.rms = said.rms;
  };
  const ask = latest(() => place.isConnected && place.dataset.spec === spec, async () => {
    const said = await post("/api/try", {spec, values});
    if (!said) return false;
    show(said);
    return true;
  });
  const controls = answer.sliders.map((s) => new Slider(s, (v) => { values[s.name] = v; ask(); }));
  const amount = new Slider({name: t("amount of it"), unit: "%", value: 100, low: 0, high: 200,
    what: t("0 %: not at all; 100 %: as the measurements say")}, (v) => {
    answer.sliders.forEach((s, k) => {
      if (!s.amount) return;
      values[s.name] = (best[s.name] * v) / 100;
      controls[k].set(values[s.name]);
    });
    ask();
  });
  const back = el("button", {class: "small", onclick: () => {
    amount.set(100);
    controls.forEach((c, k) => c.set((values[answer.sliders[k].name] = answer.sliders[k].value)));
    ask();
  }}, t("As the measurements say"));
  const own = panelsOf(found, answer.where);
  const nodes = controls.map((c) => c.node);
  const shown = found.causes.some((c) => c.spec === spec)
    || found.candidates.some((c) => c.spec === spec && c.evidence >= CONVINCING);
  place.replaceChildren(
    el("h2", {}, t("What if")), el("p", {}, el("code", {}, spec)),
    el("p", {}, t("Move a slider: what would be left if this were in the model, and all the rest of the model fitted again? Nothing is added before you say so.")),
    bars.node, amount.node,
    ...(nodes.length > MANY
      ? [el("details", {}, el("summary", {}, t("its {n} parameters", {n: nodes.length})), ...nodes)] : nodes),
    ...(shown ? [] : [el("p", {class: "note"}, t("The measurements do not show this cause: it would follow their noise."))]),
    el("p", {}, back, " ", el("button", {class: shown ? "main add" : "add", disabled: !state.writes,
      "data-spec": spec, onclick: () => act("/api/add", {spec, on: state.stands_on})}, t("Add it and refit"))),
    el("p", {class: "legend"}, el("span", {}, el("b", {class: "before"}, "■"),
      t(" grey: left by the model as it is; in colour: with this cause"))),
    el("div", {class: "panels"},
      ...own.map((panel) => new Scatter(panel, linked, reach[panel.part]).node)),
    el("details", {}, el("summary", {}, t("What the marks mean")), legend("third")));
  show(answer);
  place.dataset.ready = "1";
}

/** The pictures that a cause would change most: along its axis, against its signals. */
function panelsOf(found, where) {
  const words = Object.values(where).join(" ");
  const named = (name) => new RegExp(`(^|[^A-Za-z0-9_])${name.replace(/\W/g, "")}($|[^A-Za-z0-9_])`)
    .test(words);
  const rank = (p) => {
    if (where.about && p.part && p.measured === where.about && p.axis === where.axis) return 0;
    if (p.by === "axis" && p.axis === where.axis)
      return 2 * p.part + (p.measured === (where.direction ?? p.axis) ? 0 : 1);
    if (p.by === "signal" && named(p.signal)) return p.part - 0.5;
    if (p.by === "time" && !where.axis) return 0.7;
    if (p.by === "axis" && p.measured === where.direction) return 1.5 + p.part;
    return p.by === "time" ? 3 : 4;
  };
  return [...found.panels].sort((a, b) => rank(a) - rank(b) || a.part - b.part).slice(0, 4);
}

/** One answer at a time; of what is asked meanwhile only the last counts. Asked again until it is answered (true), while it is `wanted`. */
function latest(wanted, work) {
  let busy = false, again = false;
  return async function run() {
    if (busy) { again = true; return; }
    busy = true;
    // the server may be away, or not know the causes yet: the frame says so
    const done = await work().catch(() => false);
    if (!done && wanted()) setTimeout(run, AGAIN);
    busy = false;
    if (again) { again = false; run(); }
  };
}

class Slider {
  constructor(s, moved) {
    s = {...s, what: label(s.what)};
    this.s = s;
    const low = s.by_ratio ? Math.log(s.low) : s.low, high = s.by_ratio ? Math.log(s.high) : s.high;
    this.toStep = (v) => STEPS * ((s.by_ratio ? Math.log(v) : v) - low) / (high - low || 1);
    this.toValue = (k) => { const v = low + (k / STEPS) * (high - low); return s.by_ratio ? Math.exp(v) : v; };
    this.range = el("input", {type: "range", min: 0, max: STEPS, step: 1, "data-name": s.name,
      "aria-label": `${s.name}, ${s.unit}`, title: s.what});
    this.said = el("output", {});
    this.range.addEventListener("input", () => {
      const value = this.toValue(Number(this.range.value));
      this.#say(value);
      moved(value);
    });
    const words = s.amount === undefined ? s.name : s.what || s.name;
    this.node = el("label", {class: "slider"}, el("span", {title: `${s.name}: ${s.what}`}, words),
      this.range, this.said);
    this.set(s.value);
  }

  set(value) {
    this.range.value = String(Math.round(this.toStep(value)));
    this.#say(value);
  }

  #say(value) {
    this.said.textContent = `${number(value)} ${this.s.unit}`;
    this.range.setAttribute("aria-valuetext", this.said.textContent);
  }
}

/** The error as it is and with the cause, beside the noise floor. */
class Bars {
  constructor(found) {
    this.found = found;
    const {rms, floor, unit} = found;
    this.full = 1.15 * rms || 1;
    this.bar = el("div", {class: "bar tried"});
    this.said = el("span", {});
    const before = el("div", {class: "bar"});
    before.style.width = `${(100 * rms) / this.full}%`;
    const rows = [el("div", {class: "bars-row"}, el("span", {}, t("as it is")), el("div", {}, before),
      el("span", {}, t("{size} {unit} rms", {size: number(rms), unit}))),
    el("div", {class: "bars-row"}, el("span", {}, t("with it")), el("div", {}, this.bar), this.said)];
    if (floor !== null) {
      const noise = el("div", {class: "bar noise"});
      noise.style.width = `${Math.min(100, (100 * floor) / this.full)}%`;
      rows.push(el("div", {class: "bars-row"}, el("span", {}, t("noise floor")), el("div", {}, noise),
        el("span", {}, `${number(floor)} ${unit}`)));
    }
    this.node = el("div", {class: "bars"}, ...rows);
  }

  show(rms) {
    this.bar.style.width = `${Math.min(100, (100 * rms) / this.full)}%`;
    this.bar.classList.toggle("worse", rms > 1.001 * this.found.rms);
    this.said.textContent = t("{size} {unit} rms", {size: number(rms), unit: this.found.unit});
  }
}
