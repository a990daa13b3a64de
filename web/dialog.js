/**
 * A question before what cannot be undone, or moves a motor: asked once, by name. The rooms wait for the answer, the bar
 * does not: Stop can be pressed. Escape means no, and Stop, as everywhere, and each question says so; another room means no.
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
    const no = make("button", { type: "button", onclick: () => close(false) }, "Cancel");
    const box = /** @type {HTMLDialogElement} */ (make("dialog", { class: "dialog", "aria-labelledby": "dialog-question" },
      make("h2", { id: "dialog-question" }, question), make("p", {}, more),
      make("p", { class: "help" }, "Escape stops the motor, too. Cancel only closes this."),
      make("div", { class: "actions" }, no,
        make("button", { type: "button", class: "danger", id: "dialog-yes", onclick: () => close(true) }, yes))));
    const shade = make("div", { class: "shade" }, box);
    const rooms = document.querySelectorAll("main");
    const listening = new AbortController();
    /** @param {boolean} value */
    function close(value) {
      listening.abort();
      shade.remove();
      for (const room of rooms) room.inert = false;
      answer(value);
    }
    document.addEventListener("keydown", ({ key }) => { if (key === "Escape") close(false); }, listening);
    window.addEventListener("hashchange", () => close(false), listening);
    for (const room of rooms) room.inert = true;
    document.body.append(shade);
    box.show();
    no.focus();
  });
}
