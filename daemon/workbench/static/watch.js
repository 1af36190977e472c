// Watch: every version of the model with its error; back to any of them.
import {draw, el, table} from "./dom.js";

export function watchView(found, state, act, next) {
  const button = (i) => {
    const version = found.go_back[i];
    if (i === found.current) return el("strong", {}, "at present");
    if (version === null) return el("span", {class: "note"}, "no file here");
    return el("button", {class: "small back", "data-version": version,
      onclick: () => act("/api/back", {version})}, "Go back to it");
  };
  const plots = found.courses.map((course) => {
    const place = el("div", {class: "plot"});
    draw(place, course.figure);
    return el("figure", {class: "course"}, place, el("figcaption", {}, course.caption));
  });
  const versions = table("Errors: rms of what is left of lengths", found.columns, found.cells, button);
  const at = versions.querySelectorAll("tbody tr")[found.current];
  if (at) at.className = "current";
  return [
    el("section", {class: "verdict"}, el("h1", {}, found.title),
      ...found.said.map((text) => el("p", {class: text.startsWith("WARNING") ? "warning" : null}, text)),
      ...found.warnings.map((text) => el("p", {class: "note"}, text)),
      el("p", {}, el("button", {class: "main", id: "more", onclick: next},
        "Is anything else missing? Look for causes"))),
    el("section", {},
      el("p", {}, "Blue: the version was fitted to this campaign. Yellow: it has never seen it; only "
        + "that fall shows that a version predicts the machine. Dashed: how well the campaign "
        + "repeats itself; no model gets lastingly below."),
      el("div", {class: "panels"}, ...plots)),
    el("section", {}, versions,
      el("p", {}, el("button", {id: "fit", disabled: !state.writes, onclick: () => act("/api/fit")},
        "Fit the present version as it is")),
      el("p", {class: "note"}, state.writes
        ? `Each version is a model file in ${state.folder}; none is ever written over.`
        : "No folder for versions was stated (--versions FOLDER): nothing is written.")),
  ];
}
