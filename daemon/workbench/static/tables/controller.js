// The controller that takes tables: asked, looked at, then written to by whoever has the role.
import {say, t} from "../shared/language.js";
import {el, keepingTyped} from "../shared/dom.js";
import {get, onBack, post, why} from "../shared/server.js";
import {who} from "../shared/who.js";

const QUICK = 250, CALM = 2000; // ms between two looks at what is under way

export class Controller {
  /** `path`: of its routes; `found`: what they show; `changed` is called when something was written. */
  constructor(path, found, changed, {rollback = true} = {}) {
    this.path = path;
    this.found = found;
    this.changed = changed;
    this.typed = {}; // what was typed, where the form is made anew
    const {upload, tables} = found;
    const button = (words, name, body, kind = null) =>
      el("button", {class: kind, onclick: () => this.#ask(name, body)}, words);
    this.said = el("div", {id: "said", role: "status", "aria-live": "polite"});
    this.buttons = el("p", {class: "tools"},
      tables ? button(t("Pre-flight: look, write nothing"), "preflight", {change: "upload"}, "main") : null,
      button(t("What is active?"), "status", {}),
      rollback ? button(t("Roll back: look, write nothing"), "preflight", {change: "rollback"}) : null);
    this.form = el("div", {});
    this.node = el("section", {class: "card", id: "controller"}, el("h2", {}, upload.to), this.buttons, this.said, this.form);
    onBack(this.node, () => this.#follow());
    this.#follow();
  }

  close() {
    this.closed = true;
    clearTimeout(this.timer);
  }

  async #ask(name, body, token = "") {
    this.own = true;
    try {
      this.state = await post(`${this.path}/${name}`, body, token);
      this.refusal = "";
      // whose name was typed counts for one attempt
      if (token) delete this.typed["write-machine"];
    } catch (error) {
      this.refusal = why(error);
    }
    this.#show();
    this.#follow();
  }

  async #follow() {
    clearTimeout(this.timer);
    if (this.closed) return;
    const turn = this.turn = (this.turn ?? 0) + 1;
    try {
      const before = this.state;
      const state = await get(`${this.path}/state`);
      if (turn !== this.turn) return;
      this.state = state;
      if (before?.work && !before.work.ended && !state.work)
        this.refusal = t("The workbench ended while something was under way at the controller. Make a pre-flight: what was cut off is said there, and can be brought to its end.");
      else if (before && state.cleared !== null && state.cleared !== before.cleared && !this.own)
        this.refusal = t("This was looked at in another window. What stands here is what it found.");
      if (state.work?.ended) this.own = false;
      if (JSON.stringify(before) !== JSON.stringify(state)) this.#show();
      // who looks seldom sees only that another work has ended, never that it went on
      if (before && state.work?.ended && JSON.stringify(before.work) !== JSON.stringify(state.work)) await this.changed(state.work);
    } catch {
      // the frame says that the server is lost
    }
    if (!this.closed && turn === this.turn)
      this.timer = setTimeout(() => this.#follow(), this.state?.work && !this.state.work.ended ? QUICK : CALM);
  }

  #show() {
    const state = this.state ?? {work: null, cleared: null};
    const {work, cleared, change} = state;
    const busy = Boolean(work) && !work.ended;
    for (const b of this.buttons.querySelectorAll("button")) b.disabled = busy;
    const parts = [];
    if (work) {
      parts.push(el("h3", {class: work.ended}, title(work)));
      parts.push(el("ul", {class: "steps"}, ...work.said.map((text) => el("li", {}, say(text)))));
      if (busy) parts.push(el("p", {}, el("progress", {max: 1, value: work.part || null, "aria-label": t("How far it is")})));
    }
    if (this.refusal) parts.push(el("p", {class: "warning", role: "alert"}, this.refusal));
    this.said.replaceChildren(...parts);
    this.said.dataset.ended = work?.ended ?? "";
    this.said.dataset.kind = work?.kind ?? "";
    const unfinished = work?.ended && work.said.some((text) => text.includes("--recover"));
    const wanted = busy ? "" : cleared !== null ? `${change} ${cleared}` : unfinished ? "recover" : "";
    if (this.form.dataset.wanted === wanted) return;
    this.form.dataset.wanted = wanted;
    // somebody else may have looked meanwhile: what was typed here stays
    for (const field of this.form.querySelectorAll("input:not([type=password])")) this.typed[field.id] = field.value;
    const writing = busy && !["preflight", "status"].includes(work.kind);
    if (writing || (wanted && this.of !== change)) delete this.typed["write-machine"];
    if (wanted) this.of = change;
    keepingTyped(this.form, () => this.form.replaceChildren(...(wanted ? [this.#write(wanted === "recover" ? null : cleared, change)] : [])));
    for (const [id, value] of Object.entries(this.typed)) {
      const field = this.form.querySelector(`#${id}`);
      if (field) field.value = value;
    }
  }

  /** The form that changes what the controller holds. */
  #write(cleared, change) {
    const {upload, roles, token} = this.found;
    const field = (name, words, more = {}) => {
      const input = el("input", {id: `write-${name}`, autocomplete: "off", spellcheck: "false", ...more});
      return [input, el("p", {class: "field"}, el("label", {for: `write-${name}`}, words), input)];
    };
    const [machine, machineRow] = field("machine", t("Type the name of the machine: {name}", {name: upload.type}));
    const [secret, secretRow] = field("token", t("Token of the role operate"), {type: "password"});
    const [by, byRow] = field("by", t("Who uploads, for the journal"), {maxlength: 200, value: who()});
    const [note, noteRow] = field("note", t("Remark for the journal"), {maxlength: 200});
    const go = (event) => {
      event.preventDefault();
      const body = {machine: machine.value, by: by.value};
      const written = secret.value.trim();
      secret.value = "";
      if (cleared === null) this.#ask("recover", body, written);
      else this.#ask("write", {...body, cleared, note: note.value}, written);
    };
    const words = cleared === null ? t("Bring the upload that was cut off to its end")
      : change === "rollback" ? t("Put back what was active before") : t("Write to the controller");
    return el("form", {class: "write", onsubmit: go}, el("h3", {}, words), machineRow, secretRow, byRow,
      cleared === null ? null : noteRow,
      roles ? null : el("p", {class: "note"}, t("There is no token yet. It takes [http] in the configuration, and is made and printed once by: "), el("code", {}, token)),
      el("p", {}, el("button", {class: "danger", id: "write"}, words)));
  }
}

function title({kind, change, ended, doing}) {
  if (!ended) return t("Under way: {what}", {what: doing});
  if (kind === "status") return ended === "good" ? t("What is active") : t("The controller could not be asked");
  const what = {upload: t("upload"), rollback: t("roll-back")}[change] ?? t("recovery");
  if (kind === "preflight") return ended === "good"
    ? t("Pre-flight ({what}): nothing speaks against it", {what}) : t("Pre-flight ({what}): not now", {what});
  return ended === "good" ? t("Done: {what}", {what}) : t("Not done: {what}", {what});
}
