// Calibrate: the guide of `abbe calibrate`, step by step; what a step says and asks while it is done.
import {label, line, say, t} from "../shared/language.js";
import {el, keepingTyped, lasting} from "../shared/dom.js";
import {get, Lost, onBack, Outside, post, Refusal, why} from "../shared/server.js";
import {who} from "../shared/who.js";
import {Controller} from "../tables/controller.js";

const QUICK = 400, CALM = 3000; // ms between two looks
const MARKS = {done: "✓", next: "▶", running: "●", waits: "·"};
const WORDS = {done: t("done"), next: t("next"), running: t("under way"), waits: t("waits")};
const CHOICES = {yes: t("Yes"), no: t("No"), stands: t("It stands"), "leave out": t("Leave this set-up out")};

/** What a step does, for who does it for the first time. */
const DOES = {
  start: t("A copy of the model in this folder; one without effects gets those that machines of its structure usually have. First state below the steps how much time there is, which tools, which control."),
  plan: t("Works out which set-ups show most in the time that there is. Afterwards each stands below as a drawing."),
  program: t("Writes the program with which the control drives to all targets."),
  fit: t("Fits the model to what was measured."),
  diagnose: t("Looks for causes that the model lacks. Each that is established is asked for before it is added."),
  table: t("Works out the tables that the control will hold. Nothing is written to it."),
  "check-plan": t("Chooses lines that were not fitted: only they show whether the model holds."),
  verify: t("Compares these lines with what the model foretold, before and after correction, and writes the certificate."),
  live: t("Writes the configuration with which abbe run corrects the machine."),
};
DOES["check-program"] = DOES.program;
const PLANS = {measure: "plan", check: "check"}; // step -> the plan that it follows

export class Calibration {
  constructor() {
    this.head = el("section", {class: "verdict"}, el("p", {class: "waiting"}, t("Being read …")));
    this.work = el("section", {id: "step", role: "status", "aria-live": "polite"});
    this.start = el("div", {});
    this.steps = el("ol", {class: "guide"});
    this.asked = el("div", {});
    this.plans = el("div", {});
    this.away = el("p", {class: "warning", role: "alert", hidden: true});
    this.node = el("div", {class: "calibration"}, this.away, this.head,
      el("div", {class: "columns"},
        el("section", {class: "card"}, this.steps, this.asked),
        this.doing = el("section", {class: "card", id: "doing"}, this.work, this.start)),
      this.plans);
    onBack(this.node, () => this.#follow());
    this.#follow();
  }

  close() {
    this.controller?.close();
    this.closed = true;
    clearTimeout(this.timer);
  }

  async #follow() {
    clearTimeout(this.timer);
    const turn = this.turn = (this.turn ?? 0) + 1;
    let said = "";
    try {
      const found = await get("/api/calibrate");
      if (turn === this.turn) this.#show(found);
    } catch (error) {
      // that the server is away is said by the frame
      if (error instanceof Refusal && !(error instanceof Outside)) said = line(error.message);
      else if (!(error instanceof Lost) && !(error instanceof Outside)) throw error;
    }
    if (turn !== this.turn) return;
    this.away.hidden = !said;
    this.away.textContent = said;
    if (!this.closed) this.timer = setTimeout(() => this.#follow(), this.running ? QUICK : CALM);
  }

  async #ask(path, body = {}, token = "") {
    this.refusal = "";
    try {
      this.#show(await post(`/api/calibrate/${path}`, body, token));
    } catch (error) {
      this.refusal = why(error);
      this.key = "";
      if (this.found) this.#show(this.found);
    }
    this.#follow();
  }

