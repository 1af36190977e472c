// The frame: what is known of the machine, what is under way, and the views.
import {label, line, offerLanguages, t, translatePage} from "./shared/language.js";
import {el, keepingTyped, moment, replace, write} from "./shared/dom.js";
import {back, get, Lost, Outside, post, Refusal, why} from "./shared/server.js";
import {Calibration} from "./calibration/calibrate.js";
import {campaignsPanel, noCampaign, noVerdict, sendAll} from "./model/campaigns.js";
import {compareView} from "./model/compare.js";
import {adviceView, learnView} from "./model/learn.js";
import {Live} from "./live/live.js";
import {reportOf} from "./report/paper.js";
import {Tables} from "./tables/tables.js";
import {watchView} from "./model/watch.js";
import {askWho, who} from "./shared/who.js";

let TABS = ["live", "compare", "learn", "watch", "tables", "calibrate"];
/** Views that follow by themselves what they show. */
const OWN = {live: () => new Live(() => header().catch(() => {})), tables: () => new Tables(),
  calibrate: () => new Calibration()};
const CHANGES = ["/api/add", "/api/fit", "/api/back", "/api/note", "/api/campaigns/use", "/api/read-again"];
/** Where a change is seen; elsewhere what is shown stays. */
const LEADS = {"/api/add": "watch", "/api/fit": "watch", "/api/campaigns/use": "compare"};
const QUICK = 250, CALM = 1500; // ms between two looks at the server
/** Where a window keeps which view it shows: another language, or the page loaded anew, goes on there. */
const KEPT = "abbe-view";
const $ = (id) => document.getElementById(id);
const view = $("view");
let tab = sessionStorage.getItem(KEPT), own = null, seen = null, state = null, ended = false, mine = false, drawing = 0;
let away = false, about = "", heading = null;
// asked for before anything else is known
let headAsked = get("/api/head");
headAsked.catch(() => {});
// what was not answered, and what was said when the server came back: until the person does something else
let unsure = "", told = "";

/** The server is away: it is said by `watchOver`, which then shows what was asked for. */
function missed(error) {
  if (!(error instanceof Lost) && !(error instanceof Outside)) throw error;
}

/** Show a tab; what it needs is computed if nobody has asked for it yet. */
async function show(name) {
  tab = name;
  sessionStorage.setItem(KEPT, name);
  // clicked before anything is known: the first look at the server shows it
  if (!state) return;
  for (const t of TABS) {
    $(`tab-${t}`).setAttribute("aria-selected", String(t === name));
    $(`tab-${t}`).tabIndex = t === name ? 0 : -1;
  }
  view.setAttribute("aria-labelledby", `tab-${name}`);
  $("selection").hidden = true;
  if (own && own.name !== name) { own.close(); own = null; }
  await refresh();
}

/** Draw the present tab with what is known. */
async function refresh() {
  const turn = ++drawing;
  if (tab in OWN) {
    if (own) return;
    own = OWN[tab]();
    own.name = tab;
    replace(view, own.node);
    view.dataset.tab = tab;
    return;
  }
  const [found] = await Promise.all([state.empty && tab !== "watch" ? null : get(`/api/${tab}`), heading]);
  if (turn !== drawing) return;
  let parts;
  if (state.empty && found === null) {
    // what is chosen in it stays
    if (view.dataset.tab === tab && view.dataset.key === "empty") return;
    parts = noCampaign(act, trouble);
    view.dataset.key = "empty";
  } else if (found === null) {
    if (tab !== "watch" && !state?.task && !state?.error) await ask(`/api/${tab}`);
    // a server that was started anew finds it once more: what is shown of the same files stays
    if (view.dataset.tab === tab && view.dataset.about === about) return;
    parts = state?.error ? noVerdict(act, trouble) : [el("p", {class: "waiting"}, t("Being worked out …"))];
  } else if (tab === "compare") {
    const key = JSON.stringify([about, found.title, found.verdict, found.key]);
    // what is chosen and opened in it stays
    if (view.dataset.tab === "compare" && view.dataset.key === key) return;
    view.dataset.key = key;
    parts = [...compareView(found, () => show("learn").catch(missed)), campaignsPanel(act, trouble)];
  } else if (tab === "learn") {
    const key = JSON.stringify([about, found.title, found.rms]);
    if (view.dataset.tab === "learn" && view.dataset.key === key) {
      // only what to measure next has become known: sliders stay where they are
      $("advice").replaceWith(adviceView(found));
      return;
    }
    view.dataset.key = key;
    parts = learnView(found, state, act);
  }
  else {
    const key = JSON.stringify([about, found, state.task]);
    if (view.dataset.tab === "watch" && view.dataset.key === key) return;
    view.dataset.key = key;
    parts = watchView(found, state, act, () => show("learn").catch(missed), trouble);
  }
  keepingTyped(view, () => replace(view, ...parts));
  view.dataset.tab = found === null && !state.empty ? "" : tab;
  view.dataset.about = about;
}

