/**
 * Brings a file of recorded rows to the service, and says what was made of it, or why nothing was.
 */

import { bringRecording } from "../api.js";
import { make } from "../dom.js";
import { bytes, counted, duration } from "../format.js";
import { lacking } from "./diagnose_it.js";

const TYPES = ".csv,.gz,.parquet,.mat,.mf4";

/** @param {(recording: import("../api.js").Recording) => void} brought is told what a file has become */
export function bringFile(brought) {
  const file = /** @type {HTMLInputElement} */ (make("input", { id: "bring-file", type: "file", accept: TYPES }));
  const mapping = field("bring-map", "t=Time*1e-3,i_q=Iq[mA]");
  const constants = field("bring-set", "omega_e=0");
  const align = field("bring-align", "u=1");
  const begin = /** @type {HTMLButtonElement} */ (make("button", { type: "submit", class: "primary", id: "bring-start" }, "Bring it"));
  const message = make("p", { class: "form-message", id: "bring-message", role: "status" });
  const form = make("form", { id: "bring-form", onsubmit: (/** @type {Event} */ event) => { event.preventDefault(); bring(); } },
    make("label", { for: "bring-file" }, "CSV, CSV.gz, Parquet, .mat or .mf4"), file,
    ...labelled(mapping, "columns called otherwise"), ...labelled(constants, "in place of columns"), ...labelled(align, "rows that the voltage is late"),
    make("div", { class: "actions" }, begin), message);
  const root = make("details", { class: "bring", id: "bring" }, make("summary", {}, "Bring a file …"), form);

  async function bring() {
    const chosen = file.files?.[0];
    if (chosen === undefined) return say("Choose a file first.", "bad");
    begin.disabled = true;
    say(`${chosen.name}, ${bytes(chosen.size)}, is being read …`, "");
    try {
      const one = await bringRecording(chosen, { map: mapping.value.trim(), set: constants.value.trim(), align: align.value.trim() });
      const without = lacking(one);
      say(`${chosen.name}: ${counted(one.rows, "row")}${one.seconds === null ? "" : `, ${duration(one.seconds)}`}, of ${one.columns.join(", ")}. `
        + (without.length === 0 ? "It can be diagnosed." : `It cannot be diagnosed: it lacks ${without.join(", ")}.`), "good");
      file.value = "";
      brought(one);
    } catch (error) {
      say(/** @type {Error} */ (error).message, "bad");
    }
    begin.disabled = false;
  }

  /** @param {string} text @param {string} mood */
  function say(text, mood) {
    message.dataset.mood = mood;
    message.textContent = text;
  }

  return root;
}

/** @param {string} id @param {string} example @returns {HTMLInputElement} */
function field(id, example) {
  return /** @type {HTMLInputElement} */ (make("input", { id, class: "text", placeholder: example, maxlength: 4000 }));
}

/** @param {HTMLInputElement} of @param {string} words */
function labelled(of, words) {
  return [make("label", { for: of.id }, words), of];
}
