/**
 * The fields for the Kalman filter's tuning. What the operator touched is theirs, as in all of the form.
 *
 * @typedef {import("../api.js").Tuning} Tuning
 * @typedef {"noise_i" | "lsb" | "omega_e" | "doubt" | "warming"} Key
 */

import { element, input, number, write } from "../fields.js";
import { plain } from "../format.js";

const HELP = {
  tuned: "Variances from the figures below.",
  paper: "The published variances, for the published motor.",
  custom: "The variances given over REST or in the configuration.",
};

/** What each field is called, and its unit in SI. @type {{key: Key, what: string, scale: number}[]} */
const FIELDS = [
  { key: "noise_i", what: "Current noise", scale: 1e-3 },
  { key: "lsb", what: "Current resolution", scale: 1e-3 },
  { key: "omega_e", what: "Electrical speed", scale: 1 },
  { key: "doubt", what: "Doubt of start values", scale: 1e-2 },
  { key: "warming", what: "Warming up", scale: 1 },
];

const preset = input("ekf-preset");

/**
 * @param {Tuning | null} tuning
 * @param {Set<HTMLInputElement>} touched
 */
export function fillTuning(tuning, touched) {
  if (tuning !== null) {
    if (!touched.has(preset)) preset.value = tuning.preset;
    for (const { key, scale } of FIELDS) {
      const value = tuning[key];
      const field = input(`ekf-${key}`);
      const text = value === null ? "" : plain(value / scale, 6);
      if (!touched.has(field) && field.value !== text) field.value = text;
    }
  }
  element("ekf-sheet").hidden = preset.value !== "tuned";
  write(element("preset-help"), HELP[/** @type {Tuning["preset"]} */ (preset.value)] ?? "");
}

/**
 * What was touched, in the service's words and SI; undefined where nothing was.
 * @param {Set<HTMLInputElement>} touched
 * @returns {Partial<Tuning> | undefined}
 */
export function tuningChange(touched) {
  /** @type {Partial<Tuning>} */
  const body = {};
  if (touched.has(preset)) body.preset = /** @type {Tuning["preset"]} */ (preset.value);
  for (const { key, what, scale } of FIELDS) {
    const field = input(`ekf-${key}`);
    if (!touched.has(field)) continue;
    if (key === "omega_e" && field.value.trim() === "") body.omega_e = null;
    else body[key] = Number((number(field, what) * scale).toPrecision(12));
  }
  return Object.keys(body).length > 0 ? body : undefined;
}
