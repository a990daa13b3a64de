/**
 * Has a recording diagnosed and goes to where that is shown; one that is being diagnosed already is shown.
 */

import { askDiagnosis, readLatestDiagnosis } from "../api.js";
import { go } from "../router.js";

/** The columns that a diagnosis needs. */
const NEEDED = ["u_d", "u_q", "i_d", "i_q", "omega_e"];

/** Those of them that a recording does not have. @param {import("../api.js").Recording} recording */
export function lacking({ columns }) {
  return NEEDED.filter((name) => !columns.includes(name));
}

/**
 * @param {string} recording
 * @param {string} drive
 * @param {object} [request] trust, nominal
 */
export async function diagnoseIt(recording, drive, request = {}) {
  let job;
  try {
    job = await askDiagnosis(recording, request);
  } catch (error) {
    job = await readLatestDiagnosis(recording).catch(() => null);
    if (job === null || !["queued", "running"].includes(job.state)) throw error;
  }
  go("diagnosis", drive, job.id);
}