/** Have something done; whether the server does it. */
async function ask(path, body) {
  try {
    await post(path, body);
    if (CHANGES.includes(path)) unsure = told = "";
    trouble("");
    return true;
  } catch (error) {
    trouble(why(error));
    if (error instanceof Lost && CHANGES.includes(path)) unsure = t("What was clicked last was not answered: whether it is done stands under Watch; nothing is done twice.");
    return false;
  }
}

/** Change something, and watch what becomes of it; whether the server does it. */
async function act(path, body) {
  mine = true;
  if (!await ask(path, {...body, by: who()})) {
    mine = Boolean(unsure);
    return false;
  }
  try {
    await look();
    if (LEADS[path]) await show(LEADS[path]);
  } catch (error) {
    missed(error);
  }
  return true;
}

function trouble(text) {
  const words = [label(text), told].filter(Boolean).join(" ");
  write($("trouble"), words);
  $("trouble").hidden = !words;
}

/** Files that are other ones on the disk than what stands here was made of. */
function differ(names) {
  $("differ").hidden = !names.length;
  if (names.length) write($("differ").firstChild, t("On the disk lies another {files} now than was read: what stands here is of the one that was read.", {files: names.join(", ")}));
}

/** What the server says of itself; everything is loaded anew where something has changed. */
async function look() {
  const now = await get("/api/state");
  const before = state;
  state = now;
  if (!before) begin();
  const anew = Boolean(before) && before.run !== now.run;
  const again = away || anew;
  away = false;
  $("task").hidden = now.task === null;
  differ(now.differ ?? []);
  if (now.task) {
    const left = now.task.left > 2 ? t(", about {s} s left", {s: Math.ceil(now.task.left)}) : "";
    $("task-words").textContent = `${label(now.task.what)}: ${label(now.task.stage)}${left}`;
    $("task-bar").value = now.task.done;
  }
  const over = before?.task && !now.task;
  if (now.changes === seen && !over && !again) return;
  seen = now.changes;
  if (now.error) trouble(line(now.error));
  else if (again) { told = returned(anew, before, now); trouble(""); }
  else if (before && before.version !== now.version && !mine) {
    // stays until the person does something: what goes on meanwhile ends by itself
    told = t("The model is {version} now: it was changed in another window. What was done stands under Watch.", {version: now.version});
    trouble("");
  }
  else if (before && before.stands_on !== now.stands_on && !mine) {
    told = t("What this stands on was changed in another window: other campaigns, or files that were read again. What was done stands under Watch.");
    trouble("");
  }
  else if (over || before?.error) trouble("");
  if (!now.task) mine = false;
  // what the view shows is asked for meanwhile
  heading = header();
  if (again) { await heading; back(anew); }
  await Promise.all([heading, refresh()]);
}

/** What there is to say when the server is back. */
function returned(anew, before, now) {
  const said = [unsure].filter(Boolean);
  if (anew) {
    said.push(t("The workbench was started anew. What was typed here stays."));
    // what is only looked at is worked out anew
    if (/^(add|fit)\b/.test(before.task?.what ?? "")) said.push(t("It ended in the middle of: {what}. Look under Watch whether that is done.", {what: before.task.what}));
    if (before.version !== now.version) said.push(t("It shows {version} at first, not {before}: Watch leads to any version.", {version: now.version, before: before.version}));
  }
  return said.join(" ");
}

/** Which views there are, and the one that is shown first. */
function begin() {
  // a view may have been clicked before it was known which there are
  if (!state.views.includes(tab)) tab = state.first;
  for (const name of TABS) if (!state.views.includes(name)) $(`tab-${name}`).remove();
  if (state.views.length === 1) $("who").remove();
  TABS = state.views;
  for (const t of TABS) {
    $(`tab-${t}`).setAttribute("aria-selected", String(t === tab));
    $(`tab-${t}`).tabIndex = t === tab ? 0 : -1;
  }
  view.setAttribute("aria-labelledby", `tab-${tab}`);
}

