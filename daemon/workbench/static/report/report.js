// The window of a report: shows what the workbench made, prints it, saves it as a page that stands alone.
import {translatePage} from "../shared/language.js";

const made = window.opener?.madeReport;
const $ = (id) => document.getElementById(id);

translatePage();
if (made) {
  document.title = made.title;
  $("paper").replaceChildren(document.importNode(made.node, true));
  $("paper").dataset.ready = "true";
}
$("print").addEventListener("click", () => print());
$("save").addEventListener("click", async () => {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([await alone()], {type: "text/html"}));
  link.download = `${document.title.replace(/[^\p{L}\p{N}.-]+/gu, "-")}.html`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
});

/** The page with its styles in it, without a script, and forbidden to ask for anything. */
async function alone() {
  const copy = document.documentElement.cloneNode(true);
  const styles = await Promise.all([...copy.querySelectorAll("link[rel=stylesheet]")].map(async (link) =>
    (await fetch(link.getAttribute("href"))).text()));
  for (const node of copy.querySelectorAll("script, link, #actions")) node.remove();
  const policy = document.createElement("meta");
  policy.setAttribute("http-equiv", "Content-Security-Policy");
  policy.setAttribute("content", "default-src 'none'; img-src data:; style-src 'unsafe-inline'");
  const style = document.createElement("style");
  style.textContent = styles.join("\n");
  copy.querySelector("head").append(policy, style);
  return `<!DOCTYPE html>\n${copy.outerHTML}`;
}
