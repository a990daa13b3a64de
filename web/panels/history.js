/**
 * What the plots show of one parameter: what the service remembers of it, and what has come since, one point per
 * quarter second at most and a quarter of an hour of them. Only values that the service tells as new enter; where none
 * came, the series has a hole.
 *
 * @typedef {"estimate" | "doubtful" | "held"} Kind
 * @typedef {{time: number, value: number, half: number, low: number, high: number, kind: Kind}} Point
 *   time in ms; value, half width of its interval, and the least and largest that the band shows, in SI
 */

import { Z_95 } from "../format.js";

/** What is plotted, by status. @type {Record<string, Kind>} */
const KINDS = { ok: "estimate", doubtful: "doubtful", held: "held" };
const SPACING_MS = 240;
const HOLE_MS = 2500;

/** Time of which every point is kept, in seconds. */
export const MEMORY_S = 900;

export class History {
  /** @type {Point[]} */
  points = [];
  /** What the service remembers. @type {Point[]} */
  past = [];
  #hole_ms = HOLE_MS;

  /** Time of the oldest point, in ms. */
  get begin() {
    return Math.min(this.past[0]?.time ?? Infinity, this.points[0]?.time ?? Infinity);
  }

  /**
   * What the service remembers, in place of what it has told before.
   * @param {import("../api.js").Course | undefined} course
   * @param {number} span_s
   */
  recall(course, span_s) {
    this.#hole_ms = Math.max(HOLE_MS, 2500 * span_s);
    this.past = course === undefined ? [] : course.t.map((t, k) => {
      const [value, half] = [course.value[k], Z_95 * (course.std[k] ?? 0)];
      return { time: 1000 * (t + span_s / 2), value, half, low: Math.min(course.low[k], value - half),
        high: Math.max(course.high[k], value + half), kind: KINDS[course.status[k]] };
    });
  }

  /**
   * @param {number} time
   * @param {import("../api.js").Estimate | undefined} estimate
   */
  push(time, estimate) {
    const last = this.points.at(-1);
    if (last !== undefined && time - last.time < SPACING_MS) return;
    if (estimate === undefined || estimate.value === null) return;
    const kind = KINDS[estimate.status];
    if (kind === undefined) return;
    const half = Z_95 * (estimate.std ?? 0);
    const { value } = estimate;
    this.points.push({ time, value, half, low: value - half, high: value + half, kind });
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
    const fresh = this.points[0]?.time ?? Infinity;
    for (const point of [...this.past.filter(({ time }) => time < fresh), ...this.points]) {
      if (point.time < since) continue;
      const hole_ms = point.time < fresh || last === null || last.time < fresh ? this.#hole_ms : HOLE_MS;
      const joined = last !== null && point.kind === last.kind && point.time - last.time < hole_ms;
      if (joined) runs[runs.length - 1].push(point);
      else runs.push([point]);
      last = point;
    }
    return runs;
  }
}
