/**
 * The form for method and settings of the estimation. What the operator touches is theirs until it is applied or discarded; all else
 * follows the service. Only what was touched is sent, and the service alone judges it.
 *
 * @typedef {import("../api.js").Window} Window
 * @typedef {import("../api.js").WindowChange} WindowChange
 * @typedef {import("../api.js").Estimate} Estimate
 */

import { NoAnswerError, putWindow } from "../api.js";
import { onHeardAgain } from "../connection.js";
import { chosen, content, element, input, number, wholeNumber, write } from "../fields.js";
import { clock, duration, engineeringExponent, integer, parseNumber, plain, prefixed } from "../format.js";
import { HELD_BY_FILTER, PARAMETERS, writeSymbol } from "../parameters.js";
import { fillTuning, tuningChange } from "./tuning_form.js";

const SETTLE_MS = 3000;
/** Samples offered where the service has told no length, since the data choose it. */
const USUAL_LENGTH = "1000";
const TYPED = "Longer: steadier values. Shorter: follows changes sooner.";
const CHOSEN = "Each parameter rests on as much of the past as fits its present.";

const form = /** @type {HTMLFormElement} */ (element("window-form"));
const methods = /** @type {HTMLInputElement[]} */ ([...document.querySelectorAll('input[name="method"]')]);
/** Stands for all of `methods` where one field must. */
const method = methods[0];
const auto = input("window-auto");
const length = input("window-length");
const longest = input("window-longest");
const periods = input("window-periods");
const forgetting = input("forgetting-factor");
const message = element("form-message");

/**
 * @typedef {object} HeldRow
 * @property {import("../parameters.js").Parameter} parameter
 * @property {HTMLInputElement} estimated
 * @property {HTMLElement} choice the tick box with its words
 * @property {HTMLElement} never what stands there where the method cannot estimate it
 * @property {HTMLElement} label
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
/** Whether what is said is that no answer came. */
let unanswered = false;
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
  onHeardAgain(() => { if (unanswered) say("", ""); });
  element("window-discard").addEventListener("click", () => { forget(); say("", ""); chosen("method")?.focus(); });
}

/**
 * @param {import("../parameters.js").Parameter} parameter
 * @returns {HeldRow}
 */
function buildRow(parameter) {
  const template = /** @type {HTMLTemplateElement} */ (element("held-template"));
  const root = /** @type {HTMLElement} */ (template.content.firstElementChild?.cloneNode(true));
  const find = (/** @type {string} */ selector) => /** @type {any} */ (root.querySelector(selector));
  const row = { parameter, estimated: find(".estimated"), choice: find(".switch"), never: find(".never"),
    label: find(".held-label"), held: find(".held"), entry: find(".entry"), unit: find(".unit"), take: find(".take"),
    exponent: parameter.exponent };
  for (const symbol of root.querySelectorAll(".symbol")) writeSymbol(symbol, parameter);
  row.estimated.id = `estimated-${parameter.name}`;
  row.held.id = `held-${parameter.name}`;
  row.unit.id = `unit-${parameter.name}`;
  row.held.setAttribute("aria-describedby", row.unit.id);
  row.label.htmlFor = row.held.id;
  row.take.setAttribute("aria-label", `${parameter.meaning}: take its last estimate`);
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
    if (!touched.has(method)) for (const one of methods) one.checked = one.value === current.method;
    if (!touched.has(auto)) auto.checked = current.length === "auto";
    if (current.length !== "auto") set(length, String(current.length));
    else if (length.value === "") length.value = USUAL_LENGTH;
    set(longest, String(current.longest));
    set(periods, String(current.periods_per_row));
    set(forgetting, String(current.forgetting_factor));
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
    write(element("length-limits"), span(auto.checked ? limits.longest : limits.length));
    write(element("periods-limits"), span(limits.periods_per_row));
    write(element("forgetting-limits"), span(limits.forgetting_factor));
  }
  fillTuning(current?.ekf ?? null, touched);
  const used = content(method);
  for (const part of /** @type {NodeListOf<HTMLElement>} */ (form.querySelectorAll("[data-methods]"))) {
    part.hidden = !part.dataset.methods?.split(" ").includes(used);
  }
  write(element("length-effect"), auto.checked ? CHOSEN : TYPED);
  element("length-entry").hidden = auto.checked;
  element("longest-entry").hidden = !auto.checked;
  for (const row of rows) fillRow(row, used === "ekf");
  write(element("length-hint"), seconds(length));
  write(element("longest-hint"), seconds(longest));
  write(element("periods-hint"), seconds(periods));
  write(element("forgetting-hint"), memory());
  element("window-discard").hidden = element("form-dirty").hidden = touched.size === 0;
}

