// Campaigns: which there are, one that is dropped here, and which of them the model is laid beside.
import {line, t} from "../shared/language.js";
import {el, moment, number, table} from "../shared/dom.js";
import {get, Lost, Refusal, send, why} from "../shared/server.js";
import {who} from "../shared/who.js";

const MB = 1e6;

/** What stands in place of a comparison where there is nothing yet to compare. */
export function noCampaign(act, trouble) {
  const panel = campaignsPanel(act, trouble);
  panel.open = true;
  return [el("section", {class: "verdict"}, el("h1", {}, t("Nothing has been measured here yet")),
    el("p", {}, t("Drop a campaign on this page, or choose one: the model is laid beside it, and the verdict comes first.")),
    el("p", {class: "note"}, t("What an instrument's own software wrote becomes a campaign by  {command}", {command: "abbe import-campaign FILE --as … -o campaign.csv"}))), panel];
}

/** What stands in place of a comparison that could not be made. */
export function noVerdict(act, trouble) {
  const panel = campaignsPanel(act, trouble);
  panel.open = true;
  return [el("section", {class: "verdict"}, el("h1", {}, t("Nothing can be said of this yet")),
    el("p", {}, t("Why stands above. Choose or drop another campaign, or measure more."))), panel];
}

/** A folded list of all campaigns, with a place to drop others. */
export function campaignsPanel(act, trouble) {
  const listed = el("div", {});
  const chosen = el("input", {type: "file", id: "campaign-files", accept: ".csv,text/csv", multiple: true});
  chosen.addEventListener("change", () => sendAll([...chosen.files], act, trouble));
  const panel = el("details", {id: "campaigns"}, el("summary", {}, t("Campaigns: drop one, or choose others")),
    el("p", {class: "drop"}, el("label", {for: "campaign-files"}, t("Drop a campaign anywhere on this page, or choose a file: ")), chosen), listed);
  panel.addEventListener("toggle", () => { if (panel.open) list(listed, act, trouble); });
  return panel;
}

async function list(place, act, trouble) {
  const uses = new Map();
  try {
    const found = await get("/api/campaigns");
    const choice = (c) => {
      const select = el("select", {"aria-label": t("What {name} is for", {name: c.name})},
        ...[["", t("not used")], ["fitted", t("laid beside the model")], ["held", t("held out")]].map(([value, words]) =>
          el("option", {value, selected: value === c.use}, words)));
      uses.set(c.id, select);
      return select;
    };
    const of = (use) => [...uses].filter(([, select]) => select.value === use).map(([id]) => id);
    if (found.campaigns.length) place.replaceChildren(
      table("", [t("File"), t("Size, MB"), t("Changed (UTC)")], found.campaigns.map((c) => [c.name, number(c.bytes / MB, 2), moment(c.at)]),
        (i) => choice(found.campaigns[i])),
      el("p", {}, el("button", {class: "main", id: "use", onclick: () =>
        act("/api/campaigns/use", {fitted: of("fitted"), held: of("held")})}, t("Compare with these"))));
    place.append(el("p", {class: "note"}, found.lasting ? t("What is dropped is kept beside the versions.")
        : t("What is dropped is kept until the workbench ends: no folder was stated (--versions FOLDER).")));
  } catch (error) {
    trouble(why(error));
  }
}

/** Send files that a person dropped or chose, and lay the model beside them. */
export async function sendAll(files, act, trouble) {
  if (!files.length) return;
  try {
    const {campaigns, largest} = await get("/api/campaigns");
    const fitted = [];
    for (const file of files) {
      if (file.size > largest) throw new Refusal(t("{name} is larger than {n} MB: name it where the workbench is started.", {name: file.name, n: number(largest / MB)}));
      fitted.push((await send(`/api/campaigns?${new URLSearchParams({name: file.name, by: who()})}`, file)).id);
    }
    const held = campaigns.filter((c) => c.use === "held" && !fitted.includes(c.id)).map((c) => c.id);
    await act("/api/campaigns/use", {fitted, held});
  } catch (error) {
    if (!(error instanceof Refusal) && !(error instanceof Lost)) throw error;
    trouble(t("Nothing was taken: {why}", {why: line(error.message)}));
  }
}
