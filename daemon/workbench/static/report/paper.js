// A view as paper has it: a copy without controls, its pictures as images, under a head that says what it rests on.
import {label, t} from "../shared/language.js";
import {el, moment} from "../shared/dom.js";
import {drawnFiner} from "../shared/space.js";
import {onPaper} from "../shared/theme.js";

const FINER = 2.5; // dots of a picture for each of the screen's
const SHORT = 12; // letters of a SHA-256 that tell files apart
const CONTROLS = "button, form, input, select, textarea, datalist, progress, script, .tip, .how, .waiting, [hidden]";

/** What a report holds: `view` as it is shown now, with `head` as the server has it. */
export async function reportOf(view, name, head, version) {
  const pictures = new Map();
  for (const image of view.querySelectorAll("img")) pictures.set(image, await dataOf(image.src));
  // copied while it is in these colours: some pictures are made of other elements afterwards
  const body = await drawnFiner(FINER, () => onPaper(async () => {
    for (const plot of view.querySelectorAll(".js-plotly-plot"))
      pictures.set(plot, await Plotly.toImage(plot, {format: "svg", width: plot.clientWidth, height: plot.clientHeight}));
    for (const canvas of view.querySelectorAll("canvas"))
      if (canvas.clientWidth) pictures.set(canvas, canvas.toDataURL());
    return copyOf(view, pictures);
  }));
  body.className = `paper-body ${view.dataset.tab}`;
  return {
    title: `${head.machine} – ${name}`,
    node: el("div", {class: "paper"}, headOf(head, name, version), body,
      el("p", {class: "paper-foot"}, `Abbe ${head.abbe}, ${moment(head.made)}`), sheetFoot(head, name)),
  };
}

/** A drawing of the server's as text of the page. */
async function dataOf(address) {
  return `data:image/svg+xml,${encodeURIComponent(await (await fetch(address)).text())}`;
}

function headOf(head, name, version) {
  return el("header", {class: "paper-head"}, el("h1", {}, `${head.machine}: ${name}`),
    version ? el("p", {}, version) : null,
    el("dl", {}, ...[...head.facts, [t("Report made"), head.made]].map(([key, text]) =>
      el("div", {}, el("dt", {}, label(key)),
        el("dd", {class: text ? null : "unstated"}, label(moment(text)) || t("not stated"))))),
    el("table", {}, el("tbody", {}, ...head.files.map(([part, file, sha]) => el("tr", {},
      el("td", {}, label(part)), el("td", {}, file), el("td", {}, el("code", {class: "sha"}, sha || "–")))))));
}

/** What stands on every sheet of paper: a sheet that lies alone says what it is of. */
function sheetFoot(head, name) {
  const facts = head.facts.map(([key, text]) => `${label(key)}: ${label(moment(text)) || t("not stated")}`);
  const files = head.files.map(([part, file, sha]) => `${label(part)}: ${file} (${sha.slice(0, SHORT) || "–"})`);
  return el("div", {class: "sheet-foot"}, el("p", {}, [`${head.machine}: ${name}`, ...facts, ...files,
    `Abbe ${head.abbe}`].join(" · ")));
}

/** A copy of what is seen; what is folded is left out. */
function copyOf(view, pictures) {
  const copy = view.cloneNode(true);
  const [from, to] = [view, copy].map((node) => [...node.querySelectorAll("*")]);
  const changes = [];
  from.forEach((node, k) => {
    const image = pictures.get(node);
    // a chart is its canvas and what lies over it
    const place = node.closest(".uplot") ? to[from.indexOf(node.closest(".uplot"))] : to[k];
    if (image) changes.push([place, el("img", {src: image, width: node.clientWidth, height: node.clientHeight,
      alt: node.getAttribute("aria-label") ?? node.closest("figure, section")?.querySelector("figcaption, h2, h3")?.textContent ?? ""})]);
  });
  for (const [place, image] of changes) place.replaceWith(image);
  // what was typed and counts is kept as text: a copy of a field has nothing in it
  from.forEach((node, k) => {
    if (!node.matches("[data-said]")) return;
    to[k].replaceWith(el("ul", {}, ...[...node.querySelectorAll(".field")].map((row) =>
      el("li", {}, `${row.querySelector("label").textContent}: ${row.querySelector("input").value || "–"}`))));
  });
  for (const folded of copy.querySelectorAll("details:not([open])")) folded.remove();
  for (const control of copy.querySelectorAll(CONTROLS)) control.remove();
  for (const canvas of copy.querySelectorAll("canvas")) canvas.remove();
  for (const node of copy.querySelectorAll("[tabindex], [id]")) {
    // what is wider than the window is scrolled with keys, too
    if (!node.matches(".wide")) node.removeAttribute("tabindex");
    if (node.id !== "what-if") node.removeAttribute("id");
  }
  for (const name of ["tabindex", "id", "role", "aria-labelledby"]) copy.removeAttribute(name);
  return copy;
}
