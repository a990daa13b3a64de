/**
 * The banner over the page for when the service itself is gone. Knows nothing of drives.
 */

import { clock } from "../format.js";

const element = /** @type {HTMLElement} */ (document.getElementById("banner"));

/**
 * @param {Date} since
 * @param {string} sentence
 */
export function showLost(since, sentence) {
  const text = `Connection to the service lost since ${clock(since)}. ${sentence} `
    + "Trying again. Numbers below are the last ones received.";
  if (element.textContent !== text) element.textContent = text;
  element.hidden = false;
}

/** @param {string} text */
export function showNotice(text) {
  if (element.textContent !== text) element.textContent = text;
  element.hidden = false;
}

export function hideBanner() {
  element.hidden = true;
  element.textContent = "";
}
