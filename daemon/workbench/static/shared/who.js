// Who sits here: the name for the journals, typed once.
const KEPT = "abbe-who";

/** The name that was typed; may be empty. */
export function who() {
  return (localStorage.getItem(KEPT) ?? "").trim();
}

/** Keep what is typed in a field. */
export function askWho(field) {
  field.value = who();
  field.addEventListener("input", () => localStorage.setItem(KEPT, field.value));
}
