/**
 * The drive's signals with units and limits, those that may be written with a field to write them, and which have
 * changed since they were looked at last in this browser.
 *
 * @typedef {{name: string, value: number | null, unit: string, access: "const" | "ro" | "rw", writable: boolean,
 *   minimum: number | null, maximum: number | null, summary: string}} Signal
 */

import { readAllSignals, writeSignals } from "../api.js";
import { onHeardAgain } from "../connection.js";
import { make } from "../dom.js";
import { number } from "../fields.js";
import { clock, exact } from "../format.js";
import { unitShown } from "./quantity.js";

const GROUPS = /** @type {const} */ ([["rw", "Settings"], ["ro", "What it tells"], ["const", "What it is"]]);
/** Checksums, codes and words of bits are read in hex. */
const IN_HEX = /(_id|_word|_code|^store|^restore|^lease_holder_[0-9])$/;

/** @param {(signals: Signal[]) => void} heard is told all signals once they are read */
export function signalsView(heard) {
  const filter = /** @type {HTMLInputElement} */ (make("input", { id: "signals-filter", class: "text", type: "search",
    placeholder: "name or meaning", "aria-label": "Search signals" }));
  const again = make("button", { type: "button", id: "signals-read", onclick: read }, "Read again");
  const looked = make("p", { id: "signals-looked", class: "section-note", role: "status" });
  const message = make("p", { id: "signals-message", class: "form-message", role: "alert" });
  const tables = make("div", { id: "signals" });
  const root = make("section", { class: "card padded", "aria-labelledby": "signals-title-2" },
    make("div", { class: "section-head" }, make("h2", { id: "signals-title-2" }, "Signals"), looked),
    make("div", { class: "filters" }, filter, again), message, tables);

  let drive = "";
  /** @type {Signal[]} */
  let signals = [];
  /** Values when they were looked at last, and when that was. @type {{at: string, values: Record<string, number | null>} | null} */
  let before = null;
  /** The one whose value is being typed. */
  let edited = "";

  const place = () => `pmsm-bench signals ${drive}`;

  async function read() {
    const asked = drive;
    looked.textContent = "Reading …";
    try {
      const told = await readAllSignals(asked);
      if (asked !== drive) return;
      signals = told;
      heard(told);
      looked.textContent = `Read ${clock(new Date())}.` + (before === null ? "" : ` Compared with ${clock(before.at)}, when they were looked at last.`);
      show();
    } catch (error) {
      if (asked === drive) looked.textContent = /** @type {Error} */ (error).message;
    }
  }

  function show() {
    const text = filter.value.trim().toLowerCase();
    const fits = signals.filter(({ name, summary }) => `${name} ${summary}`.toLowerCase().includes(text));
    tables.replaceChildren(...GROUPS.flatMap(([access, title]) => {
      const rows = fits.filter((signal) => signal.access === access);
      return rows.length === 0 ? [] : [make("h3", {}, title), make("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": title }, make("table", {},
        make("thead", {}, make("tr", {}, ["signal", "value", "limits", "what it is"].map((head, k) => make("th", { class: k === 1 && "n", scope: "col" }, head)))),
        make("tbody", {}, rows.map(row))))];
    }), ...(fits.length === 0 && signals.length > 0 ? [make("p", { class: "empty" }, "No signal fits the search.")] : []));
  }

  /** @param {Signal} signal */
  function row(signal) {
    const { name, value, access, writable, summary } = signal;
    const was = access === "rw" ? before?.values[name] : undefined;
    const changed = was !== undefined && was !== value;
    return make("tr", { class: changed && "changed" }, make("td", {}, make("code", {}, name)),
      make("td", { class: "n" }, ...(edited === name ? [entry(signal)] : [shown(signal, value),
        changed && make("span", { class: "chip warn" }, `was ${shown(signal, was)}`),
        writable && make("button", { type: "button", class: "small edit", "aria-label": `Change ${name}`, onclick: () => edit(name) }, "Change")])),
      make("td", {}, access === "rw" ? (writable ? limitsOf(signal) : "written by captures") : ""), make("td", {}, summary));
  }

  /** @param {string} name empty: none */
  function edit(name) {
    edited = name;
    say("");
    show();
    tables.querySelector("input")?.select();
  }

  /** @param {Signal} signal */
  function entry(signal) {
    const { name, value, minimum, maximum, unit } = signal;
    const start = minimum !== null && minimum === maximum ? minimum : value;
    const field = /** @type {HTMLInputElement} */ (make("input", { inputmode: "decimal", "aria-label": name, value: start === null ? "" : exact(start, 7) }));
    return make("form", { class: "entry", onsubmit: (/** @type {Event} */ event) => { event.preventDefault(); write(signal, field); } },
      field, make("span", { class: "unit" }, unitShown(unit)),
      make("button", { type: "submit", class: "small primary" }, "Write"),
      make("button", { type: "button", class: "small", onclick: () => edit("") }, "Cancel"));
  }

  /** @param {Signal} signal @param {HTMLInputElement} field */
  async function write({ name }, field) {
    const asked = drive;
    try {
      const wanted = number(field, name);
      const { signals: told } = await writeSignals(asked, { [name]: wanted });
      if (asked !== drive) return;
      signals = signals.map((signal) => told.find((one) => one.name === signal.name) ?? signal);
      edit("");
      say(`${name} was written.`, "good");
    } catch (error) {
      if (asked === drive) say(/** @type {Error} */ (error).message, "bad");
    }
  }

  /** @param {string} text @param {string} [mood] */
  function say(text, mood = "") {
    message.dataset.mood = mood;
    message.textContent = text;
  }

  filter.addEventListener("input", show);
  onHeardAgain(() => { if (drive !== "" && signals.length === 0) read(); });

  return {
    root,
    /** @param {string} name */
    enter(name) {
      drive = name;
      signals = [];
      before = remembered(place());
      edited = "";
      say("");
      tables.replaceChildren();
      read();
    },
    leave() {
      if (signals.length === 0) return;
      const values = Object.fromEntries(signals.filter(({ access }) => access === "rw").map(({ name, value }) => [name, value]));
      try { localStorage.setItem(place(), JSON.stringify({ at: new Date().toISOString(), values })); } catch { /* no room for it */ }
    },
  };
}

/** @param {Signal} signal @param {number | null} value */
function shown({ name, unit }, value) {
  return value === null ? "not known" : `${digits(name, value)} ${unitShown(unit)}`.trim();
}

/** @param {string} name @param {number} value */
function digits(name, value) {
  return IN_HEX.test(name) ? `0x${value.toString(16).toUpperCase()}` : exact(value, 6);
}

/** @param {Signal} signal */
function limitsOf({ name, minimum, maximum }) {
  if (minimum !== null && minimum === maximum) return digits(name, minimum);
  if (minimum !== null && maximum !== null) return `${digits(name, minimum)} … ${digits(name, maximum)}`;
  return minimum !== null ? `from ${digits(name, minimum)}` : maximum !== null ? `up to ${digits(name, maximum)}` : "";
}

/** @param {string} place @returns {{at: string, values: Record<string, number | null>} | null} */
function remembered(place) {
  try {
    return JSON.parse(localStorage.getItem(place) ?? "null");
  } catch {
    return null;
  }
}
