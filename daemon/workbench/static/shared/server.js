// Asking the server: its answers, what it refuses, and that it is away, or does not let this window in.
import {Attached} from "./attached.js";
import {know, line, t} from "./language.js";

/** What the server does not want. */
export class Refusal extends Error {}

/** This window is not let in: its session is over, or the server is another one. */
export class Outside extends Refusal {
  constructor() {
    super(t("This window is not let in any more: nobody did anything for too long, or the workbench was started anew. Open the address that its terminal shows in this browser; this window then goes on, with what was typed."));
  }
}

/** Nobody answered: whether what was asked for is done is not known. */
export class Lost extends Error {
  constructor() {
    super(t("The workbench did not answer: whether this was done is not known. Nothing is asked for twice; look first, when it is back."));
  }
}

/** What a person is told of a request that failed; anything else is a mistake of the page's. */
export function why(error) {
  if (error instanceof Refusal || error instanceof Lost) return line(error.message);
  throw error;
}

/** JSON of this server; null where it is not known yet. */
export function get(path) {
  return answer(path, {cache: "no-store"});
}

/** Have something done; `token` where that takes a role. It is asked for once, whatever comes of it. */
export function post(path, body = {}, token = "") {
  const role = token ? {authorization: `Bearer ${token}`} : {};
  return answer(path, {
    method: "POST", headers: {"content-type": "application/json", ...role}, body: JSON.stringify(body),
  });
}

/** Have a file taken, as it is; once. */
export function send(path, file) {
  return answer(path, {method: "POST", headers: {"content-type": "text/csv"}, body: file});
}

async function answer(path, how) {
  let response, found;
  try {
    response = await fetch(path, how);
    const type = response.headers.get("content-type") ?? "";
    found = type.startsWith("application/json") ? await response.json() : await response.text();
  } catch (error) {
    // no connection, or one that ended half-way
    if (error instanceof TypeError || error instanceof SyntaxError) throw new Lost();
    throw error;
  }
  if (response.headers.get("abbe-session") === "none") throw new Outside();
  know(found);
  if (!response.ok) throw new Refusal(found.detail ?? found);
  return found;
}

const waiting = new Attached();

/** Have `act(anew)` called when the server is back; `anew`: it is another one, which knows nothing of before. */
export function onBack(element, act) {
  waiting.add(element, act);
}

/** The server is back. */
export function back(anew) {
  waiting.call(anew);
}
