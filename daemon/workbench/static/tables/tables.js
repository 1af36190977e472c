// Tables: what the controller will hold, what remains and where; their upload, looked at before it is done.
import {label, line, say, t} from "../shared/language.js";
import {draw, el, keyFigures, moment, table} from "../shared/dom.js";
import {get, Lost, onBack, Outside, Refusal} from "../shared/server.js";
import {Controller} from "./controller.js";

export class Tables {
  constructor() {
    this.node = el("div", {class: "tables"}, el("p", {class: "waiting"}, t("Being read …")));
    // what could not be read because the server was away
    onBack(this.node, () => { if (!this.found) this.#load(); });
    this.#load();
  }

  close() {
    this.controller?.close();
  }

  async #load() {
    try {
      this.found = await get("/api/tables");
    } catch (error) {
      if (error instanceof Lost || error instanceof Outside) return; // the frame says so
      if (!(error instanceof Refusal)) throw error;
      this.node.replaceChildren(el("p", {class: "warning", role: "alert"}, line(error.message)));
      return;
    }
    const {tables} = this.found;
    this.node.replaceChildren(this.#verdict(tables),
      el("div", {class: "beside"}, this.#controller(), this.#past()),
      ...(tables ? this.#held(tables) : []));
    this.node.dataset.ready = "true";
  }

  #verdict(tables) {
    if (!tables) return el("section", {class: "verdict"}, el("h1", {}, t("The tables of the controller")),
      el("p", {}, t("No new tables were stated (abbe open … --tables FOLDER): what is active can be asked for and rolled back.")));
    return el("section", {class: "verdict"},
      el("h1", {}, say(tables.title)), el("p", {}, label(tables.controller)),
      ...keyFigures(tables.key),
      ...tables.trust.map((text) => el("p", {class: tables.unverified ? "warning" : "note"}, say(text))));
  }

  /** Looking at it, and doing it. */
  #controller() {
    if (!this.found.upload) return el("section", {class: "card"}, el("h2", {}, t("No controller takes them")),
      el("p", {}, t("The configuration has no section [upload].")));
    this.controller = new Controller("/api/tables", this.found, async (work) => {
      if (!["write", "recover"].includes(work.kind)) return;
      this.found = await get("/api/tables");
      this.node.querySelector("#journal").replaceWith(this.#past());
    });
    return this.controller.node;
  }

  #past() {
    const {past, upload} = this.found;
    return el("section", {id: "journal"}, el("h2", {}, t("Uploads so far")),
      past.cells.length ? table("", past.columns, past.cells.map((row) => row.map(label))) : el("p", {}, t("None yet.")),
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
        el("div", {class: "told"}, table("", tables.remaining.columns, tables.remaining.cells.map(([name, ...rest]) => [label(name), ...rest])),
          tables.where_note ? el("p", {class: "note"}, tables.where_note) : plots(tables.where))),
      el("section", {}, el("h2", {}, t("What the controller will hold")),
        el("p", {}, t("Sign of the numbers in the files: {sign}. The pictures show errors.", {sign: label(tables.sign)})),
        el("div", {class: "told"}, table("", tables.held.columns, tables.held.cells), plots(tables.curves)),
        ...tables.notes.map((text) => el("p", {class: "note"}, text))),
      el("section", {}, el("h2", {}, t("At the controller")),
        el("ol", {}, ...tables.activation.map((text) => el("li", {}, label(text))))),
      el("section", {}, el("h2", {}, t("Record (ISO/TR 16907, 9.1)")),
        table("", ["", ""], tables.facts.map(([name, text]) => [label(name), name === "At" ? text.split("; ").map(label).join("; ") : moment(text)])), table("", ["", t("File"), "SHA-256"], tables.files.map(([part, ...rest]) => [label(part), ...rest]))),
    ];
  }
}
