// Compare: whether the model holds, and where it does not.
import {label, say, t} from "../shared/language.js";
import {el, keyFigures, table} from "../shared/dom.js";
import {Linked} from "../residuals/linked.js";
import {reaches, Scatter} from "../residuals/scatter.js";
import {Volume} from "../residuals/volume.js";

const NAMES = [t("Lengths"), t("Rotations")];
const FIRST = 6; // pictures along axes that are drawn at once

/** What the marks mean; `still`: how one is drawn of an axis that stood still. */
export function legend(still = "still") {
  const mark = (sign, side, words) => el("span", {},
    el("b", {class: side}, sign), ` ${words}`);
  return el("p", {class: "legend"},
    mark("▲", "minus", t("the axis came from the minus side, moving towards plus")),
    mark("▼", "plus", t("from the plus side, moving towards minus")),
    mark("●", still, t("it stood still, or this is not known")),
    el("span", {}, t("Thick lines: means, where they say more than chance.")), " ",
    el("span", {class: "how"}, t("Drag over points: they show in all pictures.")));
}

/** The view; `next` leads to the causes. */
export function compareView(found, next) {
  const linked = new Linked(found.rows, found.values);
  found.panels.forEach((panel, k) => { panel.number = k; });
  const reach = reaches(found.rows, found.values);
  const verdict = el("section", {class: "verdict"},
    el("h1", {class: !found.holds ? "bad" : found.open ? null : "good"}, say(found.title)),
    ...found.verdict.map((text) => el("p", {}, say(text))),
    found.unfitted ? el("p", {class: "note"}, t("No value of this model has been fitted yet: what is left is the whole error. Looking for causes fits it first.")) : null,
    found.fitted ? el("p", {class: "note"}, say(found.fitted)) : null,
    ...keyFigures(found.key),
    el("p", {}, el("button", {class: "main", id: "why", onclick: next},
      found.holds && !found.open ? t("Is anything missing? Look for causes") : t("Why? Look for causes"))),
    ...found.suspicions.map((text) => el("p", {class: "warning"}, t("SUSPICIOUS: {what}", {what: say(text)}))));
  const sections = [verdict];
  for (const part of [0, 1]) {
    if (!found.rows.part.includes(part)) continue;
    sections.push(partSection(found, linked, part, reach));
  }
  sections.push(el("section", {}, ...found.notes.map((text) => el("p", {class: "note"}, label(say(text))))));
  return sections;
}

const SIDES = /^Side of approach/; // whose rows are named in words, not by what a person chose

/** Whether the rows of a part lie in more than one direction: a line is no volume. */
function inVolume(rows, part) {
  const own = [...rows.row.keys()].filter((i) => rows.part[i] === part);
  return [0, 1, 2].filter((k) => own.some((i) => rows.place[3 * i + k] !== rows.place[3 * own[0] + k])).length > 1;
}

function partSection(found, linked, part, reach) {
  const own = found.panels.filter((panel) => panel.part === part);
  const make = (panels) => el("div", {class: "panels"},
    ...panels.map((panel) => new Scatter(panel, linked, reach[part], found.cells?.[panel.number]).node));
  const along = own.filter((panel) => panel.by === "axis");
  const shown = found.rows.part.filter((p) => p === part).length;
  const section = el("section", {},
    el("h2", {}, t("{part}: where it fails", {part: NAMES[part]})),
    el("p", {}, t("Residuals: what the model leaves of the measurements. All pictures have the same scale; the worst come first, and after them what was measured obliquely, which mixes all components. {shown} rows are drawn of {all} in all.", {shown: found.cells ? found.of : shown, all: found.of})),
    found.cells ? el("p", {}, t("The stronger a place, the more rows lie there. In the volume, and under the pointer, {shown} of them stand for all; the largest are among them. What is selected is counted among all rows.", {shown})) : null,
    legend(),
    make(along.slice(0, FIRST)));
  const more = (title, panels) => {
    if (!panels.length) return;
    const details = el("details", {}, el("summary", {}, title));
    details.addEventListener("toggle", () => {
      if (details.open && details.children.length === 1) {
        details.append(make(panels));
        linked.ask();
      }
    });
    section.append(details);
  };
  more(t("{n} more along the axes", {n: along.length - FIRST}), along.slice(FIRST));
  section.append(el("div", {class: "beside"},
    make(own.filter((panel) => panel.by === "setup" || panel.by === "time")),
    inVolume(found.rows, part) ? new Volume(linked, part, reach[part], Boolean(found.cells)).node : null));
  more(t("Against signals"), own.filter((panel) => panel.by === "signal"));
  const tables = found.tables.filter((each) => each.part === part);
  section.append(el("h2", {}, t("{part}: worst first", {part: NAMES[part]})));
  const listed = el("div", {class: "beside"});
  section.append(listed);
  tables.forEach((each, k) => {
    const cells = SIDES.test(each.title) ? each.cells.map(([where, ...rest]) => [label(where), ...rest]) : each.cells;
    const choose = (i) => el("button", {class: "small", onclick: () =>
      (found.cells ? linked.ask({group: {table: found.tables.indexOf(each), row: i}})
        : linked.choose(linked.matching(each.select[i]))),
      "aria-label": t("Show {row} in all pictures", {row: cells[i].slice(0, 3).join(" ")})}, t("Show"));
    const able = each.select.every((s) => s.tool === undefined);
    listed.append(el("details", {open: k < 2}, el("summary", {}, label(each.title)),
      table("", each.columns, cells, able ? choose : null)));
  });
  return section;
}
