/**
 * Strips of the drive's signals over the last seconds: currents, voltages, speed, temperatures. Each line goes through
 * the least and the largest value of every bin, so that no row is passed over. Held, they can be zoomed.
 *
 * @typedef {import("./recent.js").RecentRows} RecentRows
 */

import { element, write } from "../fields.js";
import { HOW_ZOOMED, MOVING, STILL, axisOf, baseLayout, copiesCsv, drawOn, palette } from "../plot.js";

const MOST = 700; // bins of a line that moves: what a screen can show; one that is held can be zoomed to each
const [WIDE, NARROW] = [2.6, 1.3]; // lines of a strip: seen where the next one lies over it
const BEHIND_S = 1; // from which on it is seen that no rows come
const RPM = 60 / (2 * Math.PI);

/** @typedef {{name: string, label: string, colour: string}} Line */
/** @typedef {{title: string, unit: string, digits: number, lines: Line[]}} Strip */

/** @type {Strip[]} */
const STRIPS = [
  { title: "current", unit: "A", digits: 3, lines: [
    { name: "i_d", label: "i_d", colour: "second" }, { name: "i_q", label: "i_q", colour: "accent" }] },
  { title: "voltage", unit: "V", digits: 2, lines: [
    { name: "u_d", label: "u_d", colour: "second" }, { name: "u_q", label: "u_q", colour: "accent" }] },
  { title: "speed", unit: "rpm", digits: 1, lines: [{ name: "omega_e", label: "speed", colour: "accent" }] },
];

const canvas = element("strips");
const hold = element("strips-hold");

let span_s = 10;
let n_p = 0;
/** @type {RecentRows | null} */
let held = null;
/** @type {RecentRows | null} */
let shown = null;

export function buildStrips() {
  element("strips-span").addEventListener("change", (event) => {
    span_s = Number(/** @type {HTMLInputElement} */ (event.target).value);
    if (shown !== null) draw(shown);
  });
  hold.addEventListener("click", () => {
    held = held === null && shown !== null ? shown.held() : null;
    hold.setAttribute("aria-pressed", String(held !== null));
    write(hold, held === null ? "Hold" : "Go on");
    if (shown !== null) draw(held ?? shown);
  });
  copiesCsv(element("strips-csv"), "signals", columns);
}

/** Forgets a drive, as when another is chosen. */
export function startStrips() {
  held = null;
  hold.setAttribute("aria-pressed", "false");
  write(hold, "Hold");
}

/** @param {RecentRows} rows @param {number | null} polePairs null: not known, speed is electrical then */
export function drawStrips(rows, polePairs) {
  n_p = polePairs ?? 0;
  shown = rows;
  if (held === null) draw(rows);
}

/** @param {RecentRows} rows */
function draw(rows) {
  const colours = palette();
  const scaled = strips();
  const traces = scaled.flatMap((strip, place) => strip.lines.map((line) => trace(rows, strip, line, place, colours)));
  const warm = temperatures(rows, scaled.length, colours);
  drawOn(canvas, [...traces, ...warm], layout(scaled, warm.length > 0, colours), held === null ? MOVING : STILL);
  canvas.setAttribute("aria-label", summary(rows, scaled));
}

/** Speed in rpm where the pole pairs are known. @returns {(Strip & {scale: number})[]} */
function strips() {
  return STRIPS.map((strip) => (strip.unit !== "rpm" ? { ...strip, scale: 1 }
    : n_p > 0 ? { ...strip, scale: RPM / n_p } : { ...strip, unit: "rad/s", scale: 1 }));
}

/** How far before now the newest row is, in s; 0 while they come, so that nothing dances. @param {RecentRows} rows */
function behind(rows) {
  const age_s = (Date.now() - rows.end) / 1000;
  return held === null && age_s > BEHIND_S ? age_s : 0;
}

/**
 * @param {RecentRows} rows
 * @param {Strip & {scale: number}} strip
 * @param {Line} line
 * @param {number} place
 * @param {Record<string, string>} colours
 */
function trace(rows, strip, line, place, colours) {
  const { t, low, high } = rows.latest(line.name, span_s, held === null ? MOST : Infinity);
  const late_s = behind(rows);
  const scaled = (/** @type {number | null} */ value) => (value === null ? null : value * strip.scale);
  return {
    x: t.flatMap((time) => [time - late_s, time - late_s]), y: t.flatMap((_, k) => [scaled(low[k]), scaled(high[k])]),
    type: "scatter", mode: "lines", name: line.label, xaxis: "x", yaxis: `y${place === 0 ? "" : place + 1}`,
    line: { color: colours[line.colour], width: line === strip.lines.at(-1) ? NARROW : WIDE },
    hovertemplate: `${line.label} %{y:.${strip.digits}f} ${strip.unit}, %{x:.2f} s<extra></extra>`,
  };
}

