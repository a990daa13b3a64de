/**
 * The form for the estimation window. What the operator touches is theirs until it is applied or discarded; all else
 * follows the service. Only what was touched is sent, and the service alone judges it.
 *
 * @typedef {import("./api.js").Window} Window
 * @typedef {import("./api.js").WindowChange} WindowChange
 * @typedef {import("./api.js").Estimate} Estimate
 */

import { NoAnswerError, putWindow } from "./api.js";
import { clock, duration, engineeringExponent, integer, parseNumber, plain, prefixed } from "./format.js";
import { PARAMETERS, writeSymbol } from "./parameters.js";

const SETTLE_MS = 3000;

const element = (/** @type {string} */ id) => /** @type {HTMLElement} */ (document.getElementById(id));
const form = /** @type {HTMLFormElement} */ (element("window-form"));
const length = /** @type {HTMLInputElement} */ (element("window-length"));
const periods = /** @type {HTMLInputElement} */ (element("window-periods"));
const message = element("form-message");

/**
 * @typedef {object} HeldRow
 * @property {import("./parameters.js").Parameter} parameter
 * @property {HTMLInputElement} estimated
 * @property {HTMLInputElement} held
 * @property {HTMLElement} entry the held value with all that belongs to it
 * @property {HTMLElement} unit
 * @property {HTMLButtonElement} take
 * @property {number} exponent
 */

/** @type {HeldRow[]} */
let rows = [];
/** @type {Set<HTMLInputElement>} */
const touched = new Set();
/** @type {string | null} */
let drive = null;
/** @type {Window | null} */
let current = null;
/** The window just applied: until a snapshot shows it, snapshots are older than the answer. */
let settling = { wanted: "", until: 0 };
let rate_hz = 0;
/** The last value that was truly estimated. @type {Map<string, number>} */
const lastEstimate = new Map();

export function buildWindowForm() {
  rows = PARAMETERS.map(buildRow);
  for (const event of ["input", "change"]) {
    form.addEventListener(event, ({ target }) => touch(/** @type {HTMLInputElement} */ (target)));
  }
  form.addEventListener("submit", (event) => { event.preventDefault(); apply(); });
  element("window-discard").addEventListener("click", () => { forget(); say("", ""); length.focus(); });
}

/**
 * @param {import("./parameters.js").Parameter} parameter
 * @returns {HeldRow}
 */
function buildRow(parameter) {
  const template = /** @type {HTMLTemplateElement} */ (element("held-template"));
  const root = /** @type {HTMLElement} */ (template.content.firstElementChild?.cloneNode(true));
  const find = (/** @type {string} */ selector) => /** @type {any} */ (root.querySelector(selector));
  const row = { parameter, estimated: find(".estimated"), held: find(".held"), entry: find(".entry"), unit: find(".unit"),
    take: find(".take"), exponent: parameter.exponent };
  writeSymbol(find(".symbol"), parameter);
  row.estimated.id = `estimated-${parameter.name}`;
  row.held.id = `held-${parameter.name}`;
  row.unit.id = `unit-${parameter.name}`;
  row.held.setAttribute("aria-describedby", row.unit.id);
  find(".held-label").htmlFor = row.held.id;
  find(".held-label").setAttribute("aria-label", `hold the ${parameter.meaning} at`);
  row.take.setAttribute("aria-label", `hold the ${parameter.meaning} at its last estimate`);
  row.take.addEventListener("click", () => takeEstimate(row));
  element("held-rows").append(root);
  return row;
}

/** Forgets a drive, as when another is chosen. @param {string | null} name */
export function startWindowForm(name) {
  drive = name;
  current = null;
  settling = { wanted: "", until: 0 };
  lastEstimate.clear();
  forget();
  say("", "");
}

/**
 * @param {Window} window
 * @param {Record<string, Estimate>} estimates
 * @param {number} rate
 */
export function showWindow(window, estimates, rate) {
  for (const { name } of PARAMETERS) {
    const estimate = estimates[name];
    if (estimate?.status === "ok" && estimate.value !== null) lastEstimate.set(name, estimate.value);
  }
  rate_hz = rate;
  if (Date.now() < settling.until && fingerprint(window) !== settling.wanted) return;
  settling.until = 0;
  current = window;
  fill();
}

/** Writes the service's window into every field that the operator has not touched. */
function fill() {
  if (current !== null) {
    const { limits, estimated, held } = current;
    set(length, String(current.length));
    set(periods, String(current.periods_per_row));
    for (const row of rows) {
      const { name, unit } = row.parameter;
      if (!touched.has(row.estimated)) row.estimated.checked = estimated.includes(name);
      if (!touched.has(row.held)) {
        const value = held[name] ?? null;
        row.exponent = engineeringExponent(value, row.exponent);
        set(row.held, value === null ? "" : plain(value / 10 ** row.exponent, 6));
      }
      write(row.unit, prefixed(row.exponent, unit));
    }
    write(element("length-limits"), span(limits.length));
    write(element("periods-limits"), span(limits.periods_per_row));
  }
  for (const row of rows) {
    row.entry.hidden = row.estimated.checked;
    row.take.hidden = !lastEstimate.has(row.parameter.name);
  }
  write(element("length-hint"), seconds(length));
  write(element("periods-hint"), seconds(periods));
  element("window-discard").hidden = element("form-dirty").hidden = touched.size === 0;
}

