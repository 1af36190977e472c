// Two versions side by side: what each leaves of the same campaigns, and in what they differ.
import {label, say, t} from "../shared/language.js";
import {el, keyFigures, table} from "../shared/dom.js";
import {get, why} from "../shared/server.js";
import {Linked} from "../residuals/linked.js";
import {reaches, Scatter} from "../residuals/scatter.js";
import {legend} from "./compare.js";

/** Two lists of versions, a button, and what is found below them; as it stands where it is of the same. */
export function besideSection(versions, standsOn, trouble) {
  const key = JSON.stringify([versions, standsOn]);
  const before = document.getElementById("beside")?.parentElement;
  if (before?.dataset.key === key) return before;
  const current = versions.find((v) => v.current)?.number;
  const place = el("div", {id: "beside"});
  const choose = (id, words, at) => {
    const list = el("select", {id}, ...versions.map((v) => el("option", {value: v.number, selected: v.number === at}, v.name)));
    return [list, el("label", {for: id}, words, " "), " "];
  };
  const [left, ...leftWords] = choose("beside-left", t("Left"), versions[0].number);
  const [right, ...rightWords] = choose("beside-right", t("Right"), current || versions.at(-1).number);
  const look = async () => {
    place.replaceChildren(el("p", {class: "waiting"}, t("Being worked out …")));
    try {
      const found = await get(`/api/beside?left=${left.value}&right=${right.value}`);
      place.replaceChildren(...shown(found));
      place.dataset.ready = `${left.value} ${right.value}`;
    } catch (error) {
      place.replaceChildren();
      trouble(why(error));
    }
  };
  return el("section", {"data-key": key}, el("h2", {}, t("Two versions side by side")),
    el("p", {class: "tools"}, ...leftWords, left, " ", ...rightWords, right, " ",
      el("button", {id: "look-beside", onclick: look}, t("Lay them side by side"))), place);
}

function shown(found) {
  const linked = new Linked(found.rows, found.values);
  linked.before = found.before;
  const reach = reaches(found.rows, found.before);
  const [left, right] = found.sides;
  const card = (side) => el("section", {class: "card"}, el("h3", {class: side.holds ? "good" : "bad"}, side.name),
    el("p", {}, say(side.title)),
    ...keyFigures(side.key));
  return [
    el("div", {class: "pair"}, card(left), card(right)),
    ...found.only.map((specs, k) => (specs.length
      ? el("p", {}, t("Only in {version}: ", {version: found.sides[k].name}), el("code", {}, specs.join("; "))) : null)).filter(Boolean),
    el("p", {class: "legend"}, el("span", {}, el("b", {class: "before"}, "■"),
      t(" grey: left by {left}; in colour: by {right}", {left: left.name, right: right.name}))), legend("third"),
    el("div", {class: "panels"}, ...found.panels.map((panel) => new Scatter(panel, linked, reach[panel.part]).node)),
    found.causes.length ? el("details", {}, el("summary", {}, found.causes.length === 1 ? t("One value in which the two differ") : t("{n} values in which the two differ", {n: found.causes.length})),
      table("", found.columns, found.causes.map((row) => row.map((text) => text || "–"))))
      : el("p", {}, t("The two have the same values.")),
    el("div", {class: "beside"}, ...found.groups.map((group) => el("details", {}, el("summary", {}, `${group.unit === "µm" ? t("Lengths") : t("Rotations")}: ${label(group.title)}`),
      table("", ["", t("{name}: rms, {unit}", {name: left.name, unit: group.unit}), t("{name}: rms, {unit}", {name: right.name, unit: group.unit})],
        group.cells.map(([where, ...rest]) => [label(where), ...rest]))))),
  ];
}
