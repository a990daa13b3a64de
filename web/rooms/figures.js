/**
 * The figures of a diagnosis, drawn from their published data with the page's colours: the same as in its report.
 *
 * @typedef {{label: string, unit: string, low: number, high: number, scale: "linear" | "log" | "exponent", names: string[]}} Axis
 * @typedef {{name: string, role: string, kind: "line" | "markers" | "bars" | "heatmap", x: (number | null)[], y: (number | null)[],
 *   z: (number | null)[][], level: [number, number] | null}} Trace
 * @typedef {{title: string, x: Axis, y: Axis, traces: Trace[]}} Panel
 * @typedef {Map<string, {low: number, high: number}>} Scales
 * @typedef {{part: string, name: string, title: string, caption: string, panels: Panel[], beside: boolean, z: Axis | null}} Figure
 */

import { make } from "../dom.js";
import { STILL, axisOf, baseLayout, copiesCsv, drawOn, palette } from "../plot.js";

const [TOP_PX, BOTTOM_PX] = [30, 44];
const PANEL_PX = 200;
/** Between panels: an axis with its title, and the title of the next panel. */
const [BELOW_PX, BESIDE] = [76, 0.1];

/**
 * @param {Figure} figure
 * @param {boolean} narrow
 * @returns {[HTMLElement, (scales: Scales) => void]} it, and what draws it once it is on the page
 */
export function figureElement(figure, narrow) {
  const canvas = make("div", { class: "canvas", role: "img", "aria-label": figure.caption });
  const csv = make("button", { type: "button", class: "small csv" }, "Copy CSV");
  const beside = figure.beside && !narrow && figure.panels.length > 1 && window.innerWidth > 700;
  const bars = Math.max(0, ...figure.panels.map(({ y }) => y.names.length));
  const rows = beside ? 1 : figure.panels.length;
  canvas.style.height = `${bars > 0 ? rows * (70 + 20 * bars) : TOP_PX + BOTTOM_PX + PANEL_PX * rows}px`;
  copiesCsv(csv, figure.name, () => columns(figure));
  /** @param {Scales} scales */
  const draw = (scales) => drawOn(canvas, figure.panels.flatMap((panel, k) => panel.traces.map((trace) => traceOf(trace, k, figure, palette()))),
    layoutOf(figure, beside, parseFloat(canvas.style.height), palette(), scales.get(figure.name) ?? figure.z), STILL);
  return [make("figure", { class: "figure" }, canvas, make("figcaption", {}, figure.caption, csv)), draw];
}

/** @param {Trace} trace @param {Record<string, string>} colours */
function colourOf({ role, level }, colours) {
  const by = /** @type {Record<string, string>} */ ({ before: colours.second, after: colours.accent, noise: colours.ink,
    measured: colours.third, chosen: colours.accent, not_chosen: colours.third });
  if (level === null || role !== "level") return by[role] ?? colours.ink;
  const share = level[1] > 1 ? (level[0] - 1) / (level[1] - 1) : 0;
  return `hsl(${220 - 200 * share} 55% ${matchMedia("(prefers-color-scheme: dark)").matches ? 65 : 40}%)`;
}

/** @param {Trace} trace @param {number} k panel @param {Figure} figure @param {Record<string, string>} colours */
function traceOf(trace, k, figure, colours) {
  const on = { xaxis: `x${k === 0 ? "" : k + 1}`, yaxis: `y${k === 0 ? "" : k + 1}`, name: trace.name };
  const { x, y } = figure.panels[k];
  const colour = colourOf(trace, colours);
  if (trace.kind === "heatmap") {
    return { ...on, type: "heatmap", x: trace.x, y: trace.y, z: trace.z, coloraxis: "coloraxis", hoverongaps: false,
      hovertemplate: `%{x:.4g}, %{y:.4g}: %{z:.3g} ${figure.z?.unit ?? ""}<extra></extra>` };
  }
  if (trace.kind === "bars") {
    return { ...on, type: "bar", orientation: "h", x: trace.x, y: trace.y, marker: { color: colour }, showlegend: false,
      hovertemplate: `${x.scale === "exponent" ? "odds 10<sup>%{x:.3g}</sup>" : "%{x:.4g}"}<extra></extra>` };
  }
  const first = figure.panels.findIndex((panel) => panel.traces.some(({ name }) => name === trace.name)) === k;
  return { ...on, type: "scatter", mode: trace.kind === "markers" ? "markers" : "lines", x: trace.x, y: trace.y,
    showlegend: first, legendgroup: trace.name, marker: { color: colour, size: 5 },
    line: { color: colour, width: trace.role === "measured" ? 2.4 : 1.3, dash: trace.role === "noise" ? "dot" : "solid" },
    hovertemplate: `${trace.name} %{y:.4g} ${y.unit}, %{x:.5g} ${x.unit}<extra></extra>` };
}

