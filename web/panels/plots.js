/**
 * Four time plots: estimate, shaded 95 % interval, doubtful values dotted, held ones dashed. The right edge is now, and
 * stays now when nothing comes any more.
 *
 * @typedef {import("./history.js").Point} Point
 * @typedef {import("../parameters.js").Parameter} Parameter
 */

import { decimalsFor, fixed, prefixed } from "../format.js";
import { PARAMETERS, writeSymbol } from "../parameters.js";
import { MOVING, axisOf, baseLayout, copiesCsv, drawOn, palette } from "../plot.js";

/** Times that can be shown and the distance of their ticks, in seconds. */
const TICK_S = new Map([
  [60, 15], [300, 60], [900, 300], [3600, 900], [86_400, 21_600], [2_592_000, 604_800], [31_536_000, 7_776_000],
]);

/** Units of time, in seconds, the longest first. @type {[number, string][]} */
const TIMES = [[86_400, "d"], [3600, "h"], [60, "min"], [1, "s"]];

/** @type {Map<string, HTMLElement>} */
const canvases = new Map();
/** What each plot shows. @type {Map<string, [import("./history.js").History, number]>} */
const shown = new Map();

export function buildPlots() {
  const template = /** @type {HTMLTemplateElement} */ (document.getElementById("plot-template"));
  const figures = PARAMETERS.map((parameter) => {
    const figure = /** @type {HTMLElement} */ (template.content.firstElementChild?.cloneNode(true));
    const canvas = /** @type {HTMLElement} */ (figure.querySelector(".canvas"));
    canvas.id = `plot-${parameter.name}`;
    writeSymbol(/** @type {Element} */ (figure.querySelector(".symbol")), parameter);
    /** @type {Element} */ (figure.querySelector(".meaning")).textContent = parameter.meaning;
    canvases.set(parameter.name, canvas);
    copiesCsv(/** @type {HTMLElement} */ (figure.querySelector(".csv")), parameter.name, () => columns(parameter));
    return figure;
  });
  document.getElementById("plots")?.replaceChildren(...figures);
}

/**
 * The time axis that holds what there is, up to the time wanted: a young page does not show empty minutes.
 * @param {number} recorded_s
 * @param {number} wanted_s
 */
export function spanFor(recorded_s, wanted_s) {
  const enough = [...TICK_S.keys()].find((span_s) => span_s >= recorded_s) ?? wanted_s;
  return Math.min(enough, wanted_s);
}

/**
 * @param {Parameter} parameter
 * @param {import("./history.js").History} history
 * @param {number} span_s time shown
 * @param {number} exponent power of ten of the unit shown
 */
export function drawPlot(parameter, history, span_s, exponent) {
  const canvas = canvases.get(parameter.name);
  if (canvas === undefined) return;
  shown.set(parameter.name, [history, span_s]);
  const now = Date.now();
  const unit = prefixed(exponent, parameter.unit);
  const runs = history.runs(now - span_s * 1000);
  const colours = palette();
  const nothing = history.begin === Infinity ? "no values are remembered" : "no values in this time";
  canvas.setAttribute("aria-label", summary(parameter, runs, unit, 10 ** exponent, span_s, nothing));
  drawOn(canvas, traces(runs, now, timeUnit(span_s)[0], 10 ** exponent, unit, colours),
    layout(span_s, unit, range(runs, 10 ** exponent), colours, nothing), MOVING);
}

/**
 * @param {Point[][]} runs
 * @param {number} now
 * @param {number} time_s unit of the time axis
 * @param {number} scale
 * @param {string} unit
 * @param {Record<string, string>} colours
 */
function traces(runs, now, time_s, scale, unit, colours) {
  const [estimated, doubtful, held] = ["estimate", "doubtful", "held"]
    .map((kind) => runs.filter((run) => run[0].kind === kind));
  const latest = estimated.at(-1)?.at(-1);
  const digits = `.${decimalsFor(latest === undefined ? null : latest.half / scale, null)}f`;
  return [
    { ...band(estimated, now, time_s, scale), name: "interval", mode: "lines", type: "scatter", showlegend: false,
      hoverinfo: "skip", fill: "toself", fillcolor: colours.band, line: { width: 0 } },
    { ...line(estimated, now, time_s, scale), name: "estimate", mode: "lines", type: "scatter", showlegend: false,
      line: { color: colours.accent, width: 1.6 },
      hovertemplate: `%{y:${digits}} ± %{customdata:${digits}} ${unit}<extra></extra>` },
    { ...line(doubtful, now, time_s, scale), name: "doubtful", mode: "lines", type: "scatter", showlegend: false,
      line: { color: colours.accent, width: 1.6, dash: "dot" },
      hovertemplate: `doubtful: %{y:${digits}} ± %{customdata:${digits}} ${unit}<extra></extra>` },
    { ...line(held, now, time_s, scale), name: "held", mode: "lines", type: "scatter", showlegend: false,
      line: { color: colours.muted, width: 1.6, dash: "dash" }, hovertemplate: `held at %{y} ${unit}<extra></extra>` },
  ];
}

/**
 * The runs one after another, with a null between two so that no line bridges a hole.
 * @param {Point[][]} runs
 * @param {number} now
 * @param {number} time_s unit of the time axis
 * @param {number} scale
 */
