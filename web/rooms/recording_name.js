/**
 * What a recording is called where there are others: its title, a file's name, else what it is and of when.
 */

import { clock, duration } from "../format.js";

/** @param {import("../api.js").Recording} recording */
export function nameOf({ id, title, kind, begun, seconds }) {
  return title || (kind === "file" ? id : "") || `${kind} of ${clock(begun)}${seconds === null ? "" : `, ${duration(seconds)}`}`;
}
