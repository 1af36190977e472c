// Compare: whether the model holds, and where it does not.
import {el, table} from "./dom.js";
import {Linked} from "./linked.js";
import {reaches, Scatter} from "./scatter.js";
import {Volume} from "./volume.js";

const NAMES = ["Lengths", "Rotations"];
const FIRST = 6; // pictures along axes that are drawn at once

export function legend() {
  const mark = (sign, side, words) => el("span", {},
    el("b", {class: side}, sign), ` ${words}`);
  return el("p", {class: "legend"},
    mark("▲", "minus", "the axis came from the minus side, upwards"),
    mark("▼", "plus", "from the plus side, downwards"),
    mark("●", "still", "it stood still, or this is not known"),
    el("span", {}, "Thick lines: means. Drag over points: they show in all pictures."));
}

/** The view; `next` leads to the causes. */
export function compareView(found, next) {
  const linked = new Linked(found.rows, found.values);
  const reach = reaches(found.rows, found.values);
  const verdict = el("section", {class: "verdict"},
    el("h1", {class: found.holds ? "good" : "bad"}, found.title),
    ...found.verdict.map((text) => el("p", {}, text)),
    found.unfitted ? el("p", {class: "note"}, "No value of this model has been fitted yet: what is "
      + "left is the whole error. Looking for causes fits it first.") : null,
    found.fitted ? el("p", {class: "note"}, found.fitted) : null,
    el("dl", {class: "key"}, ...found.key.map(([name, value, unit]) =>
      el("div", {}, el("dt", {}, name), el("dd", {}, `${value} `, el("small", {}, unit))))),
    el("p", {}, el("button", {class: "main", id: "why", onclick: next},
      found.holds ? "Is anything missing? Look for causes" : "Why? Look for causes")),
    ...found.suspicions.map((text) => el("p", {class: "warning"}, `SUSPICIOUS: ${text}`)));
  const sections = [verdict];
  for (const part of [0, 1]) {
    if (!found.rows.part.includes(part)) continue;
    sections.push(partSection(found, linked, part, reach));
  }
  sections.push(el("section", {}, ...found.notes.map((text) => el("p", {class: "note"}, text))));
  return sections;
}

function partSection(found, linked, part, reach) {
  const own = found.panels.filter((panel) => panel.part === part);
  const make = (panels) => el("div", {class: "panels"},
    ...panels.map((panel) => new Scatter(panel, linked, reach[part]).node));
  const along = own.filter((panel) => panel.by === "axis");
  const shown = found.rows.part.filter((p) => p === part).length;
  const section = el("section", {},
    el("h2", {}, `${NAMES[part]}: where it fails`),
    el("p", {}, "Residuals: what the model leaves of the measurements. All pictures have the same "
      + `scale, the worst come first. ${shown} rows are drawn of ${found.of} in all.`),
    legend(),
    make(along.slice(0, FIRST)));
  const more = (title, panels) => {
    if (!panels.length) return;
    const details = el("details", {}, el("summary", {}, title));
    details.addEventListener("toggle", () => {
      if (details.open && details.children.length === 1) {
        details.append(make(panels));
        linked.redraw();
      }
    });
    section.append(details);
  };
  more(`${along.length - FIRST} more along the axes`, along.slice(FIRST));
  section.append(el("div", {class: "beside"},
    make(own.filter((panel) => panel.by === "setup" || panel.by === "time")),
    new Volume(linked, part, reach[part]).node));
  more("Against signals", own.filter((panel) => panel.by === "signal"));
  const tables = found.tables.filter((t) => t.part === part);
  section.append(el("h2", {}, `${NAMES[part]}: worst first`));
  const listed = el("div", {class: "beside"});
  section.append(listed);
  tables.forEach((t, k) => {
    const choose = (i) => el("button", {class: "small", onclick: () =>
      linked.choose(linked.matching(t.select[i])),
      "aria-label": `Show ${t.cells[i].slice(0, 3).join(" ")} in all pictures`}, "Show");
    const able = t.select.every((s) => s.tool === undefined);
    listed.append(el("details", {open: k < 2}, el("summary", {}, t.title),
      table("", t.columns, t.cells, able ? choose : null)));
  });
  return section;
}