/**
 * @param {Figure} figure
 * @param {boolean} beside
 * @param {number} height in px
 * @param {Record<string, string>} colours
 * @param {{low: number, high: number} | null} scale ends of the colours
 */
function layoutOf(figure, beside, height, colours, scale) {
  const axis = axisOf(colours);
  const n = figure.panels.length;
  const gap = beside ? BESIDE : BELOW_PX / (height - TOP_PX - BOTTOM_PX);
  const size = (1 - (n - 1) * gap) / n;
  const names = figure.panels.some(({ y }) => y.names.length > 0);
  const heat = figure.panels.some(({ traces }) => traces.some(({ kind }) => kind === "heatmap"));
  /** @type {Record<string, any>} */
  const axes = {};
  figure.panels.forEach(({ x, y }, k) => {
    const number = k === 0 ? "" : k + 1;
    const from = k * (size + gap);
    const domain = (beside ? [from, from + size] : [1 - from - size, 1 - from]).map((end) => Math.min(1, Math.max(0, end)));
    axes[`xaxis${number}`] = { ...axis, ...rangeOf(x), anchor: `y${number}`, ...(beside ? { domain } : {}),
      title: { text: titleOf(x), standoff: 6 } };
    axes[`yaxis${number}`] = { ...axis, ...rangeOf(y), anchor: `x${number}`, ...(beside ? {} : { domain }),
      title: { text: titleOf(y), standoff: 4 }, ...(y.names.length > 0 && k > 0 && beside ? { showticklabels: false } : {}) };
  });
  return {
    ...baseLayout(colours), ...axes,
    margin: { l: names ? 190 : 70, r: heat ? 70 : 16, t: TOP_PX, b: BOTTOM_PX }, hovermode: "closest", dragmode: "zoom", bargap: 0.3, barmode: "overlay",
    legend: { orientation: "h", x: 1, xanchor: "right", y: 1, yanchor: "bottom" },
    ...(heat && figure.z !== null ? { coloraxis: { cmin: scale?.low, cmax: scale?.high,
      colorscale: [[0, colours.surface], [0.5, colours.third], [1, colours.ink]],
      colorbar: { title: { text: titleOf(figure.z), side: "right" }, thickness: 10, outlinewidth: 0 } } } : {}),
    annotations: figure.panels.flatMap(({ title }, k) => (title === "" ? [] : [{ text: `<b>${title}</b>`, showarrow: false,
      xref: `x${k === 0 ? "" : k + 1} domain`, yref: `y${k === 0 ? "" : k + 1} domain`, x: 0.5, y: 1, yanchor: "bottom" }])),
  };
}

/** @param {Axis} axis */
function rangeOf({ low, high, scale, names }) {
  if (names.length > 0) return { range: [low, high], tickvals: names.map((_, k) => k), ticktext: names, showgrid: false };
  if (scale === "log") return { type: "log", range: [Math.log10(low), Math.log10(high)], exponentformat: "power" };
  if (scale === "exponent") return { range: [low, high], tickprefix: "10<sup>", ticksuffix: "</sup>", nticks: 6, zeroline: true };
  return { range: [low, high] };
}

/** @param {Axis} axis */
function titleOf({ label, unit }) {
  return unit === "" ? label : `${label}, ${unit}`;
}

/** @param {Figure} figure */
function columns(figure) {
  /** @type {Record<string, (number | string | null)[]>} */
  const made = { panel: [], trace: [], x: [], y: [], z: [] };
  for (const { title, y: over, traces } of figure.panels) {
    for (const { name, kind, x, y, z } of traces) {
      const points = kind === "heatmap" ? z.flatMap((row, r) => row.map((value, c) => [x[c], y[r], value])) : x.map((value, k) => [value, y[k], ""]);
      for (const [px, py, pz] of points) {
        made.panel.push(`"${title || over.label}"`);
        made.trace.push(`"${name}"`);
        made.x.push(px);
        made.y.push(py);
        made.z.push(pz);
      }
    }
  }
  return made;
}
