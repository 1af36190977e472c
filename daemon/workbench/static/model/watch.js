// Watch: every version of the model with its error; back to any of them.
import {label, say, t} from "../shared/language.js";
import {draw, el, table} from "../shared/dom.js";
import {besideSection} from "./beside.js";
import {journalSection} from "./journal.js";

export function watchView(found, state, act, next, trouble) {
  const button = (i) => {
    const version = found.go_back[i];
    if (i === found.current) return el("strong", {}, t("at present"));
    if (version === null) return el("span", {class: "note"}, t("no file here"));
    return el("button", {class: "small back", "data-version": version,
      onclick: () => act("/api/back", {version})}, t("Go back to it"));
  };
  const plots = found.courses.map((course) => {
    const place = el("div", {class: "plot"});
    draw(place, course.figure);
    return el("figure", {class: "course"}, place, el("figcaption", {}, label(course.caption)));
  });
  const versions = table(t("Errors: rms of what is left of lengths"), found.columns, found.cells.map((row) => row.map((text, k) => (k === 1 ? label(text) : text))), button);
  const at = versions.querySelectorAll("tbody tr")[found.current];
  if (at) at.className = "current";
  return [
    el("section", {class: "verdict"}, el("h1", {}, say(found.title)),
      ...found.said.map((text) => el("p", {class: text.startsWith("WARNING") ? "warning" : null}, say(text))),
      ...found.warnings.map((text) => el("p", {class: "note"}, say(text))),
      el("p", {}, state.empty ? t("Nothing has been measured here yet: drop a campaign on this page, or choose one under Compare.")
        : el("button", {class: "main", id: "more", onclick: next}, t("Is anything else missing? Look for causes")))),
    !plots.length ? null : el("section", {},
      el("p", {}, t("Blue: the version was fitted to this campaign. Yellow: it has never seen it; only that fall shows that a version predicts the machine. Dashed: how well the campaign repeats itself; no model gets lastingly below.")),
      el("div", {class: "panels"}, ...plots)),
    el("section", {}, versions,
      el("p", {}, el("button", {id: "fit", disabled: !state.writes, onclick: () => act("/api/fit", {on: state.stands_on})},
        t("Fit the present version as it is"))),
      el("p", {class: "note"}, state.writes
        ? t("Each version is a model file in {folder}; none is ever written over.", {folder: state.folder})
        : state.take_out ? t("Nothing is written into the plant's store. Take the files out with  {command}", {command: state.take_out})
        : t("No folder for versions was stated (--versions FOLDER): nothing is written."))),
    ...(state.empty || found.versions.length < 2 ? [] : [besideSection(found.versions, state.stands_on, trouble)]),
    journalSection(found, act),
  ].filter(Boolean);
}
