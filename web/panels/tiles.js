/**
 * Four tiles: one parameter each, with its interval and what can be said about it.
 * A value that cannot be told is a dash and a reason, never a number. A reason that several share is told once, below.
 *
 * @typedef {import("../api.js").Estimates} Estimates
 * @typedef {import("../api.js").Estimate} Estimate
 */

import { Z_95, age, clock, decimalsFor, duration, engineeringExponent, fixed, integer, plain, prefixed } from "../format.js";
import { showMismatch } from "./mismatch.js";
import { PARAMETERS, writeSymbol } from "../parameters.js";

const STATUS_WORDS = {
  ok: "estimated",
  doubtful: "doubtful",
  stale: "not live",
  held: "held",
  not_told: "cannot be told",
  no_data: "no data yet",
};

/** What has a value to show. */
const TOLD = ["ok", "doubtful", "stale", "held"];

/** @typedef {{parameter: import("../parameters.js").Parameter, root: HTMLElement, exponent: number, decimals: number | null}} Tile */

/** @type {Tile[]} */
let tiles = [];

export function buildTiles() {
  const template = /** @type {HTMLTemplateElement} */ (document.getElementById("tile-template"));
  tiles = PARAMETERS.map((parameter) => {
    const root = /** @type {HTMLElement} */ (template.content.firstElementChild?.cloneNode(true));
    root.id = `tile-${parameter.name}`;
    part(root, "symbol").replaceChildren();
    writeSymbol(part(root, "symbol"), parameter);
    write(root, "meaning", parameter.meaning);
    return { parameter, root, exponent: parameter.exponent, decimals: null };
  });
  document.getElementById("tiles")?.replaceChildren(...tiles.map(({ root }) => root));
  clearTiles();
}

export function clearTiles() {
  for (const tile of tiles) {
    tile.exponent = tile.parameter.exponent;
    tile.decimals = null;
    showTile(tile, undefined, false, "", "");
  }
  showMismatch(null, false);
  writeById("estimates-status", "No data yet.");
  writeById("untold", "");
  writeById("fit", "");
}

/**
 * @param {Estimates} estimates
 * @param {number} rate_hz
 * @param {boolean} connected whether the service is there; without it the numbers are old
 */
export function showEstimates(estimates, rate_hz, connected) {
  const old = !connected || estimates.status === "stale";
  const told = tiles.map(({ parameter }) => estimates.estimates[parameter.name]);
  const several = sharedReasons(told);
  for (const tile of tiles) {
    const { name } = tile.parameter;
    const estimate = estimates.estimates[name];
    const reason = estimate?.reason ?? "";
    showTile(tile, estimate, old, basis(estimate, rate_hz), several.includes(reason) ? "as said below" : reason);
  }
  showMismatch(estimates.mismatch, old);
  writeById("untold", several.map(sentence).join(" "));
  writeById("estimates-status", connected ? statusSentence(estimates, rate_hz) : "Last numbers received, not live.");
  document.getElementById("estimates-status")?.classList.toggle("warn", old);
  writeById("fit", fitSentence(estimates));
}

/** The power of ten a parameter is shown in, for the plot to use the same. @param {string} name */
export function exponentOf(name) {
  return tiles.find(({ parameter }) => parameter.name === name)?.exponent ?? 0;
}

/** Reasons that several parameters share, but for those held. @param {(Estimate | undefined)[]} estimates */
function sharedReasons(estimates) {
  const reasons = estimates.flatMap((e) => e === undefined || e.status === "held" || e.reason === "" ? [] : [e.reason]);
  return [...new Set(reasons.filter((reason, k) => reasons.indexOf(reason) !== k))];
}

/** The window that the data chose. @param {Estimate | undefined} estimate @param {number} rate_hz */
function basis(estimate, rate_hz) {
  if (estimate === undefined || estimate.window === null || !TOLD.includes(estimate.status)) return "";
  return `from the last ${rate_hz > 0 ? duration(estimate.window / rate_hz) : `${integer(estimate.window)} samples`}`;
}

/** @param {string} reason */
function sentence(reason) {
  return `${reason.charAt(0).toUpperCase()}${reason.slice(1)}${reason.endsWith(".") ? "" : "."}`;
}

