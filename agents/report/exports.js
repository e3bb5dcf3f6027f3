// Tables: sorted by a click on a head, saved as CSV and LaTeX in the order in which they are shown.

/** Lets the heads of a table sort its rows: numbers by value, names by letter; empty cells come last. */
export function sortable(table) {
  table.tHead.addEventListener("click", (event) => {
    const head = event.target.closest("th");
    if (!head) return;
    const descending = head.getAttribute("aria-sort") === "ascending";
    for (const other of head.parentElement.children) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", descending ? "descending" : "ascending");
    const body = table.tBodies[0];
    const rows = [...body.rows].map((row) => [key(row.cells[head.cellIndex]), row]);
    rows.sort(([a], [b]) => order(a, b, descending));
    body.append(...rows.map(([, row]) => row));
  });
}

function key(cell) {
  const value = cell?.dataset.v;
  if (value === undefined) return cell?.textContent.trim() ?? "";
  return value === "" ? null : value === "inf" ? Infinity : value === "-inf" ? -Infinity : Number(value);
}

function order(a, b, descending) {
  if (a === null || b === null) return (a === null) - (b === null);
  const ascending = typeof a === "string" || typeof b === "string" ? String(a).localeCompare(String(b)) : a === b ? 0 : a < b ? -1 : 1;
  return descending ? -ascending : ascending;
}

/** The buttons that save a table. */
export function exports(name) {
  const line = document.createElement("p");
  line.className = "exports";
  line.dataset.name = name;
  line.append("Save as ");
  for (const [kind, text] of [["csv", "CSV"], ["tex", "LaTeX"]]) {
    const button = document.createElement("button");
    button.type = "button";
    button.dataset.export = kind;
    button.textContent = text;
    line.append(button);
  }
  return line;
}

/** Saves the table beside a button of `exports`. */
export function save(button) {
  const table = button.closest(".exported").querySelector("table");
  const kind = button.dataset.export;
  const name = button.parentElement.dataset.name.replace(/[^\w.-]+/g, "_");
  const text = kind === "csv" ? csv(table) : latex(table);
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], { type: "text/plain" }));
  link.download = `${name}.${kind}`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

/** The rows as text: numbers in full, with the ends of intervals in columns of their own. */
function csv(table) {
  const heads = [...table.tHead.rows[0].cells].map((cell) => cell.textContent.trim());
  const rows = [...table.tBodies[0].rows];
  const wide = heads.map((_, place) => rows.some((row) => row.cells[place].dataset.low !== undefined));
  const lines = [heads.flatMap((head, place) => (wide[place] ? [head, `${head} low`, `${head} high`] : [head]))];
  for (const row of rows) {
    lines.push(
      [...row.cells].flatMap((cell, place) => {
        const value = cell.dataset.v ?? cell.textContent.trim();
        return wide[place] ? [value, cell.dataset.low ?? "", cell.dataset.high ?? ""] : [value];
      }),
    );
  }
  const quoted = (text) => (/[",\n\r]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
  return lines.map((line) => line.map(quoted).join(",") + "\n").join("");
}

const SPECIAL = {
  "\\": "\\textbackslash{}", "~": "\\textasciitilde{}", "^": "\\textasciicircum{}", "\u2212": "$-$", "\u221e": "$\\infty$",
  "\u00b5": "$\\mu$", "\u03c4": "$\\tau$", "\u2013": "--", "\u2717": "$\\times$", "\u25b6": "", "<": "$<$", ">": "$>$",
};

/** A tabular with the rules of booktabs, numbers as they are shown. */
function latex(table) {
  const escaped = (text) => text.trim().replace(/[\\{}$&#%_~^\u2212\u221e\u00b5\u03c4\u2013\u2717\u25b6<>]/g, (each) => SPECIAL[each] ?? `\\${each}`);
  const line = (cells) => `${[...cells].map((cell) => escaped(cell.textContent)).join(" & ")} \\\\`;
  const heads = table.tHead.rows[0].cells;
  return [
    `\\begin{tabular}{l${"r".repeat(heads.length - 1)}}`, "\\toprule", line(heads), "\\midrule",
    ...[...table.tBodies[0].rows].map((row) => line(row.cells)), "\\bottomrule", "\\end{tabular}", "",
  ].join("\n");
}
