/**
 * A question before what cannot be undone, or moves a motor: asked once, by name. Escape means no, and Stop.
 */

import { make } from "./dom.js";

/**
 * @param {string} question
 * @param {string} more what it means, in a sentence or two
 * @param {string} yes what the button says
 * @returns {Promise<boolean>}
 */
export function confirmed(question, more, yes) {
  return new Promise((answer) => {
    const no = make("button", { type: "button", onclick: () => close(false) }, "Leave it");
    const box = /** @type {HTMLDialogElement} */ (make("dialog", { class: "dialog", "aria-labelledby": "dialog-question" },
      make("h2", { id: "dialog-question" }, question), make("p", {}, more),
      make("div", { class: "actions" }, no,
        make("button", { type: "button", class: "danger", id: "dialog-yes", onclick: () => close(true) }, yes))));
    /** @param {boolean} value */
    function close(value) {
      box.close();
      box.remove();
      answer(value);
    }
    box.addEventListener("cancel", (event) => { event.preventDefault(); close(false); });
    document.body.append(box);
    box.showModal();
    no.focus();
  });
}
