/**
 * The shaft's panel: moment of inertia, friction and load torque with their intervals, or why they cannot be told.
 *
 * @typedef {import("../api.js").Mechanics} Mechanics
 * @typedef {import("../api.js").Estimate} Estimate
 */

import { Z_95, clock, decimalsFor, engineeringExponent, fixed, prefixed } from "../format.js";
import { make } from "../dom.js";

/** @typedef {{name: string, letter: string, index: string, meaning: string, exponent: number, decimals: number | null, value: HTMLElement}} Row */

/** Square centimetres for what is below 0.1 kg m², as data sheets have it. */
const KG_CM2 = { below: 0.1, unit: "kg cm²", scale: 1e-4 };

/** @type {Row[]} */
let rows = [];

export function buildShaft() {
  rows = [
    ["J", "J", "", "moment of inertia"],
    ["B", "B", "", "viscous friction"],
    ["T_C", "T", "C", "Coulomb friction"],
    ["tau_L", "τ", "L", "load torque"],
  ].map(([name, letter, index, meaning]) => (
    { name, letter, index, meaning, exponent: 0, decimals: null, value: make("dd", { id: `shaft-${name}` }, "—") }
  ));
  document.getElementById("shaft-values")?.replaceChildren(...rows.map(({ letter, index, meaning, value }) => (
    make("div", {}, make("dt", {}, make("b", {}, letter, make("sub", {}, index)), ` ${meaning}`), value)
  )));
}

/**
 * @param {Mechanics | null} mechanics
 * @param {boolean} connected whether the service is there; without it the numbers are old
 */
export function showShaft(mechanics, connected) {
  const panel = document.getElementById("shaft");
  if (panel === null) return;
  panel.dataset.status = mechanics?.status ?? "no_data";
  panel.classList.toggle("old", !connected || mechanics?.status === "stale");
  for (const row of rows) write(row.value, mechanics === null ? "—" : told(row, mechanics));
  write(document.getElementById("shaft-sentence"), mechanics === null ? "No data yet." : words(mechanics));
}

/** @param {Row} row @param {Mechanics} mechanics */
function told(row, { estimates, sum, direction }) {
  if (row.name === "tau_L" && sum !== null) return `${quantity(row, sum)} with ${direction > 0 ? "+" : "−"} T_C`;
  return quantity(row, estimates[row.name]);
}

/** @param {Row} row @param {Estimate | undefined} estimate */
function quantity(row, estimate) {
  const value = estimate?.value ?? null;
  if (estimate === undefined || value === null) return "—";
  let [scale, unit] = [1, "kg m²"];
  if (row.name !== "J") {
    row.exponent = engineeringExponent(value, row.exponent);
    [scale, unit] = [10 ** row.exponent, prefixed(row.exponent, estimate.unit)];
  } else if (value < KG_CM2.below) ({ scale, unit } = KG_CM2);
  const half = estimate.std === null ? null : (Z_95 * estimate.std) / scale;
  row.decimals = decimalsFor(half, row.decimals);
  const interval = half === null ? "" : ` ± ${fixed(half, row.decimals)}`;
  return `${fixed(value / scale, row.decimals)}${interval} ${unit}${estimate.status === "doubtful" ? ", doubtful" : ""}`;
}

/** @param {Mechanics} mechanics */
function words({ status, sentence, since }) {
  const said = sentence === "" ? "" : `${sentence.charAt(0).toUpperCase()}${sentence.slice(1)}.`;
  if (status === "ok") return "From how it accelerates under the motor’s torque. ± is half a 95 % interval.";
  return status === "stale" && since !== null ? `Told before ${clock(since)}. ${said}` : said;
}

/** @param {HTMLElement | null} element @param {string} text */
function write(element, text) {
  if (element !== null && element.textContent !== text) element.textContent = text;
}
