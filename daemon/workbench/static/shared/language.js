// The page's own words in the language of the person: English as they stand here, others by one file each.
const KEPT = "abbe-language";
const fileOf = async (name) => (await fetch(new URL(`../words/${name}.json`, import.meta.url))).json();
const languages = await fileOf("languages"); // code -> its own name
const code = chosen();
const words = code === "en" ? {} : await fileOf(code);
document.documentElement.lang = code;

function chosen() {
  const wanted = [localStorage.getItem(KEPT), ...navigator.languages.map((name) => name.slice(0, 2))];
  return wanted.find((name) => name in languages) ?? "en";
}

/** A text in the present language; `{name}` stands for a value. */
export function t(text, values = {}) {
  return (words[text] ?? text).replace(/\{(\w+)\}/g, (all, name) => (name in values ? values[name] : all));
}

const labels = words._labels ?? {};
const fixed = (text) => text.replace(/\{\w+\}/g, "").length;
// what says the most comes first: '{a}: {b}' would fit nearly everything
const patterns = Object.entries(labels).filter(([text]) => text.includes("{")).sort(([a], [b]) => fixed(b) - fixed(a)).map(([text, own]) =>
  [new RegExp(`^${text.replace(/[.*+?^$()|[\]\\]/g, "\\$&").replace(/\{(\w+)\}/g, "(?<$1>.+?)")}$`), own]);

/** A heading, name or line that the server gave, in the present language, also within it; what is not known stays. */
export function label(text) {
  if (text in labels) return labels[text];
  for (const [pattern, own] of patterns) {
    const found = pattern.exec(text);
    if (found) return own.replace(/\{(\w+)\}/g, (_, name) => label(found.groups[name]));
  }
  return text;
}

const templates = words._sentences ?? {};
const MOST = 20_000;
const sentences = new Map(); // text -> what it was made of, as the server said

/** Keep what an answer's sentences were made of. */
export function know(answer) {
  for (const part of [answer, answer?.tables, answer?.work])
    for (const [text, made] of Object.entries(part?.sentences ?? {})) {
      sentences.delete(text);
      sentences.set(text, made);
    }
  // a page may stand for weeks, and figures in sentences change: the newest are kept
  for (const text of sentences.keys()) {
    if (sentences.size <= MOST) break;
    sentences.delete(text);
  }
}

let passing = {}; // of what is said anew every second: nothing of it is kept

/** Have the sentences of what is shown now, and of nothing before it. */
export function knowNow(answer) {
  passing = answer.sentences ?? {};
}

/** A sentence of the commands in the present language; one without its template by what it looks like, else as it is. */
export function say(text) {
  const [template, values] = passing[text] ?? sentences.get(text) ?? [];
  if (code === "en" || template === undefined) return text;
  const own = templates[template] ?? (/\p{L}/u.test(template.replace(/\{\w+\}/g, "")) ? null : template);
  const put = (all, name) => (name in values ? (values[name] === text ? text : line(values[name])) : all);
  return own === null ? label(text) : asWide(own.replace(/\{(\w+)\}/g, put), text);
}

/** As wide as the text in whose place it stands, where that was made so wide for a column. */
function asWide(own, text) {
  return text.endsWith(" ") ? own.padEnd(text.length) : own;
}

/** A line of a command: a sentence with what it was made of, or one that is looked up; what it is moved in by stays. */
export function line(text) {
  if (code === "en") return text;
  const [, before, rest] = /^(\s*)(.*)$/s.exec(text);
  for (const known of [text, rest]) {
    const own = say(known);
    if (own !== known) return known === rest ? before + own : own;
  }
  return before + asWide(label(rest.trimEnd()), rest);
}

/** The state of a correction: with the axes that it is of, where it is some. */
export function stateOf(text) {
  const [, axes, what] = /^([A-Z][A-Z0-9, ]*: )?(.*)$/s.exec(text);
  return `${axes ?? ""}${label(what)}`;
}

/** Put what stands in the page's HTML into the language; `data-t` marks it, `data-t-label` its label, `data-t-hint` what stands in an empty field. */
export function translatePage() {
  for (const node of document.querySelectorAll("[data-t]")) node.textContent = t(node.textContent);
  for (const node of document.querySelectorAll("[data-t-label]")) node.setAttribute("aria-label", t(node.getAttribute("aria-label")));
  for (const node of document.querySelectorAll("[data-t-hint]")) node.placeholder = t(node.placeholder);
}

/** Fill a list with the languages; choosing one shows the page anew. */
export function offerLanguages(list) {
  for (const [name, own] of Object.entries(languages)) {
    const option = new Option(own, name, false, name === code);
    option.lang = name;
    list.append(option);
  }
  list.addEventListener("change", () => {
    localStorage.setItem(KEPT, list.value);
    location.reload();
  });
}
