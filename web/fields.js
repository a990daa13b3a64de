/**
 * Fields of a form: numbers as people type them, and writing only what changed. Knows nothing of what they mean.
 */

import { parseNumber } from "./format.js";

/** @param {string} id */
export const element = (id) => /** @type {HTMLElement} */ (document.getElementById(id));

/** @param {string} id */
export const input = (id) => /** @type {HTMLInputElement} */ (document.getElementById(id));

/**
 * @param {HTMLElement} target
 * @param {string} text
 */
export function write(target, text) {
  if (target.textContent !== text) target.textContent = text;
}

/** What a field holds, as text. @param {HTMLInputElement} field */
export function content(field) {
  if (field.type === "radio") return chosen(field.name)?.value ?? "";
  return field.type === "checkbox" ? String(field.checked) : field.value;
}

/** The checked one of some radio buttons. @param {string} name */
export function chosen(name) {
  return /** @type {HTMLInputElement | null} */ (document.querySelector(`input[name="${name}"]:checked`));
}

/**
 * @param {HTMLInputElement} field
 * @param {string} what
 */
export function number(field, what) {
  const value = parseNumber(field.value);
  if (value === null) throw new Error(`${what}: expected a number, got “${field.value}”.`);
  return value;
}

/**
 * In a count, 1,000 and 1.000 may mean a thousand or one: neither is guessed.
 * @param {HTMLInputElement} field
 * @param {string} what
 */
export function wholeNumber(field, what) {
  if (/[.,]/.test(field.value)) throw new Error(`${what}: expected a whole number, got “${field.value}”.`);
  return number(field, what);
}
