// Tables: what the controller will hold, what remains and where; their upload, looked at before it is done.
import {label, say, t} from "../shared/language.js";
import {draw, el, get, post, Refusal, table} from "../shared/dom.js";

const QUICK = 250, CALM = 2000; // ms between two looks at what is under way

export class Tables {
  constructor() {
    this.node = el("div", {class: "tables"}, el("p", {class: "waiting"}, t("Being read …")));
    this.#load().then(() => this.#follow());
  }

  close() {
    this.closed = true;
    clearTimeout(this.timer);
  }

  async #load() {
    try {
      this.found = await get("/api/tables");
    } catch (error) {
      if (!(error instanceof Refusal)) throw error;
      this.node.replaceChildren(el("p", {class: "warning", role: "alert"}, error.message));
      return;
    }
    const {tables} = this.found;
    this.node.replaceChildren(this.#verdict(tables),
      el("div", {class: "beside"}, this.#controller(), this.#past()),
      ...(tables ? this.#held(tables) : []));
    this.node.dataset.ready = "true";
    this.#show();
  }

  #verdict(tables) {
    if (!tables) return el("section", {class: "verdict"}, el("h1", {}, t("The tables of the controller")),
      el("p", {}, t("No new tables were stated (abbe open … --tables FOLDER): what is active can be asked for and rolled back.")));
    return el("section", {class: "verdict"},
      el("h1", {}, say(tables.title)), el("p", {}, tables.controller),
      el("dl", {class: "key"}, ...tables.key.map(([name, value, unit]) =>
        el("div", {}, el("dt", {}, label(name)), el("dd", {}, `${value} `, el("small", {}, label(unit)))))),
      ...tables.trust.map((text) => el("p", {class: tables.unverified ? "warning" : "note"}, text)));
  }

  /** Looking at it, and doing it. */
  #controller() {
    const {upload, tables} = this.found;
    if (!upload) return el("section", {class: "card"}, el("h2", {}, t("No controller takes them")),
      el("p", {}, t("The configuration has no section [upload].")));
    const button = (words, path, body, kind = null) =>
      el("button", {class: kind, onclick: () => this.#ask(path, body)}, words);
    this.said = el("div", {id: "said", role: "status", "aria-live": "polite"});
    this.buttons = el("p", {class: "tools"},
      tables ? button(t("Pre-flight: look, write nothing"), "/api/tables/preflight", {change: "upload"}, "main") : null,
      button(t("What is active?"), "/api/tables/status", {}),
      button(t("Roll back: look, write nothing"), "/api/tables/preflight", {change: "rollback"}));
    this.form = el("div", {});
    return el("section", {class: "card", id: "controller"}, el("h2", {}, upload.to), this.buttons, this.said, this.form);
  }

  #past() {
    const {past, upload} = this.found;
    return el("section", {id: "journal"}, el("h2", {}, t("Uploads so far")),
      past.cells.length ? table("", past.columns, past.cells) : el("p", {}, t("None yet.")),
      upload ? el("p", {class: "note"}, t("From the journal {file}", {file: upload.journal})) : null);
  }

  #held(tables) {
    const plots = (figures) => el("div", {class: "panels charts"}, ...figures.map((figure) => {
      const place = el("div", {class: "plot"});
      draw(place, figure);
      return el("figure", {}, place);
    }));
    return [
      el("section", {}, el("h2", {}, t("What remains, and where")),
        el("p", {}, t("The length of the error vector over the working volume, up to a shift of the whole (ISO 230-1, 3.8.3), as the model predicts it. Each dot is a place in the volume.")),
        table("", tables.remaining.columns, tables.remaining.cells.map(([name, ...rest]) => [label(name), ...rest])),
        tables.where_note ? el("p", {class: "note"}, tables.where_note) : plots(tables.where)),
      el("section", {}, el("h2", {}, t("What the controller will hold")),
        el("p", {}, t("Sign of the numbers in the files: {sign}. The pictures show errors.", {sign: tables.sign})),
        table("", tables.held.columns, tables.held.cells), plots(tables.curves),
        ...tables.notes.map((text) => el("p", {class: "note"}, text))),
      el("section", {}, el("h2", {}, t("At the controller")),
        el("ol", {}, ...tables.activation.map((text) => el("li", {}, text)))),
      el("section", {}, el("h2", {}, t("Record (ISO/TR 16907, 9.1)")),
        table("", ["", ""], tables.facts), table("", ["", t("File"), "SHA-256"], tables.files)),
    ];
  }

  async #ask(path, body, token = "") {
    try {
      this.state = await post(path, body, token);
      this.refusal = "";
    } catch (error) {
      if (!(error instanceof Refusal)) throw error;
      this.refusal = error.message;
    }
    this.#show();
    this.#follow();
  }

  async #follow() {
    clearTimeout(this.timer);
    if (this.closed || !this.said) return;
    try {
      const before = this.state;
      this.state = await get("/api/tables/state");
      if (JSON.stringify(before) !== JSON.stringify(this.state)) this.#show();
      const ended = before?.work && !before.work.ended && this.state.work?.ended;
      if (ended && ["write", "recover"].includes(this.state.work.kind)) {
        this.found = await get("/api/tables");
        this.node.querySelector("#journal").replaceWith(this.#past());
      }
    } catch {
      // the frame says that the server is lost
    }
    if (!this.closed)
      this.timer = setTimeout(() => this.#follow(), this.state?.work && !this.state.work.ended ? QUICK : CALM);
  }

  #show() {
    if (!this.said || !this.state) return;
    const {work, cleared, change} = this.state;
    const busy = Boolean(work) && !work.ended;
    for (const b of this.buttons.querySelectorAll("button")) b.disabled = busy;
    const parts = [];
    if (work) {
      parts.push(el("h3", {class: work.ended}, title(work)));
      parts.push(el("ul", {class: "steps"}, ...work.said.map((text) => el("li", {}, text))));
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
    this.form.replaceChildren(...(wanted ? [this.#write(wanted === "recover" ? null : cleared, change)] : []));
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
    const [by, byRow] = field("by", t("Who uploads, for the journal"), {maxlength: 200});
    const [note, noteRow] = field("note", t("Remark for the journal"), {maxlength: 200});
    const go = (event) => {
      event.preventDefault();
      const body = {machine: machine.value, by: by.value};
      const written = secret.value.trim();
      secret.value = "";
      if (cleared === null) this.#ask("/api/tables/recover", body, written);
      else this.#ask("/api/tables/write", {...body, cleared, note: note.value}, written);
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
