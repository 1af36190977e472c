// Learn: which cause is missing; any cause tried by hand before it is added.
import {label, say, t} from "../shared/language.js";
import {draw, el, table} from "../shared/dom.js";
import {tryOut} from "./what_if.js";

const MOST = 12; // candidates that are listed

/** The view; `act(path, body)` asks the server to change something. */
export function learnView(found, state, act) {
  const trial = el("section", {id: "what-if", class: "card"});
  const open = (spec) => tryOut(trial, spec, found, state, act);
  const add = (spec, words = t("Add it and refit")) => el("button", {class: "main add",
    disabled: !state.writes, "data-spec": spec, onclick: () => act("/api/add", {spec, on: state.stands_on})}, words);
  const attempt = (spec) => el("button", {class: "small try", "data-spec": spec,
    onclick: () => { open(spec); trial.scrollIntoView({block: "nearest"}); }}, t("Try it"));
  const view = [el("section", {class: "verdict"},
    el("h1", {class: found.verdict === "complete" ? "good" : "bad"}, say(found.title)),
    ...found.said.map((text) => el("p", {class: text.startsWith("SUSPICIOUS") ? "warning" : null}, say(text))),
    state.writes ? null : state.take_out ? el("p", {class: "warning"},
      t("Nothing is added in the plant's store. Take the files out, and open them there: "), el("code", {}, state.take_out))
    : el("p", {class: "warning"}, t("Nothing can be added: no folder for versions was stated. Start again with  abbe open … --versions FOLDER")))];
  const causes = el("div", {class: "causes"});
  found.causes.forEach((cause, k) => causes.append(causeCard(cause, k, add, attempt)));
  for (const s of found.structure) {
    const place = el("div", {class: "plot"});
    causes.append(el("section", {class: "card"}, el("h2", {}, t("What no cause explains")),
      el("p", {}, say(s.said)), place, s.spec ? el("p", {},
        t("A formula describes it without explaining it: "), el("code", {}, s.spec), " ",
        add(s.spec, t("Add the formula"))) : null));
    draw(place, s.figure);
  }
  if (found.verdict === "changed" || found.verdict === "complete")
    causes.append(el("p", {}, el("button", {class: "main", id: "fit", disabled: !state.writes,
      onclick: () => act("/api/fit", {on: state.stands_on})}, t("Fit the model as it is to these campaigns"))));
  view.push(el("div", {class: "columns"}, causes, trial));
  view.push(others(found, open, trial, attempt));
  view.push(adviceView(found));
  const first = found.causes[0]?.spec ?? found.candidates[0]?.spec;
  if (first) open(first);
  return view;
}

/** What to measure next; it is known a little later than the causes. */
export function adviceView(found) {
  return el("section", {id: "advice"}, el("h2", {}, t("What to measure next")),
    found.advice === null ? el("p", {}, t("being worked out …"))
      : found.advice.length ? el("ul", {}, ...found.advice.map((text) => el("li", {}, say(text))))
        : el("p", {}, t("Nothing that would tell more stands out.")));
}

function causeCard(cause, k, add, attempt) {
  const place = el("div", {class: "plot"});
  draw(place, cause.figure);
  return el("section", {class: "card cause", "data-spec": cause.spec},
    el("h2", {}, `${k + 1}. ${say(cause.said)}`),
    el("p", {}, el("code", {}, cause.spec)),
    el("p", {}, add(cause.spec), " ", attempt(cause.spec)),
    cause.instrument ? el("p", {class: "warning"},
      t("It belongs to the instrument: it never goes into the machine's compensation.")) : null,
    ...cause.explanation.map((text) => el("p", {}, say(text))),
    table("", [t("parameter"), t("fitted"), t("plausible"), t("what it is")], cause.parameters.map((row) => row.map((text, k) => (k === 3 ? label(text) : text)))),
    place,
    el("p", {class: "note"}, t("Each dot is a row: what the cause would add, and what is left without it. Means on the dashed line: it explains them.")),
    cause.aliases.length ? table(t("What this campaign cannot tell from it"),
      [t("cause"), t("what it is"), t("χ² that tells them apart (14 is certain)")], cause.aliases.map(([spec, what, apart]) => [spec, say(what), apart]),
      (i) => attempt(cause.aliases[i][0])) : null,
    el("details", {}, el("summary", {}, t("The same as a command")),
      el("pre", {}, el("code", {}, cause.command))));
}

function others(found, open, trial, attempt) {
  const listed = found.candidates.slice(0, MOST);
  const wanted = el("input", {id: "any-cause", list: "all-causes", size: 40, spellcheck: "false",
    placeholder: "backlash axis=Z"});
  const go = (event) => {
    event.preventDefault();
    if (wanted.value.trim()) { open(wanted.value.trim()); trial.scrollIntoView({block: "nearest"}); }
  };
  return el("section", {}, el("h2", {}, t("What else it could be")),
    el("p", {}, t("{n} causes were tested. Evidence of 12 is convincing, a lead of 10 over the next is a clear distinction.", {n: found.tested})),
    table(t("The strongest, each alone against the model as it is"), [t("cause"), t("what it is"), t("evidence")],
      listed.map((c) => [c.spec, say(c.said), c.evidence === null ? "–" : c.evidence.toFixed(1)]),
      (i) => attempt(listed[i].spec)),
    el("form", {onsubmit: go}, el("label", {for: "any-cause"}, t("Try any other: ")), wanted, " ",
      el("button", {class: "small"}, t("Try it")),
      el("datalist", {id: "all-causes"},
        ...found.candidates.map((c) => el("option", {value: c.spec}, say(c.said))))));
}
