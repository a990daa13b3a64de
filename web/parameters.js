/**
 * The four parameters of the machine as the page names them.
 * Knows nothing of values.
 *
 * @typedef {{name: string, letter: string, index: string, meaning: string, unit: string, exponent: number}} Parameter
 */

/** Unit as printed, and the power of ten used until a value has been seen. @type {Parameter[]} */
export const PARAMETERS = [
  { name: "R_s", letter: "R", index: "s", meaning: "stator resistance", unit: "Ω", exponent: -3 },
  { name: "L_d", letter: "L", index: "d", meaning: "d-axis inductance", unit: "H", exponent: -3 },
  { name: "L_q", letter: "L", index: "q", meaning: "q-axis inductance", unit: "H", exponent: -3 },
  { name: "psi_f", letter: "ψ", index: "f", meaning: "magnet flux linkage", unit: "Vs", exponent: -3 },
];

/** What the Kalman filter holds even where it is to be estimated. */
export const HELD_BY_FILTER = "psi_f";

/**
 * Writes a parameter's letter and index into an element.
 * @param {Element} element
 * @param {Parameter} parameter
 */
export function writeSymbol(element, parameter) {
  const index = document.createElement("sub");
  index.textContent = parameter.index;
  element.replaceChildren(parameter.letter, index);
}
