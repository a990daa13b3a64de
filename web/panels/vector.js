/**
 * The dq plane: the vectors of current and voltage, where the current has been in the last two seconds, and how far it
 * may go. Beside it the same as numbers.
 *
 * @typedef {import("../api.js").Latest} Latest
 * @typedef {import("./recent.js").RecentRows} RecentRows
 */

import { draw, make } from "../dom.js";
import { element } from "../fields.js";
import { fixed } from "../format.js";

const TRAIL_S = 2;
const RADIUS = 92; // of the picture, to which a scale's end goes
const NICE = [1, 1.5, 2, 3, 4, 5, 6, 8, 10];

const picture = element("vector");
const values = element("vector-values");

/** Ends of the scales in use: they grow at once and shrink late, so that the picture does not dance. */
let scale_A = 0;
let scale_V = 0;

export function startVector() {
  scale_A = 0;
  scale_V = 0;
}

/**
 * @param {Latest | null} latest
 * @param {RecentRows} rows
 * @param {number | null} i_max in A
 * @param {boolean} old whether this is not what the drive does now
 */
export function drawVector(latest, rows, i_max, old) {
  const trail = trailOf(rows);
  const i = vector(latest?.i_d, latest?.i_q);
  const u = vector(latest?.u_d, latest?.u_q);
  scale_A = scaleFor(Math.max(i_max ?? 0, length(i), ...trail.map(length)), scale_A);
  scale_V = scaleFor(Math.max((latest?.u_dc ?? 0) / Math.sqrt(3), length(u)), scale_V);
  const at = (/** @type {[number, number]} */ [d, q], /** @type {number} */ scale) => [RADIUS * d / scale, -RADIUS * q / scale];
  const dots = trail.map((point, k) => {
    const [cx, cy] = at(point, scale_A);
    return draw("circle", { cx, cy, r: 1.6, class: "trail", opacity: (0.15 + 0.7 * (k / trail.length)).toFixed(2) });
  });
  picture.classList.toggle("old", old);
  picture.replaceChildren(
    draw("line", { x1: -104, y1: 0, x2: 104, y2: 0, class: "axis" }),
    draw("line", { x1: 0, y1: 104, x2: 0, y2: -104, class: "axis" }),
    draw("text", { x: 104, y: -4, class: "name", "text-anchor": "end" }, "d"),
    draw("text", { x: 5, y: -98, class: "name" }, "q"),
    draw("circle", { r: RADIUS, class: "scale" }),
    draw("text", { x: RADIUS * 0.71 + 2, y: RADIUS * 0.71 + 10, class: "end i" }, `i ${scale_A} A`),
    draw("text", { x: RADIUS * 0.71 + 2, y: RADIUS * 0.71 + 20, class: "end u" }, `u ${scale_V} V`),
    ...limit(i_max),
    ...dots,
    ...arrow(u && at(u, scale_V), "u"),
    ...arrow(i && at(i, scale_A), "i"),
  );
  picture.setAttribute("aria-label", label(latest, i, u));
  values.replaceChildren(...numbers(latest, i, u).map(([name, text]) => make("div", {}, make("dt", {}, name), make("dd", {}, text))));
}

/** How far the current may go. @param {number | null} i_max in A */
function limit(i_max) {
  if (i_max === null) return [];
  const r = RADIUS * i_max / scale_A;
  return [draw("circle", { r, class: "limit" }),
    draw("text", { x: -0.71 * r - 2, y: 0.71 * r + 9, class: "end", "text-anchor": "end" }, `i_max ${i_max} A`)];
}

/** @param {number | null | undefined} d @param {number | null | undefined} q @returns {[number, number] | null} */
function vector(d, q) {
  return d === null || d === undefined || q === null || q === undefined ? null : [d, q];
}

/** @param {[number, number] | null} vector */
function length(vector) {
  return vector === null ? 0 : Math.hypot(...vector);
}

/** Where the current has been. @param {RecentRows} rows @returns {[number, number][]} */
function trailOf(rows) {
  const [d, q] = ["i_d", "i_q"].map((name) => rows.latest(name, TRAIL_S, 100));
  return d.t.flatMap((_, k) => {
    const ends = [d.low[k], d.high[k], q.low[k], q.high[k]];
    if (ends.some((value) => value === null)) return [];
    const [d0, d1, q0, q1] = /** @type {number[]} */ (ends);
    return [/** @type {[number, number]} */ ([(d0 + d1) / 2, (q0 + q1) / 2])];
  });
}

/** @param {number} most @param {number} inUse */
function scaleFor(most, inUse) {
  if (!(most > 0)) return inUse || 1;
  if (most <= inUse && most > 0.35 * inUse) return inUse;
  const power = 10 ** Math.floor(Math.log10(most));
  return Number(((NICE.find((step) => step * power >= most) ?? 10) * power).toPrecision(3));
}

/** @param {number[] | null} end @param {"i" | "u"} name */
function arrow(end, name) {
  if (end === null) return [];
  const [x, y] = end;
  const far = Math.hypot(x, y);
  if (far < 1) return [draw("circle", { r: 2.5, class: `tip ${name}` })];
  const [ux, uy] = [x / far, y / far];
  const tip = [[x, y], [x - 8 * ux + 3.5 * uy, y - 8 * uy - 3.5 * ux], [x - 8 * ux - 3.5 * uy, y - 8 * uy + 3.5 * ux]];
  return [
    draw("line", { x1: 0, y1: 0, x2: x - 6 * ux, y2: y - 6 * uy, class: `arrow ${name}` }),
    draw("polygon", { points: tip.map((p) => p.map((v) => v.toFixed(1)).join(",")).join(" "), class: `tip ${name}` }),
    draw("text", { x: x + 7 * ux - 3, y: y + 7 * uy + 4, class: `letter ${name}` }, name),
  ];
}

/**
 * @param {Latest | null} latest
 * @param {[number, number] | null} i
 * @param {[number, number] | null} u
 * @returns {[string, string][]}
 */
function numbers(latest, i, u) {
  const told = (/** @type {number | null | undefined} */ value, /** @type {number} */ decimals, /** @type {string} */ unit) =>
    (value === null || value === undefined ? "–" : `${fixed(value, decimals)} ${unit}`);
  return [
    ["|i|", i === null ? "–" : told(length(i), 2, "A")], ["|u|", u === null ? "–" : told(length(u), 1, "V")],
    ["u_d", told(latest?.u_d, 1, "V")], ["u_q", told(latest?.u_q, 1, "V")], ["u_dc", told(latest?.u_dc, 0, "V")],
    ["winding", told(latest?.temp_winding, 1, "°C")], ["magnet", told(latest?.temp_magnet, 1, "°C")],
  ];
}

/**
 * @param {Latest | null} latest
 * @param {[number, number] | null} i
 * @param {[number, number] | null} u
 */
function label(latest, i, u) {
  if (latest === null) return "No rows of the stream come.";
  const words = [
    i === null ? "no current is told" : `current ${fixed(i[0], 2)} A along d, ${fixed(i[1], 2)} A along q`,
    u === null ? "no voltage: the bridge is off" : `voltage ${fixed(u[0], 1)} V along d, ${fixed(u[1], 1)} V along q`,
  ];
  return `dq plane: ${words.join("; ")}.`;
}