/**
 * @param {Tile} tile
 * @param {Estimate | undefined} estimate
 * @param {boolean} old
 * @param {string} from what the value rests on, where it is its own
 * @param {string} reason what keeps it from being told, or where that is said
 */
function showTile(tile, estimate, old, from, reason) {
  const { root, parameter } = tile;
  const status = estimate?.status ?? "no_data";
  root.dataset.status = status;
  root.classList.toggle("old", old);
  write(root, "chip", chip(estimate, old));
  write(root, "basis", from);
  write(root, "reason", reason);
  const value = TOLD.includes(status) ? estimate?.value ?? null : null;
  if (value === null) {
    write(root, "value", "—");
    write(root, "value-unit", "");
    write(root, "interval", "");
    return;
  }
  tile.exponent = engineeringExponent(value, tile.exponent);
  const scale = 10 ** tile.exponent;
  const unit = prefixed(tile.exponent, parameter.unit);
  write(root, "value-unit", unit);
  if (status === "held") {
    write(root, "value", plain(value / scale, 6));
    write(root, "interval", "not estimated");
    return;
  }
  const half = typeof estimate?.std === "number" ? (Z_95 * estimate.std) / scale : null;
  tile.decimals = decimalsFor(half, tile.decimals);
  write(root, "value", fixed(value / scale, tile.decimals));
  write(root, "interval", half === null ? "interval not known" : `± ${fixed(half, tile.decimals)} ${unit} (95 %)`);
}

/** The status in words. @param {Estimate | undefined} estimate @param {boolean} old */
function chip(estimate, old) {
  const status = estimate?.status ?? "no_data";
  if (old && status === "ok") return "last estimate";
  const since = estimate?.since ?? null;
  return `${STATUS_WORDS[status] ?? status}${since === null ? "" : ` since ${clock(since)}`}`;
}

/**
 * @param {Estimates} estimates
 * @param {number} rate_hz
 */
function statusSentence({ method, status, samples, window, age_s }, rate_hz) {
  if (status === "stale") return `Not live: the newest row used is ${age_s === null ? "old" : `${age(age_s)} old`}.`;
  if (status === "no_data") return "No data yet.";
  const span = rate_hz > 0 ? ` (${duration(samples / rate_hz)})` : "";
  const filling = status === "filling";
  if (method === "ekf") return `Kalman filter over ${integer(samples)} samples${span}.`;
  if (method === "rls") return `Recursion ${filling ? "filling, " : ""}over ${integer(samples)} samples${span}.`;
  const most = window.length === "auto" ? window.longest : window.length;
  if (filling) return `Window filling: ${integer(samples)} of ${integer(most)} samples.`;
  const chosen = window.length === "auto" ? "Windows chosen from the" : "From the";
  return `${chosen} last ${integer(samples)} samples${span}.`;
}

/** @param {Estimates} estimates */
function fitSentence({ method, residual_rms_V, condition, gaps, left_out, rows_dropped }) {
  const words = [];
  if (residual_rms_V !== null) words.push(`Fit residual ${plain(residual_rms_V, 3)} V rms`);
  if (condition !== null) words.push(`condition number ${plain(condition, 3)}`);
  const where = method === "wls" ? " inside the window" : "";
  if (gaps > 0) words.push(`breaks of the stream${where} ${integer(gaps)}`);
  if (left_out > 0) words.push(`rows left out (no numbers, as while the bridge is off) ${integer(left_out)}`);
  if (rows_dropped > 0) words.push(`rows too fast for the estimator ${integer(rows_dropped)}`);
  return words.join(" · ");
}

/**
 * @param {HTMLElement} root
 * @param {string} className
 */
function part(root, className) {
  return /** @type {HTMLElement} */ (root.querySelector(`.${className}`));
}

/**
 * @param {HTMLElement} root
 * @param {string} className
 * @param {string} text
 */
function write(root, className, text) {
  const target = part(root, className);
  if (target.textContent !== text) target.textContent = text;
}

/**
 * @param {string} id
 * @param {string} text
 */
function writeById(id, text) {
  const target = document.getElementById(id);
  if (target !== null && target.textContent !== text) target.textContent = text;
}
