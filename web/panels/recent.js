/**
 * What the strips and the dq picture remember of the stream's rows: bins with their extremes, two minutes of them.
 *
 * @typedef {import("../api.js").Recent} Recent
 * @typedef {{low: (number | null)[], high: (number | null)[]}} Extremes
 */

export const SIGNALS = ["i_d", "i_q", "u_d", "u_q", "omega_e", "u_dc"];
const MEMORY_S = 125;

export class RecentRows {
  bin_s = 0.02;
  /** When the newest row ended, in ms. */
  end = 0;
  /** Number of the oldest bin. */
  first = 0;
  #epoch = "";
  /** @type {Record<string, Extremes>} */
  signals = {};
  /** @type {{time: number, winding: number | null, magnet: number | null}[]} */
  temperatures = [];

  /** Bins there are. */
  get length() {
    return this.signals.i_q?.low.length ?? 0;
  }

  /** @param {Recent} told */
  take(told) {
    const [epoch, number] = told.first.split(".");
    const from = Number(number);
    if (epoch !== this.#epoch || told.bin_s !== this.bin_s || from > this.first + this.length || from < this.first) {
      this.#epoch = epoch;
      this.first = from;
      this.signals = Object.fromEntries(SIGNALS.map((name) => [name, { low: [], high: [] }]));
    }
    this.bin_s = told.bin_s;
    this.end = Date.now() - 1000 * told.age_s;
    for (const name of SIGNALS) {
      const mine = this.signals[name];
      for (const side of /** @type {const} */ (["low", "high"])) {
        mine[side].length = from - this.first;
        mine[side].push(...told.signals[name][side]);
      }
    }
    const over = this.length - Math.round(MEMORY_S / this.bin_s);
    if (over > 500) {
      this.first += over;
      for (const { low, high } of Object.values(this.signals)) { low.splice(0, over); high.splice(0, over); }
    }
  }

  /** @param {number} time in ms @param {import("../api.js").Latest | null} latest */
  takeTemperatures(time, latest) {
    const last = this.temperatures.at(-1);
    if (latest === null || (last !== undefined && time - last.time < 500)) return;
    this.temperatures.push({ time, winding: latest.temp_winding, magnet: latest.temp_magnet });
    while (this.temperatures[0].time < time - 1000 * MEMORY_S) this.temperatures.shift();
  }

  /** A copy that nothing is added to. */
  held() {
    const { bin_s, end, first, signals, temperatures } = this;
    return Object.assign(new RecentRows(), { bin_s, end, first, ...structuredClone({ signals, temperatures }) });
  }

  /**
   * The latest bins of a signal, at most so many of them: neighbours are joined, extremes kept.
   * @param {string} name
   * @param {number} span_s
   * @param {number} most
   * @returns {{t: number[], low: (number | null)[], high: (number | null)[]}} times in s before the newest row, <= 0
   */
  latest(name, span_s, most) {
    const { low, high } = this.signals[name] ?? { low: [], high: [] };
    const wanted = Math.min(low.length, Math.ceil(span_s / this.bin_s));
    const join = Math.max(1, Math.ceil(wanted / most));
    const begin = Math.ceil((this.first + low.length - wanted) / join) * join - this.first; // joined alike as time goes on
    const told = { t: /** @type {number[]} */ ([]), low: /** @type {(number | null)[]} */ ([]), high: /** @type {(number | null)[]} */ ([]) };
    for (let k = Math.max(0, begin); k < low.length; k += join) {
      told.t.push((k + join / 2 - low.length) * this.bin_s);
      told.low.push(least(low.slice(k, k + join), Math.min));
      told.high.push(least(high.slice(k, k + join), Math.max));
    }
    return told;
  }
}

/**
 * @param {(number | null)[]} values
 * @param {(...values: number[]) => number} choose
 */
function least(values, choose) {
  const told = /** @type {number[]} */ (values.filter((value) => value !== null));
  return told.length === 0 ? null : choose(...told);
}
