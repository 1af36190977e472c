// What was done to the model here, when and by whom; and notes that people keep of its versions.
import {t} from "../shared/language.js";
import {el, moment, table} from "../shared/dom.js";

/** A note for a version, and all that was done. */
export function journalSection(found, act) {
  const at = el("select", {id: "note-version"}, ...found.versions.map((v) =>
    el("option", {value: v.number, selected: v.current}, v.name)));
  const text = el("textarea", {id: "note-text", rows: 3, maxlength: 4000});
  const keep = async (event) => {
    event.preventDefault();
    if (!text.value.trim()) return;
    const note = {version: Number(at.value), text: text.value};
    text.value = "";
    if (!await act("/api/note", note)) text.value = note.text;
  };
  return el("section", {id: "done"}, el("h2", {}, t("Notes, and what was done")),
    el("form", {class: "write", onsubmit: keep},
      el("p", {class: "field"}, el("label", {for: "note-version"}, t("Version")), at),
      el("p", {class: "field"}, el("label", {for: "note-text"}, t("Note: what a later reader should know")), text),
      el("p", {}, el("button", {id: "keep-note"}, t("Keep the note")))),
    found.journal.length
      ? table("", [t("Time (UTC)"), t("Who"), t("What")], found.journal.map((entry) => [moment(entry.time), whose(entry.who), done(entry)]))
      : el("p", {}, t("Nothing was changed yet.")));
}

/** The name, and which browser of this workbench it was. */
function whose(who) {
  return who.replace(/browser (\d+)$/, (_, n) => t("browser {n}", {n}));
}

function done(entry) {
  const {what, version, before, file} = entry;
  const names = (list) => (Array.isArray(list) ? list.join(", ") : "");
  if (what === "note") return t("Note on {version}: {text}", {version, text: entry.text});
  if (what === "back") return t("{version} looked at in place of {before}", {version, before});
  if (what === "read again") return t("{version} and its campaigns read again from the disk", {version});
  if (what === "sent") return t("{file} taken in", {file});
  const held = names(entry.held) ? t("; held out: {files}", {files: names(entry.held)}) : "";
  if (what === "campaigns") return t("{version} laid beside {files}", {version, files: names(entry.fitted)}) + held;
  if (what !== "made") return what;
  const how = entry.how === "fit" ? t("fitted as it is") : t("with {cause}", {cause: String(entry.how).replace(/^add /, "")});
  return t("{version} made of {before}, {how}, fitted to {files}", {version, before, how, files: names(entry.fitted)}) + held;
}
