/**
 * What the plots remember of one parameter: bounded in number, one point per quarter second at most.
 * Only values that the service tells as new enter; where none came, the series has a hole.
 *
 * @typedef {"estimate" | "doubtful" | "held"} Kind
 * @typedef {{time: number, value: number, half: number, kind: Kind}} Point time in ms, value and half width in SI
 */

import { Z_95 } from "./format.js";

/** What is plotted, by status. @type {Record<string, Kind>} */
const KINDS = { ok: "estimate", doubtful: "doubtful", held: "held" };
const SPACING_MS = 240;
const HOLE_MS = 2500;

/** Longest time shown, in seconds. */
export const MEMORY_S = 900;

export class History {
  /** @type {Point[]} */
  points = [];

  /**
   * @param {number} time
   * @param {import("./api.js").Estimate | undefined} estimate
   */
  push(time, estimate) {
    const last = this.points.at(-1);
    if (last !== undefined && time - last.time < SPACING_MS) return;
    if (estimate === undefined || estimate.value === null) return;
    const kind = KINDS[estimate.status];
    if (kind === undefined) return;
    this.points.push({ time, value: estimate.value, half: Z_95 * (estimate.std ?? 0), kind });
    const oldest = time - MEMORY_S * 1000;
    while (this.points[0].time < oldest) this.points.shift();
  }

  /**
   * Runs of points of one kind, without holes.
   * @param {number} since
   * @returns {Point[][]}
   */
  runs(since) {
    /** @type {Point[][]} */
    const runs = [];
    /** @type {Point | null} */
    let last = null;
    for (const point of this.points) {
      if (point.time < since) continue;
      const joined = last !== null && point.kind === last.kind && point.time - last.time < HOLE_MS;
      if (joined) runs[runs.length - 1].push(point);
      else runs.push([point]);
      last = point;
    }
    return runs;
  }
}
