/**
 * Values of a diagnosis as an engineer reads them: a prefix, no more digits than the 95 % interval leaves, its half
 * width, and names in words. Pure.
 *
 * @typedef {{value: number | null, std: number | null, unit: string}} Quantity
 */

import { Z_95, decimalsFor, engineeringExponent, fixed, plain, prefixed } from "../format.js";

const PREFIXED = ["ohm", "H", "Vs", "V", "A", "s", "Hz", "S", "W", "rad"];
const SHOWN = new Map([["ohm", "Ω"], ["degC", "°C"], ["1", ""]]);

/** A unit as printed. @param {string} unit */
export function unitShown(unit) {
  return SHOWN.get(unit) ?? unit;
}

/**
 * By what to divide, and the unit then.
 * @param {number} value
 * @param {string} unit
 * @returns {[number, string]}
 */
function scaleOf(value, unit) {
  if (unit === "1" && value !== 0 && Math.abs(value) < 1) return [0.01, "%"];
  const shown = unitShown(unit);
  if (!PREFIXED.includes(unit) || value === 0) return [1, shown];
  const exponent = engineeringExponent(value, 0);
  return [10 ** exponent, prefixed(exponent, shown)];
}

/**
 * @param {Quantity | null | undefined} quantity
 * @param {number} [like] scaled as this value would be
 */
export function quantityText(quantity, like) {
  if (quantity === null || quantity === undefined || quantity.value === null) return "–";
  const { value, std, unit } = quantity;
  const [scale, shown] = scaleOf(like ?? value, unit);
  const half = std === null || !(std > 0) ? null : (Z_95 * std) / scale;
  const text = half === null ? plain(value / scale, 4).replace("-", "−")
    : `${fixed(value / scale, decimalsFor(half, null))} ± ${fixed(half, decimalsFor(half, null))}`;
  return `${text} ${shown}`.trim();
}

/** An identifier in words; letters keep their index: d-axis saturation, L_d drop. @param {string} name */
export function words(name) {
  return name.replace(/\b([dq])_axis/g, "$1-axis")
    .replace(/(?<![A-Za-z])((?:[A-Za-z]|psi|omega|theta)_[A-Za-z0-9]+)|_/g, (_, symbol) => symbol ?? " ");
}

/** @param {string} text */
export function sentenceCase(text) {
  return `${text.charAt(0).toUpperCase()}${text.slice(1)}`;
}

/** @param {number | null} value */
export function oddsText(value) {
  if (value === null || Number.isNaN(value)) return "–";
  if (value >= 1e12) return "over 10¹²";
  if (value >= 1e4) return `10${[...String(Math.floor(Math.log10(value)))].map((digit) => "⁰¹²³⁴⁵⁶⁷⁸⁹"[Number(digit)]).join("")}`;
  return plain(value, value < 100 ? 2 : 3);
}