/** @param {HTMLInputElement} input */
function touch(input) {
  if (!touched.has(input)) say("", "");
  touched.add(input);
  fill();
}

function forget() {
  touched.clear();
  fill();
}

/** @param {HeldRow} row */
function takeEstimate(row) {
  const value = lastEstimate.get(row.parameter.name);
  if (value === undefined) return;
  row.exponent = engineeringExponent(value, row.exponent);
  row.held.value = plain(value / 10 ** row.exponent, 6);
  touch(row.held);
  row.held.focus();
}

async function apply() {
  if (drive === null) return say("No drive to apply this to.", "bad");
  if (touched.size === 0) return say("Nothing has been changed.", "");
  const button = /** @type {HTMLButtonElement} */ (element("window-apply"));
  const sent = new Map([...touched].map((input) => [input, content(input)]));
  const asked = drive;
  button.disabled = true;
  try {
    const answer = await putWindow(asked, change());
    if (asked !== drive) return;
    settling = { wanted: fingerprint(answer), until: Date.now() + SETTLE_MS };
    current = answer;
    for (const [input, value] of sent) if (content(input) === value) touched.delete(input);
    fill();
    say(`Applied at ${clock(new Date())}. The samples already held are kept.`, "good");
  } catch (error) {
    const { message: sentence } = /** @type {Error} */ (error);
    const after = error instanceof NoAnswerError ? " Whether the change was taken is not known." : "";
    if (asked === drive) say(`${sentence}${after}`, "bad");
  } finally {
    button.disabled = false;
  }
}

/**
 * What was touched, in the service's words and SI.
 * @returns {WindowChange}
 */
function change() {
  /** @type {WindowChange} */
  const body = {};
  if (touched.has(length)) body.length = wholeNumber(length, "Window length");
  if (touched.has(periods)) body.periods_per_row = wholeNumber(periods, "Periods per row");
  if (rows.some((row) => touched.has(row.estimated))) {
    body.estimated = rows.filter((row) => row.estimated.checked).map((row) => row.parameter.name);
  }
  const held = rows.filter((row) => touched.has(row.held) && !row.estimated.checked);
  if (held.length > 0) {
    body.held = Object.fromEntries(held.map((row) => [row.parameter.name, heldValue(row)]));
  }
  return body;
}

/** @param {HeldRow} row */
function heldValue(row) {
  const shown = number(row.held, `Held ${row.parameter.meaning}`);
  return Number((shown * 10 ** row.exponent).toPrecision(12));
}

/**
 * @param {HTMLInputElement} input
 * @param {string} what
 */
function number(input, what) {
  const value = parseNumber(input.value);
  if (value === null) throw new Error(`${what}: expected a number, got “${input.value}”.`);
  return value;
}

/**
 * In a count, 1,000 and 1.000 may mean a thousand or one: neither is guessed.
 * @param {HTMLInputElement} input
 * @param {string} what
 */
function wholeNumber(input, what) {
  if (/[.,]/.test(input.value)) throw new Error(`${what}: expected a whole number, got “${input.value}”.`);
  return number(input, what);
}

/**
 * @param {string} text
 * @param {"good" | "bad" | ""} mood
 */
function say(text, mood) {
  message.dataset.mood = mood;
  message.textContent = text;
  if (text !== "") message.scrollIntoView({ block: "nearest" });
}

/** @param {HTMLInputElement} input */
function seconds(input) {
  const samples = parseNumber(input.value);
  return samples === null || samples <= 0 || rate_hz <= 0 ? "" : `= ${duration(samples / rate_hz)}`;
}

/** @param {import("./api.js").Limits} limits */
function span(limits) {
  return `From ${integer(limits.minimum)} to ${integer(limits.maximum)}.`;
}

/** @param {HTMLInputElement} input */
function content(input) {
  return input.type === "checkbox" ? String(input.checked) : input.value;
}

/**
 * @param {HTMLInputElement} input
 * @param {string} text
 */
function set(input, text) {
  if (!touched.has(input) && input.value !== text) input.value = text;
}

/** @param {Window} window */
function fingerprint({ length: samples, periods_per_row, estimated, held }) {
  const values = PARAMETERS.map(({ name }) => (estimated.includes(name) ? "estimated" : held[name]));
  return JSON.stringify([samples, periods_per_row, values]);
}

/**
 * @param {HTMLElement} target
 * @param {string} text
 */
function write(target, text) {
  if (target.textContent !== text) target.textContent = text;
}