/**
 * @param {RecentRows} rows
 * @param {number} place
 * @param {Record<string, string>} colours
 */
function temperatures(rows, place, colours) {
  const points = rows.temperatures;
  const newest = rows.end + 1000 * behind(rows);
  return [["winding", "accent", WIDE], ["magnet", "second", NARROW]].flatMap(([name, colour, width]) => {
    const values = points.map((point) => point[/** @type {"winding" | "magnet"} */ (name)]);
    if (values.every((value) => value === null)) return [];
    return [{ x: points.map(({ time }) => (time - newest) / 1000), y: values, type: "scatter", mode: "lines",
      name, xaxis: "x", yaxis: `y${place + 1}`, line: { color: colours[colour], width },
      hovertemplate: `${name} %{y:.1f} °C, %{x:.1f} s<extra></extra>` }];
  });
}

/**
 * @param {(Strip & {scale: number})[]} scaled
 * @param {boolean} warm whether there are temperatures
 * @param {Record<string, string>} colours
 */
function layout(scaled, warm, colours) {
  const axis = { ...axisOf(colours), fixedrange: held === null };
  const titles = [...scaled.map(({ title, unit }) => `${title}, ${unit}`), ...(warm ? ["temp., °C"] : [])];
  const share = 1 / titles.length;
  const axes = Object.fromEntries(titles.map((title, place) => [`yaxis${place === 0 ? "" : place + 1}`, {
    ...axis, title: { text: title, standoff: 4, font: { size: 11 } }, nticks: 4,
    domain: [1 - (place + 1) * share + 0.02, 1 - place * share - 0.02],
  }]));
  const names = [...scaled.map(({ lines }) => lines.length < 2 ? [] : lines.map(({ label, colour }) => ({ label, colour }))),
    warm ? [{ label: "magnet", colour: "second" }, { label: "winding", colour: "accent" }] : []];
  return {
    ...baseLayout(colours), ...axes, showlegend: false,
    annotations: names.flatMap((told, place) => told.map(({ label, colour }, k) => ({
      text: `<b>${label}</b>`, xref: "paper", yref: "paper", x: 1, y: 1 - place * share + 0.02, xanchor: "right", yanchor: "middle",
      xshift: -58 * (told.length - 1 - k), showarrow: false, font: { size: 11, color: colours[colour] },
    }))),
    margin: { l: 62, r: 14, t: 14, b: 34 },
    hovermode: "x", dragmode: held === null ? false : "zoom",
    uirevision: held === null ? String(span_s) : "held",
    xaxis: { ...axis, range: [-span_s, 0], anchor: `y${titles.length}`, ticksuffix: " s", nticks: 6,
      title: { text: held === null ? "" : `before it was held; ${HOW_ZOOMED.toLowerCase()}`, standoff: 4, font: { size: 11 } } },
  };
}

/** What is shown, for those who cannot see it. @param {RecentRows} rows @param {(Strip & {scale: number})[]} scaled */
function summary(rows, scaled) {
  if (rows.length === 0) return "No rows of the stream have come yet.";
  const words = scaled.flatMap(({ lines, unit, scale, digits }) => lines.flatMap(({ name, label }) => {
    const { low, high } = rows.latest(name, span_s, MOST);
    const [least, most] = [low.filter((v) => v !== null), high.filter((v) => v !== null)];
    if (least.length === 0) return [];
    const told = [Math.min(...least), Math.max(...most)].map((value) => (value * scale).toFixed(digits));
    return [`${label} ${told[0]} to ${told[1]} ${unit}`];
  }));
  return `Signals over the last ${span_s} s: ${words.join(", ")}.`;
}

function columns() {
  const rows = held ?? shown;
  if (rows === null) return { t_s: [] };
  const told = Object.fromEntries(STRIPS.flatMap(({ lines }) => lines.map(({ name }) => [name, rows.latest(name, span_s, Infinity)])));
  /** @type {Record<string, (number | null)[]>} */
  const made = { t_s: told.i_d.t.map((t) => Number(t.toFixed(4))) };
  for (const [name, { low, high }] of Object.entries(told)) {
    const unit = { i: "A", u: "V", o: "rad/s" }[name[0]];
    made[`${name}_low [${unit}]`] = low;
    made[`${name}_high [${unit}]`] = high;
  }
  return made;
}
