/**
 * Numbers, units and times as an operator reads them. Pure: values in, text out.
 */

const PREFIXES = new Map([[-9, "n"], [-6, "µ"], [-3, "m"], [0, ""], [3, "k"]]);
const MINUS = "−";
const THIN_SPACE = "\u202f";

/** Half width of a 95 % interval in standard errors. */
export const Z_95 = 1.96;

/**
 * The power of ten, a multiple of three, that brings a value between 1 and 1000. An exponent in use stays until
 * the value is clearly outside, so that a reading near a border does not flip between units.
 * @param {number | null} value
 * @param {number} inUse
 * @returns {number}
 */
export function engineeringExponent(value, inUse) {
  if (value === null || value === 0 || !Number.isFinite(value)) return inUse;
  const mantissa = Math.abs(value) / 10 ** inUse;
  if (mantissa >= 0.8 && mantissa < 1250) return inUse;
  const exponent = 3 * Math.floor(Math.log10(Math.abs(value)) / 3);
  return Math.min(3, Math.max(-9, exponent));
}

/**
 * @param {number} exponent
 * @param {string} unit
 */
export function prefixed(exponent, unit) {
  return `${PREFIXES.get(exponent) ?? ""}${unit}`;
}

/**
 * Decimals that show one or two digits of an interval's half width; those in use stay while they serve.
 * @param {number | null} half half width in the unit shown
 * @param {number | null} inUse
 * @returns {number}
 */
export function decimalsFor(half, inUse) {
  if (half === null || half <= 0 || !Number.isFinite(half)) return inUse ?? 2;
  if (inUse !== null) {
    const shown = half * 10 ** inUse;
    if (shown >= 4 && shown < 80) return inUse;
  }
  return Math.min(6, Math.max(0, Math.ceil(Math.log10(5 / half))));
}

/**
 * @param {number} value
 * @param {number} decimals
 */
export function fixed(value, decimals) {
  const [whole, fraction] = Math.abs(value).toFixed(decimals).split(".");
  const text = fraction === undefined ? grouped(whole) : `${grouped(whole)}.${fraction}`;
  return value < 0 && Number(value.toFixed(decimals)) !== 0 ? `${MINUS}${text}` : text;
}

/** @param {number} count */
export function integer(count) {
  return grouped(String(Math.round(count)));
}

/**
 * How many of something: 1 mark, 2 marks.
 * @param {number} count
 * @param {string} one
 * @param {string} [more]
 */
export function counted(count, one, more = `${one}s`) {
  return `${integer(count)} ${count === 1 ? one : more}`;
}

/** @param {string} digits */
function grouped(digits) {
  return digits.length < 5 ? digits : digits.replace(/\B(?=(\d{3})+$)/g, THIN_SPACE);
}

/**
 * A size on disk with about three digits.
 * @param {number} count
 */
export function bytes(count) {
  for (const [size, unit] of /** @type {[number, string][]} */ ([[1e12, "TB"], [1e9, "GB"], [1e6, "MB"], [1e3, "kB"]])) {
    if (count >= 0.9995 * size) return `${plain(count / size, 3)} ${unit}`;
  }
  return `${count} B`;
}

/** A number with so many significant digits and no trailing zeros, as one types it.
 * @param {number} value
 * @param {number} digits
 */
export function plain(value, digits) {
  return String(Number(value.toPrecision(digits)));
}

/**
 * A value as it was told: a whole number to its last digit, another one with so many significant digits.
 * @param {number} value
 * @param {number} digits
 */
export function exact(value, digits) {
  return (Number.isSafeInteger(value) ? String(value) : plain(value, digits)).replace("-", MINUS);
}

/**
 * A length of time with about three digits.
 * @param {number} seconds
 */
export function duration(seconds) {
  if (seconds < 0.9995e-3) return `${plain(seconds * 1e6, 3)} µs`;
  if (seconds < 0.9995) return `${plain(seconds * 1000, 3)} ms`;
  if (seconds < 60) return `${seconds.toFixed(seconds < 10 ? 2 : 1)} s`;
  const minutes = Math.floor(seconds / 60);
  if (minutes < 60) return `${minutes} min ${Math.floor(seconds % 60)} s`;
  return `${Math.floor(minutes / 60)} h ${minutes % 60} min`;
}

/**
 * How old data are; what is younger than a picture's life needs no digits.
 * @param {number} seconds
 */
export function age(seconds) {
  if (seconds < 0.2) return "< 0.2 s";
  return seconds < 10 ? `${seconds.toFixed(1)} s` : duration(seconds);
}

/**
 * Time of day on the operator's clock, with the date when it was another day.
 * @param {string | number | Date} time
 * @param {Date} [now]
 */
export function clock(time, now = new Date()) {
  const date = new Date(time);
  if (Number.isNaN(date.getTime())) return String(time);
  const pad = (/** @type {number} */ n) => String(n).padStart(2, "0");
  const day = `${date.getFullYear()}-${pad(date.getMonth() + 1)}-${pad(date.getDate())}`;
  const hour = `${pad(date.getHours())}:${pad(date.getMinutes())}:${pad(date.getSeconds())}`;
  return date.toDateString() === now.toDateString() ? hour : `${day} ${hour}`;
}

/**
 * Reads a number as people type it: a comma is a decimal point, spaces do not count.
 * @param {string} text
 * @returns {number | null}
 */
export function parseNumber(text) {
  const digits = text.replace(/[\s\u202f]/g, "").replace(",", ".").replace(MINUS, "-");
  const value = Number(digits);
  return digits === "" || !Number.isFinite(value) ? null : value;
}

/** What kind of job has a drive, of the name that it has it under, as "experiment". @param {string | null} whom */
export function kindOfJob(whom) {
  return whom?.split(" ")[0] ?? "";
}