  #show(found) {
    const key = JSON.stringify([found, this.refusal]);
    if (key === this.key) return;
    this.key = key;
    if (this.running && !found.work)
      this.refusal = t("The workbench ended in the middle of this step. What it has written is kept; start the step again to go on.");
    this.found = found;
    this.running = Boolean(found.work) && !found.work.ended;
    const done = found.steps.filter((s) => s.state === "done").length;
    const coming = found.steps.find((s) => s.state === "next" || s.state === "running");
    const judged = found.steps.find((s) => s.name === "verify")?.state === "done";
    this.head.replaceChildren(el("h1", {class: coming ? null : found.verified ? "good" : "bad"}, coming
      ? this.running ? t("Under way: {what}", {what: label(coming.title)}) : t("Next: {what}", {what: label(coming.title)})
      : found.verified ? t("Calibrated and verified") : t("Calibrated, but not verified")),
      ...(found.outcome && judged ? [el("p", {id: "outcome"}, label(found.outcome))] : []),
      ...(coming || found.verified ? [] : [el("p", {class: "warning"}, t("No line has shown that the model holds; the certificate says why."))]),
      el("p", {}, t("{done} of {all} steps are done, in {folder}.", {done, all: found.steps.length, folder: found.folder})),
      ...(found.certificate ? [el("p", {}, el("a", {href: "/api/calibrate/certificate", target: "_blank"},
        judged || found.work?.step === "verify" ? t("The certificate") : t("The certificate of an earlier check")))] : []));
    this.steps.replaceChildren(...found.steps.map((s, k) => el("li", {class: s.state, "data-step": s.name, "data-state": s.state},
      el("span", {class: "mark", "aria-hidden": "true"}, MARKS[s.state]),
      el("span", {}, `${k + 1}. ${label(s.title)}`, el("br"),
        el("small", {}, [s.makes.join(", "), s.role && s.state !== "done" ? t("takes the role operate") : ""].filter(Boolean).join("; "))),
      el("small", {}, s.state === "done" ? [s.at, label(s.by)].filter(Boolean).join(", ") : WORDS[s.state]))));
    this.doing.hidden = !coming && !found.work;
    this.#begin(coming, found);
    this.#work(found.work, Boolean(coming), label(found.steps.find((s) => s.name === found.work?.step)?.title ?? ""));
    this.#options(found);
    this.#setups(found.plans);
    this.node.dataset.ready = "true";
  }

  /** What starts the next step; a form that is being filled in stays. */
  #begin(coming, found) {
    const wanted = this.running || !coming ? "" : coming.name;
    if (this.start.dataset.step !== wanted) {
      this.start.dataset.step = wanted;
      this.controller?.close();
      this.controller = null;
      this.start.replaceChildren(...(wanted ? this.#form(coming, found) : []));
    }
    this.alert?.remove();
    this.alert = null;
    if (this.refusal) this.start.append(this.alert = el("p", {class: "warning", role: "alert"}, this.refusal));
  }

  #form(step, found) {
    if (step.writes) return [el("h2", {}, label(step.title)), this.#upload()];
    const field = (name, words, more = {}) => {
      const input = el("input", {id: `start-${name}`, autocomplete: "off", spellcheck: "false", ...more});
      return [input, el("p", {class: "field"}, el("label", {for: `start-${name}`}, words), input)];
    };
    const [by, byRow] = field("by", t("Who does it, for the record"), {maxlength: 150, value: this.by || who()});
    const [secret, secretRow] = field("token", t("Token of the role operate"), {type: "password"});
    const go = (event) => {
      event.preventDefault();
      const token = secret.value.trim();
      secret.value = "";
      this.by = by.value;
      this.#ask("start", {step: step.name, by: by.value, language: document.documentElement.lang}, token);
    };
    return [el("h2", {}, label(step.title)), DOES[step.name] ? el("p", {}, DOES[step.name]) : null, el("form", {onsubmit: go}, byRow, step.role ? secretRow : null,
      step.role ? el("p", {class: "note"}, t("The machine is driven by its own program or by hand: Abbe follows it, reads the instrument at each target, and writes nothing to the controller.")) : null,
      step.role && !found.roles ? el("p", {class: "note"}, t("There is no token yet: it takes [http] in the configuration, and abbe token add CONFIG NAME --role operate.")) : null,
      el("p", {}, el("button", {class: "main", id: "go"}, t("Do this step"))))].filter(Boolean);
  }

  /** The tables that were made, looked at and then written as on the page of the tables. */
  #upload() {
    const place = el("div", {}, el("p", {class: "waiting"}, t("Being read …")));
    const load = async () => {
      try {
        const found = await get("/api/calibrate/upload");
        if (!place.isConnected || this.controller) return;
        this.controller = new Controller("/api/calibrate/upload", found, () => this.#follow(), {rollback: false});
        place.replaceChildren(el("p", {}, say(found.tables.title)),
          ...found.tables.trust.map((text) => el("p", {class: found.tables.unverified ? "warning" : "note"}, say(text))),
          this.controller.node);
      } catch (error) {
        if (error instanceof Refusal && !(error instanceof Outside)) place.replaceChildren(el("p", {class: "warning", role: "alert"}, line(error.message)));
        else if (!(error instanceof Lost) && !(error instanceof Outside)) throw error;
      }
    };
    onBack(place, load);
    setTimeout(load);
    return place;
  }

  #work(work, more, what) {
    if (!work) {
      this.work.replaceChildren();
      return;
    }
    const parts = [];
    if (!work.ended) {
      const left = work.left > 2 ? t(", about {time} left", {time: lasting(work.left)}) : "";
      if (work.of) parts.push(el("p", {}, t("{done} of {all} targets", {done: work.done, all: work.of}) + left));
      parts.push(el("p", {}, el("progress", {max: 1, value: work.of ? work.done / work.of : null, "aria-label": t("How far it is")})));
      if (work.next && !work.question) parts.push(el("p", {}, line(work.next)));
      if (work.question) parts.push(el("div", {class: "question", role: "alert"}, el("p", {}, line(work.question)), this.#placed(work),
        el("p", {class: "tools"}, ...work.choices.map((choice, k) => el("button", {class: k ? null : "main", "data-choice": choice,
          onclick: () => this.#ask("answer", {answer: choice})}, CHOICES[choice])))));
      parts.push(el("p", {}, el("button", {class: "small", id: "stop", onclick: () => this.#ask("stop")}, t("Stop; it goes on later"))));
    }
    parts.push(el("h2", {class: work.ended}, {good: t("Done: {what}", {what}), bad: t("Not done: {what}", {what})}[work.ended] ?? t("What it says")));
    const lines = el("pre", {class: "lines", tabindex: 0, "aria-label": t("What the step says")}, work.lines.map(line).join("\n"));
    // what went well is read by whoever wants to; what comes next stands below
    parts.push(work.ended === "good" && more ? el("details", {}, el("summary", {}, t("What it said")), lines) : lines);
    this.work.dataset.ended = work.ended;
    this.work.dataset.done = work.done ?? "";
    this.work.replaceChildren(...parts);
    lines.scrollTop = lines.scrollHeight;
  }

  /** The drawing of the set-up that has to be placed now, beside the question. */
  #placed(work) {
    const plan = PLANS[work.step];
    const number = (this.found.plans[plan] ?? []).findIndex((setup) => setup.name === work.setup);
    if (number < 0) return null;
    const setup = this.found.plans[plan][number];
    return el("img", {src: picture(plan, number, setup), alt: say(setup.words), width: 720, height: 500});
  }

  #options(found) {
    const known = JSON.stringify([found.asked, this.running]);
    if (this.asked.dataset.known === known) return;
    this.asked.dataset.known = known;
    const rows = {time: t("Time to measure in"), check_time: t("Time to verify in"), tools: t("Tools, NAME=x,y,z in mm"),
      controller: t("Programs for the control"), tables: t("Tables for the control (none: corrected live)")};
    const inputs = {};
    const fields = Object.entries(rows).map(([name, words]) => {
      inputs[name] = el("input", {id: `ask-${name}`, value: found.asked[name], autocomplete: "off", spellcheck: "false",
        maxlength: 150, disabled: this.running});
      return el("p", {class: "field"}, el("label", {for: `ask-${name}`}, words), inputs[name]);
    });
    const go = (event) => {
      event.preventDefault();
      this.#ask("ask", Object.fromEntries(Object.entries(inputs).map(([name, input]) => [name, input.value.trim()])));
    };
    const open = this.asked.querySelector("details")?.open ?? false;
    keepingTyped(this.asked, () => this.asked.replaceChildren(el("details", {open}, el("summary", {}, t("What is asked for")),
      el("form", {onsubmit: go, "data-said": true}, ...fields, el("p", {}, el("button", {class: "small", id: "ask", disabled: this.running}, t("Use this")))))));
  }

  #setups(plans) {
    const key = JSON.stringify(plans);
    if (this.plans.dataset.key === key) return;
    this.plans.dataset.key = key;
    const titles = {plan: t("Set-ups that are measured"), check: t("Set-ups that verify it")};
    this.plans.replaceChildren(...Object.entries(plans).filter(([, setups]) => setups.length).map(([name, setups]) =>
      el("section", {"data-plan": name}, el("h2", {}, titles[name]),
        el("p", {class: "note"}, t("Grey: the reach of the tip. Orange: what moves, and its targets. Blue: where the instrument stands.")),
        el("div", {class: "setups"}, ...setups.map((setup, k) => el("figure", {},
          el("figcaption", {}, `${k + 1}. ${setup.name}`),
          el("img", {src: picture(name, k, setup), alt: say(setup.words), width: 720, height: 500}),
          el("p", {class: "note"}, say(setup.words))))))));
  }
}

/** Where a set-up's drawing is. */
function picture(plan, number, setup) {
  return `/api/calibrate/picture?plan=${plan}&number=${number}&of=${hash(setup.words)}`;
}

/** Another address for another set-up of the same number. */
function hash(text) {
  return [...text].reduce((sum, c) => (31 * sum + c.codePointAt(0)) % 4294967291, 7);
}