/**
 * The Kalman filter starts from the held values, so there they stand beside what is estimated too.
 * @param {HeldRow} row
 * @param {boolean} filter
 */
function fillRow(row, filter) {
  const { name, meaning } = row.parameter;
  const never = filter && name === HELD_BY_FILTER;
  const starts = filter && !never && row.estimated.checked;
  row.choice.hidden = never;
  row.never.hidden = !never;
  row.entry.hidden = row.estimated.checked && !filter;
  row.take.hidden = !lastEstimate.has(name);
  write(row.label, starts ? "start at" : "hold at");
  const label = starts ? `start the ${meaning} at` : `hold the ${meaning} at`;
  if (row.label.getAttribute("aria-label") !== label) row.label.setAttribute("aria-label", label);
}

/** @param {HTMLInputElement} target */
function touch(target) {
  const field = methods.includes(target) ? method : target;
  if (!touched.has(field)) say("", "");
  touched.add(field);
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
  const sent = new Map([...touched].map((field) => [field, content(field)]));
  const asked = drive;
  button.disabled = true;
  try {
    const answer = await putWindow(asked, change());
    if (asked !== drive) return;
    settling = { wanted: fingerprint(answer), until: Date.now() + SETTLE_MS };
    const begins = answer.method === "ekf" || (answer.method === "rls" && (sent.has(method) || sent.has(periods)));
    current = answer;
    for (const [field, value] of sent) if (content(field) === value) touched.delete(field);
    fill();
    const after = begins ? "It begins with the next sample." : "The samples already held are kept.";
    say(`Applied at ${clock(new Date())}. ${after}`, "good");
  } catch (error) {
    const { message: sentence } = /** @type {Error} */ (error);
    const lost = error instanceof NoAnswerError;
    if (asked !== drive) return;
    say(`${sentence}${lost ? " Whether the change was taken is not known." : ""}`, "bad");
    unanswered = lost;
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
  if (touched.has(method)) body.method = /** @type {import("../api.js").Method} */ (content(method));
  if (touched.has(auto) && auto.checked) body.length = "auto";
  else if (!auto.checked && (touched.has(auto) || touched.has(length))) {
    body.length = wholeNumber(length, "Window length");
  }
  if (touched.has(longest)) body.longest = wholeNumber(longest, "Longest window");
  if (touched.has(forgetting)) body.forgetting_factor = number(forgetting, "Forgetting factor");
  if (touched.has(periods)) body.periods_per_row = wholeNumber(periods, "Periods per row");
  if (rows.some((row) => touched.has(row.estimated))) {
    body.estimated = rows.filter((row) => row.estimated.checked).map((row) => row.parameter.name);
  }
  const held = rows.filter((row) => touched.has(row.held) && !row.entry.hidden);
  if (held.length > 0) {
    body.held = Object.fromEntries(held.map((row) => [row.parameter.name, heldValue(row)]));
  }
  const ekf = tuningChange(touched);
  if (ekf !== undefined) body.ekf = ekf;
  return body;
}

/** @param {HeldRow} row */
function heldValue(row) {
  const shown = number(row.held, `Held ${row.parameter.meaning}`);
  return Number((shown * 10 ** row.exponent).toPrecision(12));
}

/**
 * @param {string} text
 * @param {"good" | "bad" | ""} mood
 */
function say(text, mood) {
  unanswered = false;
  message.dataset.mood = mood;
  message.textContent = text;
  if (text !== "") message.scrollIntoView({ block: "nearest" });
}

/** @param {HTMLInputElement} field */
function seconds(field) {
  const samples = parseNumber(field.value);
  return samples === null || samples <= 0 || rate_hz <= 0 ? "" : `= ${duration(samples / rate_hz)}`;
}

/** How long rows are remembered, by the forgetting factor. */
function memory() {
  const lam = parseNumber(forgetting.value);
  const m = parseNumber(periods.value);
  if (lam === null || m === null || lam <= 0 || lam > 1 || rate_hz <= 0) return "";
  return lam === 1 ? "remembers all" : `remembers about ${duration(m / (1 - lam) / rate_hz)}`;
}

/** @param {import("../api.js").Limits} limits */
function span({ minimum, maximum }) {
  const [least, most] = [minimum, maximum].map((limit) => (Number.isInteger(limit) ? integer(limit) : plain(limit, 6)));
  return `From ${least} to ${most}.`;
}

/**
 * @param {HTMLInputElement} field
 * @param {string} text
 */
function set(field, text) {
  if (!touched.has(field) && field.value !== text) field.value = text;
}

/** @param {Window} window */
function fingerprint(window) {
  return JSON.stringify({ ...window, limits: null });
}
