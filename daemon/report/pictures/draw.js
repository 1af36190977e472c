// Draws a page's pictures; Plotly and their figures are unpacked for the first of them.
//
// A picture takes half a second without a graphics card, one in space five: the words come first,
// then what is in view, then the others one by one, so that the page can be read meanwhile.
const waiting = [...document.querySelectorAll("figure[data-plot]")];
let figures;
function draw(node) {
  if (!waiting.includes(node)) return;
  waiting.splice(waiting.indexOf(node), 1);
  inView.unobserve(node);
  figures = figures || opened();
  const figure = figures[node.dataset.plot];
  Plotly.newPlot(node.querySelector("div"), figure.data, figure.layout,
    // its buttons speak English only
    { responsive: true, displaylogo: false, showSendToCloud: false,
      ...(document.documentElement.lang === "en" ? {} : { displayModeBar: false }) });
}
function opened() {
  const plotly = document.createElement("script");
  plotly.textContent = unpacked(document.getElementById("plotly"));
  document.head.append(plotly);
  return JSON.parse(unpacked(document.getElementById("figures")));
}
const inView = new IntersectionObserver((changes) => {
  for (const change of changes) if (change.isIntersecting) draw(change.target);
});
function drawNext() {
  if (!waiting.length) return;
  draw(waiting.find((node) => !("space" in node.dataset)) || waiting[0]);
  setTimeout(drawNext, 20);
}
let begun = false;
function begin() {
  if (begun) return;
  begun = true;
  for (const node of waiting) inView.observe(node);
  setTimeout(drawNext, 100);
}
// the second frame: in the first one the words are shown; a page behind others has no frames
requestAnimationFrame(() => requestAnimationFrame(begin));
setTimeout(begin, 500);
window.addEventListener("beforeprint", () => {
  // paper has a still drawing of what stands in space
  for (const node of [...waiting]) if (!("space" in node.dataset)) draw(node);
  for (const plot of document.querySelectorAll("figure:not([data-space]) .js-plotly-plot"))
    Plotly.Plots.resize(plot);
});
