// The frame: what is known of the machine, what is under way, and the views.
import {el, get, post, Refusal} from "./dom.js";
import {compareView} from "./compare.js";
import {adviceView, learnView} from "./learn.js";
import {Live} from "./live.js";
import {watchView} from "./watch.js";

let TABS = ["live", "compare", "learn", "watch"];
const QUICK = 250, CALM = 1500; // ms between two looks at the server
const $ = (id) => document.getElementById(id);
const view = $("view");
let tab = null, live = null, seen = null, state = null, ended = false, mine = false, drawing = 0;

/** Show a tab; what it needs is computed if nobody has asked for it yet. */
async function show(name) {
  tab = name;
  for (const t of TABS) {
    $(`tab-${t}`).setAttribute("aria-selected", String(t === name));
    $(`tab-${t}`).tabIndex = t === name ? 0 : -1;
  }
  view.setAttribute("aria-labelledby", `tab-${name}`);
  $("selection").hidden = true;
  if (name !== "live") { live?.close(); live = null; }
  await refresh();
}

/** Draw the present tab with what is known. */
async function refresh() {
  const turn = ++drawing;
  if (tab === "live") {
    if (live) return;
    live = new Live(() => header().catch(() => {}));
    view.replaceChildren(live.node);
    view.dataset.tab = "live";
    return;
  }
  const found = await get(`/api/${tab}`);
  if (turn !== drawing) return;
  let parts;
  if (found === null) {
    if (tab !== "watch" && !state?.task && !state?.error) await ask(`/api/${tab}`);
    parts = [el("p", {class: "waiting"}, state?.error ? "Not known." : "Being worked out …")];
  } else if (tab === "compare") parts = compareView(found, () => show("learn"));
  else if (tab === "learn") {
    const key = JSON.stringify([state.version, found.title, found.rms]);
    if (view.dataset.tab === "learn" && view.dataset.key === key) {
      // only what to measure next has become known: sliders stay where they are
      $("advice").replaceWith(adviceView(found));
      return;
    }
    view.dataset.key = key;
    parts = learnView(found, state, act);
  }
  else parts = watchView(found, state, act, () => show("learn"));
  view.replaceChildren(...parts);
  view.dataset.tab = found === null ? "" : tab;
}

async function ask(path, body) {
  try {
    await post(path, body);
    $("trouble").hidden = true;
  } catch (error) {
    if (!(error instanceof Refusal)) throw error;
    trouble(error.message);
  }
}

/** Change something, and watch what becomes of it. */
async function act(path, body) {
  mine = true;
  await ask(path, body);
  await look();
  if (path !== "/api/back") await show("watch");
}

function trouble(text) {
  $("trouble").textContent = text;
  $("trouble").hidden = !text;
}

/** What the server says of itself; everything is loaded anew where something has changed. */
async function look() {
  const now = await get("/api/state");
  const before = state;
  state = now;
  if (tab === null) begin();
  $("task").hidden = now.task === null;
  if (now.task) {
    const left = now.task.left > 2 ? `, about ${Math.ceil(now.task.left)} s left` : "";
    $("task-words").textContent = `${now.task.what}: ${now.task.stage}${left}`;
    $("task-bar").value = now.task.done;
  }
  const over = before?.task && !now.task;
  if (now.changes === seen && !over) return;
  seen = now.changes;
  if (now.error) trouble(now.error);
  else if (before && before.version !== now.version && !mine)
    trouble(`The model is ${now.version} now: it was changed in another window.`);
  else if (over || before?.error) trouble("");
  if (!now.task) mine = false;
  await header();
  await refresh();
}

/** Which views there are, and the one that is shown first. */
function begin() {
  tab = state.first === "compare" ? "compare" : "live";
  if (state.first === "only live") {
    TABS = ["live"];
    for (const name of ["compare", "learn", "watch"]) $(`tab-${name}`).remove();
  }
  for (const t of TABS) {
    $(`tab-${t}`).setAttribute("aria-selected", String(t === tab));
    $(`tab-${t}`).tabIndex = t === tab ? 0 : -1;
  }
  view.setAttribute("aria-labelledby", `tab-${tab}`);
}

/** A moment as people write it. */
function moment(text) {
  return /^\d{4}-\d\d-\d\dT/.test(text) ? text.slice(0, 16).replace("T", " ") : text;
}

async function header() {
  const head = await get("/api/head");
  document.title = `${head.machine} – Abbe`;
  $("machine").textContent = head.machine;
  $("version").textContent = state.version;
  const facts = $("facts");
  facts.querySelector("dl").replaceChildren(...head.facts.map(([name, text]) =>
    el("div", {}, el("dt", {}, name), el("dd", {class: text ? null : "unstated"}, moment(text) || "not stated"))));
  facts.querySelector("table").replaceChildren(el("tbody", {}, ...head.files.map(([part, file, sha]) =>
    el("tr", {}, el("td", {}, part), el("td", {}, file),
      el("td", {}, el("code", {class: "sha"}, sha || "–"))))));
  const said = head.facts.filter(([name]) => ["Date", "Serial number"].includes(name));
  facts.querySelector("summary").textContent = [
    ...said.map(([name, text]) => `${name}: ${moment(text) || "not stated"}`),
    ...head.files.map(([part, file, sha]) => `${part}: ${file} (${sha.slice(0, 12)})`)].join(" · ");
  $("made").textContent = `Abbe ${head.abbe}, ${moment(head.made)}`;
}

async function watchOver() {
  while (!ended) {
    try {
      await look();
      view.classList.remove("lost");
    } catch (error) {
      view.classList.add("lost");
      trouble(error instanceof Refusal ? error.message
        : "The workbench does not answer. It is asked again; if 'abbe open' was ended, start it anew.");
      seen = null;
    }
    await new Promise((resolve) => setTimeout(resolve, state?.task ? QUICK : CALM));
  }
}

for (const name of TABS) {
  const button = $(`tab-${name}`);
  button.addEventListener("click", () => show(name));
  button.addEventListener("keydown", (event) => {
    const step = {ArrowRight: 1, ArrowLeft: -1}[event.key];
    if (!step) return;
    const next = TABS[(TABS.indexOf(name) + step + TABS.length) % TABS.length];
    $(`tab-${next}`).focus();
    show(next);
  });
}
$("end").addEventListener("click", async () => {
  ended = true;
  live?.close();
  await ask("/api/end");
  document.body.replaceChildren(el("main", {}, el("h1", {}, "The workbench is closed."),
    el("p", {}, "The versions that were made lie in their folder. This window can be closed.")));
});
// a session lasts while somebody is there: what pages ask by themselves does not count
let here = Date.now();
for (const kind of ["pointerdown", "keydown"])
  addEventListener(kind, () => {
    if (ended || Date.now() - here < 60_000) return;
    here = Date.now();
    post("/api/here").catch(() => {});
  });
watchOver();
