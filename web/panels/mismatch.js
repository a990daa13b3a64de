/**
 * The line that says since when, and where, the model does not explain the drive. Nothing, where it always has.
 *
 * @typedef {import("../api.js").Mismatch} Mismatch
 */

import { clock, plain } from "../format.js";

const element = /** @type {HTMLElement} */ (document.getElementById("mismatch"));

/**
 * @param {Mismatch | null} mismatch
 * @param {boolean} old whether the stream or the service is gone
 */
export function showMismatch(mismatch, old) {
  element.dataset.status = mismatch?.status ?? "not_told";
  element.classList.toggle("old", old);
  const text = mismatch === null ? "" : sentence(mismatch);
  if (element.textContent !== text) element.textContent = text;
}

/** @param {Mismatch} mismatch */
function sentence({ status, since, until, where, rms_V }) {
  if (since === null) return "";
  if (status !== "unexplained") {
    const ended = until === null ? "" : ` to ${clock(until)}`;
    return `The model explains the drive. From ${clock(since)}${ended} it did not: ${where}.`;
  }
  const size = rms_V === null ? "" : `, ${plain(rms_V, 2)} V rms above noise`;
  return `The model has not explained the drive since ${clock(since)}${size}: ${where}. `
    + "Record a capture and diagnose it.";
}