async function header() {
  const head = await (headAsked ?? get("/api/head"));
  headAsked = null;
  about = JSON.stringify([state.version, head.files]);
  document.title = `${head.machine} – Abbe`;
  $("machine").textContent = head.machine;
  $("version").textContent = state.version;
  const facts = $("facts");
  facts.querySelector("dl").replaceChildren(...head.facts.map(([name, text]) =>
    el("div", {}, el("dt", {}, label(name)), el("dd", {class: text ? null : "unstated"}, label(moment(text)) || t("not stated")))));
  facts.querySelector("table").replaceChildren(el("tbody", {}, ...head.files.map(([part, file, sha]) =>
    el("tr", {}, el("td", {}, label(part)), el("td", {}, file),
      el("td", {}, el("code", {class: "sha"}, sha || "–"))))));
  // nothing was measured: nobody has left its date out
  const dated = head.files.some(([part]) => part.startsWith("campaign"));
  const said = head.facts.filter(([name]) => ["Plant's store", ...(dated ? ["Date"] : []), "Serial number"].includes(name));
  facts.querySelector("summary").textContent = [
    ...said.map(([name, text]) => `${label(name)}: ${moment(text) || t("not stated")}`),
    ...head.files.map(([part, file, sha]) => `${label(part)}: ${file} (${sha.slice(0, 12)})`)].join(" · ");
  $("made").textContent = `Abbe ${head.abbe}, ${moment(head.made)}`;
}

async function watchOver() {
  while (!ended) {
    try {
      await look();
      view.classList.remove("lost");
    } catch (error) {
      view.classList.add("lost");
      if (!(error instanceof Lost) && !(error instanceof Refusal)) console.error(error);
      told = "";
      trouble(error instanceof Refusal ? line(error.message)
        : [t("The workbench does not answer. It is asked again. If it was ended, start 'abbe open' anew with --port {port}: this window then goes on, with what was typed.", {port: location.port}), unsure].filter(Boolean).join(" "));
      away = true;
    }
    await new Promise((resolve) => setTimeout(resolve, state?.task ? QUICK : CALM));
  }
}

for (const name of TABS) {
  const button = $(`tab-${name}`);
  button.addEventListener("click", () => { if (told) { told = unsure = ""; trouble(""); } show(name).catch(missed); });
  button.addEventListener("keydown", (event) => {
    const step = {ArrowRight: 1, ArrowLeft: -1}[event.key];
    if (!step) return;
    const next = TABS[(TABS.indexOf(name) + step + TABS.length) % TABS.length];
    $(`tab-${next}`).focus();
    show(next).catch(missed);
  });
}
/** What is shown now, as a page of its own; the window asks for `madeReport`. */
async function report() {
  const button = $("report");
  button.disabled = true;
  try {
    const name = $(`tab-${tab}`).textContent.replace(/^\d /, "");
    window.madeReport = await reportOf(view, name, await get("/api/head"), state.version);
    if (window.open("/report/report.html", "_blank")) trouble("");
    else trouble(t("The browser did not let the report's window open: allow it, and press Report once more."));
  } catch (error) {
    trouble(t("The report could not be made: {why}", {why: line(error.message)}));
  } finally {
    button.disabled = false;
  }
}

$("report").addEventListener("click", report);
$("differ").querySelector("button").addEventListener("click", () => act("/api/read-again", {}));
$("end").addEventListener("click", async () => {
  try {
    await post("/api/end");
  } catch (error) {
    trouble(why(error));
    return;
  }
  ended = true;
  own?.close();
  document.body.replaceChildren(el("main", {}, el("h1", {}, t("The workbench is closed.")),
    el("p", {}, t("The versions that were made lie in their folder. This window can be closed."))));
});
// on paper stands what it is of; on the screen it may be folded
const facts = $("facts");
let folded = false;
addEventListener("beforeprint", () => { folded = !facts.open; facts.open = true; });
addEventListener("afterprint", () => { if (folded) facts.open = false; });
// a session lasts while somebody is there: what pages ask by themselves does not count
let here = performance.now(); // the computer's clock may be set
for (const kind of ["pointerdown", "keydown"])
  addEventListener(kind, () => {
    if (ended || performance.now() - here < 60_000) return;
    here = performance.now();
    post("/api/here").catch(() => {});
  });
// a file that is dropped is a campaign, or nothing: never a page that the browser goes to
addEventListener("dragover", (event) => event.preventDefault());
addEventListener("drop", (event) => {
  event.preventDefault();
  const files = [...event.dataTransfer?.files ?? []];
  if (files.length && TABS.includes("compare")) sendAll(files, act, trouble).catch(missed);
});
askWho($("who"));
translatePage();
offerLanguages($("language"));
watchOver();
