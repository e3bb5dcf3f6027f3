// The page of a report: unpacks its data, and connects tables, tooltips and the dialog of the episodes.
import { Episodes } from "./episodes.js";
import { save, sortable } from "./exports.js";

/** The data of the page: JSON, compressed, in base64. */
async function unpacked(text) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return JSON.parse(await new Response(stream).text());
}

/** Shows what a mark of a chart says, while the pointer or the focus is on it. */
function tooltips(tip) {
  const show = (event) => {
    const mark = event.target.closest?.("[data-tip]");
    tip.hidden = !mark;
    if (!mark) return;
    tip.textContent = mark.dataset.tip;
    const box = mark.getBoundingClientRect();
    const [x, y] = event.type === "focusin" ? [box.left + box.width / 2, box.top] : [event.clientX, event.clientY];
    tip.style.left = `${Math.max(8, Math.min(x + 12, innerWidth - tip.offsetWidth - 8))}px`;
    tip.style.top = `${y > tip.offsetHeight + 20 ? y - tip.offsetHeight - 10 : y + 18}px`;
  };
  for (const type of ["pointermove", "focusin"]) document.addEventListener(type, show);
  for (const type of ["focusout", "pointerdown"]) document.addEventListener(type, () => (tip.hidden = true));
  document.addEventListener("scroll", () => show({ type: "focusin", target: document.activeElement }), { passive: true });
}

for (const table of document.querySelectorAll("table.numbers")) sortable(table);
document.addEventListener("click", (event) => {
  const button = event.target.closest("[data-export]");
  if (button) save(button);
});
tooltips(document.getElementById("tip"));

const episodes = unpacked(document.getElementById("data").textContent).then(
  (data) => new Episodes(document.getElementById("episodes"), data),
);
const follow = async () => (await episodes).open(location.hash);
addEventListener("hashchange", follow);
addEventListener("popstate", follow);
if (location.hash.startsWith("#/")) follow();
episodes.then(() => document.documentElement.classList.add("ready"));