function line(runs, now, time_s, scale) {
  const points = runs.flatMap((run) => [...run, null]);
  return {
    x: points.map((p) => p && (p.time - now) / (1000 * time_s)),
    y: points.map((p) => p && p.value / scale),
    customdata: points.map((p) => p && p.half / scale),
  };
}

/**
 * One closed outline per run: along the upper bound and back along the lower.
 * @param {Point[][]} runs
 * @param {number} now
 * @param {number} time_s unit of the time axis
 * @param {number} scale
 */
function band(runs, now, time_s, scale) {
  const x = [];
  const y = [];
  for (const run of runs) {
    const back = [...run].reverse();
    x.push(...[...run, ...back].map((p) => (p.time - now) / (1000 * time_s)), null);
    y.push(...run.map((p) => p.high / scale), ...back.map((p) => p.low / scale), null);
  }
  return { x, y };
}

/**
 * The value axis: wide enough for the intervals, except the few widest, so that the first second of a filling window
 * does not flatten the minutes after it.
 * @param {Point[][]} runs
 * @param {number} scale
 * @returns {[number, number] | null}
 */
function range(runs, scale) {
  const points = runs.flat();
  if (points.length === 0) return null;
  const lows = points.map((p) => p.low).sort((a, b) => a - b);
  const highs = points.map((p) => p.high).sort((a, b) => a - b);
  const cut = Math.floor(points.length * 0.02);
  const latest = points[points.length - 1];
  const low = Math.min(lows[cut], latest.value - latest.half);
  const high = Math.max(highs[highs.length - 1 - cut], latest.value + latest.half);
  const margin = 0.15 * (high - low) || 0.05 * Math.abs(high) || 1;
  return [(low - margin) / scale, (high + margin) / scale];
}

/**
 * @param {number} span_s
 * @param {string} unit
 * @param {[number, number] | null} limits
 * @param {Record<string, string>} colours
 * @param {string} nothing said where there is nothing to draw
 */
function layout(span_s, unit, limits, colours, nothing) {
  const axis = { ...axisOf(colours), fixedrange: true };
  return {
    ...baseLayout(colours),
    margin: { l: 76, r: 14, t: 8, b: 38 },
    dragmode: false,
    hovermode: "x",
    xaxis: { ...axis, ...timeTicks(span_s), range: [-span_s / timeUnit(span_s)[0], 0],
      title: { text: "time before now", standoff: 6 }, hoverformat: timeUnit(span_s)[0] === 1 ? ".0f" : ".2f",
      ticksuffix: ` ${timeUnit(span_s)[1]}`, showspikes: false },
    yaxis: { ...axis, title: { text: unit, standoff: 4 }, nticks: 6,
      ...(limits === null ? { range: [0, 1], showticklabels: false } : { range: limits }) },
    annotations: limits !== null ? [] : [{ text: nothing, showarrow: false, xref: "paper",
      yref: "paper", x: 0.5, y: 0.5, font: { size: 13 } }],
  };
}

/**
 * The unit that a time axis has: hover texts keep seconds up to a quarter of an hour.
 * @param {number} span_s
 * @returns {[number, string]} in seconds, and its name
 */
function timeUnit(span_s) {
  return TIMES.find(([size]) => span_s > 900 && span_s > size) ?? [1, "s"];
}

/** @param {number} span_s */
function timeTicks(span_s) {
  const step = TICK_S.get(span_s) ?? span_s / 4;
  const [size] = timeUnit(span_s);
  const [shown, name] = TIMES.find(([unit]) => step >= unit) ?? [1, "s"];
  const ticks = [];
  for (let t = 0; t >= -span_s; t -= step) ticks.push(t);
  return { tickmode: "array", tickvals: ticks.map((t) => t / size),
    ticktext: ticks.map((t) => (t === 0 ? "now" : `−${Math.round((-10 * t) / shown) / 10} ${name}`)) };
}

/**
 * What the plot shows, for those who cannot see it.
 * @param {Parameter} parameter
 * @param {Point[][]} runs
 * @param {string} unit
 * @param {number} scale
 * @param {number} span_s
 * @param {string} nothing said where there is nothing to draw
 */
function summary(parameter, runs, unit, scale, span_s, nothing) {
  const values = runs.flat().map((p) => p.value / scale);
  const [size, name] = TIMES.find(([unit]) => span_s >= unit) ?? [1, "s"];
  const what = `${parameter.meaning} over the last ${span_s / size} ${name}`;
  if (values.length === 0) return `${what}: ${nothing}`;
  const [low, high] = values.reduce(([a, b], v) => [Math.min(a, v), Math.max(b, v)], [Infinity, -Infinity]);
  return `${what}: between ${fixed(low, 2)} and ${fixed(high, 2)} ${unit}`;
}

/** The points shown, SI. @param {Parameter} parameter */
function columns({ name, unit }) {
  const [history, span_s] = shown.get(name) ?? [null, 0];
  const points = history?.runs(Date.now() - span_s * 1000).flat() ?? [];
  return {
    time: points.map((p) => new Date(p.time).toISOString()),
    [`${name} [${unit}]`]: points.map((p) => p.value),
    [`half_95 [${unit}]`]: points.map((p) => p.half),
    status: points.map((p) => p.kind),
  };
}
