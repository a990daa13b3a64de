/**
 * What all plots have in common: the page's colours, axes, how they are zoomed, and their numbers as CSV. Plotly is the
 * classic script of the page; without it the rest of the page still works.
 */

/** @typedef {Record<string, string>} Palette */

/** A plot that stands still: zoomed by drag, put back by a double click; the wheel scrolls the page. */
export const STILL = { displayModeBar: false, showTips: false, scrollZoom: false, doubleClick: "reset" };

/** How one is zoomed, for its caption. */
export const HOW_ZOOMED = "Drag to zoom, double-click for all.";

/** One that moves on with time. */
export const MOVING = { displayModeBar: false, showTips: false, scrollZoom: false, doubleClick: false };

/** The page's colours, so that plots follow light, dark and print as everything else does. @returns {Palette} */
export function palette() {
  const style = getComputedStyle(document.documentElement);
  const names = ["accent", "second", "third", "band", "ink", "line", "muted", "surface",
    "over-1", "over-2", "over-3", "over-4"];
  return Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
}

/** @param {Palette} colours */
export function axisOf(colours) {
  return { gridcolor: colours.line, zeroline: false, linecolor: colours.line, showline: true, ticks: "outside",
    ticklen: 4, tickcolor: colours.line, exponentformat: "none", separatethousands: false };
}

/** @param {Palette} colours */
export function baseLayout(colours) {
  return {
    separators: ".\u202f",
    paper_bgcolor: "rgba(0,0,0,0)",
    plot_bgcolor: "rgba(0,0,0,0)",
    font: { family: getComputedStyle(document.body).fontFamily, size: 12, color: colours.muted },
    hoverlabel: { bgcolor: colours.surface, bordercolor: colours.muted, font: { color: colours.ink } },
  };
}

/**
 * Draws, or says that nothing can.
 * @param {HTMLElement} canvas
 * @param {object[]} traces
 * @param {object} layout
 * @param {object} config
 */
export function drawOn(canvas, traces, layout, config) {
  if (!("Plotly" in window)) {
    canvas.textContent = "No plots: /assets/plotly.min.js did not load.";
    return;
  }
  if (canvas.clientWidth === 0) return; // in a room that is not shown
  // @ts-ignore the classic script's global
  window.Plotly.react(canvas, traces, { ...layout, width: canvas.clientWidth, height: canvas.clientHeight }, config);
}

/**
 * Columns of equal length as CSV, into the clipboard, or into a file where that cannot be had.
 * @param {string} name of the file
 * @param {Record<string, (number | string | null)[]>} columns by heading
 * @returns {Promise<string>} what was done, in words
 */
export async function copyCsv(name, columns) {
  const headings = Object.keys(columns);
  const rows = columns[headings[0]]?.map((_, k) => headings.map((heading) => columns[heading][k] ?? "").join(",")) ?? [];
  const text = [headings.join(","), ...rows, ""].join("\n");
  try {
    await navigator.clipboard.writeText(text);
    return "copied";
  } catch {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([text], { type: "text/csv" }));
    link.download = `${name}.csv`;
    link.click();
    URL.revokeObjectURL(link.href);
    return "saved";
  }
}

/**
 * A button that copies, and says so for a moment.
 * @param {HTMLElement} button
 * @param {string} name
 * @param {() => Record<string, (number | string | null)[]>} columns
 */
export function copiesCsv(button, name, columns) {
  const words = button.textContent;
  button.addEventListener("click", async () => {
    button.textContent = `CSV ${await copyCsv(name, columns())}`;
    setTimeout(() => { button.textContent = words; }, 2000);
  });
}
