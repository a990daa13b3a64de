/**
 * Elements made by code: `make("li", { class: "row", onclick: f }, "text", other)`. Text is text, never markup.
 * Knows nothing of what they mean.
 */

/** @typedef {Node | string | number | null | undefined | false} Child */

const SVG = "http://www.w3.org/2000/svg";

/**
 * @param {string} tag
 * @param {Record<string, any>} [given] attributes; `on...` listeners; `false`, null and undefined are left out
 * @param {...(Child | Child[])} children
 * @returns {HTMLElement}
 */
export function make(tag, given = {}, ...children) {
  return /** @type {HTMLElement} */ (filled(document.createElement(tag), given, children));
}

/**
 * An element of a vector picture.
 * @param {string} tag
 * @param {Record<string, any>} [given]
 * @param {...(Child | Child[])} children
 */
export function draw(tag, given = {}, ...children) {
  return filled(document.createElementNS(SVG, tag), given, children);
}

/**
 * @param {Element} made
 * @param {Record<string, any>} given
 * @param {(Child | Child[])[]} children
 */
function filled(made, given, children) {
  for (const [key, value] of Object.entries(given)) {
    if (value === false || value === null || value === undefined) continue;
    if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
    else made.setAttribute(key, value === true ? "" : String(value));
  }
  made.append(...children.flat().filter((child) => child !== null && child !== undefined && child !== false)
    .map((child) => (typeof child === "number" ? String(child) : /** @type {Node | string} */ (child))));
  return made;
}
